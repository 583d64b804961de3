//! Rounding of the factors: `U` to int8, `V` fitted to the rounded `U` and rounded with feedback, rows scaled anew.

use super::Rows;
use super::subspace::Factors;
use crate::prior::Prior;
use nalgebra::{DMatrix, DVector};

/// `V` of one channel.
pub(crate) struct Planes {
    /// `[rank][patch]`.
    pub(crate) codes: Vec<i8>,
    /// `[rank]`.
    pub(crate) scale: Vec<f32>,
}

const TOP: f32 = 127.0;

/// The first `rank` factors rounded: `U` as `[pixel][rank]`, and the channels' `V`.
pub(crate) fn round_factors(rows: &Rows, factors: &Factors, rank: usize, prior: &Prior) -> (Vec<i8>, [Planes; 3]) {
    let codes = round_left(rows, factors, rank);
    let planes = [0, 1, 2].map(|channel| {
        let fitted = fit_planes(rows, &codes, channel);
        round_planes(&fitted, prior)
    });
    let u = codes.transpose().iter().map(|&code| code as i8).collect();
    (u, planes)
}

/// `U` in whole numbers, pixels x rank. A pixel's scale is free, so it is chosen to make its first code whole.
fn round_left(rows: &Rows, factors: &Factors, rank: usize) -> DMatrix<f32> {
    let mut left = factors.left.columns(0, rank).into_owned();
    for (pixel, mut row) in left.row_iter_mut().enumerate() {
        let counted = &rows.importance[pixel * 3..pixel * 3 + 3];
        let importance = counted.iter().map(|i| i * i).sum::<f64>().sqrt() as f32;
        row *= if importance > 0.0 { 1.0 / importance } else { 0.0 };
    }
    let first_step = left.column(0).amax() / TOP;
    for mut row in left.row_iter_mut() {
        let code = row[0] / first_step;
        // Below half the range the first code is too coarse to steer the others by.
        if code.abs() > 0.5 * TOP {
            row *= code.round() / code;
        }
    }
    for mut column in left.column_iter_mut() {
        let step = column.amax() / TOP;
        column.apply(|value| *value = if step > 0.0 { (*value / step).round() } else { 0.0 });
    }
    left
}

/// Least squares for one channel's `V` given the whole-number `U`: patches x rank.
fn fit_planes(rows: &Rows, codes: &DMatrix<f32>, channel: usize) -> DMatrix<f32> {
    let rank = codes.ncols();
    let of = |pixel: usize| (rows.importance[pixel * 3 + channel], rows.rms[pixel * 3 + channel]);
    let counted = DMatrix::from_fn(codes.nrows(), rank, |p, k| f64::from(codes[(p, k)]) * of(p).0);
    let mut normal = counted.transpose() * &counted;
    let ridge = 1e-9 * normal.trace().max(1e-30);
    (0..rank).for_each(|k| normal[(k, k)] += ridge);
    let scaled = DMatrix::from_fn(codes.nrows(), rank, |p, k| {
        let (importance, rms) = of(p);
        if rms > 0.0 { (f64::from(codes[(p, k)]) * importance * importance / rms) as f32 } else { 0.0 }
    });
    let response = rows.response.columns_with_step(channel, rows.pixels(), 2);
    let target = response * scaled;
    match normal.cholesky().map(|c| c.inverse()) {
        Some(inverse) => (target.map(f64::from) * inverse).map(|v| v as f32),
        None => DMatrix::zeros(target.nrows(), rank),
    }
}

/// Rounds `V` (patches x rank) so that what each rounding costs under the prior is made up for by the later patches
/// (Frantar et al. 2022, GPTQ).
fn round_planes(planes: &DMatrix<f32>, prior: &Prior) -> Planes {
    let patches = planes.nrows();
    let feedback = prior.feedback();
    let mut codes = vec![0i8; planes.len()];
    let mut scale = vec![0.0f32; planes.ncols()];
    for (k, column) in planes.column_iter().enumerate() {
        let step = column.amax() / TOP;
        if !(step > 0.0 && step.is_finite()) {
            continue;
        }
        scale[k] = step;
        let mut wanted: DVector<f32> = column / step;
        for patch in 0..patches {
            let code = wanted[patch].round().clamp(-TOP, TOP);
            codes[k * patches + patch] = code as i8;
            let off = wanted[patch] - code;
            let made_up = feedback.column(patch);
            wanted.rows_range_mut(patch..).axpy(-off, &made_up.rows_range(patch..), 1.0);
        }
    }
    Planes { codes, scale }
}

/// One channel of a tile in the prior's basis, rows unscaled: modes x pixels.
pub(crate) fn shown(u: &[i8], codes: &[i8], scale: &[f32], rank: usize, prior: &Prior) -> DMatrix<f32> {
    let patches = prior.patches();
    let planes = DMatrix::from_fn(patches, rank, |patch, k| f32::from(codes[k * patches + patch]) * scale[k]);
    let left = DMatrix::from_fn(rank, u.len() / rank, |k, pixel| f32::from(u[pixel * rank + k]));
    (prior.basis_transposed() * planes) * left
}

/// The row scales that fit best under the prior, given the rounded factors.
pub(crate) fn fit_rows(rows: &Rows, u: &[i8], planes: &[Planes; 3], rank: usize, prior: &Prior) -> Vec<[f32; 3]> {
    let mut scales = vec![[0.0f32; 3]; rows.pixels()];
    for (channel, plane) in planes.iter().enumerate() {
        let shown = shown(u, &plane.codes, &plane.scale, rank, prior);
        for (pixel, scale) in scales.iter_mut().enumerate() {
            let index = pixel * 3 + channel;
            let (dot, square) = (shown.column(pixel).dot(&rows.seen.column(index)), shown.column(pixel).norm_squared());
            if rows.rms[index] > 0.0 && square > 0.0 {
                scale[channel] = (dot / square).max(0.0);
            }
        }
    }
    scales
}
