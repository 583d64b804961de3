//! Real ground in the shadow of what is not there: marks in the scene, the field's receivers, the view behind.

#![allow(clippy::unwrap_used)]

use relume::damage::Damage;
use relume::painter::{Painter, field::FieldPainter};
use relume::weights::PatchWeights;
use relume_bake::environment::Reference;
use relume_bake::scene::{Role, Scene};
use relume_tests::files::{fresh_folder, put};
use relume_tests::light::{Light, patches};
use relume_tests::picture::{read_exr, read_grey};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::receiversite::{
    SIZE, bake_args as args, bake_site, clear, code, linear, off, overcast, save_view, scene_of, sun_dir_world,
};
use relume_tests::scene::{courtyard, glb, site, write_site};
use std::path::Path;
use std::sync::OnceLock;

/// A folder with the site baked, and its stacks.
fn baked() -> &'static Path {
    static FOLDER: OnceLock<std::path::PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "receivers");
        bake_site(&folder);
        folder
    })
}

fn read_png(path: &Path) -> image::RgbImage {
    image::open(path).unwrap().into_rgb8()
}

fn as_view(folder: &Path, name: &str, picture: &Reference, exposure: f64) {
    save_view(&folder.join(name), picture, |light, _| code(light * exposure));
}

fn scene() -> Scene {
    scene_of(baked())
}

#[test]
fn the_view_is_multiplied_by_what_the_stacks_say() {
    let (folder, count) = (baked(), patches(&baked().join("stack")).0.len());
    let uneven = (0..count).map(|k| [0.2 + 0.8 * f64::from(u8::from(k % 3 == 0)), 0.5, 0.9]).collect();
    let lights =
        [Light { radiance: vec![[1.0; 3]; count], sun: None }, Light { radiance: uneven, sun: Some([2.5, 2.3, 2.0]) }];
    image::RgbImage::from_pixel(SIZE.0, SIZE.1, image::Rgb([120, 140, 100])).save(folder.join("flat.png")).unwrap();
    let view = [120, 140, 100].map(linear);
    for (light, name) in lights.iter().zip(["even", "sun"]) {
        put(&folder.join("w.csv"), light.csv(&folder.join("stack")));
        let out = format!("{name}.png");
        let relight =
            ["relight", "a.field", "--weights", "w.csv", "--view", "flat.png", "--exposure", "-1", "-o", &out];
        relume_in(folder, &relight).well();
        let shown = read_png(&folder.join(&out));
        let [own, with, without] = ["stack", "stack/with", "stack/without"].map(|stack| light.sum(&folder.join(stack)));
        let (mut most, mut squares, mut darkest) = (0.0f64, 0.0, 1.0f64);
        for at in 0..own.rgb.len() {
            let real = 1.0 - own.alpha[at];
            let share = if real > 0.0 { (with.alpha[at] / real).min(1.0) } else { 0.0 };
            for (c, view) in view.iter().enumerate() {
                let ratio = match without.rgb[at][c] {
                    light if light > 0.0 => with.rgb[at][c] / light,
                    _ => 1.0,
                };
                let expected = code(own.rgb[at][c] * 0.5 + real * view * (1.0 + share * (ratio - 1.0)));
                let found = f64::from(shown.as_raw()[3 * at + c]);
                most = most.max((found - expected).abs());
                squares += (found - expected).powi(2);
                darkest = darkest.min(if share > 0.99 { ratio } else { 1.0 });
            }
        }
        let rms = (squares / (3 * own.rgb.len()) as f64).sqrt();
        eprintln!("{name}: {most:.2} codes at most, rms {rms:.3}, darkest ratio {darkest:.2}");
        assert!(darkest < 0.6, "{name}: no shadow: {darkest}");
        assert!(most <= 6.0 && rms < 0.6, "{name}: {most} codes, rms {rms}");
    }
}

