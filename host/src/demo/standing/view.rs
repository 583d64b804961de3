//! The view camera of the study: a path trace of what is before it through its lens, its exposure, white balance, noise and
//! response. The post knows its lens as measured, its response, and nothing of the rest.

use relume_bake::camera::Camera;
use relume_bake::environment::{Environment, EnvironmentError, Reference, reference};
use relume_bake::random::Random;
use relume_bake::scene::Scene;
use relume_firmware::patches::PatchSet;

use super::film;
use crate::demo::backdrop;
use crate::map::luminance;
use crate::picture::{srgb_code, srgb_linear};
use crate::skymodel::SkyModel;

/// Rows of the map of a sky.
pub(super) const MAP_HEIGHT: usize = 256;
/// White balance, from moment to moment as the camera's own whim has it: what red, green and blue are multiplied by besides the
/// exposure, at least and at most.
const BALANCE: [[f64; 2]; 3] = [[0.9, 1.25], [1.0, 1.0], [0.75, 1.1]];
/// What a white sheet on the ground is shown as, linear, and how many stops the camera's exposure is off that at most.
const WHITE: f64 = 0.8;
const WHIM_EV: f64 = 0.5;
/// Electrons at white, and read noise in electrons: a small sensor.
const FULL_WELL: f64 = 9000.0;
const READ_NOISE: f64 = 4.0;

/// The mean of two traces of one scene.
pub(super) fn mean_of(a: &Reference, b: &Reference) -> Reference {
    let rgb = a.rgb.iter().zip(&b.rgb).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c])));
    let coverage = a.coverage.iter().zip(&b.coverage).map(|(a, b)| 0.5 * (a + b));
    Reference { rgb: rgb.collect(), coverage: coverage.collect(), ..*a }
}

/// A view camera that has chosen its exposure and white balance.
pub(super) struct ViewCamera<'s> {
    /// Linear light per radiance, red, green and blue.
    pub(super) gains: [f64; 3],
    seed: u64,
    sky: SkyModel,
    camera: &'s Camera,
}

impl<'s> ViewCamera<'s> {
    /// Exposed for the light of a sky, as well as such cameras do.
    pub(super) fn exposed(sky: SkyModel, camera: &'s Camera, seed: u64) -> Self {
        let white = f64::from(luminance(sky.horizontal_irradiance())) / std::f64::consts::PI;
        let mut whim = Random::new(seed);
        let exposure = WHITE / white.max(1e-12) * (WHIM_EV * (2.0 * whim.unit() - 1.0)).exp2();
        let gains = BALANCE.map(|[least, most]| exposure * (least + (most - least) * whim.unit()));
        ViewCamera { gains, seed, sky, camera }
    }

    /// Sum of the true sky's colours over patches.
    pub(super) fn light_sum(&self, patches: &PatchSet) -> [f64; 3] {
        let weights = self.sky.weights(patches);
        std::array::from_fn(|c| weights.radiance.iter().map(|rgb| f64::from(rgb[c])).sum())
    }

    /// What is before it: linear radiance in a picture of `size` = width and height, `samples` paths per pixel. Other `paths` have
    /// other noise.
    pub(super) fn trace(
        &self,
        scene: &Scene,
        (size, samples): ((u32, u32), u32),
        paths: u64,
    ) -> Result<Reference, EnvironmentError> {
        let map = self.sky.map(MAP_HEIGHT);
        let sun = self.sky.sun().map(|sun| (sun.dir_world, sun.irradiance));
        let environment = Environment::new(map.width, map.height, map.pixels, sun)?;
        Ok(reference(scene, self.camera, &environment, size, samples, self.seed ^ paths))
    }

    /// The picture that it takes: codes of its own response, `0x00RRGGBB`, noisy and clipped.
    pub(super) fn picture(&self, before: &Reference) -> Vec<u32> {
        let mut chance = Random::new(self.seed.wrapping_add(1));
        self.light(before).iter().map(|rgb| word(|c| film::code(counted(rgb[c], &mut chance), c))).collect()
    }

    /// What it should be shown as: sRGB of its light without noise, clipped where it clips.
    pub(super) fn ideal(&self, before: &Reference) -> Vec<u32> {
        self.light(before).iter().map(|rgb| word(|c| srgb_code(rgb[c]))).collect()
    }

