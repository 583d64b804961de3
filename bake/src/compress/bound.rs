//! How wrong a block may be under any light: the constants of the run-time bound (firmware/src/bound.rs).
//!
//! For every pixel and channel the error under weights `w` is `e . w`, with `e` what the factors leave out. Split over
//! the leading modes of the prior and, for what these leave, groups of neighbouring patches, it is at most
//! `sqrt(sum_d m_d a_d^2)` whenever `sum_d F_d^2 / m_d <= 1`, with `F_d` the norms of `e`'s parts and `a_d` those of
//! `w`'s (Cauchy-Schwarz). `m` is the axis-aligned ellipsoid that holds all pixels of the block and is smallest under
//! the prior, found by multiplicative weights (Titterington 1976), rounded up, and scaled until the worst pixel fits.

use super::Compressed;
use crate::prior::Prior;
use nalgebra::{DMatrix, DMatrixView};
use relume_firmware::bound::{AXIS, BOUND_MODES, DARK_POWER, GROUP};

/// Constants of one block; shapes as in firmware/src/bound.rs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockBound {
    /// Plain and weighted by darkness, per channel.
    pub scale: [[f32; 3]; 2],
    /// Largest sum of a pixel's response over the patches, plain and weighted, per channel.
    pub reach: [[f32; 3]; 2],
    /// Plain and weighted, per channel: one code per dimension.
    pub codes: [[Vec<u8>; 3]; 2],
}

/// The leading modes of a prior, orthonormal, patches x modes.
pub fn bound_basis(prior: &Prior) -> DMatrix<f32> {
    let modes = BOUND_MODES.min(prior.modes());
    let mut basis = prior.basis().columns(0, modes).into_owned();
    for mut column in basis.column_iter_mut() {
        let norm = column.norm();
        column.scale_mut(if norm > 0.0 { 1.0 / norm } else { 0.0 });
    }
    basis
}

/// The constants of a block made from `response`, `[pixel][3][patch]`. `row_top` is, per pixel and channel, what a row
/// scale of 65535 means in the pixel's tile.
pub fn block_bound(
    response: &[f32],
    patches: usize,
    block: &Compressed,
    row_top: &[[f32; 3]],
    prior: &Prior,
    basis: &DMatrix<f32>,
) -> BlockBound {
    let mut left_out = DMatrixView::from_slice(response, patches, block.pixels * 3).into_owned();
    for (index, mut column) in left_out.column_iter_mut().enumerate() {
        column.iter_mut().zip(block.row(index / 3, index % 3)).for_each(|(r, shown)| *r -= shown);
    }
    let parts = squared_parts(&left_out, basis);
    let importance = importance_of(prior, basis);
    let mut bound = BlockBound::default();
    for channel in 0..3 {
        let own: Vec<Vec<f64>> = (0..block.pixels).map(|pixel| parts[pixel * 3 + channel].clone()).collect();
        let darkness = |pixel: usize| {
            let share = (block.row_scale[pixel][channel] / row_top[pixel][channel]).max(1.0 / 65535.0);
            f64::from(share).powf(-2.0 * f64::from(DARK_POWER))
        };
        let reach = |pixel: usize| {
            let row = &response[(pixel * 3 + channel) * patches..][..patches];
            row.iter().map(|&r| f64::from(r.abs())).sum::<f64>()
        };
        for pixel in 0..block.pixels {
            let plain = reach(pixel) * 1.001;
            for (kind, reach) in [plain, plain * darkness(pixel).sqrt()].into_iter().enumerate() {
                bound.reach[kind][channel] = bound.reach[kind][channel].max(reach as f32);
            }
        }
        let weighted: Vec<Vec<f64>> =
            own.iter().enumerate().map(|(x, f)| f.iter().map(|v| v * darkness(x)).collect()).collect();
        for (kind, points) in [own, weighted].iter().enumerate() {
            let (codes, scale) = ellipsoid(points, &importance);
            bound.codes[kind][channel] = codes;
            bound.scale[kind][channel] = scale;
        }
    }
    bound
}

/// Per column of `left_out` (patches x rows) its squared parts: per mode, then per group of patches what the modes leave.
fn squared_parts(left_out: &DMatrix<f32>, basis: &DMatrix<f32>) -> Vec<Vec<f64>> {
    let along = basis.transpose() * left_out;
    let rest = left_out - basis * &along;
    let square = |v: &f32| f64::from(*v) * f64::from(*v);
    along
        .column_iter()
        .zip(rest.column_iter())
        .map(|(along, rest)| {
            let groups = rest.as_slice().chunks(GROUP).map(|group| group.iter().map(square).sum());
            along.iter().map(square).chain(groups).collect()
        })
        .collect()
}

