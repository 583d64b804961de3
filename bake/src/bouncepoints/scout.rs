//! Scouts: paths that find where bounce points are needed.
//!
//! A first round finds few points, evenly over the picture. What those leave of each pixel's light to chance tells how many
//! scouts the pixel sends in a second round: points gather where shadows on near surfaces show in single pixels.

use glam::Vec3A;
use rayon::prelude::*;
use relume_firmware::bounce::MAX_BOUNCE_POINTS;

use super::{BouncePoints, Vertex};
use crate::path::Step;
use crate::response::Transport;
use crate::sobol::two_squares;
use crate::strata::{Rng, hash};

/// Scouts of the first round, in all, were every pixel to see something; about one surface of each becomes a candidate.
const SCOUTS: u32 = 1 << 22;
/// Most pixels that send them.
const SCOUTING_PIXELS: u32 = 1 << 17;
/// Scouts of the second round, as a multiple of those of the first.
const SECOND_ROUND: f32 = 2.0;
/// Most that a pixel sends then, as a multiple of the mean.
const MOST_OF_ONE: f32 = 64.0;
/// A surface nearer than this to the one that it lights, in pixels there, is a candidate in any case; further ones become
/// one the less often, by the square root of their distance: shadows on near surfaces show in single pixels, those on far
/// ones only in the mean.
const NEAR_PX: f32 = 8.0;
/// Points per covered pixel, at least.
const POINTS_PER_PIXEL: usize = 2;
/// Fewest points, where there are candidates enough.
const FEWEST_POINTS: usize = 1 << 14;
/// Candidates per point at least.
const CANDIDATES_PER_POINT: usize = 4;
/// Paths from each point of a pixel that tell what is left to chance.
const NEED_PATHS: u32 = 4;

/// Streams of random numbers ([`Rng::new`]).
const FIRST: u32 = 2;
const NEED: u32 = 4;
const SECOND: u32 = 5;

/// A pixel that sends scouts.
struct Sender {
    x: u32,
    y: u32,
    /// What it has found; `None` if it sees nothing.
    found: Option<Vec<Vertex>>,
}

