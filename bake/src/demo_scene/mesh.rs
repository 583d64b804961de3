//! Builds triangles from quads, boxes, lathes and grids.

use glam::{Affine3A, Vec2, Vec3};

use crate::scene::Triangle;

/// Metres that one repeat of a texture covers on boxes, lathes and quads.
pub(super) const TEXTURE_M: f32 = 8.0;

/// Triangles in the making; `place` maps what is added next into the world.
pub(super) struct Mesh {
    pub triangles: Vec<Triangle>,
    pub place: Affine3A,
    /// Shifts the texture, so that equal parts do not look equal.
    pub shift: Vec2,
}

/// A corner of a smooth triangle: position, normal and texture coordinates in the part's own frame.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    pub at: Vec3,
    pub normal: Vec3,
    pub uv: Vec2,
}

impl Mesh {
    pub fn new() -> Self {
        Mesh { triangles: Vec::new(), place: Affine3A::IDENTITY, shift: Vec2::ZERO }
    }

    /// A triangle with normals; dropped when it has no area.
    pub fn smooth(&mut self, corners: [Corner; 3], material: u32) {
        let positions = corners.map(|corner| self.place.transform_point3(corner.at));
        let area = (positions[1] - positions[0]).cross(positions[2] - positions[0]);
        if area.length_squared() < 1e-14 {
            return;
        }
        let normals = corners.map(|corner| self.place.transform_vector3(corner.normal).normalize_or(Vec3::Y));
        let uvs = corners.map(|corner| corner.uv + self.shift);
        self.triangles.push(Triangle { positions, normals, uvs, material });
    }

    /// A flat triangle, counter-clockwise from outside, textured by projection along its main axis.
    pub fn flat(&mut self, at: [Vec3; 3], material: u32) {
        let normal = (at[1] - at[0]).cross(at[2] - at[0]).normalize_or(Vec3::Y);
        self.smooth(at.map(|at| Corner { at, normal, uv: projected(at, normal) }), material);
    }

    /// A flat quad, counter-clockwise from outside.
    pub fn quad(&mut self, at: [Vec3; 4], material: u32) {
        self.flat([at[0], at[1], at[2]], material);
        self.flat([at[0], at[2], at[3]], material);
    }

    /// A box between two corners.
    pub fn block(&mut self, low: Vec3, high: Vec3, material: u32) {
        let corner = |bits: u8| {
            let pick = |bit: u8, low: f32, high: f32| if bits & bit == 0 { low } else { high };
            Vec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z))
        };
        for face in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            self.quad(face.map(corner), material);
        }
    }

    /// A box by its middle and full size.
    pub fn block_at(&mut self, middle: Vec3, size: Vec3, material: u32) {
        self.block(middle - 0.5 * size, middle + 0.5 * size, material);
    }

    /// A prism: the polygon `outline` (x, y; counter-clockwise seen from +z) from `z0` to `z1`. Convex.
    pub fn prism(&mut self, outline: &[Vec2], z0: f32, z1: f32, material: u32) {
        let count = outline.len();
        for index in 0..count {
            let (a, b) = (outline[index], outline[(index + 1) % count]);
            self.quad([a.extend(z0), b.extend(z0), b.extend(z1), a.extend(z1)], material);
        }
        for index in 1..count.saturating_sub(1) {
            let (a, b, c) = (outline[0], outline[index], outline[index + 1]);
            self.flat([a.extend(z1), b.extend(z1), c.extend(z1)], material);
            self.flat([a.extend(z0), c.extend(z0), b.extend(z0)], material);
        }
    }

    /// A surface `of(column, row)` over a grid of `columns x rows` cells; `u` to the right and `v` up give the outside.
    pub fn grid(&mut self, columns: usize, rows: usize, material: u32, of: impl Fn(usize, usize) -> Corner) {
        for row in 0..rows {
            for column in 0..columns {
                let corners = [of(column, row), of(column + 1, row), of(column + 1, row + 1), of(column, row + 1)];
                self.smooth([corners[0], corners[1], corners[2]], material);
                self.smooth([corners[0], corners[2], corners[3]], material);
            }
        }
    }

    /// A solid of revolution about y: `profile` holds (radius, height) from below to above.
    pub fn lathe(&mut self, profile: &[Vec2], sides: usize, material: u32) {
        for pair in profile.windows(2) {
            let (low, high) = (pair[0], pair[1]);
            let slope = (low.x - high.x) / (high - low).length().max(1e-6);
            self.grid(sides, 1, material, |side, row| {
                let turn = -(side as f32) / sides as f32 * std::f32::consts::TAU;
                let out = Vec3::new(turn.cos(), 0.0, turn.sin());
                let at = if row == 0 { low } else { high };
                let flat = (1.0 - slope * slope).max(0.0).sqrt();
                let uv = Vec2::new(-turn * low.x.max(high.x), at.y) / TEXTURE_M;
                Corner { at: out * at.x + Vec3::Y * at.y, normal: out * flat + Vec3::Y * slope, uv }
            });
        }
    }
}

/// Texture coordinates of a flat part: metres along the two axes across its main one, v downwards as in pictures.
fn projected(at: Vec3, normal: Vec3) -> Vec2 {
    let size = normal.abs();
    let across = if size.y >= size.x && size.y >= size.z {
        Vec2::new(at.x, at.z)
    } else if size.x >= size.z {
        Vec2::new(at.z, -at.y)
    } else {
        Vec2::new(at.x, -at.y)
    };
    across / TEXTURE_M
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume by the divergence theorem: positive only when every face looks outwards.
    fn volume(mesh: &Mesh) -> f32 {
        mesh.triangles.iter().map(|t| t.positions[0].dot(t.positions[1].cross(t.positions[2])) / 6.0).sum()
    }

    #[test]
    fn boxes_and_prisms_face_outwards_and_are_closed() {
        let mut mesh = Mesh::new();
        mesh.block(Vec3::new(-1.0, 2.0, 3.0), Vec3::new(1.0, 5.0, 7.0), 0);
        assert!((volume(&mesh) - 24.0).abs() < 1e-4);
        let mut mesh = Mesh::new();
        mesh.prism(&[Vec2::ZERO, Vec2::new(2.0, 0.0), Vec2::new(0.0, 1.0)], -1.0, 2.0, 0);
        assert!((volume(&mesh) - 3.0).abs() < 1e-5);
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.positions;
            assert!((b - a).cross(c - a).normalize().dot(triangle.normals[0]) > 0.999);
        }
    }

    #[test]
    fn a_lathe_faces_outwards() {
        let mut mesh = Mesh::new();
        mesh.lathe(&[Vec2::new(0.0, 0.0), Vec2::new(1.0, 0.0), Vec2::new(1.0, 2.0), Vec2::new(0.0, 2.0)], 64, 0);
        assert!((volume(&mesh) / std::f32::consts::TAU - 1.0).abs() < 0.01, "{}", volume(&mesh));
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.positions;
            assert!((b - a).cross(c - a).normalize().dot(triangle.normals[0]) > 0.99);
        }
    }
}
