//! What the bench found: one JSON object, or a table for people.

use serde::Serialize;

use super::arbitrary::LightsReport;
use super::bounds::BoundsReport;
use super::skipping::SkippingReport;

/// The whole finding. Shares and errors are fractions, not per cent; every other number names its unit.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// Names of the skies that were used.
    pub skies: Vec<String>,
    /// How many of them have the sun up, as compared.
    pub skies_with_sun: usize,
    /// Size of the picture.
    pub width_px: usize,
    /// Size of the picture.
    pub height_px: usize,
    /// Covered pixels.
    pub covered_px: usize,
    /// Bytes of the field read for a full frame, per covered pixel, the sun's layer included where a sky has a sun.
    pub bytes_per_covered_pixel: f64,
    /// Bytes of the whole file, per covered pixel.
    pub bytes_stored_per_covered_pixel: f64,
    /// Bytes of the field read per second of CPU time, as a share of this run's read bandwidth; one thread, in cache.
    pub share_of_read_bandwidth: f64,
    /// What one thread reads from memory per second of CPU time.
    pub read_bandwidth_one_thread_bytes_per_cpu_s: f64,
    /// What two threads at once read per second of the CPU time of both.
    pub read_bandwidth_two_threads_bytes_per_cpu_s: f64,
    /// Size of the buffer over which that was measured.
    pub read_bandwidth_buffer_bytes: usize,
    /// Tracing the sun after it has moved, which no frame's time includes; `None` without a sun.
    pub sun_trace_cpu_ms: Option<f64>,
    /// One entry per method and budget: its errors, and its time on one thread in cache.
    pub methods: Vec<MethodReport>,
    /// The same field frame after frame.
    pub in_cache: Section,
    /// Copies of the field in turn, more bytes than the caches hold; `None`: left out.
    pub beyond_cache: Option<Section>,
    /// The bounds against the true errors; `None` without a stack or without bounds.
    pub bounds: Option<BoundsReport>,
    /// Arbitrary lights under an error budget; `None` without a stack or without bounds.
    pub lights: Option<LightsReport>,
    /// What skipping saves: without a sun, and with it where a sky has one.
    pub skipping: Vec<SkippingReport>,
}

/// One method at one budget. Error values are `None` without a stack.
#[derive(Clone, Debug, Serialize)]
pub struct MethodReport {
    /// Name; `relume`, `dense_f32_openblas` or another rival's.
    pub name: String,
    /// The budget it was given; `None`: it takes none.
    pub budget: Option<String>,
    /// Median CPU time of a full frame: weights to 8-bit picture, milliseconds.
    pub cpu_ms_per_frame: f64,
    /// Relative RMSE, median of the skies.
    pub rmse_median: Option<f64>,
    /// Relative RMSE, worst sky.
    pub rmse_worst: Option<f64>,
    /// Relative RMSE, worst sky without a sun.
    pub rmse_worst_without_sun: Option<f64>,
    /// Relative RMSE, worst sky with the sun up. The rivals sum the stack's own picture of the sun, grain and all, which
    /// holds for that one place of the sun alone; Relume traces the sun wherever it stands.
    pub rmse_worst_with_sun: Option<f64>,
    /// Largest error of an 8-bit value under any sky.
    pub worst_code: Option<u8>,
    /// Share of 8-bit values off by more than one, worst sky.
    pub share_off_by_more_than_one: Option<f64>,
    /// Largest distance of an 8-bit value from the exact code before rounding, worst sky without a sun.
    pub code_error_worst_without_sun: Option<f64>,
    /// The largest bound in codes that the frames of the skies without a sun came with. (It covers the sky's light alone.)
    pub bound_codes_worst_without_sun: Option<f64>,
    /// The dense sum's CPU time / this one's; `None` where OpenBLAS is missing.
    pub times_faster_than_dense_f32_openblas: Option<f64>,
    /// The errors sky by sky; empty without a stack.
    pub errors_per_sky: Vec<SkyErrors>,
}

