//! Direct sunlight as an exact disc gives it, to hold the live sun against: Lambert surfaces, no light by way of others.
//!
//! Rays go from what a pixel sees to directions of a 0.533 degree disc, in two ways: from the pixel's 16 points, at which the
//! bake and the live sun look, too; and from points all over the pixel, which owe nothing to those. Each way is halved, and the mean
//! square of an error is the mean product of the two halves' errors, which the rays' noise does not raise.

use crate::random::Random;
use glam::{Vec3, Vec3A};
use relume_bake::camera::{Camera, CameraView};
use relume_bake::geometry::{Cone, Geometry, Surface};
use relume_bake::scene::Scene;
use relume_firmware::pixelpoints::{PIXEL_POINTS, pixel_point};
use std::f32::consts::FRAC_1_PI;
use std::f64::consts::TAU;

/// Angular diameter of the sun's disc, degrees.
const DIAMETER_DEG: f64 = 0.533;
/// Rays from each of a pixel's 16 points in each half: one in each cell of `DISC_CELLS` x `DISC_CELLS` of the disc.
const DISC_CELLS: u32 = 3;
/// Points in each half that are spread over the pixel, one in each of `PIXEL_CELLS` x `PIXEL_CELLS` cells.
const PIXEL_CELLS: u32 = 8;
/// More than this share of full sun is seen.
const SEEN: f32 = 0.2;

/// A pixel's two halves and what full sun would be.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pixel {
    /// Premultiplied response to a sun of irradiance 1, from the pixel's 16 points.
    pub at_points: [Vec3A; 2],
    /// The same from points all over the pixel.
    pub all_over: [Vec3A; 2],
    /// What its surfaces would show if they filled it and faced the sun.
    pub full: Vec3A,
}

/// Over the pixels that the live sun covers, one way.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Apart {
    /// Rms difference over the mean of the exact picture, all channels.
    pub rms: f64,
    /// Share of pixels that are off by more than a fifth of full sun.
    pub seen: f64,
    /// Largest difference, of full sun.
    pub worst: f64,
}

/// A scene before its camera, ready to be lit.
pub struct DirectSun<'s> {
    geometry: Geometry<'s>,
    view: CameraView,
    size: (u32, u32),
    seed: u64,
}

impl<'s> DirectSun<'s> {
    /// Of a picture of `size` (width, height).
    pub fn new(scene: &'s Scene, camera: &Camera, size: (u32, u32), seed: u64) -> Self {
        DirectSun { geometry: Geometry::new(scene), view: camera.view(size.0, size.1), size, seed }
    }

    /// The picture under a sun in the unit direction `dir_world`, rows from the top.
    pub fn picture(&self, dir_world: Vec3) -> Vec<Pixel> {
        let threads = std::thread::available_parallelism().map_or(1, |count| count.get() as u32);
        let mut picture = vec![Pixel::default(); (self.size.0 * self.size.1) as usize];
        let disc = Disc::new(dir_world);
        let mut shares: Vec<Vec<_>> = (0..threads).map(|_| Vec::new()).collect();
        let rows = picture.chunks_exact_mut(self.size.0 as usize);
        for (y, row) in rows.enumerate() {
            shares[y % threads as usize].push((y as u32, row));
        }
        std::thread::scope(|scope| {
            for share in shares {
                let disc = &disc;
                scope.spawn(move || {
                    for (y, row) in share {
                        (0..).zip(row).for_each(|(x, pixel)| *pixel = self.pixel((x, y), disc));
                    }
                });
            }
        });
        picture
    }

    fn pixel(&self, (x, y): (u32, u32), disc: &Disc) -> Pixel {
        let mut random = Random::new(self.seed, y * self.size.0 + x);
        let mut pixel = Pixel::default();
        let mut hits = 0;
        for s in 0..PIXEL_POINTS {
            let Some(surface) = self.seen((x, y), pixel_point(s), &mut random) else { continue };
            hits += 1;
            pixel.full += surface.albedo * FRAC_1_PI;
            for cell in 0..2 * DISC_CELLS * DISC_CELLS {
                let at = in_cell(cell / 2, DISC_CELLS, &mut random);
                pixel.at_points[cell as usize % 2] += self.sent(&surface, disc.direction(at));
            }
        }
        pixel.full /= f32::max(hits as f32, 1.0);
        let cells = PIXEL_CELLS * PIXEL_CELLS;
        let turn = random.bits() % cells;
        for cell in 0..2 * cells {
            let place = in_cell(cell / 2, PIXEL_CELLS, &mut random);
            // Cells of the disc in another order than those of the pixel: 29 steps through 64 cells meet each once.
            let at = in_cell((29 * (cell / 2) + turn) % cells, PIXEL_CELLS, &mut random);
            if let Some(surface) = self.seen((x, y), place, &mut random) {
                pixel.all_over[cell as usize % 2] += self.sent(&surface, disc.direction(at));
            }
        }
        let rays = (PIXEL_POINTS as u32 * DISC_CELLS * DISC_CELLS) as f32;
        pixel.at_points = pixel.at_points.map(|sum| sum / rays);
        pixel.all_over = pixel.all_over.map(|sum| sum / cells as f32);
        pixel
    }

    /// What is seen at `place` in a pixel.
    fn seen(&self, (x, y): (u32, u32), place: [f32; 2], random: &mut Random) -> Option<Surface> {
        let dir = Vec3A::from(self.view.direction(x as f32 + place[0], y as f32 + place[1])?);
        let hit = self.geometry.closest(self.view.position.as_vec3a(), dir, random.bits())?;
        Some(self.geometry.surface(&hit, dir, Cone::default()))
    }

