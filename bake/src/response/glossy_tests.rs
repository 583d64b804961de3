//! Transport over glossy surfaces against appendix B's integral, and its strategies against each other.

use std::f64::consts::PI;

use glam::Vec3;
use relume_firmware::patches::PatchSet;

use super::tests::{SIZE, camera, floor, near, options, quads, spot};
use super::*;
use crate::appendix_b::Appendix;
use crate::material::{Finish, Shading};
use crate::normalmap::NormalMap;
use crate::scene::{Detail, Triangle};
use crate::texture::Wrap;

/// A glossy floor.
pub(crate) fn plane(material: &Appendix) -> Scene {
    finished(quads(&[(floor(50.0, 0.0), material.base as f32)]), material)
}

pub(crate) fn finished(mut scene: Scene, material: &Appendix) -> Scene {
    for own in &mut scene.materials {
        let (metallic, roughness) = (material.metallic as f32, material.roughness as f32);
        own.finish = Finish { metallic, roughness, ..Finish::default() };
    }
    scene.shaded(Shading::Gltf)
}

fn patches() -> PatchSet {
    PatchSet::new(64).unwrap()
}

fn tile(scene: &Scene, camera: &Camera, options: TransportOptions) -> TileResponse {
    Transport::new(scene, camera, patches(), SIZE, options).unwrap().tile(0, 0)
}

/// Mean over the covered pixels of the red response to every patch.
fn means(tile: &TileResponse) -> Vec<f64> {
    let pixels = tile.covered.len();
    let of = |patch| (0..pixels).map(|pixel| f64::from(tile.response[3 * pixel * tile.patches + patch])).sum::<f64>();
    (0..tile.patches).map(|patch| of(patch) / pixels as f64).collect()
}

