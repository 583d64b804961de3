//! A synthetic sky camera: a known radiance map through lens, glare and passing things onto a sensor with flaws.
//!
//! Radiance (the sky model's with the sun's disc shared by the pixels it covers, or any lat-long map) x the filters' own
//! primaries x what passes before the sky x vignetting, then glare -> x exposure -> full-well fraction -> shot and read noise
//! -> clipping -> response curve per channel, black level -> code of 8 to 16 bits. Everything follows from the seed, the
//! frame's number and the time. A request shows `delay_frames` frames later; times are multiples of a step; frames may be
//! dropped or handed out twice.

mod curve;
mod ghosts;
mod optics;
mod sensor;
mod settings;

use super::{Camera, CameraError, CameraLimits, Exposure, Frame};
use crate::lens::Lens;
use crate::map::{RadianceMap, Taps};
use crate::skymodel::{SkyModel, disc_directions};
use crate::sun::SunPosition;
pub use curve::Curve;
pub use ghosts::{Ghosts, Passing};
pub use optics::Glare;
use optics::{SeenPixel, mixed, seen_pixels};
use sensor::{Sensor, Shot, splitmix};
pub use settings::{REC709, SyntheticSettings};
use std::collections::VecDeque;

/// See the module's text.
pub struct SyntheticCamera {
    settings: SyntheticSettings,
    lens: Lens,
    seen: Vec<SeenPixel>,
    /// Where each seen pixel takes its radiance from the sky's map.
    taps: Vec<Taps>,
    /// Truth: Rec.709 radiance per seen pixel at `sky_time_s`, before vignetting.
    truth: Vec<[f32; 3]>,
    sky: SkyModel,
    sky_time_s: f64,
    /// What reaches the sensor, per seen pixel; of the last frame where something passes.
    light: Vec<[f32; 3]>,
    time_s: f64,
    sequence: u64,
    current: Exposure,
    pending: VecDeque<(u64, Exposure)>,
    sensor: Sensor,
    /// The last frame, kept where frames may be repeated.
    last: Option<Frame>,
}

fn sky_of(settings: &SyntheticSettings, time_s: f64) -> SkyModel {
    let below = SunPosition { azimuth_deg: 0.0, altitude_deg: -90.0 };
    let position = settings.sun.or_else(|| crate::sun::sun_position(time_s, settings.place).ok()).unwrap_or(below);
    SkyModel::new(settings.atmosphere, position, settings.north_deg, time_s)
}

fn taps(settings: &SyntheticSettings, seen: &[SeenPixel]) -> Vec<Taps> {
    if let Some(map) = &settings.map {
        return seen.iter().map(|pixel| map.taps(pixel.dir)).collect();
    }
    let rows = settings.sky_rows;
    let map = RadianceMap { width: 2 * rows, height: rows, pixels: Vec::new() };
    // The map's rows next to the horizon must not mix sky and ground.
    let lowest = 0.5 * std::f32::consts::PI / rows as f32;
    seen.iter().map(|pixel| map.taps([pixel.dir[0], pixel.dir[1].max(lowest), pixel.dir[2]])).collect()
}

impl SyntheticCamera {
    /// A camera at its first moment.
    pub fn new(settings: SyntheticSettings) -> Self {
        let default = || Lens::zenith_equidistant(settings.width, settings.height, 185.0);
        let lens = settings.lens.clone().unwrap_or_else(default);
        let seen = seen_pixels(&settings, &lens);
        let time_s = settings.start_unix_s;
        let mut camera = SyntheticCamera {
            truth: vec![[0.0; 3]; seen.len()],
            light: vec![[0.0; 3]; seen.len()],
            taps: taps(&settings, &seen),
            sky: sky_of(&settings, time_s),
            sensor: Sensor::new(&settings),
            current: Exposure { exposure_s: settings.exposure_step_s, gain: 1.0 },
            settings,
            lens,
            seen,
            sky_time_s: f64::NAN,
            time_s,
            sequence: 0,
            pending: VecDeque::new(),
            last: None,
        };
        camera.look();
        camera
    }

    /// The lens.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// The sky as of the last frame: the truth behind the pictures, unless a map is.
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

    /// True Rec.709 radiance per pixel as of the last frame, sun's disc included; 0 where the lens sees nothing. What
    /// passes before the sky is not in it.
    pub fn truth(&self) -> Vec<[f32; 3]> {
        self.picture(self.truth.iter().copied())
    }

    /// True radiance per pixel in the camera's own primaries, as of the last frame, before vignetting and glare.
    pub fn truth_camera(&self) -> Vec<[f32; 3]> {
        let matrix = &self.settings.camera_from_rec709;
        self.picture(self.truth.iter().map(|&value| mixed(matrix, value)))
    }

    /// True radiance per pixel as it falls on the sensor in a frame (by its sequence number, under the sky of the last
    /// frame): camera primaries, vignetting, glare and clouds that pass; no birds. What merging can at best find.
    pub fn truth_at_sensor(&self, sequence: u64) -> Vec<[f32; 3]> {
        let mut light = Vec::new();
        self.image(self.passing(sequence).as_deref(), |passing| passing.sky, &mut light);
        self.picture(light.into_iter())
    }

    /// True where birds or moving clouds made the pictures of some frames differ by more than 2 %.
    pub fn ghost_mask(&self, sequences: &[u64]) -> Vec<bool> {
        let mut range = vec![[f32::INFINITY, 0.0f32]; self.seen.len()];
        for passing in sequences.iter().filter_map(|&sequence| self.passing(sequence)) {
            for (range, passing) in range.iter_mut().zip(passing) {
                *range = [range[0].min(passing.seen), range[1].max(passing.seen)];
            }
        }
        let mut mask = vec![false; self.settings.width * self.settings.height];
        for (pixel, [low, high]) in self.seen.iter().zip(range) {
            mask[pixel.index] = high > 1.02 * low;
        }
        mask
    }

