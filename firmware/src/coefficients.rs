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
            self.set_channel(c, sums, tile.v_scales(c), exponent);
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
    fn set_channel(&mut self, c: usize, sums: &[i32], scales: impl Iterator<Item = u16> + Clone, exponent: i32) {
        let products = || sums.iter().zip(scales.clone()).map(|(&sum, scale)| i64::from(sum) * i64::from(scale));
        let largest = products().fold(0, |all, full| all | full.unsigned_abs());
        let fit = (64 - largest.leading_zeros() as i32 - 15).max(0);
        // What would round up to 32768 takes a doubling more, and so does a unit that would be too small.
        let fit = fit + i32::from(rounding_shift(largest as i64, fit as u32) > 32767);
        let fit = fit.max((SMALLEST_UNIT - exponent).min(62));
        // product * 2^(fit + exponent) is radiance times exposure; a unit that is out of range is as good as its limit.
        self.unit[c] = libm::scalbnf(1.0, (fit + exponent).max(SMALLEST_UNIT)).min(UNIT_LIMIT);
        let mut codes = products().map(|full| rounding_shift(full, fit as u32).clamp(-32767, 32767) as i32);
        for pair in &mut self.pairs[c][..sums.len().div_ceil(2)] {
            *pair = codes.next().unwrap_or(0) & 0xffff | codes.next().unwrap_or(0) << 16;
        }
    }

    /// Ranks used.
    pub fn rank(&self) -> usize {
        usize::from(self.rank)
    }

    /// Asks for what a projection on this tile's V will read.
    pub fn prefetch_projection(tile: &Tile<'_>, kernel: Kernel) {
        kernel.prefetch_stream(tile.v);
        kernel.prefetch_stream(tile.v_scale);
    }

    /// How far linear values (1 = display white) of a tile move from `drawn` to `self` at most, per channel: plain, and over
    /// (row scale / 65535)^0.583 ([`crate::bound`]). `size` and `reach` are the tile's.
    pub fn change_bound(&self, drawn: &Coefficients, size: &TileSize, reach: &TileReach<'_>) -> [[Sides; 3]; 2] {
        let pairs = self.rank().max(drawn.rank()).min(size.rank) / 2;
        // Units are powers of two, so that only the difference is rounded.
        let units: [[f32; 2]; 3] =
            core::array::from_fn(|c| [self.unit[c], drawn.unit[c]].map(|u| u * size.row_unit[c]));
        let pair = |x: &Coefficients, c: usize, j: usize| if 2 * j < x.rank() { x.pairs[c][j] } else { 0 };
        let mut sums = ReachSums::default();
        for j in 0..pairs {
            let mut moved = [[0.0f32; REACH_LANES]; 2];
            for (c, [new_unit, old_unit]) in units.iter().enumerate() {
                let (new, old) = (pair(self, c, j), pair(drawn, c, j));
                let even = f32::from(new as i16) * new_unit - f32::from(old as i16) * old_unit;
                let odd = (new >> 16) as f32 * new_unit - (old >> 16) as f32 * old_unit;
                (moved[0][c], moved[0][3 + c]) = (even, even);
                (moved[1][c], moved[1][3 + c]) = (odd, odd);
            }
            sums.add(reach.of(2 * j), &moved[0]);
            sums.add(reach.of(2 * j + 1), &moved[1]);
        }
        sums.sides()
    }

    /// A bound on what rounding of the coefficients, and ranks of the tile that are not used, change in any linear
    /// value, per channel; it holds over (row scale / 65535)^0.583, too. `all` are the coefficients with all ranks.
    pub fn rounding_bound(&self, all: &Coefficients, size: &TileSize) -> [f32; 3] {
        let (used, rank) = (self.rank().min(size.rank), all.rank().min(size.rank));
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
            counts * 65535.0 * all.unit[c] * size.row_unit[c] * 1.0001
        })
    }
}

/// `sums[k] = sum_i V[k][i] * values[i]` for one channel of a tile's block.
pub fn project_channel(tile: &Tile<'_>, channel: usize, values: Values<'_>, kernel: Kernel, sums: &mut [i32]) {
    let stride = values.value_q.len();
    let v = &tile.v[channel * tile.v_rank() * stride..][..sums.len() * stride];
    kernel.project(&Projection { v, weights: values.value_q, lit_blocks: values.lit_blocks }, sums);
}

/// How far something moves at most, down and up; neither is negative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sides {
    /// Down.
    pub down: f32,
    /// Up.
    pub up: f32,
}

impl Sides {
    /// As far either way.
    pub const fn both(most: f32) -> Sides {
        Sides { down: most, up: most }
    }

    /// The further one.
    pub fn most(self) -> f32 {
        self.down.max(self.up)
    }

    /// What holds for both.
    pub fn widest(self, other: Sides) -> Sides {
        Sides { down: self.down.max(other.down), up: self.up.max(other.up) }
    }
}

impl core::ops::AddAssign for Sides {
    fn add_assign(&mut self, other: Sides) {
        (self.down, self.up) = (self.down + other.down, self.up + other.up);
    }
}

/// How large a tile's coefficients count, at most.
#[derive(Clone, Copy, Debug, Default)]
pub struct TileSize {
    /// Ranks.
    pub rank: usize,
    /// What one count of a row scale means, per channel.
    pub row_unit: [f32; 3],
}

impl TileSize {
    /// Of a tile.
    pub fn of(tile: &Tile<'_>) -> Self {
        TileSize { rank: tile.rank(), row_unit: core::array::from_fn(|c| tile.row_unit(c)) }
    }

    /// The larger of both.
    pub fn max(self, other: TileSize) -> Self {
        let row_unit = core::array::from_fn(|c| self.row_unit[c].max(other.row_unit[c]));
        TileSize { rank: self.rank.max(other.rank), row_unit }
    }
}

