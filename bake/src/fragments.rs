//! Which triangles a pixel sees, and how much light each sends it: what the live sun needs to know.

use glam::Vec3A;

use crate::response::Seen;

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

/// The fragments of a pixel, largest first.
pub(crate) fn fragments(seen: &Seen) -> Vec<Fragment> {
    let share = 1.0 / seen.len() as f32;
    let mut all: Vec<(Fragment, u32)> = Vec::new();
    for (sample, surface) in seen.iter().enumerate() {
        let Some(surface) = surface else { continue };
        let strata = 1u16 << sample;
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
    all.into_iter().map(|(fragment, _)| fragment).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Cone, Surface};

    fn seen(triangle: u32, albedo: f32) -> Option<Surface> {
        let normal = Vec3A::Y;
        let albedo = Vec3A::new(albedo, 0.5 * albedo, 0.0);
        Some(Surface { triangle, position: Vec3A::ZERO, normal_flat: normal, normal, albedo, gloss: None, cone: Cone::default() })
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
}
