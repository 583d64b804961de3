//! What one code is worth: its full-well fraction and variance, and the tables that the merging loop sums.

use super::scales::well_measured;
use super::{MergeSettings, SensorNoise};
use crate::camera::{Codes, Frame};

/// Relative error of the response curve that every sample is taken to have besides its noise.
pub const CURVE_ERROR: f64 = 0.005;

/// A code without its exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fact {
    /// Full-well fraction; below 0 under the black level. NaN where clipped.
    pub fraction: f32,
    /// Variance by the width of the code and the error of the curve.
    pub width: f32,
}

impl Fact {
    /// Whether the code is below the clipping point.
    pub fn usable(&self) -> bool {
        !self.fraction.is_nan()
    }

    /// Variance of the fraction with shot and read noise at a gain.
    pub fn variance(&self, noise: &SensorNoise, gain: f64) -> f32 {
        let electrons = noise.full_well_electrons / gain;
        let shot = (f64::from(self.fraction).max(0.0) / electrons) as f32;
        (shot + ((noise.read_noise_electrons / electrons) as f32).powi(2) + self.width).max(1e-12)
    }
}

/// Facts of every code of a format, per channel.
#[derive(Clone, Debug)]
pub(super) struct Facts {
    pub channels: [Vec<Fact>; 3],
    /// Their fractions where exposures may be judged by them, NaN elsewhere.
    pub judged: [Vec<f32>; 3],
    /// Fraction at which a channel clips.
    pub clip: [f32; 3],
}

impl Facts {
    pub fn new(settings: &MergeSettings, max: u16) -> Self {
        let of = |channel| (0..=max).map(|code| fact(settings, channel, f64::from(code), f64::from(max))).collect();
        let clip = [0, 1, 2].map(|channel| fraction(settings, channel, settings.clip) as f32);
        let channels: [Vec<Fact>; 3] = [0, 1, 2].map(of);
        let judged = channels.each_ref().map(|facts| facts.iter().map(well_measured).collect());
        Facts { channels, judged, clip }
    }
}

/// Fraction above black; below the black level the curve is mirrored, so that noise around black has mean 0.
fn fraction(settings: &MergeSettings, channel: usize, share: f64) -> f64 {
    let black = settings.black.max(settings.response.black());
    let at = |share: f64| settings.response.fraction(share.clamp(0.0, 1.0), channel);
    let dark = at(black);
    let full = (at(1.0) - dark).max(1e-6);
    if share >= black { (at(share) - dark) / full } else { -(at(2.0 * black - share) - dark) / full }
}

fn fact(settings: &MergeSettings, channel: usize, code: f64, max: f64) -> Fact {
    let share = code / max;
    if share >= settings.clip {
        return Fact { fraction: f32::NAN, width: 0.0 };
    }
    let at = |share| fraction(settings, channel, share);
    let fraction = at(share);
    let width = (at(share + 1.0 / max) - at(share - 1.0 / max)) / 2.0;
    let variance = width * width / 12.0 + (CURVE_ERROR * fraction).powi(2);
    Fact { fraction: fraction as f32, width: variance as f32 }
}

/// What the merging loop adds per code: weight x t^2, weight x fraction x t, weight x fraction^2 less the share in the limit
/// of the sum of squares, and a place that fills 16 bytes; all 0 where clipped. Weight = inverse variance of the fraction,
/// t = relative exposure.
pub(super) type Entry = [f32; 4];

/// A frame's tables, kept from series to series while its exposure stays.
#[derive(Clone, Debug)]
pub(super) struct FrameTables {
    made_for: Option<(usize, f64, f64, SensorNoise)>,
    /// 256 or 65,536 entries per channel.
    pub channels: [Vec<Entry>; 3],
}

/// Least sum of squared deviations over their variances that is looked at, and what every sample adds to it.
pub(super) const LIMIT_BASE: f32 = 8.0;
const LIMIT_PER_SAMPLE: f32 = 4.0;

impl FrameTables {
    pub fn empty() -> Self {
        FrameTables { made_for: None, channels: [const { Vec::new() }; 3] }
    }

    /// The three channels' tables, if they have this many entries.
    pub fn entries<const COUNT: usize>(&self) -> Option<[&[Entry; COUNT]; 3]> {
        let [r, g, b] = &self.channels;
        Some([r.first_chunk()?, g.first_chunk()?, b.first_chunk()?])
    }

    /// Makes the tables for a relative exposure `t` at a gain, unless they are made for it already.
    pub fn set(&mut self, facts: &Facts, t: f64, gain: f64, noise: SensorNoise) {
        let wanted = Some((facts.channels[0].len(), t, gain, noise));
        if self.made_for == wanted {
            return;
        }
        self.made_for = wanted;
        for (table, facts) in self.channels.iter_mut().zip(&facts.channels) {
            table.clear();
            table.extend(facts.iter().map(|fact| entry(fact, t as f32, &noise, gain)));
        }
    }
}

fn entry(fact: &Fact, t: f32, noise: &SensorNoise, gain: f64) -> Entry {
    if !fact.usable() {
        return [0.0; 4];
    }
    let weight = 1.0 / fact.variance(noise, gain);
    let weighted = weight * fact.fraction;
    [weight * t * t, weighted * t, weighted * fact.fraction - LIMIT_PER_SAMPLE, 0.0]
}

/// Which of the two formats a frame's codes have: 0 for 8 bits, 1 for 16.
pub(super) fn format_of(frame: &Frame) -> usize {
    usize::from(matches!(frame.codes, Codes::U16(_)))
}

/// The longest exposure: tables hold exposures relative to it, so that f32 sums keep their range.
pub(super) fn longest_s(products_s: &[f64]) -> f64 {
    products_s.iter().copied().fold(0.0, f64::max)
}
