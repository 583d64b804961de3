//! What breaks a smooth sky: clouds on a flat layer, and a skyline of hills, trees and houses.

use super::cie::SmoothSky;
use crate::random::Random;
use std::f64::consts::TAU;

/// Broken clouds: smooth noise on a plane above the site, thresholded softly, lit by the sky's sun.
#[derive(Clone, Debug)]
pub(crate) struct Clouds {
    waves: Vec<[f64; 4]>,
    threshold: f64,
    softness: f64,
    brightness: f64,
    silver: f64,
}

impl Clouds {
    pub(crate) fn draw(random: &mut Random) -> Self {
        let base = random.between(0.5, 2.0);
        let waves = (0..24)
            .map(|k| {
                let octave = base * 1.26f64.powi(k / 2);
                let turn = TAU * random.unit();
                [octave * turn.cos(), octave * turn.sin(), TAU * random.unit(), 0.45 * random.normal() / octave.sqrt()]
            })
            .collect();
        Clouds {
            waves,
            threshold: random.between(-0.8, 0.8),
            softness: random.between(0.05, 0.5),
            brightness: random.between(0.4, 3.0),
            silver: random.between(0.0, 4.0),
        }
    }

    fn cover(&self, [x, y, z]: [f64; 3]) -> f64 {
        let height = y + 0.15;
        let (px, pz) = (x / height, z / height);
        let noise: f64 = self.waves.iter().map(|[kx, kz, phase, size]| size * (kx * px + kz * pz + phase).sin()).sum();
        let t = ((noise - self.threshold) / self.softness).clamp(-1.0, 1.0) * 0.5 + 0.5;
        t * t * (3.0 - 2.0 * t)
    }

    /// Radiance of `sky` seen through the clouds; `mean` is the sky's mean radiance.
    pub(crate) fn radiance(&self, sky: &SmoothSky, dir: [f64; 3], mean: f64) -> f64 {
        let cover = self.cover(dir);
        let cosine = dir.iter().zip(&sky.sun).map(|(d, s)| d * s).sum::<f64>();
        let lit = mean * self.brightness * (1.0 + self.silver * cosine.max(0.0).powi(8));
        sky.radiance(dir) * (1.0 - cover) + lit * cover
    }
}

/// What stands before the sky near the horizon: a profile over azimuth, in blocks of their own brightness.
#[derive(Clone, Debug)]
pub(crate) struct Skyline {
    waves: Vec<[f64; 3]>,
    height: f64,
    blocks: Vec<f64>,
    turn: f64,
    rows: f64,
}

impl Skyline {
    pub(crate) fn draw(random: &mut Random) -> Self {
        let waves = (1..12)
            .map(|k| {
                let k = f64::from(k);
                [k, TAU * random.unit(), random.normal() / k]
            })
            .collect();
        let count = 8 + (random.unit() * 40.0) as usize;
        let albedo = random.between(0.05, 0.4);
        let spread = random.between(0.2, 1.0);
        let blocks = (0..count * 4).map(|_| albedo * (spread * random.normal()).exp()).collect();
        Skyline {
            waves,
            height: random.between(0.05, 0.5),
            blocks,
            turn: random.unit(),
            rows: random.between(2.0, 12.0),
        }
    }

    /// Share of the ground's irradiance/pi that comes from here, or `None` where the sky is free.
    pub(crate) fn reflectance(&self, [x, y, z]: [f64; 3]) -> Option<f64> {
        let azimuth = z.atan2(x);
        let wave: f64 = self.waves.iter().map(|[k, phase, size]| size * (k * azimuth + phase).sin()).sum();
        if y > self.height * (0.5 + 0.35 * wave) {
            return None;
        }
        let columns = self.blocks.len() / 4;
        let column = ((azimuth / TAU + 1.0 + self.turn).fract() * columns as f64) as usize;
        let row = (y * self.rows) as usize & 3;
        self.blocks.get(column.min(columns - 1) * 4 + row).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_cover_between_nothing_and_all() {
        let mut random = Random::new(5);
        let mut shares = Vec::new();
        for _ in 0..40 {
            let clouds = Clouds::draw(&mut random);
            let covers: Vec<f64> = (0..100)
                .map(|k| {
                    let azimuth = f64::from(k) * 2.4;
                    let y = (f64::from(k) + 0.5) / 100.0;
                    let r = (1.0 - y * y).sqrt();
                    clouds.cover([r * azimuth.cos(), y, r * azimuth.sin()])
                })
                .collect();
            assert!(covers.iter().all(|c| (0.0..=1.0).contains(c)));
            shares.push(covers.iter().sum::<f64>() / 100.0);
        }
        assert!(shares.iter().any(|&s| s < 0.3) && shares.iter().any(|&s| s > 0.7));
    }

    #[test]
    fn skyline_leaves_the_zenith_free() {
        let mut random = Random::new(6);
        let lines: Vec<Skyline> = (0..50).map(|_| Skyline::draw(&mut random)).collect();
        assert!(lines.iter().filter(|s| s.reflectance([0.0, 1.0, 0.0]).is_some()).count() < 10);
        assert!(lines.iter().filter(|s| s.reflectance([1.0, 0.0, 0.0]).is_some()).count() > 20);
    }
}
