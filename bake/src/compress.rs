//! Compression of a block's response: one small integer code per pixel and rank, shared by the three channels.
//!
//! A block is up to four tiles that share one `V`. Every pixel-channel row is scaled to unit rms under the prior; the rows of red, green and blue lie side by side, so
//! that one `U` (pixels x rank) serves all three with a `V` (rank x patches) each. `U` comes from the singular value
//! decomposition weighted by the prior, is rounded to int8, and each `V` is then fitted by least squares to the rounded
//! `U`. The rank is the smallest that holds the worst pixel and the block's mean within the target, measured after
//! rounding; each tile then keeps only the leading ranks that it needs itself.

mod bound;
mod quantise;
mod subspace;
mod trim;
mod wayback;

use crate::encode::decoded_scales;
use crate::prior::Prior;
pub use bound::{BlockBound, block_bound, bound_basis};
use nalgebra::{DMatrix, DMatrixView};
use quantise::{fit_rows, round_factors};
use subspace::Factors;
pub use wayback::{PatchRows, Whites, tile_rows};

/// How far a compressed tile may be from the response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Relative error (rms under the prior) that a pixel at the picture's bright end ([`crate::brightness`]) may have. Darker
    /// pixels may have more, by the square root of their brightness.
    pub error: f64,
    /// Largest rank; at most 96.
    pub max_rank: usize,
}

impl Default for Target {
    fn default() -> Self {
        Target { error: 0.008, max_rank: MAX_RANK }
    }
}

/// Largest rank a tile can have.
pub const MAX_RANK: usize = 96;

/// The response of some pixels as int8 factors:
/// `response[x][c][i] ~ row_scale[x][c] * sum_(k < ranks[x]) u[x][k] * v[c][k][i] * v_scale[c][k]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Compressed {
    /// Pixels (rows).
    pub pixels: usize,
    /// Rank: 0 when the response is black, else even.
    pub rank: usize,
    /// `[pixel][rank]`, -127..=127.
    pub u: Vec<i8>,
    /// Per channel `[rank][patch]`, -127..=127.
    pub v: [Vec<i8>; 3],
    /// Per channel `[rank]`.
    pub v_scale: [Vec<f32>; 3],
    /// `[pixel]`, per channel; 0 where the response is black.
    pub row_scale: Vec<[f32; 3]>,
    /// `[pixel]`: ranks that the pixel's tile needs, even, at most `rank`.
    pub ranks: Vec<usize>,
}

impl Compressed {
    fn black(pixels: usize) -> Self {
        Compressed {
            pixels,
            rank: 0,
            u: Vec::new(),
            v: Default::default(),
            v_scale: Default::default(),
            row_scale: vec![[0.0; 3]; pixels],
            ranks: vec![0; pixels],
        }
    }

    /// One pixel-channel row of the response as the factors tell it, `[patch]`; empty when all is black.
    pub fn row(&self, pixel: usize, channel: usize) -> Vec<f32> {
        let patches = self.v[channel].len().checked_div(self.rank).unwrap_or(0);
        let codes = &self.u[pixel * self.rank..][..self.ranks[pixel]];
        let mut row = vec![0.0; patches];
        for (k, &code) in codes.iter().enumerate() {
            let factor = self.row_scale[pixel][channel] * f32::from(code) * self.v_scale[channel][k];
            let plane = &self.v[channel][k * patches..(k + 1) * patches];
            row.iter_mut().zip(plane).for_each(|(r, &v)| *r += factor * f32::from(v));
        }
        row
    }
}

/// How strongly a darker row counts, as a power of its brightness: between the linear error (1) and the error in sRGB
/// codes (about 0.42).
const DARK_POWER: f64 = 0.5;
/// No row that is lit at all counts less than this.
const DARK_FLOOR: f64 = 0.05;
/// The tile's rms residual may reach this share of the worst pixel's.
const MEAN_SHARE: f64 = 0.5;

/// A tile's rows in the prior's basis, scaled, and how much each counts.
pub(crate) struct Rows<'a> {
    /// The response, patches x (pixels * 3): one column per pixel and channel.
    response: DMatrixView<'a, f32>,
    /// The response in the prior's basis, modes x (pixels * 3).
    seen: DMatrix<f32>,
    /// Rms of each column under the prior; 0 for black ones.
    rms: Vec<f64>,
    /// How much each column counts, 0..=1; 0 for black ones.
    importance: Vec<f64>,
}

impl<'a> Rows<'a> {
    fn new(response: &'a [f32], patches: usize, prior: &Prior) -> Self {
        let columns = response.len().checked_div(patches).unwrap_or(0) / 3 * 3;
        let response = DMatrixView::from_slice(&response[..columns * patches], patches, columns);
        let seen = prior.basis_transposed() * response;
        let mut rms: Vec<f64> = seen.column_iter().map(|column| f64::from(column.norm())).collect();
        let brightest = rms.iter().copied().fold(0.0, f64::max);
        // Where a channel is this far below the tile's brightest, no display shows it.
        rms.iter_mut().filter(|r| r.is_nan() || **r <= 1e-7 * brightest).for_each(|r| *r = 0.0);
        let importance = rms
            .iter()
            .map(|&r| if r > 0.0 { (r / prior.white()).powf(DARK_POWER).clamp(DARK_FLOOR, 1.0) } else { 0.0 })
            .collect();
        Rows { response, seen, rms, importance }
    }

