//! How much of the sun's beam comes through what is before it, while the disc saturates the camera.
//!
//! A cloud before the sun dims the clear sky around it as it dims the beam, and puts light of its own over it, which has
//! another colour and another shape. So the radiance next to the sun is taken apart, in all channels at once and by least
//! squares that look at the nearest pixels most, into
//!   (share + slopes) * (clear sky of the model + what the lens scatters) + (colour of all light above the clouds) *
//!   (constant + slopes).
//! The share at the sun's centre, over that of the sky at large, is the share of the beam. It is looked for as near to the disc
//! as pixels do not saturate: a ragged cloud lets through another share a degree away. What the lens scatters is learnt while the
//! sun is clear (`aureole.rs`).

use super::aureole::{Aureole, Ring, unevenness};
use crate::linear_system::solve;
use crate::map::luminance;
use crate::skymodel::SkyModel;

/// Radius within which the aureole is looked at, degrees.
pub(super) const AUREOLE_DEG: f64 = 7.0;
/// Width of the Gaussian by which nearer pixels count more, of the distance of the nearest; and what is left out, of the width.
const WIDTH: f32 = 1.08;
const WIDTHS: f32 = 4.0;
const TERMS: usize = 6;
/// Pixels that a fit needs.
const FEWEST: usize = 12;
/// A sky is even when the middle of its patches stands no higher over the clear sky than the lower quarter, as a factor.
const EVEN: f64 = 1.12;
/// The sun is in the clear from the first share on, and from the second where the light around it is no more uneven than this
/// within some degrees: a cloud may be as smooth, but lets less through.
const CLEAR_SHARE: f64 = 0.6;
const VEILED_SHARE: f64 = 0.2;
const SMOOTH: f64 = 0.03;
const SMOOTH_DEG: f32 = 3.0;
/// Glare is known by its being so many times as bright as clear sky and cloud together: the lens makes it then.
const GLARING: f64 = 1.2;
/// Part of the way that the sky's unit goes to a newly seen clear sky's.
const FOLLOW: f64 = 0.1;
/// Least of the model's clear sky that is left of it beside what was learnt.
const LEAST_CLEAR: f64 = 0.3;
/// Shares up to the first are taken as found, from the second on as whole, between them in proportion: clouds beside a sun
/// in the clear disturb its aureole, and a clear sun is seen far more often than one behind a thin even veil.
const CLEAR: [f64; 2] = [0.45, 0.65];

/// One pixel near the sun.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    pub dir: [f32; 3],
    pub omega: f32,
    /// East and north of the sun, degrees.
    pub at_deg: [f32; 2],
    pub value: [f32; 3],
}

impl Near {
    /// Degrees from the sun.
    pub fn apart_deg(&self) -> f32 {
        self.at_deg[0].hypot(self.at_deg[1])
    }
}

/// What the sky would be without clouds.
pub(super) struct ClearSky<'m> {
    pub model: &'m SkyModel,
    /// Irradiance of the beam on a plane normal to it, in the model's unit.
    pub beam: [f32; 3],
    /// Lower quartile and median of measured over modelled patch luminance.
    pub quarters: [f64; 2],
}

/// What was learnt of the sky's unit and of the lens from clear skies.
#[derive(Clone, Debug, Default)]
pub(super) struct Beam {
    /// Measured over modelled radiance of a clear sky.
    unit: Option<f64>,
    aureole: Aureole,
}

impl Beam {
    /// Share of the clear-sky beam, 0..=1, and the unit that a modelled radiance is multiplied by.
    pub(super) fn look(&mut self, near: &[Near], sky: &ClearSky<'_>) -> (f64, f64) {
        let [quarter, middle] = sky.quarters;
        let is_even = middle <= EVEN * quarter;
        if is_even && !self.aureole.is_known() && brightness(near, sky, 1.0) > GLARING * quarter {
            self.aureole.learn(near.iter().map(|pixel| beyond(pixel, sky, quarter)));
        }
        let Some(share) = self.share(near, sky) else { return (1.0, self.unit.unwrap_or(quarter)) };
        let is_clear = share > CLEAR_SHARE * quarter;
        if is_even && is_clear {
            let unit = self.unit.unwrap_or(quarter);
            self.unit = Some(unit + FOLLOW * (quarter - unit));
        }
        let unit = self.unit.unwrap_or(quarter).max(1e-12);
        let may_be_clear = share > VEILED_SHARE * unit || !self.aureole.is_known() && brightness(near, sky, 0.0) > unit;
        if is_even && (is_clear || may_be_clear && unevenness(near, SMOOTH_DEG) < SMOOTH) {
            self.aureole.learn(near.iter().map(|pixel| beyond(pixel, sky, unit)));
        }
        (trusted(share / unit), unit)
    }

