//! glTF materials -> [`Material`]s, their textures, and what of them is left out.

use std::collections::BTreeMap;

use super::{Loader, SceneError};
use crate::material::{Alpha, DIELECTRIC_F0, Finish, Material, Shading};
use crate::texture::{Encoding, UvTransform};

/// Which texture coordinates a texture uses, and how.
#[derive(Clone, Copy, Default)]
pub(super) struct UvUse {
    pub(super) set: u32,
    pub(super) transform: UvTransform,
}

/// The coordinates of a material's textures.
#[derive(Clone, Copy, Default)]
pub(super) struct UvUses {
    pub(super) base: UvUse,
    pub(super) finish: Option<UvUse>,
    pub(super) normal: Option<UvUse>,
}

/// Parts of materials beyond metallic-roughness, and what is shown instead.
const LEFT_OUT: [(&str, &str); 9] = [
    ("KHR_materials_anisotropy", "its gloss is the same all around"),
    ("KHR_materials_clearcoat", "it has no coat"),
    ("KHR_materials_dispersion", "no light is dispersed"),
    ("KHR_materials_iridescence", "its gloss has no colours of its own"),
    ("KHR_materials_pbrSpecularGlossiness", "its metallic-roughness values are used, if it has any"),
    ("KHR_materials_sheen", "it has no sheen"),
    ("KHR_materials_transmission", "no light goes through"),
    ("KHR_materials_unlit", "it is lit like any other"),
    ("KHR_materials_volume", "it is a surface only"),
];

/// Indices of the textures that have been read, by number in the file and use.
#[derive(Default)]
struct Known {
    textures: BTreeMap<(usize, Encoding), u32>,
    normal_maps: BTreeMap<usize, u32>,
}

impl Loader<'_> {
    pub(super) fn materials(&mut self) -> Result<(), SceneError> {
        let mut known = Known::default();
        for material in self.file.document.materials() {
            let mut uses = UvUses::default();
            let pbr = material.pbr_metallic_roughness();
            let mut texture = None;
            if let Some(info) = pbr.base_color_texture() {
                uses.base = used(&info);
                texture = Some(self.texture(&mut known, &info.texture(), Encoding::Srgb)?);
            }
            let finish = match self.shading {
                Shading::Lambert => Finish::default(),
                Shading::Gltf => self.finish(&mut known, &material, &mut uses)?,
            };
            self.scene.materials.push(Material {
                name: material.name().unwrap_or("").to_owned(),
                base_color: pbr.base_color_factor().map(|v| unit(v, 1.0)),
                texture,
                alpha: match material.alpha_mode() {
                    gltf::material::AlphaMode::Opaque => Alpha::Opaque,
                    gltf::material::AlphaMode::Mask => Alpha::Mask { cutoff: material.alpha_cutoff().unwrap_or(0.5) },
                    gltf::material::AlphaMode::Blend => Alpha::Blend,
                },
                finish,
            });
            self.uses.push(uses);
            self.note(&material);
        }
        // glTF's default material, for primitives that name none: white metal, as rough as can be.
        let finish = match self.shading {
            Shading::Lambert => Finish::default(),
            Shading::Gltf => Finish { metallic: 1.0, ..Finish::default() },
        };
        let (name, base_color) = ("default".into(), [1.0; 4]);
        self.scene.materials.push(Material { name, base_color, texture: None, alpha: Alpha::Opaque, finish });
        self.uses.push(UvUses::default());
        Ok(())
    }

    fn finish(
        &mut self,
        known: &mut Known,
        material: &gltf::Material,
        uses: &mut UvUses,
    ) -> Result<Finish, SceneError> {
        let pbr = material.pbr_metallic_roughness();
        let mut finish = Finish {
            metallic: unit(pbr.metallic_factor(), 1.0),
            roughness: unit(pbr.roughness_factor(), 1.0),
            ..coat(material)
        };
        if let Some(info) = pbr.metallic_roughness_texture() {
            uses.finish = Some(used(&info));
            finish.texture = Some(self.texture(known, &info.texture(), Encoding::Linear)?);
        }
        if let Some(info) = material.normal_texture() {
            let transform = info.extension_value("KHR_texture_transform").map(transform_of).unwrap_or_default();
            uses.normal = Some(UvUse { set: transform.0.unwrap_or(info.tex_coord()), transform: transform.1 });
            let index = match known.normal_maps.entry(info.texture().index()) {
                std::collections::btree_map::Entry::Occupied(found) => *found.get(),
                std::collections::btree_map::Entry::Vacant(entry) => {
                    self.scene.normal_maps.push(self.file.normal_map(&info.texture())?);
                    *entry.insert(self.scene.normal_maps.len() as u32 - 1)
                }
            };
            let scale = info.scale();
            finish.normal_map = Some((index, if scale.is_finite() { scale } else { 1.0 }));
        }
        Ok(finish)
    }

    fn texture(&mut self, known: &mut Known, texture: &gltf::Texture, encoding: Encoding) -> Result<u32, SceneError> {
        let key = (texture.index(), encoding);
        if let Some(&index) = known.textures.get(&key) {
            return Ok(index);
        }
        self.scene.textures.push(self.file.texture(texture, encoding)?);
        let index = self.scene.textures.len() as u32 - 1;
        known.textures.insert(key, index);
        Ok(index)
    }

    /// Tells what of a material is left out.
    fn note(&mut self, material: &gltf::Material) {
        let name = material.name().map_or(format!("{}", material.index().unwrap_or(0)), |name| format!("'{name}'"));
        let mut left_out =
            |what: &str, instead: &str| self.notices.push(format!("material {name}: {what} is ignored: {instead}"));
        if material.emissive_factor().iter().any(|&v| v > 0.0) {
            left_out("emission", "Relume brings its own light");
        }
        if self.shading == Shading::Lambert {
            return;
        }
        let extensions = material.extensions();
        let has = |name: &str| {
            extensions.is_some_and(|own| own.contains_key(name)) || (name == "KHR_materials_unlit" && material.unlit())
        };
        for (extension, instead) in LEFT_OUT.iter().filter(|(extension, _)| has(extension)) {
            left_out(extension, instead);
        }
        let textured = |specular: &gltf::material::Specular| {
            specular.specular_texture().is_some() || specular.specular_color_texture().is_some()
        };
        if material.specular().is_some_and(|specular| textured(&specular)) {
            left_out("the picture of KHR_materials_specular", "its factors are used");
        }
    }
}

