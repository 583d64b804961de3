//! A scene becomes a field, a sky becomes weights, both become a picture: through the programs, against sums of the
//! stack that are made here.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::light::{Light, patches};
use relume_tests::picture::{Linear, read_exr, read_grey, relative_rmse, write_exr};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const SUN: [f64; 2] = [130.0, 42.0];

/// The courtyard baked once, with its stack and a sun.
fn baked() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "pipeline");
        write_courtyard(&folder);
        let captured = |x: usize, y: usize| [0.4 + (x % 16) as f32 / 8.0, 0.9, 1.5 - y as f32 / 32.0];
        write_exr(&folder.join("captured.exr"), (64, 32), captured);
        let sun = format!("{},{}", SUN[0], SUN[1]);
        bake_in(&folder, &bake_args("3", "a.field", &["--stack", "stack", "--sun", &sun])).well();
        folder
    })
}

fn bake_args<'a>(threads: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec!["scene", "scene.glb", "--camera", "camera.json", "--size", "64x48", "--directions", "64"];
    args.extend(["--test-sky", "captured.exr", "--threads", threads, "-o", out]);
    args.extend(more);
    args
}

/// An overcast sky, a clear one with a glow around the sun, and an evening with light from one side and below.
fn lights() -> [(&'static str, Light); 3] {
    let (patches, sun) = patches(&baked().join("stack"));
    let sun = sun.expect("the stack has a sun").dir_world;
    let make = |sky: &dyn Fn([f64; 3]) -> [f64; 3], sun| {
        let radiance = patches.iter().map(|patch| sky(patch.dir_world)).collect();
        Light { radiance, sun }
    };
    let overcast = make(&|d| [(1.0 + 2.0 * d[1].max(0.0)) / 3.0; 3].map(|v| if d[1] > 0.0 { v } else { 0.07 }), None);
    let glow = |d: [f64; 3]| (d[0] * sun[0] + d[1] * sun[1] + d[2] * sun[2]).max(0.0).powi(12);
    let clear = |d: [f64; 3]| [0.15, 0.25, 0.5].map(|v| if d[1] > 0.0 { v + 2.0 * glow(d) } else { 0.2 });
    let evening =
        |d: [f64; 3]| [1.2 + d[0], 0.8 + 0.6 * d[0], 0.5 + 0.1 * d[0]].map(|v| if d[1] > 0.0 { v } else { 0.3 });
    [("overcast", overcast), ("clear", make(&clear, None)), ("evening", make(&evening, None))]
}

fn relit(light: &Light, name: &str, more: &[&str]) -> Linear {
    let (weights, out) = (format!("{name}.csv"), format!("{name}.exr"));
    put(&baked().join(&weights), light.csv(&baked().join("stack")));
    let mut args = vec!["relight", "a.field", "--weights", &weights, "-o", &out];
    args.extend(more);
    relume_in(baked(), &args).well();
    read_exr(&baked().join(out))
}

#[test]
fn one_thread_and_three_give_the_same_bytes() {
    bake_in(baked(), &bake_args("1", "b.field", &[])).well();
    let [a, b] = ["a.field", "b.field"].map(|name| std::fs::read(baked().join(name)).unwrap());
    assert!(a == b, "{} and {} bytes, or their contents, differ", a.len(), b.len());
    let other = ["--seed", "2"];
    bake_in(baked(), &bake_args("2", "c.field", &other)).well();
    assert!(a != std::fs::read(baked().join("c.field")).unwrap(), "the seed changes nothing");
}

#[test]
fn a_field_shows_what_the_sum_of_its_stack_shows() {
    for (name, light) in lights() {
        let exact = light.sum(&baked().join("stack"));
        let shown = relit(&light, name, &[]);
        assert_eq!((shown.width, shown.height), (64, 48));
        let error = relative_rmse(&shown.rgb, &exact.rgb, &exact.alpha);
        eprintln!("{name}: {:.3} %", 100.0 * error);
        // A field's coverage has 8 bits.
        let alpha = shown.alpha.iter().zip(&exact.alpha).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(alpha <= 0.5 / 255.0 + 1e-6, "{name}: coverage differs by {alpha}");
        assert!(
            shown.rgb.iter().zip(&exact.alpha).all(|(rgb, a)| *a > 0.0 || *rgb == [0.0; 3]),
            "{name}: light on nothing"
        );
        assert!(error <= 0.005, "{name}: relative RMSE {error}");
    }
}

#[test]
fn exact_is_the_f64_sum_of_the_stack() {
    for (name, mut light) in lights() {
        light.sun = Some([9.0, 8.5, 7.5]);
        let own = light.sum(&baked().join("stack"));
        let exact = relit(&light, &format!("exact-{name}"), &["--exact", "stack"]);
        let error = relative_rmse(&exact.rgb, &own.rgb, &own.alpha);
        assert!(error < 1e-6, "{name}: {error}");
        assert_eq!(exact.alpha, own.alpha, "{name}");
    }
}

#[test]
fn a_sky_goes_through_the_weights_file_unchanged() {
    // A sky without a sun: broad blue and a warm side, sampled finely enough for 64 patches.
    let sky = |x: usize, y: usize| {
        let (theta, phi) = (PI * (y as f64 + 0.5) / 64.0, (x as f64 + 0.5) / 128.0 * 2.0 * PI);
        [0.5 + 0.3 * phi.cos(), 0.6, 0.7 + 0.2 * theta.cos()].map(|v| v as f32)
    };
    write_exr(&baked().join("sky.exr"), (128, 64), sky);
    relume_in(baked(), &["relight", "a.field", "--sky", "sky.exr", "-o", "direct.exr"]).well();
    relume_in(baked(), &["sky", "weights", "sky.exr", "--field", "a.field", "-o", "sky.csv"]).well();
    relume_in(baked(), &["relight", "a.field", "--weights", "sky.csv", "-o", "by-file.exr"]).well();
    let [direct, by_file] = ["direct.exr", "by-file.exr"].map(|name| read_exr(&baked().join(name)));
    assert_eq!(direct, by_file);
    // Each row of the file is the mean of the sky over its patch: its directions are the manifest's, and the solid
    // angles give the sky's whole integral.
    let text = std::fs::read_to_string(baked().join("sky.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|line| line.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    let (patches, _) = patches(&baked().join("stack"));
    assert_eq!(rows.len(), patches.len() + 1);
    let integral: f64 = rows[..patches.len()].iter().map(|row| row[3] * row[5]).sum();
    assert!((integral - 0.6 * 4.0 * PI).abs() < 1e-3 * integral, "{integral}");
    for (row, patch) in rows.iter().zip(&patches) {
        assert!((0..3).all(|k| (row[k] - patch.dir_world[k]).abs() < 1e-5));
        let expected = 0.5 + 0.3 * -patch.dir_world[0] / patch.dir_world[0].hypot(patch.dir_world[2]).max(0.2);
        assert!((row[4] - expected).abs() < 0.12 || patch.dir_world[1].abs() > 0.9, "{row:?}: {expected}");
    }
    assert!(rows[patches.len()][4..].iter().all(|&v| v == 0.0), "a sun was invented");
}

#[test]
fn turning_the_map_is_turning_its_pixels() {
    // Positive turns +Z towards +X: the bright spot at +Z (u = 3/4) must act like one at +X (u = 1/2).
    let spot = |u: f64| {
        move |x: usize, y: usize| {
            let away = ((x as f64 + 0.5) / 128.0 - u).abs() * 2.0 * PI;
            let theta = PI * (y as f64 + 0.5) / 64.0;
            [0.1 + (theta.sin() * away.cos()).max(0.0).powi(4) as f32; 3]
        }
    };
    write_exr(&baked().join("at-z.exr"), (128, 64), spot(0.75));
    write_exr(&baked().join("at-x.exr"), (128, 64), spot(0.5));
    relume_in(baked(), &["relight", "a.field", "--sky", "at-z.exr", "--env-rot", "90", "-o", "turned.exr"]).well();
    relume_in(baked(), &["relight", "a.field", "--sky", "at-x.exr", "-o", "moved.exr"]).well();
    relume_in(baked(), &["relight", "a.field", "--sky", "at-z.exr", "-o", "unturned.exr"]).well();
    let [turned, moved, unturned] =
        ["turned.exr", "moved.exr", "unturned.exr"].map(|name| read_exr(&baked().join(name)));
    let error = relative_rmse(&turned.rgb, &moved.rgb, &moved.alpha);
    assert!(error < 1e-3, "turned and moved differ by {error}");
    assert!(relative_rmse(&unturned.rgb, &moved.rgb, &moved.alpha) > 0.05, "the map's orientation does not matter");
}

#[test]
fn a_light_of_ones_own_is_the_stacks_sun() {
    let stack = baked().join("stack");
    let [x, y, z] = patches(&stack).1.unwrap().dir_world;
    relume_in(baked(), &["relight", "a.field", "--light", &format!("{x},{y},{z}"), "-o", "light.exr"]).well();
    let shown = read_exr(&baked().join("light.exr"));
    let (exact, covered) = (read_exr(&stack.join("sun.exr")), read_grey(&stack.join("coverage.exr")));
    let mean = exact.rgb.iter().flatten().sum::<f64>() / (3.0 * covered.iter().filter(|a| **a > 0.0).count() as f64);
    let mut errors: Vec<f64> = (0..covered.len())
        .filter(|&at| covered[at] > 0.0)
        .map(|at| (0..3).map(|c| (shown.rgb[at][c] - exact.rgb[at][c]).abs()).fold(0.0, f64::max) / mean)
        .collect();
    errors.sort_by(f64::total_cmp);
    // Pixels are large here: the sun's disc, 256 samples against the field's 16, shows at shadows' edges only.
    let share = |q: f64| errors[(q * errors.len() as f64) as usize];
    assert!(
        share(0.5) < 0.015 && share(0.95) < 0.07 && share(0.99) < 0.15,
        "{} {} {}",
        share(0.5),
        share(0.95),
        share(0.99)
    );
}

#[test]
fn a_png_shows_the_picture_over_the_view() {
    let view = image::RgbImage::from_pixel(64, 48, image::Rgb([10, 60, 200]));
    view.save(baked().join("view.png")).unwrap();
    put(&baked().join("day.csv"), lights()[0].1.csv(&baked().join("stack")));
    let args =
        ["relight", "a.field", "--weights", "day.csv", "--view", "view.png", "--exposure", "-0.5", "-o", "day.png"];
    relume_in(baked(), &args).well();
    let shown = image::open(baked().join("day.png")).unwrap().into_rgb8();
    let exact = lights()[0].1.sum(&baked().join("stack"));
    let curve = |v: f64| if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    let linear = |code: f64| if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) };
    let mut off = 0;
    for (at, pixel) in shown.pixels().enumerate() {
        for (c, behind) in [10.0, 60.0, 200.0].into_iter().enumerate() {
            let through = (1.0 - exact.alpha[at]) * linear(behind / 255.0);
            let code = 255.0 * curve((exact.rgb[at][c] * 2f64.powf(-0.5) + through).clamp(0.0, 1.0));
            off += usize::from((f64::from(pixel[c]) - code).abs() > 1.5);
        }
    }
    assert!(off <= 64 * 48 * 3 / 100, "{off} values off by more than one code");
}

#[test]
fn nothing_but_the_asked_for_files_appears() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "tidy");
    write_courtyard(&folder);
    let args =
        ["scene", "scene.glb", "--camera", "camera.json", "--size", "20x12", "--directions", "16", "-o", "f.field"];
    bake_in(&folder, &args).well();
    relume_in(&folder, &["relight", "f.field", "--light", "0,1,0", "-o", "a.exr"]).well();
    relume_in(&folder, &["relight", "f.field", "--light", "0,1,0", "-o", "a.png"]).well();
    assert_eq!(names(&folder), ["a.exr", "a.png", "camera.json", "f.field", "scene.glb"]);
}

