//! What the parts of a scene are to the post: marks that modellers set on nodes, exported as glTF extras.

use super::{Material, Scene};
use crate::normalmap::NormalMap;
use crate::texture::Texture;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What a surface is to the post.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Role {
    /// Shown: what has vanished.
    #[default]
    Virtual,
    /// Really there, and takes the shadow and the reflected light of what is shown.
    Receiver,
    /// Really there, and hides what is shown behind it.
    Occluder,
}

/// The property on a node, or on its mesh, that says what it is.
pub const PROPERTY: &str = "relume";

impl Role {
    /// The word for it in [`PROPERTY`].
    pub fn name(self) -> &'static str {
        match self {
            Role::Virtual => "virtual",
            Role::Receiver => "receiver",
            Role::Occluder => "occluder",
        }
    }

    /// The role that extras of a node or mesh give; `None` if they give none, and the value at fault if it is no role.
    pub(super) fn in_extras(extras: &gltf::json::Extras) -> Result<Option<Role>, String> {
        let Some(raw) = extras else { return Ok(None) };
        let Ok(Value::Object(properties)) = serde_json::from_str(raw.get()) else { return Ok(None) };
        match properties.get(PROPERTY) {
            None | Some(Value::Null) => Ok(None),
            Some(Value::String(text)) => match text.trim().to_ascii_lowercase().as_str() {
                "virtual" => Ok(Some(Role::Virtual)),
                "receiver" => Ok(Some(Role::Receiver)),
                "occluder" => Ok(Some(Role::Occluder)),
                _ => Err(format!("\"{text}\"")),
            },
            Some(other) => Err(other.to_string()),
        }
    }
}

impl Scene {
    /// What a triangle is to the post.
    #[inline]
    pub fn role(&self, triangle: u32) -> Role {
        self.roles.get(triangle as usize).copied().unwrap_or_default()
    }

    /// Is anything marked as a receiver?
    pub fn has_receivers(&self) -> bool {
        self.roles.contains(&Role::Receiver)
    }

    /// Gives the triangles from number `from` on a role.
    pub(super) fn mark(&mut self, from: usize, role: Role) {
        if role != Role::Virtual || !self.roles.is_empty() {
            self.roles.resize(from, Role::Virtual);
            self.roles.resize(self.triangles.len(), role);
        }
    }

    /// What is really there: the scene without its virtual geometry, and without the pictures that only that has.
    pub fn real(&self) -> Scene {
        let is_real = |index: &usize| self.role(*index as u32) != Role::Virtual;
        let kept: Vec<usize> = (0..self.triangles.len()).filter(is_real).collect();
        let mut real = Scene {
            triangles: kept.iter().map(|&index| self.triangles[index]).collect(),
            materials: self.materials.clone(),
            details: kept.iter().filter_map(|&index| self.details.get(index).copied()).collect(),
            roles: kept.iter().map(|&index| self.role(index as u32)).collect(),
            shading: self.shading,
            ..Scene::default()
        };
        for (index, material) in (0u32..).zip(&mut real.materials) {
            if real.triangles.iter().any(|triangle| triangle.material == index) {
                self.copy_pictures(material, &mut real.textures, &mut real.normal_maps);
            } else {
                (material.texture, material.finish.texture, material.finish.normal_map) = (None, None, None);
            }
        }
        real
    }

    /// Copies the pictures of a material, and has it use the copies.
    fn copy_pictures(&self, material: &mut Material, textures: &mut Vec<Texture>, normal_maps: &mut Vec<NormalMap>) {
        let mut copy = |index: u32| {
            textures.push(self.textures.get(index as usize)?.clone());
            Some(textures.len() as u32 - 1)
        };
        material.texture = material.texture.and_then(&mut copy);
        material.finish.texture = material.finish.texture.and_then(&mut copy);
        material.finish.normal_map = material.finish.normal_map.and_then(|(index, scale)| {
            normal_maps.push(self.normal_maps.get(index as usize)?.clone());
            Some((normal_maps.len() as u32 - 1, scale))
        });
    }
}
