//! The response to one sun: path-traced with its disc sampled at every surface, apart from the live method but for the
//! points at which a pixel looks at the scene.

use glam::{Vec3, Vec3A};

use crate::geometry::Surface;
use crate::response::{Seen, Transport};
use crate::sobol::two_squares;
use crate::strata::{Grid, Rng, disc_point, frame};

/// Diameter of the sun's disc, degrees.
pub const SUN_DIAMETER_DEG: f32 = 0.533;

/// Rays from each seen surface to the sun's disc, stratified over it.
const SUN_RAYS: u32 = 64;

/// Noise of a pixel's indirect light that the number of its paths aims at, were they random and not evenly spread: a
/// radiance, under irradiance 1; white paint shows 0.32.
const SUN_NOISE: f32 = 5e-4;

/// Most paths of a pixel, as a multiple of the fewest: a bound on the time that the noisiest take.
const MORE_PATHS: u32 = 4;

/// Directions of the sun's disc, uniform in solid angle.
struct Disc {
    centre: Vec3A,
    tangent: Vec3A,
    bitangent: Vec3A,
    /// 1 - cosine of the angular radius.
    depth: f32,
}

impl Disc {
    fn new(centre: Vec3A) -> Self {
        let (tangent, bitangent) = frame(centre);
        let radius = (0.5 * SUN_DIAMETER_DEG).to_radians();
        // 1 - cos without the cancellation.
        let depth = 2.0 * (0.5 * radius).sin().powi(2);
        Disc { centre, tangent, bitangent, depth }
    }

    fn direction(&self, at: glam::Vec2) -> Vec3A {
        let point = disc_point(at);
        let below = self.depth * point.length_squared();
        // Equal areas of the disc are equal steps of 1 - cosine, hence equal solid angles.
        let scale = (self.depth * (2.0 - below)).sqrt();
        self.centre * (1.0 - below) + (self.tangent * point.x + self.bitangent * point.y) * scale
    }
}

impl Transport<'_> {
    /// The response of tile (`tx`, `ty`) to a sun at the unit direction `dir_world` that gives irradiance 1 on a plane
    /// normal to it: `[h][w][channel]`, premultiplied radiance.
    pub fn sun_tile(&self, tx: u32, ty: u32, dir_world: Vec3) -> Vec<f32> {
        let [x0, y0, w, h] = self.tile_rectangle(tx, ty);
        let disc = Disc::new(Vec3A::from(dir_world).normalize_or(Vec3A::Y));
        let pixel = |index: u32| self.sun_pixel(x0 + index % w, y0 + index / w, &disc).to_array();
        (0..w * h).flat_map(pixel).collect()
    }

    fn sun_pixel(&self, x: u32, y: u32, disc: &Disc) -> Vec3A {
        let (seen, _) = self.seen(x, y);
        if seen.iter().all(Option::is_none) {
            return Vec3A::ZERO;
        }
        let mut rng = Rng::new(self.options.seed, x, y, 1);
        let cells = Grid::new(SUN_RAYS);
        let mut direct = Vec3A::ZERO;
        for surface in seen.iter().flatten() {
            for cell in 0..SUN_RAYS {
                direct += self.lit(surface, disc.direction(cells.point(cell, rng.jitter())));
            }
        }
        let least = self.options.sun_paths;
        // Paths that only tell how many are needed: with them in the mean, its luck would decide when it is done.
        let (_, variance) = self.sun_paths(&seen, (least / 4).max(1), &mut rng, disc);
        let wanted = variance / (SUN_NOISE * SUN_NOISE * seen.len() as f32);
        let paths = (wanted as u32).clamp(least, least * MORE_PATHS).next_power_of_two();
        let (indirect, _) = self.sun_paths(&seen, paths, &mut rng, disc);
        direct / (SUN_RAYS * seen.len() as u32) as f32 + indirect
    }

    /// Mean indirect light over `paths` paths from each of the points that a pixel sees, and the variance of one path's
    /// light (its mean over the channels).
    fn sun_paths(&self, seen: &Seen, paths: u32, rng: &mut Rng, disc: &Disc) -> (Vec3A, f32) {
        let seed = rng.next_u32();
        let count = (paths * seen.len() as u32) as f32;
        let (mut sum, mut squares) = (Vec3A::ZERO, 0.0);
        for (s, surface) in seen.iter().enumerate() {
            let Some(surface) = surface else { continue };
            for path in 0..paths {
                let at = two_squares(s as u32 * paths + path, seed);
                let mut light = Vec3A::ZERO;
                self.tracer.walk(surface, at, rng, |surface, throughput, _, rng| {
                    light += throughput * self.lit(surface, disc.direction(rng.jitter()));
                });
                sum += light;
                squares += (light.element_sum() / 3.0).powi(2);
            }
        }
        let mean = sum / count;
        (mean, (squares / count - (mean.element_sum() / 3.0).powi(2)).max(0.0))
    }

    /// The radiance that `surface` sends on of irradiance 1 along `dir_world`.
    fn lit(&self, surface: &Surface, dir_world: Vec3A) -> Vec3A {
        let cosine = surface.cosine(dir_world);
        if cosine <= 0.0 {
            return Vec3A::ZERO;
        }
        let passed = self.tracer.geometry.transmittance(surface.position, dir_world);
        surface.albedo * (cosine * passed * std::f32::consts::FRAC_1_PI)
    }
}

#[cfg(test)]
mod tests;
