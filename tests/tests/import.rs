//! Pictures that others made become a field: through the programs, against sums of the pictures that are made here.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::light::{Light, patches};
use relume_tests::picture::{Linear, read_exr, relative_rmse, write_exr};
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

fn shown(folder: &Path, field: &str, light: &[&str]) -> Linear {
    relume_in(folder, &[&["relight", field], light, &["-o", "out.exr"]].concat()).well();
    read_exr(&folder.join("out.exr"))
}

/// Relative rms difference to what `truth` says of column, row and channel.
fn off(picture: &Linear, truth: impl Fn(u32, u32, usize) -> f64) -> f64 {
    assert_eq!((picture.width, picture.height), (EDGE as usize, EDGE as usize));
    let (mut squares, mut sum) = (0.0f64, 0.0f64);
    for (at, pixel) in (0..).zip(&picture.rgb) {
        for (c, found) in pixel.iter().enumerate() {
            let truth = truth(at % EDGE, at / EDGE, c);
            squares += (found - truth).powi(2);
            sum += truth;
        }
    }
    let count = f64::from(3 * EDGE * EDGE);
    (squares / count).sqrt() / (sum / count)
}

/// `--light` with this direction.
fn lamp(dir: [f64; 3]) -> String {
    format!("--light={}", dir.map(|v| v.to_string()).join(","))
}

/// Rows of `W.csv`: direction, solid angle, radiance.
fn csv(lights: &[([f64; 3], f64, [f64; 3])]) -> String {
    let row = |([x, y, z], omega, [r, g, b]): &([f64; 3], f64, [f64; 3])| format!("{x},{y},{z},{omega},{r},{g},{b}\n");
    lights.iter().map(row).fold(String::from("x,y,z,solid_angle_sr,r,g,b\n"), |text, row| text + &row)
}

/// Radiances that differ from light to light and channel to channel.
fn radiance(light: usize) -> [f64; 3] {
    [0, 1, 2].map(|c| 0.3 + f64::from((7 * light + 3 * c) as u32 % 11) / 5.0)
}

/// Where a dome has a light, its picture comes back; between lights of a matt surface that none of them leaves in shadow,
/// what the cosine says.
#[test]
fn a_light_dome_is_lit_from_its_lights_and_from_between_them() {
    let (folder, dirs) = dome("import-dome");
    bake_in(&folder, &["import", "set.lp", "-o", "dome.field", "--error", "0.2%"]).well();
    let between = [0.36, 0.2, (1.0f64 - 0.36 * 0.36 - 0.04).sqrt()];
    for dir in dirs.iter().copied().chain([between]) {
        let rmse = off(&shown(&folder, "dome.field", &[&lamp(dir)]), |x, y, c| response(x, y, c, dir));
        assert!(rmse < 0.01, "{dir:?}: {rmse}");
    }
    relume_in(&folder, &["relight", "dome.field", "--light", "0,0,-1", "-o", "out.exr"])
        .refused(2, &["behind all lights"]);
}

/// Six lights around +Z, none so low that it leaves any of the relief in shadow.
fn ring() -> Vec<[f64; 3]> {
    let around = (0..5).map(|k| {
        let (sin, cos) = (std::f64::consts::TAU / 5.0 * f64::from(k)).sin_cos();
        [0.6 * cos, 0.6 * sin, 0.8]
    });
    std::iter::once([0.0, 0.0, 1.0]).chain(around).collect()
}

