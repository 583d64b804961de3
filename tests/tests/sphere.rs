//! A thing on a table: light from all around, through both programs, against closed forms.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, put};
use relume_tests::light::{Light, patches};
use relume_tests::picture::{Linear, read_exr, relative_rmse, write_exr};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::{cuboid, glb, sphere};
use std::f64::consts::{PI, TAU};
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

/// Width and height of the room's map.
const MAP: (usize, usize) = (128, 64);
/// Radiance of walls and floor, grey.
const WALLS: f64 = 0.2;

/// What shines in the room: columns and rows of its map, and the radiance there beside the walls'.
const LAMPS: [([usize; 2], [usize; 2], [f64; 3]); 4] = [
    // A lamp over the table, a window before it, another behind its left, and a lamp that stands on the floor.
    ([66, 82], [4, 10], [30.0, 22.0, 12.0]),
    ([84, 108], [20, 32], [4.0, 5.0, 6.5]),
    ([2, 12], [18, 30], [6.0, 7.0, 8.0]),
    ([88, 98], [42, 50], [9.0, 6.0, 3.0]),
];

/// The room's radiance at a place of its map.
fn room(column: usize, row: usize) -> [f64; 3] {
    let here = |(columns, rows, _): &&([usize; 2], [usize; 2], [f64; 3])| {
        (columns[0]..columns[1]).contains(&column) && (rows[0]..rows[1]).contains(&row)
    };
    let lamp = LAMPS.iter().find(here).map_or([0.0; 3], |lamp| lamp.2);
    lamp.map(|light| WALLS + light)
}

/// Irradiance on a face that looks up, or along +Z, and sees all of the room before it: integrals of the cosine over a lamp's
/// rectangle of latitudes and azimuths.
fn irradiance(faces_up: bool) -> [f64; 3] {
    let mut sum = [PI * WALLS; 3];
    for (columns, rows, radiance) in LAMPS {
        let [low, high] = [rows[1], rows[0]].map(|row| PI * (0.5 - row as f64 / MAP.1 as f64));
        let azimuths = columns.map(|column| TAU * (column as f64 / MAP.0 as f64 - 0.5));
        let seen = if faces_up {
            0.5 * (high.max(0.0).sin().powi(2) - low.max(0.0).sin().powi(2)) * (azimuths[1] - azimuths[0])
        } else {
            let along = |latitude: f64| 0.5 * latitude + 0.25 * (2.0 * latitude).sin();
            (along(high) - along(low)) * (azimuths[0].cos() - azimuths[1].cos()).max(0.0)
        };
        (0..3).for_each(|c| sum[c] += radiance[c] * seen);
    }
    sum
}

const TABLE: [f32; 3] = [0.5, 0.35, 0.2];
const BLOCK: [f32; 3] = [0.7, 0.7, 0.6];
const EYE: [f64; 3] = [0.4, 1.6, 2.0];
const AIM: [f64; 3] = [0.05, 0.1, 0.1];
const ROOM_SIZE: (usize, usize) = (60, 45);

/// A block and a ball on a table, whose front edge is as thick as the block is high.
fn table() -> PathBuf {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "table");
    let table = cuboid([-0.9, -0.4, -0.6], [0.9, 0.0, 0.6], TABLE);
    let block = cuboid([-0.5, 0.0, -0.3], [0.0, 0.4, 0.2], BLOCK);
    put(&folder.join("scene.glb"), glb(&[table, block, sphere([0.4, 0.2, 0.0], 0.2, 24, [0.8, 0.2, 0.2])], None));
    let camera = format!(r#"{{"position":{EYE:?},"target":{AIM:?},"up":[0,1,0],"fov_y_deg":42}}"#);
    put(&folder.join("camera.json"), camera);
    let size = format!("{}x{}", ROOM_SIZE.0, ROOM_SIZE.1);
    let bake = ["scene", "scene.glb", "--camera", "camera.json", "--size", &size, "--materials", "lambert"];
    let more = ["--sphere", "--directions", "256", "--stack", "stack", "-o", "a.field"];
    bake_in(&folder, &[&bake[..], &more].concat()).well();
    folder
}

