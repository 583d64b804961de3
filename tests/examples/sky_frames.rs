//! Simulated exposure series as files, with their truth: `cargo run --release -p relume-tests --example sky_frames -- DIR SEED`.
//!
//! Per sensor and series a folder with `frames.json`, PNGs, `truth.exr` (radiance on the sensor, full-well fractions per second),
//! `curve_truth.csv` and `mask.png` (white where birds and clouds passed). `tests/opencv_sky.py` reads them.

use relume::camera::Codes;
use relume::map::RadianceMap;
use relume::response::Response;
use relume_tests::skycamera::{SENSORS, Series, exposures, ghosts, settings, take};
use std::error::Error;
use std::path::Path;

fn write(folder: &Path, series: &Series) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    let mut list = Vec::new();
    for (number, frame) in series.frames.iter().enumerate() {
        let (name, width, height) = (format!("{number:02}.png"), frame.width as u32, frame.height as u32);
        let path = folder.join(&name);
        match &frame.codes {
            Codes::U8(codes) => image::save_buffer(path, codes, width, height, image::ColorType::Rgb8)?,
            Codes::U16(codes) => {
                let picture = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(width, height, codes.clone());
                picture.ok_or("a frame's codes do not fill it")?.save(path)?;
            }
        }
        list.push(serde_json::json!({"file": name, "time_s": frame.exposure.exposure_s, "gain": frame.exposure.gain}));
    }
    std::fs::write(folder.join("frames.json"), serde_json::to_string_pretty(&list)?)?;
    let (width, height) = (series.frames[0].width, series.frames[0].height);
    let pixels = series.truth[series.truth.len() / 2].clone();
    RadianceMap { width, height, pixels }.save(&folder.join("truth.exr"))?;
    Response::from_rows(series.camera.response_rows(), "truth")?.save(&folder.join("curve_truth.csv"))?;
    let mask: Vec<u8> = series.ghost_mask.iter().map(|&touched| 255 * u8::from(touched)).collect();
    image::save_buffer(folder.join("mask.png"), &mask, width as u32, height as u32, image::ColorType::L8)?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(folder), Some(Ok(seed))) = (args.next(), args.next().map(|seed| seed.parse::<u64>())) else {
        return Err("give DIR and SEED".into());
    };
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