#[test]
fn a_real_picture_with_the_house_put_in_is_the_picture_of_the_house() {
    let (folder, scene, sky) = (baked(), scene(), clear());
    let own = patches(&folder.join("stack")).1.unwrap().dir_world;
    assert!((0..3).all(|k| (own[k] - f64::from(sun_dir_world()[k])).abs() < 1e-3), "{own:?}");
    as_view(folder, "real.png", &sky.traced(folder, &scene.real(), 1), 0.5);
    as_view(folder, "whole.png", &sky.traced(folder, &scene, 2), 0.5);
    let (weights, view) = (sky.csv(folder), "real.png");
    let relight = ["relight", "a.field", "--weights", &weights, "--view", view, "--exposure", "-1", "-o", "shown.png"];
    relume_in(folder, &relight).well();
    let [real, whole, shown] = ["real.png", "whole.png", "shown.png"].map(|name| read_png(&folder.join(name)));
    let (before, after) = (off(&real, &whole), off(&shown, &whole));
    eprintln!("codes off, median, 95 % and mean: without the house {before:?}, with it put in {after:?}");
    // What is left is the noise of two path traces, and the light of patches at the shadow's edge.
    assert!(after.0 <= 1.0 && after.1 <= 5.0 && after.2 < 0.25 * before.2, "{after:?} {before:?}");
}

#[test]
fn a_still_of_a_sunny_day_is_shown_on_a_grey_one() {
    let (folder, scene) = (baked(), scene());
    let (then, now) = (clear(), overcast());
    as_view(folder, "then.png", &then.traced(folder, &scene.real(), 3), 0.6);
    as_view(folder, "now.png", &now.traced(folder, &scene, 4), 0.8);
    let (then_light, weights) = (then.csv(folder), now.csv(folder));
    let args = ["relight", "a.field", "--weights", &weights, "--view", "then.png", "--exposure", "-0.321928", "-o"];
    relume_in(folder, &[&args[..], &["still.png", "--view-light", &then_light]].concat()).well();
    relume_in(folder, &[&args[..], &["as_it_was.png"]].concat()).well();
    let [then, now, still, as_it_was] =
        ["then.png", "now.png", "still.png", "as_it_was.png"].map(|name| read_png(&folder.join(name)));
    let (before, without, after) = (off(&then, &now), off(&as_it_was, &now), off(&still, &now));
    eprintln!("codes off, median, 95 % and mean: the still {before:?}, not relit {without:?}, relit {after:?}");
    assert!(after.0 <= 2.0 && after.1 <= 9.0 && after.2 < 0.25 * without.2, "{after:?} {without:?}");
    let too_little = [&args[..], &["x.png", "--view-light", &then_light]].concat();
    image::RgbImage::new(SIZE.0, SIZE.1).save(folder.join("then.png")).unwrap();
    relume_in(folder, &too_little).refused(2, &["clear.csv", "too little", "receiver"]);
}

/// A painter of the field with its receivers before a view.
fn dark_painter<'f>(file: &'f relume::relight::FieldFile, view: &image::RgbImage) -> FieldPainter<'f> {
    let pixels_bgrx = view.pixels().map(|p| u32::from_be_bytes([0, p[0], p[1], p[2]])).collect();
    let still = relume::view::Still { width: SIZE.0 as usize, height: SIZE.1 as usize, pixels_bgrx };
    let mut painter = FieldPainter::new(file.field(), still, 1);
    painter.show_receivers(file.receivers());
    painter
}

/// The weights of the clear sky.
fn clear_weights(file: &relume::relight::FieldFile) -> PatchWeights {
    PatchWeights::load(&baked().join(clear().csv(baked())), file.field().patch_set()).unwrap()
}

/// The same under the clear sky.
fn painter<'f>(file: &'f relume::relight::FieldFile, view: &image::RgbImage) -> (FieldPainter<'f>, PatchWeights) {
    let (mut painter, weights) = (dark_painter(file, view), clear_weights(file));
    painter.relight(&weights, 1.0).unwrap();
    (painter, weights)
}

fn field_file() -> relume::relight::FieldFile {
    relume::relight::FieldFile::open(&baked().join("a.field")).unwrap()
}

/// The view's gain by the field's receivers, under the clear sky.
fn gain(view: &image::RgbImage) -> [f64; 3] {
    let seen = painter(&field_file(), view).0.view_gain().unwrap();
    assert!(seen.scatter < 0.1, "{seen:?}");
    seen.gain
}

