//! Pose and lens of a still, through the program: the camera that a still was made with comes back, bakes, and shows the scene
//! where it was; bad input is one line.

#![allow(clippy::unwrap_used)]

use image::{Rgb, RgbImage};
use relume_bake::camera::Camera;
use relume_tests::files::{fresh_folder, put};
use relume_tests::program::bake_in;
use relume_tests::scene::write_courtyard;
use std::path::{Path, PathBuf};

const TRUTH: &str = r#"{"position":[2.5,2.6,6.5],"target":[-0.4,0.8,0],"up":[0.02,1,0],"size_px":[640,480],"focal_px":560,
    "principal_px":[324.5,236.25],"lens":{"model":"radial","k":[-0.16,0.04,0]}}"#;

/// Places all over the courtyard's picture, at different distances.
fn places() -> Vec<[f64; 3]> {
    let mut all = Vec::new();
    for x in [-2.4, -0.9, 0.6, 2.1] {
        for (y, z) in [(0.0, -1.5), (0.2, 2.0), (1.9, -0.4), (2.4, 1.2)] {
            all.push([x, y, z + 0.3 * x]);
        }
    }
    all
}

/// A still, and the points of it that a careful hand would click (half a pixel of noise), with the edits of `bend`.
fn folder(name: &str, bend: impl Fn(usize, &mut [f64; 5])) -> PathBuf {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), &format!("view_camera_{name}"));
    write_courtyard(&folder);
    RgbImage::from_pixel(640, 480, Rgb([90, 90, 90])).save(folder.join("still.png")).unwrap();
    let view = Camera::parse(TRUTH, Path::new("truth")).unwrap().view(640, 480);
    let mut csv = String::from("u,v,x,y,z\n");
    let mut noise = 1u32;
    for place in places() {
        let [u, v] = view.project(place.into()).unwrap();
        if !((5.0..635.0).contains(&u) && (5.0..475.0).contains(&v)) {
            continue;
        }
        let mut click = || {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            0.8 * (f64::from(noise >> 8) / f64::from(1 << 24) - 0.5)
        };
        let mut row = [u + click(), v + click(), place[0], place[1], place[2]];
        bend(csv.lines().count() + 1, &mut row);
        csv += &(row.map(|value| value.to_string()).join(",") + "\n");
    }
    put(&folder.join("points.csv"), csv);
    folder
}

const COMMAND: [&str; 6] = ["camera", "still.png", "--points", "points.csv", "-o", "cam.json"];

#[test]
fn a_still_gives_its_camera_which_bakes() {
    let folder = folder("whole", |line, row| row[0] += if line == 6 { 17.0 } else { 0.0 });
    let drawn = ["--scene", "scene.glb", "--overlay", "overlay.png", "--north", "12", "--json"];
    let outcome = bake_in(&folder, &[&COMMAND[..], &drawn].concat()).well();
    let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
    assert!(outcome.stderr.contains("points.csv: line 6: the point is 1"), "{}", outcome.stderr);
    assert!(report["residual_rms_px"].as_f64().unwrap() < 0.6, "{report}");
    let (found, truth) =
        (Camera::load(&folder.join("cam.json")).unwrap(), Camera::parse(TRUTH, Path::new("t")).unwrap());
    assert_eq!(found.north_deg, 12.0);
    let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt();
    let moved = apart(found.position, truth.position);
    let expected = report["standard_error"]["position_m"].as_f64().unwrap();
    assert!(moved < 4.0 * expected && moved < 0.1, "{moved} m off, {expected} expected");
    let overlay = image::open(folder.join("overlay.png")).unwrap().into_rgb8();
    // Thin lines hardly cover a pixel whole.
    let is_near =
        |pixel: &Rgb<u8>, ink: [u8; 3]| (0..3).map(|c| u32::from(pixel.0[c].abs_diff(ink[c]))).sum::<u32>() < 160;
    let count = |ink: [u8; 3]| overlay.pixels().filter(|pixel| is_near(pixel, ink)).count();
    let counts = [[0, 230, 255], [255, 225, 0], [255, 40, 40]].map(count);
    assert!(counts[0] > 500 && counts[1] > 100 && counts[2] > 10, "edges, points, strays: {counts:?} px");
    let bake = |size: &'static str| {
        ["scene", "scene.glb", "--camera", "cam.json", "--size", size, "--directions", "16", "-o", "a.field"]
    };
    bake_in(&folder, &bake("64x48")).well();
    let info = bake_in(&folder, &["info", "a.field", "--json"]).well().stdout;
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    let focal = info["camera"]["lens"]["focal_px"][0].as_f64().unwrap();
    assert!((focal - 0.1 * found.optics.unwrap().focal_px).abs() < 1e-9, "{info}");
    let square = bake_in(&folder, &bake("64x64"));
    assert_eq!((square.code, square.stderr.lines().count()), (Some(2), 1), "{}", square.stderr);
    assert!(square.stderr.contains("640x480"), "{}", square.stderr);
}

#[test]
fn bad_points_and_stills_are_one_line() {
    let folder = folder("bad", |_, _| ());
    let refused = |args: &[&str], parts: &[&str]| {
        let outcome = bake_in(&folder, args);
        assert_eq!((outcome.code, outcome.stderr.lines().count()), (Some(2), 1), "{args:?}: {}", outcome.stderr);
        assert!(parts.iter().all(|part| outcome.stderr.contains(part)), "{args:?}: {}", outcome.stderr);
        assert!(!folder.join("cam.json").exists(), "{args:?}");
    };
    let with = |points: &str, parts: &[&str]| {
        put(&folder.join("bad.csv"), points);
        refused(&["camera", "still.png", "--points", "bad.csv", "-o", "cam.json"], parts);
    };
    let good = std::fs::read_to_string(folder.join("points.csv")).unwrap();
    let few = good.lines().take(5).collect::<Vec<_>>().join("\n");
    with(&few, &["bad.csv", "4 points", "at least 6"]);
    with(&good.replacen(',', ",nan,", 5), &["bad.csv: line "]);
    with(&(good.clone() + "1,2,3\n"), &["bad.csv: line ", "\"1,2,3\""]);
    with(&(good.clone() + "700,2,3,4,5\n"), &["bad.csv: line ", "outside the still of 640x480"]);
    let line: String = (0..9).map(|k| format!("{},{},{k},{k},{k}\n", 10 + 60 * k, 20 + k * k)).collect();
    with(&line, &["bad.csv", "on a line"]);
    let noise: String = (1..13)
        .map(|k| format!("{},{},{},{},{}\n", k * 211 % 640, k * 97 % 480, k * 7 % 5, k * 5 % 7, k * k % 11))
        .collect();
    with(&noise, &["bad.csv", "points"]);
    refused(&["camera", "nowhere.png", "--points", "points.csv", "-o", "cam.json"], &["nowhere.png"]);
    refused(&["camera", "scene.glb", "--points", "points.csv", "-o", "cam.json"], &["scene.glb"]);
    refused(&["camera", "still.png", "--points", "nowhere.csv", "-o", "cam.json"], &["nowhere.csv"]);
    refused(&["camera", "still.png", "-o", "cam.json"], &["--points"]);
    refused(&[&COMMAND[..], &["--overlay", "o.png"]].concat(), &["--scene"]);
    refused(&[&COMMAND[..], &["--lens", "wobbly"]].concat(), &["wobbly"]);
    refused(&[&COMMAND[..], &["--noise", "0"]].concat(), &["--noise"]);
}
