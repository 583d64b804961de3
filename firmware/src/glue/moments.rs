//! Light that stands aside of its patch's middle, moved in part to the patches next to it.
//!
//! A patch answers as if its light were even. Light that gathers at one side of it (a sun's aureole, the edge of a cloud, a bright
//! horizon) would then come from half a patch away: too much or too little of it on every surface that it grazes. So each patch
//! gives a share of its light to two neighbours, such that light and its first moment about the patch's middle stay what they
//! are: what the sky is on a matt surface that all of those patches light comes out exact. Even patches give nothing. With the
//! patch, the two are the corners of the triangle of the middles' Delaunay triangulation that the moment points into: no light is
//! negative, and a light that moves from one patch into the next, within a triangle that both are corners of, does not jump.
//! Where there is no triangle, as at the horizon, the neighbour nearest to that direction takes what it can.
//!
//! Patches of a list have no borders and keep what they have.

use crate::patches::PatchSet;
use crate::patches::vectors::{Vec3, beside, dot};
use std::f64::consts::TAU;

/// How far neighbours are, at most, in square roots of the larger one's solid angle.
const REACH: f64 = 2.0;
/// Directions of a patch, a side, that its middle is the mean of.
const SIDE: usize = 16;
/// Two directions closer than this are one, and a facet narrower than this is none.
const LEAST: f64 = 1e-9;

/// A neighbour, where it stands in the patch's tangent plane.
#[derive(Clone, Copy, Debug)]
struct Neighbour {
    patch: usize,
    at: [f64; 2],
}

/// A patch and its Delaunay neighbours, by the angle at which they stand around it.
#[derive(Clone, Debug)]
struct Around {
    axes: [Vec3; 2],
    star: Vec<Neighbour>,
}

/// Moves light between the patches of one set.
#[derive(Clone, Debug)]
pub struct Moments {
    around: Vec<Around>,
    omegas_sr: Vec<f64>,
}

/// What one channel of a patch gives: so much of its light (radiance x solid angle) to each of two patches.
type Given = [(usize, f64); 2];

impl Moments {
    /// For a set; none for a list.
    pub fn new(set: &PatchSet) -> Option<Self> {
        if set.listed().is_some() {
            return None;
        }
        // All of a sphere's patches are neighbours of each other; those of the ground are none of the sky's.
        let count = if set.horizon().is_some() { set.upper() } else { set.len() };
        let middles: Vec<Vec3> = (0..count).map(|patch| middle(set, patch)).collect();
        let omegas_sr: Vec<f64> = (0..count).map(|patch| f64::from(set.solid_angle_sr(patch))).collect();
        let around = (0..count).map(|patch| around(&middles, &omegas_sr, patch)).collect();
        Some(Moments { around, omegas_sr })
    }

    /// Moves light of `radiance` (mean RGB per patch) to where it stands: `aside[patch][channel]` is the integral of a channel's
    /// radiance x (direction - middle) over the patch, the middle being that of even light, world axes.
    pub fn settle(&self, radiance: &mut [[f32; 3]], aside: &[[Vec3; 3]]) {
        for (patch, (around, aside)) in self.around.iter().zip(aside).enumerate() {
            for (channel, &moment) in aside.iter().enumerate() {
                for (to, light) in around.given(moment) {
                    // About half of a patch's light is the most that it has to give.
                    let light = light.min(f64::from(radiance[patch][channel]) * self.omegas_sr[patch]).max(0.0);
                    radiance[patch][channel] -= (light / self.omegas_sr[patch]) as f32;
                    radiance[to][channel] += (light / self.omegas_sr[to]) as f32;
                }
            }
        }
    }
}

impl Around {
    /// What goes to whom, for a moment.
    fn given(&self, moment: Vec3) -> Given {
        let m = self.axes.map(|axis| dot(axis, moment));
        let nothing = [(0, 0.0); 2];
        if m[0].hypot(m[1]) == 0.0 || self.star.is_empty() {
            return nothing;
        }
        let pairs = self.star.iter().zip(self.star.iter().cycle().skip(1));
        let shares = |(a, b): (&Neighbour, &Neighbour)| {
            let whole = cross(a.at, b.at);
            let (to_a, to_b) = (cross(m, b.at) / whole, cross(a.at, m) / whole);
            (whole > LEAST && to_a >= 0.0 && to_b >= 0.0).then_some([(a.patch, to_a), (b.patch, to_b)])
        };
        pairs.map(shares).find_map(|found| found).unwrap_or_else(|| self.nearest(m))
    }

