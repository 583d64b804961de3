//! Scenes made in code, as glTF 2.0 files.

use relume_bake::glb::{FLOAT, Parts, UINT, container};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A mesh of one colour, or of one colour times the scene's texture.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Corners, metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit shading normals, one per corner; none: every triangle is flat.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, one per corner; used with `textured`.
    pub uvs: Vec<[f32; 2]>,
    /// Three per triangle.
    pub indices: Vec<u32>,
    /// Linear base colour.
    pub color: [f32; 3],
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// 0 a mirror, 1 as rough as can be.
    pub roughness: f32,
    /// Is the base colour multiplied by the texture?
    pub textured: bool,
    /// What its node is marked as, if it is.
    pub role: Option<&'static str>,
}

impl Mesh {
    /// A rough dielectric without corners.
    fn empty(color: [f32; 3]) -> Self {
        Mesh {
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            indices: Vec::new(),
            color,
            metallic: 0.0,
            roughness: 1.0,
            textured: false,
            role: None,
        }
    }
}

/// A quad of two triangles; texture coordinates run from 0 to 1 over it.
pub fn quad(corners: [[f32; 3]; 4], color: [f32; 3]) -> Mesh {
    let uvs = vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    Mesh { positions: corners.to_vec(), uvs, indices: vec![0, 1, 2, 0, 2, 3], ..Mesh::empty(color) }
}

/// A smooth sphere about `centre`, of `rows` rows of twice as many quads.
pub fn sphere(centre: [f32; 3], radius: f32, rows: u32, color: [f32; 3]) -> Mesh {
    let mut mesh = Mesh::empty(color);
    let columns = 2 * rows;
    for row in 0..=rows {
        for column in 0..=columns {
            let (down, around) = (row as f32 / rows as f32, column as f32 / columns as f32);
            let (sin, cos) = (std::f32::consts::PI * down).sin_cos();
            let (z, x) = (std::f32::consts::TAU * around).sin_cos();
            let normal = [sin * x, cos, sin * z];
            mesh.positions.push(std::array::from_fn(|axis| centre[axis] + radius * normal[axis]));
            mesh.normals.push(normal);
            mesh.uvs.push([around, down]);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let at = row * (columns + 1) + column;
            let below = at + columns + 1;
            mesh.indices.extend([at, at + 1, below, at + 1, below + 1, below]);
        }
    }
    mesh
}

/// A level square of half side `half` at height `y`, facing up.
pub fn ground(half: f32, y: f32, color: [f32; 3]) -> Mesh {
    quad([[-half, y, half], [half, y, half], [half, y, -half], [-half, y, -half]], color)
}

