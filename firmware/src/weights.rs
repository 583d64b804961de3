//! Fixed-point weights: the sky's radiance per patch and the sun's irradiance at one moment, times the exposure.
//!
//! `radiance * exposure = value_q * 2^exponent` with |value_q| <= 32767 and, per channel, `sum |value_q| <= 2^24`.
//! With |V| <= 127 a projection therefore stays within 127 * 2^24 < 2^31 in an i32 lane, whatever the order of adding. A
//! [`WeightStep`] has signs and the same bound, and the sums it is added to are again those of weights: they stay within
//! it after any number of steps. A coefficient is one of those sums times a 16-bit scale, below 2^47 in an i64, brought to
//! 15 bits; with |U| <= 127 and at most 128 ranks a pixel's sum stays within 128 * 127 * 32767 < 2^29.

mod standouts;
mod step;

use crate::patches::MAX_PATCHES;
use crate::tile::{LANE_PAD, padded};
pub use standouts::{EXCESS_TIMES_MEAN, MAX_STANDOUTS, MOST_STANDOUTS, standouts};
pub use step::WeightStep;

/// Most patches, padded.
pub const MAX_PADDED: usize = padded(MAX_PATCHES);
/// Largest sum of |value_q| of one channel.
pub const MAX_SUM: i64 = 1 << 24;
const BLOCKS: usize = MAX_PADDED / LANE_PAD;

/// Why weights were refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WeightError {
    /// Not as many radiances as the field has patches.
    Count {
        /// Given.
        found: usize,
        /// The field's.
        expected: usize,
    },
    /// A radiance that is NaN, infinite or negative.
    Radiance {
        /// Patch.
        patch: usize,
        /// Value.
        value: f32,
    },
    /// An irradiance of the sun that is NaN, infinite or negative, or a direction that is not a unit vector.
    Sun,
    /// An exposure that is NaN, infinite or not positive.
    Exposure(f32),
}

impl core::fmt::Display for WeightError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            WeightError::Count { found, expected } => {
                write!(f, "{found} weights, but the field has {expected} patches; make the weights for this field")
            }
            WeightError::Radiance { patch, value } => {
                write!(f, "patch {patch} has radiance {value}; it must be finite and not negative")
            }
            WeightError::Sun => write!(f, "the sun needs a unit direction and finite irradiance that is not negative"),
            WeightError::Exposure(value) => write!(f, "exposure {value}; it must be finite and positive"),
        }
    }
}

impl core::error::Error for WeightError {}

/// The sun at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunWeight {
    /// Unit direction towards the disc's centre.
    pub dir_world: [f32; 3],
    /// RGB irradiance on a plane normal to the direction.
    pub irradiance: [f32; 3],
}

/// Weights in the form the kernels take.
#[derive(Clone, Debug)]
pub struct FixedWeights {
    value_q: [[i16; MAX_PADDED]; 3],
    exponent: [i32; 3],
    patches: usize,
    /// Blocks of [`LANE_PAD`] patches in which any channel is lit; the others cost nothing.
    lit: [u8; BLOCKS],
    lit_blocks: usize,
    dark_patches: usize,
    sun_q16: [u32; 3],
    /// Patches whose light is not all in `value_q`, and how much of it, in radiance times exposure, is not.
    apart: [u16; MAX_PATCHES],
    apart_light: [[f32; 3]; MAX_PATCHES],
    apart_count: usize,
}

/// Light of a patch that is shown by the patch's own rows (wayback.rs) instead of through the factors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Apart {
    /// Patch.
    pub patch: u16,
    /// RGB: radiance where it is given, radiance times exposure in [`FixedWeights`].
    pub light: [f32; 3],
}

/// What part of a light is shown by the patches' own rows.
#[derive(Clone, Copy, Debug)]
pub enum LightApart<'a> {
    /// Some light of some patches.
    Some(&'a [Apart]),
    /// All light of all patches.
    All,
}

impl LightApart<'_> {
    /// Nothing.
    pub const NONE: LightApart<'static> = LightApart::Some(&[]);
}

/// Exponents are kept in this range so that shifts stay small.
const EXPONENT_LIMIT: i32 = 110;
/// Largest radiance times exposure, 2^120; more counts as this. Counts of it fit the largest exponent: 2^120 / 32767 and
/// the sum over all patches over 2^24 are below 2^107.
const MAX_LIGHT: f64 = (1u128 << 120) as f64;

