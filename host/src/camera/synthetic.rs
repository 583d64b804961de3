//! A synthetic sky camera: the simulated sky through a fisheye onto an 8-bit sensor.
//!
//! Radiance (the sky model's, with the sun's disc shared by the pixels it covers) x vignetting x exposure -> full-well
//! fraction -> shot and read noise -> clipping -> response curve (a power law) -> code. Everything follows from the seed,
//! the frame's number and the time. A request shows `delay_frames` frames later; times are multiples of a step.

use super::{Camera, CameraError, CameraLimits, Exposure, Frame};
use crate::lens::Lens;
use crate::map::{RadianceMap, Taps};
use crate::skymodel::{Atmosphere, SkyModel, disc_directions};
use crate::sun::{Place, SunPosition};
use std::collections::VecDeque;

const NOISE_TABLE: usize = 4096;
const RESPONSE_STEPS: usize = 8192;

/// What the synthetic camera is like and where it stands.
#[derive(Clone, Debug)]
pub struct SyntheticSettings {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Lens and orientation; an equidistant one of 185 degrees that looks at the zenith if none.
    pub lens: Option<Lens>,
    /// Where it stands.
    pub place: Place,
    /// Where north lies, degrees from -Z towards +X.
    pub north_deg: f64,
    /// Air, clouds and ground.
    pub atmosphere: Atmosphere,
    /// A sun position that overrules time and place.
    pub sun: Option<SunPosition>,
    /// Time of the first frame, unix seconds.
    pub start_unix_s: f64,
    /// Time between frames, seconds.
    pub frame_interval_s: f64,
    /// Radiance x exposure x gain that fills the well, radiance unit x s.
    pub full_well_radiance_s: f64,
    /// Electrons of a full well.
    pub full_well_electrons: f64,
    /// Read noise, electrons rms.
    pub read_noise_electrons: f64,
    /// Code = 255 x fraction^(1 / gamma).
    pub gamma: f64,
    /// Share of light lost at 90 degrees off the axis, falling off with the square of the angle.
    pub vignetting: f64,
    /// Shortest exposure and step of exposure times, seconds.
    pub exposure_step_s: f64,
    /// Longest exposure, seconds.
    pub max_exposure_s: f64,
    /// Frames until a request shows.
    pub delay_frames: u32,
    /// Rows of the lat-long map through which the sky is seen; fewer are quicker and blur the clouds.
    pub sky_rows: usize,
    /// Noise.
    pub seed: u64,
}

impl Default for SyntheticSettings {
    fn default() -> Self {
        SyntheticSettings {
            width: 480,
            height: 480,
            lens: None,
            place: Place { latitude_deg: 48.0, longitude_deg: 11.0 },
            north_deg: 0.0,
            atmosphere: Atmosphere::default(),
            sun: None,
            start_unix_s: 1_782_043_200.0,
            frame_interval_s: 1.0 / 30.0,
            full_well_radiance_s: 0.04,
            full_well_electrons: 10_000.0,
            read_noise_electrons: 5.0,
            gamma: 2.2,
            vignetting: 0.0,
            exposure_step_s: 1e-4,
            max_exposure_s: 0.5,
            delay_frames: 2,
            sky_rows: 128,
            seed: 1,
        }
    }
}

/// A pixel that sees the sky: its index and direction, and the share of light that vignetting leaves.
struct SeenPixel {
    index: usize,
    dir: [f32; 3],
    passed: f32,
}

/// See the module's text.
pub struct SyntheticCamera {
    settings: SyntheticSettings,
    lens: Lens,
    seen: Vec<SeenPixel>,
    /// Where each seen pixel takes its radiance from the sky's map.
    taps: Vec<Taps>,
    /// Truth: radiance per seen pixel at `sky_time_s`, before vignetting.
    truth: Vec<[f32; 3]>,
    sky: SkyModel,
    sky_time_s: f64,
    time_s: f64,
    sequence: u64,
    current: Exposure,
    pending: VecDeque<(u64, Exposure)>,
    noise: Vec<f32>,
    response: Vec<u8>,
}

