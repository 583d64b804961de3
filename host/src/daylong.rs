//! A whole day in fast time: from the sun 8 degrees below the horizon through noon to 8 degrees below, under passing
//! clouds, a simulated sky camera's light beside the true one.
//!
//! Everything but the sensor and the sky is what a post runs: plan, series, merge, weights, relight. Per moment the linear
//! picture under the camera's weights is compared with the one under the true sky's.

use crate::config::Config;
use crate::failure::{Failure, OrFail};
use crate::importance::importance;
use crate::map::luminance;
use crate::plot::{Axis, Canvas, Chart, Series};
use crate::relight::Relighter;
use crate::sky_source::captured::CapturedSky;
use crate::sky_source::simulated::atmosphere;
use crate::sky_source::{SkyReading, SkySource, SunSource};
use crate::skymodel::SkyModel;
use crate::sun::{Place, sun_position};
use crate::weights::PatchWeights;
use crate::{clock, split};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::RgbColor;
use relume_firmware::field::Field;
use serde::Serialize;

/// The day begins and ends with the sun so far above the horizon, degrees.
pub const ENDS_DEG: f64 = -8.0;
/// Rows of the map that the true sky is taken from.
const TRUTH_ROWS: usize = 192;
/// A plan flaps that comes back within so many series and so many seconds, or after one series with another.
const FLAP_SERIES: usize = 6;
const FLAP_S: f64 = 3600.0;

/// One moment of the day.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Moment {
    /// Unix seconds.
    pub unix_s: f64,
    /// Degrees above the horizon.
    pub sun_altitude_deg: f64,
    /// Relative RMSE of the linear picture against that under the true sky, all channels, covered pixels.
    pub error: f64,
    /// The same without the sun in either.
    pub sky_error: f64,
    /// Median over the patches of the relative difference of luminance.
    pub weights_error: f64,
    /// The sun's irradiance on a plane normal to it, luminance: measured and true.
    pub sun: [f64; 2],
    /// How the sun was known.
    pub sun_source: SunSource,
    /// Exposures of the next series.
    pub frames: usize,
    /// Their times together, seconds.
    pub light_s: f64,
    /// Times the plan has changed until now.
    pub changes: u64,
    /// Mean luminance of the covered pixels.
    pub brightness: f64,
}

/// The day.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Median and worst relative RMSE against the true sky's picture.
    pub error: [f64; 2],
    /// The same of moments with the true sun up and not behind a cloud (a half of its clear beam or more).
    pub error_in_sunshine: [f64; 2],
    /// The same without the sun in either picture.
    pub sky_error: [f64; 2],
    /// Times the plan changed, and times it went back to one that was left less than six series before.
    pub plan_changes: u64,
    /// See above.
    pub flaps: usize,
    /// Moments without light, or in which it was not finite.
    pub dark: usize,
    /// Largest over smallest brightness of the picture.
    pub brightness_range: f64,
    /// All of them.
    pub moments: Vec<Moment>,
}

/// Times of the day of `unix_s` (its UTC date) between the sun's rise above [`ENDS_DEG`] and its fall below.
pub fn span(unix_s: f64, place: Place) -> Option<[f64; 2]> {
    let noon = (unix_s / 86_400.0).floor() * 86_400.0 + 43_200.0 - place.longitude_deg * 240.0;
    let is_up = |minute: i32| {
        let at = noon + 60.0 * f64::from(minute);
        sun_position(at, place).is_ok_and(|sun| sun.altitude_deg >= ENDS_DEG).then_some(at)
    };
    let begin = (-720..720).find_map(is_up)?;
    let end = (-720..720).rev().find_map(is_up)?;
    Some([begin, end])
}

