//! Figures of the sun in the sky camera's map, on simulated series with known truth: `cargo run --release -p relume-tests
//! --example sun_figures -- [FIRST_SEED [COUNT [MAP...]]]`.
//!
//! Seven frames over 17 stops of which the shortest does not clip the disc: radiance, energy, the sun's irradiance. Four frames
//! that clip it, and a probe that is off by 1 %: the sun rebuilt, and all light. Skies are the model's with clouds, the sun beside
//! them, or lat-long maps with a sun of the model's irradiance where theirs stands (those without a sun are left out); the lens
//! is clean or scatters 2 % of all light. Irradiances are luminances; pixels count above the horizon.

use relume::bracket::{MergeSettings, Merged, Merger, PixelState};
use relume::camera::Frame;
use relume::camera::synthetic::{Glare, SyntheticSettings};
use relume::colour::CameraColour;
use relume::lens::Lens;
use relume::map::luminance;
use relume::probe::{Probe, Probed, Rebuilt};
use relume::response::Response;
use relume::response::calibration::calibrate;
use relume::skymodel::{SkyModel, clear_beam, paint_disc};
use relume::split::split;
use relume::sun::{SunPosition, angle_deg, dir_world};
use relume::weights::SunWeight;
use relume_tests::skycamera::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Light within this angle of the sun's centre, above that farther out, is the sun's, degrees.
const SUN_DEG: f64 = 1.2;
/// Radiance that an exposure of 1 s of the simulated sensor's full well stands for, over the brightest pixel's: not clipped.
const BELOW_CLIPPING: f64 = 0.6;

struct Sky {
    name: String,
    settings: SyntheticSettings,
    sun: SunPosition,
}

fn merged(frames: &[Frame], response: &Response) -> Result<Merged, Box<dyn std::error::Error>> {
    let mut found = Merged::default();
    let settings = MergeSettings { response: response.clone(), ..MergeSettings::default() };
    Merger::new(settings).merge(frames, &mut found)?;
    Ok(found)
}

/// Sums over the pixels above the horizon of radiance x solid angle: all light, the horizontal irradiance, and what stands within
/// [`SUN_DEG`] of the sun above the mean from there to 1.5 times as far.
fn sums(radiance: &[[f32; 3]], width: usize, lens: &Lens, sun: [f32; 3]) -> [[f64; 3]; 3] {
    let (mut found, mut near, mut ring) = ([[0.0; 3]; 3], 0.0, ([0.0; 3], 0.0));
    for (pixel, value) in radiance.iter().enumerate() {
        let at = [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5];
        let (Some(dir), Some(omega)) = (lens.unproject(at), lens.solid_angle_sr(at)) else { continue };
        if dir[1] <= 0.0 {
            continue;
        }
        let apart = angle_deg(dir.map(|c| c as f32), sun);
        for k in 0..3 {
            let light = f64::from(value[k]) * omega;
            found[0][k] += light;
            found[1][k] += light * dir[1];
            found[2][k] += if apart < SUN_DEG { light } else { 0.0 };
            ring.0[k] += if (SUN_DEG..1.5 * SUN_DEG).contains(&apart) { light } else { 0.0 };
        }
        near += if apart < SUN_DEG { omega } else { 0.0 };
        ring.1 += if (SUN_DEG..1.5 * SUN_DEG).contains(&apart) { omega } else { 0.0 };
    }
    found[2] = std::array::from_fn(|k| found[2][k] - near * ring.0[k] / f64::max(ring.1, 1e-12));
    found
}

fn off(found: [f64; 3], truth: [f64; 3]) -> f64 {
    let light = |rgb: [f64; 3]| f64::from(luminance(rgb.map(|v| v as f32)));
    (light(found) / light(truth) - 1.0).abs()
}

/// Settings of the first seed from one on whose sun no cloud hides.
fn in_the_clear(sensor: Sensor, seed: u64) -> (SyntheticSettings, SunPosition) {
    let mut candidates = (seed..).map(|seed| settings(sensor, seed));
    let clear = candidates.find_map(|settings| {
        let sun = settings.sun?;
        let sky = SkyModel::new(settings.atmosphere, sun, settings.north_deg, settings.start_unix_s);
        let through = luminance(sky.sun()?.irradiance) / luminance(clear_beam(sun.altitude_deg as f32, 3.0));
        (through > 0.99).then_some((settings, sun))
    });
    clear.unwrap_or((settings(sensor, seed), SunPosition { azimuth_deg: 0.0, altitude_deg: 30.0 }))
}

