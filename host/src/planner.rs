//! The choice of the next exposure series, so that it follows the light.
//!
//! What a pixel matters for is its radiance times its importance (its solid angle times what the field's picture makes of
//! that part of the sky). From the last series the planner takes the radiance above which one per cent of that lies, and
//! the radiance below which one per cent does. The shortest exposure of the plan puts the upper one at a fraction of full
//! well with room above; the longest puts the lower one well above the noise; between them no step is larger than 3 stops.
//! An even sky needs one or two frames, a clear one with the sun's aureole three. Where something still clips in all that,
//! the camera's shortest exposure is added for the sun.
//!
//! The plan stays while both ends lie within a band around their targets and no frame can be saved for long: no flapping.
//! Exposure times are kept short enough for a series to end in time; beyond that gain is used, and only when there is no
//! more gain are they longer.

use crate::bracket::{Merged, PixelState};
use crate::camera::{CameraLimits, Exposure};
use crate::map::luminance;
use serde::Serialize;

/// Most exposures of a plan.
pub const MOST: usize = 8;
/// Full-well fraction at which the bright end is put, and the band in which it may be.
const BRIGHT_TARGET: f64 = 0.60;
const BRIGHT_BAND: [f64; 2] = [0.35, 0.92];
/// Full-well fraction at which the dark end is put in the longest exposure, and the band in which it may be.
const DARK_TARGET: f64 = 0.15;
const DARK_BAND: [f64; 2] = [0.05, 0.6];
/// Largest step between neighbouring exposures, as a factor (3 stops).
const MAX_STEP: f64 = 8.0;
/// Shares of the picture's light above the bright end and below the dark end.
const TAILS: [f64; 2] = [0.01, 0.01];
/// Series in which a frame could be saved before it is.
const SPARE_PATIENCE: u32 = 20;
/// Sun frames are this much shorter than the next one, at least.
const SUN_STEP: f64 = 2.0;
/// Time that all exposures of a series should take together, seconds.
pub const LATENCY_S: f64 = 0.25;
/// Pixels that are looked at, about.
const SAMPLES: usize = 8192;
/// Bins of the histogram: sixths of an octave from 2^-40.
const BINS: usize = 480;
const BINS_PER_OCTAVE: f32 = 6.0;
const FIRST_OCTAVE: f32 = -40.0;

/// A plan as it is reported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PlanReport {
    /// Exposures of the series.
    pub frames: usize,
    /// Shortest and longest exposure time, seconds.
    pub exposure_s: [f64; 2],
    /// Largest gain.
    pub gain: f64,
    /// All exposure times together, seconds.
    pub light_s: f64,
    /// Times the plan has changed.
    pub changes: u64,
}

/// Chooses the exposures of the next series so that they follow the light.
#[derive(Clone, Debug, PartialEq)]
pub struct Planner {
    limits: CameraLimits,
    most: usize,
    latency_s: f64,
    /// Pixels looked at, with what they matter for; all alike if empty.
    sample: Vec<(u32, f32)>,
    histogram: Vec<f32>,
    plan: Vec<Exposure>,
    /// Exposure x gain of the shortest and the longest frame for the sky, seconds.
    ends_s: [f64; 2],
    has_sun: bool,
    spare: u32,
    changes: u64,
}

/// The light of a picture, by what it matters for.
#[derive(Clone, Copy, Debug)]
struct Light {
    /// Brightest channel at the bright end, luminance at the dark end; 0 in the dark.
    ends: [f64; 2],
    /// Is the bright end itself clipped in every frame?
    is_clipped: bool,
    /// Brightest channel of any pixel, and whether any is clipped in every frame.
    top: f64,
    clips: bool,
}

impl Planner {
    /// A planner for a camera that takes at most `most` (1 to [`MOST`]) exposures per series.
    pub fn new(limits: CameraLimits, most: usize) -> Self {
        let anchor_s = (limits.min_exposure_s * limits.max_exposure_s).sqrt();
        let mut planner = Planner {
            limits,
            most: most.clamp(1, MOST),
            latency_s: LATENCY_S,
            sample: Vec::new(),
            histogram: vec![0.0; BINS],
            plan: Vec::with_capacity(MOST + 1),
            ends_s: [anchor_s / MAX_STEP, anchor_s * MAX_STEP],
            has_sun: most >= 3,
            spare: 0,
            changes: 0,
        };
        planner.lay_out();
        planner
    }

