//! A post without a camera, headless: it opens, shows pictures that follow the light, and ends when told.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::program::{bake_in, relume, relume_in};
use relume_tests::scene::write_courtyard;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

fn field() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "run");
        write_courtyard(&folder);
        let args =
            ["scene", "scene.glb", "--camera", "camera.json", "--size", "64x48", "--directions", "64", "-o", "a.field"];
        bake_in(&folder, &args).well();
        image::RgbImage::from_pixel(64, 48, image::Rgb([90, 110, 140])).save(folder.join("view.png")).unwrap();
        folder
    })
}

/// A post's file with its pictures in a folder of the same name.
fn post(name: &str, sky: &str, run: &str) -> String {
    let text = format!(
        "title = 'The yard'\nfield = 'a.field'\nview = 'view.png'\nsky = '{sky}'\n\
         [site]\nlatitude = 41.9\nlongitude = 12.5\n[weather]\ncloud_cover = 0.2\n\
         [display]\nkind = 'headless'\nfolder = '{name}'\n{run}"
    );
    put(&field().join(format!("{name}.toml")), text);
    format!("{name}.toml")
}

fn light_of(path: &Path) -> f64 {
    let picture = image::open(path).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (64, 48));
    // The ground in front, clear of the title at the foot.
    let pixels: Vec<f64> =
        (28..36).flat_map(|y| (2..62).map(move |x| (x, y))).map(|(x, y)| f64::from(picture[(x, y)][1])).collect();
    pixels.iter().sum::<f64>() / pixels.len() as f64
}

#[test]
fn a_simulated_day_is_shown_from_night_to_noon() {
    let fixed = "[exposure]\nmode = 'fixed'\nev = -3.0\n";
    let file =
        post("day", "simulated", &format!("{fixed}[run]\nstart = 2026-06-21T00:00:00Z\nstep_s = 10800\nframes = 5\n"));
    let told = relume_in(field(), &["run", &file, "--json"]).well();
    let report: serde_json::Value = serde_json::from_str(&told.stdout).unwrap();
    assert_eq!(report["frames"], 5, "{}", told.stdout);
    let totals = &report["health"]["totals"];
    let total = |name: &str| totals[name].as_u64().unwrap();
    let tiles: u64 = ["tiles_drawn", "tiles_kept", "tiles_empty"].map(total).iter().sum();
    assert_eq!((tiles, total("tiles_drawn_exposed_anew")), (5 * 12, 0), "{totals}");
    assert!(total("tiles_drawn") > 12 && total("blocks_projected") > 0, "{totals}");
    assert!(told.stderr.contains(&format!("tiles: {} drawn", total("tiles_drawn"))), "{}", told.stderr);
    let folder = field().join("day");
    let pictures: Vec<String> = names(&folder).into_iter().filter(|name| name.ends_with(".png")).collect();
    let expected: Vec<String> = (0..5).map(|k| format!("frame_{k:06}.png")).collect();
    assert_eq!(pictures, expected);
    let light: Vec<f64> = pictures.iter().map(|name| light_of(&folder.join(name))).collect();
    eprintln!("{light:?}");
    assert!(light[0] < 10.0, "it is night: {light:?}");
    assert!(light[2] > light[0] + 40.0 && light[3] > light[1], "the sun rises: {light:?}");
    let health: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("health.json")).unwrap()).unwrap();
    assert_eq!((&health["state"], &health["frames"]), (&"ok".into(), &5.into()), "{health}");
    assert!(names(&folder).iter().all(|name| name.ends_with(".png") || name == "health.json"), "{:?}", names(&folder));
}

#[test]
fn a_synthetic_camera_lights_the_post_too() {
    let file = post("camera", "synthetic", "[run]\nstart = 2026-06-21T09:00:00Z\nstep_s = 600\nframes = 2\n");
    relume_in(field(), &["run", &file]).well();
    let folder = field().join("camera");
    assert!(light_of(&folder.join("frame_000001.png")) > 20.0);
    let health: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("health.json")).unwrap()).unwrap();
    assert_eq!(health["weights"], "fresh", "{health}");
}

