//! Clouds as fractal value noise on a layer above the site (Ebert et al., "Texturing and Modeling", 2003, chapter 2): thin
//! edges shine, towards the sun more so (Henyey-Greenstein), thick bases are dark.

use super::preetham::ClearSky;
use crate::random::Random;

/// Octaves of the noise.
const OCTAVES: i32 = 6;
/// Cells of the coarsest octave per height of the layer.
const CELLS: f64 = 1.3;
/// Asymmetry of scattering in a thin cloud.
const FORWARD: f64 = 0.8;

/// A cloud layer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clouds {
    seed: u64,
    /// Noise above which there is cloud.
    threshold: f64,
    /// Mean luminance of the sky that lights it.
    light: f64,
}

impl Clouds {
    /// A layer over the share `cover` of the plane.
    pub(super) fn new(seed: u64, cover: f64, light: f64) -> Self {
        let open = Clouds { seed, threshold: 0.0, light };
        // The threshold that leaves the wanted share is found from a sample of the plane.
        let mut sample: Vec<f64> =
            (0..1024).map(|k| open.noise([f64::from(k % 32) * 0.37, f64::from(k / 32) * 0.37])).collect();
        sample.sort_by(f64::total_cmp);
        let clear = ((1.0 - cover) * sample.len() as f64) as usize;
        Clouds { threshold: if cover < 1.0 { sample[clear.min(sample.len() - 1)] } else { sample[0] - 0.2 }, ..open }
    }

    /// The sky's radiance with the clouds before it.
    pub(super) fn before(&self, dir: [f64; 3], sky: &ClearSky) -> [f64; 3] {
        let height = dir[1] + 0.12;
        let depth = (self.noise([dir[0] / height * CELLS, dir[2] / height * CELLS]) - self.threshold) * 12.0;
        let clear = sky.radiance(dir);
        if depth <= 0.0 {
            return clear;
        }
        let cosine: f64 = dir.iter().zip(&sky.sun).map(|(d, s)| d * s).sum();
        let phase = (1.0 - FORWARD * FORWARD) / (1.0 + FORWARD * FORWARD - 2.0 * FORWARD * cosine).powf(1.5);
        let passes = (-2.0 * depth).exp();
        let base = 0.5 + 1.2 * (-0.8 * depth).exp();
        let own = self.light * (base * (1.0 - passes) + 0.4 * phase * depth * passes);
        clear.map(|value| value * passes + own)
    }

    /// Fractal noise, around 0.
    fn noise(&self, place: [f64; 2]) -> f64 {
        (0..OCTAVES)
            .map(|octave| 0.55f64.powi(octave) * self.lattice(place.map(|v| v * 2f64.powi(octave)), octave))
            .sum()
    }

    /// Values -0.5..0.5 at whole places, smoothly joined.
    fn lattice(&self, place: [f64; 2], octave: i32) -> f64 {
        let (cell, within) = (place.map(f64::floor), place.map(|v| v - v.floor()));
        let smooth = within.map(|t| t * t * (3.0 - 2.0 * t));
        let mut sum = 0.0;
        for corner in 0..4 {
            let [dx, dz] = [corner & 1, corner >> 1];
            let share = |t: f64, far: i64| if far == 1 { t } else { 1.0 - t };
            let key = [cell[0] as i64 + dx, cell[1] as i64 + dz, i64::from(octave)];
            let mixed = key.iter().fold(self.seed, |all, &k| Random::new(all.wrapping_add(k as u64)).bits());
            sum += share(smooth[0], dx) * share(smooth[1], dz) * ((mixed >> 11) as f64 / (1u64 << 53) as f64 - 0.5);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cover_is_what_was_asked_for() {
        let sky = ClearSky::new(3.0, [1.0, 0.8]);
        for cover in [0.0, 0.3, 0.7, 1.0] {
            let clouds = Clouds::new(5, cover, 3.0);
            let dirs = (0..4000).map(|k| {
                // Even over the layer's plane, as far as it is near.
                let (x, z) = (f64::from(k % 80) / 20.0 - 2.0, f64::from(k / 80) / 12.5 - 2.0);
                let length = (x * x + z * z + 1.0).sqrt();
                [x / length, 1.0 / length, z / length]
            });
            let covered = dirs.filter(|&dir| clouds.before(dir, &sky) != sky.radiance(dir)).count();
            let found = covered as f64 / 4000.0;
            assert!((found - cover).abs() < 0.2, "{cover}: {found}");
        }
    }
}