/// The dielectric coat by `KHR_materials_ior` and `KHR_materials_specular`, rough and without pictures.
fn coat(material: &gltf::Material) -> Finish {
    let from_ior = |ior: f32| ((1.0 - ior) / (1.0 + ior)).powi(2);
    // An index of 0 stands for one without end.
    let f0 =
        material.ior().filter(|ior| ior.is_finite() && (*ior >= 1.0 || *ior == 0.0)).map_or(DIELECTRIC_F0, from_ior);
    let (strength, color) = material
        .specular()
        .map_or((1.0, [1.0; 3]), |specular| (unit(specular.specular_factor(), 1.0), specular.specular_color_factor()));
    let coat_f0 = color.map(|c| unit(f0 * c, f0) * strength);
    Finish { coat_f0, coat_f90: strength, ..Finish::default() }
}

fn unit(value: f32, otherwise: f32) -> f32 {
    if value.is_finite() { value.clamp(0.0, 1.0) } else { otherwise }
}

fn used(info: &gltf::texture::Info) -> UvUse {
    let mut used = UvUse { set: info.tex_coord(), ..UvUse::default() };
    if let Some(transform) = info.texture_transform() {
        used.set = transform.tex_coord().unwrap_or(used.set);
        used.transform = UvTransform {
            offset: transform.offset().into(),
            rotation: transform.rotation(),
            scale: transform.scale().into(),
        };
    }
    used
}

/// `KHR_texture_transform` as JSON: the coordinates that it names, if it does, and the transform.
fn transform_of(value: &serde_json::Value) -> (Option<u32>, UvTransform) {
    let number = |value: &serde_json::Value| value.as_f64().map(|v| v as f32);
    let pair = |name: &str| {
        let list = value.get(name)?.as_array()?;
        Some(glam::Vec2::new(number(list.first()?)?, number(list.get(1)?)?))
    };
    let plain = UvTransform::default();
    let transform = UvTransform {
        offset: pair("offset").unwrap_or(plain.offset),
        rotation: value.get("rotation").and_then(number).unwrap_or(plain.rotation),
        scale: pair("scale").unwrap_or(plain.scale),
    };
    (value.get("texCoord").and_then(|v| v.as_u64()).map(|set| set as u32), transform)
}
