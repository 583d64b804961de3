//! The scene: triangles in world space with their materials, read from a glTF 2.0 file.

mod materials;
mod roles;
mod tangents;

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec3, Vec2, Vec3, Vec4};

use crate::gltf_file::GltfFile;
pub use crate::material::{Alpha, Material, Shading};
use crate::normalmap::NormalMap;
use crate::texture::{Texture, UvTransform};
use materials::{UvUse, UvUses};
pub use roles::{PROPERTY, Role};

/// Why a scene file cannot be used. Every message names the file, what is at fault, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The scene file, or a file that it names, cannot be read.
    #[error("{file}: cannot read {part}: {source}; check the path and export the scene again", file = .file.display())]
    Read {
        /// The scene file.
        file: PathBuf,
        /// What was to be read, by name.
        part: String,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not glTF 2.0, or contradicts itself.
    #[error("{file}: not a usable glTF 2.0 file: {fault}; export it again as .glb", file = .file.display())]
    Format {
        /// The scene file.
        file: PathBuf,
        /// What does not hold.
        fault: String,
    },
    /// The file requires a glTF extension that is not read here.
    #[error("{file}: needs the glTF extension {extension}, which is not supported; {advice}", file = .file.display())]
    Extension {
        /// The scene file.
        file: PathBuf,
        /// The extension's name.
        extension: String,
        /// The way out.
        advice: &'static str,
    },
    /// A texture cannot be decoded.
    #[error("{file}: image {image} cannot be decoded: {fault}; use a PNG or JPEG", file = .file.display())]
    Image {
        /// The scene file.
        file: PathBuf,
        /// The image by name or number.
        image: String,
        /// What the decoder said.
        fault: String,
    },
    /// A vertex position is NaN or infinite.
    #[error("{file}: {place} has a vertex that is not a finite number; clean up the mesh and export it again", file = .file.display())]
    Vertex {
        /// The scene file.
        file: PathBuf,
        /// Mesh and node by name.
        place: String,
    },
    /// A node is marked as something that there is not.
    #[error("{file}: {place}: {PROPERTY} = {value}; write receiver, occluder or virtual", file = .file.display())]
    Role {
        /// The scene file.
        file: PathBuf,
        /// Node or mesh by name.
        place: String,
        /// What stands there.
        value: String,
    },
    /// There is nothing to see.
    #[error("{file}: the scene has no triangles; export at least one mesh with faces", file = .file.display())]
    NoTriangles {
        /// The scene file.
        file: PathBuf,
    },
}

/// A triangle in world space, metres; counter-clockwise seen from its front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Corners, m.
    pub positions: [Vec3; 3],
    /// Unit shading normals at the corners.
    pub normals: [Vec3; 3],
    /// Texture coordinates at the corners, the material's texture transform applied.
    pub uvs: [Vec2; 3],
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// All triangles of a scene with their materials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Triangles, none of zero area.
    pub triangles: Vec<Triangle>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Base colours, metallic and roughness.
    pub textures: Vec<Texture>,
    /// Normal maps.
    pub normal_maps: Vec<NormalMap>,
    /// Per triangle what its finish's textures need; empty if no material has any.
    pub details: Vec<Detail>,
    /// Per triangle what it is to the post; empty if all are virtual.
    pub roles: Vec<Role>,
    /// Which part of the materials is used.
    pub shading: Shading,
}

/// What the textures of a triangle's finish need beside its own coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Detail {
    /// Texture coordinates of metallic and roughness at the corners, the texture transform applied.
    pub finish_uvs: [Vec2; 3],
    /// Texture coordinates of the normal map at the corners, likewise.
    pub normal_uvs: [Vec2; 3],
    /// Tangents at the corners, world space; w tells the bitangent's side as in glTF.
    pub tangents: [Vec4; 3],
}

impl Scene {
    /// The scene under another shading.
    pub fn shaded(mut self, shading: Shading) -> Self {
        self.shading = shading;
        if shading == Shading::Gltf {
            self.textures.iter_mut().for_each(Texture::make_mipmaps);
        }
        self
    }
}

