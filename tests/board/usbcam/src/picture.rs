//! One picture: the sky's radiance steps through the code tables, packed as YUYV.

use crate::codes::{Amplification, CodeTable, DEVIATES, ResponseTable};
use crate::controls::{Controls, NEUTRAL_K};
use crate::offer::MAX_SIDE;
use crate::settings::Settings;
use crate::sky::SkyPicture;
use crate::yuyv::{BLACK, pack};
use relume::camera::synthetic::SyntheticSettings;

const NOISE: usize = 1 << 16;

/// Cheap random numbers (splitmix64).
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn next_bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// Factors of red and blue at a white balance temperature, K: 1 at 6500; red x T / 6500, blue x (6500 / T)^1.7, which is
/// about what makes the light of a black body of that temperature grey.
pub fn white_balance(temperature_k: i32) -> [f64; 3] {
    let ratio = f64::from(temperature_k) / f64::from(NEUTRAL_K);
    [ratio, 1.0, ratio.powf(-1.7)]
}

/// Renders pictures; keeps its tables from one to the next.
pub struct Renderer {
    sensor: SyntheticSettings,
    response: ResponseTable,
    tables: [CodeTable; 3],
    /// Numbers of deviates, all equally likely; rows start anywhere in the first [`NOISE`].
    noise: Vec<u8>,
}

impl Renderer {
    /// A renderer for a sensor.
    pub fn new(sensor: SyntheticSettings) -> Self {
        let mut random = Random(sensor.seed);
        let length = NOISE + 3 * usize::from(MAX_SIDE);
        let noise = (0..length).map(|_| (random.next_bits() >> 32) as u8 % DEVIATES as u8).collect();
        Renderer {
            response: ResponseTable::new(sensor.gamma),
            sensor,
            tables: std::array::from_fn(|_| CodeTable::default()),
            noise,
        }
    }

    /// Renders the sky as frame `number` with settings into a YUYV picture (sized here).
    pub fn render(&mut self, sky: &SkyPicture, settings: Settings, number: u64, yuyv: &mut Vec<u8>) {
        yuyv.resize(sky.size.bytes() as usize, 0);
        let which = self.prepare(settings);
        let tables = which.map(|index| &self.tables[index]);
        let width = usize::from(sky.size.width);
        let mut random = Random(self.sensor.seed ^ number.wrapping_mul(0xd134_2543_de82_ef95));
        let rows = yuyv.chunks_exact_mut(2 * width).zip(sky.steps.chunks_exact(width)).zip(&sky.spans);
        for ((out, steps), span) in rows {
            let start = random.next_bits() as usize % NOISE;
            let noise = &self.noise[start..start + 3 * span.len()];
            let (left, right) = out.split_at_mut(2 * span.start);
            let (middle, right) = right.split_at_mut(2 * span.len());
            left.chunks_exact_mut(4).chain(right.chunks_exact_mut(4)).for_each(|pair| pair.copy_from_slice(&BLACK));
            render_row(tables, &steps[span.clone()], noise, middle);
        }
    }

    /// Makes the tables and says which one each channel takes.
    fn prepare(&mut self, settings: Settings) -> [usize; 3] {
        let gain = Controls::gain_of(settings.gain);
        let product_s = settings.exposure_s() * gain;
        let factors = white_balance(settings.temperature_k);
        let which = if factors == [1.0; 3] { [1; 3] } else { [0, 1, 2] };
        for index in which {
            let wanted = Amplification { product_s: product_s * factors[index], gain };
            self.tables[index].set(wanted, &self.sensor, &self.response);
        }
        which
    }

    /// Fills a picture with noise that has nothing to do with the sky.
    pub fn render_noise(&self, number: u64, yuyv: &mut [u8]) {
        let mut random = Random(number ^ 0x006e_6f69_7365);
        for eight in yuyv.chunks_mut(8) {
            let bytes = random.next_bits().to_le_bytes();
            eight.copy_from_slice(&bytes[..eight.len()]);
        }
    }
}

fn render_row(tables: [&CodeTable; 3], steps: &[[u16; 3]], noise: &[u8], yuyv: &mut [u8]) {
    let [red, green, blue] = tables;
    for ((pair, n), out) in steps.chunks_exact(2).zip(noise.chunks_exact(6)).zip(yuyv.chunks_exact_mut(4)) {
        let left = [red.code(pair[0][0], n[0]), green.code(pair[0][1], n[1]), blue.code(pair[0][2], n[2])];
        let right = [red.code(pair[1][0], n[3]), green.code(pair[1][1], n[4]), blue.code(pair[1][2], n[5])];
        out.copy_from_slice(&pack(left, right));
    }
}

