//! The Doric order: column, entablature and its ornament. Lengths in metres.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Vec2, Vec3};

use super::mesh::{Corner, Mesh, TEXTURE_M};
use super::stone::material::STONE;

/// Lower and upper radius of the shaft.
const RADII: [f32; 2] = [0.50, 0.39];
/// Heights of shaft, echinus and abacus.
const SHAFT: f32 = 5.40;
const ECHINUS: f32 = 0.34;
const ABACUS: f32 = 0.26;
/// A column with its capital.
pub(super) const COLUMN: f32 = SHAFT + ECHINUS + ABACUS;
const FLUTES: usize = 20;
const FLUTE_DEPTH: f32 = 0.075;
/// Heights of architrave and frieze.
pub(super) const ARCHITRAVE: f32 = 0.82;
pub(super) const FRIEZE: f32 = 0.88;

/// Radius of the shaft at a share of its height: tapering, with the swelling the Greeks called entasis.
fn radius(share: f32) -> f32 {
    RADII[0] + (RADII[1] - RADII[0]) * share + 0.014 * (PI * share).sin()
}

/// A fluted shaft from `low` to `high` (shares of its height), its axis on y, its lower end at y = 0.
pub(super) fn shaft(mesh: &mut Mesh, low: f32, high: f32) {
    const CUTS: usize = 2;
    let rows = (4.0 * (high - low)).ceil().max(1.0) as usize;
    for flute in 0..FLUTES {
        mesh.grid(CUTS, rows, STONE, |cut, row| {
            let share = low + (high - low) * row as f32 / rows as f32;
            let part = cut as f32 / CUTS as f32;
            // A flute is a shallow trough between two sharp arrises; d/dangle gives its normal.
            let hollow = 1.0 - FLUTE_DEPTH * (PI * part).sin();
            let slope = -FLUTE_DEPTH * PI * (PI * part).cos() * FLUTES as f32 / TAU;
            let angle = (flute as f32 + part) / FLUTES as f32 * TAU;
            let (out, along) = (Vec3::new(angle.cos(), 0.0, -angle.sin()), Vec3::new(-angle.sin(), 0.0, -angle.cos()));
            let taper = (radius(share + 0.01) - radius(share - 0.01)) / (0.02 * SHAFT);
            let normal = out * hollow - along * slope - Vec3::Y * taper;
            let at = out * (radius(share) * hollow) + Vec3::Y * ((share - low) * SHAFT);
            let uv = Vec2::new(angle * RADII[0], -share * SHAFT) / TEXTURE_M;
            Corner { at, normal: normal.normalize(), uv }
        });
    }
}

/// A broken or cut shaft with flat, slightly rough ends.
pub(super) fn drum(mesh: &mut Mesh, low: f32, high: f32) {
    shaft(mesh, low, high);
    let height = (high - low) * SHAFT;
    let (below, above) = (radius(low) * 0.97, radius(high) * 0.97);
    mesh.lathe(&[Vec2::new(0.0, 0.01), Vec2::new(below, 0.0)], FLUTES, STONE);
    mesh.lathe(
        &[Vec2::new(above, height), Vec2::new(0.4 * above, height + 0.05), Vec2::new(0.0, height)],
        FLUTES,
        STONE,
    );
}

/// Echinus and abacus on y = 0.
pub(super) fn capital(mesh: &mut Mesh) {
    let neck = RADII[1];
    let profile =
        [[neck - 0.01, 0.0], [neck + 0.03, 0.02], [neck + 0.13, 0.14], [neck + 0.205, 0.26], [neck + 0.21, 0.33]];
    mesh.lathe(&profile.map(Vec2::from), 18, STONE);
    mesh.block_at(Vec3::Y * (ECHINUS + 0.5 * ABACUS), Vec3::new(1.22, ABACUS, 1.22), STONE);
}

/// A column on y = 0.
pub(super) fn column(mesh: &mut Mesh) {
    shaft(mesh, 0.0, 1.0);
    let place = mesh.place;
    mesh.place = place * Affine3A::from_translation(Vec3::Y * SHAFT);
    capital(mesh);
    mesh.place = place;
}

/// One straight run of the entablature's ornament along x, its face towards +z at z = 0, from the architrave's lower
/// edge at y = 0: taenia, triglyphs with regulae, mutules. `axes` are the x of triglyphs.
pub(super) fn ornament(mesh: &mut Mesh, half_length: f32, axes: &[f32]) {
    let band = |low: f32, high: f32, out: f32, half: f32| (Vec3::new(-half, low, -0.05), Vec3::new(half, high, out));
    let (low, high) = band(ARCHITRAVE - 0.10, ARCHITRAVE, 0.06, half_length + 0.06);
    mesh.block(low, high, STONE);
    let (low, high) = band(ARCHITRAVE + FRIEZE - 0.09, ARCHITRAVE + FRIEZE, 0.09, half_length + 0.09);
    mesh.block(low, high, STONE);
    for &x in axes {
        let top = ARCHITRAVE + FRIEZE - 0.09;
        mesh.block(Vec3::new(x - 0.25, ARCHITRAVE, -0.05), Vec3::new(x + 0.25, top, 0.02), STONE);
        for bar in [-0.175, 0.0, 0.175] {
            let (low, high) =
                (Vec3::new(x + bar - 0.06, ARCHITRAVE, 0.0), Vec3::new(x + bar + 0.06, top - 0.05, 0.085));
            mesh.block(low, high, STONE);
        }
        mesh.block(Vec3::new(x - 0.25, top - 0.05, 0.0), Vec3::new(x + 0.25, top, 0.09), STONE);
        let regula = ARCHITRAVE - 0.10;
        mesh.block(Vec3::new(x - 0.25, regula - 0.07, 0.0), Vec3::new(x + 0.25, regula, 0.055), STONE);
        mesh.block(Vec3::new(x - 0.27, top + 0.02, 0.05), Vec3::new(x + 0.27, top + 0.09, 0.42), STONE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shaft_tapers_swells_and_faces_outwards() {
        let straight = |share: f32| RADII[0] + (RADII[1] - RADII[0]) * share;
        assert!(radius(0.5) > straight(0.5) + 0.01 && (radius(1.0) - RADII[1]).abs() < 1e-6);
        let mut mesh = Mesh::new();
        column(&mut mesh);
        for triangle in mesh.triangles.iter().take(300) {
            let [a, b, c] = triangle.positions;
            let face = (b - a).cross(c - a).normalize();
            let middle = (a + b + c) / 3.0;
            assert!(face.dot(Vec3::new(middle.x, 0.0, middle.z)) > 0.0);
            assert!(triangle.normals.iter().all(|normal| normal.dot(face) > 0.8));
        }
        let top = mesh.triangles.iter().flat_map(|t| t.positions).map(|p| p.y).fold(0.0, f32::max);
        assert!((top - COLUMN).abs() < 1e-4);
    }
}
