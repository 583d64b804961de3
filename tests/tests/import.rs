//! Pictures that others made become a field: through the programs, against sums of the pictures that are made here.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::light::{Light, patches};
use relume_tests::picture::{Linear, read_exr, relative_rmse};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use std::path::{Path, PathBuf};

/// The courtyard's stack, imported: under light that no prior knows of its directions alone, the picture is the sum of the
/// stack's pictures, as that of the field which was baked is.
#[test]
fn a_stack_becomes_a_field_again() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "import-stack");
    write_courtyard(&folder);
    let bake = ["scene", "scene.glb", "--camera", "camera.json", "--size", "48x32", "--directions", "32", "--stack"];
    bake_in(&folder, &[&bake[..], &["stack", "-o", "baked.field"]].concat()).well();
    bake_in(&folder, &["import", "stack", "-o", "imported.field", "--error", "0.4%"]).well();
    let (patches, _) = patches(&folder.join("stack"));
    let radiance = patches.iter().map(|patch| {
        let [x, y, _] = patch.dir_world;
        if y > 0.0 { [1.0 + 0.5 * x, 0.8, 0.6 + 0.4 * y] } else { [0.2; 3] }
    });
    let light = Light { radiance: radiance.collect(), sun: None };
    put(&folder.join("w.csv"), light.csv(&folder.join("stack")));
    let relit = |field: &str, more: &[&str], out: &str| -> Linear {
        relume_in(&folder, &[&["relight", field, "--weights", "w.csv", "-o", out], more].concat()).well();
        read_exr(&folder.join(out))
    };
    let exact = relit("baked.field", &["--exact", "stack"], "exact.exr");
    let imported = relit("imported.field", &[], "imported.exr");
    let rmse = relative_rmse(&imported.rgb, &exact.rgb, &exact.alpha);
    assert!(rmse < 0.006, "{rmse}");
    // Its own exact sum reads the very same pictures.
    let own = relative_rmse(&relit("imported.field", &["--exact", "stack"], "own.exr").rgb, &exact.rgb, &exact.alpha);
    assert!(own < 1e-5, "{own}");
}

const EDGE: u32 = 24;

/// A dome of five lights over a matt relief whose pictures are albedo times cosine, as 16-bit linear PNGs.
fn dome(name: &str) -> (PathBuf, Vec<[f64; 3]>) {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), name);
    let dirs: Vec<[f64; 3]> =
        [[0.0, 0.0, 1.0], [0.8, 0.0, 0.6], [-0.8, 0.0, 0.6], [0.0, 0.8, 0.6], [0.0, -0.8, 0.6]].to_vec();
    let mut list = String::from("5\r\n");
    for (number, dir) in dirs.iter().enumerate() {
        let picture = image::ImageBuffer::<image::Rgb<u16>, _>::from_fn(EDGE, EDGE, |x, y| {
            image::Rgb([0, 1, 2].map(|c| (65535.0 * response(x, y, c, *dir)).round() as u16))
        });
        picture.save(folder.join(format!("light {number}.png"))).unwrap();
        let [x, y, z] = dir;
        list += &format!("light {number}.png {x} {y} {z}\r\n");
    }
    put(&folder.join("set.lp"), list);
    (folder, dirs)
}

/// Albedo / pi times cosine, brightened so that 16 bits tell it well.
fn response(x: u32, y: u32, c: usize, dir: [f64; 3]) -> f64 {
    let (u, v) = (f64::from(x) / f64::from(EDGE), f64::from(y) / f64::from(EDGE));
    let slope = [0.3 * (6.0 * u).sin(), 0.3 * (5.0 * v).cos()];
    let length = (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
    let cosine = (dir[2] - slope[0] * dir[0] - slope[1] * dir[1]) / length;
    (0.3 + 0.1 * c as f64 + 0.2 * u * v) * cosine.max(0.0)
}

fn shown(folder: &Path, light: &str) -> Linear {
    relume_in(folder, &["relight", "dome.field", "--light", light, "-o", "out.exr"]).well();
    read_exr(&folder.join("out.exr"))
}

/// Where a dome has a light, its picture comes back; between lights of a matt surface that none of them leaves in shadow,
/// what the cosine says.
#[test]
fn a_light_dome_is_lit_from_its_lights_and_from_between_them() {
    let (folder, dirs) = dome("import-dome");
    bake_in(&folder, &["import", "set.lp", "-o", "dome.field", "--error", "0.2%"]).well();
    let between = [0.36, 0.2, (1.0f64 - 0.36 * 0.36 - 0.04).sqrt()];
    for dir in dirs.iter().copied().chain([between]) {
        let picture = shown(&folder, &dir.map(|v| v.to_string()).join(","));
        let (mut squares, mut sum) = (0.0f64, 0.0f64);
        for y in 0..EDGE {
            for x in 0..EDGE {
                for c in 0..3 {
                    let (truth, found) = (response(x, y, c, dir), picture.rgb[(y * EDGE + x) as usize][c]);
                    squares += (found - truth).powi(2);
                    sum += truth;
                }
            }
        }
        let count = f64::from(3 * EDGE * EDGE);
        let rmse = (squares / count).sqrt() / (sum / count);
        assert!(rmse < 0.01, "{dir:?}: {rmse}");
    }
    relume_in(&folder, &["relight", "dome.field", "--light", "0,0,-1", "-o", "out.exr"])
        .refused(2, &["behind all lights"]);
}

#[test]
fn sets_that_are_wrong_are_refused_and_leave_nothing() {
    let (folder, _) = dome("import-bad");
    let before = names(&folder);
    let list = std::fs::read_to_string(folder.join("set.lp")).unwrap();
    let refused = |text: &str, parts: &[&str]| {
        put(&folder.join("set.lp"), text);
        bake_in(&folder, &["import", "set.lp", "-o", "dome.field"]).refused(2, parts);
        assert_eq!(names(&folder), before, "{parts:?}");
    };
    refused(&list.replace("5\r\n", "6\r\n"), &["set.lp", "6 pictures", "5 follow"]);
    refused(&list.replace("light 3.png", "light 9.png"), &["light 9.png"]);
    refused(&list.replace("light 3.png", "light 2.png"), &["light 2.png", "second time"]);
    refused(&list.replace("0.8 0 0.6", "0.8 0"), &["set.lp"]);
    refused(&list.replace("0.8 0 0.6", "0 0 0"), &["set.lp"]);
    refused("", &["set.lp", "empty"]);
    put(&folder.join("set.lp"), &list);
    put(&folder.join("light 1.png"), "no picture");
    bake_in(&folder, &["import", "set.lp", "-o", "dome.field"]).refused(2, &["light 1.png"]);
    assert_eq!(names(&folder), before);
}
