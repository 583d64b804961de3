//! What a set of patches costs by itself: a path trace under the whole sky against one under the weights of its patches.
//!
//! Both are the same paths, for all sets at once: the light that a path finds is that of the sky less that of its patch,
//! so that the noise is of the difference and not of the pictures. Lambert surfaces; pixels that the scene covers wholly. Each
//! pixel's paths are halved, and the mean square of an error is the mean product of the two halves' errors, which noise does not
//! raise. The paths of a half are stratified over the directions in which they look for light first, and those in which they go on.

use crate::random::Random;
use glam::Vec3A;
use relume_bake::camera::Camera;
use relume_bake::geometry::{Cone, Geometry, Surface};
use relume_bake::scene::Scene;
use relume_firmware::glue::map::RadianceMap;
use relume_firmware::glue::split;
use relume_firmware::patches::PatchSet;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Hits after which Russian roulette may end a path.
const ROULETTE_FROM: u32 = 3;

/// The error of a picture under patches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PatchError {
    /// Relative RMSE over covered pixels and channels.
    pub rmse: f64,
    /// Standard error of that.
    pub doubt: f64,
}

/// A sky, and what each set makes of it.
pub struct Cut<'s> {
    map: &'s RadianceMap,
    /// Running sums of brightness times solid angle.
    running: Vec<f64>,
    sets: Vec<(&'s PatchSet, Vec<[f32; 3]>)>,
}

impl<'s> Cut<'s> {
    /// A map without its sun, under these sets.
    pub fn new(map: &'s RadianceMap, sets: &'s [PatchSet]) -> Self {
        let mut sum = 0.0;
        let running = map.pixels.iter().enumerate().map(|(at, rgb)| {
            sum += brightness(*rgb) * map.solid_angle_sr(at / map.width);
            sum
        });
        let running = running.collect();
        Cut { map, running, sets: sets.iter().map(|set| (set, split::settled(map, set, 0.0))).collect() }
    }

    /// The sky's radiance in a direction, then the same less each set's.
    fn light(&self, dir: Vec3A, into: &mut [Vec3A]) {
        let (col, row) = self.map.pixel_of(dir.to_array());
        let sky = Vec3A::from(self.map.pixels[row * self.map.width + col]);
        into[0] = sky;
        for ((set, weights), into) in self.sets.iter().zip(&mut into[1..]) {
            *into = sky - Vec3A::from(weights[set.patch_of(dir.to_array())]);
        }
    }

    /// The direction for a number in 0..1 by the sky's brightness.
    fn by_sky(&self, pick: f32, random: &mut Random) -> Vec3A {
        let total = self.running.last().copied().unwrap_or(0.0);
        let pick = f64::from(pick) * total;
        let at = self.running.partition_point(|&sum| sum <= pick).min(self.map.pixels.len() - 1);
        let (col, row) = (at % self.map.width, at / self.map.width);
        let step = std::f64::consts::PI / self.map.height as f64;
        let (top, low) = ((row as f64 * step).cos() as f32, ((row + 1) as f64 * step).cos() as f32);
        let y = top + (low - top) * random.unit();
        let azimuth = TAU * ((col as f32 + random.unit()) / self.map.width as f32 - 0.5);
        let radius = (1.0 - y * y).max(0.0).sqrt();
        Vec3A::new(radius * azimuth.cos(), y, radius * azimuth.sin())
    }

    /// Density (1/sr) of directions of which half are drawn by the sky's brightness and half by the surface's cosine.
    fn density(&self, surface: &Surface, dir: Vec3A) -> f32 {
        let total = self.running.last().copied().unwrap_or(0.0);
        let (col, row) = self.map.pixel_of(dir.to_array());
        let by_sky = brightness(self.map.pixels[row * self.map.width + col]) / total.max(1e-30);
        let by_cosine = surface.normal.dot(dir).max(0.0) * FRAC_1_PI;
        0.5 * (by_sky as f32 + by_cosine)
    }
}

fn brightness(rgb: [f32; 3]) -> f64 {
    rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0
}

/// A direction about `normal` with a density of cosine / pi, for `u` in the unit square.
fn cosine_direction(normal: Vec3A, u: [f32; 2]) -> Vec3A {
    let (across, up) = normal.any_orthonormal_pair();
    let (radius, turn) = (u[0].sqrt(), TAU * u[1]);
    let out = (1.0 - radius * radius).max(0.0).sqrt();
    (normal * out + (across * turn.cos() + up * turn.sin()) * radius).normalize()
}

/// A square cut into `side` x `side` cells.
struct Strata(u32);

impl Strata {
    /// A point by chance in a cell.
    fn point(&self, cell: u32, random: &mut Random) -> [f32; 2] {
        [(cell % self.0) as f32 + random.unit(), (cell / self.0 % self.0) as f32 + random.unit()]
            .map(|u| u / self.0 as f32)
    }
}

