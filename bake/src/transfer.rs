//! What the pixels of a tile receive from the bounce points: paths -> points -> nodes of their tree -> a block of BNCE
//! (layout: firmware/src/bounce.rs).

mod block;

use glam::Vec3A;

use crate::bouncepoints::{BouncePoints, Vertex};
use crate::response::{Seen, TileResponse, Transport};
use crate::sobol::two_squares;
use crate::strata::Rng;

/// What one pixel receives.
struct Received {
    /// Weights of nodes, node 0 the mean over all points.
    nodes: Vec<(u32, f32)>,
    /// Weight of all light, the mean over the channels.
    total: f32,
    /// What its light is multiplied by per channel, beside the points' own tints.
    tint: [f32; 3],
}

impl Transport<'_> {
    /// The block of BNCE of the tile with the response `tile`; empty if no light comes from the points.
    pub fn bounce_block(&self, points: &BouncePoints, tile: &TileResponse) -> Vec<u8> {
        if points.is_empty() {
            return Vec::new();
        }
        let received = tile.covered.iter().map(|&index| {
            let (x, y) = (tile.x0 + u32::from(index) % tile.w, tile.y0 + u32::from(index) / tile.w);
            self.received(points, &self.seen(x, y).0, Rng::new(self.options.seed, x, y, 3))
        });
        let received: Vec<Received> = received.collect();
        block::encode(&received, points)
    }

    /// Follows the paths of one pixel and gathers where they come by.
    fn received(&self, points: &BouncePoints, seen: &Seen, mut rng: Rng) -> Received {
        let paths = self.options.bounce_paths;
        let share = std::f32::consts::FRAC_1_PI / (paths * seen.len() as u32) as f32;
        let seed = rng.next_u32();
        let mut leaves: Vec<(u32, f32)> = Vec::with_capacity(2048);
        let (mut total, mut rgb, mut by_points) = (0.0, Vec3A::ZERO, Vec3A::ZERO);
        for (s, surface) in seen.iter().enumerate() {
            let Some(surface) = surface else { continue };
            for path in 0..paths {
                let at = two_squares(s as u32 * paths + path, seed);
                self.tracer.walk(surface, at, &mut rng, |surface, throughput, _, _| {
                    let leaf = points.nearest(&Vertex::of(surface, 1.0));
                    let light = throughput * surface.albedo * share;
                    let weight = light.element_sum() / 3.0;
                    leaves.push((leaf, weight));
                    total += weight;
                    // Weighed by the suns: light of many bounces has more colour, and comes from where there is less sun.
                    let sun = points.leaf_light[leaf as usize];
                    rgb += light * sun;
                    by_points += points.tint(leaf) * (weight * sun);
                });
            }
        }
        leaves.sort_by_key(|(leaf, _)| *leaf);
        let tint = [0, 1, 2].map(|c: usize| if by_points[c] > 0.0 { rgb[c] / by_points[c] } else { 1.0 });
        Received { total, nodes: up_the_tree(&leaves, points.len()), tint }
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