    /// Linear light, 1 where it clips, of every pixel.
    fn light(&self, before: &Reference) -> Vec<[f64; 3]> {
        let size = (before.width, before.height);
        let behind = backdrop::paint(&self.sky, self.camera, size, self.gains.map(|gain| gain as f32));
        let pixels = before.rgb.iter().zip(&before.coverage).zip(&behind);
        let light = pixels.map(|((rgb, &share), behind)| {
            let behind = behind.to_be_bytes();
            std::array::from_fn(|c| {
                f64::from(rgb[c]) * self.gains[c] + (1.0 - f64::from(share)) * srgb_linear(behind[1 + c])
            })
        });
        light.collect()
    }
}

/// `0x00RRGGBB` of three codes.
fn word(mut code: impl FnMut(usize) -> u8) -> u32 {
    let [r, g, b] = [0, 1, 2].map(&mut code);
    u32::from_be_bytes([0, r, g, b])
}

/// Light (1 = full well) as a sensor with shot and read noise counts it.
fn counted(light: f64, chance: &mut Random) -> f64 {
    let sigma = (light.max(0.0) * FULL_WELL + READ_NOISE * READ_NOISE).sqrt() / FULL_WELL;
    (light + sigma * chance.normal()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::Day;
    use super::*;
    use relume_bake::demo_scene;

    const NOON: f64 = 1_790_935_200.0;

    fn even(light: [f64; 3], gains: [f64; 3]) -> Reference {
        let rgb = vec![std::array::from_fn(|c| (light[c] / gains[c]) as f32); 4000];
        Reference { width: 80, height: 50, coverage: vec![1.0; rgb.len()], rgb }
    }

    fn channel(pixels: &[u32], c: usize) -> impl Iterator<Item = u8> + '_ {
        pixels.iter().map(move |word| word.to_be_bytes()[1 + c])
    }

    #[test]
    fn what_it_takes_is_its_light_by_its_response_with_a_sensors_noise() {
        let camera = demo_scene::site().1;
        let camera = ViewCamera::exposed(Day::all().next().unwrap().sky(NOON).unwrap(), &camera, 5);
        let light = [0.02, 0.2, 0.7];
        let taken = camera.picture(&even(light, camera.gains));
        for (c, light) in light.into_iter().enumerate() {
            let counted: Vec<f64> = channel(&taken, c).map(|code| film::light(f64::from(code) / 255.0, c)).collect();
            let mean = counted.iter().sum::<f64>() / counted.len() as f64;
            let variance = counted.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / counted.len() as f64;
            // Electrons that come by chance, those of reading them, and codes that are a step wide.
            let code = film::code(light, c);
            let step = film::light(f64::from(code + 1) / 255.0, c) - film::light(f64::from(code) / 255.0, c);
            let expected = light / FULL_WELL + (READ_NOISE / FULL_WELL).powi(2) + step * step / 12.0;
            assert!((mean / light - 1.0).abs() < 0.01, "{c}: {mean}");
            assert!((variance / expected - 1.0).abs() < 0.15, "{c}: {variance} {expected}");
        }
    }

    #[test]
    fn what_is_too_bright_is_clipped_and_what_it_should_show_is_srgb() {
        let camera = demo_scene::site().1;
        let camera = ViewCamera::exposed(Day::all().next().unwrap().sky(NOON).unwrap(), &camera, 6);
        let before = even([0.5, 0.214_041, 1.4], camera.gains);
        assert!(camera.ideal(&before).iter().all(|&word| word == 0x00bc_7fff));
        let taken = camera.picture(&before);
        assert!(channel(&taken, 2).all(|code| code == 255));
        assert!(channel(&taken, 0).all(|code| code < 255));
    }

    #[test]
    fn exposure_and_white_balance_are_the_cameras_own() {
        let (camera, day) = (demo_scene::site().1, Day::all().next().unwrap());
        let gains: Vec<[f64; 3]> =
            (0..40).map(|seed| ViewCamera::exposed(day.sky(NOON).unwrap(), &camera, seed).gains).collect();
        let spread = |of: &dyn Fn(&[f64; 3]) -> f64| {
            let all: Vec<f64> = gains.iter().map(of).collect();
            all.iter().copied().fold(0.0, f64::max) / all.iter().copied().fold(f64::INFINITY, f64::min)
        };
        assert!((1.7..=2.0).contains(&spread(&|gain| gain[1])));
        assert!(spread(&|gain| gain[0] / gain[1]) > 1.25 && spread(&|gain| gain[2] / gain[1]) > 1.25);
    }
}
