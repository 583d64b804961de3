//! A reference picture: a path trace of the scene under a whole sky, without patches.
//!
//! Independent of the bake in everything but the ray queries: at every hit one direction of the map is drawn in
//! proportion to its radiance and solid angle, and one of the sun's disc; paths go on by cosine directions and end by
//! Russian roulette. It tells what patches, their response and the split of sun and sky cost.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::geometry::{Cone, Geometry, Surface};
use crate::scene::Scene;

/// Half the sun's apparent diameter, radians.
const SUN_RADIUS: f32 = 0.5 * 0.533 * PI / 180.0;
/// Hits after which Russian roulette may end a path.
const ROULETTE_FROM: u32 = 4;

/// The light around a scene.
#[derive(Clone, Debug)]
pub struct Environment {
    width: usize,
    height: usize,
    /// Linear radiance, lat-long: row 0 the zenith, the centre column +X, three quarters +Z.
    pixels: Vec<[f32; 3]>,
    /// Running sums of luminance times solid angle, one per pixel.
    running: Vec<f64>,
    sun: Option<(Vec3A, Vec3A)>,
}

/// Why a map cannot light a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "a lat-long map of {width}x{height} pixels with {found} values; give width x height of them, finite and not negative"
)]
pub struct EnvironmentError {
    width: usize,
    height: usize,
    found: usize,
}

/// A picture of linear radiance, premultiplied: the mean over each pixel, 0 where nothing is hit.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major.
    pub rgb: Vec<[f32; 3]>,
    /// Share of each pixel that geometry covers.
    pub coverage: Vec<f32>,
}

impl Environment {
    /// A lat-long map of linear radiance (`width * height` pixels, row 0 the zenith), and the sun as a disc of
    /// 0.533 degrees: unit direction towards it and RGB irradiance on a plane normal to it.
    ///
    /// # Errors
    /// [`EnvironmentError`] when the number of pixels is wrong or one is negative, NaN or infinite.
    pub fn new(
        width: usize,
        height: usize,
        pixels: Vec<[f32; 3]>,
        sun: Option<([f32; 3], [f32; 3])>,
    ) -> Result<Self, EnvironmentError> {
        let sound = pixels.iter().flatten().all(|value| value.is_finite() && *value >= 0.0);
        if width == 0 || height == 0 || width.checked_mul(height) != Some(pixels.len()) || !sound {
            return Err(EnvironmentError { width, height, found: pixels.len() });
        }
        let mut sum = 0.0f64;
        let running = pixels.iter().enumerate().map(|(index, rgb)| {
            let mean = f64::from(rgb[0] + rgb[1] + rgb[2]) / 3.0;
            sum += mean * f64::from(row_height(index / width, height)) * f64::from(TAU) / width as f64;
            sum
        });
        let running = running.collect();
        let sun = sun.map(|(dir, irradiance)| (Vec3A::from(dir).normalize_or(Vec3A::Y), Vec3A::from(irradiance)));
        Ok(Environment { width, height, pixels, running, sun })
    }

    /// A direction of the map and the radiance it stands for divided by its probability density.
    fn sample(&self, random: &mut Random) -> (Vec3A, Vec3A) {
        let total = self.running.last().copied().unwrap_or(0.0);
        if total <= 0.0 {
            return (Vec3A::Y, Vec3A::ZERO);
        }
        let pick = f64::from(random.unit()) * total;
        let index = self.running.partition_point(|&sum| sum <= pick).min(self.pixels.len() - 1);
        let (row, column) = (index / self.width, index % self.width);
        let (top, depth) = ((PI * row as f32 / self.height as f32).cos(), row_height(row, self.height));
        let y = top - depth * random.unit();
        let azimuth = TAU * ((column as f32 + random.unit()) / self.width as f32 - 0.5);
        let radius = (1.0 - y * y).max(0.0).sqrt();
        let rgb = self.pixels[index];
        // density = mean / total, uniform over the pixel.
        let weight = total as f32 / ((rgb[0] + rgb[1] + rgb[2]) / 3.0).max(f32::MIN_POSITIVE);
        (Vec3A::new(radius * azimuth.cos(), y, radius * azimuth.sin()), Vec3A::from(rgb) * weight)
    }

