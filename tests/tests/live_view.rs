//! A live view behind the picture: composited only, and bit for bit the picture that a still of the same pixels gives.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, put};
use relume_tests::program::{Outcome, bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const VIEWS: u32 = 3;
const SIZE: (u32, u32) = (64, 48);

/// A picture of the view: every pixel another code than in the one before.
fn view(number: u32, size: (u32, u32)) -> image::RgbImage {
    image::RgbImage::from_fn(size.0, size.1, |x, y| image::Rgb([(x * 3) as u8, (y * 5) as u8, (number * 80) as u8]))
}

fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "live-view");
        write_courtyard(&folder);
        let args =
            ["scene", "scene.glb", "--camera", "camera.json", "--size", "64x48", "--directions", "64", "-o", "a.field"];
        bake_in(&folder, &args).well();
        for (name, size) in [("views", SIZE), ("large", (96, 72)), ("wide", (96, 48))] {
            let views = folder.join(name);
            std::fs::create_dir(&views).unwrap();
            let list: Vec<String> = (0..VIEWS)
                .map(|number| {
                    view(number, size).save(views.join(format!("{number}.png"))).unwrap();
                    format!("{{\"file\":\"{number}.png\",\"time_s\":0.01}}")
                })
                .collect();
            put(&views.join("frames.json"), format!("[{}]", list.join(",")));
        }
        folder
    })
}

/// Runs a post with this view and sky, under `[run]` so; its pictures go into a folder of the post's name.
fn run(name: &str, view_and_sky: &str, run: &str) -> Outcome {
    let text = format!(
        "field = 'a.field'\n{view_and_sky}\n[display]\nkind = 'headless'\nfolder = '{name}'\n\
         [run]\nstart = 2026-06-21T06:00:00Z\n{run}\n"
    );
    put(&folder().join(format!("{name}.toml")), text);
    relume_in(folder(), &["run", &format!("{name}.toml"), "--json"])
}

/// A simulated sky before a live view of the pictures in this folder.
fn live(views: &str) -> String {
    format!("sky = 'simulated'\n[site]\nlatitude = 41.9\nlongitude = 12.5\n[view_camera]\nframes = '{views}'")
}

/// The state of the view at the end.
fn view_state(outcome: &Outcome) -> serde_json::Value {
    serde_json::from_str::<serde_json::Value>(&outcome.stdout).unwrap()["health"]["view"].take()
}

fn picture(name: &str, frame: u32) -> image::RgbImage {
    image::open(folder().join(name).join(format!("frame_{frame:06}.png"))).unwrap().into_rgb8()
}

#[test]
fn every_frame_of_a_live_view_is_that_of_a_still_with_its_pixels() {
    let told = run("live", &live("views"), "step_s = 1200\nframes = 7\nlight_log = 'light.jsonl'").well();
    let view = view_state(&told);
    assert_eq!((&view["state"], &view["pictures"], &view["faults"]), (&"fresh".into(), &7.into(), &0.into()), "{view}");
    for number in 0..VIEWS {
        let still = format!("view = 'views/{number}.png'\nsky = 'logged'\n[camera]\nlight_log = 'light.jsonl'");
        run(&format!("still{number}"), &still, "").well();
    }
    for frame in 0..7 {
        let live = picture("live", frame);
        let still = |number: u32| picture(&format!("still{}", number % VIEWS), frame);
        assert!(live == still(frame), "frame {frame}");
        assert!(live != still(frame + 1), "frame {frame}: the view shows");
    }
}

#[test]
fn while_the_light_stays_nothing_but_the_view_is_composited() {
    let told =
        run("composited", &live("views"), "step_s = 0.001\nframes = 6\n[exposure]\nmode = 'fixed'\nev = -3.0").well();
    assert_eq!(view_state(&told)["frames_composited"], 5, "{}", told.stdout);
    assert!((1..6).all(|frame| picture("composited", frame) != picture("composited", frame - 1)));
}

#[test]
fn pictures_of_the_same_shape_are_scaled_and_others_refused() {
    run("scaled", &live("large"), "frames = 1").well();
    // Up there is nothing but the view, a ramp that is one and a half times as steep as in a picture of the field's size.
    let pixel = picture("scaled", 0)[(20, 2)];
    let expected = view(0, (96, 72))[(30, 3)];
    assert!((0..2).all(|c| pixel[c].abs_diff(expected[c]) <= 3), "{pixel:?} {expected:?}");
    run("wide-run", &live("wide"), "frames = 1").refused(2, &["96x48", "64x48", "view_camera.size"]);
    let told = relume_in(folder(), &["check", "wide-run.toml"]);
    assert!(told.code == Some(2) && told.stdout.contains("BAD  live"), "{}", told.stdout);
    let told = relume_in(folder(), &["check", "scaled.toml"]).well();
    assert!(told.stdout.contains("96x72, scaled to 64x48"), "{}", told.stdout);
}
