//! What throws the sun's shadow on the board: plain triangles with one opacity each.
//!
//! The board traces shadows without textures. Triangles whose texture has holes are therefore cut into small ones
//! here, each as opaque as the texture is on average over it.

use glam::{Vec2, Vec3};

use crate::geometry::{color_at, may_let_light_through};
use crate::scene::{Alpha, Material, Scene, Triangle};

/// A triangle that stops a share of the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunCaster {
    /// Corners, m, world space.
    pub positions: [Vec3; 3],
    /// Unit shading normals at the corners.
    pub normals: [Vec3; 3],
    /// Share of light that it stops, 0..1.
    pub opacity: f32,
}

/// Most pieces that all cut triangles of a scene give together.
const MOST_PIECES: usize = 1 << 19;
/// A triangle is cut in four at most this often.
const DEEPEST: u32 = 5;

/// The sun casters of a scene. The first `scene.triangles.len()` casters are the scene's triangles in their order; those
/// whose opacity varies have opacity 0 there, and their pieces follow at the end. Also returns for each triangle of the
/// scene the index of the caster that has its shape.
pub fn sun_casters(scene: &Scene) -> (Vec<SunCaster>, Vec<u32>) {
    let material = |t: &Triangle| scene.materials.get(t.material as usize).filter(|m| may_let_light_through(scene, m));
    let varies = |m: &Material| m.texture.is_some();
    let cut = scene.triangles.iter().filter(|t| material(t).is_some_and(varies)).count();
    let mut depth = DEEPEST;
    while depth > 0 && cut << (2 * depth) > MOST_PIECES {
        depth -= 1;
    }
    let mut casters: Vec<SunCaster> = scene
        .triangles
        .iter()
        .map(|triangle| {
            let opacity = match material(triangle) {
                None => 1.0,
                Some(material) if varies(material) => 0.0,
                Some(material) => opacity(material, material.base_color[3]),
            };
            SunCaster { positions: triangle.positions, normals: triangle.normals, opacity }
        })
        .collect();
    for triangle in &scene.triangles {
        if let Some(material) = material(triangle).filter(|m| varies(m)) {
            let cutter = Cutter { scene, triangle, material };
            cutter.cut([Vec3::X, Vec3::Y, Vec3::Z], depth, &mut casters);
        }
    }
    let own = (0..scene.triangles.len() as u32).collect();
    (casters, own)
}

fn opacity(material: &Material, alpha: f32) -> f32 {
    match material.alpha {
        Alpha::Opaque => 1.0,
        Alpha::Mask { cutoff } => f32::from(alpha >= cutoff),
        Alpha::Blend => alpha,
    }
}

struct Cutter<'s> {
    scene: &'s Scene,
    triangle: &'s Triangle,
    material: &'s Material,
}

impl Cutter<'_> {
    /// Cuts the piece with the corner weights `piece` until its opacity is uniform or it is as small as a texel.
    fn cut(&self, piece: [Vec3; 3], depth: u32, casters: &mut Vec<SunCaster>) {
        let texels = self.texels(piece);
        let (low, mean, high) = self.opacity(piece, texels);
        if high <= 0.0 {
            return;
        }
        if depth == 0 || high - low < 0.02 || texels < 1.5 {
            let triangle = self.triangle;
            let at = |corners: [Vec3; 3], w: Vec3| corners[0] * w.x + corners[1] * w.y + corners[2] * w.z;
            casters.push(SunCaster {
                positions: piece.map(|w| at(triangle.positions, w)),
                normals: piece.map(|w| at(triangle.normals, w).normalize_or(triangle.normals[0])),
                opacity: mean,
            });
            return;
        }
        let [a, b, c] = piece;
        let [ab, bc, ca] = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
        for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            self.cut(part, depth - 1, casters);
        }
    }

    /// The longest edge of a piece in texels.
    fn texels(&self, piece: [Vec3; 3]) -> f32 {
        let texture = self.material.texture.and_then(|index| self.scene.textures.get(index as usize));
        let size = texture.map_or(Vec2::ONE, |t| Vec2::new(t.size().0 as f32, t.size().1 as f32));
        let uvs = self.triangle.uvs;
        let [a, b, c] = piece.map(|w| size * (uvs[0] * w.x + uvs[1] * w.y + uvs[2] * w.z));
        a.distance(b).max(b.distance(c)).max(c.distance(a))
    }

    /// Smallest, mean and largest opacity over a lattice of points about a texel apart.
    fn opacity(&self, piece: [Vec3; 3], texels: f32) -> (f32, f32, f32) {
        let steps = (texels.min(1e4) as usize + 2).clamp(4, 64);
        let (mut low, mut sum, mut high, mut count) = (1.0f32, 0.0, 0.0f32, 0.0);
        for row in 0..steps {
            for column in 0..2 * (steps - row) - 1 {
                // Centres of the small triangles of the lattice, upright and inverted ones.
                let third = if column % 2 == 0 { 1.0 } else { 2.0 } / 3.0;
                let v = (row as f32 + third) / steps as f32;
                let u = ((column / 2) as f32 + third) / steps as f32;
                let weights = piece[0] * (1.0 - u - v) + piece[1] * u + piece[2] * v;
                let alpha = color_at(self.scene, self.material, self.triangle.uvs, weights).w;
                let value = opacity(self.material, alpha);
                (low, high) = (low.min(value), high.max(value));
                sum += value;
                count += 1.0;
            }
        }
        (low, sum / count, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Finish;
    use crate::texture::{Texture, Wrap};

    /// A unit square of two triangles whose texture is opaque in the left half, and one plain triangle.
    fn scene(alpha: Alpha) -> Scene {
        let texels = (0..64 * 64).map(|i| [255, 255, 255, if i % 64 < 32 { 255 } else { 0 }]).collect();
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let triangle = |at: [usize; 3], material| Triangle {
            positions: at.map(|k| corners[k].extend(0.0)),
            normals: [Vec3::Z; 3],
            uvs: at.map(|k| corners[k]),
            material,
        };
        let material = |texture, alpha| Material {
            name: String::new(),
            base_color: [1.0, 1.0, 1.0, 0.5],
            texture,
            alpha,
            finish: Finish::default(),
        };
        Scene {
            triangles: vec![triangle([0, 1, 2], 1), triangle([0, 1, 2], 0), triangle([0, 2, 3], 0)],
            materials: vec![material(Some(0), alpha), material(None, Alpha::Blend)],
            textures: vec![Texture::new(64, 64, texels, [Wrap::Clamp; 2]).unwrap()],
            ..Scene::default()
        }
    }

    fn area(caster: &SunCaster) -> f32 {
        let [a, b, c] = caster.positions;
        0.5 * (b - a).cross(c - a).length()
    }

    #[test]
    fn pieces_stop_as_much_light_as_the_texture() {
        for (alpha, want) in [(Alpha::Mask { cutoff: 0.25 }, 0.5), (Alpha::Blend, 0.25)] {
            let (casters, own) = sun_casters(&scene(alpha));
            assert_eq!(own, [0, 1, 2]);
            assert_eq!((casters[0].opacity, casters[1].opacity, casters[2].opacity), (0.5, 0.0, 0.0));
            let stopped: f32 = casters[3..].iter().map(|c| area(c) * c.opacity).sum();
            assert!((stopped - want).abs() < 0.01, "{alpha:?} {stopped}");
            // Nothing stands in the empty half, but for the texel that the bilinear edge takes.
            assert!(casters[3..].iter().all(|c| c.positions.iter().any(|p| p.x < 0.53)));
        }
    }
}
