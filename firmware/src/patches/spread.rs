//! A light in any direction as light of the patches around it, for fields that carry no geometry to trace the sun through.
//!
//! The shares `b` of the patches are those with the least sum for which `sum_i b_i dir_i = dir` and `b_i >= 0`: at most
//! three patches, the corners of the triangle of the directions' convex hull that the light shines through. So a Lambert
//! surface that all three light comes out exact, a patch's own direction is that patch alone, and nothing jumps as the
//! light moves. Towards a horizon, where there are no patches left, the light fades as on a surface that faces away from
//! that horizon. The triangle is found as the solution of that linear program by the simplex method, from any start.

use super::PatchSet;
use super::listed::is_before;
use super::vectors::{Vec3, beside, cross, dot};
use core::f64::consts::TAU;

/// A patch and its share of a light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Patch.
    pub patch: usize,
    /// Share of the light's irradiance that the patch's picture is shown for.
    pub share: f32,
}

/// Directions on the horizon that are dark.
const DARK: usize = 32;
/// What a corner of the start costs: more than any triangle of patches can.
const START_COST: f64 = 1e6;
const DONE: f64 = 1e-9;
/// Exchanges, at most; few sets need more than 20.
const STEPS: usize = 500;

/// A corner of the triangle.
#[derive(Clone, Copy)]
struct Corner {
    dir: Vec3,
    cost: f64,
    patch: Option<usize>,
}

/// Shares of the patches for a light in a unit direction; unused ones are 0. `None`: behind the horizon, or on a side that no
/// patch is on.
pub fn spread(set: &PatchSet, dir_world: [f32; 3]) -> Option<[Share; 3]> {
    let horizon = set.horizon();
    let to = dir_world.map(f64::from);
    if horizon.is_some_and(|axis| dot(axis.map(f64::from), to) < 0.0) {
        return None;
    }
    let mut corners = start(to);
    let mut shares = [1.0 / 3.0; 3];
    for _ in 0..STEPS {
        // The plane through the corners, as the duals tell it: `plane . dir` is a corner's cost.
        let plane = plane_of(&corners)?;
        let Some(next) = farthest(set, horizon, plane) else { break };
        let inverse = inverse_of(&corners)?;
        let turn = apply(&inverse, next.dir);
        let leaving = (0..3).filter(|&k| turn[k] > DONE);
        let leaving = leaving.min_by(|&a, &b| (shares[a] / turn[a]).total_cmp(&(shares[b] / turn[b])))?;
        corners[leaving] = next;
        shares = apply(&inverse_of(&corners)?, to).map(|share| share.max(0.0));
    }
    let is_start = |(corner, share): (&Corner, &f64)| corner.cost > 1.0 && *share > 1e-6;
    if corners.iter().zip(&shares).any(is_start) {
        return None;
    }
    let share = |k: usize| corners[k].patch.map_or(Share::default(), |patch| Share { patch, share: shares[k] as f32 });
    Some([share(0), share(1), share(2)])
}

/// Adds a sun's light to the patches around it; `false`, and nothing added, where [`spread`] finds none.
pub fn add_sun(set: &PatchSet, dir_world: [f32; 3], irradiance: [f32; 3], radiance_linear: &mut [[f32; 3]]) -> bool {
    let Some(shares) = spread(set, dir_world) else { return false };
    for Share { patch, share } in shares {
        let per_sr = share / set.solid_angle_sr(patch);
        if let Some(radiance) = radiance_linear.get_mut(patch) {
            (0..3).for_each(|c| radiance[c] += per_sr * irradiance[c]);
        }
    }
    true
}

/// Three directions around `to`.
fn start(to: Vec3) -> [Corner; 3] {
    let (a, b) = beside(to);
    core::array::from_fn(|k| {
        let (sin, cos) = libm::sincos(TAU * k as f64 / 3.0);
        let dir = core::array::from_fn(|i| to[i] + 0.1 * (cos * a[i] + sin * b[i]));
        Corner { dir, cost: START_COST, patch: None }
    })
}

/// The direction, of a patch or a dark one, that is farthest beyond the plane; `None` when none is.
fn farthest(set: &PatchSet, horizon: Option<[f32; 3]>, plane: Vec3) -> Option<Corner> {
    let mut best = (1.0 + DONE, None);
    for patch in 0..set.len() {
        let dir = set.dir_world(patch);
        if horizon.is_some_and(|axis| !is_before(axis, dir)) {
            continue;
        }
        let dir = dir.map(f64::from);
        let beyond = dot(plane, dir);
        if beyond > best.0 {
            best = (beyond, Some(Corner { dir, cost: 1.0, patch: Some(patch) }));
        }
    }
    if let Some(axis) = horizon {
        let (a, b) = beside(axis.map(f64::from));
        for k in 0..DARK {
            let (sin, cos) = libm::sincos(TAU * k as f64 / DARK as f64);
            let dir = core::array::from_fn(|i| cos * a[i] + sin * b[i]);
            let beyond = dot(plane, dir);
            if beyond > best.0 {
                best = (beyond, Some(Corner { dir, cost: 1.0, patch: None }));
            }
        }
    }
    best.1
}

/// `p` with `p . dir = cost` for all corners.
fn plane_of(corners: &[Corner; 3]) -> Option<Vec3> {
    let inverse = inverse_of(corners)?;
    Some(core::array::from_fn(|i| (0..3).map(|k| corners[k].cost * inverse[k][i]).sum()))
}

