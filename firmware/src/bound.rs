//! The bound on a block's error under the light of the moment, against the uncompressed response.
//!
//! ```text
//! BNDB  u32 modes K   4 u32 patches per group = 16   8 u32 dimensions D = K + ceil(patches / 16)   12 reserved, 0
//!       16 f32 [K][patches]: orthonormal modes of the sky prior
//! BNDT  per block of 2 x 2 tiles (tile.rs):
//!       0 f32[3] scale, plain, R G B   12 f32[3] scale, weighted   24 f32[3] reach, plain   36 f32[3] weighted
//!       48 u8 [2][3][D'] codes of m ([`AXIS`]), plain then weighted; D' = D rounded up to 16
//! ```
//!
//! With `a` the parts of the weights along the modes and, for the rest, the norms over groups of patches,
//! `|error| <= sqrt(scale * sum_d m_d a_d^2)` for every pixel of the block (Cauchy-Schwarz over an ellipsoid that holds
//! what compression leaves out of every pixel; bake/src/compress/bound.rs). The weighted constants bound
//! `|error| / (row scale / 65535)^0.583`, which follows the slope of the sRGB curve into the dark.

use crate::field::FieldError;
use crate::header::{f32_at, u32_at, vec3_at};
use crate::kernel::{Kernel, Loops};
use crate::minifloat::Minifloat;
use crate::patches::MAX_PATCHES;
use crate::tile::{LANE_PAD, padded};
use crate::tone::{LINEAR_SLOPE, ROOT_SLOPE};
use crate::weights::FixedWeights;

/// Modes of the prior that a bound tells apart.
pub const BOUND_MODES: usize = 31;
/// Patches per group of what the modes leave.
pub const GROUP: usize = 16;
/// Power of a row scale that the weighted bound is relative to: the sRGB curve's slope falls as light^-0.583.
pub const DARK_POWER: f32 = 0.583;
const MAX_DIMS: usize = padded(BOUND_MODES + MAX_PATCHES.div_ceil(GROUP));
const BASIS_HEADER: usize = 16;
const RECORD_HEADER: usize = 48;

/// The codes of `m`.
pub const AXIS: Minifloat = Minifloat::from(-40);

/// Checked bound layers.
#[derive(Clone, Copy, Debug)]
pub struct Bounds<'a> {
    basis: &'a [u8],
    records: &'a [u8],
    modes: usize,
    patches: usize,
    dims: usize,
}

/// The weights of one moment as the bound takes them.
#[derive(Clone, Debug)]
pub struct BoundLight {
    /// Squared parts per channel, in counts of the fixed-point weights: in range whatever the light.
    squares: [[f32; MAX_DIMS]; 3],
    /// Half a count of the fixed-point weights, per channel.
    half_count: [f32; 3],
}

impl BoundLight {
    /// No light.
    pub const DARK: BoundLight = BoundLight { squares: [[0.0; MAX_DIMS]; 3], half_count: [0.0; 3] };
}

impl<'a> Bounds<'a> {
    pub(crate) fn check(basis: &'a [u8], records: &'a [u8], blocks: usize, patches: usize) -> Result<Self, FieldError> {
        let bad = FieldError::Invalid("bounds");
        if basis.len() < BASIS_HEADER {
            return Err(bad);
        }
        let modes = u32_at(basis, 0) as usize;
        let dims = modes.saturating_add(patches.div_ceil(GROUP));
        let shape = modes <= BOUND_MODES
            && u32_at(basis, 4) as usize == GROUP
            && u32_at(basis, 8) as usize == dims
            && basis.len() == BASIS_HEADER + 4 * modes * patches;
        let bounds = Bounds { basis, records, modes, patches, dims };
        if !shape || records.len() != blocks * bounds.record_len() {
            return Err(bad);
        }
        let good = |value: f32| value.is_finite() && value >= 0.0;
        let finite = basis[BASIS_HEADER..].chunks_exact(4).all(|b| f32_at(b, 0).is_finite());
        let scales = (0..blocks).all(|block| (0..12).all(|k| good(f32_at(bounds.record(block), 4 * k))));
        if finite && scales { Ok(bounds) } else { Err(bad) }
    }

    fn record_len(&self) -> usize {
        RECORD_HEADER + 6 * padded(self.dims)
    }