    /// Share of the clear sky's light right beside the sun; none where too little is seen.
    fn share(&self, near: &[Near], sky: &ClearSky<'_>) -> Option<f64> {
        let nearest = near.iter().map(Near::apart_deg).min_by(f32::total_cmp)?;
        let width_deg = WIDTH * nearest;
        let white = sky.model.horizontal_irradiance();
        let light = luminance(white).max(1e-12);
        let white = white.map(|v| f64::from(v / light));
        let (mut a, mut b, mut count) = ([[0.0; TERMS]; TERMS], [[0.0; 1]; TERMS], 0);
        for pixel in near.iter().filter(|pixel| pixel.apart_deg() < WIDTHS * width_deg) {
            let clear = self.clear(pixel, sky);
            let [u, v] = pixel.at_deg.map(|deg| f64::from(deg / width_deg));
            let scale = (pixel.value.iter().sum::<f32>() / 3.0).max(1e-12);
            let weight = f64::from(pixel.omega / (scale * scale)) * (-0.5 * (u * u + v * v)).exp();
            for k in 0..3 {
                let row = [clear[k], clear[k] * u, clear[k] * v, white[k], white[k] * u, white[k] * v];
                for i in 0..TERMS {
                    a[i] = std::array::from_fn(|j| a[i][j] + weight * row[i] * row[j]);
                    b[i][0] += weight * row[i] * f64::from(pixel.value[k]);
                }
            }
            count += 1;
        }
        for (i, row) in a.iter_mut().enumerate() {
            row[i] *= 1.0 + 1e-9;
            row[i] += 1e-30;
        }
        let found = if count < FEWEST { f64::NAN } else { solve(a, b)[0][0] };
        found.is_finite().then(|| found.max(0.0))
    }

    /// Light at a pixel when nothing is before the sun, in the model's unit.
    fn clear(&self, pixel: &Near, sky: &ClearSky<'_>) -> [f64; 3] {
        let (model, scattered) = (sky.model.radiance(pixel.dir), self.aureole.at(pixel.apart_deg()));
        std::array::from_fn(|k| {
            let clear = f64::from(model[k]);
            (clear + scattered[k] * f64::from(sky.beam[k])).max(LEAST_CLEAR * clear)
        })
    }
}

/// Light around the sun over that of the model's clear sky and so many clouds.
fn brightness(near: &[Near], sky: &ClearSky<'_>, clouds: f64) -> f64 {
    let cloud = clouds * f64::from(luminance(sky.model.horizontal_irradiance())) / std::f64::consts::PI;
    let (mut found, mut modelled) = (0.0, 0.0);
    for pixel in near.iter().filter(|pixel| pixel.apart_deg() < SMOOTH_DEG) {
        found += f64::from(luminance(pixel.value));
        modelled += f64::from(luminance(sky.model.radiance(pixel.dir))) + cloud;
    }
    found / f64::max(modelled, 1e-12)
}

/// What a pixel shows beyond the model's clear sky, per irradiance of the beam.
fn beyond(pixel: &Near, sky: &ClearSky<'_>, unit: f64) -> Ring {
    let model = sky.model.radiance(pixel.dir);
    let beyond = |k: usize| f64::from(pixel.value[k]) / unit - f64::from(model[k]);
    let value = std::array::from_fn(|k| beyond(k) / f64::from(sky.beam[k]).max(1e-12));
    Ring { apart_deg: pixel.apart_deg(), value }
}

/// The share of the beam that is believed, see [`CLEAR`].
fn trusted(found: f64) -> f64 {
    let [low, high] = CLEAR;
    let t = ((found - low) / (high - low)).min(1.0);
    if found < low { found.max(0.0) } else { low + t * (1.0 - low) }
}
