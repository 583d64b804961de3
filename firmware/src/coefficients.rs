//! A block's coefficients: weights -> integer sums -> 16-bit pairs.

use crate::kernel::{Kernel, Projection, UNIT_LIMIT};
use crate::tile::{MAX_RANK, Tile};
use crate::weights::{FixedWeights, Values};

/// The coefficients of a block for one set of weights, the same for all its tiles.
///
/// `linear[c][x] = (sum_k U[x][k] * q[c][k]) * row[c][x] * 2^re[c] * unit[c]`, 1 = display white.
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

    /// Projects the weights on the V of a tile's block. `max_rank` limits the ranks used (rounded up to even); ranks are
    /// stored most important first.
    pub fn project(&mut self, tile: &Tile<'_>, weights: &FixedWeights, kernel: Kernel, max_rank: usize) {
        let mut sums = [[0i32; MAX_RANK]; 3];
        let rank = tile.v_rank().min(max_rank.min(MAX_RANK).next_multiple_of(2));
        for (c, sums) in sums.iter_mut().enumerate() {
            project_channel(tile, c, weights.values(c), kernel, &mut sums[..rank]);
        }
        let rank = if weights.lit_blocks().is_empty() { 0 } else { rank };
        self.set_sums(tile, [&sums[0][..rank], &sums[1][..rank], &sums[2][..rank]], weights.exponent());
    }

    /// Takes the sums of [`project_channel`], of weights with these exponents.
    pub fn set_sums(&mut self, tile: &Tile<'_>, sums: [&[i32]; 3], exponent: [i32; 3]) {
        self.rank = sums[0].len() as u8;
        for (c, sums) in sums.into_iter().enumerate() {
            let exponent = exponent[c] + i32::from(tile.record.v_exponent[c]);
            self.set_channel(c, sums, |k| tile.v_scale(c, k), exponent);
        }
    }

    /// Uses at most this many ranks from now on.
    pub fn limit_rank(&mut self, max_rank: usize) {
        self.rank = self.rank.min(max_rank.min(MAX_RANK).next_multiple_of(2) as u8);
    }

    /// Takes over another's values, only as many as it uses.
    pub fn copy_from(&mut self, other: &Coefficients) {
        let pairs = other.rank() / 2;
        for (own, other) in self.pairs.iter_mut().zip(&other.pairs) {
            own[..pairs].copy_from_slice(&other[..pairs]);
        }
        (self.rank, self.unit) = (other.rank, other.unit);
    }

    /// Brings `sums[k] * scale(k)` to 16 bits by a power of two of the block and channel, and derives the unit.
    fn set_channel(&mut self, c: usize, sums: &[i32], scale: impl Fn(usize) -> u16, exponent: i32) {
        let full = |k: usize, sum: i32| i64::from(sum) * i64::from(scale(k));
        let largest = sums.iter().enumerate().fold(0, |all, (k, &sum)| all | full(k, sum).unsigned_abs());
        let fit = (64 - largest.leading_zeros() as i32 - 15).max(0);
        // What would round up to 32768 takes a doubling more, and so does a unit that would be too small.
        let fit = fit + i32::from(rounding_shift(largest as i64, fit as u32) > 32767);
        let fit = fit.max((SMALLEST_UNIT - exponent).min(62));
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

    /// A bound on how far any linear value (1 = display white) of a tile moves from `drawn` to `self`, per channel: plain,
    /// and over (row scale / 65535)^0.583 ([`crate::bound`]). `reach` is the tile's.
    pub fn change_bound(&self, drawn: &Coefficients, tile: &Tile<'_>, reach: &TileReach<'_>) -> [[f32; 3]; 2] {
        let pairs = self.rank().max(drawn.rank()).min(tile.rank()) / 2;
        let mut out = [[0.0; 3]; 2];
        for c in 0..3 {
            let scale = row_unit(tile, c);
            let (new_unit, old_unit) = (self.unit[c] * scale, drawn.unit[c] * scale);
            let mut sums = [0.0f32; 2];
            for j in 0..pairs {
                let pair = |x: &Coefficients| if 2 * j < x.rank() { x.pairs[c][j] } else { 0 };
                let (new, old) = (pair(self), pair(drawn));
                let moved = |new: i32, old: i32| (new as f32 * new_unit - old as f32 * old_unit).abs();
                let moved = [moved(i32::from(new as i16), i32::from(old as i16)), moved(new >> 16, old >> 16)];
                for (kind, sum) in sums.iter_mut().enumerate() {
                    let reach = reach.pair(kind, c, j);
                    *sum += moved[0] * reach[0] + moved[1] * reach[1];
                }
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                out[c] = if sum == 0.0 { 0.0 } else { sum * 1.0001 + ROUNDING };
            }
        }
        out
    }

    /// A bound on what rounding of the coefficients, and ranks of the tile that are not used, change in any linear
    /// value, per channel; it holds over (row scale / 65535)^0.583, too. `all` are the coefficients with all ranks.
    pub fn rounding_bound(&self, all: &Coefficients, tile: &Tile<'_>) -> [f32; 3] {
        let (used, rank) = (self.rank().min(tile.rank()), all.rank().min(tile.rank()));
        if rank == 0 {
            // Nothing is rounded, and the row scales of a black tile have no size.
            return [0.0; 3];
        }
        core::array::from_fn(|c| {
            let dropped: i64 = (used..rank)
                .map(|k| {
                    let pair = all.pairs[c][k / 2];
                    i64::from(if k % 2 == 0 { i32::from(pair as i16) } else { pair >> 16 }.unsigned_abs())
                })
                .sum();
            // Half a count of each rank; 0.01 are single precision's: 3 roundings of 2^-24 of at most 32767 counts each.
            let counts = 127.0 * (dropped as f32 + 0.51 * rank as f32) + 1.0;
            counts * 65535.0 * all.unit[c] * row_unit(tile, c) * 1.0001
        })
    }
}

