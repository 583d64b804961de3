//! Simulated exposure series as files, with their truth: `cargo run --release -p relume-tests --example sky_frames -- DIR SEED`.
//!
//! Per sensor and series a folder with `frames.json`, PNGs, `truth.exr` (radiance on the sensor, full-well fractions per second),
//! `curve_truth.csv` and `mask.png` (white where birds and clouds passed). `tests/opencv_sky.py` reads them.

use relume::map::RadianceMap;
use relume_tests::skycamera::{SENSORS, Series, exposures, ghosts, settings, take};
use std::error::Error;
use std::path::Path;

fn write(folder: &Path, series: &Series) -> Result<(), Box<dyn Error>> {
    series.save(folder)?;
    let (width, height) = (series.frames[0].width, series.frames[0].height);
    let pixels = series.truth[series.truth.len() / 2].clone();
    RadianceMap { width, height, pixels }.save(&folder.join("truth.exr"))?;
    let mask: Vec<u8> = series.ghost_mask.iter().map(|&touched| 255 * u8::from(touched)).collect();
    image::save_buffer(folder.join("mask.png"), &mask, width as u32, height as u32, image::ColorType::L8)?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(folder), Some(Ok(seed))) = (args.next(), args.next().map(|seed| seed.parse::<u64>())) else {
        return Err("give DIR and SEED".into());
    };
    std::fs::create_dir_all(&folder)?;
    for sensor in SENSORS {
        let fourteen = exposures(6.25e-5, 2.0, 14);
        let four = exposures(1.25e-4, 8.0, 4);
        let place = |name: &str| Path::new(&folder).join(format!("{}_{name}", sensor.name()));
        write(&place("14"), &take(settings(sensor, seed), &fourteen))?;
        write(&place("4"), &take(settings(sensor, seed + 1000), &four))?;
        let mut passed = settings(sensor, seed + 2000);
        passed.ghosts = ghosts(seed);
        write(&place("ghosts"), &take(passed, &fourteen))?;
    }
    Ok(())
}
