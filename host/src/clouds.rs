//! A drifting cloud layer: a smooth, deterministic noise field of optical depth on a plane above the ground.

use crate::skymodel::Atmosphere;

const OCTAVES: u32 = 4;
/// Optical depth in the middle of a cloud.
const THICK: f32 = 14.0;

/// The clouds of one moment.
#[derive(Clone, Copy, Debug)]
pub struct Clouds {
    cover: f32,
    seed: u64,
    drift: f64,
}

impl Clouds {
    /// The clouds over a ground at a time (seconds, any epoch).
    pub fn new(atmosphere: &Atmosphere, time_s: f64) -> Self {
        // The field repeats after 2^20 cells, so that unix time keeps its precision.
        let drift = (atmosphere.cloud_drift_per_s * time_s).rem_euclid(f64::from(1 << 20));
        Clouds { cover: atmosphere.cloud_cover.clamp(0.0, 1.0), seed: atmosphere.cloud_seed, drift }
    }

    /// Optical depth in a unit direction; 0 below the horizon and where no cloud is.
    pub fn optical_depth(&self, dir: [f32; 3]) -> f32 {
        if self.cover <= 0.0 || dir[1] < 0.0 {
            return 0.0;
        }
        // The plane bends down towards the horizon like the real layer, so that distances stay finite.
        let distance = f64::from(dir[1] + 0.12).recip();
        let (x, z) = (f64::from(dir[0]) * distance - self.drift, f64::from(dir[2]) * distance);
        let (mut sum, mut scale, mut size) = (0.0, 0.5, 1.1);
        for octave in 0..OCTAVES {
            sum += scale * self.noise(x * size, z * size, octave);
            scale *= 0.5;
            size *= 2.0;
        }
        // The sum lies around 0.47 within 0.25 or so; spread it to 0..1.
        let value = (((sum - 0.47) * 2.0 + 0.5) as f32).clamp(0.0, 1.0);
        let edge = 1.15 - 1.45 * self.cover;
        let t = ((value - edge) / 0.3).clamp(0.0, 1.0);
        THICK * t * t * (3.0 - 2.0 * t)
    }

    /// Share of a beam from a direction that passes.
    pub fn transmission(&self, dir: [f32; 3]) -> f32 {
        (-self.optical_depth(dir)).exp()
    }

    /// Value noise, 0..1, with smooth first derivatives.
    fn noise(&self, x: f64, z: f64, octave: u32) -> f64 {
        let (col, row) = (x.floor(), z.floor());
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (u, v) = (smooth(x - col), smooth(z - row));
        let (col, row) = (col as i64, row as i64);
        let at = |c: i64, r: i64| lattice(self.seed, c, r, octave);
        let top = at(col, row) * (1.0 - u) + at(col + 1, row) * u;
        let bottom = at(col, row + 1) * (1.0 - u) + at(col + 1, row + 1) * u;
        top * (1.0 - v) + bottom * v
    }
}

/// A value in 0..1 per lattice point (splitmix64's finaliser).
fn lattice(seed: u64, col: i64, row: i64, octave: u32) -> f64 {
    let mut h =
        seed ^ (col as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (row as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    h = h.wrapping_add(u64::from(octave).wrapping_mul(0x1656_67b1_9e37_79f9));
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((h ^ (h >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clouds(cloud_cover: f32, time_s: f64) -> Clouds {
        Clouds::new(&Atmosphere { cloud_cover, ..Atmosphere::default() }, time_s)
    }

    fn dirs() -> impl Iterator<Item = [f32; 3]> {
        (0..2000).map(|i| {
            let y = (i as f32 + 0.5) / 2000.0;
            let (sin, cos) = (i as f32 * 2.4).sin_cos();
            let r = (1.0 - y * y).sqrt();
            [r * cos, y, r * sin]
        })
    }

    #[test]
    fn cover_is_the_share_of_sky_under_cloud() {
        for (cover, low, high) in [(0.0, 0.0, 0.0), (0.5, 0.3, 0.7), (1.0, 1.0, 1.0)] {
            let field = clouds(cover, 0.0);
            let share = dirs().filter(|&d| field.optical_depth(d) > 1.0).count() as f32 / 2000.0;
            assert!((low..=high).contains(&share), "{cover}: {share}");
        }
    }

    #[test]
    fn clouds_drift_smoothly_at_todays_unix_time() {
        let (a, b) = (clouds(0.5, 1.8e9), clouds(0.5, 1.8e9 + 1.0));
        let steps: Vec<f32> = dirs().map(|d| (a.transmission(d) - b.transmission(d)).abs()).collect();
        assert!(steps.iter().copied().fold(0.0, f32::max) < 0.2);
        assert!(steps.iter().sum::<f32>() > 0.0);
    }
}
