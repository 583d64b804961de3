//! Ray queries against the scene: closest hit, and how much light passes along a ray.

use std::time::Duration;

use glam::{Vec2, Vec3, Vec3A, Vec4};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};

use crate::gloss::{Drawn, Gloss};
use crate::material::{Alpha, Material, Shading};
use crate::scene::Scene;
use crate::shading::{Texturing, gloss_at};
use crate::strata::hash;

/// Where a ray met the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
    /// Distance along the unit direction, m.
    pub distance: f32,
    /// Weights of the triangle's second and third corner.
    pub barycentric: Vec2,
    /// Whether the triangle's back was met (its corners run clockwise as seen by the ray).
    pub back: bool,
}

/// A point of a surface as seen by a ray that met it.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
    /// The point, lifted off the surface towards the viewer so that rays from it do not meet it again, m.
    pub position: Vec3A,
    /// Unit normal of the triangle's plane, towards the viewer.
    pub normal_flat: Vec3A,
    /// Unit shading normal, on the viewer's side of the plane.
    pub normal: Vec3A,
    /// Linear RGB reflectance, 0..1; of the diffuse base where there is gloss.
    pub albedo: Vec3A,
    /// Its reflection lobe; `None` for a Lambert surface.
    pub gloss: Option<Gloss>,
    /// The cone that the surface was seen in.
    pub cone: Cone,
}

/// What a ray stands for: textures are averaged over it (Akenine-Moller et al., *Improved Shader and Texture Level of Detail
/// Using Ray Cones*, JCGT 2021).
#[derive(Clone, Copy, Debug, Default)]
pub struct Cone {
    /// Width at the origin, m.
    pub width: f32,
    /// Opening angle, radians.
    pub spread: f32,
}

/// Opening angle of a ray that leaves a diffuse surface, radians: many of them make a picture's light.
const DIFFUSE_SPREAD: f32 = 0.1;

impl Cone {
    /// The cone of a ray that goes on from `surface`.
    pub(crate) fn on(self, surface: &Surface, drawn: &Drawn) -> Cone {
        let alpha = surface.gloss.map_or(1.0, |gloss| gloss.lobe.alpha);
        let spread = if drawn.specular { self.spread + DIFFUSE_SPREAD * alpha } else { DIFFUSE_SPREAD };
        Cone { width: self.width, spread }
    }
}

impl Surface {
    /// The cosine that `dir_world` makes with the shading normal; 0 for directions below the surface.
    #[inline]
    pub fn cosine(&self, dir_world: Vec3A) -> f32 {
        if self.normal_flat.dot(dir_world) <= 0.0 { 0.0 } else { self.normal.dot(dir_world).max(0.0) }
    }

    /// Does `dir_world` leave the surface?
    #[inline]
    pub fn is_above(&self, dir_world: Vec3A) -> bool {
        self.normal_flat.dot(dir_world) > 0.0
    }

    /// Linear RGB: all that the surface reflects of even light.
    #[inline]
    pub fn reflectance(&self) -> Vec3A {
        self.gloss.map_or(self.albedo, |gloss| gloss.reflectance)
    }
}

/// The scene prepared for ray queries; shared by all threads.
pub struct Geometry<'s> {
    scene: &'s Scene,
    bvh: CwBvh,
    /// In the order of the tree's leaves.
    leaves: Vec<obvhs::triangle::Triangle>,
    /// Same order: whether the triangle may let light through.
    see_through: Vec<bool>,
    any_see_through: bool,
    lift_scene: f32,
    centre: Vec3A,
    diagonal: f32,
}

/// Lift off a surface as a share of the largest coordinate: about 80 rounding steps of an f32, of which the
/// intersection loses up to ten.
const LIFT_COORDINATE: f32 = 1e-5;
/// Lift off a surface as a share of the scene's diagonal.
const LIFT_SCENE: f32 = 1e-6;