    /// Sets what each pixel of the picture matters for (0: not looked at).
    pub fn set_importance(&mut self, per_pixel: &[f32]) {
        let count = per_pixel.iter().filter(|&&value| value > 0.0).count();
        let step = (count / SAMPLES).max(1);
        let counted = per_pixel.iter().enumerate().filter(|(_, value)| **value > 0.0);
        self.sample = counted.step_by(step).map(|(pixel, &value)| (pixel as u32, value)).collect();
    }

    /// Sets the time that all exposures of a series should take together, seconds.
    pub fn set_latency_s(&mut self, latency_s: f64) {
        self.latency_s = latency_s;
        self.lay_out();
    }

    /// The next series, rising, as the camera can take it.
    pub fn exposures(&self) -> &[Exposure] {
        &self.plan
    }

    /// The exposure whose frame shows most of what matters, for a single look.
    pub fn watch(&self) -> Exposure {
        let at = usize::from(self.has_sun && self.plan.len() > 1);
        self.plan.get(at).copied().unwrap_or(Exposure { exposure_s: self.limits.min_exposure_s, gain: 1.0 })
    }

    /// What is planned.
    pub fn report(&self) -> PlanReport {
        let times = self.plan.iter().map(|e| e.exposure_s);
        let ends = times.clone().fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], t| [low.min(t), high.max(t)]);
        PlanReport {
            frames: self.plan.len(),
            exposure_s: ends,
            gain: self.plan.iter().map(|e| e.gain).fold(1.0, f64::max),
            light_s: times.sum(),
            changes: self.changes,
        }
    }

    /// Takes in what the last series showed; true if the plan changed.
    pub fn follow(&mut self, merged: &Merged) -> bool {
        let Some(light) = self.look(merged) else { return false };
        let wanted = self.wanted_ends(&light);
        let has_sun = self.needs_sun(&light, wanted[0]);
        let frames = self.frames(wanted) + usize::from(has_sun);
        let is_spare = frames < self.plan.len();
        self.spare = if is_spare { self.spare + 1 } else { 0 };
        let fits = self.fits(&light) && (has_sun == self.has_sun || (self.has_sun && self.spare < SPARE_PATIENCE));
        if fits && self.spare < SPARE_PATIENCE {
            return false;
        }
        (self.ends_s, self.has_sun, self.spare) = (wanted, has_sun, 0);
        self.lay_out()
    }

    /// Bright and dark end by a histogram of the light; none without pixels.
    fn look(&mut self, merged: &Merged) -> Option<Light> {
        let count = merged.radiance.len();
        if count == 0 {
            return None;
        }
        self.histogram.fill(0.0);
        // What the shortest exposure cannot show is no reason to choose another.
        let is_shortest = self.plan.first().is_some_and(|e| e.product_s() < SUN_STEP * self.limits.min_exposure_s);
        let (mut total, mut top, mut clipped) = (0.0f64, 0.0f32, 0.0f64);
        let mut see = |pixel: usize, importance: f32| {
            let value = merged.radiance[pixel];
            let brightest = value.into_iter().fold(0.0, f32::max);
            top = top.max(brightest);
            let is_clipped = merged.state[pixel] == PixelState::Clipped;
            if is_clipped && is_shortest {
                return;
            }
            let light = luminance(value).max(0.0) * importance;
            let octave = if brightest > 0.0 { brightest.log2() - FIRST_OCTAVE } else { 0.0 };
            let bin = (octave * BINS_PER_OCTAVE).clamp(0.0, (BINS - 1) as f32) as usize;
            self.histogram[bin] += light;
            total += f64::from(light);
            clipped += f64::from(light) * f64::from(u8::from(is_clipped));
        };
        if self.sample.is_empty() {
            (0..count).step_by((count / SAMPLES).max(1)).for_each(|pixel| see(pixel, 1.0));
        } else {
            self.sample.iter().filter(|(pixel, _)| (*pixel as usize) < count).for_each(|&(p, i)| see(p as usize, i));
        }
        let [above, below] = TAILS.map(|share| share * total);
        let bright = self.bin_at(above, (0..BINS).rev());
        let dark = self.bin_at(below, 0..BINS);
        let at = |bin: usize| f64::from((FIRST_OCTAVE + (bin as f32 + 0.5) / BINS_PER_OCTAVE).exp2());
        let ends = if total > 0.0 { [at(bright), at(dark)] } else { [0.0; 2] };
        let clips = merged.state.contains(&PixelState::Clipped);
        Some(Light { ends, is_clipped: clipped > above && total > 0.0, top: top.into(), clips })
    }

    /// The bin at which the sum over bins, taken in this order, first exceeds `share`.
    fn bin_at(&self, share: f64, mut bins: impl Iterator<Item = usize>) -> usize {
        let mut sum = 0.0;
        let is_there = |&bin: &usize| {
            sum += f64::from(self.histogram[bin]);
            sum > share
        };
        bins.find(is_there).unwrap_or(0)
    }

    /// Exposure x gain for both ends. What is clipped or black throughout is looked for 3 stops on.
    fn wanted_ends(&self, light: &Light) -> [f64; 2] {
        let longest = self.limits.max_exposure_s * self.limits.max_gain;
        let [bright, dark] = light.ends;
        let first = if bright <= 0.0 {
            self.ends_s[0] * MAX_STEP
        } else if light.is_clipped && self.ends_s[0] > self.limits.min_exposure_s {
            (BRIGHT_TARGET / bright).min(self.ends_s[0] / MAX_STEP)
        } else {
            BRIGHT_TARGET / bright
        };
        let first = first.clamp(self.limits.min_exposure_s, longest);
        let last = if dark <= 0.0 { first * MAX_STEP } else { DARK_TARGET / dark };
        [first, last.clamp(first, longest)]
    }

    /// Frames for the sky between two ends.
    fn frames(&self, [first, last]: [f64; 2]) -> usize {
        let steps = ((last / first).ln() / MAX_STEP.ln() - 0.05).ceil().max(0.0) as usize;
        (steps + 1).min(self.most)
    }

    /// Does something clip in the shortest frame for the sky that a shorter one may show?
    fn needs_sun(&self, light: &Light, first: f64) -> bool {
        self.most >= 3 && (light.clips || light.top * first > 1.2) && self.limits.min_exposure_s * SUN_STEP <= first
    }

    /// Do both ends still lie in their bands, as far as the camera's limits let them?
    fn fits(&self, light: &Light) -> bool {
        let [bright, dark] = light.ends;
        let [first, last] = self.ends_s;
        let longest = self.limits.max_exposure_s * self.limits.max_gain;
        let [low, high] = BRIGHT_BAND;
        let is_bright = (bright * first <= high || first <= self.limits.min_exposure_s)
            && (bright * first >= low || first >= longest)
            && !(light.is_clipped && first > self.limits.min_exposure_s);
        let [low, high] = DARK_BAND;
        let reach = (first * MAX_STEP.powi(self.room() as i32 - 1)).min(longest);
        let is_dark = (dark * last <= high || last <= first) && (dark * last >= low || last >= 0.99 * reach);
        is_bright && is_dark
    }

    /// Frames that the sky may have.
    fn room(&self) -> usize {
        self.most - usize::from(self.has_sun)
    }

    /// Spreads the frames between the ends; true if the exposures are others than before.
    fn lay_out(&mut self) -> bool {
        let mut new = [Exposure { exposure_s: 0.0, gain: 1.0 }; MOST + 1];
        let mut count = 0;
        let mut add = |exposure: Exposure| {
            if !new[..count].iter().any(|known| known.same_as(&exposure)) {
                new[count] = exposure;
                count += 1;
            }
        };
        if self.has_sun {
            add(self.limits.nearest(Exposure { exposure_s: self.limits.min_exposure_s, gain: 1.0 }));
        }
        let frames = self.frames(self.ends_s).min(self.room());
        let [first, last] = self.ends_s;
        let step = (last / first).powf(1.0 / (frames.max(2) - 1) as f64).min(MAX_STEP);
        self.ends_s[1] = first * step.powi(frames as i32 - 1);
        let products = (0..frames).map(|frame| first * step.powi(frame as i32));
        // The frames that need much light share the time; the steps down from them add up to a seventh of it.
        let time_s = 0.85 * self.latency_s;
        let long = products.clone().filter(|product| *product > time_s / frames as f64).count();
        for product in products {
            add(self.split(product, time_s / long.max(1) as f64));
        }
        let changed = new[..count] != self.plan[..];
        self.plan.clear();
        self.plan.extend_from_slice(&new[..count]);
        self.changes += u64::from(changed);
        changed
    }

    /// Time up to what a frame may take, then gain, then more time.
    fn split(&self, product_s: f64, time_s: f64) -> Exposure {
        let in_time = time_s.clamp(self.limits.min_exposure_s, self.limits.max_exposure_s);
        let gain = (product_s / in_time).clamp(1.0, self.limits.max_gain);
        self.limits.nearest(Exposure { exposure_s: product_s / gain, gain })
    }
}

#[cfg(test)]
mod tests;