/// The error of each set under a sky, in the picture of `size` that `camera` sees of `scene`.
pub fn patch_errors(
    (scene, camera, size): (&Scene, &Camera, (u32, u32)),
    cut: &Cut<'_>,
    paths: u32,
    seed: u64,
) -> Vec<PatchError> {
    let geometry = Geometry::new(scene);
    let threads = std::thread::available_parallelism().map_or(1, |count| count.get() as u32);
    let rows_of = |thread: u32| (thread..size.1).step_by(threads as usize);
    let trace_rows = |thread: u32| {
        let mut sums = Sums::new(cut.sets.len());
        for y in rows_of(thread) {
            for x in 0..size.0 {
                let mut random = Random::new(seed, y * size.0 + x);
                let halves = [0, 1].map(|_| half_pixel((&geometry, camera, size), cut, ((x, y), paths), &mut random));
                if let [Some(first), Some(second)] = halves {
                    sums.add(&first, &second);
                }
            }
        }
        sums
    };
    let mut all = Sums::new(cut.sets.len());
    std::thread::scope(|scope| {
        let work: Vec<_> = (0..threads).map(|thread| scope.spawn(move || trace_rows(thread))).collect();
        for done in work {
            if let Ok(sums) = done.join() {
                all.take(&sums);
            }
        }
    });
    all.errors()
}

/// Mean light of half a pixel's paths: the sky's, then what each set is off by. `None` where one of them misses the scene.
fn half_pixel(
    (geometry, camera, (width, height)): (&Geometry<'_>, &Camera, (u32, u32)),
    cut: &Cut<'_>,
    ((x, y), paths): ((u32, u32), u32),
    random: &mut Random,
) -> Option<Vec<Vec3A>> {
    let strata = Strata(((paths / 4) as f32).sqrt().ceil().max(1.0) as u32);
    let cells = strata.0 * strata.0;
    let turn = random.bits();
    let view = camera.view(width, height);
    let (mut sum, mut light) = (vec![Vec3A::ZERO; cut.sets.len() + 1], vec![Vec3A::ZERO; cut.sets.len() + 1]);
    for k in 0..2 * cells {
        let dir = view.direction(x as f32 + random.unit(), y as f32 + random.unit())?;
        let (mut origin, mut dir) = (view.position.as_vec3a(), Vec3A::from(dir));
        let mut throughput = Vec3A::ONE;
        for hits in 1.. {
            let Some(hit) = geometry.closest(origin, dir, random.bits()) else {
                if hits == 1 {
                    return None;
                }
                break;
            };
            let surface = geometry.surface(&hit, dir, Cone::default());
            // Later surfaces take cells by chance.
            let cell = if hits == 1 { k / 2 } else { random.bits() % cells };
            let towards = match k % 2 {
                0 => cut.by_sky((cell as f32 + random.unit()) / cells as f32, random),
                _ => cosine_direction(surface.normal, strata.point(cell, random)),
            };
            let cosine = surface.cosine(towards);
            if cosine > 0.0 {
                let passed = cosine * geometry.transmittance(surface.position, towards);
                let weight = throughput * surface.albedo * (passed * FRAC_1_PI / cut.density(&surface, towards));
                if weight.max_element() > 0.0 {
                    cut.light(towards, &mut light);
                    sum.iter_mut().zip(&light).for_each(|(sum, &light)| *sum += weight * light);
                }
            }
            throughput *= surface.albedo;
            if hits >= ROULETTE_FROM {
                let chance = throughput.max_element().clamp(0.02, 0.95);
                if random.unit() >= chance {
                    break;
                }
                throughput /= chance;
            }
            // Cells in another order than those of the light.
            let cell = if hits == 1 {
                (k / 2).wrapping_mul(7919).wrapping_add(turn >> 8) % cells
            } else {
                random.bits() % cells
            };
            dir = cosine_direction(surface.normal, strata.point(cell, random));
            if surface.cosine(dir) <= 0.0 {
                break;
            }
            origin = surface.position;
        }
    }
    let scale = 1.0 / (2 * cells) as f32;
    Some(sum.into_iter().map(|light| light * scale).collect())
}

/// Sums over pixels.
struct Sums {
    pixels: f64,
    sky: f64,
    /// Per set, of the product of both halves' errors (mean of the channels), and of its square.
    products: Vec<[f64; 2]>,
}

impl Sums {
    fn new(sets: usize) -> Self {
        Sums { pixels: 0.0, sky: 0.0, products: vec![[0.0; 2]; sets] }
    }

    fn add(&mut self, first: &[Vec3A], second: &[Vec3A]) {
        self.pixels += 1.0;
        self.sky += f64::from((first[0] + second[0]).element_sum()) / 6.0;
        for (sum, (a, b)) in self.products.iter_mut().zip(first[1..].iter().zip(&second[1..])) {
            let product = f64::from(a.dot(*b)) / 3.0;
            *sum = [sum[0] + product, sum[1] + product * product];
        }
    }

    fn take(&mut self, other: &Sums) {
        self.pixels += other.pixels;
        self.sky += other.sky;
        self.products.iter_mut().zip(&other.products).for_each(|(a, b)| *a = [a[0] + b[0], a[1] + b[1]]);
    }

    fn errors(&self) -> Vec<PatchError> {
        let mean = self.sky / self.pixels;
        let error = |&[sum, squares]: &[f64; 2]| {
            let square = sum / self.pixels;
            let doubt = ((squares / self.pixels - square * square).max(0.0) / self.pixels).sqrt();
            let rmse = square.max(0.0).sqrt();
            PatchError { rmse: rmse / mean, doubt: doubt / (2.0 * rmse.max(doubt.sqrt())) / mean }
        };
        self.products.iter().map(error).collect()
    }
}
