//! Gloss: the metallic-roughness reflection of glTF 2.0 (appendix B), in the bake and, for the sun, on the board.
//!
//! ```text
//! GLST  u32 per tile and one more: where the tile's records begin in GLSS, in records
//! GLSS  16 bytes per fragment, in the order of FRAG (sunlight.rs)
//!    0 i16[3] bend: what a normal map adds to the interpolated normal before it is made unit again, in 1/16384
//!    6 u16 alpha = roughness^2, in 1/65535     8 u16[3] reflectance at normal incidence R G B, in 1/65535
//!   14 u8 the same of the coat over the diffuse base, 255 sqrt     15 u8 reflectance at grazing incidence, in 1/255
//! ```
//! A field without the two layers is Lambert: its fragments' albedo is all that they reflect. With them the albedo is the
//! diffuse base's, which shines through what the coat does not reflect.

use crate::field::FieldError;
use crate::header::{u16_at, u32_at};
use crate::vector::{Vec3, add, cross, dot, mul, sub, unit};

/// Length of a record, bytes.
pub const GLOSS: usize = 16;
/// Smallest alpha: a roughness of 0.045. What is smoother cannot be told from it, as wide as the sun's disc is.
pub const SMOOTHEST: f32 = 0.002;

/// Reflection lobe of a point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Width parameter of the microfacet distribution: roughness squared, at least [`SMOOTHEST`].
    pub alpha: f32,
    /// Reflectance at normal incidence, of metal and dielectric coat together.
    pub f0: [f32; 3],
    /// Reflectance at grazing incidence.
    pub f90: f32,
    /// Reflectance at normal incidence of the dielectric coat alone: the largest channel.
    pub coat_f0: f32,
    /// Reflectance at grazing incidence of the dielectric coat alone.
    pub coat_f90: f32,
}

/// What a lobe does with light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflected {
    /// Share of light that reaches the diffuse base.
    pub base: f32,
    /// The microfacets' reflection, 1/sr: radiance per irradiance on a plane normal to the shading normal.
    pub specular: [f32; 3],
}

impl Lobe {
    /// Reflection from the unit direction `light` to the unit direction `view` (both away from the surface) about the unit
    /// normal `normal`: glTF 2.0, appendix B.3, with Schlick's Fresnel term and the height-correlated Smith term.
    #[inline]
    pub fn reflected(&self, normal: Vec3, view: Vec3, light: Vec3) -> Reflected {
        let half = unit(add(view, light));
        let weight = schlick_weight(dot(view, half));
        let base = 1.0 - (self.coat_f0 + (self.coat_f90 - self.coat_f0) * weight);
        let (n_v, n_l) = (dot(normal, view), dot(normal, light));
        if n_v <= 0.0 || n_l <= 0.0 {
            return Reflected { base, specular: [0.0; 3] };
        }
        let facets = distribution(self.alpha, normal, half) * visibility(self.alpha, n_v, n_l);
        let specular = self.f0.map(|f0| facets * (f0 + (self.f90 - f0) * weight));
        Reflected { base, specular }
    }

    /// Density (1/sr), towards `light`, of the reflection of `view` by a visible microfacet drawn at random (Heitz 2018).
    #[inline]
    pub fn density(&self, normal: Vec3, view: Vec3, light: Vec3) -> f32 {
        let n_v = dot(normal, view);
        if n_v <= 0.0 || dot(normal, light) <= 0.0 {
            return 0.0;
        }
        let half = unit(add(view, light));
        // G1 D / (4 N.V), with G1 = 2 N.V / (N.V + root).
        distribution(self.alpha, normal, half) * 0.5 / (n_v + root(self.alpha, n_v))
    }
}

/// Schlick's (1 - V.H)^5.
#[inline]
pub fn schlick_weight(v_h: f32) -> f32 {
    let left = 1.0 - v_h.abs().min(1.0);
    let squared = left * left;
    squared * squared * left
}

/// Trowbridge and Reitz's distribution, 1/sr. By the sine of the half angle, which keeps its digits where the cosine's are 1.
#[inline]
fn distribution(alpha: f32, normal: Vec3, half: Vec3) -> f32 {
    let across = cross(normal, half);
    let cosine = dot(normal, half);
    if cosine <= 0.0 {
        return 0.0;
    }
    let wide = alpha * alpha * cosine * cosine + dot(across, across);
    let ratio = alpha / wide;
    ratio * ratio * core::f32::consts::FRAC_1_PI
}