/// A picture without any light.
pub fn render_black(yuyv: &mut [u8]) {
    yuyv.chunks_exact_mut(4).for_each(|pair| pair.copy_from_slice(&BLACK));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sky::Looker;
    use relume::camera::synthetic::SyntheticCamera;
    use relume::camera::{Camera, Exposure, Frame};

    fn sensor() -> SyntheticSettings {
        SyntheticSettings { width: 64, height: 64, delay_frames: 0, ..SyntheticSettings::default() }
    }

    fn settings(exposure_100us: u32) -> Settings {
        Settings { exposure_100us, gain: 0, temperature_k: NEUTRAL_K }
    }

    /// Mean luma by pixel of `count` pictures of the renderer.
    fn rendered(exposure_100us: u32, count: u64) -> Vec<f64> {
        let sky = Looker::new(sensor()).look(sensor().start_unix_s, "64x64".parse().unwrap());
        let (mut renderer, mut yuyv) = (Renderer::new(sensor()), Vec::new());
        let mut sums = vec![0.0; 64 * 64];
        for number in 0..count {
            renderer.render(&sky, settings(exposure_100us), number, &mut yuyv);
            sums.iter_mut().zip(yuyv.chunks_exact(2)).for_each(|(sum, y)| *sum += f64::from(y[0]) / count as f64);
        }
        sums
    }

    /// The same of the synthetic camera's codes by the standard's formula.
    fn synthetic(exposure_s: f64, count: u64) -> Vec<f64> {
        let mut camera = SyntheticCamera::new(sensor());
        camera.request(Exposure { exposure_s, gain: 1.0 }).unwrap();
        let (mut frame, mut sums) = (Frame::default(), vec![0.0; 64 * 64]);
        for _ in 0..count {
            camera.set_time(sensor().start_unix_s);
            camera.frame(&mut frame).unwrap();
            for (pixel, sum) in sums.iter_mut().enumerate() {
                let [r, g, b] = [0, 1, 2].map(|k| f64::from(frame.codes.get(3 * pixel + k)));
                *sum += (16.0 + 219.0 / 255.0 * (0.299 * r + 0.587 * g + 0.114 * b)) / count as f64;
            }
        }
        sums
    }

    #[test]
    fn pictures_are_those_of_the_synthetic_camera() {
        for exposure_100us in [3, 30, 300] {
            let found = rendered(exposure_100us, 64);
            let expected = synthetic(f64::from(exposure_100us) * 1e-4, 64);
            let off: Vec<f64> = found.iter().zip(&expected).map(|(a, b)| a - b).collect();
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            let worst = off.iter().map(|d| d.abs()).fold(0.0, f64::max);
            // The noise of a mean of 64 is about 0.2 codes.
            assert!(mean.abs() < 0.1 && worst < 1.2, "{exposure_100us}: {mean} {worst}");
        }
    }

    #[test]
    fn white_balance_moves_red_and_blue_apart() {
        let sky = Looker::new(sensor()).look(sensor().start_unix_s, "64x64".parse().unwrap());
        let (mut renderer, mut yuyv) = (Renderer::new(sensor()), Vec::new());
        let mut chroma = |temperature_k| {
            renderer.render(&sky, Settings { temperature_k, ..settings(20) }, 1, &mut yuyv);
            let middle = &yuyv[2 * (32 * 64 + 20)..][..4];
            (i32::from(middle[1]), i32::from(middle[3]))
        };
        let (neutral, warm) = (chroma(NEUTRAL_K), chroma(3000));
        assert!(warm.0 > neutral.0 + 10 && warm.1 < neutral.1 - 10, "{warm:?} {neutral:?}");
        let [red, green, blue] = white_balance(3250);
        assert!(red == 0.5 && green == 1.0 && (blue - 3.249).abs() < 1e-3);
    }

    #[test]
    fn frames_differ_by_their_noise_alone() {
        let sky = Looker::new(sensor()).look(sensor().start_unix_s, "64x64".parse().unwrap());
        let mut renderer = Renderer::new(sensor());
        let mut frame = |number| {
            let mut yuyv = Vec::new();
            renderer.render(&sky, settings(20), number, &mut yuyv);
            yuyv
        };
        assert_eq!(frame(5), frame(5));
        assert_ne!(frame(5), frame(6));
    }
}
