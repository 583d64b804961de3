//! The reflection lobe of a surface: sampling by visible microfacets, how bright it is in all, and the weights that share its
//! light between rays aimed at patches and paths that follow the lobe.

use std::sync::LazyLock;

use glam::{Vec2, Vec3A};
use relume_firmware::gloss::{Lobe, Reflected, root, schlick_weight};

use crate::strata::{cosine_direction, frame};

/// Lobes narrower than this (alpha; roughness 0.55) are looked for in two ways. A wider one changes so little over a patch
/// that aimed rays alone find it with less noise.
const NARROW: f32 = 0.3;
/// Smallest and largest share of paths that follow a narrow lobe over a diffuse base.
const FEWEST: f32 = 0.1;

/// The lobe of one point of a surface as seen from one direction.
#[derive(Clone, Copy, Debug)]
pub struct Gloss {
    /// The material there.
    pub lobe: Lobe,
    /// Unit, towards the viewer.
    pub view: Vec3A,
    /// Unit normal of the microfacets: the shading normal, bent until its mirror direction lies above the surface.
    pub normal: Vec3A,
    /// What the normal map adds to the interpolated normal.
    pub bend: Vec3A,
    /// Share of a surface's paths that follow the lobe; the others start from the diffuse base.
    pub share: f32,
    /// Linear RGB: all that the surface reflects of even light, diffuse base and lobe.
    pub reflectance: Vec3A,
}

/// A direction drawn from a lobe or from the base under it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn {
    pub(crate) dir_world: Vec3A,
    /// Reflection times cosine over density.
    pub(crate) weight: Vec3A,
    /// Drawn from the lobe?
    pub(crate) specular: bool,
}

impl Gloss {
    /// The lobe over a diffuse base of reflectance `albedo`.
    pub(crate) fn new(lobe: Lobe, albedo: Vec3A, view: Vec3A, normal: Vec3A, bend: Vec3A) -> Self {
        let mean = Means::of(&lobe, normal.dot(view));
        let (base, specular) = (albedo * mean.base, mean.specular);
        let (dim, bright) = (base.element_sum(), specular.element_sum());
        let mut share = if bright > 0.0 { bright / (dim + bright) } else { 0.0 };
        if lobe.alpha < NARROW && dim > 0.0 && bright > 0.0 {
            share = share.clamp(FEWEST, 1.0 - FEWEST);
        }
        Gloss { lobe, view, normal, bend, share, reflectance: base + specular }
    }

    /// What becomes of light from `dir_world`.
    #[inline]
    pub(crate) fn reflected(&self, dir_world: Vec3A) -> Reflected {
        self.lobe.reflected(self.normal.to_array(), self.view.to_array(), dir_world.to_array())
    }

    /// Pi times the radiance that is sent on of radiance 1 from `dir_world`, over 1 sr: all of the diffuse base's, which is
    /// `base` under no coat, and `part` of the lobe's.
    #[inline]
    pub(crate) fn sent_on(&self, base: Vec3A, dir_world: Vec3A, part: f32) -> Vec3A {
        let reflected = self.reflected(dir_world);
        let cosine = self.normal.dot(dir_world).max(0.0);
        base * reflected.base + Vec3A::from(reflected.specular) * (std::f32::consts::PI * cosine * part)
    }

    /// Is the lobe's light looked for by paths that follow it, too?
    #[inline]
    pub(crate) fn is_narrow(&self) -> bool {
        self.lobe.alpha < NARROW
    }

    /// The part of the lobe's light from `dir_world` that aimed rays of the density `aimed` (1/sr) bring, when `paths` paths
    /// start from here; the others bring the rest (Veach & Guibas 1995, the power heuristic).
    #[inline]
    pub(crate) fn aimed_part(&self, dir_world: Vec3A, aimed: f32, paths: f32) -> f32 {
        if !self.is_narrow() {
            return 1.0;
        }
        let density = self.lobe.density(self.normal.to_array(), self.view.to_array(), dir_world.to_array());
        let ratio = paths * self.share * density / aimed;
        1.0 / (1.0 + ratio * ratio)
    }

    /// Draws a direction at the point `at` of the unit square: from the lobe, or by the cosine about `normal` from the base of
    /// reflectance `albedo`. It may lie below the surface.
    pub(crate) fn draw(&self, normal: Vec3A, albedo: Vec3A, at: Vec2) -> Drawn {
        if at.x < self.share {
            let at = Vec2::new(at.x / self.share, at.y);
            let dir_world = self.draw_from_lobe(at);
            return Drawn { dir_world, weight: self.lobe_weight(dir_world) / self.share, specular: true };
        }
        let rest = 1.0 - self.share;
        let at = Vec2::new(((at.x - self.share) / rest).min(1.0), at.y);
        let dir_world = cosine_direction(normal, at);
        Drawn { dir_world, weight: albedo * (self.reflected(dir_world).base / rest), specular: false }
    }

