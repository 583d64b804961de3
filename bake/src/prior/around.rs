//! Light from all around a small thing: rooms, windows, lamps.
//!
//! A random light of mean 1 whose variation has the same statistics in all directions: the sum of three fields with the
//! kernel `exp((cos - 1) / width^2)` of the angle between two directions (a Gaussian on the sphere, positive definite), and
//! white noise per patch, for lamps that one patch alone sees.

use super::Prior;
use nalgebra::DMatrix;
use relume_firmware::patches::PatchSet;

/// Width of a kernel, radians, and standard deviation of its field, relative to the mean light.
const FIELDS: [(f64, f64); 3] = [(1.0, 0.8), (0.35, 0.6), (0.12, 0.4)];
/// Standard deviation of the white part per patch.
pub(super) const WHITE: f64 = 0.3;
/// Share of the second moment that may be left out of the basis.
const TAIL: f64 = 1e-3;

pub(super) fn prior(set: &PatchSet) -> Prior {
    let dirs: Vec<[f32; 3]> = (0..set.len()).map(|patch| set.dir_world(patch)).collect();
    let moment = DMatrix::from_fn(dirs.len(), dirs.len(), |i, j| {
        smooth_moment(dirs[i], dirs[j]) + if i == j { WHITE * WHITE } else { 0.0 }
    });
    let total = moment.trace();
    Prior::from_moment(set, moment, TAIL * total, usize::MAX)
}

/// Second moment of the light from two unit directions, but for the white part.
pub(super) fn smooth_moment(a: [f32; 3], b: [f32; 3]) -> f64 {
    let cosine: f64 = a.iter().zip(b).map(|(&a, b)| f64::from(a) * f64::from(b)).sum();
    1.0 + FIELDS.iter().map(|(width, sd)| sd * sd * ((cosine - 1.0) / (width * width)).exp()).sum::<f64>()
}
