//! Closed forms: each scene has an answer that was derived without a renderer.

pub(crate) mod alpha;

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use relume_firmware::patches::PatchSet;

use super::*;
use crate::material::Finish;
use crate::scene::{Alpha, Material, Triangle};

/// A scene of quads: corners counter-clockwise from the front, and a grey reflectance.
pub(crate) fn quads(all: &[([Vec3; 4], f32)]) -> Scene {
    let mut scene = Scene::default();
    for (corners, albedo) in all {
        let material = scene.materials.len() as u32;
        let base_color = [*albedo, *albedo, *albedo, 1.0];
        scene.materials.push(Material {
            name: String::new(),
            base_color,
            texture: None,
            alpha: Alpha::Opaque,
            finish: Finish::default(),
        });
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        for at in [[0, 1, 2], [0, 2, 3]] {
            let positions = at.map(|k: usize| corners[k]);
            scene.triangles.push(Triangle { positions, normals: [normal; 3], uvs: [Vec2::ZERO; 3], material });
        }
    }
    scene
}

/// A horizontal square of half side `half` at height `y`, front up.
pub(crate) fn floor(half: f32, y: f32) -> [Vec3; 4] {
    [[-half, half], [half, half], [half, -half], [-half, -half]].map(|[x, z]| Vec3::new(x, y, z))
}

/// A floor and a long wall of height 1 that stands on it at z = -1, front towards +Z.
pub(crate) fn corner(albedo: f32) -> Scene {
    let wall = [[-200.0, 0.0], [200.0, 0.0], [200.0, 1.0], [-200.0, 1.0]].map(|[x, y]| Vec3::new(x, y, -1.0));
    quads(&[(floor(200.0, 0.0), albedo), (wall, albedo)])
}

/// A cube of side 2 about the origin, fronts outside.
fn cube(albedo: f32) -> Scene {
    let mut sides = Vec::new();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[u, v]| {
                let mut p = [0.0; 3];
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (sign, u, v);
                Vec3::from(p)
            });
            if sign < 0.0 {
                corners.reverse();
            }
            sides.push((corners, albedo));
        }
    }
    quads(&sides)
}

pub(crate) fn camera(position: [f64; 3], target: [f64; 3], fov_y_deg: f64) -> Camera {
    Camera { position, target, up: [0.0, 1.0, 0.0], fov_y_deg, north_deg: 0.0, optics: None }
}

/// Looks at the origin from above, so narrowly that all pixels see the same point.
pub(crate) fn spot() -> Camera {
    camera([0.3, 0.5, 0.2], [0.0; 3], 0.1)
}

/// Sees the floor and the foot of the wall of [`corner`], and nothing else.
pub(crate) fn into_the_corner() -> Camera {
    camera([0.0, 0.4, 0.5], [0.0, 0.2, -1.0], 30.0)
}

pub(crate) const SIZE: (u32, u32) = (16, 16);

pub(crate) fn options(max_hits: u32) -> TransportOptions {
    TransportOptions { max_hits, ..TransportOptions::default() }
}

/// Many paths, so that their noise stays far below what a test would tell.
fn finer(max_hits: u32) -> TransportOptions {
    TransportOptions { paths: 16, patch_group: 4, ..options(max_hits) }
}

pub(crate) fn tile(scene: &Scene, camera: &Camera, options: TransportOptions) -> TileResponse {
    Transport::new(scene, camera, patches(), SIZE, options).unwrap().tile(0, 0)
}

fn patches() -> PatchSet {
    PatchSet::new(64).unwrap()
}

/// Mean over the tile's covered pixels of the red response to `patch`.
pub(crate) fn mean(tile: &TileResponse, values: &[f32], patch: usize) -> f32 {
    let pixels = tile.covered.len();
    (0..pixels).map(|pixel| values[3 * pixel * tile.patches + patch]).sum::<f32>() / pixels as f32
}

/// Mean over the tile's covered pixels of the red response to a sky of radiance 1.
pub(crate) fn under_white_sky(tile: &TileResponse, values: &[f32]) -> f32 {
    (0..tile.patches).map(|patch| mean(tile, values, patch)).sum()
}

pub(crate) fn near(got: f32, want: f32, tolerance: f32) {
    assert!((got / want - 1.0).abs() < tolerance, "{got} instead of {want}");
}

#[test]
fn a_plane_answers_each_patch_with_its_cosine() {
    let tile = tile(&quads(&[(floor(50.0, 0.0), 0.6)]), &spot(), options(0));
    let set = patches();
    for patch in 0..set.len() {
        // A patch is uniform in height, so its mean cosine to +Y is its middle height.
        let cosine = set.sample(patch, [0.5, 0.5])[1].max(0.0);
        let want = 0.6 / PI * cosine * set.solid_angle_sr(patch);
        let got = mean(&tile, &tile.response, patch);
        assert!((got - want).abs() < 0.04 * want + 1e-6, "patch {patch}: {got} instead of {want}");
    }
    near(under_white_sky(&tile, &tile.response), 0.6, 1e-3);
    assert!(tile.indirect.iter().all(|&v| v == 0.0));
    assert!(tile.coverage.iter().all(|&a| a == 1.0));
}

