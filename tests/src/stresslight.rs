//! Lights that are hard on numbers, per patch.

use crate::stressfield::scatter;
use relume_firmware::patches::PatchSet;
use relume_firmware::weights::Apart;

/// Radiance per patch; the exposure is 1.
pub type PatchLight = Vec<[f32; 3]>;

/// Random numbers in 0..1 from a seed.
#[derive(Clone, Debug)]
pub struct Chance(pub u32);

impl Chance {
    /// The next number, below 1.
    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9);
        (scatter(self.0) >> 8) as f32 / (1u32 << 24) as f32
    }

    /// A whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f32) as usize
    }
}

/// All light of these patches, to be set apart.
pub fn whole(light: &PatchLight, patches: &[u16]) -> Vec<Apart> {
    patches.iter().map(|&patch| Apart { patch, light: light[usize::from(patch)] }).collect()
}

/// One patch, and no other.
pub fn alone(patches: usize, patch: usize, radiance: f32) -> PatchLight {
    let mut light = vec![[0.0; 3]; patches];
    light[patch] = [radiance; 3];
    light
}

/// A sky as a camera sees it: a gradient with a glow somewhere and broken clouds; mean radiance about `level`.
pub fn captured(set: &PatchSet, seed: u32, level: f32) -> PatchLight {
    let mut chance = Chance(seed);
    let (azimuth, altitude) = (chance.unit() * std::f32::consts::TAU, chance.unit() * 1.5);
    let sun = [altitude.cos() * azimuth.cos(), altitude.sin(), altitude.cos() * azimuth.sin()];
    let (glow, clouds, ground) = (20.0 * chance.unit(), chance.unit(), 0.4 * chance.unit());
    let of_patch = |patch: usize| {
        let d = set.dir_world(patch);
        let near: f32 = d.iter().zip(sun).map(|(a, b)| a * b).sum();
        let blob = ((7.0 * d[0] + seed as f32).sin() * (6.0 * d[2]).cos() * (9.0 * d[1]).sin()).max(0.0);
        let smooth = 0.4 + d[1].max(0.0) + glow * near.max(0.0).powi(40) + 1.5 * clouds * blob;
        let share = if d[1] >= 0.0 { smooth } else { ground };
        [0.8, 1.0, 1.3].map(|tint| level * share * tint)
    };
    (0..set.len()).map(of_patch).collect()
}

/// A captured sky with a lamp in one patch that is `times` as bright as the sky's mean.
pub fn torch(set: &PatchSet, seed: u32, times: f32) -> PatchLight {
    let mut light = captured(set, seed, 1.0);
    light[scatter(seed) as usize % set.len()] = [times, 0.6 * times, 0.3 * times];
    light
}

/// Light where a residual is positive (or negative), with its size as radiance or without.
pub fn along(residual: &[f32], sign: f32, sized: bool) -> PatchLight {
    let top = residual.iter().fold(0.0f32, |top, r| top.max(r.abs())).max(f32::MIN_POSITIVE);
    let of_patch = |r: &f32| {
        let value = if r * sign > 0.0 { 0.5 } else { 0.0 };
        [if sized { value * r.abs() / top } else { value }; 3]
    };
    residual.iter().map(of_patch).collect()
}

/// The sum of two lights.
pub fn both(a: &PatchLight, b: &PatchLight) -> PatchLight {
    a.iter().zip(b).map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]).collect()
}

/// A light times a number.
pub fn times(light: &PatchLight, factor: f32) -> PatchLight {
    light.iter().map(|rgb| rgb.map(|value| value * factor)).collect()
}