    /// Radiance that `surface` sends on, of light that reaches it straight from the map and the sun.
    fn light(&self, geometry: &Geometry<'_>, surface: &Surface, random: &mut Random) -> Vec3A {
        let mut sum = Vec3A::ZERO;
        let (direction, radiance) = self.sample(random);
        let mut add = |direction: Vec3A, irradiance: Vec3A| {
            let cosine = surface.cosine(direction);
            if cosine > 0.0 {
                sum += irradiance * (cosine * geometry.transmittance(surface.position, direction));
            }
        };
        add(direction, radiance);
        if let Some((centre, irradiance)) = self.sun {
            let (across, up) = centre.any_orthonormal_pair();
            let (radius, turn) = (random.unit().sqrt() * SUN_RADIUS, TAU * random.unit());
            add((centre + (across * turn.cos() + up * turn.sin()) * radius).normalize(), irradiance);
        }
        sum * surface.albedo / PI
    }
}

/// Height in y of the map's row: its solid angle over 2 pi.
fn row_height(row: usize, height: usize) -> f32 {
    let edge = |row: usize| (std::f64::consts::PI * row as f64 / height as f64).cos();
    (edge(row) - edge(row + 1)) as f32
}

/// Traces the picture of `scene`, which is shaded by Lambert, as `camera` sees it under `environment`, `samples` paths per
/// pixel.
/// The same seed gives the same picture, whatever the number of threads.
pub fn reference(
    scene: &Scene,
    camera: &Camera,
    environment: &Environment,
    size: (u32, u32),
    samples: u32,
    seed: u64,
) -> Reference {
    let (width, height) = size;
    let geometry = Geometry::new(scene);
    let view = camera.view(width, height);
    let origin = view.position.as_vec3();
    let pixel = |index: u32| {
        let mut random = Random::new(seed, index);
        let (mut sum, mut hits) = (Vec3A::ZERO, 0u32);
        for _ in 0..samples {
            let (px, py) = ((index % width) as f32 + random.unit(), (index / width) as f32 + random.unit());
            let Some(direction) = view.direction(px, py) else { continue };
            if let Some(radiance) = path(&geometry, environment, (origin, direction), &mut random) {
                sum += radiance;
                hits += 1;
            }
        }
        let samples = samples.max(1) as f32;
        ((sum / samples).to_array(), hits as f32 / samples)
    };
    let (rgb, coverage) = (0..width.saturating_mul(height)).into_par_iter().map(pixel).unzip();
    Reference { width, height, rgb, coverage }
}

/// The radiance along one path from the eye; `None` where nothing is hit.
fn path(geometry: &Geometry<'_>, environment: &Environment, eye: (Vec3, Vec3), random: &mut Random) -> Option<Vec3A> {
    let (mut origin, mut direction) = (Vec3A::from(eye.0), Vec3A::from(eye.1));
    let mut radiance = Vec3A::ZERO;
    let mut throughput = Vec3A::ONE;
    for hits in 1.. {
        let Some(hit) = geometry.closest(origin, direction, random.bits()) else {
            return (hits > 1).then_some(radiance);
        };
        let surface = geometry.surface(&hit, direction, Cone::default());
        radiance += throughput * environment.light(geometry, &surface, random);
        throughput *= surface.albedo;
        if hits >= ROULETTE_FROM {
            let chance = throughput.max_element().clamp(0.02, 0.95);
            if random.unit() >= chance {
                break;
            }
            throughput /= chance;
        }
        let (across, up) = surface.normal.any_orthonormal_pair();
        let (radius, turn) = (random.unit().sqrt(), TAU * random.unit());
        let out = (1.0 - radius * radius).max(0.0).sqrt();
        direction = (surface.normal * out + (across * turn.cos() + up * turn.sin()) * radius).normalize();
        if throughput.max_element() <= 0.0 || surface.cosine(direction) <= 0.0 {
            break;
        }
        origin = surface.position;
    }
    Some(radiance)
}

/// PCG XSH RR 64/32 (O'Neill 2014), one stream per pixel.
struct Random {
    state: u64,
    stream: u64,
}