/// A scene and what of its file is left out, in words.
#[derive(Clone, Debug, Default)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// One line each.
    pub notices: Vec<String>,
}

/// Reads a `.glb` or `.gltf` file for a shading: the default scene, else the first, else every node.
///
/// # Errors
/// [`SceneError`], see its variants.
pub fn load(path: &Path, shading: Shading) -> Result<Loaded, SceneError> {
    let file = GltfFile::open(path)?;
    let mut loader = Loader { file: &file, shading, scene: Scene::default(), uses: Vec::new(), notices: Vec::new() };
    loader.materials()?;
    let document = &file.document;
    let roots: Vec<gltf::Node> = match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => scene.nodes().collect(),
        None => document.nodes().collect(),
    };
    for node in roots {
        loader.node(&node, (DMat4::IDENTITY, Role::Virtual), 0)?;
    }
    if loader.scene.triangles.is_empty() {
        return Err(SceneError::NoTriangles { file: path.to_owned() });
    }
    Ok(Loaded { scene: loader.scene.shaded(shading), notices: loader.notices })
}

struct Loader<'f> {
    file: &'f GltfFile,
    shading: Shading,
    scene: Scene,
    /// Per material.
    uses: Vec<UvUses>,
    notices: Vec<String>,
}

impl Loader<'_> {
    /// `parent`: its place in the world and its role, which a node has, too, unless it has one of its own.
    fn node(&mut self, node: &gltf::Node, parent: (DMat4, Role), depth: usize) -> Result<(), SceneError> {
        // A tree cannot be deeper than it has nodes: deeper is a cycle, which would recurse for ever.
        if depth > self.file.document.nodes().len().min(512) {
            return Err(self.file.fault(format!("node {} is its own ancestor or too deep", node.index())));
        }
        let local = node.transform().matrix().map(|column| column.map(f64::from));
        let to_world = parent.0 * DMat4::from_cols_array_2d(&local);
        let name = |name: Option<&str>, index: usize| name.map_or(format!("{index}"), |n| format!("'{n}'"));
        let own = |extras, place: String| {
            let fault = |value| SceneError::Role { file: self.file.path.clone(), place, value };
            Role::in_extras(extras).map_err(fault)
        };
        let role = own(node.extras(), format!("node {}", name(node.name(), node.index())))?.unwrap_or(parent.1);
        if let Some(mesh) = node.mesh() {
            let of_mesh = own(mesh.extras(), format!("mesh {}", name(mesh.name(), mesh.index())))?;
            let place = format!("mesh {} of node {}", name(mesh.name(), mesh.index()), name(node.name(), node.index()));
            let from = self.scene.triangles.len();
            for primitive in mesh.primitives() {
                self.primitive(&primitive, to_world, &place)?;
            }
            self.scene.mark(from, of_mesh.unwrap_or(role));
        }
        for child in node.children() {
            self.node(&child, (to_world, role), depth + 1)?;
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &gltf::Primitive, to_world: DMat4, place: &str) -> Result<(), SceneError> {
        use gltf::mesh::Mode;
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let Some(positions) = self.attribute::<3>(primitive, &gltf::Semantic::Positions, place)? else {
            return Ok(());
        };
        if primitive.get(&gltf::Semantic::Colors(0)).is_some() {
            self.notices.push(format!("{place}: vertex colours are ignored; bake them into a picture"));
        }
        let normals = self.attribute::<3>(primitive, &gltf::Semantic::Normals, place)?;
        let material = primitive.material().index().unwrap_or(self.scene.materials.len() - 1);
        let uses = self.uses.get(material).copied().unwrap_or_default();
        let uvs = self.coordinates(primitive, Some(uses.base), place)?;
        let corners = self.corners(primitive, positions.len(), place)?;
        let mesh = PlacedMesh::new(&positions, normals.as_deref(), uvs.as_deref(), to_world, uses.base.transform);
        let detailing = self.detailing(primitive, uses, normals.is_some(), place)?;
        for corner in corners {
            let triangle = match mesh.triangle(corner, material as u32) {
                Ok(Some(triangle)) => triangle,
                Ok(None) => continue,
                Err(NotFinite) => return Err(SceneError::Vertex { file: self.file.path.clone(), place: place.into() }),
            };
            if let Some(detailing) = &detailing {
                self.scene.details.resize(self.scene.triangles.len(), Detail::default());
                self.scene.details.push(detailing.of(&mesh, &triangle, corner));
            }
            self.scene.triangles.push(triangle);
        }
        Ok(())
    }

    /// What the finish's textures of a primitive need, if its material has any.
    fn detailing(
        &self,
        primitive: &gltf::Primitive,
        uses: UvUses,
        has_normals: bool,
        place: &str,
    ) -> Result<Option<Detailing>, SceneError> {
        if uses.finish.is_none() && uses.normal.is_none() {
            return Ok(None);
        }
        let tangents = match uses.normal {
            Some(_) if has_normals => self.attribute::<4>(primitive, &gltf::Semantic::Tangents, place)?,
            _ => None,
        };
        let finish_uvs = self.coordinates(primitive, uses.finish, place)?;
        let normal_uvs = self.coordinates(primitive, uses.normal, place)?;
        Ok(Some(Detailing { uses, finish_uvs, normal_uvs, tangents }))
    }

    fn coordinates(
        &self,
        primitive: &gltf::Primitive,
        wanted: Option<UvUse>,
        place: &str,
    ) -> Result<Option<Vec<[f64; 2]>>, SceneError> {
        let Some(wanted) = wanted else { return Ok(None) };
        self.attribute::<2>(primitive, &gltf::Semantic::TexCoords(wanted.set), place)
    }

    fn attribute<const N: usize>(
        &self,
        primitive: &gltf::Primitive,
        semantic: &gltf::Semantic,
        place: &str,
    ) -> Result<Option<Vec<[f64; N]>>, SceneError> {
        let Some(accessor) = primitive.get(semantic) else { return Ok(None) };
        match crate::accessor::read(&accessor, &self.file.buffers) {
            Some((values, components)) if components == N => Ok(Some(values.as_chunks::<N>().0.to_vec())),
            _ => Err(self.file.fault(format!("{place}: accessor {} lies outside its buffer", accessor.index()))),
        }
    }

    /// The corners of every triangle of a primitive as indices below `vertices`.
    fn corners(
        &self,
        primitive: &gltf::Primitive,
        vertices: usize,
        place: &str,
    ) -> Result<Vec<[usize; 3]>, SceneError> {
        use gltf::mesh::Mode;
        let indices: Vec<usize> = match primitive.indices() {
            None => (0..vertices).collect(),
            Some(accessor) => match crate::accessor::read(&accessor, &self.file.buffers) {
                Some((values, 1)) => values.iter().map(|&v| v as usize).collect(),
                _ => return Err(self.file.fault(format!("{place}: its indices lie outside their buffer"))),
            },
        };
        if let Some(index) = indices.iter().find(|&&index| index >= vertices) {
            return Err(self.file.fault(format!("{place}: index {index} of only {vertices} vertices")));
        }
        let corners = match primitive.mode() {
            Mode::TriangleStrip => {
                let turn = |(k, w): (usize, &[usize])| if k % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
                indices.windows(3).enumerate().map(turn).collect()
            }
            Mode::TriangleFan => indices.windows(2).skip(1).map(|w| [indices[0], w[0], w[1]]).collect(),
            _ => indices.as_chunks::<3>().0.to_vec(),
        };
        Ok(corners)
    }
}

