//! A tile's coefficients: weights -> integer sums -> 16-bit pairs.

use crate::kernel::{Kernel, Projection, UNIT_LIMIT};
use crate::tile::{MAX_RANK, Tile};
use crate::weights::FixedWeights;

/// A tile's coefficients for one set of weights.
///
/// `linear[c][x] = (sum_k U[x][k] * q[c][k]) * row[c][x] * unit[c]`, 1 = display white.
#[derive(Clone, Copy, Debug)]
pub struct Coefficients {
    /// Pairs of |q| <= 32767: low half even rank, high half odd rank.
    pub(crate) pairs: [[i32; MAX_RANK / 2]; 3],
    rank: u8,
    pub(crate) unit: [f32; 3],
}

impl Coefficients {
    /// All zero, as before the first projection.
    pub const ZERO: Coefficients = Coefficients { pairs: [[0; MAX_RANK / 2]; 3], rank: 0, unit: [0.0; 3] };

    /// Projects the weights on a tile's V. `max_rank` limits the ranks used (rounded up to even); ranks are stored
    /// most important first.
    pub fn project(&mut self, tile: &Tile<'_>, weights: &FixedWeights, kernel: Kernel, max_rank: usize) {
        let lit = !weights.lit_blocks().is_empty();
        let rank = if lit { tile.rank().min(max_rank.min(MAX_RANK).next_multiple_of(2)) } else { 0 };
        self.rank = rank as u8;
        let mut sums = [0i32; MAX_RANK];
        for c in 0..3 {
            let values = weights.value_q(c);
            let v = &tile.v[c * tile.rank() * values.len()..][..rank * values.len()];
            let job = Projection { v, weights: values, lit_blocks: weights.lit_blocks() };
            kernel.project(&job, &mut sums[..rank]);
            let exponent =
                weights.exponent()[c] + i32::from(tile.record.v_exponent[c]) + i32::from(tile.record.row_exponent[c]);
            self.set_channel(c, &sums[..rank], |k| tile.v_scale(c, k), exponent);
        }
    }

    /// Takes over another's values, only as many as it uses.
    pub fn copy_from(&mut self, other: &Coefficients) {
        let pairs = other.rank() / 2;
        for (own, other) in self.pairs.iter_mut().zip(&other.pairs) {
            own[..pairs].copy_from_slice(&other[..pairs]);
        }
        (self.rank, self.unit) = (other.rank, other.unit);
    }

    /// Brings `sums[k] * scale(k)` to 16 bits by a power of two of the tile and channel, and derives the unit.
    fn set_channel(&mut self, c: usize, sums: &[i32], scale: impl Fn(usize) -> u16, exponent: i32) {
        let full = |k: usize, sum: i32| i64::from(sum) * i64::from(scale(k));
        let largest = sums.iter().enumerate().fold(0, |all, (k, &sum)| all | full(k, sum).unsigned_abs());
        let fit = (64 - largest.leading_zeros() as i32 - 15).max(0);
        // product * 2^(fit + exponent) is radiance times exposure; a unit that is out of range is as good as its limit.
        self.unit[c] = libm::scalbnf(1.0, (fit + exponent).max(SMALLEST_UNIT)).min(UNIT_LIMIT);
        for (k, &sum) in sums.iter().enumerate() {
            let q = rounding_shift(full(k, sum), fit as u32).clamp(-32767, 32767) as i32;
            let pair = &mut self.pairs[c][k / 2];
            *pair = if k % 2 == 0 { q & 0xffff } else { *pair | q << 16 };
        }
    }

    /// Ranks used.
    pub fn rank(&self) -> usize {
        usize::from(self.rank)
    }

    /// Asks for what a projection on this tile's V will read.
    pub fn prefetch_projection(tile: &Tile<'_>, kernel: Kernel) {
        kernel.prefetch(tile.v);
        kernel.prefetch(tile.v_scale);
    }

    /// A bound on how far any linear value (1 = display white) of a tile moves from `drawn` to `self`:
    /// |U| <= 127, row scales < 2^16, and rounding of both pictures.
    pub fn change_bound(&self, drawn: &Coefficients) -> f32 {
        (0..3).map(|c| self.channel_change_bound(drawn, c)).fold(0.0, f32::max)
    }

    fn channel_change_bound(&self, drawn: &Coefficients, c: usize) -> f32 {
        let (new_unit, old_unit) = (self.unit[c], drawn.unit[c]);
        let pairs = self.rank().max(drawn.rank()) / 2;
        let mut sum = 0.0f32;
        for j in 0..pairs {
            let pair = |x: &Coefficients| if 2 * j < x.rank() { x.pairs[c][j] } else { 0 };
            let (new, old) = (pair(self), pair(drawn));
            let term = |new: i32, old: i32| (new as f32 * new_unit - old as f32 * old_unit).abs();
            sum += term(i32::from(new as i16), i32::from(old as i16)) + term(new >> 16, old >> 16);
        }
        if sum == 0.0 { 0.0 } else { sum * (127.0 * 65535.0 * 1.0001) + ROUNDING }
    }
}

/// Exponent of the smallest unit: whatever it multiplies stays normal, and far below a code.
const SMALLEST_UNIT: i32 = -110;
/// More than single precision rounds off two values up to 2.
const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

fn rounding_shift(value: i64, by: u32) -> i64 {
    if by == 0 { value } else { (value + (1 << (by - 1))) >> by }
}
