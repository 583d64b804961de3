//! Which triangles a pixel sees, and how much light each sends it: what the live sun needs to know.

use glam::Vec3A;

use crate::response::Seen;
use crate::strata::STRATA;

/// Most fragments that a pixel keeps.
pub const MAX_FRAGMENTS: usize = 8;

/// One triangle as a pixel sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fragment {
    /// Index into the scene's triangles.
    pub triangle: u32,
    /// Bit `s` is set when stratum `s` (column `s % 4` from the left, row `s / 4` from the top) sees the triangle.
    pub strata: u16,
    /// Linear RGB: the triangle's share of the pixel's samples times its mean reflectance. The sum over a pixel's
    /// fragments is its premultiplied mean reflectance.
    pub albedo: [f32; 3],
}

/// The fragments of a pixel, largest first; when there are more than [`MAX_FRAGMENTS`], the largest are kept and scaled
/// so that the pixel's mean reflectance stays the same in every channel.
pub(crate) fn fragments(seen: &Seen) -> Vec<Fragment> {
    let share = 1.0 / seen.len() as f32;
    let mut all: Vec<(Fragment, u32)> = Vec::new();
    for (sample, surface) in seen.iter().enumerate() {
        let Some(surface) = surface else { continue };
        let strata = 1u16 << (sample as u32 % STRATA);
        let albedo = surface.albedo * share;
        match all.iter_mut().find(|(fragment, _)| fragment.triangle == surface.triangle) {
            Some((fragment, samples)) => {
                fragment.strata |= strata;
                fragment.albedo = (Vec3A::from(fragment.albedo) + albedo).to_array();
                *samples += 1;
            }
            None => all.push((Fragment { triangle: surface.triangle, strata, albedo: albedo.to_array() }, 1)),
        }
    }
    all.sort_by_key(|(fragment, samples)| (std::cmp::Reverse(*samples), fragment.triangle));
    let total: Vec3A = all.iter().map(|(fragment, _)| Vec3A::from(fragment.albedo)).sum();
    all.truncate(MAX_FRAGMENTS);
    let mut kept: Vec<Fragment> = all.into_iter().map(|(fragment, _)| fragment).collect();
    let kept_total: Vec3A = kept.iter().map(|fragment| Vec3A::from(fragment.albedo)).sum();
    for channel in 0..3 {
        if kept_total[channel] > 0.0 {
            let scale = total[channel] / kept_total[channel];
            kept.iter_mut().for_each(|fragment| fragment.albedo[channel] *= scale);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Surface;

    fn seen(triangle: u32, albedo: f32) -> Option<Surface> {
        let normal = Vec3A::Y;
        let albedo = Vec3A::new(albedo, 0.5 * albedo, 0.0);
        Some(Surface { triangle, position: Vec3A::ZERO, normal_flat: normal, normal, albedo })
    }

    #[test]
    fn shares_strata_and_reflectance() {
        let mut pixel = vec![None; 16];
        pixel[0] = seen(7, 0.8);
        pixel[5] = seen(7, 0.4);
        pixel[15] = seen(3, 1.0);
        let got = fragments(&pixel);
        assert_eq!((got.len(), got[0].triangle, got[0].strata), (2, 7, 1 | 1 << 5));
        assert!((got[0].albedo[0] - 1.2 / 16.0).abs() < 1e-6);
        assert_eq!((got[1].triangle, got[1].strata), (3, 1 << 15));
    }

    #[test]
    fn too_many_keep_their_energy() {
        let mut pixel: Vec<_> = (0..16).map(|k| seen(k, 0.1 * k as f32)).collect();
        pixel[1] = seen(0, 0.1);
        let all: f32 = pixel.iter().flatten().map(|s| s.albedo.x).sum::<f32>() / 16.0;
        let got = fragments(&pixel);
        assert_eq!((got.len(), got[0].triangle), (MAX_FRAGMENTS, 0));
        assert!((got.iter().map(|f| f.albedo[0]).sum::<f32>() - all).abs() < 1e-6);
    }
}
