//! Small systems of linear equations, without allocation.

/// Solves `a x = b` for `K` right-hand sides by Gauss with pivoting; of a singular system the solution is not finite.
pub fn solve<const N: usize, const K: usize>(mut a: [[f64; N]; N], mut b: [[f64; K]; N]) -> [[f64; K]; N] {
    for col in 0..N {
        let pivot = (col..N).max_by(|&i, &j| a[i][col].abs().total_cmp(&a[j][col].abs())).unwrap_or(col);
        a.swap(col, pivot);
        b.swap(col, pivot);
        for row in col + 1..N {
            let factor = a[row][col] / a[col][col];
            let (left, right) = (a[col], b[col]);
            a[row] = std::array::from_fn(|k| a[row][k] - factor * left[k]);
            b[row] = std::array::from_fn(|k| b[row][k] - factor * right[k]);
        }
    }
    for row in (0..N).rev() {
        b[row] = std::array::from_fn(|k| {
            let known: f64 = (row + 1..N).map(|j| a[row][j] * b[j][k]).sum();
            (b[row][k] - known) / a[row][row]
        });
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_by_hand() {
        // 2y = 4, x + y = 3 needs its rows exchanged.
        assert_eq!(solve([[0.0, 2.0], [1.0, 1.0]], [[4.0, 2.0], [3.0, 0.0]]), [[1.0, -1.0], [2.0, 1.0]]);
        assert!(!solve([[1.0, 2.0], [2.0, 4.0]], [[1.0], [3.0]])[1][0].is_finite());
    }
}
