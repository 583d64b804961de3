//! A thing on a table: light from all around, through both programs, against closed forms.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, put};
use relume_tests::picture::{read_exr, write_exr};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::{cuboid, glb};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

const ALBEDO: [f32; 3] = [0.6, 0.4, 0.2];

/// A slab in the air, seen from below so closely that its underside fills the picture.
fn slab() -> PathBuf {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "sphere");
    put(&folder.join("scene.glb"), glb(&[cuboid([-9.0, 1.0, -9.0], [9.0, 1.5, 9.0], ALBEDO)], None));
    put(&folder.join("camera.json"), r#"{"position":[0,0,0],"target":[0.1,1,0.2],"up":[0,0,1],"fov_y_deg":20}"#);
    let bake = [
        "scene",
        "scene.glb",
        "--camera",
        "camera.json",
        "--size",
        "24x16",
        "--max-hits",
        "1",
        "--materials",
        "lambert",
    ];
    bake_in(&folder, &[&bake[..], &["--sphere", "--directions", "96", "-o", "a.field"]].concat()).well();
    folder
}

/// The picture is this in every pixel, within `within` of it.
fn is_even(folder: &Path, shown: &str, wanted: [f64; 3], within: f64) {
    for pixel in read_exr(&folder.join(shown)).rgb {
        for (found, wanted) in pixel.iter().zip(wanted) {
            assert!((found - wanted).abs() <= within * wanted.max(1e-3), "{shown}: {pixel:?} for {wanted:?}");
        }
    }
}

#[test]
fn a_ceiling_is_lit_from_below() {
    let folder = slab();
    let info = bake_in(&folder, &["info", "a.field", "--json"]).well().stdout;
    assert!(info.contains("\"patches_upper\":48,\"patches_lower\":48"), "{info}");
    let light = |name: &str, below: f32, above: f32| {
        write_exr(&folder.join(name), (64, 32), |_, y| if y >= 16 { [below; 3] } else { [above; 3] });
    };
    light("below.exr", 2.0, 0.0);
    light("above.exr", 0.0, 2.0);
    let relight = |args: &[&str], out: &str| {
        relume_in(&folder, &[&["relight", "a.field"], args, &["-o", out]].concat()).well();
    };
    // A Lambert plane under an even hemisphere of radiance 2 shows twice its albedo, under the other one nothing.
    relight(&["--sky", "below.exr"], "lit.exr");
    is_even(&folder, "lit.exr", ALBEDO.map(|a| 2.0 * f64::from(a)), 0.03);
    relight(&["--sky", "above.exr"], "dark.exr");
    is_even(&folder, "dark.exr", [0.0; 3], 1.0);
    // A distant lamp of irradiance 1, 60 degrees off the plane's normal.
    relight(&["--light=0.8660254,-0.5,0"], "lamp.exr");
    is_even(&folder, "lamp.exr", ALBEDO.map(|a| 0.5 * f64::from(a) / PI), 0.01);
    relight(&["--light=0,1,0"], "behind.exr");
    is_even(&folder, "behind.exr", [0.0; 3], 1.0);
}