/// An upright box over `min..max`, its faces outwards.
pub fn cuboid(min: [f32; 3], max: [f32; 3], color: [f32; 3]) -> Mesh {
    let corner = |bits: usize| std::array::from_fn(|axis| if bits >> axis & 1 == 1 { max[axis] } else { min[axis] });
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut mesh = Mesh::empty(color);
    for face in faces {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(face.map(corner));
        mesh.uvs.extend([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
        mesh.indices.extend([0, 1, 2, 0, 2, 3].map(|k| first + k));
    }
    mesh
}

/// A checked PNG, 8 x 8, of two sRGB greys.
///
/// # Panics
/// Never in practice: the picture is in memory.
pub fn checks_png() -> Vec<u8> {
    let picture = image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([if (x + y) % 2 == 0 { 235 } else { 90 }; 3]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("a PNG in memory");
    bytes.into_inner()
}

/// Where a glTF's texture lies.
#[derive(Clone, Copy, Debug)]
pub enum Picture<'a> {
    /// In the binary part.
    Inside(&'a [u8]),
    /// In a file beside the scene.
    Beside(&'a str),
}

fn entry(parts: &mut Parts, mesh: &Mesh, material: usize) -> Value {
    let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let bound = |pick: fn(f32, f32) -> f32| {
        let start = mesh.positions.first().copied().unwrap_or_default();
        let bound: [f32; 3] =
            std::array::from_fn(|axis| mesh.positions.iter().map(|p| p[axis]).fold(start[axis], pick));
        // JSON has no NaN: a scene with one states a plain bound.
        json!(bound.map(|v| if v.is_finite() { v } else { 0.0 }))
    };
    let bounds = Some((bound(f32::min), bound(f32::max)));
    let position = parts.accessor(&bytes(mesh.positions.as_flattened()), mesh.positions.len(), FLOAT, "VEC3", bounds);
    let uv = parts.accessor(&bytes(mesh.uvs.as_flattened()), mesh.uvs.len(), FLOAT, "VEC2", None);
    let indices: Vec<u8> = mesh.indices.iter().flat_map(|k| k.to_le_bytes()).collect();
    let indices = parts.accessor(&indices, mesh.indices.len(), UINT, "SCALAR", None);
    let mut attributes = json!({"POSITION": position, "TEXCOORD_0": uv});
    if !mesh.normals.is_empty() {
        let normals = bytes(mesh.normals.as_flattened());
        attributes["NORMAL"] = json!(parts.accessor(&normals, mesh.normals.len(), FLOAT, "VEC3", None));
    }
    json!({"primitives": [{"attributes": attributes, "indices": indices, "material": material}]})
}

/// The JSON and the binary part of a glTF scene.
fn document(meshes: &[Mesh], picture: Option<Picture<'_>>) -> (Value, Vec<u8>) {
    let mut parts = Parts::default();
    let written: Vec<Value> = meshes.iter().enumerate().map(|(k, mesh)| entry(&mut parts, mesh, k)).collect();
    let materials: Vec<Value> = meshes
        .iter()
        .map(|mesh| {
            let [r, g, b] = mesh.color;
            let mut surface = json!({"baseColorFactor": [r, g, b, 1.0], "metallicFactor": mesh.metallic});
            if mesh.roughness != 1.0 {
                surface["roughnessFactor"] = json!(mesh.roughness);
            }
            if mesh.textured {
                surface["baseColorTexture"] = json!({"index": 0});
            }
            json!({"pbrMetallicRoughness": surface})
        })
        .collect();
    let node = |(k, mesh): (usize, &Mesh)| match mesh.role {
        Some(role) => json!({"mesh": k, "extras": {"relume": role}}),
        None => json!({"mesh": k}),
    };
    let nodes: Vec<Value> = meshes.iter().enumerate().map(node).collect();
    let mut root = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}],
        "nodes": nodes, "meshes": written, "materials": materials,
    });
    if let Some(picture) = picture {
        root["textures"] = json!([{"source": 0}]);
        root["images"] = match picture {
            Picture::Inside(png) => json!([{"bufferView": parts.view(png), "mimeType": "image/png"}]),
            Picture::Beside(name) => json!([{"uri": name}]),
        };
    }
    root["accessors"] = json!(parts.accessors);
    root["bufferViews"] = json!(parts.views);
    root["buffers"] = json!([{"byteLength": parts.binary.len()}]);
    (root, parts.binary)
}

/// A `.glb` file of these meshes.
pub fn glb(meshes: &[Mesh], picture: Option<Picture<'_>>) -> Vec<u8> {
    let (root, binary) = document(meshes, picture);
    container(&root, &binary)
}

/// A `.glb` that holds no mesh.
pub fn empty_glb() -> Vec<u8> {
    container(&json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}), &[])
}

/// Writes `scene.gltf` and `scene.bin` into `folder`.
///
/// # Panics
/// If they cannot be written.
pub fn write_gltf(folder: &Path, meshes: &[Mesh], picture: Option<Picture<'_>>) -> PathBuf {
    let (mut root, binary) = document(meshes, picture);
    root["buffers"][0]["uri"] = json!("scene.bin");
    crate::files::put(&folder.join("scene.bin"), binary);
    let path = folder.join("scene.gltf");
    crate::files::put(&path, root.to_string());
    path
}

