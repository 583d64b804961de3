//! A view camera that is not the ideal one: a curve of its own, a tint, a wrong pose. What the post makes of it, and what
//! `relume check` says.

#![allow(clippy::unwrap_used)]

use relume_bake::environment::Reference;
use relume_tests::files::{fresh_folder, put};
use relume_tests::light::{Light, patches};
use relume_tests::program::relume_in;
use relume_tests::receiversite::{SIZE, bake_site, clear, code, off, save_view, scene_of};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A folder with the site baked, and `film.csv`.
fn baked() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "view_calibration");
        bake_site(&folder);
        let row = |code: u32| {
            let v = f64::from(code) / 255.0;
            format!("{v},{},{},{}\n", film(v, 0), film(v, 1), film(v, 2))
        };
        put(&folder.join("film.csv"), "code/max,R,G,B\n".to_owned() + &(0..256).map(row).collect::<String>());
        folder
    })
}

/// Linear light of a code / max of a camera far from sRGB: power laws, and a film-like S in green.
fn film(code: f64, channel: usize) -> f64 {
    let s = code * code * (3.0 - 2.0 * code);
    [code.powf(1.8), 0.5 * (s + s * s), code.powf(2.6)][channel]
}

/// Its code, 0 to 255, of linear light.
fn film_code(light: f64, channel: usize) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if film(middle, channel) < light { low = middle } else { high = middle }
    }
    255.0 * low
}

fn read_png(name: &str) -> image::RgbImage {
    image::open(baked().join(name)).unwrap().into_rgb8()
}

/// Codes by which an even film view is shown wrongly, at most and rms: receivers by the stacks' sums in f64, edges by coverage.
fn errors_over_even_view(light: &Light, more: &[&str]) -> (f64, f64) {
    let folder = baked();
    let codes = [120u8, 140, 100];
    image::RgbImage::from_pixel(SIZE.0, SIZE.1, image::Rgb(codes)).save(folder.join("flat.png")).unwrap();
    put(&folder.join("w.csv"), light.csv(&folder.join("stack")));
    let args =
        ["relight", "a.field", "--weights", "w.csv", "--view", "flat.png", "--exposure", "-1", "-o", "flat_out.png"];
    relume_in(folder, &[&args[..], more].concat()).well();
    let shown = read_png("flat_out.png");
    let [own, with, without] = ["stack", "stack/with", "stack/without"].map(|stack| light.sum(&folder.join(stack)));
    let (mut most, mut squares) = (0.0f64, 0.0);
    for at in 0..own.rgb.len() {
        let real = 1.0 - own.alpha[at];
        let share = if real > 0.0 { (with.alpha[at] / real).min(1.0) } else { 0.0 };
        for (c, &own_code) in codes.iter().enumerate() {
            let lit = without.rgb[at][c];
            let ratio = if lit > 0.0 { with.rgb[at][c] / lit } else { 1.0 };
            let view = film(f64::from(own_code) / 255.0, c);
            let expected = code(own.rgb[at][c] * 0.5 + real * view * (1.0 + share * (ratio - 1.0)));
            let error = (f64::from(shown.as_raw()[3 * at + c]) - expected).abs();
            most = most.max(error);
            squares += error * error;
        }
    }
    (most, (squares / (3 * own.rgb.len()) as f64).sqrt())
}

#[test]
fn shadows_and_edges_over_a_view_of_another_curve_are_right_in_linear_light() {
    let count = patches(&baked().join("stack")).0.len();
    let light = Light { radiance: vec![[0.6, 0.7, 0.9]; count], sun: Some([2.5, 2.3, 2.0]) };
    let by_curve = errors_over_even_view(&light, &["--view-response", "film.csv"]);
    let as_srgb = errors_over_even_view(&light, &[]);
    eprintln!("codes off, most and rms: by its curve {by_curve:.2?}, as sRGB {as_srgb:.2?}");
    // As over a view that is sRGB, and half a code of rounding more.
    assert!(by_curve.0 <= 4.0 && by_curve.1 < 0.6, "{by_curve:?}");
    assert!(as_srgb.1 > 5.0, "the same without the curve: {as_srgb:?}");
}

/// Exposures of the view camera, red, green and blue.
const EXPOSURES: [f64; 3] = [0.45, 0.5, 0.4];

/// Runs a post over a live view whose only picture is `view`, and gives what it shows and its health.
fn run(name: &str, view: &Path, keys: &str) -> (image::RgbImage, serde_json::Value) {
    put(&baked().join(format!("{name}.toml")), post(name, view, keys, "mode = 'view'"));
    let told = relume_in(baked(), &["run", &format!("{name}.toml"), "--json"]).well().stdout;
    (
        read_png(&format!("{name}/frame_000000.png")),
        serde_json::from_str::<serde_json::Value>(&told).unwrap()["health"].take(),
    )
}

