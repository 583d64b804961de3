//! Leading left singular vectors of a matrix by block power iteration (Halko, Martinsson, Tropp 2011, section 4.5).

use nalgebra::{DMatrix, SymmetricEigen};

use crate::random::Random;

/// Columns beyond the wanted ones, for the accuracy of the last.
const OVERSAMPLING: usize = 4;
const POWER_STEPS: usize = 4;

/// The fewest orthonormal columns, at most `most`, that leave a relative error (Frobenius) of at most `error`.
pub(crate) fn leading_vectors(matrix: &DMatrix<f32>, most: usize, error: f32) -> DMatrix<f32> {
    let rows = matrix.nrows();
    let gram = matrix * matrix.transpose();
    let block = (most + OVERSAMPLING).min(rows);
    let mut random = Random::new(block as u64);
    let mut basis = DMatrix::from_fn(rows, block, |_, _| random.normal() as f32);
    for _ in 0..POWER_STEPS {
        basis = (&gram * basis).qr().q();
    }
    let small = (basis.transpose() * &gram * &basis).map(f64::from);
    let eigen = SymmetricEigen::new(0.5 * (&small + small.transpose()));
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let whole = f64::from(gram.trace());
    let (mut rest, mut rank) = (whole, 0);
    while rank < most.min(order.len()) && (rank == 0 || rest > f64::from(error * error) * whole) {
        rest -= eigen.eigenvalues[order[rank]];
        rank += 1;
    }
    let turn = DMatrix::from_fn(order.len(), rank, |row, column| eigen.eigenvectors[(row, order[column])] as f32);
    basis * turn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_as_the_error_asks_for() {
        // Three orthogonal rank-one parts of strengths 10, 1 and 0.1.
        let part = |k: usize, strength: f32| {
            let wave = |n: usize, length: usize| {
                move |at: usize| (std::f32::consts::PI * n as f32 * (at as f32 + 0.5) / length as f32).cos()
            };
            let (left, right) = (wave(k, 20), wave(k + 1, 31));
            DMatrix::from_fn(20, 31, |row, column| strength * left(row) * right(column))
        };
        let matrix = part(1, 10.0) + part(2, 1.0) + part(3, 0.1);
        for (error, rank) in [(0.2, 1), (0.05, 2), (0.001, 3)] {
            let vectors = leading_vectors(&matrix, 8, error);
            assert_eq!(vectors.ncols(), rank);
            let rest = &matrix - &vectors * (vectors.transpose() * &matrix);
            assert!(rest.norm() <= error * matrix.norm());
        }
        assert_eq!(leading_vectors(&matrix, 2, 0.0).ncols(), 2);
    }
}
