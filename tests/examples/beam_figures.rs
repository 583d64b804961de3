//! Figures of the sun's beam through passing clouds while its disc saturates the camera: `cargo run --release -p relume-tests
//! --example beam_figures -- [FIRST_SEED [COUNT]]`.
//!
//! Per seed ten minutes of a drifting sky, a series every ten seconds, 480x480: the beam's share that the sky camera tells against
//! the true one, over the moments with the sun behind a cloud (less than .02 of its beam), in the clear (more than .98) and between;
//! and the longest time for which it was off by more than .3. The lens is clean or scatters light.

use relume::bracket::{MergeSettings, Merged, Merger};
use relume::camera::synthetic::{Glare, SyntheticCamera, SyntheticSettings};
use relume::camera::take_series;
use relume::capture::{Capture, CaptureSettings};
use relume::map::luminance;
use relume::response::Response;
use relume::skymodel::{Atmosphere, clear_beam};
use relume::sun::SunPosition;
use relume_firmware::patches::PatchSet;
use relume_tests::skycamera::exposures;

const MOMENTS: u32 = 60;
const STEP_S: f64 = 10.0;
/// A share that is off by more than this is plainly wrong.
const WRONG: f64 = 0.3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1).filter_map(|a| a.parse::<u64>().ok());
    let (first, count) = (args.next().unwrap_or(100), args.next().unwrap_or(6));
    let lenses = [("clean", Glare::default()), ("halo", Glare { veil: 0.005, halo: 0.01, halo_px: 5.0 })];
    for (name, glare) in lenses {
        let (mut all, mut longest_s) = (Vec::new(), 0.0f64);
        for seed in first..first + count {
            let shares = day(seed, glare)?;
            let mut wrong_s = 0.0;
            for [found, truth] in &shares {
                wrong_s = if (found - truth).abs() > WRONG { wrong_s + STEP_S } else { 0.0 };
                longest_s = longest_s.max(wrong_s);
            }
            all.extend(shares);
        }
        print!("{name}: {} moments", all.len());
        let parts =
            [("behind a cloud", -1.0, 0.02), ("between", 0.02, 0.98), ("in the clear", 0.98, 2.0), ("all", -1.0, 2.0)];
        for (name, low, high) in parts {
            let part = all.iter().filter(|[_, truth]| (low..high).contains(truth));
            let off: Vec<f64> = part.map(|[found, truth]| (found - truth).abs()).collect();
            let wrong = off.iter().filter(|&&off| off > WRONG).count() as f64;
            let of = off.len().max(1) as f64;
            print!("; {name} mean {:.3}, plainly wrong {:.1} %", off.iter().sum::<f64>() / of, 100.0 * wrong / of);
        }
        println!("; longest {longest_s:.0} s");
    }
    Ok(())
}

/// Found and true share of the beam, moment by moment.
fn day(seed: u64, glare: Glare) -> Result<Vec<[f64; 2]>, Box<dyn std::error::Error>> {
    let sun =
        SunPosition { azimuth_deg: (seed as f64 * 137.5) % 360.0, altitude_deg: 12.0 + (seed as f64 * 37.3) % 50.0 };
    let atmosphere = Atmosphere { cloud_cover: 0.35, cloud_seed: seed, ..Atmosphere::default() };
    let settings = SyntheticSettings { sun: Some(sun), atmosphere, glare, seed, ..SyntheticSettings::default() };
    let mut camera = SyntheticCamera::new(settings);
    let response = Response::from_rows(camera.response_rows(), "response")?;
    let mut merger = Merger::new(MergeSettings { response, ..MergeSettings::default() });
    let weights = CaptureSettings { radiance_scale: camera.radiance_scale(), ..CaptureSettings::default() };
    let mut capture = Capture::new(camera.lens(), (480, 480), PatchSet::new(256)?, weights, None)?;
    let (mut frames, mut merged, mut shares) = (Vec::new(), Merged::default(), Vec::new());
    let beam = f64::from(luminance(clear_beam(sun.altitude_deg as f32, atmosphere.turbidity)));
    for moment in 0..MOMENTS {
        camera.set_time(f64::from(moment) * STEP_S);
        take_series(&mut camera, &exposures(1e-4, 8.0, 4), &mut frames)?;
        merger.merge(&frames, &mut merged)?;
        let found = capture.weights(&merged, Some(sun))?;
        let share =
            |sun: Option<relume::weights::SunWeight>| sun.map_or(0.0, |s| f64::from(luminance(s.irradiance)) / beam);
        shares.push([share(found.weights.sun), share(camera.sky().sun())]);
    }
    Ok(shares)
}