#[test]
fn where_receivers_change_the_view_is_composited_and_nowhere_else() {
    let file = field_file();
    let view = image::RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| image::Rgb([x as u8 * 2, 90, y as u8 * 3]));
    let drawn = |painter: &mut FieldPainter<'_>| painter.draw(&mut Damage::none(96, 64)).unwrap();
    let (mut still, clear_sky) = painter(&file, &view);
    drawn(&mut still);
    let before = still.pixels_bgrx().to_vec();
    assert_eq!(drawn(&mut still).tiles_composited, 0);
    // Light goes out where it matters to the ground's shadow more than to the house: one patch after the other, until some
    // tile of the ground changes and not all do.
    let tiles = drawn(&mut still).tiles;
    let mut weights = clear_sky.clone();
    let mut some = 0;
    for patch in 0..weights.radiance.len() {
        weights.radiance[patch] = weights.radiance[patch].map(|light| 0.9 * light);
        still.relight(&weights, 1.0).unwrap();
        let counters = drawn(&mut still);
        assert!(counters.tiles_composited <= counters.receiver_tiles_drawn, "{counters:?}");
        some += usize::from(counters.receiver_tiles_drawn > 0 && counters.tiles_composited < tiles);
    }
    assert!(some > 0 && still.pixels_bgrx() != before, "{some}");
    // In the end it shows what a post shows that begins in this light, but for what changes of less than half a code are.
    let (mut fresh, _) = painter(&file, &view);
    fresh.relight(&weights, 1.0).unwrap();
    drawn(&mut fresh);
    let code = |word: u32, c: usize| i32::from(word.to_be_bytes()[1 + c]);
    let pairs = || still.pixels_bgrx().iter().zip(fresh.pixels_bgrx());
    assert!(pairs().all(|(&a, &b)| (0..3).all(|c| (code(a, c) - code(b, c)).abs() <= 1)));
}

/// The clear sky with its sun moved by some degrees, clockwise; without it if by none.
fn with_sun_at(clear: &PatchWeights, turned_deg: Option<f32>) -> PatchWeights {
    let sun = clear.sun.zip(turned_deg).map(|(sun, turned_deg)| {
        let ([x, y, z], (sin, cos)) = (sun.dir_world, turned_deg.to_radians().sin_cos());
        relume::weights::SunWeight { dir_world: [cos * x - sin * z, y, sin * x + cos * z], ..sun }
    });
    PatchWeights { sun, ..clear.clone() }
}

/// The largest difference of two pictures, codes.
fn apart(a: &[u32], b: &[u32]) -> u8 {
    let codes = |words: &[u32]| words.iter().flat_map(|word| word.to_be_bytes()).collect::<Vec<u8>>();
    codes(a).iter().zip(codes(b)).map(|(a, b)| a.abs_diff(b)).max().unwrap()
}

#[test]
fn a_sun_that_is_traced_behind_frames_comes_to_house_and_ground_in_one_frame() {
    let file: &'static relume::relight::FieldFile = Box::leak(Box::new(field_file()));
    let view = image::RgbImage::from_pixel(SIZE.0, SIZE.1, image::Rgb([120, 110, 100]));
    let clear = clear_weights(file);
    let picture = |weights: &PatchWeights| {
        let mut painter = dark_painter(file, &view);
        painter.relight(weights, 1.0).unwrap();
        painter.draw(&mut Damage::none(96, 64)).unwrap();
        (painter.pixels_bgrx().to_vec(), painter.view_gain().unwrap().gain[1])
    };
    let mut behind = dark_painter(file, &view);
    behind.trace_behind(0.05).unwrap();
    let without = picture(&with_sun_at(&clear, None));
    let mut before = without.clone();
    // The last is of another time of day: until it is traced, no sun is shown.
    for turned_deg in (0..24).map(|k| if k % 2 == 0 { 0.0 } else { 6.0 }).chain([120.0]) {
        let weights = with_sun_at(&clear, Some(turned_deg));
        let after = picture(&weights);
        let before_now = if turned_deg == 120.0 { &without } else { &before };
        assert!(apart(&before_now.0, &after.0) > 20);
        loop {
            // New light may come with any frame.
            behind.relight(&weights, 1.0).unwrap();
            behind.draw(&mut Damage::none(96, 64)).unwrap();
            let shown = behind.pixels_bgrx();
            let off = [before_now, &after].map(|(pixels, _)| apart(pixels, shown));
            assert!(
                off.iter().any(|&off| off <= 2),
                "{turned_deg}: neither the sun before nor this one: {off:?} codes"
            );
            let gain = behind.view_gain().map(|seen| seen.gain[1]);
            assert_eq!(gain.is_none(), behind.sun_dir_world().is_none());
            let is_of = |(_, known): &(Vec<u32>, f64)| gain.is_none_or(|gain| (gain / known - 1.0).abs() < 0.01);
            assert!(is_of(before_now) || is_of(&after), "{turned_deg}: {gain:?}");
            if behind.sun_dir_world() == weights.sun.map(|sun| sun.dir_world) {
                break;
            }
        }
        assert!(apart(&after.0, behind.pixels_bgrx()) <= 2);
        before = after;
    }
}

