//! The temple: six by thirteen columns on three steps, with cella, pediments and roof. Its long axis is local x.

use glam::{Affine3A, Vec2, Vec3};

use super::mesh::Mesh;
use super::noise::hash;
use super::order::{ARCHITRAVE, COLUMN, FRIEZE, column, ornament};
use super::stone::material::{ASHLAR, STONE, TILE};

/// Half lengths of the rectangle that the column axes stand on.
const AXES: Vec2 = Vec2::new(14.94, 6.10);
const COLUMNS: [usize; 2] = [13, 6];
/// From the column axes to the edge of the uppermost step, and to the entablature's face.
const EDGE: f32 = 0.66;
const FACE: f32 = 0.45;
const STEP: f32 = 0.35;
const FLOOR: f32 = 3.0 * STEP;
const ENTABLATURE: f32 = FLOOR + COLUMN;
const GEISON: f32 = ENTABLATURE + ARCHITRAVE + FRIEZE;
const EAVES: f32 = GEISON + 0.28;
/// Overhang of the geison beyond the entablature's face.
const OVERHANG: f32 = 0.55;
/// Rise over run of the roof: 14 degrees.
const SLOPE: f32 = 0.2493;

/// The whole temple around the origin of `mesh.place`, the ground at y = 0.
pub(super) fn temple(mesh: &mut Mesh) {
    for step in 0..3u8 {
        let out = AXES + EDGE + 0.40 * f32::from(2 - step);
        let top = STEP * f32::from(step + 1);
        // The lowest course goes into the ground, which is not level.
        let bottom = if step == 0 { -1.2 } else { top - STEP };
        mesh.block(Vec3::new(-out.x, bottom, -out.y), Vec3::new(out.x, top, out.y), STONE);
    }
    colonnade(mesh);
    entablature(mesh);
    cella(mesh);
    roof(mesh);
    for side in [1.0, -1.0] {
        pediment(mesh, side);
    }
}

fn stand_column(mesh: &mut Mesh, x: f32, z: f32) {
    let place = mesh.place;
    mesh.shift =
        Vec2::new(hash((x * 10.0) as i64, (z * 10.0) as i64, 1), hash((x * 10.0) as i64, (z * 10.0) as i64, 2));
    mesh.place = place * Affine3A::from_translation(Vec3::new(x, FLOOR, z));
    column(mesh);
    mesh.place = place;
    mesh.shift = Vec2::ZERO;
}

fn colonnade(mesh: &mut Mesh) {
    let [along, across] = COLUMNS;
    let at = |index: usize, count: usize, half: f32| -half + 2.0 * half * index as f32 / (count - 1) as f32;
    for index in 0..along {
        for z in [-AXES.y, AXES.y] {
            stand_column(mesh, at(index, along, AXES.x), z);
        }
    }
    for index in 1..across - 1 {
        for x in [-AXES.x, AXES.x] {
            stand_column(mesh, x, at(index, across, AXES.y));
        }
    }
}

/// Four blocks around a rectangle, between half sizes `inner` and `outer`.
fn ring(mesh: &mut Mesh, outer: Vec2, inner: Vec2, y: [f32; 2], material: u32) {
    for side in [-1.0, 1.0] {
        let (a, b) = (side * inner.y, side * outer.y);
        mesh.block(Vec3::new(-outer.x, y[0], a.min(b)), Vec3::new(outer.x, y[1], a.max(b)), material);
        let (a, b) = (side * inner.x, side * outer.x);
        mesh.block(Vec3::new(a.min(b), y[0], -inner.y), Vec3::new(a.max(b), y[1], inner.y), material);
    }
}

fn entablature(mesh: &mut Mesh) {
    ring(mesh, AXES + FACE, AXES - FACE, [ENTABLATURE, GEISON], STONE);
    // Geison and ceiling in one: nothing above it is seen from below.
    let out = AXES + FACE + OVERHANG;
    mesh.block(Vec3::new(-out.x, GEISON, -out.y), Vec3::new(out.x, EAVES, out.y), STONE);
    let place = mesh.place;
    for quarter in 0..4u8 {
        let flank = quarter % 2 == 0;
        let (half, off, columns) = if flank { (AXES.x, AXES.y, COLUMNS[0]) } else { (AXES.y, AXES.x, COLUMNS[1]) };
        // A triglyph over each column and one between; the outer ones move to the corners.
        let count = 2 * columns - 1;
        let reach = half + FACE - 0.25;
        let axes: Vec<f32> = (0..count).map(|n| -reach + 2.0 * reach * n as f32 / (count - 1) as f32).collect();
        let turn = Affine3A::from_rotation_y(f32::from(quarter) * std::f32::consts::FRAC_PI_2);
        mesh.place = place * turn * Affine3A::from_translation(Vec3::new(0.0, ENTABLATURE, off + FACE));
        ornament(mesh, half + FACE, &axes);
    }
    mesh.place = place;
}

