//! Nonlinear least squares for a dozen parameters at most: Levenberg-Marquardt on dense normal equations.
//!
//! Marquardt 1963, *An algorithm for least-squares estimation of nonlinear parameters*; derivatives by central differences.

/// A square matrix, by rows.
pub type Matrix = Vec<Vec<f64>>;

/// Rounds until the search is given up; few need more than ten.
const MAX_ROUNDS: usize = 60;
/// The sum of squares has settled when a round takes off less than this share.
const SETTLED: f64 = 1e-10;

/// Where the sum of squares is least.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The parameters.
    pub parameters: Vec<f64>,
    /// Sum of squared residuals.
    pub cost: f64,
    /// Inverse of J^T J: the parameters' covariance when residuals are in units of their standard deviation.
    pub covariance: Matrix,
}

/// Finds the least sum of squared residuals near `start`; `steps` are the parameters' steps for derivatives.
///
/// `residuals` gives the same number of values for every parameter vector, or none where the model is not defined. The
/// result is none when it is not defined at the start, or when the residuals leave a parameter undetermined.
pub fn minimise(start: &[f64], steps: &[f64], residuals: impl Fn(&[f64]) -> Option<Vec<f64>>) -> Option<Solution> {
    let mut at = start.to_vec();
    let mut found = residuals(&at)?;
    let mut cost = sum_of_squares(&found);
    let mut damping = 1e-3;
    for _ in 0..MAX_ROUNDS {
        let (normal, gradient) = normal_equations(&at, steps, &found, &residuals)?;
        let mut gained = 0.0;
        while damping < 1e12 {
            let step = cholesky(&damped(&normal, damping)).map(|factor| solve(&factor, &gradient));
            let trial: Option<Vec<f64>> = step.map(|step| at.iter().zip(step).map(|(a, s)| a - s).collect());
            let tried = trial.and_then(|trial| residuals(&trial).map(|found| (trial, found)));
            if let Some((trial, trial_residuals)) = tried
                && sum_of_squares(&trial_residuals) < cost
            {
                gained = cost - sum_of_squares(&trial_residuals);
                (at, found) = (trial, trial_residuals);
                damping = (damping / 9.0).max(1e-12);
                break;
            }
            damping *= 11.0;
        }
        cost = sum_of_squares(&found);
        if gained <= SETTLED * cost {
            break;
        }
    }
    let (normal, _) = normal_equations(&at, steps, &found, &residuals)?;
    Some(Solution { covariance: inverse(&normal)?, parameters: at, cost })
}

fn sum_of_squares(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum()
}

/// J^T J and J^T r.
fn normal_equations(
    at: &[f64],
    steps: &[f64],
    found: &[f64],
    residuals: &impl Fn(&[f64]) -> Option<Vec<f64>>,
) -> Option<(Matrix, Vec<f64>)> {
    let count = at.len();
    let shifted = |index: usize, by: f64| {
        let mut near = at.to_vec();
        near[index] += by;
        residuals(&near)
    };
    let column = |index: usize| {
        let (low, high) = (shifted(index, -steps[index])?, shifted(index, steps[index])?);
        Some(high.iter().zip(low).map(|(h, l)| (h - l) / (2.0 * steps[index])).collect::<Vec<f64>>())
    };
    let columns: Vec<Vec<f64>> = (0..count).map(column).collect::<Option<_>>()?;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let normal = columns.iter().map(|a| columns.iter().map(|b| dot(a, b)).collect()).collect();
    Some((normal, columns.iter().map(|a| dot(a, found)).collect()))
}

fn damped(normal: &Matrix, damping: f64) -> Matrix {
    let mut matrix = normal.clone();
    for (i, row) in matrix.iter_mut().enumerate() {
        row[i] *= 1.0 + damping;
    }
    matrix
}

/// The lower triangular factor of a positive definite matrix; none if it is not (relative to its diagonal).
fn cholesky(matrix: &Matrix) -> Option<Matrix> {
    let count = matrix.len();
    let mut factor = vec![vec![0.0; count]; count];
    for i in 0..count {
        for j in 0..=i {
            let rest = matrix[i][j] - (0..j).map(|k| factor[i][k] * factor[j][k]).sum::<f64>();
            if i > j {
                factor[i][j] = rest / factor[j][j];
            } else if rest > 1e-14 * matrix[i][i] {
                factor[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(factor)
}

/// Solves L L^T x = b.
fn solve(factor: &Matrix, b: &[f64]) -> Vec<f64> {
    let count = b.len();
    let mut x = b.to_vec();
    for i in 0..count {
        x[i] = (x[i] - (0..i).map(|k| factor[i][k] * x[k]).sum::<f64>()) / factor[i][i];
    }
    for i in (0..count).rev() {
        x[i] = (x[i] - (i + 1..count).map(|k| factor[k][i] * x[k]).sum::<f64>()) / factor[i][i];
    }
    x
}

/// Inverse of a positive definite matrix.
fn inverse(matrix: &Matrix) -> Option<Matrix> {
    let factor = cholesky(matrix)?;
    let unit = |i: usize| (0..matrix.len()).map(|j| f64::from(u8::from(i == j))).collect::<Vec<f64>>();
    Some((0..matrix.len()).map(|i| solve(&factor, &unit(i))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_has_its_textbook_solution_and_covariance() {
        // y = 1 + 2 x at x = 0..=4 with errors that sum to nothing against 1 and x.
        let data = [(0.0, 1.1), (1.0, 2.8), (2.0, 5.0), (3.0, 7.2), (4.0, 8.9)];
        let found =
            minimise(&[0.0, 0.0], &[1e-3, 1e-3], |p| Some(data.iter().map(|(x, y)| p[0] + p[1] * x - y).collect()))
                .unwrap();
        assert!((found.parameters[0] - 1.0).abs() < 1e-8 && (found.parameters[1] - 2.0).abs() < 1e-8, "{found:?}");
        // (X^T X)^-1 = [[5, 10], [10, 30]]^-1 = [[0.6, -0.2], [-0.2, 0.1]].
        let expected = [[0.6, -0.2], [-0.2, 0.1]];
        assert!((0..2).all(|i| (0..2).all(|j| (found.covariance[i][j] - expected[i][j]).abs() < 1e-9)));
    }

    #[test]
    fn rosenbrocks_valley_is_walked_to_its_end() {
        let found =
            minimise(&[-1.2, 1.0], &[1e-6, 1e-6], |p| Some(vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]])).unwrap();
        assert!((found.parameters[0] - 1.0).abs() < 1e-6 && found.cost < 1e-12, "{found:?}");
    }

    #[test]
    fn what_is_undetermined_or_undefined_gives_nothing() {
        assert_eq!(minimise(&[1.0, 1.0], &[1e-3, 1e-3], |p| Some(vec![p[0] + p[1], 2.0 * (p[0] + p[1])])), None);
        assert_eq!(minimise(&[1.0], &[1e-3], |_| None), None);
    }
}