#[test]
fn visitors_do_not_change_what_is_known_of_the_views_exposure() {
    let folder = baked();
    let exposures = [0.45, 0.5, 0.4];
    let real = clear().traced(folder, &scene().real(), 5);
    let mut tinted = real.clone();
    tinted.rgb.iter_mut().for_each(|rgb| (0..3).for_each(|c| rgb[c] *= exposures[c] as f32));
    as_view(folder, "tinted.png", &tinted, 1.0);
    let view = read_png(&folder.join("tinted.png"));
    let found = gain(&view);
    let error = |found: [f64; 3]| (0..3).map(|c| (found[c] / exposures[c] - 1.0).abs()).fold(0.0, f64::max);
    eprintln!("gain {found:?}: off by {:.2} %", 100.0 * error(found));
    assert!(error(found) < 0.02, "{found:?}");
    // People in dark and in bright clothes before a fifth of the ground.
    for (name, clothes) in [("dark", [18u8, 20, 26]), ("bright", [235, 225, 215])] {
        let mut visited = view.clone();
        for (x, y, pixel) in visited.enumerate_pixels_mut() {
            if x / 5 % 5 == 2 && y > 26 {
                *pixel = image::Rgb(clothes);
            }
        }
        let found = gain(&visited);
        eprintln!("{name} visitors: {found:?}: off by {:.2} %", 100.0 * error(found));
        assert!(error(found) < 0.02, "{name}: {found:?}");
    }
}

#[test]
fn a_post_follows_a_view_camera_that_exposes_anew() {
    let folder = baked();
    let real = clear().traced(folder, &scene().real(), 6);
    std::fs::create_dir_all(folder.join("views")).unwrap();
    let mut list = Vec::new();
    for (number, exposure) in [0.3, 0.3, 0.6, 0.6].into_iter().enumerate() {
        as_view(&folder.join("views"), &format!("{number}.png"), &real, exposure);
        list.push(format!("{{\"file\":\"{number}.png\",\"time_s\":0.01}}"));
    }
    put(&folder.join("views/frames.json"), format!("[{}]", list.join(",")));
    clear().log(folder, 4);
    let run = |name: &str, frames: u32| {
        let text = format!(
            "field = 'a.field'\nsky = 'logged'\n[camera]\nlight_log = 'light.jsonl'\n[view_camera]\nframes = 'views'\n\
             [display]\nkind = 'headless'\nfolder = '{name}'\n[exposure]\nmode = 'view'\n\
             [run]\nstart = 2026-06-21T04:00:00Z\nstep_s = 1\nframes = {frames}\n"
        );
        put(&folder.join("post.toml"), text);
        let told = relume_in(folder, &["run", "post.toml", "--json"]).well().stdout;
        serde_json::from_str::<serde_json::Value>(&told).unwrap()["health"]["exposure_ev"].as_f64().unwrap()
    };
    let (before, after) = (run("two", 2), run("three", 3));
    eprintln!("exposure {:.4} and, in the frame that the view doubles in, {:.4}", before.exp2(), after.exp2());
    assert!((before.exp2() / 0.3 - 1.0).abs() < 0.02 && (after.exp2() / 0.6 - 1.0).abs() < 0.02);
}

