//! Patches that fit the scene (`--adaptive`), through both programs.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::light::{Light, patches};
use relume_tests::picture::{read_exr, read_grey, relative_rmse, write_exr};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

const BAKE: [&str; 12] = [
    "scene.glb",
    "--camera",
    "camera.json",
    "--size",
    "36x20",
    "--directions",
    "64",
    "--adaptive",
    "--materials",
    "lambert",
    "--sun-paths",
    "8",
];

fn courtyard(name: &str) -> PathBuf {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), name);
    write_courtyard(&folder);
    folder
}

fn args<'a>(command: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&[command][..], &BAKE, &["-o", out], more].concat()
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

/// A sky without a sun: brighter towards one side and the horizon, a soft bright spot.
fn sky(dir: [f64; 3]) -> [f32; 3] {
    let [x, y, z] = dir;
    let spot = (8.0 * (0.6 * x + 0.5 * y - 0.62 * z - 1.0)).exp();
    [1.0 + 0.4 * x + 2.0 * spot, 1.2 - 0.3 * y + 2.0 * spot, 1.5 + 0.2 * z + 2.0 * spot].map(|v| v as f32)
}

/// Mean of a channel of [`sky`] over the sphere.
fn mean_of_sky(channel: usize) -> f64 {
    let n = 200_000;
    let at = |k: usize| {
        let (y, azimuth) = (1.0 - (2.0 * k as f64 + 1.0) / n as f64, k as f64 * 2.399_963_229_728_653);
        let radius = (1.0 - y * y).sqrt();
        f64::from(sky([radius * azimuth.cos(), y, radius * azimuth.sin()])[channel])
    };
    (0..n).map(at).sum::<f64>() / n as f64
}

/// The light of each row of a `W.csv`.
fn weights(file: &Path) -> Vec<[f64; 3]> {
    let text = std::fs::read_to_string(file).unwrap();
    let light = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        [numbers[4], numbers[5], numbers[6]]
    };
    text.lines().skip(1).map(light).collect()
}

/// The map whose direction `dir` shows [`sky`] at RotY(`turn_deg`) `dir`: `--env-rot` by the same angle makes it `sky` again.
fn write_sky(path: &Path, turn_deg: f64) {
    const SIZE: (usize, usize) = (256, 128);
    write_exr(path, SIZE, |col, row| {
        let theta = PI * (row as f64 + 0.5) / SIZE.1 as f64;
        let azimuth = TAU * ((col as f64 + 0.5) / SIZE.0 as f64 - 0.5);
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let (x, z) = (theta.sin() * azimuth.cos(), theta.sin() * azimuth.sin());
        sky([x * cos + z * sin, theta.cos(), z * cos - x * sin])
    });
}

