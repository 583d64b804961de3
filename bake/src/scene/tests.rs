//! Small glTF files, most of them broken.

use std::io::Write;

use super::*;

/// A `.gltf` of one mesh whose buffer lies beside it: positions, normals after them, indices after those.
struct Sample {
    positions: Vec<[f32; 3]>,
    indices: Vec<u16>,
    mode: u32,
    node: &'static str,
    extra: &'static str,
    material: &'static str,
}

impl Default for Sample {
    fn default() -> Self {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
        Sample { positions, indices: vec![0, 1, 2, 2, 1, 3], mode: 4, node: "", extra: "", material: "" }
    }
}

impl Sample {
    fn json(&self, uri: &str, length: usize) -> String {
        let (vertices, count) = (self.positions.len(), self.indices.len());
        let split = 12 * vertices;
        let (mode, node, extra, material) = (self.mode, self.node, self.extra, self.material);
        format!(
            r#"{{"asset":{{"version":"2.0"}},{extra}
            "scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"name":"Hut"{node}}}],
            "meshes":[{{"name":"Roof","primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"mode":{mode}{material}}}]}}],
            "buffers":[{{"uri":"{uri}","byteLength":{length}}}],
            "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":{split}}},
                {{"buffer":0,"byteOffset":{split},"byteLength":{rest}}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3",
                "min":[0,0,0],"max":[1,1,1]}},
                {{"bufferView":1,"componentType":5123,"count":{count},"type":"SCALAR"}}]}}"#,
            rest = length - split.min(length),
        )
    }

    fn bytes(&self) -> Vec<u8> {
        let numbers = self.positions.iter().flatten().flat_map(|v| v.to_le_bytes());
        numbers.chain(self.indices.iter().flat_map(|v| v.to_le_bytes())).collect()
    }

    fn load(&self) -> Result<Scene, SceneError> {
        let dir = tempfile::tempdir().unwrap();
        let bytes = self.bytes();
        std::fs::write(dir.path().join("a part.bin"), &bytes).unwrap();
        let path = dir.path().join("hut.gltf");
        std::fs::write(&path, self.json("a%20part.bin", bytes.len())).unwrap();
        load(&path, Shading::Gltf).map(|loaded| loaded.scene)
    }
}