    /// The mirror direction about a visible microfacet (Dupuy & Benyoub, *Sampling Visible GGX Normals with Spherical Caps*,
    /// 2023).
    fn draw_from_lobe(&self, at: Vec2) -> Vec3A {
        let (tangent, bitangent) = frame(self.normal);
        let alpha = self.lobe.alpha;
        let local = Vec3A::new(tangent.dot(self.view), bitangent.dot(self.view), self.normal.dot(self.view));
        let stretched = (local * Vec3A::new(alpha, alpha, 1.0)).normalize_or(Vec3A::Z);
        let height = (1.0 - at.y) * (1.0 + stretched.z) - stretched.z;
        let radius = (1.0 - height * height).max(0.0).sqrt();
        let (sin, cos) = (std::f32::consts::TAU * at.x).sin_cos();
        let half = Vec3A::new(radius * cos, radius * sin, height) + stretched;
        let half = (half * Vec3A::new(alpha, alpha, 1.0)).normalize_or(Vec3A::Z);
        let half = tangent * half.x + bitangent * half.y + self.normal * half.z;
        (half * (2.0 * half.dot(self.view)) - self.view).normalize_or(self.normal)
    }

    /// Reflection times cosine over density of a direction drawn from the lobe: Fresnel's term times G2 / G1.
    fn lobe_weight(&self, dir_world: Vec3A) -> Vec3A {
        let (n_v, n_l) = (self.normal.dot(self.view), self.normal.dot(dir_world));
        if n_l <= 0.0 || n_v <= 0.0 {
            return Vec3A::ZERO;
        }
        let weight = schlick_weight(self.view.dot((self.view + dir_world).normalize_or(self.normal)));
        let fresnel = Vec3A::from(self.lobe.f0) * (1.0 - weight) + self.lobe.f90 * weight;
        fresnel * passed(self.lobe.alpha, n_v, n_l)
    }
}

/// G2 / G1: the share of the light off visible microfacets that is not shadowed by others.
fn passed(alpha: f32, n_v: f32, n_l: f32) -> f32 {
    let (root_v, root_l) = (root(alpha, n_v), root(alpha, n_l));
    n_l * (n_v + root_v) / (n_v * root_l + n_l * root_v)
}

/// Mean reflection under even light.
struct Means {
    /// Share of light that reaches the base and leaves it.
    base: f32,
    specular: Vec3A,
}

/// Steps of the tables: along the cosine of the view, and along the root of alpha.
const STEPS: usize = 32;

impl Means {
    fn of(lobe: &Lobe, n_v: f32) -> Self {
        let along_v = n_v.clamp(0.0, 1.0) * (STEPS - 1) as f32;
        let along_a = lobe.alpha.clamp(0.0, 1.0).sqrt() * (STEPS - 1) as f32;
        let (v, a) = ((along_v as usize).min(STEPS - 2), (along_a as usize).min(STEPS - 2));
        let (part_v, part_a) = (along_v - v as f32, along_a - a as f32);
        let cell = |a: usize, v: usize| TABLE.lobe[a * STEPS + v];
        let row = |a: usize| cell(a, v).lerp(cell(a, v + 1), part_v);
        let [whole, grazing] = row(a).lerp(row(a + 1), part_a).to_array();
        let weight = TABLE.base[v] + (TABLE.base[v + 1] - TABLE.base[v]) * part_v;
        Means {
            base: 1.0 - (lobe.coat_f0 + (lobe.coat_f90 - lobe.coat_f0) * weight),
            specular: Vec3A::from(lobe.f0) * (whole - grazing) + lobe.f90 * grazing,
        }
    }
}

struct Table {
    /// `[alpha][n_v]`: mean of G2 / G1, and of it times Schlick's weight.
    lobe: Vec<Vec2>,
    /// `[n_v]`: mean of Schlick's weight over the cosine's directions.
    base: Vec<f32>,
}

static TABLE: LazyLock<Table> = LazyLock::new(|| {
    let share = |k: usize| k as f32 / (STEPS - 1) as f32;
    let lobe = (0..STEPS * STEPS).map(|k| mean_of_lobe(share(k / STEPS).powi(2), share(k % STEPS)));
    Table { lobe: lobe.collect(), base: (0..STEPS).map(|v| mean_of_base(share(v))).collect() }
});

/// Points of the unit square for the tables, per side.
const SIDE: usize = 32;

fn over_the_square() -> impl Iterator<Item = Vec2> {
    (0..SIDE * SIDE).map(|k| (Vec2::new((k % SIDE) as f32, (k / SIDE) as f32) + 0.5) / SIDE as f32)
}

fn mean_of_lobe(alpha: f32, n_v: f32) -> Vec2 {
    let alpha = alpha.max(relume_firmware::gloss::SMOOTHEST);
    let n_v = n_v.max(1e-3);
    let view = Vec3A::new((1.0 - n_v * n_v).sqrt(), 0.0, n_v);
    let white = Lobe { alpha, f0: [1.0; 3], f90: 1.0, coat_f0: 0.0, coat_f90: 0.0 };
    let gloss = Gloss { lobe: white, view, normal: Vec3A::Z, bend: Vec3A::ZERO, share: 1.0, reflectance: Vec3A::ONE };
    let of = |at: Vec2| {
        let light = gloss.draw_from_lobe(at);
        let passed = gloss.lobe_weight(light).x;
        Vec2::new(passed, passed * schlick_weight(view.dot((view + light).normalize_or(Vec3A::Z))))
    };
    over_the_square().map(of).sum::<Vec2>() / (SIDE * SIDE) as f32
}

fn mean_of_base(n_v: f32) -> f32 {
    let view = Vec3A::new((1.0 - n_v * n_v).max(0.0).sqrt(), 0.0, n_v);
    let of = |at: Vec2| schlick_weight(view.dot((view + cosine_direction(Vec3A::Z, at)).normalize_or(Vec3A::Z)));
    over_the_square().map(of).sum::<f32>() / (SIDE * SIDE) as f32
}

#[cfg(test)]
mod tests;