impl<'s> Geometry<'s> {
    /// Builds the tree. An empty scene gives geometry that no ray meets.
    pub fn new(scene: &'s Scene) -> Self {
        let corners = |t: &crate::scene::Triangle| t.positions.map(Vec3A::from);
        let triangles: Vec<obvhs::triangle::Triangle> = scene
            .triangles
            .iter()
            .map(|t| {
                let [v0, v1, v2] = corners(t);
                obvhs::triangle::Triangle { v0, v1, v2 }
            })
            .collect();
        let points = || scene.triangles.iter().flat_map(corners);
        let low = points().reduce(Vec3A::min).unwrap_or(Vec3A::ZERO);
        let high = points().reduce(Vec3A::max).unwrap_or(Vec3A::ZERO);
        // No spatial splits: a leaf visited twice would count its transparency twice.
        let params = BvhBuildParams { pre_split: false, ..BvhBuildParams::slow_build() };
        let bvh = if triangles.is_empty() {
            CwBvh::default()
        } else {
            build_cwbvh_from_tris(&triangles, params, &mut Duration::default())
        };
        let in_order = || bvh.primitive_indices.iter().map(|&index| index as usize);
        let leaves = in_order().map(|index| triangles[index]).collect();
        let may: Vec<bool> = scene.materials.iter().map(|m| may_let_light_through(scene, m)).collect();
        let see_through: Vec<bool> = in_order()
            .map(|index| may.get(scene.triangles[index].material as usize).copied().unwrap_or(false))
            .collect();
        let diagonal = (high - low).length();
        Geometry {
            scene,
            any_see_through: see_through.contains(&true),
            leaves,
            see_through,
            bvh,
            lift_scene: diagonal * LIFT_SCENE,
            centre: 0.5 * (low + high),
            diagonal,
        }
    }

    /// Length of the diagonal of the scene's bounding box, m.
    pub fn diagonal(&self) -> f32 {
        self.diagonal
    }

    /// Middle of the scene's bounding box, m.
    pub fn centre(&self) -> Vec3A {
        self.centre
    }

    /// The first surface along the ray; blended surfaces are met with the probability of their alpha, decided by
    /// `seed` and the triangle. `dir_world` is a unit vector.
    pub fn closest(&self, origin: Vec3A, dir_world: Vec3A, seed: u32) -> Option<Hit> {
        let mut hit = RayHit::none();
        let ray = ray(origin, dir_world);
        if self.any_see_through {
            self.bvh.ray_traverse(ray, &mut hit, |ray, leaf| {
                let t = self.leaves[leaf].intersect(ray);
                if t < ray.tmax && self.see_through[leaf] {
                    let opacity = self.opacity(leaf, ray.origin, ray.direction);
                    let chance = hash(seed ^ hash(leaf as u32 + 1)) as f32 * (1.0 / 4_294_967_296.0);
                    return if chance < opacity { t } else { f32::INFINITY };
                }
                t
            });
        } else {
            self.bvh.ray_traverse(ray, &mut hit, |ray, leaf| self.leaves[leaf].intersect(ray));
        }
        let leaf = hit.primitive_id as usize;
        let triangle = *self.bvh.primitive_indices.get(leaf)?;
        let (barycentric, back) = barycentric(&self.leaves[leaf], origin, dir_world);
        Some(Hit { triangle, distance: hit.t, barycentric, back })
    }

    /// The share of light, 0..1, that reaches `origin` from infinity along the unit vector `dir_world`.
    #[inline]
    pub fn transmittance(&self, origin: Vec3A, dir_world: Vec3A) -> f32 {
        let ray = ray(origin, dir_world);
        if !self.any_see_through {
            let miss = self.bvh.ray_traverse_miss(ray, |ray, leaf| self.leaves[leaf].intersect(ray));
            return if miss { 1.0 } else { 0.0 };
        }
        let mut passed = 1.0;
        self.bvh.ray_traverse_miss(ray, |ray, leaf| {
            let t = self.leaves[leaf].intersect(ray);
            if t < ray.tmax {
                passed *= if self.see_through[leaf] { 1.0 - self.opacity(leaf, origin, dir_world) } else { 0.0 };
                if passed > 0.0 {
                    return f32::INFINITY;
                }
            }
            t
        });
        passed
    }

    /// The surface at a hit of a ray along the unit vector `dir_world`, seen in `cone`.
    pub fn surface(&self, hit: &Hit, dir_world: Vec3A, cone: Cone) -> Surface {
        let triangle = &self.scene.triangles[hit.triangle as usize];
        let [a, b, c] = triangle.positions.map(Vec3A::from);
        let weights = Vec3::new(1.0 - hit.barycentric.x - hit.barycentric.y, hit.barycentric.x, hit.barycentric.y);
        let point = a * weights.x + b * weights.y + c * weights.z;
        let flat = (b - a).cross(c - a).normalize_or_zero();
        let normal_flat = if flat.dot(dir_world) > 0.0 { -flat } else { flat };
        let [na, nb, nc] = triangle.normals.map(Vec3A::from);
        let smooth = (na * weights.x + nb * weights.y + nc * weights.z).try_normalize().unwrap_or(normal_flat);
        let normal = if smooth.dot(normal_flat) < 0.0 { -smooth } else { smooth };
        let lift = self.lift(point);
        let cone = Cone { width: cone.width + cone.spread * hit.distance, ..cone };
        let mut surface = Surface {
            triangle: hit.triangle,
            position: point + normal_flat * lift,
            normal_flat,
            normal,
            albedo: Vec3A::ZERO,
            gloss: None,
            cone,
        };
        match self.scene.shading {
            Shading::Lambert => surface.albedo = self.color(hit.triangle, weights).truncate().into(),
            Shading::Gltf => {
                let texturing = Texturing { scene: self.scene, triangle: hit.triangle as usize, weights };
                gloss_at(&texturing, -dir_world, &mut surface);
            }
        }
        surface
    }

