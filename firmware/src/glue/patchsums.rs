//! A map's sums over each patch: its light, and where in the patch that stands.

use super::map::RadianceMap;
use crate::patches::PatchSet;
use std::f64::consts::{PI, TAU};

/// Bounds of a ring of patches: height `y_low..y_high` and, per patch, azimuth `from..to` (radians, `to` may pass 2 pi).
struct Ring {
    y_low: f64,
    y_high: f64,
    cells: Vec<(usize, f64, f64)>,
}

/// The patches as rings of azimuth spans; every patch is a rectangle in height and azimuth.
fn rings(set: &PatchSet) -> Vec<Ring> {
    let turn = |[x, _, z]: [f32; 3]| {
        let azimuth = f64::from(z).atan2(f64::from(x)).rem_euclid(TAU);
        if azimuth > TAU - 1e-5 { 0.0 } else { azimuth }
    };
    let mut rings: Vec<Ring> = Vec::new();
    for patch in 0..set.len() {
        let first = set.sample(patch, [0.0, 0.0]);
        let (a, b) = (f64::from(first[1]), f64::from(set.sample(patch, [1.0, 0.0])[1]));
        let from = turn(first);
        let to = turn(set.sample(patch, [0.0, 1.0]));
        let to = if to <= from + 1e-5 { to + TAU } else { to };
        match rings.last_mut() {
            Some(ring) if (ring.y_low - a.min(b)).abs() < 1e-5 && (ring.y_high - a.max(b)).abs() < 1e-5 => {
                ring.cells.push((patch, from, to));
            }
            _ => rings.push(Ring { y_low: a.min(b), y_high: a.max(b), cells: vec![(patch, from, to)] }),
        }
    }
    rings
}

/// What is summed up of a map: red, green, blue and 1.
const SUMMED: usize = 4;

/// Running sums of one map row over columns, from column 0 to any fractional column: of each of what is summed up its integral,
/// and those times cosine and sine of the azimuth in the map.
struct RowSums(Vec<[[f64; 3]; SUMMED]>);

impl RowSums {
    /// Of a row, and sine and cosine of its pixels' azimuths.
    fn new(row: &[[f32; 3]], azimuths: &[(f64, f64)]) -> Self {
        let mut sums = vec![[[0.0; 3]; SUMMED]; row.len() + 1];
        for (col, (&[r, g, b], &(sin, cos))) in row.iter().zip(azimuths).enumerate() {
            for (k, value) in [r, g, b, 1.0].map(f64::from).into_iter().enumerate() {
                let [sum, by_cos, by_sin] = sums[col][k];
                sums[col + 1][k] = [sum + value, by_cos + value * cos, by_sin + value * sin];
            }
        }
        RowSums(sums)
    }

    fn until(&self, column: f64) -> [[f64; 3]; SUMMED] {
        let width = self.0.len() - 1;
        let turns = (column / width as f64).floor();
        let within = (column - turns * width as f64).clamp(0.0, width as f64);
        let col = (within as usize).min(width - 1);
        let part = within - col as f64;
        let (a, b, whole) = (&self.0[col], &self.0[col + 1], &self.0[width]);
        let at = |k: usize, m: usize| turns * whole[k][m] + a[k][m] + (b[k][m] - a[k][m]) * part;
        std::array::from_fn(|k| std::array::from_fn(|m| at(k, m)))
    }
}

/// A map over one patch: of red, green, blue and 1 the integral over its solid angle, and those times the direction in the map.
#[derive(Clone, Copy, Default)]
pub(super) struct PatchSums {
    pub integral: [f64; SUMMED],
    pub by_dir: [[f64; 3]; SUMMED],
}

/// Sums of every patch of a set of rings. Pixels that straddle a border of patches are shared by exact area; each share counts at
/// its pixel's centre.
pub(super) fn patch_sums(map: &RadianceMap, set: &PatchSet, env_rot_deg: f64) -> Vec<PatchSums> {
    let rings = rings(set);
    let mut sums = vec![PatchSums::default(); set.len()];
    let step = PI / map.height as f64;
    let column = |azimuth_world: f64| ((azimuth_world + env_rot_deg.to_radians()) / TAU + 0.5) * map.width as f64;
    let azimuth = |col: usize| (((col as f64 + 0.5) / map.width as f64 - 0.5) * TAU).sin_cos();
    let azimuths: Vec<(f64, f64)> = (0..map.width).map(azimuth).collect();
    for (row, pixels) in map.pixels.chunks_exact(map.width).enumerate() {
        let (top, bottom) = ((row as f64 * step).cos(), ((row + 1) as f64 * step).cos());
        let (level, up) = ((row as f64 + 0.5) * step).sin_cos();
        let row_sums = RowSums::new(pixels, &azimuths);
        for ring in &rings {
            let height = top.min(ring.y_high) - bottom.max(ring.y_low);
            if height <= 0.0 {
                continue;
            }
            for &(patch, from, to) in &ring.cells {
                let (a, b) = (row_sums.until(column(from)), row_sums.until(column(to)));
                let of = |k: usize, m: usize| (b[k][m] - a[k][m]) * height * TAU / map.width as f64;
                let PatchSums { integral, by_dir } = &mut sums[patch];
                for k in 0..SUMMED {
                    integral[k] += of(k, 0);
                    let dir = [level * of(k, 1), up * of(k, 0), level * of(k, 2)];
                    by_dir[k] = std::array::from_fn(|m| by_dir[k][m] + dir[m]);
                }
            }
        }
    }
    sums
}

/// Mean RGB radiance per patch.
pub(super) fn means(sums: &[PatchSums], set: &PatchSet) -> Vec<[f32; 3]> {
    let mean = |(patch, sum): (usize, &PatchSums)| -> [f32; 3] {
        std::array::from_fn(|k| (sum.integral[k] / f64::from(set.solid_angle_sr(patch))).max(0.0) as f32)
    };
    sums.iter().enumerate().map(mean).collect()
}
