//! Light paths: from the eye to the first surface, and on from surface to surface.

use glam::{Vec2, Vec3A};

use crate::geometry::{Geometry, Surface};
use crate::strata::{Rng, cosine_direction};

/// Hits after which a path of unlimited length may end by Russian roulette: from 3 on it costs more noise than it saves time.
const ROULETTE_FROM: u32 = 5;
/// Largest chance to go on: bounds the mean length of a path between white walls.
const ROULETTE_CAP: f32 = 0.95;

/// Follows paths through a scene.
pub(crate) struct Tracer<'s> {
    pub(crate) geometry: Geometry<'s>,
    /// Most surface hits of a path, the seen one included; 0 for no limit.
    pub(crate) max_hits: u32,
}

impl Tracer<'_> {
    /// The surface that is seen from `origin` along the unit vector `dir_world`.
    pub(crate) fn first(&self, origin: Vec3A, dir_world: Vec3A, rng: &mut Rng) -> Option<Surface> {
        let hit = self.geometry.closest(origin, dir_world, rng.next_u32())?;
        Some(self.geometry.surface(&hit, dir_world))
    }

    /// Follows one path on from `seen`, whose first two directions are the cosine directions of `at`. Calls `visit` with every
    /// later surface, the path's throughput up to it (all reflectances before it) and its number of hits, 2 or more.
    pub(crate) fn walk(
        &self,
        seen: &Surface,
        at: [Vec2; 2],
        rng: &mut Rng,
        mut visit: impl FnMut(&Surface, Vec3A, u32, &mut Rng),
    ) {
        let mut surface = *seen;
        let [mut at, second] = at;
        let mut throughput = Vec3A::ONE;
        // Without the seen surface: a dark one must not shorten the paths that light it.
        let mut relayed = Vec3A::ONE;
        let mut hits = 1;
        while self.max_hits == 0 || hits < self.max_hits {
            throughput *= surface.albedo;
            if hits > 1 {
                relayed *= surface.albedo;
            }
            if throughput.max_element() <= 0.0 {
                return;
            }
            if self.max_hits == 0 && hits >= ROULETTE_FROM {
                let chance = relayed.max_element().min(ROULETTE_CAP);
                if rng.unit() >= chance {
                    return;
                }
                throughput /= chance;
                relayed /= chance;
            }
            let direction = cosine_direction(surface.normal, at);
            if surface.cosine(direction) <= 0.0 {
                return;
            }
            let Some(next) = self.first(surface.position, direction, rng) else { return };
            surface = next;
            hits += 1;
            visit(&surface, throughput, hits, rng);
            at = if hits == 2 { second } else { rng.square() };
        }
    }
}
