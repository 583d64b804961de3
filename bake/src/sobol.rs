//! Sobol's sequence in four dimensions with Owen's scrambling (hashed: Burley, *Practical Hash-based Owen Scrambling*, JCGT
//! 2020): points that fill the cube evenly, different for every seed.

use glam::Vec2;

use crate::strata::hash;

/// Degree, inner coefficients and first numbers of the primitive polynomials (Joe and Kuo 2008) after the first
/// dimension, which is van der Corput's.
const POLYNOMIALS: [(usize, u32, [u32; 3]); 3] = [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];

const fn directions() -> [[u32; 32]; 4] {
    let mut all = [[0; 32]; 4];
    let mut k = 0;
    while k < 32 {
        all[0][k] = 1 << (31 - k);
        k += 1;
    }
    let mut dimension = 1;
    while dimension < 4 {
        let (degree, inner, first) = POLYNOMIALS[dimension - 1];
        let mut k = 0;
        while k < 32 {
            all[dimension][k] = if k < degree {
                first[k] << (31 - k)
            } else {
                let before = all[dimension][k - degree];
                let mut value = before ^ (before >> degree);
                let mut j = 1;
                while j < degree {
                    if inner >> (degree - 1 - j) & 1 != 0 {
                        value ^= all[dimension][k - j];
                    }
                    j += 1;
                }
                value
            };
            k += 1;
        }
        dimension += 1;
    }
    all
}

const DIRECTIONS: [[u32; 32]; 4] = directions();

/// Owen's scrambling: every bit turns by a hash of the bits above it.
#[inline]
fn scrambled(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits().wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// Point `index` of the sequence of `seed`, as two points of the unit square. Any `2^k` points whose indices start at a
/// multiple of `2^k` are even by themselves.
#[inline]
pub(crate) fn two_squares(index: u32, seed: u32) -> [Vec2; 2] {
    let mut bits = [0u32; 4];
    let mut rest = index;
    let mut k = 0;
    while rest != 0 {
        if rest & 1 != 0 {
            for (value, directions) in bits.iter_mut().zip(&DIRECTIONS) {
                *value ^= directions[k];
            }
        }
        rest >>= 1;
        k += 1;
    }
    let mut dimension = 0;
    let unit = bits.map(|value| {
        dimension += 1;
        (scrambled(value, hash(seed ^ hash(dimension))) >> 8) as f32 * (1.0 / 16_777_216.0)
    });
    [Vec2::new(unit[0], unit[1]), Vec2::new(unit[2], unit[3])]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every aligned block of 16 points has one point in each of 4 x 4 cells of either square, and in each sixteenth.
    #[test]
    fn blocks_are_nets() {
        for (block, seed) in [(0, 1), (5, 1), (77, 2), (1 << 20, 9)] {
            let points: Vec<[Vec2; 2]> = (0..16).map(|k| two_squares(16 * block + k, seed)).collect();
            let distinct = |key: &dyn Fn(&[Vec2; 2]) -> u32| {
                points.iter().map(key).collect::<std::collections::BTreeSet<_>>().len()
            };
            assert_eq!(distinct(&|p| (p[0].x * 4.0) as u32 + 4 * (p[0].y * 4.0) as u32), 16);
            for dimension in 0..4 {
                assert_eq!(
                    distinct(&|p| (p[dimension / 2].to_array()[dimension % 2] * 16.0) as u32),
                    16,
                    "{dimension}"
                );
            }
        }
        assert_ne!(two_squares(3, 1), two_squares(3, 2));
    }

    /// The integral of a product over all four dimensions, far closer than 4096 random points would give it.
    #[test]
    fn four_dimensions_are_even_together() {
        let mut sum = 0.0;
        for index in 0..4096 {
            let [a, b] = two_squares(index, 7);
            sum += (a.x * a.y * b.x * b.y) / 4096.0;
        }
        // A random mean would be off by 0.0014 (one sigma).
        assert!((sum - 1.0 / 16.0).abs() < 1.5e-4, "{sum}");
    }
}
