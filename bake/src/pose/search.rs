//! Where a fit begins: poses from three points each, under a ladder of lenses, judged by all points with a bounded loss.
//!
//! Fischler & Bolles, *Random Sample Consensus*, CACM 1981; points in a plane are no exception to three of them.

use super::model::{Model, Projector, diagonal_px};
use super::points::Point;
use super::threepoint::{Stand, poses};
use crate::camera::{Optics, Projection};
use glam::DVec3;

/// Focal lengths that are tried: half the diagonal over them, and the step between two.
const CORNERS: std::ops::Range<f64> = 0.05..2.6;
const STEP: f64 = 1.25;
/// Distortion at the corner that is tried.
const BENT_RADIAL: [f64; 3] = [0.0, -0.12, -0.25];
const BENT_FISHEYE: [f64; 1] = [0.0];
/// Triples that are tried, at most.
const TRIPLES: usize = 220;
/// A point farther off than this share of the diagonal counts as that far off.
const FAR: f64 = 0.02;
/// Starts that are handed on.
pub const STARTS: usize = 6;

/// The best starts under `projection`, the best first.
pub fn starts(points: &[Point], size_px: [u32; 2], projection: Projection, max_angle_deg: f64) -> Vec<Model> {
    let triples = triples(points.len());
    let bent: &[f64] = match projection {
        Projection::Radial => &BENT_RADIAL,
        Projection::KannalaBrandt => &BENT_FISHEYE,
    };
    let mut found: Vec<(f64, Model)> = Vec::new();
    let mut corner = CORNERS.start;
    while corner < CORNERS.end {
        let focal_px = 0.5 * diagonal_px(size_px) / corner;
        for &kappa in bent {
            let ideal = Optics::ideal(projection, size_px, focal_px);
            let k = [kappa / (corner * corner), 0.0, 0.0, 0.0];
            let optics = Optics { k, max_angle_deg, ..ideal };
            if optics.fold_px().is_none() {
                found.extend(best_stand(points, &triples, &optics));
            }
        }
        corner *= STEP;
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(STARTS);
    found.into_iter().map(|(_, model)| model).collect()
}

fn best_stand(points: &[Point], triples: &[[usize; 3]], optics: &Optics) -> Option<(f64, Model)> {
    let lens = optics.lens();
    let far = FAR * diagonal_px(optics.size_px);
    let rays: Vec<Option<DVec3>> = points.iter().map(|p| lens.direction(p.position_px).map(DVec3::from)).collect();
    let mut best: Option<(f64, Stand)> = None;
    for &[a, b, c] in triples {
        let (Some(ra), Some(rb), Some(rc)) = (rays[a], rays[b], rays[c]) else { continue };
        poses([points[a].world, points[b].world, points[c].world], [ra, rb, rc], |stand| {
            let projector = Projector::new(stand, lens);
            let limit = best.map_or(f64::INFINITY, |(loss, _)| loss);
            let mut loss = 0.0;
            for point in points {
                let off = projector.residual(point).map_or(far, |[x, y]| x.hypot(y).min(far));
                loss += off * off;
                if loss >= limit {
                    return;
                }
            }
            best = Some((loss, stand));
        });
    }
    best.map(|(loss, stand)| {
        let mut model = Model::new(stand, optics, 1.0);
        let distances = model.distances_m(points);
        model.scale_m = distances[distances.len() / 2].max(1e-9);
        (loss, model)
    })
}

/// Triples of different indices below `count`: all of them, or evenly many drawn without order.
fn triples(count: usize) -> Vec<[usize; 3]> {
    let all = count * (count - 1) * (count - 2) / 6;
    if all <= TRIPLES {
        let mut list = Vec::with_capacity(all);
        for a in 0..count {
            for b in a + 1..count {
                list.extend((b + 1..count).map(|c| [a, b, c]));
            }
        }
        return list;
    }
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % count
    };
    let mut list = Vec::with_capacity(TRIPLES);
    while list.len() < TRIPLES {
        let [a, b, c] = [draw(), draw(), draw()];
        if a != b && b != c && a != c {
            list.push([a, b, c]);
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triples_are_all_or_enough() {
        assert_eq!((triples(6).len(), triples(12).len(), triples(40).len()), (20, 220, TRIPLES));
        assert!(triples(40).iter().all(|[a, b, c]| a != b && b != c && a != c && *a.max(b).max(c) < 40));
    }
}
