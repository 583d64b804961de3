//! Figures of the sky camera on simulated series with known truth: `cargo run --release -p relume-tests --example sky_figures
//! -- [FIRST_SEED [COUNT]]`. Where things move the truth is that of the reference frame's moment.

use relume::bracket::{MergeSettings, Merged, Merger, PixelState};
use relume::camera::Frame;
use relume::response::Response;
use relume::response::calibration::calibrate;
use relume_tests::skycamera::*;

fn merged(frames: &[Frame], response: &Response) -> (Merged, relume::bracket::MergeReport) {
    let mut merger = Merger::new(MergeSettings { response: response.clone(), ..MergeSettings::default() });
    let mut merged = Merged::default();
    if let Err(error) = merger.merge(frames, &mut merged) {
        eprintln!("{error}");
    }
    (merged, merger.report().clone())
}

/// Relative errors over pixels, against the light at the moment of a frame.
fn errors(merged: &Merged, series: &Series, frame: usize, mask: impl Fn(usize) -> bool) -> [f64; 2] {
    let mut all = Vec::new();
    for (at, truth) in series.truth[frame].iter().enumerate() {
        if truth[1] > 0.0 && merged.state[at] == PixelState::Valid && mask(at) {
            (0..3).for_each(|k| all.push(f64::from(merged.radiance[at][k] / truth[k] - 1.0).abs()));
        }
    }
    quantiles(all)
}

fn main() {
    let mut args = std::env::args().skip(1).filter_map(|a| a.parse::<u64>().ok());
    let (first, count) = (args.next().unwrap_or(100), args.next().unwrap_or(2));
    let pct = |[a, b]: [f64; 2]| format!("{:.2}/{:.2}%", 100.0 * a, 100.0 * b);
    for sensor in SENSORS {
        for seed in first..first + count {
            let name = format!("{} {seed}", sensor.name());
            let long = take(settings(sensor, seed), &exposures(6.25e-5, 2.0, 14));
            let stored = match calibrate(&long.frames, None) {
                Ok(found) => found,
                Err(error) => {
                    println!("{name}: {error}");
                    continue;
                }
            };
            let truth = long.camera.response_rows();
            let (rms, spread) = response_error(|code, k| stored.response.fraction(code, k), &truth);
            println!(
                "{name}: black {:.4} response 14: rms {rms:.4} colour {spread:.4} {:?}",
                stored.black, stored.channels
            );
            if std::env::var_os("CURVE").is_some() {
                for code in [2, 5, 10, 20, 40, 80, 120, 160, 200, 230, 240, 245, 250, 255] {
                    let row = truth[code];
                    let of = |k: usize| (stored.response.fraction(row[0], k) / row[k + 1]).ln();
                    println!("   {code}: {:.4} {:.4} {:.4}", of(0), of(1), of(2));
                }
            }
            let (found, report) = merged(&long.frames, &stored.response);
            println!(
                "    merge 14: {} noise {:?} drift {:.4} ghosts {}",
                pct(errors(&found, &long, 0, |_| true)),
                report.noise,
                report.drift,
                report.ghost_pixels
            );
            let four = take(settings(sensor, seed + 1000), &exposures(1.25e-4, 8.0, 4));
            let (found, report) = merged(&four.frames, &stored.response);
            println!(
                "    merge 4 stored: {} noise {:?} ghosts {}",
                pct(errors(&found, &four, 0, |_| true)),
                report.noise,
                report.ghost_pixels
            );
            match calibrate(&four.frames, None) {
                Ok(own) => {
                    let (rms, spread) = response_error(|code, k| own.response.fraction(code, k), &truth);
                    println!("    response 4: rms {rms:.4} colour {spread:.4}");
                    let (found, _) = merged(&four.frames, &own.response);
                    println!("    merge 4 own: {}", pct(errors(&found, &four, 0, |_| true)));
                }
                Err(error) => println!("    response 4: {error}"),
            }
            for (label, times) in [("14", exposures(6.25e-5, 2.0, 14)), ("4", exposures(1.25e-4, 8.0, 4))] {
                let mut with = settings(sensor, seed + 2000);
                with.ghosts = ghosts(seed);
                let passed = take(with, &times);
                let (found, report) = merged(&passed.frames, &stored.response);
                println!(
                    "    ghosts {label}: {} outside {} ({} of {} px, reference {})",
                    pct(errors(&found, &passed, report.reference, |at| passed.ghost_mask[at])),
                    pct(errors(&found, &passed, report.reference, |at| !passed.ghost_mask[at])),
                    report.ghost_pixels,
                    passed.ghost_mask.iter().filter(|&&m| m).count(),
                    report.reference
                );
            }
        }
    }
}