/// The root in Smith's term for one direction: `sqrt(alpha^2 + (1 - alpha^2) cosine^2)`.
#[inline]
pub fn root(alpha: f32, cosine: f32) -> f32 {
    let a2 = alpha * alpha;
    libm::sqrtf(a2 + (1.0 - a2) * cosine * cosine)
}

/// Height-correlated masking and shadowing over 4 N.L N.V.
#[inline]
fn visibility(alpha: f32, n_v: f32, n_l: f32) -> f32 {
    0.5 / (n_v * root(alpha, n_l) + n_l * root(alpha, n_v))
}

/// The shading normal for reflection: `normal`, unless the mirror direction of `view` about it lies below the surface with the
/// unit normal `flat`; then the nearest one whose mirror direction grazes it (Keller et al., *The Iray Light Transport
/// Simulation and Rendering System*, 2017, A.3). All unit, `flat` on the viewer's side.
#[inline]
pub fn reflecting_normal(view: Vec3, flat: Vec3, normal: Vec3) -> Vec3 {
    let mirrored = sub(mul(normal, 2.0 * dot(normal, view)), view);
    let height = dot(flat, mirrored);
    if height >= 0.0 {
        return normal;
    }
    let upright = dot(normal, flat).max(1e-3);
    unit(add(view, unit(sub(mirrored, mul(normal, height / upright)))))
}

/// What the board knows about the gloss of one fragment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// What the normal map adds to the interpolated normal.
    pub bend: [f32; 3],
    /// The mean lobe.
    pub lobe: Lobe,
}

impl Gloss {
    /// The record's bytes.
    pub fn encode(&self) -> [u8; GLOSS] {
        let mut bytes = [0; GLOSS];
        let unsigned = |value: f32, top: f32| libm::rintf(value.clamp(0.0, 1.0) * top);
        for (c, bend) in self.bend.iter().enumerate() {
            let code = libm::rintf(bend * BEND_UNITS).clamp(-32767.0, 32767.0) as i16;
            bytes[2 * c..2 * c + 2].copy_from_slice(&code.to_le_bytes());
        }
        let wide = core::iter::once(&self.lobe.alpha).chain(&self.lobe.f0);
        for (k, value) in wide.enumerate() {
            bytes[6 + 2 * k..8 + 2 * k].copy_from_slice(&(unsigned(*value, 65535.0) as u16).to_le_bytes());
        }
        bytes[14] = unsigned(libm::sqrtf(self.lobe.coat_f0.max(0.0)), 255.0) as u8;
        bytes[15] = unsigned(self.lobe.f90, 255.0) as u8;
        bytes
    }

    /// The record of at least [`GLOSS`] bytes.
    pub(crate) fn decode(bytes: &[u8]) -> Self {
        let wide = |at: usize| f32::from(u16_at(bytes, at)) / 65535.0;
        let coat = f32::from(bytes[14]) / 255.0;
        let f90 = f32::from(bytes[15]) / 255.0;
        Gloss {
            bend: [0, 2, 4].map(|at| f32::from(u16_at(bytes, at) as i16) / BEND_UNITS),
            lobe: Lobe {
                alpha: wide(6).max(SMOOTHEST),
                f0: [wide(8), wide(10), wide(12)],
                f90,
                coat_f0: coat * coat,
                coat_f90: f90,
            },
        }
    }
}

const BEND_UNITS: f32 = 16384.0;

/// Checked GLST and GLSS.
#[derive(Clone, Copy, Debug)]
pub struct GlossLayer<'a> {
    places: &'a [u8],
    records: &'a [u8],
}

impl<'a> GlossLayer<'a> {
    /// `fragments` tells the number of fragments of each tile.
    pub(crate) fn check(
        places: &'a [u8],
        records: &'a [u8],
        tiles: usize,
        fragments: impl Fn(usize) -> usize,
    ) -> Result<Self, FieldError> {
        let bad = FieldError::Invalid("gloss");
        if places.len() != (tiles + 1) * 4 || !records.len().is_multiple_of(GLOSS) {
            return Err(FieldError::Invalid("length of a gloss layer"));
        }
        let layer = GlossLayer { places, records };
        for tile in 0..tiles {
            let (from, to) = layer.range(tile);
            if from > to || to > records.len() / GLOSS || to - from != fragments(tile) {
                return Err(bad);
            }
        }
        Ok(layer)
    }