/// `sums[k] = sum_i V[k][i] * values[i]` for one channel of a tile's block.
pub fn project_channel(tile: &Tile<'_>, channel: usize, values: Values<'_>, kernel: Kernel, sums: &mut [i32]) {
    let stride = values.value_q.len();
    let v = &tile.v[channel * tile.v_rank() * stride..][..sums.len() * stride];
    kernel.project(&Projection { v, weights: values.value_q, lit_blocks: values.lit_blocks }, sums);
}

/// What one count of a row scale means.
pub(crate) fn row_unit(tile: &Tile<'_>, channel: usize) -> f32 {
    libm::scalbnf(1.0, i32::from(tile.record.row_exponent[channel]))
}

/// How far one count of a coefficient moves a tile's pixels at most: the largest |U| times row scale (codes), plain, and
/// over (row scale / 65535)^0.583. `[2][3][rank]`; empty: the worst that a tile can have.
#[derive(Clone, Copy, Debug)]
pub struct TileReach<'a>(pub &'a [f32]);

impl TileReach<'_> {
    /// Fills `out`, `[2][3][rank]`.
    pub fn measure(tile: &Tile<'_>, out: &mut [f32]) {
        let (n, rank) = (tile.padded_pixels(), tile.rank());
        out.fill(0.0);
        for c in 0..3 {
            for (x, row) in tile.row_codes(c).map(f32::from).enumerate() {
                let weighted = 65535.0 * libm::powf(row / 65535.0, 1.0 - crate::bound::DARK_POWER) * 1.0001;
                for k in 0..rank {
                    let u = f32::from((tile.u[(k / 2 * n + x) * 2 + k % 2] as i8).unsigned_abs());
                    for (kind, row) in [row, weighted].into_iter().enumerate() {
                        let slot = &mut out[(kind * 3 + c) * rank + k];
                        *slot = slot.max(u * row);
                    }
                }
            }
        }
    }

    fn pair(&self, kind: usize, channel: usize, pair: usize) -> [f32; 2] {
        let rank = self.0.len() / 6;
        let at = (kind * 3 + channel) * rank + 2 * pair;
        match self.0.get(at..at + 2) {
            Some(reach) if 2 * pair < rank => [reach[0], reach[1]],
            _ => [127.0 * 65535.0; 2],
        }
    }
}

/// Exponent of the smallest unit: whatever it multiplies stays normal, and far below a code.
const SMALLEST_UNIT: i32 = -110;
/// More than single precision rounds off two values up to 2.
const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

fn rounding_shift(value: i64, by: u32) -> i64 {
    if by == 0 { value } else { (value + (1 << (by - 1))) >> by }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What [`Coefficients::rounding_bound`] relies on, at the ends of 16 bits and of the units.
    #[test]
    fn a_coefficient_is_within_half_a_count_of_its_sum() {
        let ends = (0..31).flat_map(|bits| [(1i64 << bits) - 1, 1 << bits, (1 << bits) + 1]);
        let numbers = ends.chain([i64::from(i32::MAX), 16_776_960, 33_553_920, 1_048_560]);
        for sum in numbers.filter_map(|n| i32::try_from(n).ok()).flat_map(|n| [n, -n]) {
            for scale in [1u16, 3, 32768, 65535] {
                for exponent in [-190, -120, -40, 0] {
                    let mut found = Coefficients::ZERO;
                    found.set_channel(1, &[sum, 1], |_| scale, exponent);
                    let unit = f64::from(found.unit[1]);
                    for (q, sum) in [(found.pairs[1][0] as i16, sum), ((found.pairs[1][0] >> 16) as i16, 1)] {
                        let exact = f64::from(sum) * f64::from(scale) * libm::scalbn(1.0, exponent);
                        let error = (f64::from(q) * unit - exact).abs();
                        assert!(error <= 0.5 * unit, "{sum} * {scale}, 2^{exponent}: {q} {unit}");
                    }
                }
            }
        }
    }
}
