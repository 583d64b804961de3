//! What lies before the simulated sensor: which pixels see the sky, vignetting, the filters' own primaries, glare.

use super::SyntheticSettings;
use crate::lens::Lens;

/// A pixel that sees the sky: its index and direction, and the share of light that vignetting leaves.
pub(super) struct SeenPixel {
    pub index: usize,
    pub dir: [f32; 3],
    pub passed: f32,
}

/// Largest angle off the axis that the lens images, radians.
const WIDEST: f64 = 1.65;

/// The pixels that the lens images, in order.
pub(super) fn seen_pixels(settings: &SyntheticSettings, lens: &Lens) -> Vec<SeenPixel> {
    let axis = lens.unproject([0.5 * settings.width as f64, 0.5 * settings.height as f64]).unwrap_or([0.0, 1.0, 0.0]);
    let pixel = |index: usize| {
        let at = [(index % settings.width) as f64 + 0.5, (index / settings.width) as f64 + 0.5];
        let dir = lens.unproject(at)?;
        let off_axis = (0..3).map(|k| axis[k] * dir[k]).sum::<f64>().clamp(-1.0, 1.0).acos();
        let passed = 1.0 - settings.vignetting * (off_axis / std::f64::consts::FRAC_PI_2).powi(2);
        let seen = SeenPixel { index, dir: dir.map(|c| c as f32), passed: passed.max(0.0) as f32 };
        (off_axis <= WIDEST).then_some(seen)
    };
    (0..settings.width * settings.height).filter_map(pixel).collect()
}

/// Light that lens and housing scatter; the rest stays where it belongs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Glare {
    /// Share of all light that is spread evenly over the pixels that see the sky (veiling glare).
    pub veil: f64,
    /// Share of each pixel's light that is spread around it, falling off exponentially in both directions.
    pub halo: f64,
    /// Length over which the halo falls to 1/e, pixels.
    pub halo_px: f64,
}

impl Glare {
    /// A clean lens of the usual kind, whose picture of the whole sky is `picture_px` across: of a hundredth of the light that it
    /// scatters, most stays within a few degrees.
    pub fn usual(picture_px: usize) -> Self {
        Glare { veil: 0.003, halo: 0.007, halo_px: picture_px as f64 / 120.0 }
    }

    /// Scatters the light of `light` (one entry per seen pixel).
    pub(super) fn scatter(&self, seen: &[SeenPixel], (width, height): (usize, usize), light: &mut [[f32; 3]]) {
        if self.veil <= 0.0 && self.halo <= 0.0 {
            return;
        }
        let mut mean = [0.0f64; 3];
        for value in light.iter() {
            (0..3).for_each(|k| mean[k] += f64::from(value[k]) / light.len() as f64);
        }
        let spread = self.spread(seen, (width, height), light);
        let own = (1.0 - self.veil - self.halo) as f32;
        for (at, value) in light.iter_mut().enumerate() {
            let around = spread.get(seen[at].index).copied().unwrap_or_default();
            *value = std::array::from_fn(|k| {
                own * value[k] + self.veil as f32 * mean[k] as f32 + self.halo as f32 * around[k]
            });
        }
    }

    /// The whole picture through the halo's point spread; empty without a halo.
    fn spread(&self, seen: &[SeenPixel], (width, height): (usize, usize), light: &[[f32; 3]]) -> Vec<[f32; 3]> {
        if self.halo <= 0.0 {
            return Vec::new();
        }
        let mut picture = vec![[0.0f32; 3]; width * height];
        for (pixel, value) in seen.iter().zip(light) {
            picture[pixel.index] = *value;
        }
        let keep = (-1.0 / self.halo_px.max(0.1)).exp() as f32;
        for row in 0..height {
            run(&mut picture, row * width, 1, width, keep);
        }
        for col in 0..width {
            run(&mut picture, col, width, height, keep);
        }
        picture
    }
}

/// A recursive exponential filter along one line, there and back: symmetric, of sum 1.
fn run(picture: &mut [[f32; 3]], start: usize, step: usize, count: usize, keep: f32) {
    let there = (0..count).map(|i| start + i * step);
    for order in [there.clone().collect::<Vec<_>>(), there.rev().collect()] {
        let mut state = [0.0f32; 3];
        for at in order {
            state = std::array::from_fn(|k| keep * state[k] + (1.0 - keep) * picture[at][k]);
            picture[at] = state;
        }
    }
}

/// `matrix * rgb`.
pub(super) fn mixed(matrix: &[[f64; 3]; 3], rgb: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| (0..3).map(|k| row[k] * f64::from(rgb[k])).sum::<f64>().max(0.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(count: usize) -> Vec<SeenPixel> {
        (0..count * count).map(|index| SeenPixel { index, dir: [0.0, 1.0, 0.0], passed: 1.0 }).collect()
    }

    #[test]
    fn glare_keeps_all_light_and_spreads_its_share() {
        let (size, seen) = (101, line(101));
        let mut light = vec![[0.0f32; 3]; size * size];
        let centre = 50 * size + 50;
        light[centre] = [1000.0, 2000.0, 0.0];
        Glare { veil: 0.1, halo: 0.2, halo_px: 3.0 }.scatter(&seen, (size, size), &mut light);
        let total: f64 = light.iter().map(|v| f64::from(v[0])).sum();
        assert!((total - 1000.0).abs() < 0.5, "{total}");
        let veil = 0.1 * 1000.0 / (size * size) as f32;
        assert!((light[0][0] / veil - 1.0).abs() < 1e-3, "{} {veil}", light[0][0]);
        // Closed form of the halo along an axis: e^(-d / px).
        let halo = |d: usize| light[centre + d][1] - 2.0 * veil;
        assert!((halo(7) / halo(4) - (-1.0f32).exp()).abs() < 1e-2, "{} {}", halo(7), halo(4));
        let down = |d: usize| light[centre + d * size][1] - 2.0 * veil;
        assert!((down(7) / halo(7) - 1.0).abs() < 1e-2 && (down(1) / halo(1) - 1.0).abs() < 1e-2);
        assert!(light[centre][0] > 700.0 && light[centre][2] == 0.0);
    }
}