/// Errors of a method under one sky.
#[derive(Clone, Debug, Serialize)]
pub struct SkyErrors {
    /// Name of the sky.
    pub sky: String,
    /// Is the sun up in it, as compared?
    pub has_sun: bool,
    /// Relative RMSE.
    pub rmse: f64,
    /// Largest error of an 8-bit value.
    pub worst_code: u8,
    /// Share of 8-bit values off by more than one.
    pub share_off_by_more_than_one: f64,
    /// Largest distance of an 8-bit value from the exact code before rounding.
    pub code_error: f64,
    /// The bound in codes that the frame came with, on the sky's light; `None`: the method gives none.
    pub bound_codes: Option<f64>,
}

/// Times under one condition.
#[derive(Clone, Debug, Serialize)]
pub struct Section {
    /// Copies of the field that take turns.
    pub field_copies: usize,
    /// Bytes that those copies hold for frames to read.
    pub field_bytes: usize,
    /// Bytes of made-up numbers through which the rivals' frames wander; 0: each has its own.
    pub rivals_bytes: usize,
    /// Size of the last-level cache, as the system or the caller says; 0: unknown.
    pub last_level_cache_bytes: usize,
    /// Were skies with the sun up among the frames?
    pub sun_included: bool,
    /// One entry per method, budget and number of threads.
    pub timings: Vec<Timing>,
}

/// Times of one method. Medians over frames; a frame is weights to 8-bit picture.
#[derive(Clone, Debug, Serialize)]
pub struct Timing {
    /// Name of the method.
    pub name: String,
    /// The budget it was given; `None`: it takes none.
    pub budget: Option<String>,
    /// Threads.
    pub threads: usize,
    /// CPU time of all threads.
    pub cpu_ms_per_frame: f64,
    /// The same over frames with a sun; `None`: there were none.
    pub cpu_ms_per_frame_with_sun: Option<f64>,
    /// The same over frames without a sun; `None`: there were none.
    pub cpu_ms_per_frame_without_sun: Option<f64>,
    /// CPU time when the coefficients are known already; `None`: the method has no such thing.
    pub cpu_ms_per_frame_coefficients_reused: Option<f64>,
    /// Wall-clock time.
    pub wall_ms_per_frame: f64,
    /// Bytes that a frame reads per covered pixel, mean of the frames.
    pub bytes_read_per_covered_pixel: f64,
    /// Those bytes per second of CPU time as a share of what as many threads read in this run.
    pub share_of_read_bandwidth: f64,
    /// The dense sum's CPU time on as many threads / this one's; `None` where OpenBLAS is missing.
    pub times_faster_than_dense_f32_openblas: Option<f64>,
    /// The same with the coefficients known already.
    pub times_faster_than_dense_f32_openblas_coefficients_reused: Option<f64>,
}

/// Name of the rival in reports.
pub const DENSE_NAME: &str = "dense_f32_openblas";
/// Name of Relume's own way in reports.
pub const RELUME_NAME: &str = "relume";

impl Section {
    /// Fills in how many times faster each method is than the dense sum on as many threads, where that was measured.
    pub fn compare_with_dense(&mut self) {
        let dense: Vec<(usize, f64)> = self
            .timings
            .iter()
            .filter(|timing| timing.name == DENSE_NAME)
            .map(|timing| (timing.threads, timing.cpu_ms_per_frame))
            .collect();
        for timing in &mut self.timings {
            let Some((_, dense_ms)) = dense.iter().find(|(threads, _)| *threads == timing.threads) else { continue };
            timing.times_faster_than_dense_f32_openblas = Some(dense_ms / timing.cpu_ms_per_frame);
            timing.times_faster_than_dense_f32_openblas_coefficients_reused =
                timing.cpu_ms_per_frame_coefficients_reused.map(|ms| dense_ms / ms);
        }
    }

    /// The times of a method at a budget on so many threads.
    pub fn timing(&self, name: &str, budget: Option<&str>, threads: usize) -> Option<&Timing> {
        let same = |t: &&Timing| t.name == name && t.budget.as_deref() == budget && t.threads == threads;
        self.timings.iter().find(same)
    }
}

