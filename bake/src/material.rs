//! Materials: what glTF 2.0 says about a surface.

use serde::{Deserialize, Serialize};

/// Which part of the materials is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shading {
    /// Base colour only, reflected evenly.
    #[default]
    Lambert,
    /// Metallic-roughness with normal maps, as glTF 2.0 appendix B defines it.
    Gltf,
}

/// How a material treats alpha (its base colour's alpha times its texture's).
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Alpha {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// Nothing is there where alpha is below `cutoff`.
    Mask {
        /// Alpha from which the surface is there.
        cutoff: f32,
    },
    /// Alpha is the share of light that meets the surface.
    Blend,
}

/// A material, the same on both sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the file.
    pub name: String,
    /// Linear RGB reflectance and alpha, each 0..1; multiplies the texture.
    pub base_color: [f32; 4],
    /// Index into [`crate::scene::Scene::textures`].
    pub texture: Option<u32>,
    /// How alpha is treated.
    pub alpha: Alpha,
    /// What [`Shading::Gltf`] reads beside the base colour.
    pub finish: Finish,
}

/// The metallic-roughness part of a material.
#[derive(Clone, Debug, PartialEq)]
pub struct Finish {
    /// 0 dielectric, 1 metal; multiplies the blue channel of `texture`.
    pub metallic: f32,
    /// Perceptual roughness, 0..1; multiplies the green channel of `texture`.
    pub roughness: f32,
    /// Index into [`crate::scene::Scene::textures`].
    pub texture: Option<u32>,
    /// Index into [`crate::scene::Scene::normal_maps`], and the factor of its x and y.
    pub normal_map: Option<(u32, f32)>,
    /// Linear RGB reflectance of the dielectric coat at normal incidence: 0.04, or what `KHR_materials_ior` and
    /// `KHR_materials_specular` make of it.
    pub coat_f0: [f32; 3],
    /// The same at grazing incidence: 1, or the factor of `KHR_materials_specular`.
    pub coat_f90: f32,
}

impl Default for Finish {
    /// A rough dielectric.
    fn default() -> Self {
        Finish {
            metallic: 0.0,
            roughness: 1.0,
            texture: None,
            normal_map: None,
            coat_f0: [DIELECTRIC_F0; 3],
            coat_f90: 1.0,
        }
    }
}

/// Reflectance at normal incidence of an index of refraction of 1.5.
pub const DIELECTRIC_F0: f32 = 0.04;