/// The closed room: long walls that end in antae, two columns between them, a cross wall with a doorway at each end
/// (the western one walled up).
fn cella(mesh: &mut Mesh) {
    const HALF: Vec2 = Vec2::new(11.0, 3.75);
    const WALL: f32 = 0.70;
    const DOOR: Vec2 = Vec2::new(1.25, 4.9);
    let floor = FLOOR + 0.22;
    mesh.block(Vec3::new(-HALF.x - 0.3, FLOOR, -HALF.y - 0.3), Vec3::new(HALF.x + 0.3, floor, HALF.y + 0.3), STONE);
    for side in [-1.0, 1.0] {
        let (a, b) = (side * HALF.y, side * (HALF.y - WALL));
        mesh.block(Vec3::new(-HALF.x, floor, a.min(b)), Vec3::new(HALF.x, GEISON, a.max(b)), ASHLAR);
        for x in [-HALF.x + 0.2, HALF.x - 0.2] {
            stand_column(mesh, x, 1.25 * side);
        }
        let (a, b) = (side * DOOR.x, side * (HALF.y - WALL));
        mesh.block(Vec3::new(7.4, floor, a.min(b)), Vec3::new(8.0, GEISON, a.max(b)), ASHLAR);
        // The beam over antae and inner columns.
        let (a, b) = (side * (HALF.x - 0.65), side * (HALF.x + 0.15));
        let (low, high) = (Vec3::new(a.min(b), ENTABLATURE, -HALF.y), Vec3::new(a.max(b), GEISON, HALF.y));
        mesh.block(low, high, STONE);
    }
    mesh.block(Vec3::new(7.4, floor + DOOR.y, -DOOR.x), Vec3::new(8.0, GEISON, DOOR.x), ASHLAR);
    mesh.block(Vec3::new(-8.0, floor, -3.05), Vec3::new(-7.4, GEISON, 3.05), ASHLAR);
    for z in [-1.0, 1.0] {
        mesh.block_at(Vec3::new(8.03, floor + 0.5 * DOOR.y, z * (DOOR.x + 0.14)), Vec3::new(0.14, DOOR.y, 0.28), STONE);
    }
    mesh.block_at(Vec3::new(8.04, floor + DOOR.y + 0.17, 0.0), Vec3::new(0.18, 0.34, 2.0 * DOOR.x + 0.8), STONE);
}

/// Turns local z into x, so that prisms run along the temple.
fn lengthwise() -> Affine3A {
    Affine3A::from_rotation_y(std::f32::consts::FRAC_PI_2)
}

/// One slope's cross-section between heights `low` and `high` above the eaves' line.
fn slope(side: f32, low: f32, high: f32) -> [Vec2; 4] {
    let out = AXES.y + FACE + OVERHANG + 0.06;
    let ridge = EAVES + SLOPE * out;
    let section = [[side * out, EAVES + low], [side * out, EAVES + high], [0.0, ridge + high], [0.0, ridge + low]];
    let section = section.map(Vec2::from);
    if side > 0.0 { section } else { [section[3], section[2], section[1], section[0]] }
}

fn roof(mesh: &mut Mesh) {
    let place = mesh.place;
    mesh.place = place * lengthwise();
    let half = AXES.x + FACE + OVERHANG - 0.35;
    for side in [-1.0, 1.0] {
        mesh.prism(&slope(side, 0.02, 0.26), -half, half, TILE);
        let ribs = 47;
        for rib in 0..ribs {
            let z = -half + 0.3 + (2.0 * half - 0.6) * rib as f32 / (ribs - 1) as f32;
            mesh.prism(&slope(side, 0.24, 0.35), z - 0.09, z + 0.09, TILE);
            if rib % 2 == 0 {
                let edge = side * (AXES.y + FACE + OVERHANG + 0.02);
                mesh.block_at(Vec3::new(edge, EAVES + 0.36, z), Vec3::new(0.10, 0.42, 0.30), TILE);
            }
        }
    }
    mesh.place = place;
}

fn pediment(mesh: &mut Mesh, side: f32) {
    let place = mesh.place;
    mesh.place = place * Affine3A::from_rotation_y(side * std::f32::consts::FRAC_PI_2);
    let out = AXES.y + FACE + OVERHANG;
    let face = AXES.x + FACE;
    let tympanum = [[-out, EAVES], [out, EAVES], [0.0, EAVES + SLOPE * out]].map(Vec2::from);
    mesh.prism(&tympanum, face - 0.5, face - 0.12, STONE);
    for half in [-1.0, 1.0] {
        mesh.prism(&slope(half, 0.0, 0.33), face - 0.3, face + OVERHANG, STONE);
        mesh.prism(&slope(half, 0.33, 0.47), face - 0.2, face + OVERHANG + 0.10, STONE);
        // Corner acroteria.
        mesh.block_at(Vec3::new(half * (out - 0.3), EAVES + 0.75, face + 0.2), Vec3::new(0.5, 0.55, 0.5), STONE);
    }
    let ridge = EAVES + SLOPE * out + 0.4;
    mesh.block_at(Vec3::new(0.0, ridge + 0.15, face + 0.2), Vec3::new(0.9, 0.35, 0.55), STONE);
    // A palmette of seven leaves on the ridge.
    for leaf in -3..=3i8 {
        let turn = Affine3A::from_rotation_z(-f32::from(leaf) * 0.38);
        let middle = Affine3A::from_translation(Vec3::new(0.0, ridge + 0.36, face + 0.2));
        let kept = mesh.place;
        mesh.place = kept * middle * turn;
        let length = 0.95 - 0.09 * f32::from(leaf.abs());
        let outline = [[0.0, 0.0], [0.11, 0.7 * length], [0.0, length], [-0.11, 0.7 * length]].map(Vec2::from);
        mesh.prism(&outline, -0.07, 0.07, STONE);
        mesh.place = kept;
    }
    mesh.place = place;
}