/// Ground, a box on it and an upright textured board: shadow, bounce and texture at 64 x 48.
pub fn courtyard() -> Vec<Mesh> {
    let mut board = quad([[-3.0, 0.0, -1.5], [-0.5, 0.0, -2.5], [-0.5, 2.2, -2.5], [-3.0, 2.2, -1.5]], [0.9, 0.8, 0.7]);
    board.textured = true;
    vec![ground(12.0, 0.0, [0.35, 0.4, 0.3]), cuboid([0.2, 0.0, -1.2], [1.8, 1.6, 0.4], [0.75, 0.55, 0.35]), board]
}

/// A bronze and a polished marble sphere on a stone floor, before a rough wall.
pub fn polished() -> Vec<Mesh> {
    let mut bronze = sphere([-1.1, 0.9, 0.0], 0.9, 48, [0.71, 0.43, 0.18]);
    (bronze.metallic, bronze.roughness) = (1.0, 0.25);
    let mut marble = sphere([1.1, 0.9, 0.3], 0.9, 48, [0.78, 0.74, 0.68]);
    marble.roughness = 0.12;
    let wall = cuboid([-3.2, 0.0, -2.4], [3.2, 1.4, -2.0], [0.6, 0.5, 0.38]);
    let mut floor = ground(9.0, 0.0, [0.45, 0.42, 0.37]);
    floor.roughness = 0.6;
    vec![floor, bronze, marble, wall]
}

/// Writes the polished spheres as `scene.glb` and their camera as `camera.json`.
///
/// # Panics
/// If they cannot be written.
pub fn write_polished(folder: &Path) {
    crate::files::put(&folder.join("scene.glb"), glb(&polished(), None));
    let camera = r#"{"position":[0.6,2.0,6.2],"target":[0.0,0.75,0],"up":[0,1,0],"fov_y_deg":34}"#;
    crate::files::put(&folder.join("camera.json"), camera);
}

/// A house that has vanished, on real ground, behind a real wall's stump, with a tree trunk in front of it.
pub fn site() -> Vec<Mesh> {
    let house = cuboid([-1.6, 0.0, -1.4], [1.4, 2.2, 0.6], [0.7, 0.5, 0.3]);
    let mut floor = ground(14.0, 0.0, [0.4, 0.42, 0.3]);
    let mut stump = cuboid([2.2, 0.0, -0.6], [3.6, 0.9, -0.2], [0.6, 0.58, 0.52]);
    let mut trunk = cuboid([0.3, 0.0, 2.4], [0.6, 3.4, 2.7], [0.25, 0.2, 0.15]);
    (floor.role, stump.role, trunk.role) = (Some("receiver"), Some("receiver"), Some("occluder"));
    vec![floor, stump, house, trunk]
}

/// Writes the site as `scene.glb` and its camera as `camera.json`.
///
/// # Panics
/// If they cannot be written.
pub fn write_site(folder: &Path) {
    crate::files::put(&folder.join("scene.glb"), glb(&site(), None));
    let camera = r#"{"position":[2.0,2.4,9.0],"target":[0.6,0.7,0],"up":[0,1,0],"fov_y_deg":40}"#;
    crate::files::put(&folder.join("camera.json"), camera);
}

/// Writes the courtyard as `scene.glb` and its camera as `camera.json`.
///
/// # Panics
/// If they cannot be written.
pub fn write_courtyard(folder: &Path) {
    let png = checks_png();
    crate::files::put(&folder.join("scene.glb"), glb(&courtyard(), Some(Picture::Inside(&png))));
    let camera = r#"{"position":[2.5,2.6,6.5],"target":[-0.4,0.8,0],"up":[0,1,0],"fov_y_deg":45}"#;
    crate::files::put(&folder.join("camera.json"), camera);
}
