//! A scene as a binary glTF 2.0 file, for other programs: one mesh per material and role, roles as the property that
//! [`crate::scene::load`] reads.
//!
//! Base colours, their pictures, alpha, metallic and roughness are written; normal maps and pictures of metallic and roughness
//! are not.

use std::collections::BTreeMap;
use std::io::{Cursor, Write};
use std::path::Path;

use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use relume_firmware::glue::outfile::{OutError, write_whole};
use serde_json::{Value, json};

use crate::glb::{FLOAT, Parts, container};
use crate::material::{Alpha, Material};
use crate::scene::{PROPERTY, Role, Scene, Triangle};
use crate::texture::{Texture, Wrap};

/// Writes `scene` into `file`, whole or not at all.
///
/// # Errors
/// [`OutError`]: the place cannot be written, or the disk is full.
pub fn write_glb(file: &Path, scene: &Scene) -> Result<(), OutError> {
    let written = glb(scene);
    write_whole(file, |out| out.write_all(&written?))
}

fn glb(scene: &Scene) -> std::io::Result<Vec<u8>> {
    let mut parts = Parts::default();
    let mut groups = BTreeMap::<(Role, u32), Vec<&Triangle>>::new();
    for (index, triangle) in (0u32..).zip(&scene.triangles) {
        groups.entry((scene.role(index), triangle.material)).or_default().push(triangle);
    }
    let mut meshes: Vec<Value> = Vec::new();
    let mut nodes: Vec<Value> = Vec::new();
    for ((role, material), triangles) in &groups {
        nodes.push(json!({"mesh": meshes.len(), "extras": {PROPERTY: role.name()}}));
        meshes.push(json!({"primitives": [{"attributes": corners(&mut parts, triangles), "material": material}]}));
    }
    let images: Vec<Value> =
        scene.textures.iter().map(|texture| picture(&mut parts, texture)).collect::<Result<_, _>>()?;
    let samplers: Vec<Value> = scene.textures.iter().map(sampler).collect();
    let textures: Vec<Value> = (0..images.len()).map(|at| json!({"source": at, "sampler": at})).collect();
    let mut root = json!({
        "asset": {"version": "2.0", "generator": "Relume"},
        "scene": 0, "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}], "nodes": nodes, "meshes": meshes,
        "materials": scene.materials.iter().map(material_entry).collect::<Vec<_>>(),
        "accessors": parts.accessors, "bufferViews": parts.views, "buffers": [{"byteLength": parts.binary.len()}],
    });
    if !images.is_empty() {
        // glTF allows no empty lists.
        (root["images"], root["samplers"], root["textures"]) = (json!(images), json!(samplers), json!(textures));
    }
    Ok(container(&root, &parts.binary))
}

fn sampler(texture: &Texture) -> Value {
    let mode = |wrap: Wrap| match wrap {
        Wrap::Repeat => 10497,
        Wrap::Mirror => 33648,
        Wrap::Clamp => 33071,
    };
    json!({"wrapS": mode(texture.wrap[0]), "wrapT": mode(texture.wrap[1])})
}

fn material_entry(material: &Material) -> Value {
    let finish = &material.finish;
    let mut surface = json!({
        "baseColorFactor": material.base_color, "metallicFactor": finish.metallic, "roughnessFactor": finish.roughness,
    });
    if let Some(texture) = material.texture {
        surface["baseColorTexture"] = json!({"index": texture});
    }
    let mut entry = json!({"name": material.name, "doubleSided": true, "pbrMetallicRoughness": surface});
    match material.alpha {
        Alpha::Opaque => {}
        Alpha::Mask { cutoff } => (entry["alphaMode"], entry["alphaCutoff"]) = (json!("MASK"), json!(cutoff)),
        Alpha::Blend => entry["alphaMode"] = json!("BLEND"),
    }
    entry
}

/// Adds numbers of which `width` belong to a corner.
fn numbers(parts: &mut Parts, values: &[f32], width: usize) -> usize {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let bound = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
        let of = |axis: usize| values.iter().skip(axis).step_by(width).copied().reduce(pick).unwrap_or(0.0);
        (0..width).map(of).collect()
    };
    let bounds = (json!(bound(f32::min)), json!(bound(f32::max)));
    parts.accessor(&bytes, values.len() / width, FLOAT, &format!("VEC{width}"), Some(bounds))
}

fn corners(parts: &mut Parts, triangles: &[&Triangle]) -> Value {
    let positions: Vec<f32> = triangles.iter().flat_map(|t| t.positions).flat_map(|p| p.to_array()).collect();
    let normals: Vec<f32> = triangles.iter().flat_map(|t| t.normals).flat_map(|n| n.to_array()).collect();
    let uvs: Vec<f32> = triangles.iter().flat_map(|t| t.uvs).flat_map(|uv| uv.to_array()).collect();
    json!({
        "POSITION": numbers(parts, &positions, 3), "NORMAL": numbers(parts, &normals, 3),
        "TEXCOORD_0": numbers(parts, &uvs, 2),
    })
}

fn picture(parts: &mut Parts, texture: &Texture) -> std::io::Result<Value> {
    let (width, height) = texture.size();
    let mut png = Cursor::new(Vec::new());
    let encoder = PngEncoder::new(&mut png);
    let (pixels, kind) = (texture.texels().as_flattened(), image::ExtendedColorType::Rgba8);
    encoder.write_image(pixels, width as u32, height as u32, kind).map_err(std::io::Error::other)?;
    Ok(json!({"bufferView": parts.view(png.get_ref()), "mimeType": "image/png"}))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo_scene;
    use crate::scene::load;

    #[test]
    fn what_is_written_is_read_back() {
        let (scene, _) = demo_scene::site();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("site.glb");
        write_glb(&file, &scene).unwrap();
        let back = load(&file, scene.shading).unwrap();
        assert!(back.notices.is_empty(), "{:?}", back.notices);
        let back = back.scene;
        assert_eq!(back.triangles.len(), scene.triangles.len());
        let sorted = |scene: &Scene| {
            let mut order: Vec<u32> = (0..scene.triangles.len() as u32).collect();
            order.sort_by_key(|&at| (scene.role(at), scene.triangles[at as usize].material));
            order
        };
        for (a, b) in sorted(&scene).into_iter().zip(sorted(&back)) {
            assert_eq!(scene.role(a), back.role(b));
            let (mut a, b) = (scene.triangles[a as usize], back.triangles[b as usize]);
            let off = a.normals.iter().zip(&b.normals).map(|(a, b)| (*a - *b).length()).fold(0.0, f32::max);
            assert!(off < 1e-6, "{off}");
            a.normals = b.normals;
            assert_eq!(a, b);
        }
        for (a, b) in scene.materials.iter().zip(&back.materials) {
            assert_eq!((&a.name, a.base_color, a.alpha), (&b.name, b.base_color, b.alpha));
            let texture =
                |scene: &Scene, material: &Material| material.texture.map(|at| scene.textures[at as usize].clone());
            assert!(texture(&scene, a) == texture(&back, b), "{}", a.name);
        }
    }
}
