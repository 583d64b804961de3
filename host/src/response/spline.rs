//! A cubic B-spline on equal intervals, with a penalty on its bends, fitted through normal equations.

/// Uniform cubic B-spline basis over `low..=high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Basis {
    low: f64,
    step: f64,
    intervals: usize,
}

impl Basis {
    pub fn new(low: f64, high: f64, intervals: usize) -> Self {
        Basis { low, step: (high - low) / intervals as f64, intervals }
    }

    /// Number of coefficients.
    pub fn len(&self) -> usize {
        self.intervals + 3
    }

    /// The first of the four functions that are not 0 at `u`, and their values.
    pub fn at(&self, u: f64) -> (usize, [f64; 4]) {
        let place = ((u - self.low) / self.step).clamp(0.0, self.intervals as f64);
        let first = (place as usize).min(self.intervals - 1);
        let t = place - first as f64;
        let s = 1.0 - t;
        let values = [s * s * s, 3.0 * t * t * t - 6.0 * t * t + 4.0, 3.0 * s * s * s - 6.0 * s * s + 4.0, t * t * t];
        (first, values.map(|v| v / 6.0))
    }
}

/// A quadratic form `c' A c - 2 b' c + y`: what least squares minimises.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Normal {
    size: usize,
    a: Vec<f64>,
    b: Vec<f64>,
    y: f64,
}

impl Normal {
    pub fn new(size: usize) -> Self {
        Normal { size, a: vec![0.0; size * size], b: vec![0.0; size], y: 0.0 }
    }

    /// Adds `weight * (row . c - target)^2`; the row is given by its entries that are not 0.
    pub fn add(&mut self, row: &[(usize, f64)], target: f64, weight: f64) {
        for &(i, vi) in row {
            for &(j, vj) in row {
                self.a[i * self.size + j] += weight * vi * vj;
            }
            self.b[i] += weight * vi * target;
        }
        self.y += weight * target * target;
    }

    /// Adds `factor` times another form of the same size.
    pub fn add_form(&mut self, other: &Normal, factor: f64) {
        self.a.iter_mut().zip(&other.a).for_each(|(a, b)| *a += factor * b);
        self.b.iter_mut().zip(&other.b).for_each(|(a, b)| *a += factor * b);
        self.y += factor * other.y;
    }

    /// Adds `weight` times the squared differences of the given order between neighbours among the first `count` coefficients
    /// (Eilers & Marx 1996).
    pub fn add_bends(&mut self, count: usize, order: usize, weight: f64) {
        let mut kernel = vec![1.0];
        for _ in 0..order {
            let mut next = vec![0.0; kernel.len() + 1];
            for (i, v) in kernel.iter().enumerate() {
                next[i] -= v;
                next[i + 1] += v;
            }
            kernel = next;
        }
        for start in 0..count - order {
            let row: Vec<(usize, f64)> = kernel.iter().enumerate().map(|(i, &v)| (start + i, v)).collect();
            self.add(&row, 0.0, weight);
        }
    }

    /// The form's value at `c`.
    pub fn value(&self, c: &[f64]) -> f64 {
        let square: f64 = self.a.chunks_exact(self.size).zip(c).map(|(row, ci)| ci * dot(row, c)).sum();
        square - 2.0 * dot(&self.b, c) + self.y
    }

    /// The minimum by Cholesky's factors; none where the form has no single one.
    pub fn minimum(&self) -> Option<Vec<f64>> {
        let n = self.size;
        let mut l = self.a.clone();
        for i in 0..n {
            for j in 0..=i {
                let sum = l[i * n + j] - dot(&l[i * n..i * n + j], &l[j * n..j * n + j]);
                if i != j {
                    l[i * n + j] = sum / l[j * n + j];
                } else if sum > 1e-14 * self.a[i * n + i] && sum.is_finite() {
                    l[i * n + i] = sum.sqrt();
                } else {
                    return None;
                }
            }
        }
        let mut x = self.b.clone();
        for i in 0..n {
            x[i] = (x[i] - dot(&l[i * n..i * n + i], &x[..i])) / l[i * n + i];
        }
        for i in (0..n).rev() {
            let below: f64 = (i + 1..n).map(|j| l[j * n + i] * x[j]).sum();
            x[i] = (x[i] - below) / l[i * n + i];
        }
        Some(x)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splines_reproduce_cubics_and_sum_to_one() {
        let basis = Basis::new(-1.0, 3.0, 9);
        let cubic = |u: f64| 0.3 * u * u * u - u * u + 2.0;
        let mut form = Normal::new(basis.len());
        for i in 0..200 {
            let u = -1.0 + 0.02 * f64::from(i);
            let (first, values) = basis.at(u);
            assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let row: Vec<(usize, f64)> = (0..4).map(|k| (first + k, values[k])).collect();
            form.add(&row, cubic(u), 1.0);
        }
        let c = form.minimum().unwrap();
        assert!(form.value(&c) < 1e-12);
        let (first, values) = basis.at(1.234);
        let value: f64 = (0..4).map(|k| c[first + k] * values[k]).sum();
        assert!((value - cubic(1.234)).abs() < 1e-9);
        // Third differences of a cubic's coefficients are all alike, fourth ones are 0.
        let mut bends = Normal::new(basis.len());
        bends.add_bends(basis.len(), 4, 1.0);
        assert!(bends.value(&c) < 1e-12);
        assert!(Normal::new(4).minimum().is_none());
    }
}