fn splitmix(state: &mut u64) -> u64 {
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

fn sky_of(settings: &SyntheticSettings, time_s: f64) -> SkyModel {
    let below = SunPosition { azimuth_deg: 0.0, altitude_deg: -90.0 };
    let position = settings.sun.or_else(|| crate::sun::sun_position(time_s, settings.place).ok()).unwrap_or(below);
    SkyModel::new(settings.atmosphere, position, settings.north_deg, time_s)
}

fn taps(sky_rows: usize, seen: &[SeenPixel]) -> Vec<Taps> {
    let map = RadianceMap { width: 2 * sky_rows, height: sky_rows, pixels: Vec::new() };
    // The map's rows next to the horizon must not mix sky and ground.
    let lowest = 0.5 * std::f32::consts::PI / sky_rows as f32;
    seen.iter().map(|pixel| map.taps([pixel.dir[0], pixel.dir[1].max(lowest), pixel.dir[2]])).collect()
}

impl SyntheticCamera {
    /// A camera at its first moment.
    pub fn new(settings: SyntheticSettings) -> Self {
        let default = || Lens::zenith_equidistant(settings.width, settings.height, 185.0);
        let lens = settings.lens.clone().unwrap_or_else(default);
        let axis =
            lens.unproject([0.5 * settings.width as f64, 0.5 * settings.height as f64]).unwrap_or([0.0, 1.0, 0.0]);
        let mut seen = Vec::new();
        for index in 0..settings.width * settings.height {
            let at = [(index % settings.width) as f64 + 0.5, (index / settings.width) as f64 + 0.5];
            let Some(dir) = lens.unproject(at) else { continue };
            let off_axis = (0..3).map(|k| axis[k] * dir[k]).sum::<f64>().clamp(-1.0, 1.0).acos();
            if off_axis > 1.65 {
                continue;
            }
            let passed = 1.0 - settings.vignetting * (off_axis / std::f64::consts::FRAC_PI_2).powi(2);
            seen.push(SeenPixel { index, dir: dir.map(|c| c as f32), passed: passed.max(0.0) as f32 });
        }
        let response = (0..=RESPONSE_STEPS)
            .map(|i| (255.0 * (i as f64 / RESPONSE_STEPS as f64).powf(2.0 / settings.gamma)).round() as u8)
            .collect();
        let time_s = settings.start_unix_s;
        let sky = sky_of(&settings, time_s);
        let noise = noise_table(settings.seed);
        let current = Exposure { exposure_s: settings.exposure_step_s, gain: 1.0 };
        let mut camera = SyntheticCamera {
            truth: vec![[0.0; 3]; seen.len()],
            taps: taps(settings.sky_rows, &seen),
            settings,
            lens,
            seen,
            sky,
            sky_time_s: f64::NAN,
            time_s,
            sequence: 0,
            current,
            pending: VecDeque::new(),
            noise,
            response,
        };
        camera.look();
        camera
    }

    /// The lens.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// The sky as of the last frame: the truth behind the pictures.
    pub fn sky(&self) -> &SkyModel {
        &self.sky
    }

    /// Takes in the sky of a time, unix seconds, without a frame; that of the next frame is the same.
    pub fn see(&mut self, unix_s: f64) {
        self.time_s = unix_s;
        self.look();
    }

    /// Index and true radiance of every pixel that the lens images, as of the last frame, in order.
    pub fn seen(&self) -> impl Iterator<Item = (usize, [f32; 3])> {
        self.seen.iter().map(|pixel| pixel.index).zip(self.truth.iter().copied())
    }

    /// True radiance per pixel as of the last frame, sun's disc included; 0 where the lens sees nothing.
    pub fn truth(&self) -> Vec<[f32; 3]> {
        let mut picture = vec![[0.0; 3]; self.settings.width * self.settings.height];
        for (pixel, &value) in self.seen.iter().zip(&self.truth) {
            picture[pixel.index] = value;
        }
        picture
    }

    /// Radiance of one full-well fraction per second: what turns merged frames into the sky's unit.
    pub fn radiance_scale(&self) -> f64 {
        self.settings.full_well_radiance_s
    }

    /// Sets the time of the next frame, unix seconds.
    pub fn set_time(&mut self, unix_s: f64) {
        self.time_s = unix_s;
    }

    /// Sets the response curve's exponent aside: the linear fraction (0..1) of each code, for a response table.
    pub fn response_curve(&self) -> Vec<f64> {
        (0..256).map(|code| (f64::from(code) / 255.0).powf(self.settings.gamma)).collect()
    }

    /// Evaluates the sky once per tenth of a second: clouds and sun move less than a pixel in that time.
    fn look(&mut self) {
        if (self.time_s - self.sky_time_s).abs() < 0.1 {
            return;
        }
        self.sky = sky_of(&self.settings, self.time_s);
        self.sky_time_s = self.time_s;
        let map = self.sky.map(self.settings.sky_rows);
        let ground = self.sky.ground_radiance();
        for ((value, pixel), taps) in self.truth.iter_mut().zip(&self.seen).zip(&self.taps) {
            *value = if pixel.dir[1] < 0.0 { ground } else { map.mix(taps) };
        }
        self.add_sun();
    }

    /// Adds the sun's disc; pixels share it by the area of the disc they see.
    fn add_sun(&mut self) {
        let Some(sun) = self.sky.sun() else { return };
        let count = 1024;
        for dir in disc_directions(sun.dir_world, count) {
            let Some(at) = self.lens.project(dir) else { continue };
            if at.iter().any(|&c| c < 0.0) || at[0] as usize >= self.settings.width {
                continue;
            }
            let index = at[1] as usize * self.settings.width + at[0] as usize;
            let centre = at.map(|c| c.floor() + 0.5);
            let (Ok(seen), Some(omega)) =
                (self.seen.binary_search_by_key(&index, |pixel| pixel.index), self.lens.solid_angle_sr(centre))
            else {
                continue;
            };
            let scale = 1.0 / (omega * f64::from(count));
            let value = &mut self.truth[seen];
            *value = std::array::from_fn(|k| value[k] + (f64::from(sun.irradiance[k]) * scale) as f32);
        }
    }
}

impl Camera for SyntheticCamera {
    fn limits(&self) -> CameraLimits {
        CameraLimits {
            width: self.settings.width,
            height: self.settings.height,
            min_exposure_s: self.settings.exposure_step_s,
            max_exposure_s: self.settings.max_exposure_s,
            exposure_step_s: self.settings.exposure_step_s,
            max_gain: 16.0,
            delay_frames: self.settings.delay_frames,
        }
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        let accepted = self.limits().nearest(exposure);
        self.pending.push_back((self.sequence + u64::from(self.settings.delay_frames), accepted));
        Ok(accepted)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        while let Some(&(from, exposure)) = self.pending.front()
            && from <= self.sequence
        {
            self.current = exposure;
            self.pending.pop_front();
        }
        self.look();
        let scale = (self.current.product_s() / self.settings.full_well_radiance_s) as f32;
        let gain = self.current.gain;
        let shot = (gain / self.settings.full_well_electrons) as f32;
        let read = ((gain * self.settings.read_noise_electrons / self.settings.full_well_electrons) as f32).powi(2);
        let mut state = self.settings.seed ^ self.sequence.wrapping_mul(0xd134_2543_de82_ef95);
        let codes = into.codes_u8(self.settings.width, self.settings.height);
        codes.fill(0);
        for (pixel, value) in self.seen.iter().zip(&self.truth) {
            let bits = splitmix(&mut state);
            for k in 0..3 {
                let signal = value[k] * pixel.passed * scale;
                let deviate = self.noise[(bits >> (16 * k)) as usize % NOISE_TABLE];
                let noisy = (signal + deviate * (signal * shot + read).sqrt()).clamp(0.0, 1.0);
                // The table runs over the root, where a power law is smooth at 0.
                codes[pixel.index * 3 + k] = self.response[(noisy.sqrt() * RESPONSE_STEPS as f32 + 0.5) as usize];
            }
        }
        into.exposure = self.current;
        into.sequence = self.sequence;
        into.captured_at_s = self.time_s;
        self.sequence += 1;
        self.time_s += self.settings.frame_interval_s;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> SyntheticSettings {
        SyntheticSettings { width: 64, height: 64, gamma: 1.0, ..SyntheticSettings::default() }
    }

    #[test]
    fn codes_follow_truth_and_exposure_after_the_delay() {
        let mut camera = SyntheticCamera::new(small());
        let wanted = camera.request(Exposure { exposure_s: 1.23e-3, gain: 1.0 }).unwrap();
        assert!((wanted.exposure_s - 1.2e-3).abs() < 1e-12);
        let mut frame = Frame::default();
        for expected in [1e-4, 1e-4, 1.2e-3] {
            camera.frame(&mut frame).unwrap();
            assert!((frame.exposure.exposure_s - expected).abs() < 1e-12, "{:?}", frame.exposure);
        }
        let truth = camera.truth();
        for (pixel, value) in truth.iter().enumerate() {
            for (k, &value) in value.iter().enumerate() {
                let fraction = f64::from(value) * 1.2e-3 / camera.radiance_scale();
                let spread = (fraction / 1e4 + (5e-4f64).powi(2)).sqrt() * 255.0;
                let expected = 255.0 * fraction.min(1.0);
                let off = (f64::from(frame.codes.get(pixel * 3 + k)) - expected).abs();
                assert!(fraction > 0.97 || off < 5.0 * spread + 0.6, "{pixel} {k}: {off}");
            }
        }
    }

    #[test]
    fn the_suns_disc_keeps_its_irradiance() {
        let settings = SyntheticSettings { width: 480, height: 480, ..small() };
        let mut camera = SyntheticCamera::new(settings);
        camera.frame(&mut Frame::default()).unwrap();
        let sun = camera.sky().sun().unwrap();
        let (mut sum, truth) = (0.0, camera.truth());
        for (pixel, value) in truth.iter().enumerate() {
            let at = [(pixel % 480) as f64 + 0.5, (pixel / 480) as f64 + 0.5];
            let dir = camera.lens().unproject(at).unwrap();
            if (0..3).map(|k| dir[k] * f64::from(sun.dir_world[k])).sum::<f64>() > 1.0f64.to_radians().cos() {
                let background = f64::from(camera.sky().radiance(dir.map(|c| c as f32))[1]);
                sum += (f64::from(value[1]) - background) * camera.lens().solid_angle_sr(at).unwrap();
            }
        }
        assert!((sum / f64::from(sun.irradiance[1]) - 1.0).abs() < 0.02, "{sum} {sun:?}");
    }

    #[test]
    fn the_same_seed_gives_the_same_frames() {
        let frames = |seed| {
            let mut camera = SyntheticCamera::new(SyntheticSettings { seed, ..small() });
            let mut frame = Frame::default();
            camera.frame(&mut frame).unwrap();
            camera.frame(&mut frame).unwrap();
            frame
        };
        assert_eq!(frames(3), frames(3));
        assert_ne!(frames(3).codes, frames(4).codes);
    }
}