    fn range(&self, tile: usize) -> (usize, usize) {
        (u32_at(self.places, tile * 4) as usize, u32_at(self.places, tile * 4 + 4) as usize)
    }

    /// A tile's records, as many as it has fragments.
    pub(crate) fn tile(&self, tile: usize) -> &'a [u8] {
        let (from, to) = self.range(tile);
        &self.records[from * GLOSS..to * GLOSS]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dielectric(alpha: f32) -> Lobe {
        Lobe { alpha, f0: [0.04; 3], f90: 1.0, coat_f0: 0.04, coat_f90: 1.0 }
    }

    #[test]
    fn a_record_keeps_its_lobe() {
        let lobe = Lobe { alpha: 0.09, f0: [0.95, 0.64, 0.54], f90: 1.0, coat_f0: 0.04, coat_f90: 1.0 };
        let gloss = Gloss { bend: [0.3, -0.9, 0.001], lobe };
        let found = Gloss::decode(&gloss.encode());
        assert!((0..3).all(|c| (found.bend[c] - gloss.bend[c]).abs() < 1e-4));
        assert!((0..3).all(|c| (found.lobe.f0[c] - lobe.f0[c]).abs() < 1e-5));
        assert!((found.lobe.coat_f0 - 0.04).abs() < 1e-7 && found.lobe.f90 == 1.0);
        assert!((found.lobe.alpha - 0.09).abs() < 1e-5);
        assert_eq!(Gloss::decode(&[0; GLOSS]).lobe.alpha, SMOOTHEST);
    }

    #[test]
    fn reflection_is_the_same_both_ways() {
        let normal = [0.0, 1.0, 0.0];
        for k in 0..200u32 {
            let share = |m: u32| (k.wrapping_mul(m) % 1013) as f32 / 1012.0 - 0.5;
            let (a, b) = (unit([share(7), 0.6, share(11)]), unit([share(13), 0.3, share(17)]));
            let lobe = dielectric(0.05 + 0.9 * (share(19) + 0.5));
            let (there, back) = (lobe.reflected(normal, a, b), lobe.reflected(normal, b, a));
            assert!((there.base - back.base).abs() < 1e-6, "{there:?} {back:?}");
            assert!((there.specular[0] / back.specular[0] - 1.0).abs() < 1e-4, "{there:?} {back:?}");
        }
    }

    #[test]
    fn a_reflecting_normal_mirrors_above_the_surface() {
        let flat = [0.0, 1.0, 0.0];
        let mut bent = 0;
        for k in 0..500u32 {
            let share = |m: u32| (k.wrapping_mul(m) % 1013) as f32 / 1012.0 - 0.5;
            let view = unit([share(7), 0.52 + share(11), share(13)]);
            let normal = unit([2.0 * share(17), 0.55 + share(19), 2.0 * share(23)]);
            let found = reflecting_normal(view, flat, normal);
            let mirrored = sub(mul(found, 2.0 * dot(found, view)), view);
            assert!(dot(mirrored, flat) > -1e-5 && dot(found, view) > 0.0, "{view:?} {normal:?} {found:?}");
            bent += usize::from(found != normal);
        }
        assert!((20..480).contains(&bent), "{bent}");
    }

    #[test]
    fn layers_that_contradict_the_fragments_are_refused() {
        let places: [u8; 12] = [0, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0];
        let records = [0u8; 3 * GLOSS];
        let of = |tile: usize| [2, 1][tile];
        assert!(GlossLayer::check(&places, &records, 2, of).is_ok());
        assert!(GlossLayer::check(&places, &records, 2, |_| 1).is_err());
        assert!(GlossLayer::check(&places, &records[..32], 2, of).is_err());
        assert!(GlossLayer::check(&places[..8], &records, 2, of).is_err());
        let backwards: [u8; 12] = [2, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0];
        assert!(GlossLayer::check(&backwards, &records, 2, of).is_err());
    }
}