impl BenchReport {
    /// A line if any bound is below the true error: then it is none.
    pub fn broken_bound(&self) -> Option<String> {
        let skies = self.bounds.iter().flat_map(|bounds| &bounds.per_sky);
        let skies = skies.map(|sky| (format!("sky {}", sky.sky), sky.share_of_tiles_below_error));
        let lights = self.lights.iter().map(|l| ("an arbitrary light".to_owned(), l.share_of_tiles_below_error()));
        let (what, share) = skies.chain(lights).find(|(_, share)| *share > 0.0)?;
        Some(format!(
            "{what}: the bound of {:.2} % of the tiles is below their true error; it must never be",
            100.0 * share
        ))
    }
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{:.3} %", 100.0 * v))
}

fn codes(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"))
}

fn times(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |times| format!("{times:.1}x"))
}

impl std::fmt::Display for BenchReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "skies: {}", self.skies.join(", "))?;
        writeln!(
            f,
            "bytes per covered pixel: {:.1} read, {:.1} stored; {:.0} % of the read bandwidth",
            self.bytes_per_covered_pixel,
            self.bytes_stored_per_covered_pixel,
            100.0 * self.share_of_read_bandwidth
        )?;
        writeln!(
            f,
            "{:<26} {:<16} {:>9} {:>10} {:>10} {:>6} {:>6} {:>6} {:>10} {:>8}",
            "method", "budget", "ms/frame", "RMSE med", "worst", "code", "sky's", "bound", "off > 1", "faster"
        )?;
        for m in &self.methods {
            writeln!(
                f,
                "{:<26} {:<16} {:>9.3} {:>10} {:>10} {:>6} {:>6} {:>6} {:>10} {:>8}",
                m.name,
                m.budget.as_deref().unwrap_or("-"),
                m.cpu_ms_per_frame,
                percent(m.rmse_median),
                percent(m.rmse_worst),
                m.worst_code.map_or_else(|| "-".to_owned(), |code| code.to_string()),
                codes(m.code_error_worst_without_sun),
                codes(m.bound_codes_worst_without_sun),
                percent(m.share_off_by_more_than_one),
                times(m.times_faster_than_dense_f32_openblas),
            )?;
        }
        write_section(f, "in cache", &self.in_cache)?;
        self.beyond_cache.as_ref().map_or(Ok(()), |section| write_section(f, "beyond the caches", section))?;
        self.bounds.as_ref().map_or(Ok(()), |bounds| write!(f, "{bounds}"))?;
        self.lights.as_ref().map_or(Ok(()), |lights| write!(f, "{lights}"))?;
        self.skipping.iter().try_for_each(|skipping| write!(f, "{skipping}"))
    }
}

fn write_section(f: &mut std::fmt::Formatter<'_>, title: &str, section: &Section) -> std::fmt::Result {
    let mib = |bytes: usize| bytes >> 20;
    writeln!(
        f,
        "\n{title}: {} x field, {} MiB; last-level cache {} MiB",
        section.field_copies,
        mib(section.field_bytes),
        mib(section.last_level_cache_bytes)
    )?;
    writeln!(
        f,
        "{:<26} {:<16} {:>3} {:>8} {:>8} {:>8} {:>8} {:>7} {:>8} {:>8}",
        "method", "budget", "thr", "CPU ms", "wall ms", "reused", "bytes/px", "memory", "faster", "reused"
    )?;
    for t in &section.timings {
        writeln!(
            f,
            "{:<26} {:<16} {:>3} {:>8.3} {:>8.3} {:>8} {:>8.1} {:>5.0} % {:>8} {:>8}",
            t.name,
            t.budget.as_deref().unwrap_or("-"),
            t.threads,
            t.cpu_ms_per_frame,
            t.wall_ms_per_frame,
            t.cpu_ms_per_frame_coefficients_reused.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.3}")),
            t.bytes_read_per_covered_pixel,
            100.0 * t.share_of_read_bandwidth,
            times(t.times_faster_than_dense_f32_openblas),
            times(t.times_faster_than_dense_f32_openblas_coefficients_reused),
        )?;
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests;