/// Pictures of a renderer or a light stage in different formats, by lights of different strength and colour: the manifest
/// tells them, and the relief comes out as if all had been one.
#[test]
fn a_folder_of_pictures_by_unequal_lights_becomes_a_field() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "import-folder");
    let mut manifest = String::from("horizon = [0.0, 0.0, 1.0]\n");
    let mut lights = Vec::new();
    for (number, dir) in ring().into_iter().enumerate() {
        // What 16 bits hold ends at 1.
        let (name, intensity) = match number % 3 {
            0 => (format!("stage {number}.exr"), [3.0 * (number + 1) as f64; 3]),
            1 => (format!("stage {number}.hdr"), [40.0, 25.0, 16.0 + number as f64]),
            _ => (format!("stage {number}.png"), [0.5, 0.9, 1.0]),
        };
        let value = |x: u32, y: u32| [0, 1, 2].map(|c| (intensity[c] * response(x, y, c, dir)) as f32);
        write_as(&folder.join(&name), value);
        let omega = 0.2 + 0.05 * number as f64;
        manifest += &format!("[[patch]]\nfile = {name:?}\ndirection = {dir:?}\nsolid_angle_sr = {omega}\n");
        let [r, g, b] = intensity;
        manifest += &if r == g { format!("intensity = {r}\n") } else { format!("intensity = [{r}, {g}, {b}]\n") };
        lights.push((dir, omega, radiance(number)));
    }
    put(&folder.join("manifest.toml"), manifest);
    bake_in(&folder, &["import", ".", "-o", "stage.field", "--error", "0.2%"]).well();
    for dir in ring().into_iter().chain([[0.28, 0.0, 0.96]]) {
        let rmse = off(&shown(&folder, "stage.field", &[&lamp(dir)]), |x, y, c| response(x, y, c, dir));
        assert!(rmse < 0.008, "{dir:?}: {rmse}");
    }
    put(&folder.join("w.csv"), csv(&lights));
    let sum = |x: u32, y: u32, c: usize| -> f64 {
        lights.iter().map(|(dir, omega, rgb)| omega * rgb[c] * response(x, y, c, *dir)).sum()
    };
    let rmse = off(&shown(&folder, "stage.field", &["--weights", "w.csv"]), sum);
    assert!(rmse < 0.005, "{rmse}");
}

/// Writes a picture of `EDGE` x `EDGE` in the format that its name asks for; PNGs have 16 bits.
fn write_as(path: &Path, value: impl Fn(u32, u32) -> [f32; 3] + Sync) {
    let all = || (0..EDGE * EDGE).map(|at| image::Rgb(value(at % EDGE, at / EDGE)));
    match path.extension().and_then(|ext| ext.to_str()) {
        Some("exr") => write_exr(path, (EDGE as usize, EDGE as usize), |x, y| value(x as u32, y as u32)),
        Some("hdr") => {
            let file = std::fs::File::create(path).unwrap();
            let pixels: Vec<_> = all().collect();
            image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, EDGE as usize, EDGE as usize).unwrap();
        }
        _ => {
            let code = |x, y| image::Rgb(value(x, y).map(|v| (65535.0 * v).round() as u16));
            image::ImageBuffer::<image::Rgb<u16>, _>::from_fn(EDGE, EDGE, code).save(path).unwrap();
        }
    }
}

/// A museum's dome: JPEGs, which are sRGB, with spaces in their names and the path of another machine before one of them.
#[test]
fn a_dome_of_jpegs_is_read_by_their_curve() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "import-jpeg");
    let mut list = format!("{}\n", ring().len());
    for (number, [x, y, z]) in ring().into_iter().enumerate() {
        let name = format!("coin  no {number} (obverse).jpg");
        let curve = |v: f64| if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        let code = |column, row| {
            let of = |c| (255.0 * curve(response(column, row, c, [x, y, z]))).round() as u8;
            image::Rgb([0, 1, 2].map(of))
        };
        let picture = image::ImageBuffer::from_fn(EDGE, EDGE, code);
        let file = std::fs::File::create(folder.join(&name)).unwrap();
        image::codecs::jpeg::JpegEncoder::new_with_quality(file, 100).encode_image(&picture).unwrap();
        let path = if number == 3 { "C:\\Users\\museum\\coin set\\" } else { "" };
        list += &format!("{path}{name} {x} {y} {z}\n");
    }
    put(&folder.join("set.lp"), list);
    // A folder with one such list is that list's set.
    bake_in(&folder, &["import", ".", "-o", "coin.field", "--error", "0.2%"]).well();
    for dir in ring().into_iter().chain([[0.28, 0.0, 0.96]]) {
        let rmse = off(&shown(&folder, "coin.field", &[&lamp(dir)]), |x, y, c| response(x, y, c, dir));
        assert!(rmse < 0.012, "{dir:?}: {rmse}");
    }
    // Bare rows are in the list's order; every light's cell of the half sphere is its own.
    bake_in(&folder, &["import", ".", "-o", "coin.field", "--error", "0.2%", "--stack", "stack"]).well();
    let (patches, _) = patches(&folder.join("stack"));
    let omegas: Vec<f64> = patches.iter().map(|patch| patch.solid_angle_sr).collect();
    assert!((omegas.iter().sum::<f64>() / std::f64::consts::TAU - 1.0).abs() < 1e-3, "{omegas:?}");
    let rows = (0..6).map(radiance).map(|[r, g, b]| format!("{r} {g} {b}\n"));
    put(&folder.join("w.txt"), rows.collect::<String>());
    let dirs = ring();
    let sum = |x: u32, y: u32, c: usize| -> f64 {
        (0..6).map(|k| omegas[k] * radiance(k)[c] * response(x, y, c, dirs[k])).sum()
    };
    let rmse = off(&shown(&folder, "coin.field", &["--weights", "w.txt"]), sum);
    assert!(rmse < 0.008, "{rmse}");
}