/// One bake in all its ways: whole with a stack, in shares, imported again; lit by a map, a turned map and `W.csv`.
#[test]
fn a_field_of_fitted_patches_goes_all_the_ways_of_another() {
    let folder = courtyard("adaptive");
    let told = bake_in(&folder, &args("scene", "a.field", &["--stack", "stack"])).well();
    assert!(told.stderr.contains("directions: "), "{}", told.stderr);
    let info = bake_in(&folder, &["info", "a.field"]).well().stdout;
    assert!(info.contains("cut to the scene: 0.0") && info.contains("layer     CUTS"), "{info}");

    // The stack's own text of each patch: all of the sphere, of different sizes, as many as equal ones would be.
    let (listed, _) = patches(&folder.join("stack"));
    let total: f64 = listed.iter().map(|patch| patch.solid_angle_sr).sum();
    let sizes = || listed.iter().map(|patch| patch.solid_angle_sr);
    let (least, most) = (sizes().fold(f64::MAX, f64::min), sizes().fold(0.0, f64::max));
    assert!((total - 2.0 * TAU).abs() < 1e-4 && listed.len() == 68, "{total} {}", listed.len());
    assert!(most > 1.9 * least, "{least} to {most} sr: nothing was cut or merged");

    write_sky(&folder.join("sky.exr"), 0.0);
    write_sky(&folder.join("turned.exr"), -60.0);
    let relight = |field: &str, light: &[&str], out: &str| {
        relume_in(&folder, &[&["relight", field], light, &["-o", out]].concat()).well();
        read_exr(&folder.join(out)).rgb
    };
    // Weights of the map by themselves: its whole light, and the picture that their sum over the stack is.
    relume_in(&folder, &["sky", "weights", "sky.exr", "--field", "a.field", "-o", "W.csv"]).well();
    let radiance = weights(&folder.join("W.csv"));
    assert_eq!(radiance.len(), listed.len() + 1, "the sun comes last");
    for c in 0..3 {
        let light: f64 = listed.iter().zip(&radiance).map(|(patch, rgb)| patch.solid_angle_sr * rgb[c]).sum();
        let whole = mean_of_sky(c) * 2.0 * TAU;
        assert!((light / whole - 1.0).abs() < 1e-3, "{c}: {light} of {whole}");
    }
    let exact = Light { radiance: radiance[..listed.len()].to_vec(), sun: None }.sum(&folder.join("stack")).rgb;
    let covered = read_grey(&folder.join("stack/coverage.exr"));
    let shown = relight("a.field", &["--sky", "sky.exr"], "sky_shown.exr");
    assert!(relative_rmse(&shown, &exact, &covered) < 0.01, "{}", relative_rmse(&shown, &exact, &covered));
    let weighed = relight("a.field", &["--weights", "W.csv"], "weighed.exr");
    assert!(relative_rmse(&weighed, &shown, &covered) < 1e-3, "{}", relative_rmse(&weighed, &shown, &covered));

    // A map turned one way and turned back by the command is the same light.
    let turned = relight("a.field", &["--sky", "turned.exr", "--env-rot", "-60"], "turned_shown.exr");
    assert!(relative_rmse(&turned, &shown, &covered) < 0.005, "{}", relative_rmse(&turned, &shown, &covered));
    let wrong = relight("a.field", &["--sky", "turned.exr", "--env-rot", "60"], "wrong_shown.exr");
    assert!(relative_rmse(&wrong, &shown, &covered) > 0.02, "{}", relative_rmse(&wrong, &shown, &covered));

    // The stack comes back by `import` as the same patches.
    bake_in(&folder, &["import", "stack", "-o", "back.field"]).well();
    let id = |field: &str| {
        let info = bake_in(&folder, &["info", field, "--json"]).well().stdout;
        info.split("\"patch_set_id\":\"").nth(1).unwrap()[..8].to_owned()
    };
    assert_eq!(id("back.field"), id("a.field"));
    let back = relight("back.field", &["--sky", "sky.exr"], "back_shown.exr");
    assert!(relative_rmse(&back, &exact, &covered) < 0.01);
}

#[test]
fn shares_of_a_plan_keep_its_patches() {
    let folder = courtyard("adaptive_shares");
    bake_in(&folder, &args("scene", "whole.field", &["--threads", "1"])).well();
    bake_in(&folder, &args("plan", "plan.toml", &["--threads", "2"])).well();
    for (tiles, out) in [("0..1", "a"), ("1..2", "b")] {
        bake_in(&folder, &["scene", "--plan", "plan.toml", "--tiles", tiles, "-o", out]).well();
    }
    bake_in(&folder, &["merge", "plan.toml", "b", "a", "-o", "joined.field"]).well();
    assert!(bytes(&folder.join("joined.field")) == bytes(&folder.join("whole.field")), "the bytes differ");

    let plan = std::fs::read_to_string(folder.join("plan.toml")).unwrap();
    let cuts = plan.lines().find(|line| line.starts_with("cuts = ")).unwrap();
    let share = |plan: &str, more: &[&str]| {
        put(&folder.join("bent.toml"), plan);
        let args = ["scene", "--plan", "bent.toml", "--tiles", "0..1", "-o", "x"];
        bake_in(&folder, &[&args[..], more].concat())
    };
    share(&plan.replace(cuts, "cuts = \"100001\""), &[]).refused(2, &["bent.toml", "cuts"]);
    share(&plan.replace(cuts, ""), &[]).refused(2, &["bent.toml", "changed"]);
    share(&plan, &["--adaptive"]).refused(2, &["patches", "the plan's"]);
    let more: Vec<&str> = args("scene", "x", &["--directions", "1025"]);
    bake_in(&folder, &more).refused(2, &["--directions", "1025"]);
    assert!(!names(&folder).iter().any(|name| name == "x" || name.ends_with(".part")));
}