    /// How far a point of a surface is lifted off it, m.
    pub fn lift(&self, point: Vec3A) -> f32 {
        point.abs().max_element() * LIFT_COORDINATE + self.lift_scene
    }

    fn opacity(&self, leaf: usize, origin: Vec3A, dir_world: Vec3A) -> f32 {
        let (at, _) = barycentric(&self.leaves[leaf], origin, dir_world);
        let triangle = self.bvh.primitive_indices[leaf];
        let alpha = self.color(triangle, Vec3::new(1.0 - at.x - at.y, at.x, at.y)).w;
        match self.scene.materials[self.scene.triangles[triangle as usize].material as usize].alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask { cutoff } => f32::from(alpha >= cutoff),
            Alpha::Blend => alpha,
        }
    }

    /// Linear base colour of the material where it was hit.
    pub fn base_color(&self, hit: &Hit) -> Vec3A {
        let [u, v] = hit.barycentric.to_array();
        self.color(hit.triangle, Vec3::new(1.0 - u - v, u, v)).truncate().into()
    }

    /// Linear colour and alpha of the material at a point of a triangle.
    fn color(&self, triangle: u32, weights: Vec3) -> Vec4 {
        let triangle = &self.scene.triangles[triangle as usize];
        let Some(material) = self.scene.materials.get(triangle.material as usize) else { return Vec4::ONE };
        color_at(self.scene, material, triangle.uvs, weights)
    }
}

/// Linear colour and alpha of `material` at the corner weights `weights` of a triangle with coordinates `uvs`.
pub(crate) fn color_at(scene: &Scene, material: &Material, uvs: [Vec2; 3], weights: Vec3) -> Vec4 {
    let base = Vec4::from(material.base_color);
    match material.texture.and_then(|index| scene.textures.get(index as usize)) {
        Some(texture) => base * texture.sample(uvs[0] * weights.x + uvs[1] * weights.y + uvs[2] * weights.z),
        None => base,
    }
}

/// Whether any point of `material` can have an opacity below 1.
pub(crate) fn may_let_light_through(scene: &Scene, material: &Material) -> bool {
    let texture = material.texture.and_then(|index| scene.textures.get(index as usize));
    let lowest = material.base_color[3] * texture.map_or(1.0, |t| t.alpha_range().0);
    match material.alpha {
        Alpha::Opaque => false,
        Alpha::Mask { cutoff } => lowest < cutoff,
        Alpha::Blend => lowest < 1.0,
    }
}

/// A negative zero would send the traversal to the wrong side of the tree; adding zero makes it a positive one.
fn ray(origin: Vec3A, dir_world: Vec3A) -> Ray {
    Ray::new_inf(origin, dir_world + Vec3A::ZERO)
}

/// Weights of the second and third corner where the ray meets the triangle's plane, and whether it meets the back.
fn barycentric(triangle: &obvhs::triangle::Triangle, origin: Vec3A, dir_world: Vec3A) -> (Vec2, bool) {
    let (edge1, edge2) = (triangle.v1 - triangle.v0, triangle.v2 - triangle.v0);
    let normal = edge1.cross(edge2);
    let facing = normal.dot(dir_world);
    let across = dir_world.cross(triangle.v0 - origin);
    let at = Vec2::new(-across.dot(edge2), across.dot(edge1)) / facing;
    let at = if at.is_finite() { at.clamp(Vec2::ZERO, Vec2::ONE) } else { Vec2::splat(1.0 / 3.0) };
    (at, facing > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::tests::{floor, quads};

    #[test]
    fn negative_zeros_in_a_direction_meet_what_positive_ones_do() {
        let (scene, origin) = (quads(&[(floor(3.0, -2.0), 0.5)]), Vec3A::new(0.3, 0.0, 0.7));
        let geometry = Geometry::new(&scene);
        for dir_world in [Vec3A::new(0.0, -1.0, 0.0), Vec3A::new(-0.0, -1.0, -0.0), -Vec3A::Y] {
            let hit = geometry.closest(origin, dir_world, 0);
            assert_eq!(hit.map(|hit| hit.distance), Some(2.0), "{dir_world:?}");
            assert_eq!(geometry.transmittance(origin, dir_world), 0.0, "{dir_world:?}");
        }
    }
}
