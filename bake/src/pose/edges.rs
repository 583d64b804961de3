//! The lines that a draughtsman would draw of a scene: open borders, creases and silhouettes, where nothing hides them.

use crate::camera::CameraView;
use crate::geometry::Geometry;
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Faces that meet at a larger angle make a crease: its cosine (25 degrees).
const CREASE: f32 = 0.906;
/// Corners nearer to each other than this share of the scene's diagonal are one.
const SAME: f32 = 1e-6;
/// Pieces of an edge whose length in the picture is found first, and the length of those that are drawn, px.
const PIECES: u32 = 16;
const PIECE_PX: f64 = 2.0;
/// Most drawn pieces of a first piece.
const FINEST: f64 = 512.0;
/// What is nearer than an edge by more than this share of its distance hides it.
const BEFORE: f32 = 2e-3;

/// Two positions in the picture, px, with a straight line between them.
pub type Line = [[f64; 2]; 2];

type Cell = [i64; 3];

/// An edge and the faces at it.
#[derive(Clone, Copy, Debug)]
struct Edge {
    ends: [Vec3; 2],
    /// Normal of the first face, and of the second as if both were wound alike.
    normals: [Vec3; 2],
    faces: u32,
    forwards: bool,
}

impl Edge {
    /// Is it seen as a line from `eye`?
    fn is_drawn(&self, eye: Vec3) -> bool {
        if self.faces != 2 {
            return true;
        }
        let [first, second] = self.normals;
        let towards = eye - self.ends[0];
        first.dot(second) < CREASE || (first.dot(towards) > 0.0) != (second.dot(towards) > 0.0)
    }
}

/// The lines of `scene` in the picture of `view`, `size` (width, height) in px.
pub fn lines(scene: &Scene, geometry: &Geometry<'_>, view: &CameraView, size: [u32; 2]) -> Vec<Line> {
    let eye = view.position.as_vec3();
    let drawn: Vec<Edge> = edges(scene, geometry).into_iter().filter(|edge| edge.is_drawn(eye)).collect();
    drawn.par_iter().flat_map_iter(|edge| visible(edge, geometry, view, size)).collect()
}

fn edges(scene: &Scene, geometry: &Geometry<'_>) -> Vec<Edge> {
    let cell_m = (SAME * geometry.diagonal()).max(f32::MIN_POSITIVE);
    let cell = |p: Vec3| -> Cell { p.to_array().map(|c| (f64::from(c) / f64::from(cell_m)).round() as i64) };
    let mut found: HashMap<[Cell; 2], Edge> = HashMap::with_capacity(2 * scene.triangles.len());
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.positions;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for ends in [[a, b], [b, c], [c, a]] {
            let [from, to] = ends.map(cell);
            if from == to {
                continue;
            }
            let forwards = from < to;
            let key = if forwards { [from, to] } else { [to, from] };
            let new = Edge { ends, normals: [normal; 2], faces: 0, forwards };
            let edge = found.entry(key).or_insert(new);
            edge.faces += 1;
            if edge.faces == 2 {
                // Neighbours that are wound alike run along their edge in opposite directions.
                edge.normals[1] = if edge.forwards == forwards { -normal } else { normal };
            }
        }
    }
    found.into_values().collect()
}

/// The parts of an edge that the camera sees.
fn visible(edge: &Edge, geometry: &Geometry<'_>, view: &CameraView, size: [u32; 2]) -> Vec<Line> {
    let [from, to] = edge.ends.map(|end| end.as_dvec3());
    let at = |share: f64| from.lerp(to, share);
    let within = |p: [f64; 2]| (0..2).all(|c| p[c] >= -1.0 && p[c] <= f64::from(size[c]) + 1.0);
    let seen = |place: DVec3| {
        let position = view.project(place).filter(|&p| within(p))?;
        let along = (place - view.position).as_vec3a();
        let distance = along.length();
        let hit = geometry.closest(view.position.as_vec3a(), along / distance, 0);
        hit.is_none_or(|hit| hit.distance > distance * (1.0 - BEFORE)).then_some(position)
    };
    let mut lines = Vec::new();
    for piece in 0..PIECES {
        let [low, high] = [piece, piece + 1].map(|k| f64::from(k) / f64::from(PIECES));
        let Some([a, b]) = view.project(at(low)).zip(view.project(at(high))).map(|(a, b)| [a, b]) else { continue };
        let middle = view.project(at(0.5 * (low + high)));
        if !(within(a) || within(b) || middle.is_some_and(within)) {
            continue;
        }
        let steps = ((a[0] - b[0]).hypot(a[1] - b[1]) / PIECE_PX).ceil().clamp(1.0, FINEST);
        let mut before = seen(at(low));
        for step in 1..=steps as u32 {
            let next = seen(at(low + (high - low) * f64::from(step) / steps));
            lines.extend(before.zip(next).map(|(a, b)| [a, b]));
            before = next;
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::tests::{camera, quads};

    /// A cube of 2 m around the origin.
    fn cube() -> Scene {
        let side = |u: Vec3, v: Vec3| {
            let out = u.cross(v);
            ([out - u - v, out + u - v, out + u + v, out - u + v], 0.5)
        };
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        let sides: Vec<([Vec3; 4], f32)> =
            (0..3).flat_map(|k| [side(axes[k], axes[(k + 1) % 3]), side(axes[(k + 1) % 3], axes[k])]).collect();
        quads(&sides)
    }

    #[test]
    fn a_cube_from_above_a_corner_has_nine_edges() {
        let scene = cube();
        let geometry = Geometry::new(&scene);
        let view = camera([6.0, 5.0, 7.0], [0.0; 3], 30.0).view(400, 400);
        let all = edges(&scene, &geometry);
        assert_eq!(all.iter().filter(|edge| edge.is_drawn(view.position.as_vec3())).count(), 12);
        let length = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let drawn: f64 = lines(&scene, &geometry, &view, [400, 400]).iter().map(|[a, b]| length(*a, *b)).sum();
        // The three edges at the far corner are hidden.
        let corner = |x: f64, y: f64, z: f64| view.project(DVec3::new(x, y, z)).unwrap();
        let mut expected = 0.0;
        for (a, b) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let ends = [
                (corner(-1.0, a, b), corner(1.0, a, b)),
                (corner(a, -1.0, b), corner(a, 1.0, b)),
                (corner(a, b, -1.0), corner(a, b, 1.0)),
            ];
            let hidden = a < 0.0 && b < 0.0;
            expected += if hidden { 0.0 } else { ends.iter().map(|(a, b)| length(*a, *b)).sum() };
        }
        assert!((drawn / expected - 1.0).abs() < 0.02, "{drawn} {expected}");
    }

    #[test]
    fn flat_seams_are_no_edges() {
        let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let square = [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)];
        let scene = quads(&[(square, 0.5)]);
        let geometry = Geometry::new(&scene);
        let drawn = edges(&scene, &geometry).iter().filter(|edge| edge.is_drawn(Vec3::new(0.0, 5.0, 0.1))).count();
        assert_eq!(drawn, 4);
    }
}