impl Transport<'_> {
    /// Finds the points for this view. Depends on the seed only.
    pub fn bounce_points(&self) -> BouncePoints {
        let pixels = self.width * self.height;
        let stride = pixels.div_ceil(SCOUTING_PIXELS);
        let scouts = (SCOUTS / (pixels / stride)).clamp(4, 64).next_power_of_two();
        let send = |k: u32| {
            let at = k * stride + hash(k) % stride;
            let (x, y) = (at % self.width, at / self.width);
            Sender { x, y, found: self.scout(x, y, scouts, FIRST) }
        };
        let mut senders: Vec<Sender> = (0..pixels / stride).into_par_iter().map(send).collect();
        let covered = senders.iter().filter(|sender| sender.found.is_some()).count() * stride as usize;
        let wanted = (covered * POINTS_PER_PIXEL).next_power_of_two().clamp(FEWEST_POINTS, MAX_BOUNCE_POINTS);
        let first = self.tree(candidates(&senders), wanted / 4);
        self.second_round(&mut senders, scouts, &first);
        self.tree(candidates(&senders), wanted)
    }

    /// At most `wanted` points of these candidates, a power of two.
    fn tree(&self, candidates: Vec<Vertex>, wanted: usize) -> BouncePoints {
        let most = (candidates.len() / CANDIDATES_PER_POINT).min(MAX_BOUNCE_POINTS);
        let count = wanted.min((most + 1).next_power_of_two() / 2);
        BouncePoints::new(candidates, count, &self.tracer.geometry)
    }

    /// Lets every pixel send more scouts by what `first` leaves of its light.
    fn second_round(&self, senders: &mut [Sender], scouts: u32, first: &BouncePoints) {
        let need = |s: &Sender| s.found.as_ref().map_or(0.0, |_| self.left_to_chance(first, s.x, s.y));
        let needs: Vec<f32> = senders.par_iter().map(need).collect();
        let seeing = senders.iter().filter(|sender| sender.found.is_some()).count();
        let mean = needs.iter().sum::<f32>() / seeing.max(1) as f32;
        if mean <= 0.0 {
            return;
        }
        senders.par_iter_mut().zip(&needs).for_each(|(sender, need)| {
            let more = (scouts as f32 * SECOND_ROUND * (need / mean).min(MOST_OF_ONE)) as u32;
            let Some(found) = &mut sender.found else { return };
            found.extend(self.scout(sender.x, sender.y, more, SECOND).unwrap_or_default());
            let share = scouts as f32 / (scouts + more) as f32;
            found.iter_mut().for_each(|vertex| vertex.paths *= share);
        });
    }

    /// What `points` leave of a pixel's light to chance, rms over suns: how differently the two halves of a point's
    /// surroundings are lit, times how much the pixel receives from there.
    fn left_to_chance(&self, points: &BouncePoints, x: u32, y: u32) -> f32 {
        if points.len() < 2 {
            return 0.0;
        }
        let (seen, _) = self.seen(x, y);
        let mut rng = Rng::new(self.options.seed, x, y, NEED);
        let seed = rng.next_u32();
        let mut leaves: Vec<(u32, f32)> = Vec::new();
        for (s, surface) in seen.iter().enumerate() {
            let Some(surface) = surface else { continue };
            for path in 0..NEED_PATHS {
                let at = two_squares(s as u32 * NEED_PATHS + path, seed);
                self.tracer.walk(surface, at, &mut rng, |step, throughput, _, _| {
                    let Step::Met(surface) = step else { return };
                    let weight = (throughput * surface.reflectance()).element_sum() / 3.0;
                    leaves.push((points.nearest(&Vertex::of(surface, 1.0)), weight));
                });
            }
        }
        leaves.sort_by_key(|(leaf, _)| *leaf);
        let mut squared = 0.0;
        for own in leaves.chunk_by(|a, b| a.0 == b.0) {
            // Pairs of different paths only: a single path's square says nothing but that it is one.
            let (sum, squares) = own.iter().fold((0.0, 0.0), |(s, q), (_, w)| (s + w, q + w * w));
            squared += (sum * sum - squares) * points.power[(points.len() + own[0].0 as usize) / 2];
        }
        squared.max(0.0).sqrt() / (NEED_PATHS * seen.len() as u32) as f32
    }

    /// Surfaces that paths from a pixel meet, each with a chance of the reflectances that its light passes on its way to
    /// the seen surface; `None` for a pixel that sees nothing.
    fn scout(&self, x: u32, y: u32, scouts: u32, stream: u32) -> Option<Vec<Vertex>> {
        let (seen, _) = self.seen(x, y);
        let seen: Vec<_> = seen.iter().flatten().collect();
        let mut rng = Rng::new(self.options.seed, x, y, stream);
        let seed = rng.next_u32();
        let mut found = Vec::new();
        for path in 0..scouts {
            let surface = seen.get(rng.next_u32() as usize % seen.len().max(1))?;
            let own = surface.reflectance().max(Vec3A::splat(1e-6));
            let from_eye = surface.position.distance(self.view.position.as_vec3a());
            let footprint = NEAR_PX * self.view.pixel_angle(x as f32 + 0.5, y as f32 + 0.5) * from_eye;
            let mut before = surface.position;
            self.tracer.walk(surface, two_squares(path, seed), &mut rng, |step, throughput, _, rng| {
                let Step::Met(surface) = step else { return };
                let relayed = (throughput / own * surface.reflectance()).element_sum() / 3.0;
                let distance = surface.position.distance(before);
                before = surface.position;
                let near = (footprint / distance).min(1.0).sqrt();
                if rng.unit() < relayed * near {
                    found.push(Vertex::of(surface, 1.0 / near));
                }
            });
        }
        Some(found)
    }
}

fn candidates(senders: &[Sender]) -> Vec<Vertex> {
    senders.iter().filter_map(|sender| sender.found.as_ref()).flatten().copied().collect()
}