fn message(result: Result<Scene, SceneError>) -> String {
    let text = result.unwrap_err().to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

#[test]
fn triangles_come_with_flat_normals_and_the_default_material() {
    let scene = Sample::default().load().unwrap();
    assert_eq!(scene.triangles.len(), 2);
    assert!(scene.triangles.iter().all(|t| t.normals == [Vec3::Z; 3]));
    assert_eq!(scene.materials[scene.triangles[0].material as usize].base_color, [1.0; 4]);
}

#[test]
fn nodes_move_turn_and_mirror() {
    let node = r#","scale":[-2,2,2],"translation":[10,0,0]"#;
    let scene = Sample { node, ..Sample::default() }.load().unwrap();
    let triangle = scene.triangles[0];
    let [a, b, c] = triangle.positions;
    assert!(triangle.positions.contains(&Vec3::new(8.0, 0.0, 0.0)));
    // A mirror keeps fronts in front.
    assert_eq!((b - a).cross(c - a).normalize(), Vec3::Z);
    assert_eq!(triangle.normals[0], Vec3::Z);
}

#[test]
fn strips_and_fans_keep_their_fronts() {
    let strip = Sample { indices: vec![0, 1, 2, 3], mode: 5, ..Sample::default() }.load().unwrap();
    let fan = Sample { indices: vec![0, 1, 3, 2], mode: 6, ..Sample::default() }.load().unwrap();
    for scene in [strip, fan] {
        assert_eq!(scene.triangles.len(), 2);
        assert!(scene.triangles.iter().all(|t| t.normals[0] == Vec3::Z));
    }
}

#[test]
fn degenerate_triangles_are_left_out() {
    let scene = Sample { indices: vec![0, 1, 2, 1, 1, 2], ..Sample::default() }.load().unwrap();
    assert_eq!(scene.triangles.len(), 1);
}

#[test]
fn faults_are_one_line_with_file_and_place() {
    let mut sample = Sample::default();
    sample.positions[1][2] = f32::NAN;
    let text = message(sample.load());
    assert!(text.contains("hut.gltf: mesh 'Roof' of node 'Hut' has a vertex"), "{text}");

    let text = message(Sample { indices: vec![0, 1, 9], ..Sample::default() }.load());
    assert!(text.contains("index 9 of only 4 vertices"), "{text}");

    assert!(message(Sample { mode: 1, ..Sample::default() }.load()).contains("no triangles"));

    let extra = r#""extensionsRequired":["KHR_draco_mesh_compression"],
        "extensionsUsed":["KHR_draco_mesh_compression"],"#;
    let text = message(Sample { extra, ..Sample::default() }.load());
    assert!(text.contains("KHR_draco_mesh_compression") && text.contains("without compression"), "{text}");

    let cycle = r#","children":[0]"#;
    assert!(message(Sample { node: cycle, ..Sample::default() }.load()).contains("ancestor"));
}

#[test]
fn missing_and_short_files_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("hut.gltf");
    let sample = Sample::default();
    std::fs::write(&path, sample.json("lost.bin", 60)).unwrap();
    let text = message(load(&path, Shading::Gltf).map(|loaded| loaded.scene));
    assert!(text.contains("hut.gltf") && text.contains("lost.bin"), "{text}");
    std::fs::write(dir.path().join("lost.bin"), [0; 10]).unwrap();
    assert!(message(load(&path, Shading::Gltf).map(|loaded| loaded.scene)).contains("10 of 60 bytes"));
    let texture = r#""materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],
        "textures":[{"source":0}],"images":[{"uri":"wall.png"}],"#;
    let sample = Sample { extra: texture, ..Sample::default() };
    std::fs::write(dir.path().join("lost.bin"), sample.bytes()).unwrap();
    std::fs::write(&path, sample.json("lost.bin", 60)).unwrap();
    assert!(message(load(&path, Shading::Gltf).map(|loaded| loaded.scene)).contains("wall.png"));
    assert!(message(load(&dir.path().join("none.glb"), Shading::Gltf).map(|loaded| loaded.scene)).contains("none.glb"));
}

#[test]
fn damaged_files_never_panic() {
    let sample = Sample::default();
    let bytes = sample.bytes();
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("b.bin"), &bytes).unwrap();
    let json = sample.json("b.bin", bytes.len()).into_bytes();
    let path = dir.path().join("hut.gltf");
    for at in (0..json.len()).step_by(5) {
        for flip in [0x01, 0x08] {
            let mut damaged = json.clone();
            damaged[at] ^= flip;
            std::fs::File::create(&path).unwrap().write_all(&damaged).unwrap();
            let _ = load(&path, Shading::Gltf);
        }
        std::fs::write(&path, &json[..at]).unwrap();
        assert!(load(&path, Shading::Gltf).is_err());
    }
}

fn loaded(sample: &Sample, shading: Shading) -> Loaded {
    let dir = tempfile::tempdir().unwrap();
    let bytes = sample.bytes();
    std::fs::write(dir.path().join("b.bin"), &bytes).unwrap();
    let normals = image::RgbImage::from_pixel(4, 4, image::Rgb([204, 128, 230]));
    normals.save(dir.path().join("n.png")).unwrap();
    let path = dir.path().join("hut.gltf");
    std::fs::write(&path, sample.json("b.bin", bytes.len())).unwrap();
    load(&path, shading).unwrap()
}