/// Attributes of one primitive for its finish's textures.
struct Detailing {
    uses: UvUses,
    finish_uvs: Option<Vec<[f64; 2]>>,
    normal_uvs: Option<Vec<[f64; 2]>>,
    tangents: Option<Vec<[f64; 4]>>,
}

impl Detailing {
    fn of(&self, mesh: &PlacedMesh<'_>, triangle: &Triangle, corner: [usize; 3]) -> Detail {
        let normal_uvs = mesh.uvs(self.normal_uvs.as_deref(), corner, self.uses.normal);
        Detail {
            finish_uvs: mesh.uvs(self.finish_uvs.as_deref(), corner, self.uses.finish),
            normal_uvs,
            tangents: match &self.tangents {
                Some(own) => mesh.tangents(own, corner),
                None => tangents::of(triangle, normal_uvs),
            },
        }
    }
}

/// A vertex position is NaN or infinite.
struct NotFinite;

/// The vertices of one primitive under one node.
struct PlacedMesh<'m> {
    positions: &'m [[f64; 3]],
    normals: Option<&'m [[f64; 3]]>,
    uvs: Option<&'m [[f64; 2]]>,
    to_world: DMat4,
    normal_to_world: DMat3,
    mirrored: bool,
    uv_transform: UvTransform,
}