impl Random {
    fn new(seed: u64, pixel: u32) -> Self {
        let mut random = Random { state: 0, stream: (u64::from(pixel) << 1) | 1 };
        random.bits();
        random.state = random.state.wrapping_add(seed);
        random.bits();
        random
    }

    fn bits(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(self.stream);
        ((((old >> 18) ^ old) >> 27) as u32).rotate_right((old >> 59) as u32)
    }

    /// Uniform in 0..1, 1 excluded.
    fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1u32 << 24) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Finish;
    use crate::scene::{Alpha, Material, Triangle};
    use glam::Vec2;

    /// A square floor at y = 0 of reflectance 0.5, and a camera straight above it.
    fn floor() -> (Scene, Camera) {
        let at = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let triangle = |positions| Triangle { positions, normals: [Vec3::Y; 3], uvs: [Vec2::ZERO; 3], material: 0 };
        let triangles = vec![
            triangle([at(-9.0, -9.0), at(-9.0, 9.0), at(9.0, 9.0)]),
            triangle([at(-9.0, -9.0), at(9.0, 9.0), at(9.0, -9.0)]),
        ];
        let material = Material {
            name: "floor".into(),
            base_color: [0.5, 0.5, 0.5, 1.0],
            texture: None,
            alpha: Alpha::Opaque,
            finish: Finish::default(),
        };
        let camera = Camera {
            position: [0.0, 5.0, 0.0],
            target: [0.0; 3],
            up: [0.0, 0.0, -1.0],
            fov_y_deg: 40.0,
            optics: None,
            north_deg: 0.0,
        };
        (Scene { triangles, materials: vec![material], ..Scene::default() }, camera)
    }

    fn mean(environment: &Environment) -> f32 {
        let (scene, camera) = floor();
        let picture = reference(&scene, &camera, environment, (16, 16), 64, 1);
        assert!(picture.coverage.iter().all(|&share| share == 1.0));
        picture.rgb.iter().map(|rgb| rgb[1]).sum::<f32>() / picture.rgb.len() as f32
    }

    #[test]
    fn a_floor_under_a_uniform_sky_and_a_slanted_sun_has_the_radiance_of_the_textbook() {
        // Lambert: radiance = albedo / pi * irradiance; a uniform sky of radiance 2 gives irradiance 2 pi.
        let sky = |sun| Environment::new(64, 32, vec![[2.0; 3]; 2048], sun).unwrap();
        assert!((mean(&sky(None)) - 1.0).abs() < 0.02);
        let slanted = sky(Some(([0.866_025_4, 0.5, 0.0], [PI; 3])));
        assert!((mean(&slanted) - 1.0 - 0.25).abs() < 0.02);
    }

    #[test]
    fn one_bright_pixel_lights_by_its_solid_angle_and_place() {
        let mut pixels = vec![[0.0; 3]; 2048];
        let row = 10;
        pixels[row * 64 + 50] = [100.0; 3];
        let theta = PI * (row as f32 + 0.5) / 32.0;
        let solid_angle_sr = theta.sin() * (PI / 32.0) * (TAU / 64.0);
        let expected = 0.5 / PI * 100.0 * solid_angle_sr * theta.cos();
        let found = mean(&Environment::new(64, 32, pixels, None).unwrap());
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    }

    #[test]
    fn the_map_follows_the_world_convention() {
        // Three quarters of the width is +Z.
        let mut pixels = vec![[0.0; 3]; 2048];
        pixels[15 * 64 + 48] = [1.0; 3];
        let environment = Environment::new(64, 32, pixels, None).unwrap();
        let (direction, _) = environment.sample(&mut Random::new(1, 1));
        assert!(direction.z > 0.98 && direction.y > 0.0, "{direction}");
    }

    #[test]
    fn maps_of_the_wrong_shape_or_with_bad_pixels_are_refused() {
        assert!(Environment::new(4, 2, vec![[1.0; 3]; 7], None).is_err());
        for bad in [f32::NAN, -1.0, f32::INFINITY] {
            assert!(Environment::new(4, 2, vec![[bad; 3]; 8], None).is_err());
        }
        let dark = Environment::new(4, 2, vec![[0.0; 3]; 8], None).unwrap();
        assert_eq!(mean(&dark), 0.0);
    }
}
