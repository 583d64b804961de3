//! A smooth sky fitted to the patches that were seen, for what was not.
//!
//! Real spherical harmonics up to order 2 and a glow along the horizon by least squares, and what they leave over near by:
//! the mean of the seen patches' residuals under a Gaussian of 12 degrees, which fades to nothing where none is near.

use crate::linear_system::solve;
use relume_firmware::patches::PatchSet;

const TERMS: usize = 10;
/// Height over which the glow along the horizon falls by e, as a sine.
const GLOW: f64 = 0.15;
/// Width of the Gaussian over residuals, as the square of a chord: 12 degrees.
const WIDTH_2: f32 = 0.209 * 0.209;
/// Weight of "no residual" beside those of the patches.
const AT_REST: f32 = 0.05;

/// Real spherical harmonics up to order 2, not normalised, and the horizon's glow.
fn shapes([x, y, z]: [f32; 3]) -> [f64; TERMS] {
    let [x, y, z] = [x, y, z].map(f64::from);
    [1.0, x, y, z, x * y, y * z, x * z, 3.0 * y * y - 1.0, x * x - z * z, (-y.max(0.0) / GLOW).exp()]
}

/// A fitted sky; its memory is reused from one fit to the next.
#[derive(Clone, Debug, Default)]
pub struct SmoothSky {
    fit: [[f64; 3]; TERMS],
    /// Direction and residual of every patch that was fitted to.
    residuals: Vec<([f32; 3], [f32; 3])>,
    /// Range of the patches that were fitted to.
    low: [f32; 3],
    high: [f32; 3],
}

impl SmoothSky {
    /// Fits the upper patches for which `is_known`; an empty choice gives a black sky.
    pub fn fit(&mut self, set: &PatchSet, radiance: &[[f32; 3]], is_known: impl Fn(usize) -> bool) {
        let (mut a, mut b) = ([[0.0; TERMS]; TERMS], [[0.0; 3]; TERMS]);
        (self.low, self.high) = ([f32::INFINITY; 3], [0.0; 3]);
        self.residuals.clear();
        for patch in (0..set.upper()).filter(|&patch| is_known(patch)) {
            let (dir, value) = (set.dir_world(patch), radiance[patch]);
            let basis = shapes(dir);
            for i in 0..TERMS {
                a[i] = std::array::from_fn(|j| a[i][j] + basis[i] * basis[j]);
                b[i] = std::array::from_fn(|k| b[i][k] + basis[i] * f64::from(value[k]));
            }
            self.low = std::array::from_fn(|k| self.low[k].min(value[k]));
            self.high = std::array::from_fn(|k| self.high[k].max(value[k]));
            self.residuals.push((dir, value));
        }
        // Few or one-sided patches leave shapes undetermined; those stay flat.
        let count = self.residuals.len() as f64;
        for (i, row) in a.iter_mut().enumerate() {
            row[i] += if i == 0 { 1e-9 } else { 1e-3 * count.max(1.0) };
        }
        self.fit = solve(a, b);
        let fit = self.fit;
        for (dir, value) in &mut self.residuals {
            let smooth = trend(&fit, *dir);
            *value = std::array::from_fn(|k| value[k] - smooth[k]);
        }
    }

    /// Radiance in a unit direction, within the range of the patches that were fitted to.
    pub fn at(&self, dir: [f32; 3]) -> [f32; 3] {
        if self.residuals.is_empty() {
            return [0.0; 3];
        }
        let (mut near, mut total) = ([0.0; 3], AT_REST);
        for (other, residual) in &self.residuals {
            let apart: f32 = (0..3).map(|k| (dir[k] - other[k]).powi(2)).sum();
            if apart < 9.0 * WIDTH_2 {
                let weight = (-apart / WIDTH_2).exp();
                total += weight;
                near = std::array::from_fn(|k| near[k] + weight * residual[k]);
            }
        }
        let smooth = trend(&self.fit, dir);
        std::array::from_fn(|k| (smooth[k] + near[k] / total).clamp(self.low[k], self.high[k]))
    }
}

fn trend(fit: &[[f64; 3]; TERMS], dir: [f32; 3]) -> [f32; 3] {
    let basis = shapes(dir);
    std::array::from_fn(|k| (0..TERMS).map(|i| basis[i] * fit[i][k]).sum::<f64>() as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::luminance;
    use crate::skymodel::{Atmosphere, SkyModel};
    use crate::sun::SunPosition;

    #[test]
    fn a_smooth_sky_is_completed() {
        let set = PatchSet::new(256).unwrap();
        let sky = |d: [f32; 3]| [2.0, 1.0 + 0.5 * d[1], 1.5 + 0.4 * d[0] * d[1]];
        let radiance: Vec<[f32; 3]> = (0..set.upper()).map(|p| sky(set.dir_world(p))).collect();
        let is_known = |patch: usize| set.dir_world(patch)[0] <= 0.7;
        let mut smooth = SmoothSky::default();
        smooth.fit(&set, &radiance, is_known);
        for patch in (0..set.upper()).filter(|&patch| !is_known(patch)) {
            let (found, expected) = (smooth.at(set.dir_world(patch)), sky(set.dir_world(patch)));
            for k in 0..3 {
                assert!((found[k] - expected[k]).abs() < 0.05, "{found:?} {expected:?}");
            }
        }
        smooth.fit(&set, &radiance, |_| false);
        assert_eq!(smooth.at([0.0, 1.0, 0.0]), [0.0; 3]);
    }

    #[test]
    fn a_house_before_a_clear_sky_costs_little() {
        let set = PatchSet::new(256).unwrap();
        let sun = SunPosition { azimuth_deg: 150.0, altitude_deg: 40.0 };
        let model = SkyModel::new(Atmosphere::default(), sun, 0.0, 0.0);
        let radiance = model.weights(&set).radiance;
        // A quarter of the horizon up to 25 degrees, in the east; then in the sun's own south-east.
        for (towards, most) in [([1.0, 0.0, 0.0], 0.10), ([0.6, 0.0, 0.8], 0.15)] {
            let is_hidden = |patch: usize| {
                let d = set.dir_world(patch);
                let level = d[0].hypot(d[2]);
                d[1] < 0.42 && (d[0] * towards[0] + d[2] * towards[2]) / level > 0.707
            };
            let mut smooth = SmoothSky::default();
            smooth.fit(&set, &radiance, |patch| !is_hidden(patch));
            let hidden: Vec<usize> = (0..set.upper()).filter(|&patch| is_hidden(patch)).collect();
            let off: f32 = hidden
                .iter()
                .map(|&p| (luminance(smooth.at(set.dir_world(p))) / luminance(radiance[p]) - 1.0).abs())
                .sum::<f32>()
                / hidden.len() as f32;
            eprintln!("{} patches hidden towards {towards:?}: {:.1} % off", hidden.len(), 100.0 * off);
            assert!(hidden.len() > 20 && off < most, "{off}");
        }
    }
}