/// Unit vector from the origin to the camera.
pub(crate) fn towards(camera: &Camera) -> [f64; 3] {
    let [x, y, z] = camera.position;
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// The same by quadrature over the patch.
fn response(material: &Appendix, normal: [f64; 3], view: [f64; 3], patch: usize) -> f64 {
    let (set, steps) = (patches(), 64usize);
    let at = |k: usize| (k as f32 + 0.5) / steps as f32;
    let of = |k: usize| {
        let light = set.sample(patch, [at(k % steps), at(k / steps)]).map(f64::from);
        let cosine: f64 = normal.iter().zip(light).map(|(n, l)| n * l).sum();
        material.brdf(normal, view, light) * cosine.max(0.0)
    };
    let mean = (0..steps * steps).map(of).sum::<f64>() / (steps * steps) as f64;
    mean * f64::from(set.solid_angle_sr(patch))
}

fn materials() -> impl Iterator<Item = Appendix> {
    let of = |metallic: f64| [0.1, 0.5, 1.0].map(|roughness| Appendix { base: 0.7, metallic, roughness });
    [0.0, 1.0].into_iter().flat_map(of)
}

#[test]
fn a_white_furnace_shows_the_appendix_s_integral() {
    for material in materials() {
        let eye = spot();
        let got: f64 = means(&tile(&plane(&material), &eye, options(0))).iter().sum();
        let want = material.furnace(towards(&eye));
        assert!((got / want - 1.0).abs() < 0.006, "{material:?}: {got} instead of {want}");
    }
}

#[test]
fn a_plane_under_one_patch_shows_the_formula() {
    let eye = spot();
    for material in materials() {
        let got = means(&tile(&plane(&material), &eye, options(1)));
        let total: f64 = got.iter().sum();
        for (patch, got) in got.iter().enumerate() {
            let want = response(&material, [0.0, 1.0, 0.0], towards(&eye), patch);
            assert!((got - want).abs() < 0.05 * want + 1e-3 * total, "{material:?} {patch}: {got} instead of {want}");
        }
    }
}

#[test]
fn strategies_agree() {
    // Aimed rays alone, paths alone and both: of a lobe that all of them find.
    let material = Appendix { base: 0.8, metallic: 1.0, roughness: 0.45 };
    let (eye, scene) = (spot(), plane(&material));
    let patch = mirrored_patch(&eye);
    let want = response(&material, [0.0, 1.0, 0.0], towards(&eye), patch);
    let both = means(&tile(&scene, &eye, options(1)))[patch];
    let transport = Transport::new(&scene, &eye, patches(), SIZE, options(1)).unwrap();
    let (seen, mut rng) = transport.seen(8, 8);
    let surface = seen[0].unwrap();
    let gloss = surface.gloss.unwrap();
    let (count, grid) = (1u32 << 16, Grid::new(1 << 16));
    let (mut aimed, mut followed) = (0.0f64, 0.0f64);
    for cell in 0..count {
        let direction = transport.patches.direction(patch, grid.point(cell, rng.jitter()));
        aimed += f64::from(gloss.sent_on(Vec3A::ZERO, direction, 1.0).x);
        let drawn = gloss.draw(surface.normal, Vec3A::ZERO, grid.point(cell, rng.jitter()));
        if patches().patch_of(drawn.dir_world.to_array()) == patch {
            followed += f64::from(drawn.weight.x);
        }
    }
    aimed *= f64::from(patches().solid_angle_sr(patch)) / (PI * f64::from(count));
    followed /= f64::from(count);
    for (name, got) in [("aimed", aimed), ("followed", followed), ("both", both)] {
        assert!((got / want - 1.0).abs() < 0.02, "{name}: {got} instead of {want}");
    }
}

/// The patch that a mirror in place of the floor shows.
fn mirrored_patch(eye: &Camera) -> usize {
    let [x, y, z] = towards(eye).map(|c| c as f32);
    patches().patch_of([-x, y, -z])
}

#[test]
fn a_mirror_shows_the_patch_behind_it() {
    let mirror = Appendix { base: 1.0, metallic: 1.0, roughness: 0.0 };
    let eye = camera([0.3, 0.5, 0.2], [0.0; 3], 0.02);
    let got = means(&tile(&plane(&mirror), &eye, options(0)));
    let patch = mirrored_patch(&eye);
    assert!((got[patch] - 1.0).abs() < 0.02, "{} of patch {patch}", got[patch]);
    assert!(got.iter().sum::<f64>() < 1.02);
}

/// A sphere of radius 1 about the origin.
fn sphere() -> Scene {
    let rows = 96;
    let point = |row: usize, column: usize| {
        let (down, around) = (PI * row as f64 / rows as f64, PI * column as f64 / rows as f64);
        Vec3::new((down.sin() * around.cos()) as f32, down.cos() as f32, (down.sin() * around.sin()) as f32)
    };
    let mut scene = quads(&[(floor(50.0, 0.0), 1.0)]);
    let plain = scene.triangles[0];
    scene.triangles.clear();
    for (row, column) in (0..rows).flat_map(|row| (0..2 * rows).map(move |column| (row, column))) {
        let [a, b] = [point(row, column), point(row, column + 1)];
        let [c, d] = [point(row + 1, column), point(row + 1, column + 1)];
        for positions in [[a, b, c], [b, d, c]] {
            scene.triangles.push(Triangle { positions, normals: positions, ..plain });
        }
    }
    scene
}

#[test]
fn a_mirror_sphere_shows_the_patch_behind_every_point() {
    let scene = finished(sphere(), &Appendix { base: 1.0, metallic: 1.0, roughness: 0.0 });
    let eye = Vec3::new(0.0, 0.5, 5.0);
    for patch in [3, 20, 33, 50] {
        let light = Vec3::from(patches().dir_world(patch));
        // The point whose normal halves the angle between eye and patch.
        let halved = |normal: Vec3| ((eye - normal).normalize() + light).normalize();
        let point = (0..30).fold(Vec3::Z, |normal, _| halved(normal));
        if (eye - point).dot(point) < 0.2 {
            continue;
        }
        let look = camera(eye.to_array().map(f64::from), point.to_array().map(f64::from), 0.02);
        let got = means(&tile(&scene, &look, options(0)));
        assert!((got[patch] - 1.0).abs() < 0.03, "patch {patch} from {point}: {}", got[patch]);
    }
}

#[test]
fn a_mirror_in_a_closed_white_room_is_white() {
    // A white furnace of two kinds of surface: a mirror floor, before it a white Lambert wall.
    let mut scene = super::tests::corner(1.0);
    scene.materials[0].finish = Finish { metallic: 1.0, roughness: 0.2, ..Finish::default() };
    // A coat that reflects nothing leaves the Lambert wall.
    scene.materials[1].finish = Finish { coat_f0: [0.0; 3], coat_f90: 0.0, ..Finish::default() };
    let tile = tile(
        &scene.shaded(Shading::Gltf),
        &super::tests::into_the_corner(),
        TransportOptions { paths: 16, ..options(0) },
    );
    let got: f64 = means(&tile).iter().sum();
    // What a roughness of 0.2 loses to masking is below a hundredth.
    assert!((got - 1.0).abs() < 0.02, "{got}");
}

/// A floor with a normal map that leans every normal by `slope` towards +X.
pub(crate) fn mapped(material: &Appendix, slope: f32) -> Scene {
    let mut scene = plane(material);
    let code = |v: f32| ((v + 1.0) * 127.5).round() as u8;
    let lean = Vec3::new(slope, 0.0, 1.0).normalize();
    let texels = [[code(lean.x), 128, code(lean.z), 255]; 4];
    scene.normal_maps.push(NormalMap::new(2, 2, &texels, [Wrap::Repeat; 2]).unwrap());
    scene.materials[0].finish.normal_map = Some((0, 1.0));
    let detail = |_: &Triangle| Detail { tangents: [Vec3::X.extend(1.0); 3], ..Detail::default() };
    scene.details = scene.triangles.iter().map(detail).collect();
    scene
}

#[test]
fn a_normal_map_is_a_tilted_plane() {
    for material in
        [Appendix { base: 0.7, metallic: 0.0, roughness: 0.3 }, Appendix { base: 0.7, metallic: 1.0, roughness: 0.4 }]
    {
        let eye = camera([0.1, 0.8, 0.2], [0.0; 3], 0.1);
        let got = means(&tile(&mapped(&material, 0.25), &eye, options(1)));
        let lean = Vec3::new(0.25, 0.0, 1.0).normalize();
        // Codes round the slope.
        let rounded = |v: f32| f64::from(((v + 1.0) * 127.5).round() / 127.5 - 1.0);
        let (x, y) = (rounded(lean.x), rounded(lean.z));
        let normal = [x / x.hypot(y), y / x.hypot(y), 0.0];
        let total: f64 = got.iter().sum();
        for patch in (0..64).filter(|&patch| patches().dir_world(patch)[1] > 0.35) {
            let want = response(&material, normal, towards(&eye), patch);
            let got = got[patch];
            assert!((got - want).abs() < 0.05 * want + 2e-3 * total, "{material:?} {patch}: {got} instead of {want}");
        }
    }
}

#[test]
fn a_steep_normal_map_lets_no_light_through_and_none_out_of_nothing() {
    let eye = camera([0.6, 0.2, 0.1], [0.0; 3], 0.1);
    for (metallic, roughness) in [(1.0, 0.1), (0.0, 0.3), (1.0, 0.8)] {
        let material = Appendix { base: 1.0, metallic, roughness };
        let got = means(&tile(&mapped(&material, -1.5), &eye, options(0)));
        let below: f64 = (64..got.len()).map(|patch| got[patch]).sum();
        let total: f64 = got.iter().sum();
        assert!(below == 0.0, "{below} from below");
        assert!((0.2..1.1).contains(&total), "{material:?}: {total}");
    }
}

#[test]
fn the_two_ends_of_a_path_may_be_swapped() {
    // Patch A seen from direction B against patch B seen from direction A: one low, one high, both small.
    let set = PatchSet::new(1024).unwrap();
    let low = Vec3::new(0.9, 0.25, 0.2).normalize();
    let high = Vec3::new(-0.3, 0.9, 0.1).normalize();
    let [low, high] = [low, high].map(|dir| set.patch_of(dir.to_array()));
    for material in materials().filter(|material| material.roughness > 0.2) {
        let scene = plane(&material);
        let got = [(low, high), (high, low)].map(|(eye, patch)| {
            let eye = camera(set.dir_world(eye).map(|c| 5.0 * f64::from(c)), [0.0; 3], 0.01);
            let tile = Transport::new(&scene, &eye, set, SIZE, options(1)).unwrap().tile(0, 0);
            means(&tile)[patch] / f64::from(set.dir_world(patch)[1] * set.solid_angle_sr(patch))
        });
        near(got[0] as f32, got[1] as f32, 0.03);
    }
}
