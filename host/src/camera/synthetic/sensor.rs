//! The simulated sensor: light to codes, with shot and read noise, clipping, black level, response curves and bits.

use super::{Curve, SyntheticSettings};
use crate::camera::Frame;

const NOISE_TABLE: usize = 4096;
/// Steps of the root of the fraction from 0 to 1, by bits of a code: a power law is smooth there at 0.
const STEPS: usize = 8192;
const DEEP_STEPS: usize = 65_536;
/// Root of the largest fraction below black that a code still shows.
const BELOW_BLACK: f64 = 0.25;

/// The next number of splitmix64.
pub(super) fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Normal deviates in random order: cheap noise with an exact distribution.
fn noise_table(seed: u64) -> Vec<f32> {
    let mut state = seed;
    let mut uniform = || ((splitmix(&mut state) >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    let mut normal = || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
    (0..NOISE_TABLE).map(|_| normal() as f32).collect()
}

/// Light to codes.
pub(super) struct Sensor {
    /// Per channel: code by steps of the signed root of the fraction, from `-below` to 1.
    codes: [Vec<u16>; 3],
    below: f32,
    steps: f32,
    deep: bool,
    black: f64,
    full_well_electrons: f64,
    read_noise_electrons: f64,
    full_well_radiance_s: f64,
    noise: Vec<f32>,
}

/// How a frame is exposed.
pub(super) struct Shot {
    pub product_s: f64,
    pub gain: f64,
    /// Start of its noise.
    pub seed: u64,
}

impl Sensor {
    pub fn new(settings: &SyntheticSettings) -> Self {
        let deep = settings.bits > 8;
        let steps = if deep { DEEP_STEPS } else { STEPS };
        let below = if settings.black > 0.0 { BELOW_BLACK } else { 0.0 };
        let levels = f64::from((1u32 << settings.bits.clamp(8, 16)) - 1);
        // More than 8 bits are spread over 16, as drivers and PNG files do.
        let unit = if deep { 65_535.0 / levels } else { 1.0 };
        let table = |curve: Curve| -> Vec<u16> {
            let count = steps + (below * steps as f64) as usize;
            let of = |i: usize| {
                let root = i as f64 / steps as f64 - below;
                let share = settings.black + (1.0 - settings.black) * curve.code(root * root.abs());
                ((levels * share).round().clamp(0.0, levels) * unit).round() as u16
            };
            (0..=count).map(of).collect()
        };
        Sensor {
            codes: settings.curves().map(table),
            below: below as f32,
            steps: steps as f32,
            deep,
            black: settings.black,
            full_well_electrons: settings.full_well_electrons,
            read_noise_electrons: settings.read_noise_electrons,
            full_well_radiance_s: settings.full_well_radiance_s,
            noise: noise_table(settings.seed),
        }
    }

    /// Exposes the light that falls on pixels `(index, radiance)` into the codes of a frame of this size.
    pub fn expose(
        &self,
        (width, height): (usize, usize),
        light: impl Iterator<Item = (usize, [f32; 3])>,
        shot: &Shot,
        into: &mut Frame,
    ) {
        if self.deep {
            let codes = into.codes_u16(width, height);
            self.fill_dark(shot, |at, code| codes[at] = code, width * height);
            self.fill(light, shot, |at, code| codes[at] = code);
        } else {
            let codes = into.codes_u8(width, height);
            self.fill_dark(shot, |at, code| codes[at] = code as u8, width * height);
            self.fill(light, shot, |at, code| codes[at] = code as u8);
        }
    }

    /// Pixels that the lens does not image: black, and its noise where the black level lets it show.
    fn fill_dark(&self, shot: &Shot, mut put: impl FnMut(usize, u16), pixels: usize) {
        if self.black <= 0.0 {
            (0..3 * pixels).for_each(|at| put(at, 0));
            return;
        }
        let dark = (0..pixels).map(|index| (index, [0.0; 3]));
        self.fill(dark, &Shot { seed: !shot.seed, ..*shot }, put);
    }

    fn fill(&self, light: impl Iterator<Item = (usize, [f32; 3])>, shot: &Shot, mut put: impl FnMut(usize, u16)) {
        let scale = (shot.product_s / self.full_well_radiance_s) as f32;
        let shot_noise = (shot.gain / self.full_well_electrons) as f32;
        let read = ((shot.gain * self.read_noise_electrons / self.full_well_electrons) as f32).powi(2);
        let lowest = -self.below * self.below;
        let mut state = shot.seed;
        for (index, value) in light {
            let bits = splitmix(&mut state);
            for (k, value) in value.into_iter().enumerate() {
                let signal = value * scale;
                let deviate = self.noise[(bits >> (16 * k)) as usize % NOISE_TABLE];
                let noisy = (signal + deviate * (signal * shot_noise + read).sqrt()).clamp(lowest, 1.0);
                let root = noisy.abs().sqrt().copysign(noisy) + self.below;
                let step = (root * self.steps + 0.5) as usize;
                put(index * 3 + k, self.codes[k][step.min(self.codes[k].len() - 1)]);
            }
        }
    }
}
