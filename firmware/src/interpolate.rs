//! Sunlight from patch responses: smooth interpolation weights around one direction.
//!
//! The response to a sun is approximated by a mean of the responses of the patches around it, weighted by a Gaussian
//! of the chord between sun and patch centroid. It is meant for light that has bounced at least once, which changes
//! slowly with the sun's direction; direct sunlight has edges that no patch resolves.

use crate::patches::PatchSet;

/// Width of the Gaussian, in patch widths (square root of the solid angle).
pub const KERNEL_SIGMA: f32 = 0.6;
/// Where the Gaussian has fallen to zero, in sigmas; its value there is subtracted so that it ends without a step.
const KERNEL_REACH: f32 = 4.0;

/// Writes one weight per patch so that `sum_i out[i] * response_i` approximates the response to a sun of irradiance 1
/// (on a plane normal to it) in direction `dir_world` (unit, towards the sun). Units: 1/sr.
///
/// The kernel sums to 1 over the upper hemisphere and varies continuously with the direction; lower patches get 0. A
/// direction below the horizon is taken as the point of the horizon under it, the nadir as no sun (all zero).
/// `out` entries beyond the set's patches are set to 0; a shorter `out` gets the weights of its patches only.
pub fn sun_patch_weights(set: &PatchSet, dir_world: [f32; 3], out: &mut [f32]) {
    out.fill(0.0);
    let Some([x, y, z]) = above_horizon(dir_world) else { return };
    let sigma = KERNEL_SIGMA * libm::sqrtf(set.solid_angle_sr(0));
    let inverse = 0.5 / (sigma * sigma);
    let floor = libm::expf(-0.5 * KERNEL_REACH * KERNEL_REACH);
    let kernel = |patch: usize| {
        let [px, py, pz] = set.dir_world(patch);
        let chord2 = (px - x) * (px - x) + (py - y) * (py - y) + (pz - z) * (pz - z);
        (libm::expf(-chord2 * inverse) - floor).max(0.0)
    };
    let mut total = 0.0;
    for patch in 0..set.upper() {
        let value = kernel(patch);
        total += value * set.solid_angle_sr(patch);
        if let Some(slot) = out.get_mut(patch) {
            *slot = value;
        }
    }
    // The chord from any direction to its own patch's centroid is under two sigmas, so the total is not zero.
    let scale = if total > 0.0 { 1.0 / total } else { 0.0 };
    out.iter_mut().for_each(|weight| *weight *= scale);
}

fn above_horizon([x, y, z]: [f32; 3]) -> Option<[f32; 3]> {
    let y = y.max(0.0);
    let length = libm::sqrtf(x * x + y * y + z * z);
    (length.is_finite() && length > 1e-6).then(|| [x / length, y / length, z / length])
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec;
    use std::vec::Vec;

    fn weights(set: &PatchSet, dir_world: [f32; 3]) -> Vec<f32> {
        let mut out = vec![9.0; set.len() + 3];
        sun_patch_weights(set, dir_world, &mut out);
        out
    }

    fn towards(azimuth: f32, altitude_deg: f32) -> [f32; 3] {
        let altitude = altitude_deg.to_radians();
        [altitude.cos() * azimuth.cos(), altitude.sin(), altitude.cos() * azimuth.sin()]
    }

    /// A plane facing the sun sees irradiance 1: the light's weighted solid angles sum to 1, and its mean direction is the sun's.
    #[test]
    fn irradiance_and_mean_direction_are_the_suns() {
        for n in [16, 145, 256, 1024] {
            let set = PatchSet::new(n).unwrap();
            let width = libm::sqrtf(set.solid_angle_sr(0));
            for altitude in [0.0f32, 3.0, 30.0, 60.0, 89.0, 90.0] {
                let d = towards(1.3, altitude);
                let w = weights(&set, d);
                let mut flux = 0.0;
                let mut mean = [0.0f32; 3];
                for (patch, &weight) in w.iter().enumerate().take(set.len()) {
                    let part = weight * set.solid_angle_sr(patch);
                    flux += part;
                    mean.iter_mut().zip(set.dir_world(patch)).for_each(|(m, p)| *m += part * p);
                }
                assert!((flux - 1.0).abs() < 1e-5);
                let off = mean.iter().zip(d).map(|(m, d)| (m - d) * (m - d)).sum::<f32>().sqrt();
                // Half the kernel is missing on the horizon, which lifts the mean.
                let allowed = if altitude < 10.0 { 0.65 } else { 0.25 };
                assert!(off < allowed * width, "{n} {altitude}: {off} of {width}");
                assert!(w[set.upper()..].iter().all(|&v| v == 0.0));
            }
        }
    }

    #[test]
    fn continuous_over_zenith_horizon_and_patch_borders() {
        let set = PatchSet::new(64).unwrap();
        let step = 0.1f32;
        let mut worst = 0.0f32;
        for azimuth in [0.0, 3.1] {
            let mut last = weights(&set, towards(azimuth, -2.0));
            let peak = last.iter().fold(0.0f32, |a, &b| a.max(b));
            for k in 1..1800 {
                let next = weights(&set, towards(azimuth, -2.0 + step * k as f32));
                let change = last.iter().zip(&next).fold(0.0f32, |a, (l, n)| a.max((l - n).abs()));
                worst = worst.max(change / peak);
                last = next;
            }
        }
        // 0.05 degrees is a hundredth of sigma.
        assert!(worst < 0.02, "{worst}");
    }

    #[test]
    fn nadir_and_nonsense_are_no_sun() {
        let set = PatchSet::new(64).unwrap();
        assert!(weights(&set, [0.0, -1.0, 0.0]).iter().all(|&w| w == 0.0));
        assert!(weights(&set, [f32::NAN, 1.0, 0.0]).iter().all(|&w| w == 0.0));
        assert_eq!(weights(&set, towards(0.4, -20.0)), weights(&set, towards(0.4, 0.0)));
        let mut short = [1.0f32; 5];
        sun_patch_weights(&set, [0.0, 1.0, 0.0], &mut short);
        assert!(short[0] > 0.0 && short.iter().all(|w| w.is_finite()));
    }
}