/// More than rounding is always left, so that the least budget there is cannot be kept everywhere; a generous one can.
#[test]
fn a_post_tells_which_error_budget_its_field_cannot_keep() {
    let told_of = |codes: &str| {
        let name = format!("budget-{codes}");
        let budget =
            format!("[budget]\nerror_codes = {codes}\n[run]\nstart = 2026-06-21T09:00:00Z\nstep_s = 60\nframes = 3\n");
        let told = relume_in(field(), &["run", &post(&name, "simulated", &budget), "--json"]).well();
        let report: serde_json::Value = serde_json::from_str(&told.stdout).unwrap();
        let (frame, note) = (report["health"]["frame"].clone(), report["health"]["note"].to_string());
        (frame["bound_codes"].as_f64().unwrap(), frame["tiles_beyond_budget"].as_u64().unwrap(), note)
    };
    let (bound, tiles, note) = told_of("0.6");
    assert!(bound > 0.6 && tiles > 0, "{bound} {tiles}");
    assert!(note.contains(&format!("{tiles} tiles cannot be held to the error budget")), "{note}");
    let (bound, tiles, note) = told_of("4");
    assert!(bound <= 4.0 && tiles == 0 && !note.contains("budget"), "{bound} {tiles} {note}");
}

#[test]
fn check_tells_a_good_post_from_a_bad_one() {
    let good = post("good", "simulated", "[run]\nstart = 2026-06-21T09:00:00Z\n");
    let told = relume_in(field(), &["check", &good]).well();
    assert!(told.stdout.contains("ok ") && !told.stdout.contains("BAD"), "{}", told.stdout);
    let text = std::fs::read_to_string(field().join(&good)).unwrap();
    put(&field().join("bad.toml"), text.replace("view.png", "lost.png"));
    let told = relume_in(field(), &["check", "bad.toml", "--json"]);
    told.refused(2, &["bad.toml"]);
    assert!(told.stdout.contains("lost.png"), "{}", told.stdout);
}

#[test]
fn a_post_ends_when_told_to() {
    let file = post("endless", "simulated", "[run]\nstart = 2026-06-21T09:00:00Z\nstep_s = 1\nspeed = 1.0\n");
    let mut child = relume().args(["run", &file]).current_dir(field()).spawn().unwrap();
    let first = field().join("endless/frame_000000.png");
    let started = Instant::now();
    while !first.exists() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let told = std::process::Command::new("kill").arg("-TERM").arg(child.id().to_string()).status().unwrap();
    assert!(told.success());
    let asked = Instant::now();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(asked.elapsed() < Duration::from_secs(10), "took {:?} to end", asked.elapsed());
    assert!(first.exists());
}

#[test]
fn logged_light_makes_the_same_pictures_again() {
    let run = "[run]\nstart = 2026-06-21T03:00:00Z\nstep_s = 5400\nframes = 6\n";
    let first = post("logging", "simulated", &format!("{run}light_log = 'light.jsonl'\n"));
    relume_in(field(), &["run", &first]).well();
    let again = "title = 'The yard'\nfield = 'a.field'\nview = 'view.png'\nsky = 'logged'\n[camera]\nlight_log = 'light.jsonl'\n\
                 [display]\nkind = 'headless'\nfolder = 'again'\n[run]\nstart = 2026-06-21T03:00:00Z\n";
    put(&field().join("again.toml"), again);
    relume_in(field(), &["run", "again.toml"]).well();
    for k in 0..6 {
        let [first, again] = ["logging", "again"]
            .map(|folder| image::open(field().join(folder).join(format!("frame_{k:06}.png"))).unwrap().into_rgb8());
        assert!(first == again, "frame {k}");
    }
    // Half a log is a fault of the sky that is told, not the end of the post.
    let log = std::fs::read_to_string(field().join("light.jsonl")).unwrap();
    put(&field().join("light.jsonl"), &log[..log.len() - 40]);
    let told = relume_in(field(), &["run", "again.toml", "--json"]).well();
    assert!(told.stderr.contains("light.jsonl: line 6: not a light"), "{}", told.stderr);
}
