//! Random numbers and the strata that they fill: pixels in 4 x 4 cells, patches in cells of equal solid angle.

use glam::{Vec2, Vec3A};
use relume_firmware::patches::PatchSet;

/// Mixes 32 bits so that every input bit changes half of the output bits (C. Wellons' `lowbias32`).
#[inline]
pub(crate) fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A small random generator (PCG-XSH-RR 64/32, M. O'Neill 2014), one per pixel.
#[derive(Clone, Debug)]
pub(crate) struct Rng(u64);

impl Rng {
    /// The stream of one `purpose` at one pixel of one `seed`.
    pub(crate) fn new(seed: u64, x: u32, y: u32, purpose: u32) -> Self {
        let low = hash(x ^ hash(y ^ hash(purpose ^ hash(seed as u32))));
        let high = hash(y.wrapping_add(0x9e37_79b9) ^ hash(x ^ hash((seed >> 32) as u32 ^ purpose)));
        let mut rng = Rng((u64::from(high) << 32) | u64::from(low));
        rng.next_u32();
        rng
    }

    #[inline]
    pub(crate) fn next_u32(&mut self) -> u32 {
        let state = self.0;
        self.0 = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let word = (((state >> 18) ^ state) >> 27) as u32;
        word.rotate_right((state >> 59) as u32)
    }

    /// Uniform in 0..1, below 1.
    #[inline]
    pub(crate) fn unit(&mut self) -> f32 {
        (self.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// A point of the unit square.
    #[inline]
    pub(crate) fn square(&mut self) -> Vec2 {
        Vec2::new(self.unit(), self.unit())
    }

    /// A point of the unit square on a 65536 x 65536 lattice: enough inside a small cell, and half the price.
    #[inline]
    pub(crate) fn jitter(&mut self) -> Vec2 {
        let word = self.next_u32();
        Vec2::new((word >> 16) as f32 + 0.5, (word & 0xffff) as f32 + 0.5) * (1.0 / 65536.0)
    }
}

/// A square cut into `columns` x `rows` cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Grid {
    columns: u32,
    rows: u32,
}

impl Grid {
    /// The most square grid of exactly `cells` cells.
    pub(crate) fn new(cells: u32) -> Self {
        let cells = cells.max(1);
        let rows = (1..=cells.isqrt()).rev().find(|rows| cells.is_multiple_of(*rows)).unwrap_or(1);
        Grid { columns: cells / rows, rows }
    }

    /// The point of the unit square at `inside` of cell `cell`.
    #[inline]
    pub(crate) fn point(&self, cell: u32, inside: Vec2) -> Vec2 {
        let corner = Vec2::new((cell % self.columns) as f32, (cell / self.columns) as f32);
        (corner + inside) / Vec2::new(self.columns as f32, self.rows as f32)
    }
}

/// Side of the grid of strata of a pixel.
pub(crate) const STRATA_SIDE: u32 = 4;
/// Strata of a pixel; stratum `s` is column `s % 4` from the left in row `s / 4` from the top.
#[cfg(test)]
pub(crate) const STRATA: u32 = STRATA_SIDE * STRATA_SIDE;

/// One of four classes of strata; each class has one stratum in every row, column and quadrant of the pixel.
#[inline]
pub(crate) fn class_of(stratum: u32) -> u32 {
    const SHIFT: [u32; 4] = [0, 2, 1, 3];
    (stratum + SHIFT[(stratum / STRATA_SIDE) as usize & 3]) & 3
}

/// One patch as a rectangle in height and azimuth.
#[derive(Clone, Copy, Debug)]
struct Rectangle {
    height: f32,
    height_span: f32,
    azimuth: f32,
    azimuth_span: f32,
}

/// The patches of a set, prepared for fast sampling, in the set's order.
#[derive(Clone, Debug)]
pub(crate) struct PatchTable {
    pub(crate) set: PatchSet,
    rectangles: Vec<Rectangle>,
    /// Centre and the sine of the largest angle to it: a patch is wholly below a plane when
    /// `normal . centre < -sine`.
    cones: Vec<(Vec3A, f32)>,
    pub(crate) solid_angle_sr: Vec<f32>,
}

impl PatchTable {
    pub(crate) fn new(set: &PatchSet) -> Self {
        let patches = 0..set.len();
        PatchTable {
            set: *set,
            rectangles: patches.clone().map(|patch| rectangle(set, patch)).collect(),
            cones: patches.clone().map(|patch| cone(set, patch)).collect(),
            solid_angle_sr: patches.map(|patch| set.solid_angle_sr(patch)).collect(),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.rectangles.len()
    }

    /// Whether no direction of the patch lies above the plane with unit normal `normal`.
    #[inline]
    pub(crate) fn below(&self, patch: usize, normal: Vec3A) -> bool {
        let (centre, sine) = self.cones[patch];
        normal.dot(centre) < -sine
    }

    /// Whether the patch is so large that a surface's cosine differs much over it, as below the horizon.
    #[inline]
    pub(crate) fn wide(&self, patch: usize) -> bool {
        self.solid_angle_sr[patch] > 0.1
    }

    /// The direction at `at` of the unit square, uniform in solid angle over the patch.
    #[inline]
    pub(crate) fn direction(&self, patch: usize, at: Vec2) -> Vec3A {
        let cell = self.rectangles[patch];
        let height = cell.height + cell.height_span * at.x;
        let (sin, cos) = (cell.azimuth + cell.azimuth_span * at.y).sin_cos();
        let radius = (1.0 - height * height).max(0.0).sqrt();
        Vec3A::new(radius * cos, height, radius * sin)
    }
}

/// Reads a patch's bounds off the set's own sampling.
fn rectangle(set: &PatchSet, patch: usize) -> Rectangle {
    // Inside, not at the border: the zenith cap has no azimuth at its top.
    let at = |u: f32, v: f32| set.sample(patch, [u, v]).map(f64::from);
    let (low, high) = (at(0.0, 0.0)[1], at(1.0, 0.0)[1]);
    let azimuth = |p: [f64; 3]| p[2].atan2(p[0]);
    let (start, middle) = (azimuth(at(0.0, 0.0)), azimuth(at(0.0, 0.5)));
    let span = 2.0 * (middle - start).rem_euclid(std::f64::consts::TAU);
    Rectangle { height: low as f32, height_span: (high - low) as f32, azimuth: start as f32, azimuth_span: span as f32 }
}

fn cone(set: &PatchSet, patch: usize) -> (Vec3A, f32) {
    let centre = Vec3A::from(set.dir_world(patch));
    let steps = [0.0, 0.25, 0.5, 0.75, 1.0];
    let cosine = steps
        .iter()
        .flat_map(|&u| steps.iter().map(move |&v| [u, v]))
        .map(|at| centre.dot(Vec3A::from(set.sample(patch, at))))
        .fold(1.0f32, f32::min);
    // A wide patch has no useful cone; the margin covers what lies between the steps.
    let sine = if cosine > 0.0 { ((1.0 - cosine * cosine).sqrt() * 1.1 + 1e-3).min(1.0) } else { 1.0 };
    (centre, sine)
}

/// Two unit vectors that make a right-handed frame with the unit vector `normal` (Duff et al. 2017).
#[inline]
pub(crate) fn frame(normal: Vec3A) -> (Vec3A, Vec3A) {
    let sign = 1.0f32.copysign(normal.z);
    let a = -1.0 / (sign + normal.z);
    let b = normal.x * normal.y * a;
    let tangent = Vec3A::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x);
    (tangent, Vec3A::new(b, sign + normal.y * normal.y * a, -normal.y))
}

/// A direction about `normal` with a density of cosine / pi, for `at` in the unit square (Shirley & Chiu's map).
#[inline]
pub(crate) fn cosine_direction(normal: Vec3A, at: Vec2) -> Vec3A {
    let disc = disc_point(at);
    let height = (1.0 - disc.length_squared()).max(0.0).sqrt();
    let (tangent, bitangent) = frame(normal);
    tangent * disc.x + bitangent * disc.y + normal * height
}

/// A point of the unit disc for a point of the unit square; equal areas stay equal and neighbours stay neighbours.
#[inline]
pub(crate) fn disc_point(at: Vec2) -> Vec2 {
    let centred = 2.0 * at - 1.0;
    if centred == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let quarter = std::f32::consts::FRAC_PI_4;
    let (radius, angle) = if centred.x.abs() > centred.y.abs() {
        (centred.x, quarter * (centred.y / centred.x))
    } else {
        (centred.y, 2.0 * quarter - quarter * (centred.x / centred.y))
    };
    let (sin, cos) = angle.sin_cos();
    Vec2::new(radius * cos, radius * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_equals_the_patch_set() {
        for n in [16, 145, 256] {
            let set = PatchSet::new(n).unwrap();
            let table = PatchTable::new(&set);
            for patch in 0..set.len() {
                for at in [[0.1, 0.2], [0.5, 0.5], [0.9, 0.7], [0.3, 0.99]] {
                    let (fast, exact) = (table.direction(patch, Vec2::from(at)), set.sample(patch, at));
                    assert!((fast - Vec3A::from(exact)).length() < 3e-6, "{n} {patch} {fast} {exact:?}");
                    let opposite = -Vec3A::from(exact);
                    assert!(!table.below(patch, -(opposite + Vec3A::splat(1e-4)).normalize()), "{n} {patch}");
                }
            }
        }
    }

    #[test]
    fn a_patch_is_below_only_if_every_direction_is() {
        let set = PatchSet::new(64).unwrap();
        let table = PatchTable::new(&set);
        let mut rng = Rng::new(1, 2, 3, 4);
        let mut skipped = 0;
        for _ in 0..200 {
            let normal = cosine_direction(Vec3A::new(0.6, 0.0, 0.8), rng.square());
            for patch in 0..set.len() {
                if table.below(patch, normal) {
                    skipped += 1;
                    for _ in 0..16 {
                        assert!(normal.dot(table.direction(patch, rng.jitter())) <= 0.0);
                    }
                }
            }
        }
        assert!(skipped > 1000);
    }

    #[test]
    fn classes_hold_one_stratum_per_row_column_and_quadrant() {
        for class in 0..4 {
            let cells: Vec<(u32, u32)> =
                (0..STRATA).filter(|&s| class_of(s) == class).map(|s| (s % 4, s / 4)).collect();
            let distinct =
                |key: fn(&(u32, u32)) -> u32| cells.iter().map(key).collect::<std::collections::BTreeSet<_>>().len();
            assert_eq!(cells.len(), 4);
            assert_eq!((distinct(|c| c.0), distinct(|c| c.1), distinct(|c| c.0 / 2 + c.1 / 2 * 2)), (4, 4, 4));
        }
    }

    #[test]
    fn cosine_directions_have_the_cosine_density() {
        let normal = Vec3A::new(-0.48, 0.6, -0.64);
        let grid = Grid::new(4096);
        let mut mean = Vec3A::ZERO;
        for cell in 0..4096 {
            let direction = cosine_direction(normal, grid.point(cell, Vec2::splat(0.5)));
            assert!((direction.length() - 1.0).abs() < 1e-5 && direction.dot(normal) >= 0.0);
            mean += direction / 4096.0;
        }
        // The mean direction of the cosine density is 2/3 of the normal.
        assert!((mean - normal * (2.0 / 3.0)).length() < 2e-3, "{mean}");
    }
}