    fn picture(&self, values: impl Iterator<Item = [f32; 3]>) -> Vec<[f32; 3]> {
        let mut picture = vec![[0.0; 3]; self.settings.width * self.settings.height];
        for (pixel, value) in self.seen.iter().zip(values) {
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

    /// The linear fraction (0..1) of each 8-bit code in green, for a response table.
    pub fn response_curve(&self) -> Vec<f64> {
        self.response_rows().iter().map(|row| row[2]).collect()
    }

    /// The true inverse response: rows `[code/max, R, G, B]`, 256 of them, full well = 1, 0 up to the black level.
    pub fn response_rows(&self) -> Vec<[f64; 4]> {
        let (curves, black) = (self.settings.curves(), self.settings.black);
        let row = |code: u32| {
            let share = f64::from(code) / 255.0;
            let [r, g, b] = curves.map(|curve| curve.fraction((share - black) / (1.0 - black)));
            [share, r, g, b]
        };
        (0..256).map(row).collect()
    }

    /// Evaluates the sky once per tenth of a second: clouds and sun move less than a pixel in that time.
    fn look(&mut self) {
        if (self.time_s - self.sky_time_s).abs() < 0.1 || (self.settings.map.is_some() && !self.sky_time_s.is_nan()) {
            return;
        }
        self.sky_time_s = self.time_s;
        self.sky = sky_of(&self.settings, self.time_s);
        if let Some(map) = &self.settings.map {
            self.truth.iter_mut().zip(&self.taps).for_each(|(value, taps)| *value = map.mix(taps));
        } else {
            let map = self.sky.map(self.settings.sky_rows);
            let ground = self.sky.ground_radiance();
            for ((value, pixel), taps) in self.truth.iter_mut().zip(&self.seen).zip(&self.taps) {
                *value = if pixel.dir[1] < 0.0 { ground } else { map.mix(taps) };
            }
            self.add_sun();
        }
        let mut light = std::mem::take(&mut self.light);
        self.image(None, |_| 1.0, &mut light);
        self.light = light;
    }

    /// What passes each seen pixel in a frame; none where nothing ever does.
    fn passing(&self, sequence: u64) -> Option<Vec<Passing>> {
        let size = (self.settings.width, self.settings.height);
        let pixels = || self.seen.iter().map(|pixel| pixel.index).collect::<Vec<_>>();
        (!self.settings.ghosts.none()).then(|| self.settings.ghosts.passing(size, sequence, &pixels()))
    }

    /// The light on the sensor, per seen pixel.
    fn image(&self, passing: Option<&[Passing]>, factor: impl Fn(&Passing) -> f32, into: &mut Vec<[f32; 3]>) {
        let matrix = &self.settings.camera_from_rec709;
        into.clear();
        into.extend(self.seen.iter().zip(&self.truth).enumerate().map(|(at, (pixel, &value))| {
            let own = if *matrix == REC709 { value } else { mixed(matrix, value) };
            let passed = pixel.passed * passing.map_or(1.0, |passing| factor(&passing[at]));
            own.map(|v| v * passed)
        }));
        self.settings.glare.scatter(&self.seen, (self.settings.width, self.settings.height), into);
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
        if self.repeats(into) {
            return Ok(());
        }
        while self.happens(self.settings.dropped_share, 0x6472_6f70) {
            self.advance();
        }
        while let Some(&(from, exposure)) = self.pending.front()
            && from <= self.sequence
        {
            self.current = exposure;
            self.pending.pop_front();
        }
        self.look();
        if let Some(passing) = self.passing(self.sequence) {
            let mut light = std::mem::take(&mut self.light);
            self.image(Some(&passing), |passing| passing.seen, &mut light);
            self.light = light;
        }
        let shot = Shot {
            product_s: self.current.product_s(),
            gain: self.current.gain,
            seed: self.settings.seed ^ self.sequence.wrapping_mul(0xd134_2543_de82_ef95),
        };
        let light = self.seen.iter().map(|pixel| pixel.index).zip(self.light.iter().copied());
        self.sensor.expose((self.settings.width, self.settings.height), light, &shot, into);
        into.exposure = self.current;
        into.sequence = self.sequence;
        into.captured_at_s = self.time_s;
        self.advance();
        if self.settings.repeated_share > 0.0 {
            self.last = Some(into.clone());
        }
        Ok(())
    }
}

impl SyntheticCamera {
    fn advance(&mut self) {
        self.sequence += 1;
        self.time_s += self.settings.frame_interval_s;
    }

    /// Whether something that happens to a share of frames happens to the next one.
    fn happens(&self, share: f64, salt: u64) -> bool {
        let mut state = (self.settings.seed << 32) ^ salt ^ self.sequence.wrapping_mul(0x9e6c_63d0_876a_3f6b);
        (splitmix(&mut state) >> 11) as f64 / ((1u64 << 53) as f64) < share.min(0.9)
    }

    /// Hands out the last frame again where it stands in for the next one.
    fn repeats(&mut self, into: &mut Frame) -> bool {
        if !self.happens(self.settings.repeated_share, 0x7265_7065) {
            return false;
        }
        let Some(last) = self.last.take() else { return false };
        into.clone_from(&last);
        self.last = Some(last);
        self.advance();
        true
    }
}

#[cfg(test)]
mod tests;
