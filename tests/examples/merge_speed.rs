//! CPU time of merging 4 frames of 1280x960 RGB, 8 bits, on one thread: `cargo run --release -p relume-tests --example
//! merge_speed`. Prints milliseconds, median and least of 31 series, ghost rejection included.

use relume::bracket::{MergeSettings, Merged, Merger};
use relume::response::Response;
use relume_tests::skycamera::{Sensor, exposures, settings, take};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut camera = settings(Sensor::Film, 7);
    (camera.width, camera.height) = (1280, 960);
    let series = take(camera, &exposures(1.25e-4, 8.0, 4));
    let response = Response::from_rows(series.camera.response_rows(), "response")?;
    let mut merger = Merger::new(MergeSettings { response, ..MergeSettings::default() });
    let mut merged = Merged::default();
    let mut times_ms = Vec::new();
    for _ in 0..32 {
        let start = Instant::now();
        merger.merge(&series.frames, &mut merged)?;
        times_ms.push(1e3 * start.elapsed().as_secs_f64());
    }
    let report = merger.report();
    times_ms.remove(0);
    times_ms.sort_by(f64::total_cmp);
    println!("{:.2} {:.2}", times_ms[times_ms.len() / 2], times_ms[0]);
    eprintln!("{} ghost pixels, {:?}", report.ghost_pixels, report.noise);
    Ok(())
}
