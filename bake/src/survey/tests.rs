//! Scenes with one fault each, and the same without it.

use super::*;
use crate::camera::Camera;
use crate::response::tests::{camera, quads};
use glam::Vec3;

const SIZE: (u32, u32) = (96, 96);

/// A box from `low` to `high`, fronts outside, on a ground at y = 0.
fn block(low: [f32; 3], high: [f32; 3], albedo: f32) -> Scene {
    let at = |x: usize, y: usize, z: usize| Vec3::new([low, high][x][0], [low, high][y][1], [low, high][z][2]);
    let sides = [
        [at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)],
        [at(1, 0, 0), at(0, 0, 0), at(0, 1, 0), at(1, 1, 0)],
        [at(1, 0, 1), at(1, 0, 0), at(1, 1, 0), at(1, 1, 1)],
        [at(0, 0, 0), at(0, 0, 1), at(0, 1, 1), at(0, 1, 0)],
        [at(0, 1, 1), at(1, 1, 1), at(1, 1, 0), at(0, 1, 0)],
        [at(0, 0, 0), at(1, 0, 0), at(1, 0, 1), at(0, 0, 1)],
    ];
    let ground = [[-90.0, 90.0], [90.0, 90.0], [90.0, -90.0], [-90.0, -90.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let quads: Vec<([Vec3; 4], f32)> = sides.into_iter().map(|side| (side, albedo)).chain([(ground, 0.3)]).collect();
    quads_of_two_materials(&quads)
}

/// The first quads share a material, the last has its own.
fn quads_of_two_materials(all: &[([Vec3; 4], f32)]) -> Scene {
    let mut scene = quads(all);
    let last = scene.materials.len() as u32 - 1;
    for triangle in &mut scene.triangles {
        triangle.material = if triangle.material == last { 1 } else { 0 };
    }
    scene.materials = vec![scene.materials[0].clone(), scene.materials[last as usize].clone()];
    scene.materials[0].name = "plaster".into();
    scene
}

fn hut(albedo: f32) -> Scene {
    block([-3.0, 0.0, -3.0], [3.0, 4.0, 3.0], albedo)
}

fn seen_by(scene: &Scene, camera: &Camera) -> Vec<Notice> {
    survey(scene, &Geometry::new(scene), &camera.view(SIZE.0, SIZE.1), (SIZE, false))
}

fn notices(scene: &Scene, position: [f64; 3]) -> Vec<Notice> {
    seen_by(scene, &camera(position, [0.0, 2.0, 0.0], 40.0))
}

const EYE: [f64; 3] = [8.0, 1.7, 9.0];

fn only(notices: &[Notice], words: &str) {
    assert!(notices.len() == 1 && notices[0].contains(words), "{notices:?}");
    assert!(!notices[0].contains('\n') && notices[0].len() < 250, "{notices:?}");
}

#[test]
fn a_sound_scene_gets_no_notice() {
    assert_eq!(notices(&hut(0.5), EYE), Vec::<Notice>::new());
}

#[test]
fn paint_whiter_than_snow_is_told() {
    only(&notices(&hut(0.95), EYE), "material 'plaster' reflects 95 %");
}

/// The hut in other units, and what is said of it where small things are usual, or not.
fn in_units(scale: f32, is_small: bool) -> Vec<Notice> {
    let mut scene = hut(0.5);
    scene.triangles.iter_mut().flat_map(|t| &mut t.positions).for_each(|p| *p *= scale);
    let camera = camera(EYE.map(|c| f64::from(scale) * c), [0.0, 2.0 * f64::from(scale), 0.0], 40.0);
    survey(&scene, &Geometry::new(&scene), &camera.view(SIZE.0, SIZE.1), (SIZE, is_small))
}

#[test]
fn units_other_than_metres_are_told() {
    // Millimetres, centimetres, inches; feet are as large as a tall building's own metres.
    for (scale, words) in [(1000.0, "away"), (100.0, "170 m above"), (39.37, "67 m above"), (0.01, "less than 0.0")] {
        let all = in_units(scale, false);
        only(&all, "glTF counts in metres");
        assert!(all[0].contains(words), "{all:?}");
    }
    assert_eq!(in_units(0.03, true), Vec::<Notice>::new(), "a coin may be near");
}

#[test]
fn faces_that_look_inwards_are_told() {
    let mut scene = hut(0.5);
    // The winding alone: what Blender's "flip" leaves where custom normals stay.
    scene.triangles.iter_mut().filter(|t| t.material == 0).for_each(|t| t.positions.swap(1, 2));
    only(&notices(&scene, EYE), "normals point into the surface");
    scene.triangles.iter_mut().filter(|t| t.material == 0).for_each(|t| t.normals = t.normals.map(|n| -n));
    only(&notices(&scene, EYE), "backs of faces");
}

#[test]
fn walls_like_paper_are_told() {
    let mut scene = hut(0.5);
    // The two sides that the camera does not see, and the floor.
    let hidden = |t: &crate::scene::Triangle| {
        let middle = t.positions.iter().sum::<Vec3>() / 3.0;
        t.material == 0 && (middle.x < -2.9 || middle.z < -2.9)
    };
    scene.triangles.retain(|t| !hidden(t));
    only(&notices(&scene, EYE), "no thickness");
}

#[test]
fn a_camera_under_the_ground_is_told() {
    let below = seen_by(&hut(0.5), &camera([8.0, -0.4, 9.0], [0.0, -0.4, 0.0], 60.0));
    assert!(below.iter().any(|notice| notice.contains("0.40 m under the ground")), "{below:?}");
    // Under a roof is not under the ground.
    assert_eq!(notices(&hut(0.5), [0.0, 1.7, 20.0]), Vec::<Notice>::new());
}
