//! What the demo measured: `report.json` and the summary.

use std::io::Write;
use std::path::Path;
use std::time::Duration;

use serde::Serialize;

use super::compare::Blocks;
use super::day::Moment;
use super::figures::{size_told, spared};
use super::site::Site;
use super::trace::Trace;
use crate::failure::{Failure, OrFail};
use crate::outfile::write_whole;

/// One picture.
#[derive(Serialize)]
struct Picture {
    time: String,
    sun_azimuth_deg: f64,
    sun_altitude_deg: f64,
    sun_shines: bool,
    exposure: f32,
    relight_ms: f64,
    draw_ms: f64,
    tiles_kept_percent: f64,
    relative_rmse_sky: Option<f64>,
    irradiance_off: f64,
}

/// One moment against the path trace.
#[derive(Serialize)]
struct Traced {
    time: String,
    seconds: f64,
    transport: Blocks,
    camera: Blocks,
}

/// `report.json`. Errors are fractions.
#[derive(Serialize)]
pub(super) struct Report {
    size: String,
    triangles: usize,
    bake_s: f64,
    field_bytes: usize,
    rank_mean: f64,
    bytes_per_covered_pixel: f64,
    relative_rmse_sky_median: f64,
    relative_rmse_sky_worst: f64,
    camera_irradiance_off_median: f64,
    camera_irradiance_off_worst: f64,
    relight_ms_median: f64,
    draw_ms_median: f64,
    drift_tiles_kept_percent: f64,
    drift_sun_not_traced_percent: f64,
    total_s: f64,
    traced: Vec<Traced>,
    pictures: Vec<Picture>,
    drift: Vec<Picture>,
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

fn picture(moment: &Moment) -> Picture {
    Picture {
        time: moment.clock(),
        sun_azimuth_deg: moment.sun.azimuth_deg,
        sun_altitude_deg: moment.sun.altitude_deg,
        sun_shines: moment.weights.sun.is_some(),
        exposure: moment.exposure,
        relight_ms: milliseconds(moment.relight_time),
        draw_ms: milliseconds(moment.draw_time),
        tiles_kept_percent: spared(moment)[0].1,
        relative_rmse_sky: moment.error,
        irradiance_off: moment.irradiance_off,
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

fn median(values: &[f64]) -> f64 {
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

impl Report {
    /// Gathers the figures.
    pub fn new(site: &Site, hours: &[Moment], drift: &[Moment], traces: &[Trace], total: Duration) -> Self {
        let errors = sorted(hours.iter().filter_map(|moment| moment.error));
        let off = sorted(hours.iter().map(|moment| moment.irradiance_off.abs()));
        let times = |pick: fn(&Moment) -> Duration| sorted(hours.iter().map(|moment| milliseconds(pick(moment))));
        let kept: Vec<f64> = drift.iter().skip(1).map(|moment| spared(moment)[0].1).collect();
        let untraced: Vec<f64> =
            drift.iter().skip(1).map(|moment| if moment.counters.sun_traced { 0.0 } else { 100.0 }).collect();
        let traced = |trace: &Trace| Traced {
            time: hours[trace.moment].clock(),
            seconds: trace.time.as_secs_f64(),
            transport: trace.transport,
            camera: trace.camera,
        };
        Report {
            size: size_told(),
            triangles: site.scene.triangles.len(),
            bake_s: site.bake_time.as_secs_f64(),
            field_bytes: site.bytes,
            rank_mean: site.baked.rank_mean,
            bytes_per_covered_pixel: site.baked.bytes_per_covered_pixel,
            relative_rmse_sky_median: median(&errors),
            relative_rmse_sky_worst: errors.last().copied().unwrap_or(0.0),
            camera_irradiance_off_median: median(&off),
            camera_irradiance_off_worst: off.last().copied().unwrap_or(0.0),
            relight_ms_median: median(&times(|moment| moment.relight_time)),
            draw_ms_median: median(&times(|moment| moment.draw_time)),
            drift_tiles_kept_percent: mean(&kept),
            drift_sun_not_traced_percent: mean(&untraced),
            total_s: total.as_secs_f64(),
            traced: traces.iter().map(traced).collect(),
            pictures: hours.iter().map(picture).collect(),
            drift: drift.iter().map(picture).collect(),
        }
    }

    /// Writes the report as JSON.
    pub fn save(&self, path: &Path) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(self).or_runtime()?;
        Ok(write_whole(path, |file| writeln!(file, "{text}"))?)
    }

    /// Prints the summary.
    pub fn say(&self, out: &Path) -> Result<(), Failure> {
        let text = self.summary(out);
        match std::io::stdout().lock().write_all(text.as_bytes()) {
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).or_runtime(),
            _ => Ok(()),
        }
    }

    fn summary(&self, out: &Path) -> String {
        let percent = |value: f64| 100.0 * value;
        let mut text = format!(
            "temple   {} triangles, {} pixels; baked in {:.0} s to {:.2} MB ({:.0} bytes per covered pixel)\n",
            self.triangles,
            self.size,
            self.bake_s,
            self.field_bytes as f64 / 1e6,
            self.bytes_per_covered_pixel
        );
        text += &format!(
            "day      {} pictures; per picture {:.1} ms for new weights, {:.1} ms to draw (medians, with tracing the sun)\n",
            self.pictures.len(),
            self.relight_ms_median,
            self.draw_ms_median
        );
        text += &format!(
            "skipped  under drifting clouds {:.0} % of the tiles kept, the sun not traced in {:.0} % of the pictures\n",
            self.drift_tiles_kept_percent, self.drift_sun_not_traced_percent
        );
        text += &format!(
            "error    sky against the exact sum: {:.2} % median, {:.2} % worst (relative RMSE)\n",
            percent(self.relative_rmse_sky_median),
            percent(self.relative_rmse_sky_worst)
        );
        text += &format!(
            "         sky camera: horizontal irradiance off by {:.1} % median, {:.0} % worst\n",
            percent(self.camera_irradiance_off_median),
            percent(self.camera_irradiance_off_worst)
        );
        for traced in &self.traced {
            let (blocks, bias) = (traced.transport.block_rmse, traced.transport.bias.map(percent));
            text += &format!(
                "         {} against a path trace: {:.1} % over 8x8 blocks, bias {:+.1} {:+.1} {:+.1} % (r g b); \
                 with the sky camera {:.1} %\n",
                traced.time,
                percent(blocks),
                bias[0],
                bias[1],
                bias[2],
                percent(traced.camera.block_rmse)
            );
        }
        text + &format!("files    {} (all in {:.0} s)\n", out.display(), self.total_s)
    }
}