    /// The one neighbour that takes most of a moment.
    fn nearest(&self, m: [f64; 2]) -> Given {
        let along = |n: &Neighbour| (m[0] * n.at[0] + m[1] * n.at[1]) / n.at[0].hypot(n.at[1]);
        let best = self.star.iter().max_by(|a, b| along(a).total_cmp(&along(b)));
        let given = best.map_or((0, 0.0), |n| (n.patch, (along(n) / n.at[0].hypot(n.at[1])).max(0.0)));
        [given, (0, 0.0)]
    }
}

/// Mean direction of a patch, which is not of unit length.
fn middle(set: &PatchSet, patch: usize) -> Vec3 {
    let part = |at: usize| (at as f32 + 0.5) / SIDE as f32;
    let mut sum = [0.0; 3];
    for at in 0..SIDE * SIDE {
        let dir = set.sample(patch, [part(at % SIDE), part(at / SIDE)]);
        sum = std::array::from_fn(|k| sum[k] + f64::from(dir[k]) / (SIDE * SIDE) as f64);
    }
    sum
}

/// Two unit vectors that span a patch's tangent plane.
fn axes(middle: Vec3) -> [Vec3; 2] {
    let length = dot(middle, middle).sqrt();
    beside(middle.map(|c| c / length)).into()
}

fn around(middles: &[Vec3], omegas_sr: &[f64], patch: usize) -> Around {
    let own = middles[patch];
    let axes = axes(own);
    let apart = |other: Vec3| -> Vec3 { std::array::from_fn(|k| other[k] - own[k]) };
    let is_near = |&(other, middle): &(usize, &Vec3)| {
        other != patch
            && dot(apart(*middle), apart(*middle)).sqrt() < REACH * omegas_sr[patch].max(omegas_sr[other]).sqrt()
    };
    let stands =
        |(other, middle): (usize, &Vec3)| Neighbour { patch: other, at: axes.map(|axis| dot(axis, apart(*middle))) };
    let mut all: Vec<Neighbour> = middles.iter().enumerate().filter(is_near).map(stands).collect();
    let turn = |n: &Neighbour| n.at[1].atan2(n.at[0]).rem_euclid(TAU);
    all.sort_by(|a, b| turn(a).total_cmp(&turn(b)));
    Around { axes, star: star(all) }
}

/// Leaves the neighbours of the Delaunay triangulation: turned inside out (`at / |at|^2`), which makes lines of the circles through
/// the patch, they are the corners of their hull.
fn star(mut all: Vec<Neighbour>) -> Vec<Neighbour> {
    let inverted = |n: &Neighbour| n.at.map(|c| c / (n.at[0] * n.at[0] + n.at[1] * n.at[1]));
    let is_behind = |a: &Neighbour, b: &Neighbour, c: &Neighbour| {
        let [a, b, c] = [a, b, c].map(inverted);
        cross(a, c) > LEAST && cross([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]) <= 0.0
    };
    while let Some(behind) = (0..all.len()).find(|&at| {
        let n = all.len();
        n > 2 && is_behind(&all[(at + n - 1) % n], &all[at], &all[(at + 1) % n])
    }) {
        all.remove(behind);
    }
    all
}