/// The inverse of the matrix whose columns are the corners' directions, by rows.
fn inverse_of(corners: &[Corner; 3]) -> Option<[Vec3; 3]> {
    let [a, b, c] = [corners[0].dir, corners[1].dir, corners[2].dir];
    let rows = [cross(b, c), cross(c, a), cross(a, b)];
    let determinant = dot(a, rows[0]);
    (determinant.abs() > 1e-14).then(|| rows.map(|row| row.map(|v| v / determinant)))
}

fn apply(rows: &[Vec3; 3], v: Vec3) -> Vec3 {
    rows.map(|row| dot(row, v))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::patches::{Listed, ListedPatch};
    use std::vec;
    use std::vec::Vec;

    fn set(dirs: &[[f32; 3]], horizon: Option<[f32; 3]>) -> PatchSet {
        let mut dirs: Vec<[f32; 3]> = dirs.to_vec();
        dirs.sort_by_key(|dir| dir[1] < 0.0);
        let patch =
            |(row, &dir_world): (usize, &[f32; 3])| ListedPatch { dir_world, solid_angle_sr: 0.1, row: row as u16 };
        let patches: Vec<ListedPatch> = dirs.iter().enumerate().map(patch).collect();
        PatchSet::of_list(Listed::new(&patches, horizon).unwrap())
    }

    /// Directions spread over the sphere, or its part with z >= `low`.
    fn spiral(n: usize, low: f64) -> Vec<[f32; 3]> {
        (0..n)
            .map(|k| {
                let z = 1.0 - (1.0 - low) * (k as f64 + 0.5) / n as f64;
                let (sin, cos) = libm::sincos(k as f64 * 2.399_963_229_728_653);
                let r = libm::sqrt(1.0 - z * z);
                [(r * cos) as f32, (r * sin) as f32, z as f32]
            })
            .collect()
    }

    fn sum(set: &PatchSet, shares: &[Share; 3]) -> ([f32; 3], f32) {
        let at = |c: usize| shares.iter().map(|s| s.share * set.dir_world(s.patch)[c]).sum();
        ([at(0), at(1), at(2)], shares.iter().map(|s| s.share).sum())
    }

    /// All around: the shares put the direction together, and no three other patches do it with less.
    #[test]
    fn shares_are_the_hulls_triangle() {
        let set = set(&spiral(40, -1.0), None);
        for to in spiral(101, -1.0) {
            let shares = spread(&set, to).unwrap();
            let (dir, total) = sum(&set, &shares);
            assert!(dir.iter().zip(to).all(|(a, b)| (a - b).abs() < 1e-5), "{to:?} {shares:?}");
            assert!(shares.iter().all(|s| s.share >= 0.0) && (1.0..1.3).contains(&total));
            for a in 0..40 {
                for b in 0..a {
                    for c in 0..b {
                        let corner = |p: usize| Corner { dir: set.dir_world(p).map(f64::from), cost: 1.0, patch: None };
                        let Some(inverse) = inverse_of(&[corner(a), corner(b), corner(c)]) else { continue };
                        let other = apply(&inverse, to.map(f64::from));
                        let better = other.iter().sum::<f64>() < f64::from(total) - 1e-5;
                        assert!(!(better && other.iter().all(|&s| s > -1e-9)), "{to:?} {a} {b} {c} {other:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_patchs_own_direction_is_that_patch() {
        for (set, n) in [(set(&spiral(64, -1.0), None), 64), (set(&spiral(64, 0.2), Some([0.0, 0.0, 1.0])), 64)] {
            for patch in 0..n {
                for Share { patch: other, share } in spread(&set, set.dir_world(patch)).unwrap() {
                    let wanted = if other == patch && share > 0.5 { 1.0 } else { 0.0 };
                    assert!((share - wanted).abs() < 1e-5, "{patch} {other} {share}");
                }
            }
        }
    }

    /// Below the lowest lights of a dome, a surface that faces the camera keeps its cosine; behind it there is no light.
    #[test]
    fn a_dome_fades_to_its_horizon() {
        let set = set(&spiral(60, 0.3), Some([0.0, 0.0, 1.0]));
        for z in [0.25f32, 0.1, 0.01] {
            for turn in 0..7 {
                let (sin, cos) = libm::sincosf(turn as f32 * 0.9);
                let r = (1.0 - z * z).sqrt();
                let shares = spread(&set, [r * cos, r * sin, z]).unwrap();
                let flat: f32 = shares.iter().map(|s| s.share * set.dir_world(s.patch)[2]).sum();
                assert!((flat - z).abs() < 1e-5, "{z} {turn} {flat}");
            }
        }
        assert_eq!(spread(&set, [0.0, 0.6, -0.8]), None);
        // Light from all around that has no patch on one side has no light from there.
        let half = self::set(&spiral(60, 0.3), None);
        assert_eq!(spread(&half, [0.0, 0.0, -1.0]), None);
    }

    #[test]
    fn nothing_jumps_as_a_light_moves() {
        let set = PatchSet::new(64).unwrap();
        let at = |k: u32| {
            let (sin, cos) = libm::sincosf(k as f32 * 0.002);
            let mut light = vec![[0.0f32; 3]; set.len()];
            let dir = [cos * 0.8, sin * 0.8 + 0.1 * (1.0 - sin), 0.6];
            let length = dir.iter().map(|c| c * c).sum::<f32>().sqrt();
            assert!(add_sun(&set, dir.map(|c| c / length), [1.0, 2.0, 0.0], &mut light));
            light
        };
        for k in 1..700 {
            let (before, after) = (at(k - 1), at(k));
            let change: f32 = before.iter().zip(&after).map(|(a, b)| (a[1] - b[1]).abs()).sum();
            let all: f32 = after.iter().map(|rgb| rgb[1]).sum();
            assert!(change < 0.04 * all, "{k} {change} of {all}");
        }
    }
}