    fn sent(&self, surface: &Surface, light: Vec3A) -> Vec3A {
        let cosine = surface.cosine(light);
        if cosine <= 0.0 {
            return Vec3A::ZERO;
        }
        surface.albedo * (cosine * FRAC_1_PI * self.geometry.transmittance(surface.position, light))
    }
}

/// A point by chance in a cell of the unit square cut into `side` x `side`.
fn in_cell(cell: u32, side: u32, random: &mut Random) -> [f32; 2] {
    [(cell % side) as f32 + random.unit(), (cell / side) as f32 + random.unit()].map(|at| at / side as f32)
}

/// The sun's disc, in f64: its radius is a two-hundredth.
struct Disc {
    axes: [glam::DVec3; 3],
    depth: f64,
}

impl Disc {
    fn new(dir_world: Vec3) -> Self {
        let axis = dir_world.as_dvec3().normalize();
        let (across, up) = axis.any_orthonormal_pair();
        // 1 - cos without the cancellation.
        Disc { axes: [across, up, axis], depth: 2.0 * (0.25 * DIAMETER_DEG.to_radians()).sin().powi(2) }
    }

    /// A direction for a point of the unit square; equal areas are equal solid angles.
    fn direction(&self, at: [f32; 2]) -> Vec3A {
        let below = self.depth * f64::from(at[0]);
        let level = (below * (2.0 - below)).sqrt();
        let (sin, cos) = (TAU * f64::from(at[1])).sin_cos();
        let [across, up, axis] = self.axes;
        (axis * (1.0 - below) + (across * cos + up * sin) * level).as_vec3a()
    }
}

/// How far `live` is from the exact picture one way (`exact` picks it), over the pixels that `live` has.
pub fn apart(live: &[Option<Vec3A>], picture: &[Pixel], exact: impl Fn(&Pixel) -> [Vec3A; 2]) -> Apart {
    let (mut squares, mut sum, mut count, mut seen, mut worst) = (0.0, 0.0, 0.0, 0.0, 0.0f64);
    for (live, pixel) in live.iter().zip(picture) {
        let Some(live) = *live else { continue };
        let [a, b] = exact(pixel);
        squares += f64::from((live - a).dot(live - b)) / 3.0;
        sum += f64::from((a + b).element_sum()) / 6.0;
        count += 1.0;
        let off = off_of_full(live, pixel, 0.5 * (a + b)).abs();
        seen += if off > SEEN { 1.0 } else { 0.0 };
        worst = worst.max(f64::from(off));
    }
    Apart { rms: (squares / count).max(0.0).sqrt() / (sum / count), seen: seen / count, worst }
}

/// How much brighter `live` is than `exact` in the channel where that is most, of full sun.
pub fn off_of_full(live: Vec3A, pixel: &Pixel, exact: Vec3A) -> f32 {
    let off = (live - exact) / pixel.full.max(Vec3A::splat(1e-6));
    off.to_array().into_iter().fold(0.0, |most: f32, off| if off.abs() > most.abs() { off } else { most })
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_bake::material::{Alpha, Finish, Material};
    use relume_bake::scene::Triangle;
    use std::f64::consts::PI;

    /// A floor under half a ceiling that ends at x = `edge`, 2 m up.
    fn under_an_edge(edge: f32) -> Scene {
        let (alpha, finish) = (Alpha::Opaque, Finish::default());
        let material = Material { name: String::new(), base_color: [0.5, 0.5, 0.5, 1.0], texture: None, alpha, finish };
        let mut scene = Scene { materials: vec![material], ..Scene::default() };
        for (low, y) in [(-50.0, 0.0), (edge, 2.0)] {
            let corners = [[low, 50.0], [50.0, 50.0], [50.0, -50.0], [low, -50.0]].map(|[x, z]| Vec3::new(x, y, z));
            for at in [[0, 1, 2], [0, 2, 3]] {
                let positions = at.map(|k: usize| corners[k]);
                let triangle = Triangle { positions, normals: [Vec3::Y; 3], uvs: [glam::Vec2::ZERO; 3], material: 0 };
                scene.triangles.push(triangle);
            }
        }
        scene
    }

    #[test]
    fn half_a_ceiling_hides_the_disc_on_one_side_of_a_chord() {
        let radius = 2.0 * (0.5 * DIAMETER_DEG).to_radians().tan();
        // All pixels look at one point of the floor.
        let (position, up) = ([0.3, 0.5, 0.2], [0.0, 1.0, 0.0]);
        let camera = Camera { position, target: [0.0; 3], up, fov_y_deg: 0.001, north_deg: 0.0, optics: None };
        for share in [-1.2, -0.6, 0.0, 0.3, 0.9, 1.2] {
            let scene = under_an_edge((share * radius) as f32);
            let picture = DirectSun::new(&scene, &camera, (8, 8), 5).picture(Vec3::Y);
            let u = f64::clamp(share, -1.0, 1.0);
            let want = 0.5 / PI * (1.0 - (u.acos() - u * (1.0 - u * u).sqrt()) / PI);
            for way in [|p: &Pixel| p.at_points, |p: &Pixel| p.all_over] {
                let sum: f32 = picture.iter().map(|pixel| way(pixel)[0].x + way(pixel)[1].x).sum();
                let got = f64::from(sum) / (2.0 * picture.len() as f64);
                assert!((got - want).abs() < 0.004 * 0.5 / PI, "{share}: {got} instead of {want}");
            }
            let exact = Some(Vec3A::splat(want as f32));
            let apart = apart(&vec![exact; picture.len()], &picture, |pixel| pixel.at_points);
            assert!(apart.seen == 0.0 && apart.worst < 0.1, "{share}: {apart:?}");
        }
    }
}