/// A post by logged light over a live view of one picture, which is moved into a folder of its own.
fn post(name: &str, view: &Path, keys: &str, exposure: &str) -> String {
    let frames = baked().join(format!("{name}_frames"));
    std::fs::create_dir_all(&frames).unwrap();
    std::fs::copy(view, frames.join("0.png")).unwrap();
    put(&frames.join("frames.json"), "[{\"file\":\"0.png\",\"time_s\":0.01}]");
    clear().log(baked(), 1);
    format!(
        "field = 'a.field'\nsky = 'logged'\n[camera]\nlight_log = 'light.jsonl'\n[view_camera]\nframes = '{name}_frames'\n\
         {keys}\n[display]\nkind = 'headless'\nfolder = '{name}'\n[exposure]\n{exposure}\n\
         [run]\nstart = 2026-06-21T04:00:00Z\nframes = 1\n"
    )
}

#[test]
fn a_live_view_of_another_curve_has_its_true_gain_and_shows_the_house_as_it_would_be() {
    let (folder, scene, sky) = (baked(), scene_of(baked()), clear());
    let real = sky.traced(folder, &scene.real(), 11);
    save_view(&folder.join("film.png"), &real, |light, c| film_code(light * EXPOSURES[c], c));
    save_view(&folder.join("whole.png"), &sky.traced(folder, &scene, 12), |light, c| code(light * EXPOSURES[c]));
    let whole = read_png("whole.png");
    let gain_error = |health: &serde_json::Value| {
        let error = |c: usize| health["view_gain"]["gain"][c].as_f64().unwrap() / EXPOSURES[c] - 1.0;
        (0..3).map(|c| error(c).abs()).fold(0.0, f64::max)
    };
    let (by_curve, health) = run("by_curve", &folder.join("film.png"), "response = 'film.csv'");
    let (as_srgb, health_as_srgb) = run("as_srgb", &folder.join("film.png"), "");
    let (found, missed) = (gain_error(&health), gain_error(&health_as_srgb));
    let (right, wrong) = (off(&by_curve, &whole), off(&as_srgb, &whole));
    eprintln!(
        "gain off by {:.2} %, as sRGB {:.0} %; codes off (median, 95 %, mean) {right:.2?}, as sRGB {wrong:.2?}",
        100.0 * found,
        100.0 * missed
    );
    assert!(found < 0.02 && right.0 <= 1.0 && right.1 <= 5.0, "{found} {right:?}");
    assert!(missed > 0.1 && wrong.0 >= 5.0, "the same without the curve: {missed} {wrong:?}");
}

#[test]
fn curves_that_cannot_be_are_named_by_line() {
    let folder = baked();
    image::RgbImage::new(SIZE.0, SIZE.1).save(folder.join("black.png")).unwrap();
    let toml = post("bad_curve", &folder.join("black.png"), "response = 'bad.csv'", "mode = 'auto'");
    put(&folder.join("bad_curve.toml"), toml);
    for (rows, parts) in [
        ("code/max,R,G,B\n0,0,0,0\n0.5,0.6,0.6,0.6\n0.7,0.5,0.7,0.7\n1,1,1,1\n", ["bad.csv", "line 4", "falls"]),
        ("0,0,0,0\n1,1,1,0.9\n", ["bad.csv", "light 1", "divide"]),
        ("0,0,0,0\n0.9,1,1,1\n", ["bad.csv", "code/max", "from 0 to 1"]),
    ] {
        put(&folder.join("bad.csv"), rows);
        relume_in(folder, &["run", "bad_curve.toml"]).refused(2, &parts);
        let told = relume_in(folder, &["check", "bad_curve.toml"]);
        assert!(told.code == Some(2) && told.stdout.contains("BAD  live by"), "{}", told.stdout);
        let args = [
            "relight",
            "a.field",
            "--light",
            "0,1,0",
            "--view",
            "black.png",
            "--view-response",
            "bad.csv",
            "-o",
            "x.png",
        ];
        relume_in(folder, &args).refused(2, &parts);
    }
    let args = ["relight", "a.field", "--light", "0,1,0", "--view-response", "film.csv", "-o", "x.png"];
    relume_in(folder, &args).refused(2, &["--view-response", "--view STILL"]);
}

/// The site without its house as the view camera takes it: `tint` times as bright as an exposure of 0.5.
fn real() -> &'static Reference {
    static REAL: OnceLock<Reference> = OnceLock::new();
    REAL.get_or_init(|| clear().traced(baked(), &scene_of(baked()).real(), 21))
}