/// Runs a day of `count` moments over a field under the weather of a post's file with `sky = "synthetic"`.
///
/// # Errors
/// [`Failure`] when the post's file has no site or camera that can be used, or the camera fails.
pub fn run(config: &Config, field: &Field<'_>, date_unix_s: f64, count: usize) -> Result<Report, Failure> {
    let missing = || Failure::bad(format!("{}: [site] is missing", config.file.display()));
    let site = config.site.ok_or_else(missing)?;
    let (patches, north_deg) = (*field.patch_set(), f64::from(field.camera().north_deg));
    let mut camera = CapturedSky::open(config, patches, north_deg).or_bad()?.with_importance(&importance(field));
    let no_day = || Failure::bad(format!("{}: the sun stays down all day there", config.file.display()));
    let [begin, end] = span(date_unix_s, site.place).ok_or_else(no_day)?;
    let mut meter = Relighter::new(*field, 1);
    let (mut moments, mut reading) = (Vec::new(), SkyReading::default());
    for number in 0..count {
        let unix_s = begin + (end - begin) * number as f64 / (count.max(2) - 1) as f64;
        camera.read(clock::Moment { unix_s, trusted: true }, &mut reading).or_runtime()?;
        let sky = SkyModel::at(atmosphere(site, config.weather), unix_s, site.place, north_deg).or_runtime()?;
        let mut radiance = split::settled(&sky.map(TRUTH_ROWS), &patches, 0.0);
        radiance[patches.upper()..].fill(sky.ground_radiance());
        let truth = PatchWeights { radiance, sun: sky.sun() };
        moments.push(compare(&mut meter, unix_s, &reading, &truth, site.place)?);
    }
    Ok(summary(moments))
}

fn compare(
    meter: &mut Relighter<'_>,
    unix_s: f64,
    reading: &SkyReading,
    truth: &PatchWeights,
    place: Place,
) -> Result<Moment, Failure> {
    let mut pictures = |weights: &PatchWeights| -> Result<[Vec<[f32; 3]>; 2], Failure> {
        let mut of = |sun| {
            let weights = PatchWeights { radiance: weights.radiance.clone(), sun };
            meter.set_weights(&weights, 1.0).or_runtime()?;
            let picture = meter.radiance();
            let pixels = picture.rgb.iter().zip(&picture.alpha).filter(|(_, alpha)| **alpha > 0.0);
            Ok::<_, Failure>(pixels.map(|(rgb, _)| *rgb).collect())
        };
        Ok([of(weights.sun)?, of(None)?])
    };
    let (found, exact) = (pictures(&reading.weights)?, pictures(truth)?);
    let upper = field_upper(truth);
    let pairs = reading.weights.radiance.iter().zip(&truth.radiance).take(upper);
    let mut apart: Vec<f64> =
        pairs.map(|(a, b)| f64::from((luminance(*a) / luminance(*b).max(1e-30) - 1.0).abs())).collect();
    apart.sort_unstable_by(f64::total_cmp);
    let sun = [&reading.weights, truth].map(|w| w.sun.map_or(0.0, |sun| f64::from(luminance(sun.irradiance))));
    let plan = reading.series.unwrap_or_default().plan;
    let light: f64 = found[0].iter().map(|&rgb| f64::from(luminance(rgb))).sum();
    Ok(Moment {
        unix_s,
        sun_altitude_deg: sun_position(unix_s, place).or_runtime()?.altitude_deg,
        error: relative_rmse(&found[0], &exact[0]),
        sky_error: relative_rmse(&found[1], &exact[1]),
        weights_error: apart.get(apart.len() / 2).copied().unwrap_or(0.0),
        sun,
        sun_source: reading.sun,
        frames: plan.frames,
        light_s: plan.light_s,
        changes: plan.changes,
        brightness: light / found[0].len().max(1) as f64,
    })
}

/// Patches above the horizon: one in 17 is below it.
fn field_upper(weights: &PatchWeights) -> usize {
    weights.radiance.len() * 16 / 17
}

/// rms(difference) / mean(exact) over all channels.
fn relative_rmse(found: &[[f32; 3]], exact: &[[f32; 3]]) -> f64 {
    let pairs = found.as_flattened().iter().zip(exact.as_flattened());
    let (square, sum) = pairs.fold((0.0, 0.0), |(square, sum), (&a, &b)| {
        (square + (f64::from(a) - f64::from(b)).powi(2), sum + f64::from(b))
    });
    let count = (3 * exact.len()).max(1) as f64;
    if sum > 0.0 { (square / count).sqrt() / (sum / count) } else { 0.0 }
}