fn skies(sensor: Sensor, seed: u64, maps: &[PathBuf]) -> Vec<Sky> {
    let (clear, sun) = in_the_clear(sensor, seed);
    let mut list = vec![Sky { name: "model".into(), settings: clear.clone(), sun }];
    for path in maps {
        let Some(mut under) = under_map(clear.clone(), path) else { continue };
        let Some(mut map) = under.map.take().map(Arc::unwrap_or_clone) else { continue };
        let found = split(&map);
        let Some(dir_world) = found.sun.map(|sun| sun.dir_world).filter(|dir| dir[1] > 0.1) else { continue };
        let altitude_deg = f64::from(dir_world[1].asin().to_degrees());
        let azimuth_deg = f64::from(dir_world[0].atan2(-dir_world[2]).to_degrees());
        map = found.sky;
        paint_disc(&mut map, &SunWeight { dir_world, irradiance: clear_beam(altitude_deg as f32, 3.0) });
        under.map = Some(Arc::new(map));
        let name = path.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        list.push(Sky { name, settings: under, sun: SunPosition { azimuth_deg, altitude_deg } });
    }
    list
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize, other: u64| args.get(at).and_then(|a| a.parse::<u64>().ok()).unwrap_or(other);
    let (first, count) = (number(0, 100), number(1, 1));
    let maps: Vec<PathBuf> = args.iter().skip(2).map(PathBuf::from).collect();
    for (sensor, seed) in SENSORS.iter().flat_map(|&sensor| (first..first + count).map(move |seed| (sensor, seed))) {
        let stored = calibrate(&take(settings(sensor, seed), &exposures(6.25e-5, 2.0, 14)).frames, None)?.response;
        for mut sky in skies(sensor, seed + 500, &maps) {
            for (lens, glare) in
                [("clean", Glare::default()), ("glare", Glare { veil: 0.01, halo: 0.01, halo_px: 6.0 })]
            {
                sky.settings.glare = glare;
                print!("{} {seed} {} {lens}: ", sensor.name(), sky.name);
                wide(&sky, &stored)?;
                clipped(&sky, &stored, seed)?;
            }
        }
    }
    Ok(())
}

/// Seven frames over 17 stops.
fn wide(sky: &Sky, response: &Response) -> Result<(), Box<dyn std::error::Error>> {
    let mut settings = sky.settings.clone();
    settings.exposure_step_s = 1e-12;
    let brightest = take(settings.clone(), &exposures(1e-6, 2.0, 1));
    let most = brightest.truth[0].iter().flatten().fold(0.0f32, |a, &b| a.max(b));
    let series = take(settings, &exposures(BELOW_CLIPPING / f64::from(most), 2f64.powf(17.0 / 6.0), 7));
    let found = merged(&series.frames, response)?;
    let truth = &series.truth[0];
    let is_up = |at: usize| {
        let place = [(at % found.width) as f64 + 0.5, (at / found.width) as f64 + 0.5];
        series.camera.lens().unproject(place).is_some_and(|dir| dir[1] > 0.0)
    };
    let valid = |&at: &usize| truth[at][1] > 0.0 && found.state[at] == PixelState::Valid && is_up(at);
    let pixels = (0..truth.len()).filter(valid);
    let errors = pixels.flat_map(|at| [0, 1, 2].map(|k| f64::from(found.radiance[at][k] / truth[at][k] - 1.0).abs()));
    let [median, p95] = quantiles(errors.collect());
    let direction = dir_world(sky.sun, 0.0);
    let of = |radiance: &[[f32; 3]]| sums(radiance, found.width, series.camera.lens(), direction);
    let (a, b) = (of(&found.radiance), of(truth));
    print!(
        "17 stops {:.2}/{:.2} %, energy {:.2} %, sun {:.2} %; ",
        100.0 * median,
        100.0 * p95,
        100.0 * off(a[0], b[0]),
        100.0 * off(a[2], b[2])
    );
    Ok(())
}

/// Four frames that clip the disc, and a probe; truth is the light before the lens.
fn clipped(sky: &Sky, response: &Response, seed: u64) -> Result<(), Box<dyn std::error::Error>> {
    let series = take(sky.settings.clone(), &exposures(1.25e-4, 8.0, 4));
    let mut found = merged(&series.frames, response)?;
    let (direction, scale) = (dir_world(sky.sun, 0.0), series.camera.radiance_scale());
    let truth: Vec<[f32; 3]> = series.camera.truth().iter().map(|v| v.map(|v| v / scale as f32)).collect();
    let exact = sums(&truth, found.width, series.camera.lens(), direction);
    // One per cent too much or too little, each channel in its own way.
    let sign = |k: usize| if (seed >> k) & 1 == 0 { 1.01 } else { 0.99 };
    let probe = Probe { horizontal: std::array::from_fn(|k| exact[1][k] * sign(k)), relative_sigma: 0.01 };
    let (lens, colour) = (series.camera.lens(), &CameraColour::default());
    let rebuilt = probe.rebuild(&mut Probed { merged: &mut found, sigma: None, lens, colour }, direction)?;
    let all = sums(&found.radiance, found.width, series.camera.lens(), direction);
    match rebuilt {
        Rebuilt::Disc(normal) => println!(
            "probe: sun {:.2} %, as it stands in the map {:.2} %, all light {:.2} %",
            100.0 * off(normal, exact[2]),
            100.0 * off(all[2], exact[2]),
            100.0 * off(all[0], exact[0])
        ),
        other => println!("probe: {other:?}"),
    }
    Ok(())
}