/// How far one count of a coefficient moves a tile's pixels: U times row scale (codes), plain, and over
/// (row scale / 65535)^0.583. Per rank the middle of all pixels' and then how far they are from it at most, each plain R G B,
/// weighted R G B and two zeros: `[rank][2][8]`. Empty: the worst that a tile can have.
#[derive(Clone, Copy, Debug)]
pub struct TileReach<'a>(pub &'a [f32]);

const REACH_LANES: usize = 8;

impl TileReach<'_> {
    /// Values of a tile's reach.
    pub fn len_of(tile: &Tile<'_>) -> usize {
        2 * REACH_LANES * tile.rank()
    }

    /// Fills `out`, [`TileReach::len_of`] values.
    pub fn measure(tile: &Tile<'_>, out: &mut [f32]) {
        let n = tile.padded_pixels();
        let (ranks, _) = out.as_chunks_mut::<{ 2 * REACH_LANES }>();
        for ends in ranks.iter_mut() {
            let (low, high) = ends.split_at_mut(REACH_LANES);
            low.fill(f32::INFINITY);
            high.fill(f32::NEG_INFINITY);
        }
        for c in 0..3 {
            // Black pixels do not move.
            for (x, row) in tile.row_codes(c).map(f32::from).enumerate().filter(|(_, row)| *row > 0.0) {
                let weighted = 65535.0 * libm::powf(row / 65535.0, 1.0 - crate::bound::DARK_POWER);
                for (k, ends) in ranks.iter_mut().enumerate() {
                    let u = f32::from(tile.u[(k / 2 * n + x) * 2 + k % 2] as i8);
                    for (lane, row) in [(c, row), (3 + c, weighted)] {
                        ends[lane] = ends[lane].min(u * row);
                        ends[REACH_LANES + lane] = ends[REACH_LANES + lane].max(u * row);
                    }
                }
            }
        }
        for (low, high) in ranks.iter_mut().flat_map(|ends| {
            let (low, high) = ends.split_at_mut(REACH_LANES);
            low.iter_mut().zip(high)
        }) {
            let (middle, half) = (0.5 * (*low + *high), 0.5 * (*high - *low));
            // The part of the middle is more than the powers are off by.
            (*low, *high) = if *low <= *high { (middle, half + 1e-5 * (half + middle.abs())) } else { (0.0, 0.0) };
        }
    }

    /// Widens `own` to hold for a tile of this reach and size, too, in units of a row unit of 1.
    pub fn join(&self, size: &TileSize, own: &mut [f32]) {
        let ranks = own.as_chunks_mut::<{ 2 * REACH_LANES }>().0.iter_mut().enumerate();
        for (rank, (own_middles, own_halves)) in ranks.map(|(rank, own)| (rank, own.split_at_mut(REACH_LANES))) {
            // What lacks a rank does not move with it.
            let reach = if rank < size.rank { *self.of(rank) } else { [0.0; 2 * REACH_LANES] };
            for (lane, (middle, half)) in own_middles.iter_mut().zip(own_halves).enumerate().take(6) {
                let unit = size.row_unit[lane % 3];
                let (other, other_half) = (reach[lane] * unit, reach[REACH_LANES + lane] * unit);
                let low = (*middle - *half).min(other - other_half);
                let high = (*middle + *half).max(other + other_half);
                *middle = 0.5 * (low + high);
                *half = 0.5 * (high - low) + 1e-6 * (high.abs() + low.abs());
            }
        }
    }

    /// Of one rank.
    fn of(&self, rank: usize) -> &[f32; 2 * REACH_LANES] {
        const WORST: [f32; 2 * REACH_LANES] = {
            let mut worst = [0.0; 2 * REACH_LANES];
            let mut lane = REACH_LANES;
            while lane < 2 * REACH_LANES {
                worst[lane] = 127.0 * 65535.0;
                lane += 1;
            }
            worst
        };
        self.0.as_chunks().0.get(rank).unwrap_or(&WORST)
    }
}

/// Sums over the ranks.
#[derive(Default)]
struct ReachSums {
    middle: [f32; REACH_LANES],
    /// Of the middles' sizes.
    size: [f32; REACH_LANES],
    around: [f32; REACH_LANES],
}

impl ReachSums {
    #[inline]
    fn add(&mut self, reach: &[f32; 2 * REACH_LANES], moved: &[f32; REACH_LANES]) {
        for lane in 0..REACH_LANES {
            let step = moved[lane] * reach[lane];
            self.middle[lane] += step;
            self.size[lane] += step.abs();
            self.around[lane] += moved[lane].abs() * reach[REACH_LANES + lane];
        }
    }

    fn sides(&self) -> [[Sides; 3]; 2] {
        let side = |lane: usize| {
            let (middle, size, around) = (self.middle[lane], self.size[lane], self.around[lane]);
            if size + around == 0.0 {
                return Sides::default();
            }
            // More than single precision loses in sums of up to 128.
            let around = around + 2e-5 * (size + around) + ROUNDING;
            Sides { down: (around - middle).max(0.0), up: (around + middle).max(0.0) }
        };
        [0, 3].map(|kind| core::array::from_fn(|c| side(kind + c)))
    }
}

/// Exponent of the smallest unit: whatever it multiplies stays normal, and far below a code.
const SMALLEST_UNIT: i32 = -110;
/// More than single precision rounds off two values up to 2.
const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

fn rounding_shift(value: i64, by: u32) -> i64 {
    (value + ((1i64 << by) >> 1)) >> by
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
                    found.set_channel(1, &[sum, 1], [scale; 2].into_iter(), exponent);
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