#[test]
fn materials_bring_their_finish_and_tell_what_is_left_out() {
    let extra = r#""materials":[{"name":"Lamp","emissiveFactor":[1,0,0],
        "pbrMetallicRoughness":{"metallicFactor":0.25,"roughnessFactor":0.5},
        "extensions":{"KHR_materials_ior":{"ior":2.0},"KHR_materials_specular":{"specularFactor":0.5},
            "KHR_materials_clearcoat":{"clearcoatFactor":1}}}, {}],"#;
    let sample = Sample { extra, ..Sample::default() };
    let Loaded { scene, notices } = loaded(&sample, Shading::Gltf);
    let finish = &scene.materials[0].finish;
    assert_eq!((finish.metallic, finish.roughness, finish.coat_f90), (0.25, 0.5, 0.5));
    assert!((finish.coat_f0[1] - 0.5 / 9.0).abs() < 1e-6);
    // What a file does not say is glTF's default: metal, and as rough as can be.
    assert_eq!((scene.materials[1].finish.metallic, scene.materials[1].finish.roughness), (1.0, 1.0));
    assert_eq!(notices.len(), 2, "{notices:?}");
    assert!(notices[0].contains("'Lamp'") && notices[0].contains("emission"), "{notices:?}");
    assert!(notices[1].contains("KHR_materials_clearcoat"), "{notices:?}");
    let lambert = loaded(&sample, Shading::Lambert);
    assert_eq!(lambert.notices.len(), 1);
    assert!(lambert.scene.materials.iter().all(|material| material.finish == crate::material::Finish::default()));
}

#[test]
fn normal_maps_come_with_coordinates_and_tangents() {
    let extra = r#""materials":[{"normalTexture":{"index":0,"scale":0.5,
        "extensions":{"KHR_texture_transform":{"offset":[0.25,0.5],"scale":[2,2]}}},
        "pbrMetallicRoughness":{"metallicRoughnessTexture":{"index":0}}}],
        "textures":[{"source":0}],"images":[{"uri":"n.png"}],"#;
    let mut sample = Sample { extra, ..Sample::default() };
    sample.material = r#","material":0"#;
    let scene = loaded(&sample, Shading::Gltf).scene;
    let finish = &scene.materials[0].finish;
    assert_eq!((finish.normal_map, finish.texture), (Some((0, 0.5)), Some(0)));
    assert_eq!((scene.details.len(), scene.normal_maps.len(), scene.textures.len()), (2, 1, 1));
    // Without coordinates all corners have the offset, and no tangent can be told.
    assert_eq!(scene.details[0].normal_uvs, [Vec2::new(0.25, 0.5); 3]);
    assert_eq!(scene.details[0].tangents, [Vec4::ZERO; 3]);
    // Roughness is green and metallic blue, as plain values.
    let texel = scene.textures[0].sample(Vec2::ZERO);
    assert!((texel.y - 128.0 / 255.0).abs() < 1e-6 && (texel.z - 230.0 / 255.0).abs() < 1e-6, "{texel}");
    let lambert = loaded(&sample, Shading::Lambert).scene;
    assert!(lambert.details.is_empty() && lambert.normal_maps.is_empty() && lambert.textures.is_empty());
}

#[test]
fn a_mirrored_node_keeps_the_map_s_up() {
    // Tangents of a file under a mirror: the bitangent in the world is still the mirrored one.
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let (normals, tangents) = ([[0.0, 0.0, 1.0]; 3], [[1.0, 0.0, 0.0, 1.0]; 3]);
    for mirror in [DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0), DVec3::new(1.0, 1.0, -1.0)] {
        let to_world = DMat4::from_scale(mirror);
        let mesh = PlacedMesh::new(&positions, Some(&normals), None, to_world, UvTransform::default());
        let tangent = mesh.tangents(&tangents, [0, 1, 2])[0];
        let Ok(Some(triangle)) = mesh.triangle([0, 1, 2], 0) else { panic!("a triangle") };
        let bitangent = triangle.normals[0].cross(tangent.truncate()) * tangent.w;
        assert_eq!(tangent.truncate(), (DVec3::X * mirror).as_vec3());
        assert_eq!(bitangent, (DVec3::Y * mirror).as_vec3(), "{mirror}");
    }
}
