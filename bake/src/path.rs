//! Light paths: from the eye to the first surface, and on from surface to surface.

use glam::{Vec2, Vec3A};

use crate::geometry::{Cone, Geometry, Surface};
use crate::gloss::Drawn;
use crate::strata::{Rng, cosine_direction};

/// Hits after which a path of unlimited length may end by Russian roulette: from 3 on it costs more noise than it saves time.
const ROULETTE_FROM: u32 = 5;
/// Largest chance to go on: bounds the mean length of a path between white walls.
const ROULETTE_CAP: f32 = 0.95;

/// Where a path comes by.
#[derive(Clone, Copy)]
pub(crate) enum Step<'w> {
    /// Another surface.
    Met(&'w Surface),
    /// Nothing any more, along the lobe of a surface whose lobe is looked for in this way, too.
    Escaped { from: &'w Surface, dir_world: Vec3A },
}

/// Follows paths through a scene.
pub(crate) struct Tracer<'s> {
    pub(crate) geometry: Geometry<'s>,
    /// Most surface hits of a path, the seen one included; 0 for no limit.
    pub(crate) max_hits: u32,
}

impl Tracer<'_> {
    /// The surface that is seen from `origin` along the unit vector `dir_world`.
    pub(crate) fn first(&self, origin: Vec3A, dir_world: Vec3A, cone: Cone, rng: &mut Rng) -> Option<Surface> {
        let hit = self.geometry.closest(origin, dir_world, rng.next_u32())?;
        Some(self.geometry.surface(&hit, dir_world, cone))
    }

    /// Follows one path on from `seen`, whose first two directions are those of the points `at` of the unit square. Calls
    /// `visit` with every later step, the path's throughput up to it (all reflectances before it) and the number of
    /// surfaces that it has met, the step's own among them.
    pub(crate) fn walk(
        &self,
        seen: &Surface,
        at: [Vec2; 2],
        rng: &mut Rng,
        mut visit: impl FnMut(Step<'_>, Vec3A, u32, &mut Rng),
    ) {
        let mut surface = *seen;
        let [mut at, second] = at;
        let mut carried = Carried { throughput: Vec3A::ONE, relayed: Vec3A::ONE };
        let mut hits = 1;
        loop {
            let last = self.max_hits != 0 && hits >= self.max_hits;
            let drawn = draw(&surface, at);
            let may_escape = drawn.specular && surface.gloss.is_some_and(|gloss| gloss.is_narrow());
            if last && !may_escape || !carried.goes_on(drawn.weight, hits, self.max_hits == 0, rng) {
                return;
            }
            let (dir_world, throughput) = (drawn.dir_world, carried.throughput);
            let leaves = if drawn.specular { surface.is_above(dir_world) } else { surface.cosine(dir_world) > 0.0 };
            if !leaves {
                return;
            }
            let Some(next) = self.first(surface.position, dir_world, surface.cone.on(&surface, &drawn), rng) else {
                if may_escape {
                    visit(Step::Escaped { from: &surface, dir_world }, throughput, hits, rng);
                }
                return;
            };
            if last {
                return;
            }
            surface = next;
            hits += 1;
            visit(Step::Met(&surface), throughput, hits, rng);
            at = if hits == 2 { second } else { rng.square() };
        }
    }
}

/// What is left of a path's light.
struct Carried {
    throughput: Vec3A,
    /// Without the seen surface: a dark one must not shorten the paths that light it.
    relayed: Vec3A,
}

impl Carried {
    /// Takes in the reflection at the path's hit number `hits`; false when nothing is left of the path, or when it ends by
    /// Russian roulette.
    fn goes_on(&mut self, weight: Vec3A, hits: u32, roulette: bool, rng: &mut Rng) -> bool {
        self.throughput *= weight;
        if hits > 1 {
            self.relayed *= weight;
        }
        if self.throughput.max_element() <= 0.0 {
            return false;
        }
        if roulette && hits >= ROULETTE_FROM {
            let chance = self.relayed.max_element().min(ROULETTE_CAP);
            if rng.unit() >= chance {
                return false;
            }
            self.throughput /= chance;
            self.relayed /= chance;
        }
        true
    }
}

/// Where a path goes on from `surface` for a point of the unit square.
fn draw(surface: &Surface, at: Vec2) -> Drawn {
    match &surface.gloss {
        Some(gloss) => gloss.draw(surface.normal, surface.albedo, at),
        None => Drawn { dir_world: cosine_direction(surface.normal, at), weight: surface.albedo, specular: false },
    }
}