/// Exposure as the design defines it: 0.8 / the 99th percentile of the covered channel values.
fn exposure_of(exact: &Linear) -> f64 {
    let covered = exact.rgb.iter().zip(&exact.alpha).filter(|(_, share)| **share > 0.0);
    let mut values: Vec<f64> = covered.flat_map(|(rgb, _)| *rgb).collect();
    values.sort_by(f64::total_cmp);
    let place = 0.99 * (values.len() - 1) as f64;
    let (low, high) = (values[place as usize], values[place.ceil() as usize]);
    0.8 / (low + (high - low) * place.fract())
}

/// `name.png` of a light by `relight` with these options.
fn codes(name: &str, weights: &str, exposure: f64, more: &[&str]) -> Vec<u8> {
    let (out, ev) = (format!("{name}.png"), format!("{}", exposure.log2()));
    let mut args = vec!["relight", "a.field", "--weights", weights, "--exposure", &ev, "-o", &out];
    args.extend(more);
    relume_in(baked(), &args).well();
    image::open(baked().join(&out)).unwrap().into_rgb8().into_raw()
}

#[test]
fn info_tells_the_errors_under_held_out_skies() {
    let told = bake_in(baked(), &["info", "a.field", "--json"]).well().stdout;
    let info: serde_json::Value = serde_json::from_str(&told).unwrap();
    let set = relume_firmware::patches::PatchSet::new(64).unwrap();
    let skies = relume_bake::heldout::test_skies(&set);
    let errors = info["bake"]["held_out"].as_array().unwrap();
    assert_eq!(errors.len(), skies.len() + 1);
    for (index, (sky, error)) in skies.iter().zip(errors).enumerate() {
        assert_eq!(error["sky"], sky.name.as_str());
        let light = Light { radiance: sky.radiance.iter().map(|rgb| rgb.map(f64::from)).collect(), sun: None };
        let (name, weights) = (format!("held{index}"), format!("held{index}.csv"));
        let (shown, exact) = (relit(&light, &name, &[]), relit(&light, &name, &["--exact", "stack"]));
        let rmse = relative_rmse(&shown.rgb, &exact.rgb, &exact.alpha);
        let value = |key: &str| error[key].as_f64().unwrap();
        assert!((value("rmse") / rmse - 1.0).abs() < 0.02, "{}: {} but {rmse}", sky.name, value("rmse"));
        let exposure = exposure_of(&exact);
        let (shown, truth) =
            (codes(&name, &weights, exposure, &[]), codes(&name, &weights, exposure, &["--exact", "stack"]));
        let covered = exact.alpha.iter().flat_map(|share| [*share > 0.0; 3]);
        let off: Vec<u8> =
            shown.iter().zip(&truth).zip(covered).filter(|(_, lit)| *lit).map(|((a, b), _)| a.abs_diff(*b)).collect();
        let worst = f64::from(*off.iter().max().unwrap());
        assert!((value("worst_code") - worst).abs() <= 1.0, "{}: {} but {worst}", sky.name, value("worst_code"));
        let share = off.iter().filter(|&&off| off > 1).count() as f64 / off.len() as f64;
        let told = value("share_off_by_more_than_one");
        assert!((told - share).abs() < 2e-4 + 0.05 * share, "{}: {told} but {share}", sky.name);
    }
    // A captured map is one sky more.
    let captured = |name: &str, more: &[&str]| {
        let mut args = vec!["relight", "a.field", "--sky", "captured.exr", "-o", name];
        args.extend(more);
        relume_in(baked(), &args).well();
        read_exr(&baked().join(name))
    };
    let (shown, exact) = (captured("map.exr", &[]), captured("map-exact.exr", &["--exact", "stack"]));
    let rmse = relative_rmse(&shown.rgb, &exact.rgb, &exact.alpha);
    let (told, name) = (errors[skies.len()]["rmse"].as_f64().unwrap(), &errors[skies.len()]["sky"]);
    assert!(name == "captured" && (told / rmse - 1.0).abs() < 0.02, "{name}: {told} but {rmse}");
    // What people read has a line for each, and the target.
    let text = bake_in(baked(), &["info", "a.field"]).well().stdout;
    assert_eq!(text.lines().filter(|line| line.starts_with("error ")).count(), errors.len(), "{text}");
    assert!(text.contains("target    0.800 %"), "{text}");
}