fn summary(moments: Vec<Moment>) -> Report {
    let ends = |values: &mut dyn Iterator<Item = f64>| {
        let mut sorted: Vec<f64> = values.collect();
        sorted.sort_unstable_by(f64::total_cmp);
        [sorted.get(sorted.len() / 2).copied().unwrap_or(0.0), sorted.last().copied().unwrap_or(0.0)]
    };
    let shines = |m: &&Moment| {
        let beam = f64::from(luminance(crate::skymodel::clear_beam(m.sun_altitude_deg as f32, 3.0)));
        beam > 0.0 && m.sun[1] >= 0.5 * beam
    };
    let brightness = moments.iter().map(|m| m.brightness).filter(|v| *v > 0.0);
    let range = brightness.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], v| [low.min(v), high.max(v)]);
    Report {
        error: ends(&mut moments.iter().map(|m| m.error)),
        error_in_sunshine: ends(&mut moments.iter().filter(shines).map(|m| m.error)),
        sky_error: ends(&mut moments.iter().map(|m| m.sky_error)),
        plan_changes: moments.last().map_or(0, |m| m.changes),
        flaps: flaps(&moments),
        dark: moments.iter().filter(|m| !(m.brightness > 0.0 && m.brightness.is_finite())).count(),
        brightness_range: range[1] / range[0].max(1e-300),
        moments,
    }
}

/// Times a plan of as many frames and as much light came back soon after it had been left.
fn flaps(moments: &[Moment]) -> usize {
    let plan = |m: &Moment| (m.frames, m.light_s.to_bits());
    let came_back = |at: &usize| {
        let (now, before) = (plan(&moments[*at]), plan(&moments[at - 1]));
        let soon = &moments[at.saturating_sub(FLAP_SERIES)..at - 1];
        // Morning and evening of a day of few moments may well ask for the same.
        let is_soon = |m: &Moment| moments[*at].unix_s - m.unix_s <= FLAP_S;
        let flips = *at >= 2 && plan(&moments[at - 2]) == now;
        now != before && (flips || soon.iter().any(|m| plan(m) == now && is_soon(m)))
    };
    (1..moments.len()).filter(came_back).count()
}

/// Two charts: the picture's error over the day, and what the camera did.
pub fn draw(report: &Report, midnight_unix_s: f64) -> Canvas {
    let hour = |m: &Moment| (m.unix_s - midnight_unix_s) / 3600.0;
    let line = |of: &dyn Fn(&Moment) -> f64| report.moments.iter().map(|m| (hour(m), of(m).max(1e-6))).collect();
    let from = report.moments.first().map_or(0.0, hour).floor();
    let to = report.moments.last().map_or(24.0, hour).ceil();
    let hours = || Axis::hours("local time", from, to, 1.0);
    let above = Chart::new(
        "Picture under the camera's light against that under the true sky",
        hours(),
        Axis::log("relative RMSE, %"),
    )
    .with(Series::line("sky and sun", line(&|m| 100.0 * m.error)))
    .with(Series::line("sky alone", line(&|m| 100.0 * m.sky_error)))
    .draw(960, 360);
    let beam: f64 = report.moments.iter().map(|m| m.sun[1]).fold(0.0, f64::max).max(1e-30);
    let below = Chart::new("What the camera did", hours(), Axis::linear("share, frames / 4"))
        .with(Series::line("sun as measured, of the day's largest", line(&|m| m.sun[0] / beam)))
        .with(Series::line("true sun", line(&|m| m.sun[1] / beam)))
        .with(Series::line("frames per series / 4", line(&|m| m.frames as f64 / 4.0)))
        .draw(960, 300);
    let mut both = Canvas::new(960, 660, Rgb888::WHITE);
    both.paste(&above, 0, 0);
    both.paste(&below, 0, 360);
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_day_runs_from_dawn_to_dusk() {
        for (latitude_deg, longitude_deg) in [(48.0, 11.0), (38.0, 23.7), (-33.0, 151.0), (40.0, -120.0)] {
            let place = Place { latitude_deg, longitude_deg };
            let [begin, end] = span(1_790_888_400.0, place).unwrap();
            let altitude = |at| sun_position(at, place).unwrap().altitude_deg;
            assert!((altitude(begin) - ENDS_DEG).abs() < 0.3 && (altitude(end) - ENDS_DEG).abs() < 0.3);
            assert!(altitude(0.5 * (begin + end)) > 35.0 && (end - begin) > 9.0 * 3600.0);
        }
        assert!(span(1_790_888_400.0 + 86_400.0 * 80.0, Place { latitude_deg: 80.0, longitude_deg: 0.0 }).is_none());
    }
}