fn tinted(name: &str, tint: [f64; 3]) -> PathBuf {
    let path = baked().join(format!("{name}.png"));
    save_view(&path, real(), |light, c| code(light * 0.5 * tint[c]));
    path
}

/// What `relume check` says of a post over this view: all of it, and the rows that are marked as advice.
fn advice(name: &str, view: &Path, exposure: &str) -> (String, Vec<String>) {
    put(&baked().join(format!("{name}.toml")), post(name, view, "", exposure));
    let told = relume_in(baked(), &["check", &format!("{name}.toml")]).well().stdout;
    eprintln!("{name}:\n{told}");
    let advised = told.lines().filter_map(|line| line.strip_prefix("see  ")).map(String::from).collect();
    (told, advised)
}

#[test]
fn check_finds_nothing_to_calibrate_where_the_view_agrees() {
    let (told, advised) = advice("agrees", &tinted("agrees", [1.0; 3]), "mode = 'fixed'\nev = -1.0");
    assert_eq!(advised, [""; 0], "{told}");
    assert!(told.contains("ok   receivers") && told.contains("EV -1.0") && told.contains("ok   pose"), "{told}");
}

#[test]
fn check_tells_a_tint_an_exposure_and_a_pose_apart() {
    let only = |name: &str, view: &Path, exposure: &str, parts: &[&str]| {
        let (told, advised) = advice(name, view, exposure);
        assert_eq!(advised.len(), 1, "{told}");
        assert!(parts.iter().all(|part| advised[0].contains(part)), "{told}");
    };
    let fixed = "mode = 'fixed'\nev = -1.0";
    only("tint", &tinted("tint", [1.15, 1.0, 0.85]), fixed, &["tint", "red +15 %", "white balance"]);
    only("bright", &tinted("bright", [1.5; 3]), fixed, &["exposure", " stops darker", "exposure.ev = -0.4"]);
    // The camera has been turned by three pixels to the right and one up: what it sees moves the other way.
    let view = image::open(tinted("straight", [1.0; 3])).unwrap().into_rgb8();
    let turned = image::RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| view[((x + 3).min(SIZE.0 - 1), y.saturating_sub(1))]);
    turned.save(baked().join("turned.png")).unwrap();
    only(
        "turned",
        &baked().join("turned.png"),
        fixed,
        &["pose", "px to the left", "px further down", "relume-bake camera"],
    );
    // Both at once, in the view's own white and exposure: nothing but the pose is left to do.
    let (told, advised) = advice("by_view", &tinted("by_view", [1.5, 1.2, 0.9]), "mode = 'view'");
    assert_eq!(advised, [""; 0], "{told}");
}

#[test]
fn what_is_painted_in_front_is_not_measured_by() {
    let folder = baked();
    let mut view = image::open(tinted("painted", [1.0; 3])).unwrap().into_rgb8();
    for (width, name) in [(24, "quarter"), (56, "most")] {
        // A dark trunk from the left edge, and nothing in the model of it.
        let is_trunk = |x: u32| x < width;
        view.enumerate_pixels_mut()
            .filter(|(x, ..)| is_trunk(*x))
            .for_each(|(.., pixel)| *pixel = image::Rgb([24, 20, 18]));
        view.save(folder.join("painted_view.png")).unwrap();
        let mask = image::GrayImage::from_fn(SIZE.0, SIZE.1, |x, _| image::Luma([255 * u8::from(is_trunk(x))]));
        mask.save(folder.join("mask.png")).unwrap();
        let text = format!("mask = 'mask.png'\n{}", post(name, &folder.join("painted_view.png"), "", "mode = 'view'"));
        put(&folder.join("painted.toml"), &text);
        let told = relume_in(folder, &["check", "painted.toml"]).well().stdout;
        assert!(told.contains("ok   mask") && !told.contains("see  "), "{told}");
        let health = relume_in(folder, &["run", "painted.toml", "--json"]).well().stdout;
        let health: serde_json::Value = serde_json::from_str(&health).unwrap();
        let gain = health["health"]["view_gain"]["gain"][1].as_f64().unwrap();
        assert!((gain / 0.5 - 1.0).abs() < 0.02, "{width}: {gain}");
    }
}

