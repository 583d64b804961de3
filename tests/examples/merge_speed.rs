//! CPU time of merging 4 frames of 1280x960 RGB, 8 bits, on one thread: `cargo run --release -p relume-tests --example
//! merge_speed`. Prints CPU milliseconds, median and least of 31 series, ghost rejection included.

use relume::bench::{cpu_s, median};
use relume::bracket::{MergeSettings, Merged, Merger};
use relume::response::Response;
use relume_tests::skycamera::{Sensor, exposures, settings, take};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut camera = settings(Sensor::Film, 7);
    (camera.width, camera.height) = (1280, 960);
    let series = take(camera, &exposures(1.25e-4, 8.0, 4));
    let response = Response::from_rows(series.camera.response_rows(), "response")?;
    let mut merger = Merger::new(MergeSettings { response, ..MergeSettings::default() });
    let mut merged = Merged::default();
    let mut times_ms = Vec::new();
    for _ in 0..32 {
        let start = cpu_s();
        merger.merge(&series.frames, &mut merged)?;
        times_ms.push(1e3 * (cpu_s() - start));
    }
    let report = merger.report();
    times_ms.remove(0);
    println!("{:.2} {:.2}", median(&times_ms), times_ms.iter().copied().fold(f64::INFINITY, f64::min));
    eprintln!("{} ghost pixels, {:?}", report.ghost_pixels, report.noise);
    Ok(())
}