    fn pixels(&self) -> usize {
        self.rms.len() / 3
    }

    /// Rows scaled to their importance, (3 * modes) x pixels.
    fn weighted(&self) -> DMatrix<f32> {
        let mut weighted = self.seen.clone();
        for (index, mut column) in weighted.column_iter_mut().enumerate() {
            column *= if self.rms[index] > 0.0 { (self.importance[index] / self.rms[index]) as f32 } else { 0.0 };
        }
        weighted.reshape_generic(nalgebra::Dyn(self.seen.nrows() * 3), nalgebra::Dyn(self.pixels()))
    }
}

/// Residuals of a tile, counted by importance: the worst pixel's and the rms over pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Residual {
    worst: f64,
    mean: f64,
}

impl Residual {
    /// From each pixel's squared residual, summed over the channels.
    fn of(squares: impl Iterator<Item = f64>) -> Self {
        let (mut worst, mut sum, mut count) = (0.0f64, 0.0, 0usize);
        for square in squares {
            worst = worst.max(square / 3.0);
            sum += square / 3.0;
            count += 1;
        }
        Residual { worst: worst.sqrt(), mean: (sum / count.max(1) as f64).sqrt() }
    }

    fn within(&self, target: &Target) -> bool {
        self.worst <= target.error && self.mean <= MEAN_SHARE * target.error
    }
}

/// Compresses a tile's response, `[pixel][3][patch]`, for the skies of a prior.
///
/// The rank grows until the target holds or `max_rank` is reached; the same input gives the same bytes.
pub fn compress(response: &[f32], patches: usize, prior: &Prior, target: &Target) -> Compressed {
    let pixels = response.len().checked_div(3 * patches).unwrap_or(0);
    compress_block(response, patches, &[pixels], prior, target)
}

/// The same for a block whose tiles have `tile_pixels` pixels, one after the other in `response`: each tile keeps the
/// ranks that it needs. Scales are such as the field can hold.
pub fn compress_block(
    response: &[f32],
    patches: usize,
    tile_pixels: &[usize],
    prior: &Prior,
    target: &Target,
) -> Compressed {
    let rows = Rows::new(response, patches, prior);
    let pixels = rows.pixels();
    if patches != prior.patches() || rows.rms.iter().all(|&r| r == 0.0) {
        return Compressed::black(pixels);
    }
    let limit = even(pixels.min(3 * prior.modes())).min(target.max_rank.min(MAX_RANK) & !1).max(2);
    let weighted = rows.weighted();
    let factors = Factors::until(&weighted, limit, |residual| residual.within(target));
    let mut rank = factors.rank_for(|residual| residual.within(target)).clamp(2, limit);
    loop {
        let tile = encode(&rows, &factors, rank, prior);
        // Rounding costs a little more than truncation alone; a step or two more rank pays for it.
        if rank + 2 > limit.min(factors.rank()) || residual_of(&rows, &tile, prior).within(target) {
            return finish(&rows, tile, tile_pixels, prior, target);
        }
        rank += 2;
    }
}

fn even(rank: usize) -> usize {
    rank.next_multiple_of(2)
}

/// Leaves each tile the ranks it needs, and rounds all scales to what the field's 16 bits hold.
fn finish(rows: &Rows, mut block: Compressed, tile_pixels: &[usize], prior: &Prior, target: &Target) -> Compressed {
    for scales in &mut block.v_scale {
        *scales = decoded_scales(scales);
    }
    let mut first = 0;
    for &pixels in tile_pixels {
        let tile = first..first + pixels;
        trim::trim(rows, &mut block, tile.clone(), prior, target);
        for c in 0..3 {
            let scales: Vec<f32> = block.row_scale[tile.clone()].iter().map(|scale| scale[c]).collect();
            let rounded = decoded_scales(&scales);
            block.row_scale[tile.clone()].iter_mut().zip(rounded).for_each(|(scale, rounded)| scale[c] = rounded);
        }
        first = tile.end;
    }
    block
}

fn encode(rows: &Rows, factors: &Factors, rank: usize, prior: &Prior) -> Compressed {
    let (u, planes) = round_factors(rows, factors, rank, prior);
    let row_scale = fit_rows(rows, &u, &planes, rank, prior);
    let [r, g, b] = planes;
    Compressed {
        pixels: rows.pixels(),
        rank,
        u,
        v: [r.codes, g.codes, b.codes],
        v_scale: [r.scale, g.scale, b.scale],
        row_scale,
        ranks: vec![rank; rows.pixels()],
    }
}

/// The residual of a finished tile under the prior.
fn residual_of(rows: &Rows, tile: &Compressed, prior: &Prior) -> Residual {
    let mut squares = vec![0.0f64; rows.pixels()];
    for channel in 0..3 {
        let shown = quantise::shown(&tile.u, &tile.v[channel], &tile.v_scale[channel], tile.rank, prior);
        for (pixel, square) in squares.iter_mut().enumerate() {
            let index = pixel * 3 + channel;
            if rows.rms[index] > 0.0 {
                let scale = tile.row_scale[pixel][channel];
                let off = (rows.seen.column(index) - shown.column(pixel) * scale).norm();
                *square += (f64::from(off) * rows.importance[index] / rows.rms[index]).powi(2);
            }
        }
    }
    Residual::of(squares.into_iter())
}

#[cfg(test)]
mod tests;
