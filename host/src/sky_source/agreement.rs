//! Whether a sky camera's exposures agree with each other, and its sun with the ephemeris, over many series.
//!
//! Of one light every exposure must give one radiance, and the sun stands where time and place say. Clouds, birds and noise move
//! single series either way; a response curve or a lens that is not the camera's moves all of them alike. What is looked at is
//! therefore the median over the newest series of [`MergeReport::slope`](crate::bracket::MergeReport::slope) and
//! [`Capture::sun_astray_deg`](crate::capture::Capture::sun_astray_deg).

use crate::quantile::median;

/// Series that are looked back on.
const LATEST: usize = 32;
/// The fewest series that tell.
const FEWEST: usize = 8;
/// Every how many series the sun's place is looked at: each look goes through the whole picture.
pub const ASTRAY_EVERY: u64 = 4;
/// Slope that is told: that of a curve whose exponent is 4 % off. Frames 3 stops apart then differ by 9 %. Simulated cameras whose
/// curve is known stay below a tenth of it under noise, clouds and birds, by day and at dusk.
const TOLD: f64 = 0.04;

/// The sun's distance from its place that is told, degrees: beyond its own spot it counts as covered.
const ASTRAY_DEG: f64 = 2.0;

/// A figure of the newest series.
#[derive(Clone, Debug, Default)]
pub struct Usual {
    values: [f64; LATEST],
    scratch: [f64; LATEST],
    count: usize,
}

impl Usual {
    /// Takes in a series' value, if it has one.
    pub fn add(&mut self, value: Option<f64>) {
        if let Some(value) = value.filter(|value| value.is_finite()) {
            self.values[self.count % LATEST] = value;
            self.count += 1;
        }
    }

    /// Median of the newest series; none of too few.
    pub fn median(&mut self) -> Option<f64> {
        let known = self.count.min(LATEST);
        self.scratch[..known].copy_from_slice(&self.values[..known]);
        (known >= FEWEST).then(|| median(&mut self.scratch[..known])).flatten()
    }
}

/// What a median slope means, where it is worth a word; `has_curve`: whether the post's file names a response.
pub fn disagreement(slope: Option<f64>, has_curve: bool) -> Option<String> {
    let slope = slope.filter(|slope| slope.abs() > TOLD)?;
    let percent = 100.0 * (slope * std::f64::consts::LN_2).exp_m1();
    let curve = if has_curve { "camera.response is not this camera's" } else { "camera.response is missing" };
    Some(format!(
        "the sky camera's exposures disagree by {percent:+.0} % per stop: {curve}, or it does not take the exposures that it \
         tells; find the curve by `relume sky capture --series 14` and `relume sky response`"
    ))
}

/// What the sun's usual distance from its place means, where it is worth a word.
pub fn sun_astray(astray_deg: Option<f64>) -> Option<String> {
    let astray_deg = astray_deg.filter(|&angle_deg| angle_deg > ASTRAY_DEG)?;
    Some(format!(
        "the sun stands {astray_deg:.0} degrees from where camera.lens, time and place put it: if these and the clock are right, \
         the lens file is not this camera's or the camera was turned; find it by `relume sky capture --sun` and `relume sky lens`"
    ))
}

#[cfg(test)]
mod tests;
