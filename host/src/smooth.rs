//! A smooth sky fitted to some patches, for those that were not seen.

use relume_firmware::patches::PatchSet;

const TERMS: usize = 9;

/// Real spherical harmonics up to order 2, not normalised.
fn harmonics([x, y, z]: [f32; 3]) -> [f64; TERMS] {
    let [x, y, z] = [x, y, z].map(f64::from);
    [1.0, x, y, z, x * y, y * z, x * z, 3.0 * y * y - 1.0, x * x - z * z]
}

/// Solves `a x = b` (symmetric, made definite by its diagonal) for three right-hand sides; Gauss with pivoting.
fn solve(mut a: [[f64; TERMS]; TERMS], mut b: [[f64; 3]; TERMS]) -> [[f64; 3]; TERMS] {
    for col in 0..TERMS {
        let pivot = (col..TERMS).max_by(|&i, &j| a[i][col].abs().total_cmp(&a[j][col].abs())).unwrap_or(col);
        a.swap(col, pivot);
        b.swap(col, pivot);
        for row in col + 1..TERMS {
            let factor = a[row][col] / a[col][col];
            let (left, right) = (a[col], b[col]);
            a[row] = std::array::from_fn(|k| a[row][k] - factor * left[k]);
            b[row] = std::array::from_fn(|k| b[row][k] - factor * right[k]);
        }
    }
    for row in (0..TERMS).rev() {
        b[row] = std::array::from_fn(|k| {
            let known: f64 = (row + 1..TERMS).map(|j| a[row][j] * b[j][k]).sum();
            (b[row][k] - known) / a[row][row]
        });
    }
    b
}

/// Fills the `missing` patches from a smooth sky fitted to the `known` ones, kept within the range of the known.
pub fn fill(set: &PatchSet, radiance: &mut [[f32; 3]], known: &[usize], missing: &[usize]) {
    if known.is_empty() {
        return;
    }
    let (mut a, mut b) = ([[0.0; TERMS]; TERMS], [[0.0; 3]; TERMS]);
    let (mut low, mut high) = ([f32::INFINITY; 3], [0.0f32; 3]);
    for &patch in known {
        let (basis, value) = (harmonics(set.dir_world(patch)), radiance[patch]);
        for i in 0..TERMS {
            for j in 0..TERMS {
                a[i][j] += basis[i] * basis[j];
            }
            for k in 0..3 {
                b[i][k] += basis[i] * f64::from(value[k]);
            }
        }
        low = std::array::from_fn(|k| low[k].min(value[k]));
        high = std::array::from_fn(|k| high[k].max(value[k]));
    }
    // Few or one-sided patches leave shapes undetermined; those stay flat.
    for (i, row) in a.iter_mut().enumerate() {
        row[i] += if i == 0 { 1e-9 } else { 1e-3 * known.len() as f64 };
    }
    let fit = solve(a, b);
    for &patch in missing {
        let basis = harmonics(set.dir_world(patch));
        radiance[patch] = std::array::from_fn(|k| {
            let value: f64 = (0..TERMS).map(|i| basis[i] * fit[i][k]).sum();
            (value as f32).clamp(low[k], high[k])
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_sky_is_completed() {
        let set = PatchSet::new(256).unwrap();
        let sky = |d: [f32; 3]| [2.0, 1.0 + 0.5 * d[1], 1.5 + 0.4 * d[0] * d[1]];
        let mut radiance: Vec<[f32; 3]> = (0..set.upper()).map(|p| sky(set.dir_world(p))).collect();
        let (missing, known): (Vec<usize>, Vec<usize>) = (0..set.upper()).partition(|&p| set.dir_world(p)[0] > 0.7);
        missing.iter().for_each(|&p| radiance[p] = [0.0; 3]);
        fill(&set, &mut radiance, &known, &missing);
        for &patch in &missing {
            let expected = sky(set.dir_world(patch));
            for k in 0..3 {
                assert!((radiance[patch][k] - expected[k]).abs() < 0.05, "{:?} {expected:?}", radiance[patch]);
            }
        }
    }
}
