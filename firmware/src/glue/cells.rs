//! A map's mean over the cell of each listed direction: the directions that are nearest to it, on its side of the horizon.

use super::map::RadianceMap;
use super::split::rotate_to_world;
use crate::patches::Listed;

/// Rows that a map is looked at in, at least: coarser ones are looked at several times per pixel.
const LEAST_ROWS: usize = 512;

/// Mean radiance per patch of a map turned by `env_rot_deg` about +Y. A cell smaller than a look has the map's value in its
/// own direction.
pub(super) fn cell_means(map: &RadianceMap, list: &Listed, env_rot_deg: f64) -> Vec<[f32; 3]> {
    let times = LEAST_ROWS.div_ceil(map.height);
    let mut sums = vec![([0.0f64; 3], 0.0f64); list.len()];
    for row in 0..map.height * times {
        let theta = std::f64::consts::PI * (row as f64 + 0.5) / (map.height * times) as f64;
        let omega = theta.sin();
        for col in 0..map.width * times {
            let azimuth = std::f64::consts::TAU * ((col as f64 + 0.5) / (map.width * times) as f64 - 0.5);
            let dir_map = [omega * azimuth.cos(), theta.cos(), omega * azimuth.sin()].map(|c| c as f32);
            let Some(patch) = list.nearest(rotate_to_world(dir_map, env_rot_deg)) else { continue };
            let rgb = map.pixels[row / times * map.width + col / times];
            let (sum, total) = &mut sums[patch];
            (0..3).for_each(|c| sum[c] += omega * f64::from(rgb[c]));
            *total += omega;
        }
    }
    let mean = |(patch, &(sum, total)): (usize, &([f64; 3], f64))| match total > 0.0 {
        true => sum.map(|v| (v / total).max(0.0) as f32),
        false => {
            let [col, row] = map.position_of(rotate_to_world(list.patch(patch).dir_world, -env_rot_deg));
            let (col, row) = ((col as usize).min(map.width - 1), (row as usize).min(map.height - 1));
            map.pixels[row * map.width + col]
        }
    };
    sums.iter().enumerate().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::{ListedPatch, PatchSet};

    fn octahedron(horizon: Option<[f32; 3]>) -> PatchSet {
        let dirs = [
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0f32],
            [0.0, -1.0, 0.0],
        ];
        let patch =
            |(row, &dir_world): (usize, &[f32; 3])| ListedPatch { dir_world, solid_angle_sr: 2.0, row: row as u16 };
        let patches: Vec<ListedPatch> = dirs.iter().enumerate().map(patch).collect();
        PatchSet::of_list(Listed::new(&patches, horizon).unwrap())
    }

    /// Radiance `2 + x`, turned: by symmetry the cells of y and z have 2, those of x the same above and below, and over all
    /// cells, which are alike, the mean of the map.
    #[test]
    fn cells_of_an_octahedron_have_their_means() {
        let (width, height) = (64, 32);
        let mut map = RadianceMap { width, height, pixels: vec![[0.0; 3]; width * height] };
        for row in 0..height {
            for col in 0..width {
                let [x, _, _] = map.dir_map(col, row);
                map.pixels[row * width + col] = [2.0 + x, 1.0, 0.0];
            }
        }
        let means = super::super::split::integrate(&map, &octahedron(None), 0.0);
        // Mean of x over a face of the cube around the sphere, by an independent sum over that face.
        let (mut sum, mut area) = (0.0f64, 0.0f64);
        for k in 0..200 {
            for l in 0..200 {
                let (u, v) = ((k as f64 + 0.5) / 100.0 - 1.0, (l as f64 + 0.5) / 100.0 - 1.0);
                let r = (1.0 + u * u + v * v).sqrt();
                sum += 1.0 / r.powi(4);
                area += 1.0 / r.powi(3);
            }
        }
        let x = sum / area;
        for (mean, want) in means.iter().zip([2.0 + x, 2.0 - x, 2.0, 2.0, 2.0, 2.0]) {
            assert!((f64::from(mean[0]) - want).abs() < 4e-3 && (mean[1] - 1.0).abs() < 1e-6, "{mean:?} {want}");
        }
        // RotY(90) takes +X of the map to -Z of the world.
        let turned = super::super::split::integrate(&map, &octahedron(None), 90.0);
        assert!((f64::from(turned[4][0]) - 2.0 - x).abs() < 4e-3, "{turned:?}");
        // Behind the horizon nothing counts: half a cell of +X is left, and none of -Z, which takes its own direction.
        let dome = super::super::split::integrate(&map, &octahedron(Some([0.0, 0.0, 1.0])), 0.0);
        assert!((f64::from(dome[0][0]) - 2.0 - x).abs() < 4e-3 && dome[4][1] == 1.0);
    }
}
