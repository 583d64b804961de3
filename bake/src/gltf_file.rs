//! A glTF file with its buffers, and its pictures on demand.

use std::path::{Path, PathBuf};

use crate::normalmap::NormalMap;
use crate::scene::SceneError;
use crate::texture::{Encoding, Texture, Wrap};

/// Extensions that change nothing that a bake reads, or that the accessor reader handles as it is.
const HARMLESS: [&str; 3] = ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_lights_punctual"];

/// A checked glTF document and the bytes of its buffers.
pub(crate) struct GltfFile {
    pub(crate) path: PathBuf,
    pub(crate) document: gltf::Document,
    pub(crate) buffers: Vec<Vec<u8>>,
}

impl GltfFile {
    pub(crate) fn open(path: &Path) -> Result<Self, SceneError> {
        let read = |source| SceneError::Read { file: path.to_owned(), part: "the scene".into(), source };
        let bytes = std::fs::read(path).map_err(read)?;
        let fault = |error: gltf::Error| SceneError::Format { file: path.to_owned(), fault: one_line(&error) };
        let gltf = gltf::Gltf::from_slice_without_validation(&bytes).map_err(fault)?;
        let mut blob = gltf.blob;
        let mut root = gltf.document.into_json();
        for extension in &root.extensions_required {
            refuse_extension(path, extension)?;
        }
        root.extensions_required.clear();
        // The library's own check looks positions up before it has checked their index.
        let used = root.meshes.iter().flat_map(|m| &m.primitives).flat_map(|p| p.attributes.values());
        if let Some(index) = used.map(|index| index.value()).find(|&index| index >= root.accessors.len()) {
            let fault = format!("a mesh uses accessor {index} of {}", root.accessors.len());
            return Err(SceneError::Format { file: path.to_owned(), fault });
        }
        let document = gltf::Document::from_json(root).map_err(fault)?;
        let mut file = GltfFile { path: path.to_owned(), document, buffers: Vec::new() };
        let mut buffers = Vec::new();
        for buffer in file.document.buffers() {
            let bytes = match buffer.source() {
                gltf::buffer::Source::Bin => {
                    blob.take().ok_or_else(|| file.fault("its binary part is missing".into()))?
                }
                gltf::buffer::Source::Uri(uri) => file.resolve(uri, &format!("buffer {}", buffer.index()))?,
            };
            if bytes.len() < buffer.length() {
                let (index, want) = (buffer.index(), buffer.length());
                return Err(file.fault(format!("buffer {index} has {} of {want} bytes", bytes.len())));
            }
            buffers.push(bytes);
        }
        file.buffers = buffers;
        Ok(file)
    }

    pub(crate) fn fault(&self, fault: String) -> SceneError {
        SceneError::Format { file: self.path.clone(), fault }
    }

    /// The bytes behind a URI: `data:` or a file beside the scene.
    fn resolve(&self, uri: &str, part: &str) -> Result<Vec<u8>, SceneError> {
        if uri.starts_with("data:") {
            let source = gltf::buffer::Source::Uri(uri);
            let data = gltf::buffer::Data::from_source(source, None);
            return data.map(|d| d.0).map_err(|error| self.fault(format!("{part}: {}", one_line(&error))));
        }
        let name = percent_decoded(uri.strip_prefix("file://").unwrap_or(uri));
        let path = self.path.parent().unwrap_or(Path::new("")).join(&name);
        let named = format!("{part} '{name}'");
        std::fs::read(path).map_err(|source| SceneError::Read { file: self.path.clone(), part: named, source })
    }

    /// Decodes the picture of `texture`.
    pub(crate) fn texture(&self, texture: &gltf::Texture, encoding: Encoding) -> Result<Texture, SceneError> {
        let picture = self.picture(texture)?;
        Texture::encoded(picture.size.0, picture.size.1, picture.texels, picture.wrap, encoding)
            .ok_or_else(|| picture.name.fault(&self.path, "it is empty".into()))
    }

    /// Decodes the normal map of `texture`.
    pub(crate) fn normal_map(&self, texture: &gltf::Texture) -> Result<NormalMap, SceneError> {
        let picture = self.picture(texture)?;
        NormalMap::new(picture.size.0, picture.size.1, &picture.texels, picture.wrap)
            .ok_or_else(|| picture.name.fault(&self.path, "it is empty".into()))
    }

    fn picture(&self, texture: &gltf::Texture) -> Result<Picture, SceneError> {
        let source = texture.source();
        let name = source.name().map_or(format!("{}", source.index()), |n| format!("'{n}'"));
        let bytes = match source.source() {
            gltf::image::Source::Uri { uri, .. } => self.resolve(uri, &format!("image {name}"))?,
            gltf::image::Source::View { view, .. } => {
                let end = view.offset().saturating_add(view.length());
                let bytes = self.buffers.get(view.buffer().index()).and_then(|b| b.get(view.offset()..end));
                bytes.ok_or_else(|| self.fault(format!("image {name} lies outside its buffer")))?.to_vec()
            }
        };
        let name = PictureName(name);
        let picture = image::load_from_memory(&bytes).map_err(|e| name.fault(&self.path, e.to_string()))?.into_rgba8();
        let (width, height) = picture.dimensions();
        let texels = picture.pixels().map(|p| p.0).collect();
        let wrap = [texture.sampler().wrap_s(), texture.sampler().wrap_t()].map(|mode| match mode {
            gltf::texture::WrappingMode::Repeat => Wrap::Repeat,
            gltf::texture::WrappingMode::MirroredRepeat => Wrap::Mirror,
            gltf::texture::WrappingMode::ClampToEdge => Wrap::Clamp,
        });
        Ok(Picture { name, size: (width as usize, height as usize), texels, wrap })
    }
}

/// A decoded picture.
struct Picture {
    name: PictureName,
    size: (usize, usize),
    texels: Vec<[u8; 4]>,
    wrap: [Wrap; 2],
}

struct PictureName(String);

impl PictureName {
    fn fault(&self, file: &Path, fault: String) -> SceneError {
        SceneError::Image { file: file.to_owned(), image: self.0.clone(), fault }
    }
}

fn refuse_extension(path: &Path, extension: &str) -> Result<(), SceneError> {
    let advice = match extension {
        "KHR_draco_mesh_compression" => "export without compression (Blender: Data > Compression off)",
        "EXT_meshopt_compression" | "KHR_meshopt_compression" => "export without mesh compression",
        "KHR_texture_basisu" | "EXT_texture_webp" => "export the textures as PNG or JPEG",
        "EXT_mesh_gpu_instancing" => "make the instances real before the export",
        _ if HARMLESS.contains(&extension) || extension.starts_with("KHR_materials_") => return Ok(()),
        _ => "export without it",
    };
    Err(SceneError::Extension { file: path.to_owned(), extension: extension.to_owned(), advice })
}

fn one_line(error: &dyn std::fmt::Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

fn percent_decoded(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let code = (bytes[at] == b'%').then(|| uri.get(at + 1..at + 3)).flatten();
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                out.push(byte);
                at += 3;
            }
            None => {
                out.push(bytes[at]);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}