impl FixedWeights {
    /// No light at all, for a field of `patches` patches.
    pub const fn dark(patches: usize) -> Self {
        FixedWeights {
            value_q: [[0; MAX_PADDED]; 3],
            exponent: [0; 3],
            patches,
            lit: [0; BLOCKS],
            lit_blocks: 0,
            dark_patches: patches,
            sun_q16: [0; 3],
            apart: [0; MAX_PATCHES],
            apart_light: [[0.0; 3]; MAX_PATCHES],
            apart_count: 0,
        }
    }

    /// Quantises `radiance_linear` (RGB per patch, in the field's order) and the sun, both times `exposure`. The radiance
    /// `apart` is taken out and kept in [`FixedWeights::apart`]; it names patches of the field, each once.
    ///
    /// # Errors
    /// [`WeightError`] for a wrong count, or a NaN, infinite or negative number; `self` is then as before.
    pub fn set(
        &mut self,
        radiance_linear: &[[f32; 3]],
        sun: Option<&SunWeight>,
        exposure: f32,
        apart: LightApart<'_>,
    ) -> Result<(), WeightError> {
        self.check(radiance_linear, sun, exposure)?;
        self.set_apart(radiance_linear, exposure, apart);
        for channel in 0..3 {
            self.set_channel(channel, radiance_linear, exposure, apart);
        }
        self.find_lit();
        self.sun_q16 = sun.map_or([0; 3], |sun| sun.irradiance.map(|e| sun_q16(e * exposure)));
        Ok(())
    }

    fn check(&self, radiance: &[[f32; 3]], sun: Option<&SunWeight>, exposure: f32) -> Result<(), WeightError> {
        if radiance.len() != self.patches || self.patches > MAX_PATCHES {
            return Err(WeightError::Count { found: radiance.len(), expected: self.patches });
        }
        if !(exposure.is_finite() && exposure > 0.0) {
            return Err(WeightError::Exposure(exposure));
        }
        let good = |value: f32| value.is_finite() && value >= 0.0;
        for (patch, rgb) in radiance.iter().enumerate() {
            if let Some(&value) = rgb.iter().find(|&&value| !good(value)) {
                return Err(WeightError::Radiance { patch, value });
            }
        }
        if let Some(sun) = sun {
            let length_sq: f32 = sun.dir_world.iter().map(|c| c * c).sum();
            let unit = (length_sq - 1.0).abs() < 1e-3;
            if !(unit && sun.irradiance.iter().all(|&e| good(e))) {
                return Err(WeightError::Sun);
            }
        }
        Ok(())
    }

    fn set_apart(&mut self, radiance: &[[f32; 3]], exposure: f32, apart: LightApart<'_>) {
        self.apart_count = 0;
        let mut add = |patch: u16, light: [f32; 3]| {
            self.apart[self.apart_count] = patch;
            self.apart_light[self.apart_count] = light.map(|value| (value * exposure).min(MAX_LIGHT as f32));
            self.apart_count += 1;
        };
        match apart {
            LightApart::Some(some) => some.iter().take(MAX_PATCHES).for_each(|one| add(one.patch, one.light)),
            LightApart::All => {
                let lit = radiance.iter().enumerate().filter(|(_, light)| light.iter().any(|&v| v > 0.0));
                lit.for_each(|(patch, light)| add(patch as u16, *light));
            }
        }
    }

    fn set_channel(&mut self, channel: usize, radiance: &[[f32; 3]], exposure: f32, apart: LightApart<'_>) {
        let (wide, mut largest, mut sum) = (f64::from(exposure), 0f64, 0f64);
        let mut values = [0f64; MAX_PADDED];
        values.iter_mut().zip(radiance).for_each(|(value, rgb)| *value = rgb[channel].into());
        match apart {
            LightApart::Some(some) => some.iter().take(MAX_PATCHES).for_each(|one| {
                let value = &mut values[usize::from(one.patch)];
                *value = (*value - f64::from(one.light[channel])).max(0.0);
            }),
            LightApart::All => values.fill(0.0),
        }
        let values = &values[..radiance.len()];
        for &value in values {
            let value = (value * wide).min(MAX_LIGHT);
            largest = largest.max(value);
            sum += value;
        }
        // The smallest power of two that keeps both the largest value and the sum in range; rounding adds at most
        // half a count per patch to the sum.
        let room = (MAX_SUM - MAX_PATCHES as i64) as f64;
        let unit = (largest / 32767.0).max(sum / room);
        let least = exponent_above(unit).clamp(-EXPONENT_LIMIT, EXPONENT_LIMIT);
        // One step of slack: light that flickers around a power of two keeps its scale, and projections stay additive.
        let exponent = if self.exponent[channel] == least + 1 { least + 1 } else { least };
        let (scale, top) = (libm::scalbn(wide, -exponent), libm::scalbn(MAX_LIGHT, -exponent).min(32767.0));
        for (q, &value) in self.value_q[channel].iter_mut().zip(values) {
            *q = libm::rint((value * scale).min(top)) as i16;
        }
        self.exponent[channel] = exponent;
    }