    fn record(&self, block: usize) -> &'a [u8] {
        &self.records[block * self.record_len()..][..self.record_len()]
    }

    /// Patches of the modes.
    pub fn patches(&self) -> usize {
        self.patches
    }

    /// Modes of the prior.
    pub fn modes(&self) -> usize {
        self.modes
    }

    /// What mode `k` has of a patch.
    pub fn mode_at(&self, k: usize, patch: usize) -> f32 {
        f32_at(self.basis, BASIS_HEADER + 4 * (k * self.patches + patch))
    }

    /// Leaves of `light`, a value per patch, what no mode has, and tells how much each had. Each mode takes its part of
    /// what the ones before left: the same as all at once for orthonormal modes.
    #[inline(always)]
    pub(crate) fn take_modes(&self, light: &mut [f32], mut tell: impl FnMut(usize, f32)) {
        for k in 0..self.modes {
            let part = dot(self.mode(k), light);
            self.add_mode(k, -part, light);
            tell(k, part);
        }
    }

    /// Adds `part` times mode `k`.
    #[inline(always)]
    pub(crate) fn add_mode(&self, k: usize, part: f32, light: &mut [f32]) {
        light.iter_mut().zip(self.mode(k)).for_each(|(light, z)| *light += part * f32::from_le_bytes(*z));
    }

    #[inline(always)]
    fn mode(&self, k: usize) -> &'a [[u8; 4]] {
        self.basis[BASIS_HEADER + 4 * k * self.patches..][..4 * self.patches].as_chunks::<4>().0
    }

    /// Splits the weights over the modes and groups.
    pub fn light(&self, weights: &FixedWeights, kernel: Kernel, out: &mut BoundLight) {
        kernel.widely(Split { bounds: self, weights, out });
    }

    /// Bounds `[plain, weighted][channel]` on radiance times exposure, of compression and of the weights' rounding.
    pub fn block(&self, block: usize, light: &BoundLight, kernel: Kernel) -> [[f32; 3]; 2] {
        let record = self.record(block);
        let sums = kernel.widely(Sums { codes: &record[RECORD_HEADER..], stride: padded(self.dims), light });
        core::array::from_fn(|kind| {
            let reach = vec3_at(record, 24 + 12 * kind);
            core::array::from_fn(|c| {
                let (half, scale) = (light.half_count[c], f32_at(record, 12 * kind + 4 * c));
                libm::sqrtf(sums[kind][c] * scale) * SLACK * (2.0 * half) + half * reach[c]
            })
        })
    }
}

/// [`Bounds::light`].
struct Split<'a> {
    bounds: &'a Bounds<'a>,
    weights: &'a FixedWeights,
    out: &'a mut BoundLight,
}

impl Loops for Split<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let Split { bounds, weights, out } = self;
        for c in 0..3 {
            let mut rest = [0.0f32; padded(MAX_PATCHES)];
            let rest = &mut rest[..bounds.patches];
            rest.iter_mut().zip(weights.value_q(c)).for_each(|(r, &q)| *r = f32::from(q));
            let squares = &mut out.squares[c];
            squares.fill(0.0);
            bounds.take_modes(rest, |k, part| squares[k] = part * part);
            for (square, group) in squares[bounds.modes..].iter_mut().zip(rest.chunks(GROUP)) {
                *square = group.iter().map(|r| r * r).sum();
            }
            out.half_count[c] = 0.5 * libm::scalbnf(1.0, weights.exponent()[c]);
        }
    }
}

/// `[plain, weighted][channel]` of a block: the squares of the light, weighted by its codes.
struct Sums<'a> {
    codes: &'a [u8],
    stride: usize,
    light: &'a BoundLight,
}

impl Loops for Sums<'_> {
    type Out = [[f32; 3]; 2];

    #[inline(always)]
    fn run(self) -> [[f32; 3]; 2] {
        let mut sums = [[0.0; 3]; 2];
        let rows = self.codes.chunks_exact(self.stride.max(LANE_PAD));
        for (place, (sum, codes)) in sums.iter_mut().flatten().zip(rows).enumerate() {
            *sum = weighted_sum(codes, &self.light.squares[place % 3]);
        }
        sums
    }
}

/// What single precision may lose on the way.
const SLACK: f32 = 1.0001;

#[inline(always)]
fn dot(mode: &[[u8; 4]], rest: &[f32]) -> f32 {
    let mut lanes = [0.0f32; LANE_PAD];
    let ((modes, mode_end), (rests, rest_end)) = (mode.as_chunks::<LANE_PAD>(), rest.as_chunks::<LANE_PAD>());
    for (mode, rest) in modes.iter().zip(rests) {
        for k in 0..LANE_PAD {
            lanes[k] += f32::from_le_bytes(mode[k]) * rest[k];
        }
    }
    let ends = mode_end.iter().zip(rest_end);
    lanes.iter_mut().zip(ends).for_each(|(sum, (z, r))| *sum += f32::from_le_bytes(*z) * r);
    lanes.iter().sum()
}

#[inline(always)]
fn weighted_sum(codes: &[u8], squares: &[f32]) -> f32 {
    let mut lanes = [0.0f32; LANE_PAD];
    for (codes, squares) in codes.as_chunks::<LANE_PAD>().0.iter().zip(squares.as_chunks::<LANE_PAD>().0) {
        for k in 0..LANE_PAD {
            lanes[k] += AXIS.above_zero(codes[k]) * squares[k];
        }
    }
    lanes.iter().sum()
}

/// The slope of the sRGB curve in codes per linear light, from above: a table over the octaves, eight steps in each.
#[derive(Clone, Debug)]
pub struct CodeSlope([f32; STEPS]);

/// Steps from 2^-16 to 1.
const STEPS: usize = 16 * 8;
const FIRST_STEP: u32 = (127 - 16) << 3;
/// Light from which on the curve is no line, and a little more.
const LINE_END: f32 = 0.003_15;