/// The third coordinate of a product of two vectors in the plane.
fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small light in a direction, as means and moments, and what it was.
    fn lamp(set: &PatchSet, dir: [f32; 3]) -> (Vec<[f32; 3]>, Vec<[Vec3; 3]>) {
        let patch = set.patch_of(dir);
        let own = middle(set, patch);
        let (mut radiance, mut aside) = (vec![[0.0; 3]; set.len()], vec![[[0.0; 3]; 3]; set.len()]);
        radiance[patch] = [1.0 / set.solid_angle_sr(patch), 0.0, 0.0];
        aside[patch][0] = std::array::from_fn(|k| f64::from(dir[k]) - own[k]);
        (radiance, aside)
    }

    fn unit(v: [f32; 3]) -> [f32; 3] {
        v.map(|c| c / v.iter().map(|c| c * c).sum::<f32>().sqrt())
    }

    /// Directions all over, or above the lowest ring.
    fn directions(low: f32) -> impl Iterator<Item = [f32; 3]> {
        let at = move |k: u32| {
            let (y, azimuth) = (1.0 - (1.0 - low) * (k as f32 + 0.5) / 500.0, k as f32 * 2.399_963);
            let r = (1.0 - y * y).max(0.0).sqrt();
            unit([r * azimuth.cos(), y, r * azimuth.sin()])
        };
        (0..500).map(at)
    }

    #[test]
    fn light_and_its_direction_stay_and_none_is_negative() {
        for (set, low) in [(PatchSet::new(256).unwrap(), 0.1), (PatchSet::sphere(300).unwrap(), -1.0)] {
            let moments = Moments::new(&set).unwrap();
            let middles: Vec<Vec3> = (0..set.len()).map(|patch| middle(&set, patch)).collect();
            for dir in directions(low) {
                let (mut radiance, aside) = lamp(&set, dir);
                moments.settle(&mut radiance, &aside);
                assert!(radiance.iter().all(|rgb| rgb[0] >= 0.0 && rgb[1] == 0.0), "{dir:?}");
                let light = |patch: usize| f64::from(radiance[patch][0] * set.solid_angle_sr(patch));
                let whole: f64 = (0..set.len()).map(light).sum();
                assert!((whole - 1.0).abs() < 1e-5, "{dir:?}: {whole}");
                let own = middle(&set, set.patch_of(dir));
                // The moment stays in the plane of the patch; along its direction it is what the patches' curvature leaves.
                for axis in axes(own) {
                    let there: f64 = (0..set.len()).map(|patch| light(patch) * dot(axis, middles[patch])).sum();
                    let wanted = dot(axis, dir.map(f64::from));
                    assert!((there - wanted).abs() < 1e-5, "{dir:?}: {there} for {wanted}");
                }
            }
        }
    }

    #[test]
    fn even_light_stays() {
        let set = PatchSet::new(64).unwrap();
        let mut radiance = vec![[1.0, 2.0, 3.0]; set.len()];
        Moments::new(&set).unwrap().settle(&mut radiance, &vec![[[0.0; 3]; 3]; set.len()]);
        assert!(radiance.iter().all(|rgb| *rgb == [1.0, 2.0, 3.0]));
    }

    /// Without moments all of it jumps at every border.
    #[test]
    fn a_light_seldom_jumps_as_it_moves() {
        let set = PatchSet::new(256).unwrap();
        let moments = Moments::new(&set).unwrap();
        let dir = |k: u32| {
            let turn = k as f32 * 0.0005;
            unit([turn.cos(), 0.5 + 0.2 * (3.0 * turn).sin(), turn.sin()])
        };
        let at = |k: u32| {
            let (mut radiance, aside) = lamp(&set, dir(k));
            moments.settle(&mut radiance, &aside);
            radiance
        };
        let (mut borders, mut jumps) = (0, 0);
        for k in 1..12_000 {
            let change: f32 = at(k).iter().zip(&at(k - 1)).map(|(a, b)| (a[0] - b[0]).abs()).sum();
            borders += u32::from(set.patch_of(dir(k)) != set.patch_of(dir(k - 1)));
            jumps += u32::from(change * set.solid_angle_sr(0) > 0.05);
        }
        assert!(borders > 40 && jumps * 10 <= borders, "{jumps} jumps at {borders} borders");
    }

    /// Low light has no patches below it to share with: it stays above the horizon, all of it.
    #[test]
    fn light_at_the_horizon_stays_above_it() {
        let set = PatchSet::new(256).unwrap();
        let moments = Moments::new(&set).unwrap();
        for k in 0..200 {
            let azimuth = k as f32 * 0.1;
            let (mut radiance, aside) = lamp(&set, unit([azimuth.cos(), 0.002, azimuth.sin()]));
            moments.settle(&mut radiance, &aside);
            let above: f32 = radiance[..set.upper()].iter().map(|rgb| rgb[0] * set.solid_angle_sr(0)).sum();
            assert!((above - 1.0).abs() < 1e-5, "{k}: {above}");
        }
    }
}
