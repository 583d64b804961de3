//! The error that patches cost over their number, equal ones and ones that fit the scene: `cargo run --release -p relume-tests
//! --example direction_figures -- OUT_DIR PATHS (demo | SCENE.glb CAMERA.json) MAP...`.
//!
//! 64 to 1024 directions; each map without its sun, which is a light of its own, turned to four sides. Truth is a path trace under
//! the map itself (`src/patcherror.rs`); the seed is 8191. Writes `directions.csv`, `directions.json` and `directions.png`.

use relume::map::RadianceMap;
use relume::plot::{Axis, Chart, Series};
use relume::split::split;
use relume_bake::bake::BakeOptions;
use relume_bake::camera::Camera;
use relume_bake::scene::{Scene, Shading, load};
use relume_bake::{demo_scene, directions};
use relume_firmware::patches::PatchSet;
use relume_tests::patcherror::{Cut, PatchError, patch_errors};
use std::fmt::Write;
use std::path::{Path, PathBuf};

const COUNTS: [usize; 5] = [64, 128, 256, 512, 1024];
const SEED: u64 = 8191;
/// Size of the picture that errors are measured in.
const SIZE: (u32, u32) = (48, 36);
/// Size that the patches are made for.
const BAKED: (u32, u32) = (512, 384);

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut args = std::env::args().skip(1);
    let mut next = |what: &str| args.next().ok_or_else(|| format!("{what} is missing"));
    let (out, paths) = (PathBuf::from(next("OUT_DIR")?), next("PATHS")?.parse()?);
    let (scene, camera) = match next("demo or SCENE.glb")?.as_str() {
        "demo" => demo_scene::temple(),
        file => (load(Path::new(file), Shading::Lambert)?.scene, Camera::load(Path::new(&next("CAMERA.json")?))?),
    };
    let scene = scene.shaded(Shading::Lambert);
    let maps: Vec<PathBuf> = args.map(PathBuf::from).collect();
    std::fs::create_dir_all(&out)?;
    let sets = sets(&scene, &camera)?;
    let found = errors((&scene, &camera), &maps, &sets, paths)?;
    write_all(&out, &sets, &found)
}

/// Equal ones, then those that fit, by count.
fn sets(scene: &Scene, camera: &Camera) -> Result<Vec<PatchSet>, Failure> {
    let mut sets = Vec::new();
    for directions in COUNTS {
        sets.push(PatchSet::new(directions)?);
    }
    for directions in COUNTS {
        let started = std::time::Instant::now();
        let options = BakeOptions { size: BAKED, directions, ..BakeOptions::default() };
        sets.push(PatchSet::of_subdivided(directions::fit(scene, camera, &options)?));
        eprintln!("{directions} directions: {:.1} s", started.elapsed().as_secs_f64());
    }
    Ok(sets)
}

/// Per sky its name and the error of every set.
type Found = Vec<(String, Vec<PatchError>)>;

fn errors(scene: (&Scene, &Camera), maps: &[PathBuf], sets: &[PatchSet], paths: u32) -> Result<Found, Failure> {
    let mut found = Vec::new();
    for file in maps {
        let sky = split(&RadianceMap::load(file)?).sky;
        for side in 0..4 {
            let name = format!("{} {}", file.file_stem().unwrap_or_default().to_string_lossy(), 90 * side);
            let map = turned(&sky, side);
            let errors = patch_errors((scene.0, scene.1, SIZE), &Cut::new(&map, sets), paths, SEED + side as u64);
            let told: Vec<String> = errors.iter().map(|e| format!("{:.2}", 100.0 * e.rmse)).collect();
            eprintln!("{name}: {}", told.join(" "));
            found.push((name, errors));
        }
    }
    Ok(found)
}

/// A map turned by quarters.
fn turned(map: &RadianceMap, quarters: usize) -> RadianceMap {
    let mut turned = map.clone();
    for row in turned.pixels.chunks_exact_mut(map.width) {
        row.rotate_left(quarters * map.width / 4);
    }
    turned
}

fn write_all(out: &Path, sets: &[PatchSet], found: &Found) -> Result<(), Failure> {
    let mut csv = String::from("sky,directions,patches,adaptive,rmse,standard_error\n");
    for (name, errors) in found {
        for (at, error) in errors.iter().enumerate() {
            let (directions, adaptive) = (COUNTS[at % COUNTS.len()], at >= COUNTS.len());
            let PatchError { rmse, doubt } = error;
            writeln!(csv, "{name},{directions},{},{adaptive},{rmse:.6},{doubt:.6}", sets[at].len())?;
        }
    }
    std::fs::write(out.join("directions.csv"), csv)?;
    let quantile = |at: usize, share: f64| {
        let mut errors: Vec<f64> = found.iter().map(|(_, errors)| errors[at].rmse).collect();
        errors.sort_by(f64::total_cmp);
        errors[(share * (errors.len() - 1) as f64).round() as usize]
    };
    let mut chart = Chart::new("Error that patches cost", Axis::log("patches"), Axis::log("relative RMSE"));
    let mut json = Vec::new();
    for (name, first) in [("equal", 0), ("adaptive", COUNTS.len())] {
        for (what, share) in [("median", 0.5), ("worst", 1.0)] {
            let points: Vec<(f64, f64)> =
                (0..COUNTS.len()).map(|k| (sets[first + k].len() as f64, quantile(first + k, share))).collect();
            let told: Vec<String> = points.iter().map(|point| format!("{:.2} %", 100.0 * point.1)).collect();
            println!("{name}, {what}: {}", told.join(", "));
            json.push(serde_json::json!({ "patches": name, "skies": what, "points": points }));
            chart = chart.with(Series::line(format!("{name}, {what} sky"), points).with_markers());
        }
    }
    std::fs::write(out.join("directions.json"), serde_json::to_string_pretty(&json)?)?;
    chart.draw(900, 560).save(&out.join("directions.png"))?;
    Ok(())
}
