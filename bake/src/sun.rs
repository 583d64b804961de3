//! The response to one sun: path-traced with its disc sampled at every surface, apart from the live method.

use glam::{Vec3, Vec3A};

use crate::geometry::Surface;
use crate::response::Transport;
use crate::strata::{Grid, Rng, disc_point, frame};

/// Diameter of the sun's disc, degrees.
pub const SUN_DIAMETER_DEG: f32 = 0.533;

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
        let samples = self.options.sun_samples;
        let mut rng = Rng::new(self.options.seed, x, y, 1);
        let seen = self.seen(x, y, samples, &mut rng);
        let cells = Grid::new(samples);
        let [sun_turn, path_turn] = [rng.next_u32() % samples, rng.next_u32() % samples];
        let mut sum = Vec3A::ZERO;
        for (k, surface) in seen.iter().enumerate() {
            let Some(surface) = surface else { continue };
            // Different steps keep the three sets of cells unlike.
            let cell = |step: u32, turn: u32| (k as u32 * step + turn) % samples;
            let at = cells.point(cell(5, sun_turn), rng.jitter());
            sum += self.lit(surface, disc.direction(at));
            let at = cells.point(cell(11, path_turn), rng.jitter());
            self.tracer.walk(surface, at, &mut rng, |surface, throughput, _, rng| {
                sum += throughput * self.lit(surface, disc.direction(rng.jitter()));
            });
        }
        sum / samples as f32
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