/// The mean of the pixel in which `point` is seen and its neighbours at the sides.
fn at(picture: &Linear, point: [f64; 3]) -> [f64; 3] {
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let unit = |v: [f64; 3]| v.map(|c| c / dot(v, v).sqrt());
    let forward = unit(sub(AIM, EYE));
    let right = unit([-forward[2], 0.0, forward[0]]);
    let up = sub([0.0, 1.0, 0.0], forward.map(|c| c * forward[1]));
    let from_eye = sub(point, EYE);
    let scale = 0.5 * ROOM_SIZE.1 as f64 / 21f64.to_radians().tan() / dot(from_eye, forward);
    let column = 0.5 * ROOM_SIZE.0 as f64 + scale * dot(from_eye, right);
    let row = 0.5 * ROOM_SIZE.1 as f64 - scale * dot(from_eye, unit(up));
    let mut sum = [0.0; 3];
    for x in column as usize - 1..column as usize + 2 {
        (0..3).for_each(|c| sum[c] += picture.rgb[row as usize * ROOM_SIZE.0 + x][c] / 3.0);
    }
    sum
}

/// The middle of the block's upper side, and a place on the table's front: both see the room alone.
const TOP: [f64; 3] = [-0.25, 0.4, -0.05];
const FRONT: [f64; 3] = [0.1, -0.2, 0.6];

#[test]
fn small_things_on_a_table_are_lit_by_the_room() {
    let folder = table();
    let shown = |light: &[&str]| {
        relume_in(&folder, &[&["relight", "a.field"], light, &["-o", "out.exr"]].concat()).well();
        read_exr(&folder.join("out.exr"))
    };
    let is_near = |found: [f64; 3], wanted: [f64; 3], within: f64, what: &str| {
        let off = (0..3).map(|c| (found[c] - wanted[c]).abs() / wanted[c].max(1e-3)).fold(0.0, f64::max);
        eprintln!("{what}: off by {:.2} %", 100.0 * off);
        assert!(off <= within, "{what}: {found:?} instead of {wanted:?}, off by {off:.4}");
    };
    let paint = |albedo: [f32; 3], light: [f64; 3]| [0, 1, 2].map(|c| f64::from(albedo[c]) / PI * light[c]);
    write_exr(&folder.join("room.exr"), MAP, |x, y| room(x, y).map(|v| v as f32));
    let lit = shown(&["--sky", "room.exr"]);
    is_near(at(&lit, TOP), paint(BLOCK, irradiance(true)), 0.03, "top");
    is_near(at(&lit, FRONT), paint(TABLE, irradiance(false)), 0.03, "front");
    // From below the table's front alone is lit, of these two.
    let lit = shown(&["--light=0,-0.6,0.8"]);
    is_near(at(&lit, FRONT), paint(TABLE, [0.8; 3]), 0.01, "front from below");
    is_near(at(&lit, TOP), [0.0; 3], 0.01, "top from below");
    // All pixels against the sum of the stack's pictures, each patch with the room's light in its middle.
    let (patches, _) = patches(&folder.join("stack"));
    assert_eq!(patches.len(), 256);
    let in_its_middle = patches.iter().map(|patch| {
        let [x, y, z] = patch.dir_world;
        let column = ((0.5 + z.atan2(x) / TAU) * MAP.0 as f64) as usize % MAP.0;
        room(column, ((y.clamp(-1.0, 1.0).acos() / PI) * MAP.1 as f64) as usize)
    });
    let light = Light { radiance: in_its_middle.collect(), sun: None };
    put(&folder.join("w.csv"), light.csv(&folder.join("stack")));
    let exact = light.sum(&folder.join("stack"));
    let off = relative_rmse(&shown(&["--weights", "w.csv"]).rgb, &exact.rgb, &exact.alpha);
    eprintln!("field and stack differ by {:.2} %", 100.0 * off);
    assert!(off < 0.01, "{off}");
}
