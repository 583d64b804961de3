//! Which triangles a pixel sees, and how much light each sends it: what the live sun needs to know.

use glam::Vec3A;
use relume_firmware::gloss::{Gloss, Lobe};

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
    /// How it gleams, the mean over the samples; `None` for a Lambert surface.
    pub gloss: Option<Gloss>,
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
            None => {
                let albedo = albedo.to_array();
                all.push((Fragment { triangle: surface.triangle, strata, albedo, gloss: None }, 1));
            }
        }
    }
    all.sort_by_key(|(fragment, samples)| (std::cmp::Reverse(*samples), fragment.triangle));
    let with_gloss = |(mut fragment, _): (Fragment, u32)| {
        let own = |sample: &usize| fragment.strata >> sample & 1 != 0;
        let surfaces = (0..seen.len()).filter(own).filter_map(|sample| seen[sample].as_ref()?.gloss);
        fragment.gloss = mean_gloss(&surfaces.collect::<Vec<_>>());
        fragment
    };
    all.into_iter().map(with_gloss).collect()
}

/// The mean of lobes; normals that differ make it wider.
fn mean_gloss(all: &[crate::gloss::Gloss]) -> Option<Gloss> {
    let share = 1.0 / all.len() as f32;
    let mean = |of: &dyn Fn(&crate::gloss::Gloss) -> f32| all.iter().map(of).sum::<f32>() * share;
    let bend = all.iter().map(|gloss| gloss.bend).sum::<Vec3A>() * share;
    // Normals of the variance s along each of two axes widen alpha^2 by 2 s.
    let spread = mean(&|gloss| gloss.bend.distance_squared(bend));
    let alpha = (mean(&|gloss| gloss.lobe.alpha.powi(2)) + spread).sqrt().min(1.0);
    let lobe = Lobe {
        alpha,
        f0: [0, 1, 2].map(|c: usize| mean(&|gloss| gloss.lobe.f0[c])),
        f90: mean(&|gloss| gloss.lobe.f90),
        coat_f0: mean(&|gloss| gloss.lobe.coat_f0),
        coat_f90: mean(&|gloss| gloss.lobe.coat_f90),
    };
    (!all.is_empty()).then(|| Gloss { bend: bend.to_array(), lobe })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Cone, Surface};

    fn seen(triangle: u32, albedo: f32) -> Option<Surface> {
        let normal = Vec3A::Y;
        let albedo = Vec3A::new(albedo, 0.5 * albedo, 0.0);
        Some(Surface {
            triangle,
            position: Vec3A::ZERO,
            normal_flat: normal,
            normal,
            albedo,
            gloss: None,
            cone: Cone::default(),
        })
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