impl<'m> PlacedMesh<'m> {
    fn new(
        positions: &'m [[f64; 3]],
        normals: Option<&'m [[f64; 3]]>,
        uvs: Option<&'m [[f64; 2]]>,
        to_world: DMat4,
        uv_transform: UvTransform,
    ) -> Self {
        let linear = DMat3::from_mat4(to_world);
        let mirrored = linear.determinant() < 0.0;
        // Cofactors equal the inverse transpose up to a factor, and exist for flattened meshes too.
        let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        let normal_to_world = if mirrored { -cofactors } else { cofactors };
        PlacedMesh { positions, normals, uvs, to_world, normal_to_world, mirrored, uv_transform }
    }

    /// The corners in the order that keeps fronts in front.
    fn in_order(&self, [a, b, c]: [usize; 3]) -> [usize; 3] {
        if self.mirrored { [a, c, b] } else { [a, b, c] }
    }

    /// Coordinates of a triangle's corners in a texture.
    fn uvs(&self, uvs: Option<&[[f64; 2]]>, corner: [usize; 3], used: Option<UvUse>) -> [Vec2; 3] {
        let transform = used.unwrap_or_default().transform;
        self.in_order(corner).map(|c| {
            let uv = uvs.and_then(|u| u.get(c)).map_or(Vec2::ZERO, |&[u, v]| Vec2::new(u as f32, v as f32));
            transform.apply(uv)
        })
    }

    /// The file's tangents of a triangle's corners. A mirror turns the bitangent round.
    fn tangents(&self, tangents: &[[f64; 4]], corner: [usize; 3]) -> [Vec4; 3] {
        let linear = DMat3::from_mat4(self.to_world);
        self.in_order(corner).map(|c| {
            let [x, y, z, w] = tangents.get(c).copied().unwrap_or_default();
            let side = if (w < 0.0) != self.mirrored { -1.0 } else { 1.0 };
            (linear * DVec3::new(x, y, z)).normalize_or_zero().as_vec3().extend(side)
        })
    }

    /// The triangle in world space; `None` when it has no area.
    fn triangle(&self, corner: [usize; 3], material: u32) -> Result<Option<Triangle>, NotFinite> {
        let corner = self.in_order(corner);
        let world = corner.map(|c| self.to_world.transform_point3(DVec3::from(self.positions[c])).as_vec3());
        if !world.iter().all(|p| p.is_finite() && p.abs().max_element() < 1e12) {
            return Err(NotFinite);
        }
        let [a, b, c] = world.map(|p| p.as_dvec3());
        let flat = (b - a).cross(c - a);
        let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
        if flat.length() <= 1e-12 * longest {
            return Ok(None);
        }
        let flat = flat.normalize();
        let normals = corner.map(|c| {
            let own =
                self.normals.and_then(|n| n.get(c)).map(|&n| (self.normal_to_world * DVec3::from(n)).try_normalize());
            own.flatten().unwrap_or(flat).as_vec3()
        });
        let uvs = corner.map(|c| {
            let uv = self.uvs.and_then(|u| u.get(c)).map_or(Vec2::ZERO, |&[u, v]| Vec2::new(u as f32, v as f32));
            self.uv_transform.apply(uv)
        });
        Ok(Some(Triangle { positions: world, normals, uvs, material }))
    }
}

#[cfg(test)]
mod tests;