impl CodeSlope {
    /// Computes the table (512 bytes).
    pub fn new() -> Self {
        CodeSlope(core::array::from_fn(|step| {
            let light = f32::from_bits((FIRST_STEP + step as u32) << 20);
            // 255 * 1.055 / 2.4 = 112.1 times light^-0.583, and 1.9 % more to be above the line's end, too, in rows of any
            // scale; where the curve is a line, its slope.
            (114.3 * libm::powf(light, -DARK_POWER)).min(LINEAR_SLOPE)
        }))
    }

    /// No slope at this light or above it is larger.
    #[inline]
    pub fn above(&self, light: f32) -> f32 {
        let step = (light.to_bits() >> 20).wrapping_sub(FIRST_STEP) as usize;
        // Light below the table, negative or not a number has the steepest slope.
        if light >= 1.0 { self.0[STEPS - 1] } else { self.0.get(step).copied().unwrap_or(LINEAR_SLOPE) }
    }

    /// No slope over the square root of light, at this light or above it, is larger.
    #[inline]
    pub fn root_above(&self, light: f32) -> f32 {
        // Where the curve is no line any more its slope over the root falls, too.
        if light > LINE_END { ROOT_SLOPE.min(self.above(light) * 2.0 * libm::sqrtf(light)) } else { ROOT_SLOPE }
    }

    /// The largest change of an 8-bit sRGB code, before rounding, that an error within `plain` and `weighted` (of
    /// [`Bounds::block`], one channel) makes in a tile.
    ///
    /// `brightness` is a linear value over (row scale / 65535) that no pixel of the tile falls below (its smallest linear
    /// value will do), `dark_share` what [`dark_share`] says of its smallest row scale.
    #[inline]
    pub fn codes(&self, plain: f32, weighted: f32, brightness: f32, dark_share: f32) -> f32 {
        let steepest = LINEAR_SLOPE * plain;
        // In the darkest pixel the error is the largest share of the light.
        let rest = brightness - weighted * dark_share;
        if rest <= 0.1 * brightness || rest.is_nan() {
            return steepest;
        }
        steepest.min(self.above(rest) * weighted)
    }
}

impl Default for CodeSlope {
    fn default() -> Self {
        Self::new()
    }
}

/// How much more an error within a weighted bound matters in a pixel of the row scale `row` (over 65535) than in one of the
/// largest: `row^(0.583 - 1)`.
pub fn dark_share(row: f32) -> f32 {
    libm::powf(row.max(1.0 / 65535.0), DARK_POWER - 1.0) * 1.0001
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the curve itself: no pixel of any row scale moves further than the bound says.
    #[test]
    fn code_bound_holds_on_the_curve() {
        let slope = CodeSlope::new();
        for brightness in [0.003f32, 0.05, 0.3, 1.0] {
            for weighted in [1e-5f32, 1e-3, 0.01] {
                for darkest in [1e-3f32, 0.05, 0.5, 1.0] {
                    let bound = f64::from(slope.codes(weighted, weighted, brightness, dark_share(darkest)));
                    for k in 0..=50 {
                        let row = darkest.powf(k as f32 / 50.0);
                        let (light, error) = (row * brightness, row.powf(DARK_POWER) * weighted);
                        for way in [-1.0, 1.0] {
                            let truth = (light + way * error).max(0.0);
                            let codes = |l: f32| crate::tone::srgb_code(f64::from(l.min(1.0)));
                            assert!((codes(truth) - codes(light)).abs() <= bound * 1.0001 + 1e-4);
                        }
                    }
                }
            }
        }
    }

    /// The slope over the square root of light, from any light on.
    #[test]
    fn the_slope_over_the_root_is_above_the_curve() {
        let slope = CodeSlope::new();
        let code = |root: f64| crate::tone::srgb_code(root * root);
        for k in 0..4000 {
            let root = f64::from(k) / 4000.0;
            let steepest = (code(root + 1e-6) - code(root)) / 1e-6;
            for below in [0.0, 0.5, 0.9, 1.0] {
                let light = (root * root * below) as f32;
                assert!(steepest <= f64::from(slope.root_above(light)) + 1e-3, "{root} {light}: {steepest}");
            }
        }
    }

    /// Small errors, where the bound is the slope: in no row scale is the curve steeper, its straight part included.
    #[test]
    fn the_slope_is_above_the_curve_in_rows_of_any_scale() {
        let slope = CodeSlope::new();
        for brightness in [0.0035f32, 0.03125, 0.11, 0.25, 0.5, 0.9375, 1.0] {
            for k in 0..=400 {
                let row = libm::powf(1e-3, k as f32 / 400.0);
                let weighted = 1e-4 * row * brightness;
                let bound = f64::from(slope.codes(weighted, weighted, brightness, dark_share(row)));
                let (light, error) = (f64::from(row * brightness), f64::from(libm::powf(row, DARK_POWER) * weighted));
                let moved = crate::tone::srgb_code(light) - crate::tone::srgb_code(light - error);
                assert!(moved <= bound * 1.0001, "{light}: {moved} {bound}");
            }
        }
    }
}
