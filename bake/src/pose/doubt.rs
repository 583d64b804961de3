//! How sure a fitted camera is: covariance, and what it makes of the picture.

use super::model::{FOCAL, KAPPA, Model, PRINCIPAL, Prior, diagonal_px};
use super::points::Point;
use nalgebra::DMatrix;
use std::ops::Index;

/// Positions across and down the still at which its sureness is looked at.
const GRID: [u32; 2] = [13, 9];

/// A symmetric matrix over the moves of a [`Model`].
#[derive(Clone, Debug, PartialEq)]
pub struct Square(DMatrix<f64>);

impl Index<(usize, usize)> for Square {
    type Output = f64;

    fn index(&self, at: (usize, usize)) -> &f64 {
        &self.0[at]
    }
}

impl Square {
    /// Covariance (xx, xy, yy; px^2) of a picture position with these slopes by the moves.
    pub fn of_picture(&self, slopes: &[[f64; 2]]) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (i, a) in slopes.iter().enumerate() {
            for (j, b) in slopes.iter().enumerate() {
                let shared = self.0[(i, j)];
                sums[0] += shared * a[0] * b[0];
                sums[1] += shared * a[0] * b[1];
                sums[2] += shared * a[1] * b[1];
            }
        }
        sums
    }

    /// Moves that have this covariance, of as many independent standard normal numbers; none if it is no covariance.
    pub fn drawn(&self, normal: &[f64]) -> Option<Vec<f64>> {
        let factor = self.0.clone().cholesky()?.l();
        Some((factor * nalgebra::DVector::from_column_slice(normal)).as_slice().to_vec())
    }

    fn trace(&self, range: std::ops::Range<usize>) -> f64 {
        range.map(|index| self.0[(index, index)]).sum()
    }
}

/// Covariance of the moves around `model` when `points` have the noise `sigma_px`: the inverse of Fisher's information, the
/// prior's included, and so the bound of Cramer and Rao. None where the points leave something undetermined.
pub fn covariance(model: &Model, points: &[Point], sigma_px: f64, prior: &Prior) -> Option<Square> {
    let count = model.moves();
    let mut information = DMatrix::<f64>::zeros(count, count);
    for point in points {
        let slopes = model.slopes(point.world)?;
        for (i, a) in slopes.iter().enumerate() {
            for (j, b) in slopes.iter().enumerate() {
                information[(i, j)] += (a[0] * b[0] + a[1] * b[1]) / (sigma_px * sigma_px);
            }
        }
    }
    for index in FOCAL..count {
        information[(index, index)] += prior.sigma[index - FOCAL].powi(-2);
    }
    // Units differ by orders of magnitude: the inverse is taken of correlations.
    let scale: Vec<f64> = (0..count).map(|i| information[(i, i)].sqrt().recip()).collect();
    let scaled = DMatrix::from_fn(count, count, |i, j| information[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    let covariance = DMatrix::from_fn(count, count, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    covariance.iter().all(|value| value.is_finite()).then_some(Square(covariance))
}

/// Logarithm of the determinant; none if the matrix is no covariance.
pub fn log_determinant(covariance: &Square) -> Option<f64> {
    let factor = covariance.0.clone().cholesky()?;
    Some(factor.l_dirty().diagonal().iter().map(|value| 2.0 * value.ln()).sum())
}

/// Standard errors of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubt {
    /// Of the eye, m, all three axes together.
    pub position_m: f64,
    /// Of the orientation, degrees, all three axes together.
    pub orientation_deg: f64,
    /// Of the focal length, px.
    pub focal_px: f64,
    /// Of the principal point, px, both axes together.
    pub principal_px: f64,
    /// Of the distortion in the corners of the still, px.
    pub bend_px: f64,
    /// Of the picture of places as far away as the points, px: mean (rms) over the still.
    pub picture_px: f64,
    /// The same where it is largest.
    pub picture_worst_px: f64,
}

impl Doubt {
    /// Of a model with this covariance, whose points are `points`.
    pub fn new(model: &Model, covariance: &Square, points: &[Point]) -> Self {
        let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0f64);
        for place in places(model, points) {
            let Some(slopes) = model.slopes(place) else { continue };
            let [xx, _, yy] = covariance.of_picture(&slopes);
            sum += xx + yy;
            count += 1.0;
            worst = worst.max(xx + yy);
        }
        let diagonal = diagonal_px(model.size_px);
        let bend = (KAPPA..model.moves()).flat_map(|i| (KAPPA..model.moves()).map(move |j| covariance[(i, j)]));
        Doubt {
            position_m: model.scale_m * covariance.trace(3..6).sqrt(),
            orientation_deg: covariance.trace(0..3).sqrt().to_degrees(),
            focal_px: model.focal_px * covariance[(FOCAL, FOCAL)].sqrt(),
            principal_px: diagonal * covariance.trace(PRINCIPAL..KAPPA).sqrt(),
            bend_px: 0.5 * diagonal * bend.sum::<f64>().max(0.0).sqrt(),
            picture_px: (sum / f64::max(count, 1.0)).sqrt(),
            picture_worst_px: worst.sqrt(),
        }
    }
}

/// Places all over the still, as near as the nearest of the points, as far as the farthest, and between.
pub fn places(model: &Model, points: &[Point]) -> Vec<glam::DVec3> {
    let distances = model.distances_m(points);
    let [width, height] = model.size_px.map(f64::from);
    let mut all = Vec::new();
    let depths = [distances.first(), distances.get(distances.len() / 2), distances.last()];
    for row in 0..GRID[1] {
        for column in 0..GRID[0] {
            let at = |index: u32, of: u32, side: f64| side * f64::from(index) / f64::from(of - 1);
            let position_px = [at(column, GRID[0], width), at(row, GRID[1], height)];
            let Some(dir) = model.dir_world(position_px) else { continue };
            all.extend(depths.into_iter().flatten().map(|distance| model.stand.eye + dir * *distance));
        }
    }
    all
}