#[test]
fn check_refuses_what_a_post_does_not_open_with() {
    let folder = baked();
    let live = post("refused", &tinted("refused", [1.0; 3]), "", "mode = 'fixed'\nev = 0.0");
    let still = live.replace("[view_camera]\nframes = 'refused_frames'\n", "");
    image::GrayImage::new(40, 30).save(folder.join("small.png")).unwrap();
    image::GrayImage::from_pixel(SIZE.0, SIZE.1, image::Luma([255])).save(folder.join("all.png")).unwrap();
    let light = clear().csv(folder);
    let bare = ["scene", "demo", "--size", "48x32", "--directions", "16", "--sun-paths", "1", "-o", "bare.field"];
    relume_tests::program::bake_in(folder, &bare).well();
    let by_view = live.replace("mode = 'fixed'\nev = 0.0", "mode = 'view'").replace("a.field", "bare.field");
    let cases = [
        (format!("mask = 'none.png'\n{live}"), ["BAD  mask", "none.png"]),
        (format!("mask = 'small.png'\n{live}"), ["BAD  mask", "40x30"]),
        (format!("view = 'refused.png'\nview_light = 'none.csv'\n{still}"), ["BAD  light then", "none.csv"]),
        // In front of every receiver: nothing is left to tell how the still was exposed.
        (
            format!("mask = 'all.png'\nview = 'refused.png'\nview_light = '{light}'\n{still}"),
            ["BAD  light then", "too little"],
        ),
        (by_view, ["BAD  exposure", "relume = receiver"]),
    ];
    for (text, parts) in cases {
        put(&folder.join("refused.toml"), &text);
        for command in ["check", "run"] {
            let told = relume_in(folder, &[command, "refused.toml"]);
            assert_eq!(told.code, Some(2), "{command}: {told:?}");
            let parts = if command == "check" { &parts[..] } else { &parts[1..] };
            assert!(parts.iter().all(|part| (told.stdout.clone() + &told.stderr).contains(part)), "{told:?}");
        }
    }
}

#[test]
fn check_tells_a_lens_that_darkens_its_corners() {
    let path = baked().join("vignetted.png");
    let mut dark = real().clone();
    let middle = [0.5 * f64::from(SIZE.0 - 1), 0.5 * f64::from(SIZE.1 - 1)];
    for (at, rgb) in dark.rgb.iter_mut().enumerate() {
        let (x, y) = (at as u32 % SIZE.0, at as u32 / SIZE.0);
        let square = (f64::from(x) - middle[0]).powi(2) + (f64::from(y) - middle[1]).powi(2);
        let falloff = 1.0 - 0.4 * square / (middle[0] * middle[0] + middle[1] * middle[1]);
        *rgb = rgb.map(|v| v * falloff as f32);
    }
    save_view(&path, &dark, |light, _| code(light * 0.5));
    let (told, advised) = advice("vignetted", &path, "mode = 'view'");
    assert!(advised.len() == 1 && advised[0].contains("evenness") && advised[0].contains("vignetting"), "{told}");
}

#[test]
fn check_says_when_it_cannot_tell_and_why() {
    let folder = baked();
    let black = folder.join("night.png");
    image::RgbImage::new(SIZE.0, SIZE.1).save(&black).unwrap();
    let (told, advised) = advice("night", &black, "mode = 'view'");
    assert!(advised.is_empty() && told.contains("cannot tell") && told.contains("black or clipped"), "{told}");
    let text = post("model", &black, "", "mode = 'view'").replace(
        "sky = 'logged'\n[camera]\nlight_log = 'light.jsonl'",
        "sky = 'simulated'\n[site]\nlatitude = 41.9\nlongitude = 12.5",
    );
    put(&folder.join("model.toml"), &text);
    let told = relume_in(folder, &["check", "model.toml"]).well().stdout;
    assert!(told.contains("cannot tell") && told.contains("a model's light"), "{told}");
}

#[test]
fn check_takes_a_still_by_the_light_it_was_taken_in() {
    let folder = baked();
    tinted("still", [1.1, 1.0, 0.9]);
    let light = clear().csv(folder);
    let live = post("still_then", &folder.join("still.png"), "", "mode = 'fixed'\nev = 0.0");
    let still = |keys: &str| {
        let text = live.replace("[view_camera]\nframes = 'still_then_frames'\n", "");
        put(&folder.join("still_then.toml"), format!("view = 'still.png'\n{keys}\n{text}"));
        relume_in(folder, &["check", "still_then.toml"]).well().stdout
    };
    let told = still("");
    assert!(told.contains("cannot tell") && told.contains("write view_light"), "{told}");
    let told = still(&format!("view_light = '{light}'"));
    assert!(told.contains("EV -1.0") && told.contains("the still is relit") && !told.contains("see  "), "{told}");
    let told = still(&format!("view_light = '{light}'\nview_response = 'film.csv'"));
    assert!(told.contains("ok   still by") && told.contains("film.csv: 256 codes"), "{told}");
}