    fn find_lit(&mut self) {
        let lit_at = |w: &Self, patch: usize| w.value_q.iter().any(|channel| channel[patch] != 0);
        self.lit_blocks = 0;
        for block in 0..padded(self.patches) / LANE_PAD {
            if (block * LANE_PAD..(block + 1) * LANE_PAD).any(|patch| lit_at(self, patch)) {
                self.lit[self.lit_blocks] = block as u8;
                self.lit_blocks += 1;
            }
        }
        self.dark_patches = (0..self.patches).filter(|&patch| !lit_at(self, patch)).count();
    }

    /// The light that was taken out of the values.
    pub fn apart(&self) -> impl Iterator<Item = Apart> + '_ {
        let known = self.apart[..self.apart_count].iter().zip(&self.apart_light);
        known.map(|(&patch, &light)| Apart { patch, light })
    }

    /// Values of a channel, padded with zeros to a multiple of [`LANE_PAD`].
    pub fn value_q(&self, channel: usize) -> &[i16] {
        &self.value_q[channel][..padded(self.patches)]
    }

    /// Values and lit blocks of a channel, as a projection takes them.
    pub fn values(&self, channel: usize) -> Values<'_> {
        Values { value_q: self.value_q(channel), lit_blocks: self.lit_blocks() }
    }

    /// Power of two of one count, per channel.
    pub fn exponent(&self) -> [i32; 3] {
        self.exponent
    }

    /// Blocks of [`LANE_PAD`] patches with any light, ascending.
    pub fn lit_blocks(&self) -> &[u8] {
        &self.lit[..self.lit_blocks]
    }

    /// Patches whose weight is zero in all channels.
    pub fn dark_patches(&self) -> usize {
        self.dark_patches
    }

    /// Patches of the field these weights are for.
    pub fn patches(&self) -> usize {
        self.patches
    }

    /// The sun's irradiance times exposure in 1/65536, at most [`MAX_SUN_Q16`].
    pub fn sun_q16(&self) -> [u32; 3] {
        self.sun_q16
    }
}

/// Values of one channel and the blocks of [`LANE_PAD`] patches in which any channel is not 0.
#[derive(Clone, Copy, Debug)]
pub struct Values<'a> {
    /// Padded with zeros to a multiple of [`LANE_PAD`].
    pub value_q: &'a [i16],
    /// Ascending.
    pub lit_blocks: &'a [u8],
}

/// Largest weight of the sun: 512 times the irradiance that shows as display white on a response of 1.
pub const MAX_SUN_Q16: u32 = (1 << 25) - 1;

fn sun_q16(irradiance: f32) -> u32 {
    libm::rint(f64::from(irradiance) * 65536.0).min(f64::from(MAX_SUN_Q16)) as u32
}