/// Tregenza's patches as Radiance numbers and turns them: 0 the ground, then rows from the horizon up, each clockwise from
/// north, the zenith last; in the world's axes, where Radiance's north (+Y) is -Z. Direction and solid angle.
fn tregenza() -> Vec<([f64; 3], f64)> {
    let mut all = vec![([0.0, -1.0, 0.0], std::f64::consts::TAU)];
    for (row, count) in [30, 30, 24, 24, 18, 12, 6].into_iter().enumerate() {
        let (low, high) = ((12.0 * row as f64).to_radians(), (12.0 * (row + 1) as f64).to_radians());
        for column in 0..count {
            let azimuth = (360.0 * f64::from(column) / f64::from(count)).to_radians();
            let (sin, cos) = (0.5 * (low + high)).sin_cos();
            let omega = (high.sin() - low.sin()) * std::f64::consts::TAU / f64::from(count);
            all.push(([cos * azimuth.sin(), sin, -cos * azimuth.cos()], omega));
        }
    }
    all.push(([0.0, 1.0, 0.0], std::f64::consts::TAU * (1.0 - 6f64.to_radians().cos())));
    all
}

/// The relief lies on the ground and is lit from `dir` of the world.
fn on_the_ground(x: u32, y: u32, c: usize, dir: [f64; 3]) -> f64 {
    response(x, y, c, [dir[0], -dir[2], dir[1]])
}

#[test]
fn patch_pictures_of_radiance_become_a_field() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "import-radiance");
    let patches = tregenza();
    assert_eq!(patches.len(), 146);
    let by_ground = |x: u32, y: u32, c: usize| 0.1 * response(x, y, c, [0.0, 0.0, 1.0]);
    let seen = |patch: usize, x: u32, y: u32, c: usize| match patches[patch] {
        _ if patch == 0 => by_ground(x, y, c),
        (dir, omega) => omega * on_the_ground(x, y, c, dir),
    };
    for patch in 0..patches.len() {
        let value = |x: u32, y: u32| [0, 1, 2].map(|c| seen(patch, x, y, c) as f32);
        write_as(&folder.join(format!("sky_{patch:04}.hdr")), value);
    }
    bake_in(&folder, &["import", ".", "-o", "patches.field", "--error", "0.2%"]).well();
    // By patch, in Radiance's order, the ground in the first row.
    let rows: Vec<_> = patches.iter().enumerate().map(|(k, &(dir, omega))| (dir, omega, radiance(k))).collect();
    put(&folder.join("w.csv"), csv(&rows));
    let sum = |x: u32, y: u32, c: usize| (0..patches.len()).map(|k| radiance(k)[c] * seen(k, x, y, c)).sum::<f64>();
    let rmse = off(&shown(&folder, "patches.field", &["--weights", "w.csv"]), sum);
    assert!(rmse < 0.004, "{rmse}");
    // Patch 70 is the tenth of the third row, 30 degrees up in the south-east; the others are the zenith and between patches.
    for dir in [patches[70].0, patches[145].0, [0.48, 0.8, 0.36]] {
        let rmse = off(&shown(&folder, "patches.field", &[&lamp(dir)]), |x, y, c| on_the_ground(x, y, c, dir));
        assert!(rmse < 0.012, "{dir:?}: {rmse}");
    }
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
