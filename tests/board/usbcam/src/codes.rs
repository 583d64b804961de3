//! The sensor's inner part in whole numbers: radiance to codes through a table per exposure.
//!
//! It is the synthetic camera of `relume` (shot and read noise, clipping, response curve) made cheap enough for an emulated
//! processor, where a floating-point operation costs a hundred times an integer one. Radiance is kept as a step on a scale
//! of 256 steps per octave; a table gives the code for each step and each of 16 equally likely deviates of the noise.

use relume::camera::synthetic::SyntheticSettings;

/// Deviates of the noise.
pub const DEVIATES: usize = 16;
/// The step of pixels that the lens does not image: always black.
pub const UNSEEN: u16 = 0;

const STEPS: usize = 1 << 14;
const ENTRIES: usize = STEPS * DEVIATES;
/// Steps below the one of radiance 1 (2^-40 is the least).
const LOWEST: u32 = (127 - 40) << 8;
/// A full well, in the linear units of the tables.
const FULL: f32 = 65_535.0;
/// Means of the 16 equally likely parts of a normal distribution, times 256, scaled to variance 1.
const NORMAL_256: [i32; DEVIATES] =
    [-509, -343, -262, -201, -150, -104, -61, -20, 20, 61, 104, 150, 201, 262, 343, 509];

/// The step of a radiance.
pub fn step(radiance: f32) -> u16 {
    let step = (radiance.max(0.0).to_bits() >> 15).saturating_sub(LOWEST);
    step.clamp(1, STEPS as u32 - 1) as u16
}

/// The radiance in the middle of a step.
pub fn radiance(step: u16) -> f32 {
    f32::from_bits(((u32::from(step) + LOWEST) << 15) | 1 << 14)
}

/// The response curve: code of each linear unit.
#[derive(Clone, Debug)]
pub struct ResponseTable(Vec<u8>);

impl ResponseTable {
    /// Code = 255 x fraction^(1 / gamma).
    pub fn new(gamma: f64) -> Self {
        ResponseTable(
            (0..=65_535).map(|i| (255.0 * (f64::from(i) / 65_535.0).powf(1.0 / gamma)).round() as u8).collect(),
        )
    }

    fn code(&self, linear: i32) -> u8 {
        self.0[linear.clamp(0, 65_535) as usize]
    }
}

/// What a table is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amplification {
    /// Exposure time x gain x the channel's white balance, seconds.
    pub product_s: f64,
    /// Gain.
    pub gain: f64,
}

/// Codes by radiance step and deviate, for one channel at one exposure.
#[derive(Clone, Debug)]
pub struct CodeTable {
    made_for: Amplification,
    codes: Box<[u8; ENTRIES]>,
}

impl Default for CodeTable {
    fn default() -> Self {
        let nothing = Amplification { product_s: 0.0, gain: 0.0 };
        // A large array would go over the stack.
        let codes = vec![0u8; ENTRIES].into_boxed_slice();
        let codes = codes.try_into().unwrap_or_else(|_| Box::new([0; ENTRIES]));
        CodeTable { made_for: nothing, codes }
    }
}

impl CodeTable {
    /// Makes the table for an amplification, unless it is made for it already.
    pub fn set(&mut self, wanted: Amplification, sensor: &SyntheticSettings, response: &ResponseTable) {
        if self.made_for == wanted {
            return;
        }
        self.made_for = wanted;
        let scale = (wanted.product_s / sensor.full_well_radiance_s) as f32;
        let shot = (wanted.gain / sensor.full_well_electrons) as f32;
        let read = ((wanted.gain * sensor.read_noise_electrons / sensor.full_well_electrons) as f32).powi(2);
        let row = |step: u16| -> [u8; DEVIATES] {
            let signal = radiance(step) * scale;
            let sigma = (FULL * (signal * shot + read).sqrt()) as i32;
            let linear = (FULL * signal).min(1e8) as i32;
            NORMAL_256.map(|deviate| response.code(linear + ((deviate * sigma) >> 8)))
        };
        // Below a hundred-thousandth of a well all is dark alike, above twice a well all is white.
        let (dark, white) = (step(1e-5 / scale), step(2.0 / scale));
        let rows = self.codes.chunks_exact_mut(DEVIATES);
        let (dark_row, white_row) = (row(dark), row(white));
        for (number, entry) in rows.enumerate().skip(1) {
            let codes = match number as u16 {
                step if step <= dark => dark_row,
                step if step >= white => white_row,
                step => row(step),
            };
            entry.copy_from_slice(&codes);
        }
    }

    /// Code of a radiance step with a deviate's number (0..16).
    pub fn code(&self, step: u16, deviate: u8) -> u8 {
        let index = usize::from(step) * DEVIATES + usize::from(deviate);
        self.codes[index % ENTRIES]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviates_are_normal() {
        let mean: i32 = NORMAL_256.iter().sum();
        let variance = NORMAL_256.iter().map(|d| (f64::from(*d) / 256.0).powi(2)).sum::<f64>() / 16.0;
        assert_eq!(mean, 0);
        assert!((variance - 1.0).abs() < 0.01, "{variance}");
    }

    #[test]
    fn steps_hold_their_radiance_within_a_quarter_percent() {
        for radiance_in in [1e-9f32, 3.3e-7, 0.5, 1.0, 7.7, 2.0e6] {
            let back = radiance(step(radiance_in));
            assert!((back / radiance_in - 1.0).abs() < 0.0025, "{radiance_in} {back}");
        }
        assert_eq!((step(0.0), step(f32::MAX), step(-1.0)), (1, STEPS as u16 - 1, 1));
    }

    #[test]
    fn codes_are_the_response_of_the_exposed_radiance() {
        let sensor = SyntheticSettings::default();
        let mut table = CodeTable::default();
        for (product_s, gain) in [(1e-4, 1.0), (3e-3, 1.0), (0.1, 8.0)] {
            table.set(Amplification { product_s, gain }, &sensor, &ResponseTable::new(2.2));
            for fraction in [0.02f64, 0.1, 0.4, 0.7] {
                let light = fraction * 0.04 / product_s;
                let of = |deviate| f64::from(table.code(step(light as f32), deviate));
                let codes: Vec<f64> = (0..16).map(of).collect();
                let mean = codes.iter().sum::<f64>() / 16.0;
                let spread = (codes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / 16.0).sqrt();
                // Closed form: 255 f^(1/2.2) and its slope times the electrons' noise.
                let sigma = (fraction * gain / 1e4 + (5.0 * gain / 1e4).powi(2)).sqrt();
                let (code, slope) = (255.0 * fraction.powf(1.0 / 2.2), 255.0 / 2.2 * fraction.powf(1.0 / 2.2 - 1.0));
                let tolerance = 0.5 + 0.05 * slope * sigma;
                assert!((mean - code).abs() < tolerance, "{product_s} {fraction}: {mean} {code}");
                assert!((spread - slope * sigma).abs() < 0.4 + 0.1 * slope * sigma, "{fraction}: {spread}");
            }
            assert_eq!((table.code(step(1e6), 0), table.code(UNSEEN, 3)), (255, 0));
        }
    }
}