/// The smallest exponent with `2^exponent >= value`; a very small one for 0.
fn exponent_above(value: f64) -> i32 {
    if value <= 0.0 {
        return -EXPONENT_LIMIT;
    }
    let (mantissa, exponent) = libm::frexp(value);
    if mantissa == 0.5 { exponent - 1 } else { exponent }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec;

    #[test]
    fn values_times_their_unit_are_the_radiances() {
        let mut weights = FixedWeights::dark(272);
        for scale in [1e-12f32, 1e-3, 1.0, 7.3e4, 1e12] {
            let sky: vec::Vec<[f32; 3]> =
                (0..272).map(|i| [scale * (i as f32 + 1.0), scale, scale * 0.5 / (i as f32 + 1.0)]).collect();
            weights.set(&sky, None, 0.25, LightApart::NONE).unwrap();
            for c in 0..3 {
                let unit = 2f64.powi(weights.exponent()[c]);
                let largest = sky.iter().map(|rgb| f64::from(rgb[c])).fold(0.0, f64::max) * 0.25;
                for (q, rgb) in weights.value_q(c).iter().zip(&sky) {
                    let error = (f64::from(*q) * unit - f64::from(rgb[c]) * 0.25).abs();
                    assert!(error <= 0.5 * unit * 1.0001 && unit <= largest / 16000.0, "{scale} {c} {error}");
                }
            }
        }
    }

    #[test]
    fn the_sum_stays_in_its_bound_at_the_most_patches() {
        let mut weights = FixedWeights::dark(MAX_PATCHES);
        weights.set(&vec![[3.0e7; 3]; MAX_PATCHES], None, 1.0, LightApart::NONE).unwrap();
        let sum: i64 = weights.value_q(0).iter().map(|&q| i64::from(q)).sum();
        assert!(sum <= MAX_SUM && sum > MAX_SUM / 4);
    }

    /// The largest floats there are: no count may leave 16 bits, and no sum the range that a projection holds.
    #[test]
    fn the_sum_stays_in_its_bound_at_the_brightest_light() {
        let mut weights = FixedWeights::dark(MAX_PATCHES);
        for (radiance, exposure) in [(f32::MAX, 1.0), (1e38, 0.5), (f32::MAX, f32::MAX), (1.0, f32::MAX)] {
            weights.set(&vec![[radiance; 3]; MAX_PATCHES], None, exposure, LightApart::NONE).unwrap();
            let sum: i64 = weights.value_q(2).iter().map(|&q| i64::from(q)).sum();
            assert!(sum <= MAX_SUM && sum > MAX_SUM / 4, "{radiance} {exposure}: {sum}");
        }
    }

    #[test]
    fn bad_numbers_are_refused_by_place() {
        let mut weights = FixedWeights::dark(16);
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            let mut sky = vec![[1.0; 3]; 16];
            sky[5][1] = bad;
            assert!(matches!(
                weights.set(&sky, None, 1.0, LightApart::NONE),
                Err(WeightError::Radiance { patch: 5, .. })
            ));
        }
        let sky = vec![[1.0; 3]; 16];
        assert!(matches!(weights.set(&sky[1..], None, 1.0, LightApart::NONE), Err(WeightError::Count { .. })));
        assert!(matches!(weights.set(&sky, None, 0.0, LightApart::NONE), Err(WeightError::Exposure(_))));
        let sun = SunWeight { dir_world: [0.0, 2.0, 0.0], irradiance: [1.0; 3] };
        assert_eq!(weights.set(&sky, Some(&sun), 1.0, LightApart::NONE), Err(WeightError::Sun));
    }

    #[test]
    fn patches_apart_leave_the_values_and_keep_their_light() {
        let mut weights = FixedWeights::dark(32);
        let mut sky = vec![[1.0; 3]; 32];
        sky[7] = [1000.0, 500.0, 250.0];
        weights.set(&sky, None, 0.5, LightApart::Some(&[Apart { patch: 7, light: sky[7] }])).unwrap();
        assert_eq!(weights.value_q(0)[7], 0);
        assert!(weights.value_q(0)[6] > 16000, "the bright patch no longer rules the scale");
        assert!(weights.apart().eq([Apart { patch: 7, light: [500.0, 250.0, 125.0] }]));
        // Only a part of it: what is left goes through the factors.
        let part = [Apart { patch: 7, light: [999.0, 500.0, 0.0] }];
        weights.set(&sky, None, 0.5, LightApart::Some(&part)).unwrap();
        assert_eq!(weights.value_q(0)[7], weights.value_q(0)[6]);
        assert_eq!(weights.value_q(1)[7], 0);
        assert!(weights.value_q(2)[7] > 16000);
    }

    #[test]
    fn flicker_around_a_power_of_two_keeps_the_scale() {
        let mut weights = FixedWeights::dark(16);
        let mut seen = vec![];
        for k in 0..100 {
            let value = if k % 2 == 0 { 0.999 } else { 1.001 } * 32767.0 / 16384.0;
            weights.set(&[[value; 3]; 16], None, 1.0, LightApart::NONE).unwrap();
            seen.push(weights.exponent()[0]);
        }
        assert!(seen[2..].windows(2).all(|pair| pair[0] == pair[1]));
    }

    #[test]
    fn denormal_light_counts_as_dark() {
        let mut weights = FixedWeights::dark(32);
        let mut sky = vec![[0.0; 3]; 32];
        sky[20] = [f32::from_bits(1); 3];
        weights.set(&sky, None, 1.0, LightApart::NONE).unwrap();
        assert_eq!((weights.lit_blocks().len(), weights.dark_patches()), (0, 32));
        sky[20] = [1.0; 3];
        weights.set(&sky, None, 1.0, LightApart::NONE).unwrap();
        assert_eq!((weights.lit_blocks(), weights.dark_patches()), (&[1u8][..], 31));
    }
}
