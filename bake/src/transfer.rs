//! What the pixels of a tile receive from the bounce points: paths -> points -> nodes of their tree -> a block of BNCE
//! (layout: firmware/src/bounce.rs).

mod block;

use glam::Vec3A;

use crate::bouncepoints::{BouncePoints, Vertex};
use crate::path::Step;
use crate::response::{TileResponse, Transport};
use crate::sobol::two_squares;
use crate::strata::Rng;
use crate::sun::SunDisc;

/// What one pixel receives.
struct Received {
    /// Weights of nodes, node 0 the mean over all points.
    nodes: Vec<(u32, f32)>,
    /// Weight of all light, the mean over the channels.
    total: f32,
    /// What its light is multiplied by per channel, beside the points' own tints.
    tint: [f32; 3],
}

/// What the paths from the covered pixels of a tile bring.
pub struct Gathered {
    /// The tile's block of BNCE; empty if no light comes from the points.
    pub bounce: Vec<u8>,
    /// `[covered]`: radiance by way of other surfaces under the sun that was asked for, at irradiance 1; else empty.
    pub sun: Vec<Vec3A>,
}

impl Transport<'_> {
    /// Follows the paths of the tile with the response `tile`.
    pub fn gather(&self, points: &BouncePoints, tile: &TileResponse, sun: Option<&SunDisc>) -> Gathered {
        if points.is_empty() {
            return Gathered { bounce: Vec::new(), sun: vec![Vec3A::ZERO; tile.covered.len()] };
        }
        let pixels = tile.covered.iter().map(|&index| {
            let (x, y) = tile.place(index);
            self.gather_pixel(points, x, y, sun)
        });
        let (received, by_sun): (Vec<Received>, Vec<Vec3A>) = pixels.unzip();
        Gathered { bounce: block::encode(&received, points), sun: by_sun }
    }

    /// Follows the paths of one pixel and gathers where they come by.
    fn gather_pixel(&self, points: &BouncePoints, x: u32, y: u32, sun: Option<&SunDisc>) -> (Received, Vec3A) {
        let (seen, _) = self.seen(x, y);
        let mut rng = Rng::new(self.options.seed, x, y, 3);
        // Its own, so that a field is the same with a stack and without.
        let mut sun_rng = Rng::new(self.options.seed, x, y, 6);
        let paths = self.options.sun_paths;
        let count = (paths * seen.len() as u32) as f32;
        let seed = rng.next_u32();
        let mut leaves: Vec<(u32, f32)> = Vec::with_capacity(2048);
        let (mut total, mut rgb, mut by_points) = (0.0, Vec3A::ZERO, Vec3A::ZERO);
        let mut by_sun = Vec3A::ZERO;
        for (s, surface) in seen.iter().enumerate() {
            let Some(surface) = surface else { continue };
            for path in 0..paths {
                let at = two_squares(s as u32 * paths + path, seed);
                self.tracer.walk(surface, at, &mut rng, |step, throughput, _, _| {
                    let Step::Met(surface) = step else { return };
                    let leaf = points.nearest(&Vertex::of(surface, 1.0));
                    let light = throughput * surface.reflectance() * (std::f32::consts::FRAC_1_PI / count);
                    let weight = light.element_sum() / 3.0;
                    leaves.push((leaf, weight));
                    total += weight;
                    // Weighed by the suns: light of many bounces has more colour, and comes from where there is less sun.
                    let under_suns = points.leaf_light[leaf as usize];
                    rgb += light * under_suns;
                    by_points += points.tint(leaf) * (weight * under_suns);
                    if let Some(sun) = sun {
                        by_sun += throughput * self.passed_on(surface, sun.direction(sun_rng.jitter()));
                    }
                });
            }
        }
        leaves.sort_by_key(|(leaf, _)| *leaf);
        let tint = [0, 1, 2].map(|c: usize| if by_points[c] > 0.0 { rgb[c] / by_points[c] } else { 1.0 });
        (Received { total, nodes: up_the_tree(&leaves, points.len()), tint }, by_sun / count)
    }
}

/// Weights of points, ascending -> weights of nodes.
fn up_the_tree(leaves: &[(u32, f32)], points: usize) -> Vec<(u32, f32)> {
    let mut received = Vec::with_capacity(3 * leaves.len());
    let sum = |own: &[(u32, f32)]| own.iter().map(|(_, weight)| weight).sum::<f32>();
    let same = leaves.chunk_by(|a, b| a.0 == b.0);
    let mut level: Vec<(u32, f32)> = same.map(|own| (own[0].0 + points as u32, sum(own))).collect();
    for _ in 0..points.trailing_zeros() {
        let mut parents = Vec::with_capacity(level.len());
        for children in level.chunk_by(|a, b| a.0 >> 1 == b.0 >> 1) {
            let node = children[0].0 >> 1;
            let signed = |&(child, weight): &(u32, f32)| if child & 1 == 0 { weight } else { -weight };
            received.push((node, children.iter().map(signed).sum()));
            parents.push((node, sum(children)));
        }
        level = parents;
    }
    received.extend(level.first().map(|(_, total)| (0, *total)));
    received
}
