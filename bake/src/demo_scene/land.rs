//! Around the temple: the headland it stands on, a ruin, boulders, shrubs and cypresses.

use glam::{Affine3A, Quat, Vec2, Vec3};

use super::mesh::{Corner, Mesh};
use super::noise::{fbm, hash, smoothstep};
use super::order::{capital, drum};
use super::stone::material::{ASHLAR, BARK, CYPRESS, GROUND, ROCK, SHRUB, STONE};
use super::{AIM, EYE, temple_place};

/// Half the side of the modelled land, m.
const REACH: f32 = 230.0;
const CELLS: usize = 70;
/// Metres that one repeat of the ground's texture covers.
const GROUND_M: f32 = 32.0;

/// Height of the ground at (x, z), m, world space. The temple's platform lies at 0.
pub(super) fn height(x: f32, z: f32) -> f32 {
    let local = temple_place().inverse().transform_point3(Vec3::new(x, 0.0, z));
    let outside = Vec2::new((local.x.abs() - 17.2).max(0.0), (local.z.abs() - 8.4).max(0.0)).length();
    let rolling = 2.6 * fbm(x / 46.0 + 3.1, z / 46.0, 3, 0, 201) + 0.9 * fbm(x / 11.0, z / 11.0 + 7.7, 3, 0, 211);
    let hill = 17.0 * (-((x + 150.0).powi(2) + (z + 60.0).powi(2)) / 5200.0).exp();
    let ridge = 12.0 * (-((x + 40.0).powi(2) + (z + 170.0).powi(2)) / 3600.0).exp();
    let far = (x * x + z * z).sqrt();
    let fall = 16.0 * smoothstep(60.0, 230.0, far);
    let small = 0.10 * fbm(x / 1.9, z / 1.9, 2, 0, 223);
    (rolling * 0.8 - 0.7) * smoothstep(0.5, 26.0, outside) + hill + ridge - fall + small * smoothstep(0.0, 3.0, outside)
}

/// The ground: a grid that is fine near the temple and coarse far away.
pub(super) fn terrain(mesh: &mut Mesh) {
    let warp = |index: usize, middle: f32| {
        let u = 2.0 * index as f32 / CELLS as f32 - 1.0;
        middle * (1.0 - u * u) + REACH * u * (0.20 + 0.80 * u * u)
    };
    mesh.grid(CELLS, CELLS, GROUND, |column, row| {
        // The finest cells lie between the temple and the viewpoint.
        let (x, z) = (warp(column, 14.0), warp(CELLS - row, 14.0));
        let step = 0.6;
        let slope = |dx: f32, dz: f32| height(x + dx, z + dz) - height(x - dx, z - dz);
        let normal = Vec3::new(-slope(step, 0.0), 2.0 * step, -slope(0.0, step)).normalize();
        Corner { at: Vec3::new(x, height(x, z), z), normal, uv: Vec2::new(x, z) / GROUND_M }
    });
}

/// A place on the ground, turned about y and shifted up by `lift`.
fn on_ground(x: f32, z: f32, turn_deg: f32, lift: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, height(x, z) + lift, z)) * Affine3A::from_rotation_y(turn_deg.to_radians())
}

/// The place (x, z) that lies `right` and `forward` of the viewpoint, m: what stands there is composed for the eye.
fn before_eye(right: f32, forward: f32) -> (f32, f32) {
    let ahead = (AIM - EYE).normalize();
    let at = EYE + ahead * forward + Vec2::new(-ahead.y, ahead.x) * right;
    (at.x, at.y)
}

/// What is left of an older building: stumps in a row, fallen drums, a capital, a low wall.
pub(super) fn ruin(mesh: &mut Mesh) {
    let keep = mesh.place;
    for (right, forward, share) in [(-9.4, 24.2, 0.26), (-7.7, 22.6, 0.55), (-6.0, 21.0, 0.12), (-4.2, 19.4, 0.33)] {
        let (x, z) = before_eye(right, forward);
        mesh.place = on_ground(x, z, 31.0 * x, 0.15);
        mesh.shift = Vec2::new(x, z) * 0.13;
        drum(mesh, 0.0, share);
        mesh.block_at(Vec3::new(0.0, -0.35, 0.0), Vec3::new(1.5, 0.7, 1.5), STONE);
    }
    let lying = Affine3A::from_rotation_z(-std::f32::consts::FRAC_PI_2);
    for (right, forward, turn, from, to) in [
        (-1.9, 19.0, 20.0, 0.25, 0.45),
        (-3.4, 17.4, 64.0, 0.45, 0.62),
        (-5.8, 18.2, -35.0, 0.0, 0.2),
        (6.6, 18.4, 105.0, 0.3, 0.5),
        (9.6, 19.6, 70.0, 0.5, 0.68),
    ] {
        let (x, z) = before_eye(right, forward);
        mesh.place = on_ground(x, z, turn, 0.40) * lying;
        mesh.shift = Vec2::new(z, x) * 0.17;
        drum(mesh, from, to);
    }
    let (x, z) = before_eye(4.4, 20.2);
    mesh.place = on_ground(x, z, 40.0, 0.50) * Affine3A::from_rotation_x(2.75);
    capital(mesh);
    wall(mesh);
    mesh.place = keep;
    mesh.shift = Vec2::ZERO;
}

