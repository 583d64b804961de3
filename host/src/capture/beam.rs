//! How much of the sun's beam comes through what is before it, while the disc saturates the camera.
//!
//! The clear sky shines brightest around the sun. A cloud before both dims that aureole as it dims the beam, and puts light
//! of its own over it, which has another colour and changes less over a few degrees. So the radiance within some degrees
//! of the sun is taken apart, in all channels at once and by least squares that look at the nearest most, into
//!   share * (clear sky of the model) + (colour of all light above the clouds) * (constant + slopes + bulge).
//! The clear sky's share there, over its share in the sky at large, is the share of the beam. What a lens scatters around
//! the sun makes the aureole brighter by a factor; the largest share seen is taken as that of a clear sun, and forgotten
//! slowly.

use crate::linear_system::solve;
use crate::map::luminance;
use crate::skymodel::SkyModel;

/// Radius within which the aureole is looked at, degrees.
pub(super) const AUREOLE_DEG: f64 = 7.0;
/// Width of the Gaussian by which nearer pixels count more, degrees.
const WIDTH_DEG: f32 = 3.0;
const TERMS: usize = 5;
/// A sky is even when the middle of its patches stands no higher over the clear sky than the lower quarter, as a factor.
const EVEN: f64 = 1.12;
/// Part of the way that the sky's unit goes to a newly seen clear sky's.
const FOLLOW: f64 = 0.1;
/// How much of the largest share is forgotten with each look.
const FORGET: f64 = 2e-5;
/// Shares up to the first are taken as found, from the second on as whole, between them in proportion: clouds beside a sun
/// in the clear disturb its aureole, and a clear sun is seen far more often than one behind a thin even veil.
const CLEAR: [f64; 2] = [0.45, 0.65];

/// One pixel near the sun.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    pub dir: [f32; 3],
    pub omega: f32,
    pub value: [f32; 3],
}

/// What was learnt of the sky's unit and of the lens from clear skies.
#[derive(Clone, Debug, Default)]
pub(super) struct Beam {
    /// Measured over modelled radiance of a clear sky.
    unit: Option<f64>,
    /// Largest share of the aureole, over the unit.
    clear_share: f64,
}

impl Beam {
    /// Share of the clear-sky beam, 0..=1, and the unit that a modelled radiance is multiplied by. `quarters`: lower
    /// quartile and median of measured over modelled patch luminance.
    pub(super) fn look(&mut self, near: &[Near], model: &SkyModel, quarters: [f64; 2]) -> (f64, f64) {
        let Some(share) = share(near, model) else { return (1.0, quarters[0]) };
        let is_clear = quarters[1] <= EVEN * quarters[0] && share > 0.6 * quarters[0];
        if is_clear {
            let unit = self.unit.unwrap_or(quarters[0]);
            self.unit = Some(unit + FOLLOW * (quarters[0] - unit));
        }
        let unit = self.unit.unwrap_or(quarters[0]);
        let through = share / unit.max(1e-12);
        self.clear_share = (self.clear_share * (1.0 - FORGET)).max(1.0);
        if is_clear {
            self.clear_share = self.clear_share.max(through);
        }
        (trusted(through / self.clear_share), unit)
    }
}

/// The share of the beam that is believed, see [`CLEAR`].
fn trusted(found: f64) -> f64 {
    let [low, high] = CLEAR;
    let t = ((found - low) / (high - low)).min(1.0);
    if found < low { found.max(0.0) } else { low + t * (1.0 - low) }
}

/// Share of the model's clear sky in the radiance around the sun; none where too little is seen.
fn share(near: &[Near], model: &SkyModel) -> Option<f64> {
    let white = model.horizontal_irradiance();
    let light = luminance(white).max(1e-12);
    let white = white.map(|v| f64::from(v / light));
    let axis = model.sun_dir();
    // East and north of the sun.
    let side = [-axis[2], 0.0, axis[0]];
    let level = side[0].hypot(side[2]).max(1e-6);
    let side = side.map(|c| c / level);
    let up = [axis[1] * side[2], axis[2] * side[0] - axis[0] * side[2], -axis[1] * side[0]];
    let along = |d: [f32; 3], e: [f32; 3]| (0..3).map(|k| d[k] * e[k]).sum::<f32>().to_degrees() / WIDTH_DEG;
    let (mut a, mut b) = ([[0.0; TERMS]; TERMS], [[0.0; 1]; TERMS]);
    for pixel in near {
        let clear = model.radiance(pixel.dir).map(f64::from);
        let [u, v] = [side, up].map(|e| along(pixel.dir, e));
        let bell = (-0.5 * (u * u + v * v)).exp();
        let scale = clear.iter().sum::<f64>() / 3.0;
        let weight = f64::from(bell * pixel.omega) / (scale * scale).max(1e-24);
        let shape = [1.0, u, v, u * u + v * v].map(f64::from);
        for k in 0..3 {
            let row = [clear[k], white[k] * shape[0], white[k] * shape[1], white[k] * shape[2], white[k] * shape[3]];
            for i in 0..TERMS {
                a[i] = std::array::from_fn(|j| a[i][j] + weight * row[i] * row[j]);
                b[i][0] += weight * row[i] * f64::from(pixel.value[k]);
            }
        }
    }
    if near.len() < 8 * TERMS {
        return None;
    }
    for (i, row) in a.iter_mut().enumerate() {
        row[i] *= 1.0 + 1e-9;
        row[i] += 1e-30;
    }
    let found = solve(a, b)[0][0];
    found.is_finite().then(|| found.max(0.0))
}
