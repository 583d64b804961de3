//! The choice of the next exposure series, so that it follows the light.

use crate::bracket::{Merged, PixelState};
use crate::camera::{CameraLimits, Exposure};
use crate::map::luminance;

/// Chooses the exposures of the next series so that they follow the light.
#[derive(Clone, Debug, PartialEq)]
pub struct Planner {
    limits: CameraLimits,
    frames: usize,
    /// Exposure x gain that puts the sky's bright end at the target, seconds.
    anchor_s: f64,
}

/// Full-well fraction at which the sky's bright end is put in the shortest sky exposure.
const BRIGHT_TARGET: f64 = 0.6;
/// Largest step between neighbouring exposures, as a factor (3 stops).
const MAX_STEP: f64 = 8.0;
/// The anchor stays while the wanted one lies within this factor: no flapping.
const HYSTERESIS: f64 = 1.25;

impl Planner {
    /// A planner for a camera that takes `frames` (at least 1) exposures per series.
    pub fn new(limits: CameraLimits, frames: usize) -> Self {
        let anchor_s = (limits.min_exposure_s * limits.max_exposure_s).sqrt();
        Planner { limits, frames: frames.max(1), anchor_s }
    }

    /// The next series: the camera's shortest exposure for the sun if there are three frames or more, then from the
    /// anchor upward by 3 stops, then a stop apart down from there, all within the camera's limits, rising.
    pub fn exposures(&self) -> Vec<Exposure> {
        let mut products: Vec<f64> = Vec::new();
        if self.frames >= 3 {
            products.push(self.limits.min_exposure_s);
        }
        let steps = [0.0, 1.0, -1.0 / 3.0, 2.0, -1.0, 1.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0];
        for step in steps.iter().cycle().take(steps.len()) {
            products.push(self.anchor_s * MAX_STEP.powf(*step));
        }
        let mut series: Vec<Exposure> = Vec::new();
        for product in products {
            let exposure = self.split(product);
            if series.len() < self.frames && !series.iter().any(|known| known.same_as(&exposure)) {
                series.push(exposure);
            }
        }
        series.sort_by(|a, b| a.product_s().total_cmp(&b.product_s()));
        series
    }

    /// Time first, gain only when the longest time is not enough.
    fn split(&self, product_s: f64) -> Exposure {
        let gain = (product_s / self.limits.max_exposure_s).clamp(1.0, self.limits.max_gain);
        self.limits.nearest(Exposure { exposure_s: product_s / gain, gain })
    }

    /// Takes in what the last series showed. The bright end is the 98th percentile of luminance; when that was clipped in
    /// every frame the exposures drop by 3 stops, when all is black they rise by as much.
    pub fn follow(&mut self, merged: &Merged) {
        let count = merged.radiance.len();
        if count == 0 {
            return;
        }
        let stride = (count / 8192).max(1);
        let mut values: Vec<(f32, bool)> = (0..count)
            .step_by(stride)
            .map(|i| (luminance(merged.radiance[i]), merged.state[i] == PixelState::Clipped))
            .collect();
        let at = (values.len() * 98 / 100).min(values.len() - 1);
        values.select_nth_unstable_by(at, |a, b| a.0.total_cmp(&b.0));
        let (bright, clipped) = values[at];
        let wanted = if clipped {
            self.anchor_s / MAX_STEP
        } else if bright <= 0.0 {
            self.anchor_s * MAX_STEP
        } else {
            (BRIGHT_TARGET / f64::from(bright)).clamp(self.anchor_s / 64.0, self.anchor_s * 64.0)
        };
        let change = wanted / self.anchor_s;
        if !(1.0 / HYSTERESIS..=HYSTERESIS).contains(&change) {
            self.anchor_s = wanted.clamp(self.limits.min_exposure_s, self.limits.max_exposure_s * self.limits.max_gain);
        }
    }
}

#[cfg(test)]
mod tests;