#[test]
fn what_stands_in_front_cuts_what_is_shown() {
    let folder = baked();
    let scene = scene();
    let count = |role| (0..scene.triangles.len() as u32).filter(|&k| scene.role(k) == role).count();
    assert_eq!([count(Role::Virtual), count(Role::Receiver), count(Role::Occluder)], [12, 14, 12]);
    let [own, with, without] =
        ["stack", "stack/with", "stack/without"].map(|s| read_grey(&folder.join(s).join("coverage.exr")));
    assert!(with == without, "the receivers' pixels differ");
    assert!(own.iter().zip(&with).all(|(own, with)| own + with <= 1.0 + 1e-6));
    // The trunk hides both: a column of pixels over its whole height.
    let hidden = |x: usize| (22..42).all(|y| own[y * 96 + x] == 0.0 && with[y * 96 + x] == 0.0);
    assert!((0..96).any(hidden), "nothing hides what is shown");
    assert!(own.iter().any(|share| *share > 0.0 && *share < 1.0));
    let alpha = {
        let light = Light { radiance: vec![[1.0; 3]; patches(&folder.join("stack")).0.len()], sun: None };
        put(&folder.join("one.csv"), light.csv(&folder.join("stack")));
        relume_in(folder, &["relight", "a.field", "--weights", "one.csv", "-o", "one.exr"]).well();
        read_exr(&folder.join("one.exr")).alpha
    };
    assert!(alpha.iter().zip(&own).all(|(a, b)| (a - b).abs() <= 0.5 / 255.0 + 1e-6 || *b < 1.0 / 255.0));
}

#[test]
fn shares_of_a_site_join_to_the_field_of_one_bake() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "receiver_shares");
    write_site(&folder);
    let coarse = ["--max-hits", "2", "--sun-paths", "8"];
    bake_in(&folder, &args("scene", "whole.field", &coarse)).well();
    let told = bake_in(&folder, &args("plan", "plan.toml", &[&coarse[..], &["--json"]].concat())).well();
    assert_eq!(told.stdout, "{\"tiles\":18}\n");
    for (tiles, out) in [("0..7", "a"), ("7..18", "b")] {
        bake_in(&folder, &["scene", "--plan", "plan.toml", "--tiles", tiles, "-o", out]).well();
    }
    bake_in(&folder, &["merge", "plan.toml", "b", "a", "-o", "joined.field"]).well();
    assert!(std::fs::read(folder.join("joined.field")).unwrap() == std::fs::read(folder.join("whole.field")).unwrap());
    let info = bake_in(&folder, &["info", "whole.field"]).well().stdout;
    assert!(
        info.contains("receivers ") && info.contains("layer     RCVW") && info.contains("layer     RCVO"),
        "{info}"
    );
}

#[test]
fn marks_that_mean_nothing_are_named() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "receiver_marks");
    write_site(&folder);
    let mut meshes = site();
    meshes[0].role = Some("recevier");
    put(&folder.join("scene.glb"), glb(&meshes, None));
    bake_in(&folder, &args("scene", "a.field", &[]))
        .refused(2, &["scene.glb", "node 0", "relume = \"recevier\"", "receiver"]);
    // Everything is really there: there is nothing to show.
    meshes.iter_mut().for_each(|mesh| mesh.role = Some("Receiver "));
    put(&folder.join("scene.glb"), glb(&meshes, None));
    bake_in(&folder, &args("scene", "a.field", &["--max-hits", "2"])).refused(2, &["receivers and occluders only"]);
    assert!(!folder.join("a.field").exists());
    // Without marks there are no such layers.
    put(
        &folder.join("scene.glb"),
        glb(&courtyard(), Some(relume_tests::scene::Picture::Inside(&relume_tests::scene::checks_png()))),
    );
    bake_in(&folder, &args("scene", "a.field", &["--max-hits", "2"])).well();
    assert!(!bake_in(&folder, &["info", "a.field"]).well().stdout.contains("RCV"));
}