/// A low wall of three courses, with blocks missing towards its end.
fn wall(mesh: &mut Mesh) {
    for course in 0..3i64 {
        for block in 0..11i64 {
            if hash(block, course, 301) < (block as f32 * 0.05 + course as f32 * 0.17 - 0.12) {
                continue;
            }
            let along = block as f32 * 1.05 + 0.52 * (course % 2) as f32;
            let (x, z) = before_eye(-14.4 + 0.93 * along, 32.5 - 0.36 * along);
            let jitter = Vec3::new(0.02, 0.015, 0.03) * (hash(block, course, 307) - 0.5);
            let size = Vec3::new(1.02, 0.42, 0.62 + 0.06 * hash(block, course, 311)) + jitter;
            mesh.place = on_ground(x, z, 47.0 - 21.0 + 3.0 * (hash(block, course, 313) - 0.5), 0.42 * course as f32);
            mesh.shift = Vec2::new(block as f32 * 0.31, course as f32 * 0.43);
            mesh.block_at(Vec3::Y * 0.08, size, if course == 2 { STONE } else { ASHLAR });
        }
    }
}

/// A closed lump: a sphere of `size` half axes, roughened by `rough`, its middle at the origin.
fn lump(mesh: &mut Mesh, size: Vec3, rough: f32, rings: usize, seed: u32, material: u32) {
    let point = |side: usize, row: usize| {
        let (across, up) = (side % (2 * rings), row as f32 / rings as f32);
        let turn = -(across as f32 / rings as f32) * std::f32::consts::PI;
        let fall = (up - 0.5) * std::f32::consts::PI;
        let dir = Vec3::new(fall.cos() * turn.cos(), fall.sin(), fall.cos() * turn.sin());
        let leaves =
            if material == SHRUB && row > 0 && row < rings { hash(across as i64, row as i64, seed) - 0.5 } else { 0.0 };
        let bump = fbm(2.1 * dir.x + 5.0 * dir.y, 2.1 * dir.z - 3.0 * dir.y, 3, 0, seed) + 0.5 * leaves;
        dir * size * (1.0 + rough * bump)
    };
    for row in 0..rings {
        for side in 0..2 * rings {
            let corners = [point(side, row), point(side + 1, row), point(side + 1, row + 1), point(side, row + 1)];
            mesh.flat([corners[0], corners[1], corners[2]], material);
            mesh.flat([corners[0], corners[2], corners[3]], material);
        }
    }
}

/// Boulders, stones and shrubs, scattered where neither temple nor ruin stands.
pub(super) fn scatter(mesh: &mut Mesh) {
    let keep = mesh.place;
    for index in 0..120i64 {
        let seed = 400 + index as u32;
        let (x, z) = (70.0 * hash(index, 0, 401) - 26.0, 62.0 * hash(index, 1, 401) - 18.0);
        let local = temple_place().inverse().transform_point3(Vec3::new(x, 0.0, z));
        let size = 0.09 + 0.55 * hash(index, 2, 401).powi(4);
        let free = local.x.abs() > 18.0 + size || local.z.abs() > 9.0 + size;
        let before_the_eye = (Vec2::new(x, z) - EYE).length() < 13.0;
        if !free || before_the_eye {
            continue;
        }
        mesh.place = on_ground(x, z, 360.0 * hash(index, 3, 401), 0.25 * size);
        mesh.shift = Vec2::new(x, z) * 0.1;
        if hash(index, 4, 401) < 0.62 {
            lump(mesh, Vec3::new(size, 0.62 * size, 0.8 * size), 0.8, 5, seed, ROCK);
        } else {
            let size = 0.22 + 0.8 * size;
            lump(mesh, Vec3::new(size, 0.75 * size, 0.9 * size), 1.0, 8, seed, SHRUB);
        }
    }
    mesh.place = keep;
    mesh.shift = Vec2::ZERO;
}

/// Cypresses: slim spindles with a rough outline.
pub(super) fn cypresses(mesh: &mut Mesh) {
    const TREES: [(f32, f32, f32); 5] =
        [(-27.0, 9.0, 9.5), (-30.5, 5.0, 11.5), (13.0, -17.5, 10.0), (16.8, -20.5, 8.6), (-52.0, 22.0, 9.0)];
    let keep = mesh.place;
    for (index, &(x, z, tall)) in TREES.iter().enumerate() {
        let seed = 500 + index as u32;
        let lean = Affine3A::from_quat(Quat::from_rotation_x(0.02 * (index as f32 - 3.0)));
        mesh.place = on_ground(x, z, 77.0 * index as f32, 0.0) * lean;
        mesh.lathe(&[Vec2::new(0.20, -0.4), Vec2::new(0.16, 1.2)], 8, BARK);
        let (sides, rows) = (18, 26);
        let point = |side: usize, row: usize| {
            let (up, around) = (row as f32 / rows as f32, side % sides);
            let turn = -(around as f32) / sides as f32 * std::f32::consts::TAU;
            let body = (up * std::f32::consts::PI).sin().max(0.0).powf(0.62) * (1.0 - 0.62 * up) * 0.16 * tall;
            let rough = 1.0
                + 0.55 * (hash(around as i64, row as i64, seed) - 0.5)
                + 0.5 * fbm(around as f32 * 0.5, row as f32 * 0.33, 2, 0, seed);
            let lift = 0.25 * (hash(row as i64, around as i64, seed) - 0.5);
            Vec3::new(turn.cos() * body * rough, 0.6 + up * tall + lift, turn.sin() * body * rough)
        };
        for row in 0..rows {
            for side in 0..sides {
                let corners = [point(side, row), point(side + 1, row), point(side + 1, row + 1), point(side, row + 1)];
                mesh.flat([corners[0], corners[1], corners[2]], CYPRESS);
                mesh.flat([corners[0], corners[2], corners[3]], CYPRESS);
            }
        }
    }
    mesh.place = keep;
}
