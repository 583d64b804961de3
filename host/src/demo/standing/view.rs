//! The view camera of the study: a path trace of what is before it, its exposure, white balance, noise and curve.

use relume_bake::camera::Camera;
use relume_bake::environment::{Environment, EnvironmentError, Reference, reference};
use relume_bake::scene::Scene;

use super::SIZE;
use crate::demo::backdrop;
use crate::map::luminance;
use crate::picture::{srgb_code, srgb_linear};
use crate::skymodel::SkyModel;

/// Paths per pixel.
const SAMPLES: u32 = 192;
/// Rows of the map of a sky.
pub(super) const MAP_HEIGHT: usize = 256;
/// White balance: what red, green and blue are multiplied by besides the exposure.
const BALANCE: [f64; 3] = [1.12, 1.0, 0.84];
/// What a white sheet on the ground is shown as, linear.
const WHITE: f64 = 0.8;
/// Electrons at white, and read noise in electrons: a small sensor.
const FULL_WELL: f64 = 9000.0;
const READ_NOISE: f64 = 4.0;

/// The mean of two traces of one scene.
pub(super) fn mean_of(a: &Reference, b: &Reference) -> Reference {
    let rgb = a.rgb.iter().zip(&b.rgb).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c])));
    let coverage = a.coverage.iter().zip(&b.coverage).map(|(a, b)| 0.5 * (a + b));
    Reference { rgb: rgb.collect(), coverage: coverage.collect(), ..*a }
}

/// A view camera that has chosen its exposure.
pub(super) struct ViewCamera<'s> {
    gains: [f64; 3],
    seed: u64,
    sky: &'s SkyModel,
    camera: &'s Camera,
}

impl<'s> ViewCamera<'s> {
    /// Exposed for the light of a sky.
    pub(super) fn exposed(sky: &'s SkyModel, camera: &'s Camera, seed: u64) -> Self {
        let white = f64::from(luminance(sky.horizontal_irradiance())) / std::f64::consts::PI;
        ViewCamera { gains: BALANCE.map(|balance| balance * WHITE / white.max(1e-12)), seed, sky, camera }
    }

    /// Linear light per radiance, red, green and blue.
    pub(super) fn gains(&self) -> [f64; 3] {
        self.gains
    }

    /// What is before it: linear radiance. Other `paths` have other noise.
    pub(super) fn trace(&self, scene: &Scene, paths: u64) -> Result<Reference, EnvironmentError> {
        let map = self.sky.map(MAP_HEIGHT);
        let sun = self.sky.sun().map(|sun| (sun.dir_world, sun.irradiance));
        let environment = Environment::new(map.width, map.height, map.pixels, sun)?;
        Ok(reference(scene, self.camera, &environment, SIZE, SAMPLES, self.seed ^ paths))
    }

    /// The picture that it takes, `0x00RRGGBB`; with its noise or without.
    pub(super) fn picture(&self, before: &Reference, with_noise: bool) -> Vec<u32> {
        let behind = backdrop::paint(self.sky, self.camera, SIZE, self.gains.map(|gain| gain as f32));
        let mut noise = Noise(self.seed | 1);
        let pixels = before.rgb.iter().zip(&before.coverage).zip(&behind);
        let taken = pixels.map(|((rgb, &share), behind)| {
            let behind = behind.to_be_bytes();
            let code = |channel: usize| {
                let open = (1.0 - f64::from(share)) * srgb_linear(behind[1 + channel]);
                let light = f64::from(rgb[channel]) * self.gains[channel] + open;
                srgb_code(if with_noise { noise.taken(light) } else { light })
            };
            let [r, g, b] = [0, 1, 2].map(code);
            u32::from_be_bytes([0, r, g, b])
        });
        taken.collect()
    }
}

/// Shot and read noise.
struct Noise(u64);

impl Noise {
    /// Light (1 = white) as it is counted.
    fn taken(&mut self, light: f64) -> f64 {
        let sigma = (light.max(0.0) * FULL_WELL + READ_NOISE * READ_NOISE).sqrt() / FULL_WELL;
        (light + sigma * self.normal()).min(1.0)
    }

    /// The sum of twelve uniform numbers, less six.
    fn normal(&mut self) -> f64 {
        let mut unit = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f64 / (1u64 << 24) as f64
        };
        (0..12).map(|_| unit()).sum::<f64>() - 6.0
    }
}
