//! Relighting of one tile: weights -> coefficients -> linear pixels.

use crate::kernel::{Kernel, Projection, Reconstruction};
use crate::residual::Residuals;
use crate::tile::{MAX_RANK, TILE_PIXELS, Tile};
use crate::weights::{FixedWeights, Standout};

/// Binary places of a linear value: `1 << LINEAR_BITS` shows as display white.
pub const LINEAR_BITS: i32 = 20;

/// A tile's coefficients for one set of weights.
///
/// `linear[c][x] = (sum_k U[x][k] * q[c][k]) * row[c][x] >> right[c] << left[c]`, in 1/2^20 of display white.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coefficients {
    /// Pairs of |q| <= 32767: low half even rank, high half odd rank.
    pairs: [[i32; MAX_RANK / 2]; 3],
    rank: u8,
    right: [u8; 3],
    left: [u8; 3],
}

impl Coefficients {
    /// All zero, as before the first projection.
    pub const ZERO: Coefficients =
        Coefficients { pairs: [[0; MAX_RANK / 2]; 3], rank: 0, right: [16; 3], left: [0; 3] };

    /// Projects the weights on a tile's V. `max_rank` limits the ranks used (rounded up to even); ranks are stored
    /// most important first.
    pub fn project(tile: &Tile<'_>, weights: &FixedWeights, kernel: Kernel, max_rank: usize) -> Self {
        let rank = tile.rank().min(max_rank.min(MAX_RANK).next_multiple_of(2));
        let mut out = Coefficients { rank: rank as u8, ..Coefficients::ZERO };
        if rank == 0 || weights.lit_blocks().is_empty() {
            return out;
        }
        let mut sums = [0i32; MAX_RANK];
        for c in 0..3 {
            let values = weights.value_q(c);
            let v = &tile.v[c * tile.rank() * values.len()..][..rank * values.len()];
            let job = Projection { v, weights: values, lit_blocks: weights.lit_blocks() };
            kernel.project(&job, &mut sums[..rank]);
            let exponent =
                weights.exponent()[c] + i32::from(tile.record.v_exponent[c]) + i32::from(tile.record.row_exponent[c]);
            out.set_channel(c, &sums[..rank], |k| tile.v_scale(c, k), exponent);
        }
        out
    }

    /// Brings `sums[k] * scale(k)` to 16 bits by a power of two of the tile and channel, and derives the shifts.
    fn set_channel(&mut self, c: usize, sums: &[i32], scale: impl Fn(usize) -> u16, exponent: i32) {
        let mut full = [0i64; MAX_RANK];
        let mut largest = 0u64;
        for (k, &sum) in sums.iter().enumerate() {
            full[k] = i64::from(sum) * i64::from(scale(k));
            largest |= full[k].unsigned_abs();
        }
        let fit = (64 - largest.leading_zeros() as i32 - 15).max(0);
        // product * 2^(block + exponent) is radiance times exposure; in 1/2^20 that is a right shift by
        // -(block + exponent + 20). A shift beyond 32 would need bits above the 64th, so take a larger block: its
        // rounding is then below 2^-16 of an output step.
        let block = fit.max(-LINEAR_BITS - exponent - 32).min(62);
        let shift = (-(block + exponent + LINEAR_BITS)).min(32);
        self.right[c] = shift.max(16) as u8;
        self.left[c] = (16 - shift).clamp(0, 30) as u8;
        for (k, &value) in full[..sums.len()].iter().enumerate() {
            let q = rounding_shift(value, block as u32).clamp(-32767, 32767) as i32;
            let pair = &mut self.pairs[c][k / 2];
            *pair = if k % 2 == 0 { q & 0xffff } else { *pair | q << 16 };
        }
    }

    /// Ranks used.
    pub fn rank(&self) -> usize {
        usize::from(self.rank)
    }

    /// Linear values of all padded pixels of the tile (1/2^20 of display white, premultiplied) into `out`.
    ///
    /// `sun` is the sun's response plane of the whole field (u16 in 1/32768, laid out like the row scales) and its
    /// weight ([`FixedWeights::sun_q16`]).
    pub fn reconstruct(&self, tile: &Tile<'_>, sun: Option<(&[u16], [u32; 3])>, kernel: Kernel, out: &mut LinearTile) {
        let n = tile.padded_pixels();
        let pairs = self.rank() / 2;
        let job = Reconstruction {
            u: tile.u,
            pixels: n,
            pairs: [&self.pairs[0][..pairs], &self.pairs[1][..pairs], &self.pairs[2][..pairs]],
            rows: tile.rows,
            right: self.right.map(u32::from),
            left: self.left.map(u32::from),
            sun: sun.map(|(plane, weight)| (&plane[tile.plane_at..tile.plane_at + 3 * n], weight)),
        };
        let [r, g, b] = &mut out.0;
        kernel.reconstruct(&job, [&mut r[..n], &mut g[..n], &mut b[..n]]);
    }

    /// Adds the residuals of the patches that outshine the sky to reconstructed values of tile number `index`.
    pub fn add_residuals(
        residuals: &Residuals<'_>,
        (index, tile): (usize, &Tile<'_>),
        standouts: &[Standout],
        kernel: Kernel,
        out: &mut LinearTile,
    ) {
        let n = tile.padded_pixels();
        for standout in standouts {
            if let Some(residual) = residuals.get(index, tile, usize::from(standout.patch)) {
                let [r, g, b] = &mut out.0;
                kernel.add_residual(&residual.term(standout.light, n), [&mut r[..n], &mut g[..n], &mut b[..n]]);
            }
        }
    }

    /// A bound on how far any linear value (1/2^20 of display white) of a tile moves from `drawn` to `self`:
    /// |U| <= 127, row scales < 2^16, and rounding of both pictures.
    pub fn change_bound(&self, drawn: &Coefficients) -> f32 {
        (0..3).map(|c| self.channel_change_bound(drawn, c)).fold(0.0, f32::max)
    }

    fn channel_change_bound(&self, drawn: &Coefficients, c: usize) -> f32 {
        let unit = |x: &Coefficients| libm::scalbnf(1.0, i32::from(x.left[c]) - i32::from(x.right[c]));
        let (new_unit, old_unit) = (unit(self), unit(drawn));
        let pairs = self.rank().max(drawn.rank()) / 2;
        let mut sum = 0.0f32;
        for (&new, &old) in self.pairs[c][..pairs].iter().zip(&drawn.pairs[c][..pairs]) {
            let term = |new: i32, old: i32| (new as f32 * new_unit - old as f32 * old_unit).abs();
            sum += term(i32::from(new as i16), i32::from(old as i16)) + term(new >> 16, old >> 16);
        }
        if sum == 0.0 { 0.0 } else { sum * (127.0 * 65535.0 * 1.0001) + 1.0 }
    }
}

fn rounding_shift(value: i64, by: u32) -> i64 {
    if by == 0 { value } else { (value + (1 << (by - 1))) >> by }
}

/// Linear values of one tile, `[channel][covered pixel]` in 1/2^20 of display white, premultiplied by coverage.
#[derive(Clone, Debug)]
pub struct LinearTile(pub [[i32; TILE_PIXELS]; 3]);

impl LinearTile {
    /// All zero.
    pub const fn new() -> Self {
        LinearTile([[0; TILE_PIXELS]; 3])
    }

    /// RGB of the covered pixel number `x` of the tile.
    pub fn rgb(&self, x: usize) -> [i32; 3] {
        [self.0[0][x], self.0[1][x], self.0[2][x]]
    }
}

impl Default for LinearTile {
    fn default() -> Self {
        Self::new()
    }
}
