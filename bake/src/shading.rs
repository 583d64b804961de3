//! A point of a surface under [`Shading::Gltf`](crate::material::Shading): its material's textures, averaged over what the ray
//! stands for, and the lobe that they make.

use glam::{Vec2, Vec3, Vec3A, Vec4};
use relume_firmware::gloss::{Lobe, SMOOTHEST, reflecting_normal};

use crate::geometry::Surface;
use crate::gloss::Gloss;
use crate::material::{Finish, Material};
use crate::scene::{Detail, Scene, Triangle};

/// A place on a triangle.
pub(crate) struct Texturing<'s> {
    pub(crate) scene: &'s Scene,
    pub(crate) triangle: usize,
    /// Weights of the corners.
    pub(crate) weights: Vec3,
}

/// Sets albedo, normal and gloss of `surface`, which is looked at from `view` (unit, away from it).
pub(crate) fn gloss_at(at: &Texturing<'_>, view: Vec3A, surface: &mut Surface) {
    let triangle = &at.scene.triangles[at.triangle];
    let Some(material) = at.scene.materials.get(triangle.material as usize) else { return };
    let finish = &material.finish;
    let detail = at.scene.details.get(at.triangle);
    let base = Vec3A::from(at.base_color(material, triangle, surface.cone.width).truncate());
    let (metallic, roughness) = at.metallic_roughness(finish, detail, surface.cone.width);
    let mut alpha2 = roughness.powi(4);
    let mut bend = Vec3A::ZERO;
    if let Some((mapped, more)) = at.mapped_normal(finish, detail, surface) {
        bend = mapped - surface.normal;
        surface.normal = mapped;
        alpha2 += more;
    }
    let coat_f0 = Vec3A::from(finish.coat_f0);
    let lobe = Lobe {
        alpha: alpha2.sqrt().clamp(SMOOTHEST, 1.0),
        f0: coat_f0.lerp(base, metallic).to_array(),
        f90: finish.coat_f90 + (1.0 - finish.coat_f90) * metallic,
        coat_f0: coat_f0.max_element(),
        coat_f90: finish.coat_f90,
    };
    surface.albedo = base * (1.0 - metallic);
    let flat = surface.normal_flat.to_array();
    let normal = Vec3A::from(reflecting_normal(view.to_array(), flat, surface.normal.to_array()));
    surface.gloss = Some(Gloss::new(lobe, surface.albedo, view, normal, bend));
}

impl Texturing<'_> {
    fn mixed(&self, corners: [Vec2; 3]) -> Vec2 {
        corners[0] * self.weights.x + corners[1] * self.weights.y + corners[2] * self.weights.z
    }

    /// Mipmap level of a picture of `size` texels with the coordinates `uvs`, for a ray `width` m wide.
    fn lod(&self, uvs: [Vec2; 3], size: (usize, usize), width: f32) -> f32 {
        let [a, b, c] = self.scene.triangles[self.triangle].positions;
        let area = (b - a).cross(c - a).length();
        let texels = Vec2::new(size.0 as f32, size.1 as f32);
        let [u, v] = [(uvs[1] - uvs[0]) * texels, (uvs[2] - uvs[0]) * texels];
        (width * (u.perp_dot(v).abs() / area).sqrt()).max(1e-6).log2()
    }

    fn base_color(&self, material: &Material, triangle: &Triangle, width: f32) -> Vec4 {
        let base = Vec4::from(material.base_color);
        match material.texture.and_then(|index| self.scene.textures.get(index as usize)) {
            Some(texture) => {
                let lod = self.lod(triangle.uvs, texture.size(), width);
                base * texture.sample_level(self.mixed(triangle.uvs), lod)
            }
            None => base,
        }
    }

    fn metallic_roughness(&self, finish: &Finish, detail: Option<&Detail>, width: f32) -> (f32, f32) {
        let texture = finish.texture.and_then(|index| self.scene.textures.get(index as usize));
        let Some((texture, detail)) = texture.zip(detail) else { return (finish.metallic, finish.roughness) };
        let lod = self.lod(detail.finish_uvs, texture.size(), width);
        let texel = texture.sample_level(self.mixed(detail.finish_uvs), lod);
        (finish.metallic * texel.z, finish.roughness * texel.y)
    }

    /// The normal map's normal on the viewer's side of `surface`, and what it adds to alpha^2.
    fn mapped_normal(&self, finish: &Finish, detail: Option<&Detail>, surface: &Surface) -> Option<(Vec3A, f32)> {
        let (index, scale) = finish.normal_map?;
        let (map, detail) = (self.scene.normal_maps.get(index as usize)?, detail?);
        let lod = self.lod(detail.normal_uvs, map.size(), surface.cone.width);
        let found = map.sample(self.mixed(detail.normal_uvs), lod, scale);
        let triangle = &self.scene.triangles[self.triangle];
        let [na, nb, nc] = triangle.normals;
        let front = (na * self.weights.x + nb * self.weights.y + nc * self.weights.z).try_normalize()?;
        let [ta, tb, tc] = detail.tangents;
        let along = ta * self.weights.x + tb * self.weights.y + tc * self.weights.z;
        let tangent = (along.truncate() - front * front.dot(along.truncate())).try_normalize()?;
        let bitangent = front.cross(tangent) * if along.w < 0.0 { -1.0 } else { 1.0 };
        let Vec3 { x, y, z } = found.normal;
        let mapped = Vec3A::from(tangent * x + bitangent * y + front * z);
        // Backs have their normals turned round, the map's with them.
        let side = if surface.normal.dot(front.into()) < 0.0 { -1.0 } else { 1.0 };
        Some((mapped.normalize_or(surface.normal) * side, found.alpha2))
    }
}
