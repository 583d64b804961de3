//! Three moments against a path trace of the scene under the unsplit sky.

use std::time::{Duration, Instant};

use relume_bake::environment::{Environment, Reference, reference};

use super::compare::{Blocks, Linear, against_reference};
use super::day::{Day, Moment, TURBIDITY};
use super::site::{SIZE, Site};
use crate::failure::{Failure, OrFail};
use crate::map::luminance;
use crate::relight::Picture;
use crate::skymodel::clear_beam;

/// Hours of the day that are traced: the front in raking light, noon, the flank in raking light.
const HOURS: [f64; 3] = [9.0, 13.0, 17.0];
const SAMPLES: u32 = 64;
/// Rows of the map that stands for the sky; the sun's disc is apart, as a disc.
const MAP_HEIGHT: usize = 256;

/// A traced moment.
pub(super) struct Trace {
    /// Index of the moment.
    pub moment: usize,
    pub picture: Reference,
    pub time: Duration,
    /// Relit with the weights of the true sky: what patches, bake and compression cost.
    pub transport: Blocks,
    /// Relit with the weights that the camera measured: the camera's error as well.
    pub camera: Blocks,
}

/// Traces the moments nearest to [`HOURS`] that have the sun out: most of its light comes through.
pub(super) fn three(site: &Site, day: &mut Day<'_>, hours: &[Moment]) -> Result<Vec<Trace>, Failure> {
    let mut traces: Vec<Trace> = Vec::new();
    for hour in HOURS {
        let sunny = |index: &usize| sun_is_out(&hours[*index]) && traces.iter().all(|trace| trace.moment != *index);
        let distance = |index: &usize| ((hours[*index].hour() - hour).abs() * 3600.0) as i64;
        if let Some(moment) = (0..hours.len()).filter(sunny).min_by_key(distance) {
            traces.push(trace(site, day, &hours[moment], moment)?);
        }
    }
    Ok(traces)
}

fn sun_is_out(moment: &Moment) -> bool {
    let clear = clear_beam(moment.sun.altitude_deg as f32, TURBIDITY);
    moment.truth.sun().is_some_and(|sun| luminance(sun.irradiance) > 0.8 * luminance(clear))
}

fn trace(site: &Site, day: &mut Day<'_>, moment: &Moment, index: usize) -> Result<Trace, Failure> {
    let balance = day.balance();
    let balanced = |rgb: [f32; 3]| std::array::from_fn(|k| rgb[k] * balance[k]);
    let map = moment.truth.map(MAP_HEIGHT);
    let pixels = map.pixels.iter().map(|&rgb| balanced(rgb)).collect();
    let sun = moment.truth.sun().map(|sun| (sun.dir_world, balanced(sun.irradiance)));
    let environment = Environment::new(map.width, map.height, pixels, sun).or_runtime()?;
    let started = Instant::now();
    let half = (SIZE.0 / 2, SIZE.1 / 2);
    let picture = reference(&site.scene, &site.camera, &environment, half, SAMPLES, index as u64 + 1);
    let time = started.elapsed();
    let weights = day.true_weights(&moment.truth);
    let against = |found: &Picture| {
        let found = Linear { width: found.width, rgb: &found.rgb, coverage: &found.alpha };
        let truth = Linear { width: half.0 as usize, rgb: &picture.rgb, coverage: &picture.coverage };
        against_reference(found, truth)
    };
    let transport = against(&day.radiance(&weights)?);
    let camera = against(&day.radiance(&moment.weights)?);
    Ok(Trace { moment: index, picture, time, transport, camera })
}
