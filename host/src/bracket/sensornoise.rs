//! A sensor's noise, stated or found from the frames themselves.
//!
//! Two exposures of a series see the same pixels: the difference of their fractions, d = f_short - f_long t_short / t_long, has
//! variance (1 + r) f / N + (1 + r^2) (read / N)^2 besides the width of the codes (r = t_short / t_long, N electrons of a full
//! well). Its spread in bands of f gives both by least squares, whatever the scene and however far off the response curve is:
//! that only shifts a band's middle.

use super::tables::Fact;
use crate::quantile::quantile;

/// Noise of a sensor at gain 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Electrons of a full well.
    pub full_well_electrons: f64,
    /// Read noise, electrons rms.
    pub read_noise_electrons: f64,
}

impl Default for SensorNoise {
    fn default() -> Self {
        SensorNoise { full_well_electrons: 10_000.0, read_noise_electrons: 5.0 }
    }
}

/// Bands of the shorter exposure's fraction, evenly over its logarithm, and their range.
const BANDS: usize = 10;
const LOWEST: f32 = 0.004;
const HIGHEST: f32 = 0.9;
/// Differences a band needs, and those kept per band.
const FEWEST: usize = 60;
const MOST: usize = 4096;
/// What the interdecile range of a normal distribution is, standard deviations.
const INTERDECILE: f64 = 2.563;

/// Gathers differences of neighbouring exposures; its buffers are kept.
#[derive(Clone, Debug, Default)]
pub(super) struct NoiseGauge {
    differences: [Vec<f32>; BANDS],
    /// Mean width (variance) of the codes and mean fraction, sums per band.
    sums: [[f64; 2]; BANDS],
    /// Least squares over all bands seen: sums of a a, a b, b b, a y, b y.
    normal: [f64; 5],
    bands_seen: usize,
}

impl NoiseGauge {
    fn begin(&mut self) {
        self.differences.iter_mut().for_each(Vec::clear);
        self.sums = [[0.0; 2]; BANDS];
    }

    /// Takes a pixel's channel in a shorter and a longer exposure of ratio `r` (short over long).
    pub fn take(&mut self, short: &Fact, long: &Fact, r: f32) {
        if !short.usable() || !long.usable() || !(LOWEST..HIGHEST).contains(&short.fraction) {
            return;
        }
        let place = (short.fraction / LOWEST).ln() / (HIGHEST / LOWEST).ln();
        let band = ((place * BANDS as f32) as usize).min(BANDS - 1);
        if self.differences[band].len() < MOST {
            self.differences[band].push(short.fraction - long.fraction * r);
            self.sums[band][0] += f64::from(short.width + r * r * long.width);
            self.sums[band][1] += f64::from(short.fraction);
        }
    }

    /// Ends the pair of exposures of ratio `r`, both at a gain: its bands become equations.
    pub fn end_pair(&mut self, r: f64, gain: f64) {
        for (values, sums) in self.differences.iter_mut().zip(self.sums) {
            let count = values.len();
            if count < FEWEST {
                continue;
            }
            let mut at = |share: f64| quantile(values, share).unwrap_or(0.0);
            let spread = f64::from(at(0.9) - at(0.1)) / INTERDECILE;
            let (width, fraction) = (sums[0] / count as f64, sums[1] / count as f64);
            // Where the width of the codes is most of it, the noise does not show.
            let variance = spread * spread - width;
            if variance < 0.5 * width {
                continue;
            }
            let (a, b) = (gain * fraction * (1.0 + r), gain * gain * (1.0 + r * r));
            let weight = count as f64 / (spread * spread).powi(2);
            let terms = [a * a, a * b, b * b, a * variance, b * variance];
            self.normal.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
            self.bands_seen += 1;
        }
        self.begin();
    }

    /// The noise that explains all pairs so far; none where too little was seen.
    pub fn noise(&self) -> Option<SensorNoise> {
        if self.bands_seen < 2 {
            return None;
        }
        let [aa, ab, bb, ay, by] = self.normal;
        let determinant = aa * bb - ab * ab;
        let (mut shot, mut read) = ((ay * bb - by * ab) / determinant, (by * aa - ay * ab) / determinant);
        if !(read.is_finite() && read > 0.0) {
            (shot, read) = (ay / aa, 0.0);
        }
        let full_well_electrons = 1.0 / shot;
        if !(full_well_electrons.is_finite() && (50.0..1e7).contains(&full_well_electrons)) {
            return None;
        }
        let read_noise_electrons = (read.sqrt() * full_well_electrons).clamp(0.5, 0.1 * full_well_electrons);
        Some(SensorNoise { full_well_electrons, read_noise_electrons })
    }
}