#[test]
fn a_convex_body_in_a_white_furnace_shows_its_reflectance() {
    let tile = tile(&cube(0.7), &camera([3.0, 4.0, 6.0], [0.0; 3], 25.0), options(0));
    let mut edges = 0;
    for (pixel, &index) in tile.covered.iter().enumerate() {
        let own = &tile.response[3 * pixel * tile.patches..][..tile.patches];
        let coverage = tile.coverage[usize::from(index)];
        if coverage == 1.0 {
            near(own.iter().sum::<f32>(), 0.7, 0.1);
        }
        edges += usize::from(coverage < 1.0);
    }
    let mean_coverage = tile.coverage.iter().sum::<f32>() / tile.covered.len() as f32;
    near(under_white_sky(&tile, &tile.response), 0.7 * mean_coverage, 0.005);
    assert!(edges > 10, "the view must show silhouettes");
}

#[test]
fn white_walls_vanish_in_a_white_furnace() {
    // Reflectance 1 and radiance 1 from everywhere: every surface shows radiance 1, whatever its shape.
    let tile = tile(&corner(1.0), &into_the_corner(), finer(0));
    near(under_white_sky(&tile, &tile.response), 1.0, 0.01);
    assert!(under_white_sky(&tile, &tile.indirect) > 0.1);
}

#[test]
fn a_corner_has_the_form_factor_of_the_textbook() {
    // Point at distance 1 before an endless wall of height 1 that stands upright on its plane.
    let form_factor = 0.5 * (1.0 - 1.0 / 2.0f32.sqrt());
    let tile = tile(&corner(0.5), &spot(), options(2));
    // The wall sees half of the upper sky with its cosine: irradiance pi / 2.
    near(under_white_sky(&tile, &tile.indirect), 0.5 * form_factor * 0.5 * 0.5, 0.02);
    let direct = under_white_sky(&tile, &tile.response) - under_white_sky(&tile, &tile.indirect);
    near(direct, 0.5 * (1.0 - form_factor), 0.01);
}

#[test]
fn a_plate_takes_its_form_factor_from_the_sky() {
    let tile = tile(&quads(&[(floor(50.0, 0.0), 0.5), (floor(1.0, 2.0), 0.5)]), &spot(), options(1));
    // Four equal rectangles about the normal, each with sides 1 x 1 at distance 2.
    let side = 0.5f32;
    let root = (1.0 + side * side).sqrt();
    let form_factor = 4.0 / (2.0 * PI) * 2.0 * side / root * (side / root).atan();
    near(under_white_sky(&tile, &tile.response), 0.5 * (1.0 - form_factor), 2e-3);
}

#[test]
fn roulette_agrees_with_a_fixed_number_of_hits() {
    let [roulette, fixed] = [0, 40].map(|hits| tile(&corner(0.8), &into_the_corner(), finer(hits)));
    let [roulette, fixed] = [roulette, fixed].map(|tile| under_white_sky(&tile, &tile.indirect));
    near(roulette, fixed, 0.02);
}

#[test]
fn hits_are_counted_from_the_seen_surface() {
    let light = [1, 2, 3].map(|hits| {
        let tile = tile(&corner(0.8), &into_the_corner(), options(hits));
        under_white_sky(&tile, &tile.indirect)
    });
    assert_eq!(light[0], 0.0);
    assert!(light[1] > 0.0 && light[2] > 1.1 * light[1], "{light:?}");
}

#[test]
fn threads_do_not_matter_and_seeds_do() {
    use rayon::prelude::*;
    let (scene, eye) = (cube(0.5), camera([3.0, 4.0, 6.0], [0.0; 3], 30.0));
    let bake = |threads: usize, seed: u64| {
        let options = TransportOptions { seed, ..options(0) };
        let transport = Transport::new(&scene, &eye, patches(), (40, 24), options).unwrap();
        let (across, down) = transport.tiles();
        let tiles = || (0..across * down).into_par_iter().map(|t| transport.tile(t % across, t / across)).collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(tiles)
    };
    let one: Vec<TileResponse> = bake(1, 1);
    assert_eq!((one.len(), one[2].w, one[5].h), (6, 8, 8));
    assert_eq!(one, bake(3, 1));
    assert_ne!(one, bake(1, 2));
}

#[test]
fn hopeless_views_are_refused() {
    let scene = cube(0.5);
    let view = |camera: Camera, size| Transport::new(&scene, &camera, patches(), size, options(0)).err();
    let outside = camera([3.0, 4.0, 6.0], [0.0; 3], 30.0);
    assert_eq!(view(outside, SIZE), None);
    assert!(matches!(view(outside, (0, 16)), Some(TransportError::Size { width: 0, height: 16 })));
    let away = camera([3.0, 4.0, 6.0], [6.0, 8.0, 12.0], 30.0);
    assert!(matches!(view(away, SIZE), Some(TransportError::NothingSeen { .. })));
    let inside = camera([0.2, 0.1, 0.0], [0.0, 0.0, -1.0], 60.0);
    assert!(matches!(view(inside, SIZE), Some(TransportError::InsideWall { .. })));
    let touching = camera([0.0, 0.0, 1.0005], [0.0; 3], 60.0);
    assert!(matches!(view(touching, SIZE), Some(TransportError::InsideWall { .. })));
    let empty = Scene::default();
    let none = Transport::new(&empty, &outside, patches(), SIZE, options(0)).err();
    assert_eq!(none, Some(TransportError::NoTriangles));
}