/// Mean square of the weights' part in each dimension under the prior.
fn importance_of(prior: &Prior, basis: &DMatrix<f32>) -> Vec<f64> {
    let (modes, patches) = (basis.ncols(), prior.patches());
    let square = |v: f32| f64::from(v) * f64::from(v);
    let along = (0..modes).map(|k| f64::from(prior.basis().column(k).norm_squared()));
    let left = |patch: usize| (modes..prior.modes()).map(|k| square(prior.basis()[(patch, k)])).sum::<f64>();
    let groups = (0..patches.div_ceil(GROUP))
        .map(|group| (group * GROUP..((group + 1) * GROUP).min(patches)).map(|patch| left(patch) + ROUGHNESS).sum());
    along.chain(groups).collect()
}

/// Mean square that real skies have beyond the prior's modes, per patch, relative to the mean radiance.
const ROUGHNESS: f64 = 0.01;
const STEPS: usize = 40;

/// Codes of `m` and the factor that makes all `points` fit.
fn ellipsoid(points: &[Vec<f64>], importance: &[f64]) -> (Vec<u8>, f32) {
    let dims = importance.len();
    let mut counts = vec![1.0f64; points.len()];
    let mut m = vec![0.0f64; dims];
    for _ in 0..STEPS {
        let total: f64 = counts.iter().sum();
        m.fill(0.0);
        for (count, point) in counts.iter().zip(points) {
            m.iter_mut().zip(point).for_each(|(m, f)| *m += count / total * f);
        }
        m.iter_mut().zip(importance).for_each(|(m, weight)| *m = (*m / weight.max(1e-12)).sqrt());
        let mut top = 0.0f64;
        for (count, point) in counts.iter_mut().zip(points) {
            *count *= fit(point, &m).max(1e-12);
            top = top.max(*count);
        }
        counts.iter_mut().for_each(|count| *count = (*count / top).max(1e-9));
    }
    let largest = m.iter().fold(0.0f64, |a, &b| a.max(b));
    if largest <= 0.0 || !largest.is_finite() {
        return (vec![0; dims], 0.0);
    }
    // The largest takes the last code. No code stands for less than 1e-8 of it: it must not be zero where anything is left
    // out.
    let top = f64::from(AXIS.value(u8::MAX));
    let codes: Vec<u8> = m.iter().map(|m| AXIS.code(((m / largest).max(1e-8) * top) as f32)).collect();
    let rounded: Vec<f64> = codes.iter().map(|&code| f64::from(AXIS.value(code))).collect();
    let worst = points.iter().map(|point| fit(point, &rounded)).fold(0.0f64, f64::max);
    (codes, (worst * 1.0001) as f32)
}

fn fit(point: &[f64], m: &[f64]) -> f64 {
    point.iter().zip(m).map(|(f, m)| if *m > 0.0 { f / m } else { 0.0 }).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_lies_in_its_ellipsoid() {
        let points: Vec<Vec<f64>> =
            (0..200).map(|k| (0..12).map(|d| ((k * 37 + d * 11) % 23) as f64 * (d as f64 + 1.0)).collect()).collect();
        let importance: Vec<f64> = (0..12).map(|d| 1.0 / (1.0 + d as f64)).collect();
        let (codes, scale) = ellipsoid(&points, &importance);
        for point in &points {
            let m: Vec<f64> = codes.iter().map(|&c| f64::from(AXIS.value(c)) * f64::from(scale)).collect();
            assert!(fit(point, &m) <= 1.0);
        }
        assert_eq!(ellipsoid(&[vec![0.0; 4]], &[1.0; 4]), (vec![0; 4], 0.0));
    }

    /// One point: the best ellipsoid is known, `m_d ~ F_d`, and a light of that shape meets it with equality.
    #[test]
    fn an_ellipsoid_around_one_point_is_tight() {
        let point: Vec<f64> = (0..12).map(|d| 4f64.powi(-d)).collect();
        let (codes, scale) = ellipsoid(std::slice::from_ref(&point), &[1.0; 12]);
        let bound: f64 = codes.iter().map(|&code| f64::from(AXIS.value(code)) * f64::from(scale)).sum();
        let best = point.iter().map(|f| f.sqrt()).sum::<f64>().powi(2);
        assert!(bound >= best && bound < 1.15 * best, "{bound} {best}");
    }
}
