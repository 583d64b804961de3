//! The stack's response to one sun, whose disc is sampled at every surface that paths meet: along the very paths from which
//! the field learns what its pixels receive of any sun (transfer.rs), but with the sun's light at each surface itself. So
//! what the field differs by from its stack is what bounce points, factors and rounding cost; what the paths leave to
//! chance is in both, and is told by pictures of other renderers.

use glam::{Vec3, Vec3A};

use crate::geometry::Surface;
use crate::response::{Seen, TileResponse, Transport};
use crate::strata::{Grid, Rng, disc_point, frame};

/// Diameter of the sun's disc, degrees.
pub const SUN_DIAMETER_DEG: f32 = 0.533;

/// Rays from each seen surface to the sun's disc, stratified over it.
const SUN_RAYS: u32 = 64;

/// Directions of the sun's disc, uniform in solid angle.
pub struct SunDisc {
    centre: Vec3A,
    tangent: Vec3A,
    bitangent: Vec3A,
    /// 1 - cosine of the angular radius.
    depth: f32,
}

impl SunDisc {
    /// The disc about the direction `dir_world`.
    pub fn new(dir_world: Vec3) -> Self {
        let centre = Vec3A::from(dir_world).normalize_or(Vec3A::Y);
        let (tangent, bitangent) = frame(centre);
        let radius = (0.5 * SUN_DIAMETER_DEG).to_radians();
        // 1 - cos without the cancellation.
        let depth = 2.0 * (0.5 * radius).sin().powi(2);
        SunDisc { centre, tangent, bitangent, depth }
    }

    pub(crate) fn direction(&self, at: glam::Vec2) -> Vec3A {
        let point = disc_point(at);
        let below = self.depth * point.length_squared();
        // Equal areas of the disc are equal steps of 1 - cosine, hence equal solid angles.
        let scale = (self.depth * (2.0 - below)).sqrt();
        self.centre * (1.0 - below) + (self.tangent * point.x + self.bitangent * point.y) * scale
    }
}

impl Transport<'_> {
    /// The response of the tile with the response `tile` to a sun that gives irradiance 1 on a plane normal to it:
    /// `[h][w][channel]`, premultiplied radiance. `further` is what its covered pixels receive by way of other surfaces.
    pub fn sun_tile(&self, tile: &TileResponse, further: &[Vec3A], sun: &SunDisc) -> Vec<f32> {
        let mut picture = vec![0.0; 3 * (tile.w * tile.h) as usize];
        for (&index, further) in tile.covered.iter().zip(further) {
            let (x, y) = tile.place(index);
            let rgb = self.first_sunlight(&self.seen(x, y).0, Rng::new(self.options.seed, x, y, 1), sun) + *further;
            picture[3 * usize::from(index)..][..3].copy_from_slice(&rgb.to_array());
        }
        picture
    }

    fn first_sunlight(&self, seen: &Seen, mut rng: Rng, sun: &SunDisc) -> Vec3A {
        let cells = Grid::new(SUN_RAYS);
        let mut sum = Vec3A::ZERO;
        for surface in seen.iter().flatten() {
            for cell in 0..SUN_RAYS {
                sum += self.sunlit(surface, sun.direction(cells.point(cell, rng.jitter())));
            }
        }
        sum / (SUN_RAYS * seen.len() as u32) as f32
    }

    /// The radiance that the seen `surface` sends to the eye of irradiance 1 along `dir_world`.
    fn sunlit(&self, surface: &Surface, dir_world: Vec3A) -> Vec3A {
        let Some(gloss) = surface.gloss.filter(|_| surface.is_above(dir_world)) else {
            return self.passed_on(surface, dir_world);
        };
        let light = gloss.sent_on(surface.albedo * surface.cosine(dir_world), dir_world, 1.0);
        if light.max_element() <= 0.0 {
            return Vec3A::ZERO;
        }
        light * (self.tracer.geometry.transmittance(surface.position, dir_world) * std::f32::consts::FRAC_1_PI)
    }

    /// The radiance that a `surface` on the way passes on of irradiance 1 along `dir_world`, to all sides alike: as the bounce
    /// points do, which know nothing of lobes but how much they reflect in all.
    pub(crate) fn passed_on(&self, surface: &Surface, dir_world: Vec3A) -> Vec3A {
        let cosine = surface.cosine(dir_world);
        if cosine <= 0.0 {
            return Vec3A::ZERO;
        }
        let passed = self.tracer.geometry.transmittance(surface.position, dir_world);
        surface.reflectance() * (cosine * passed * std::f32::consts::FRAC_1_PI)
    }
}

#[cfg(test)]
mod alpha_tests;
#[cfg(test)]
mod glossy_tests;
#[cfg(test)]
mod tests;
