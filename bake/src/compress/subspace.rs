//! Leading singular vectors of a tile by block power iteration (Halko, Martinsson, Tropp 2011, section 4.5).

use super::Residual;
use crate::random::Random;
use nalgebra::{DMatrix, SymmetricEigen};

/// Columns beyond the wanted rank, for accuracy of the last ones.
const OVERSAMPLING: usize = 6;
const FIRST_BLOCK: usize = 24;
const POWER_STEPS: usize = 4;

/// `M ~ right * left^T` with `left` (pixels x rank) orthonormal, ordered by singular value.
pub(crate) struct Factors {
    /// Left factors of the pixels, pixels x rank.
    pub(crate) left: DMatrix<f32>,
    /// Residual after 2, 4, 6 ... columns.
    residuals: Vec<Residual>,
}

impl Factors {
    /// Factors of `rows` (values x pixels), as many as it takes for `enough` to hold, at most `limit`.
    pub(crate) fn until(rows: &DMatrix<f32>, limit: usize, enough: impl Fn(&Residual) -> bool) -> Factors {
        let most = rows.nrows().min(rows.ncols());
        let gram = rows.transpose() * rows;
        let mut wanted = FIRST_BLOCK.min(limit);
        let mut start = DMatrix::zeros(rows.ncols(), 0);
        loop {
            start = leading_subspace(&gram, start, (wanted + OVERSAMPLING).min(most));
            let factors = Factors::within(rows, &start, wanted.min(most));
            let done = factors.residuals.last().is_some_and(&enough);
            if done || wanted >= limit {
                return factors;
            }
            wanted = (wanted * 2).min(limit);
        }
    }

    /// Columns found.
    pub(crate) fn rank(&self) -> usize {
        self.residuals.len() * 2
    }

    /// The smallest even rank for which `enough` holds, or all there are.
    pub(crate) fn rank_for(&self, enough: impl Fn(&Residual) -> bool) -> usize {
        let steps = self.residuals.iter().position(enough).unwrap_or(self.residuals.len().saturating_sub(1));
        2 * (steps + 1)
    }

    /// The best factors whose left vectors lie in a subspace (Rayleigh-Ritz).
    fn within(rows: &DMatrix<f32>, subspace: &DMatrix<f32>, rank: usize) -> Factors {
        let block = subspace.ncols();
        let mut right = rows * subspace;
        let small = (right.transpose() * &right).map(f64::from);
        let eigen = SymmetricEigen::new(small);
        let mut order: Vec<usize> = (0..block).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let turn = DMatrix::from_fn(block, rank, |row, column| eigen.eigenvectors[(row, order[column])] as f32);
        let mut left = subspace * &turn;
        right = &right * &turn;
        let residuals = residuals_of(rows, &left, &right);
        // An odd last column is met by a zero one, so that ranks stay even.
        if rank % 2 == 1 {
            left = left.insert_column(rank, 0.0);
        }
        Factors { left, residuals }
    }
}

/// Block power iteration on the Gram matrix, from `start` filled up with random columns to `block`.
fn leading_subspace(gram: &DMatrix<f32>, start: DMatrix<f32>, block: usize) -> DMatrix<f32> {
    let known = start.ncols();
    let mut random = Random::new(block as u64);
    let mut left = start.resize_horizontally(block, 0.0);
    left.columns_mut(known, block - known).apply(|value| *value = random.normal() as f32);
    for _ in 0..POWER_STEPS {
        left = gram * &left;
        orthonormalise(&mut left);
    }
    left
}

/// Takes the columns away two by two: differences of sums of squares would lose the small residuals to rounding.
fn residuals_of(rows: &DMatrix<f32>, left: &DMatrix<f32>, right: &DMatrix<f32>) -> Vec<Residual> {
    let mut rest = rows.clone();
    let mut residuals = Vec::with_capacity(left.ncols().div_ceil(2));
    for first in (0..left.ncols()).step_by(2) {
        for k in first..(first + 2).min(left.ncols()) {
            rest.ger(-1.0, &right.column(k), &left.column(k), 1.0);
        }
        residuals.push(Residual::of(rest.column_iter().map(|column| f64::from(column.norm_squared()))));
    }
    residuals
}

/// Gram-Schmidt, twice; columns that vanish become zero. What is left of a column may be mostly rounding: any direction
/// will do, for the next power step turns it to where the response is.
fn orthonormalise(basis: &mut DMatrix<f32>) {
    for k in 0..basis.ncols() {
        let before = basis.column(k).norm();
        for _ in 0..2 {
            for j in 0..k {
                let share = basis.column(j).dot(&basis.column(k));
                let (done, mut rest) = basis.columns_range_pair_mut(j, k);
                rest.axpy(-share, &done, 1.0);
            }
        }
        let norm = basis.column(k).norm();
        let scale = if norm > 1e-9 * before && norm > 0.0 { 1.0 / norm } else { 0.0 };
        basis.column_mut(k).scale_mut(scale);
    }
}
