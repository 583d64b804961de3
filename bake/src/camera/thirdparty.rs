//! The camera against OpenCV 5.0.0: its numbers are those of `tests/opencv_lens.py`.

use super::*;
use crate::material::Finish;
use crate::response::{TILE, Transport, TransportOptions};
use crate::scene::{Alpha, Material, Scene, Triangle};
use glam::{Vec2, Vec3A};
use relume_firmware::patches::PatchSet;
use std::f64::consts::{PI, TAU};

const PLACES: [[f64; 3]; 8] = [
    [0.0, 0.0, 0.0],
    [-3.0, 1.0, -2.0],
    [2.5, 4.0, -1.0],
    [-6.0, 0.5, 3.0],
    [5.5, 3.2, 4.1],
    [1.0, -2.0, 6.0],
    [-2.0, 6.5, -9.0],
    [3.4, 1.9, 8.1],
];
const RADIAL: [[f64; 2]; 8] = [
    [905.731201, 843.800226],
    [687.881944, 693.261604],
    [1243.790047, 289.589607],
    [4.931159, 801.821481],
    [1849.533441, 150.091712],
    [539.466544, 1689.302743],
    [1001.696307, 262.951792],
    [880.574594, 426.527334],
];
const KANNALA_BRANDT: [[f64; 2]; 8] = [
    [922.193121, 691.727490],
    [821.846084, 622.345534],
    [1077.684249, 436.608026],
    [527.621394, 666.677284],
    [1339.634345, 379.672014],
    [766.321189, 1046.559030],
    [966.436128, 423.886690],
    [910.393642, 499.206228],
];

const SIZE_PX: (u32, u32) = (1920, 1080);

fn cameras() -> [(Camera, [[f64; 2]; 8]); 2] {
    let of = |lens: &str| {
        let stand = r#""position":[4,1.7,9.5],"target":[-0.5,2.4,-3],"up":[0.05,1,0.02],"size_px":[1920,1080]"#;
        Camera::parse(&format!("{{{stand},{lens}}}"), Path::new("c.json")).unwrap()
    };
    let radial = r#""focal_px":1412.5,"principal_px":[968.25,533.5],
        "lens":{"model":"radial","k":[-0.183,0.041,-0.006]}"#;
    let fisheye = r#""focal_px":655,"principal_px":[951,548.75],
        "lens":{"model":"kannala_brandt","k":[0.021,-0.0093,0.0031,-0.0004]}"#;
    [(of(radial), RADIAL), (of(fisheye), KANNALA_BRANDT)]
}

#[test]
fn places_are_seen_where_opencv_sees_them() {
    for (camera, expected) in cameras() {
        let view = camera.view(SIZE_PX.0, SIZE_PX.1);
        for (place, [u, v]) in PLACES.into_iter().zip(expected) {
            let [x, y] = view.project(place.into()).unwrap();
            assert!((x - u).hypot(y - v) < 2e-6, "({x}, {y}) instead of ({u}, {v})");
            let towards = (DVec3::from(place) - view.position).normalize().as_vec3();
            // A position in single precision is 1e-4 px.
            assert!(view.direction(u as f32, v as f32).unwrap().distance(towards) < 1e-6);
        }
    }
}

/// A ball of radius `radius` around each of `centres`.
fn balls(centres: &[[f64; 3]], radius: f64) -> Scene {
    let mut triangles = Vec::new();
    let corner = |centre: DVec3, row: u32, column: u32| {
        let (sin, cos) = (PI * f64::from(row) / 16.0).sin_cos();
        let (east, north) = (TAU * f64::from(column) / 32.0).sin_cos();
        (centre + radius * DVec3::new(sin * north, cos, sin * east)).as_vec3()
    };
    for centre in centres.iter().map(|&centre| DVec3::from(centre)) {
        for cell in 0..16 * 32 {
            let (row, column) = (cell / 32, cell % 32);
            let at = |down: u32, right: u32| corner(centre, row + down, column + right);
            for positions in [[at(0, 0), at(0, 1), at(1, 1)], [at(0, 0), at(1, 1), at(1, 0)]] {
                let normals = positions.map(|p| (p - centre.as_vec3()).normalize());
                triangles.push(Triangle { positions, normals, uvs: [Vec2::ZERO; 3], material: 0 });
            }
        }
    }
    let material = Material {
        name: String::new(),
        base_color: [0.5, 0.5, 0.5, 1.0],
        texture: None,
        alpha: Alpha::Opaque,
        finish: Finish::default(),
    };
    triangles.retain(|t| {
        let [a, b, c] = t.positions.map(Vec3A::from);
        (b - a).cross(c - a).length() > 0.0
    });
    Scene { triangles, materials: vec![material], ..Scene::default() }
}

/// Small balls stand in the baked picture where OpenCV puts their centres.
#[test]
fn the_baked_picture_shows_things_where_opencv_does() {
    for (camera, expected) in cameras() {
        let shown = |[u, v]: [f64; 2]| (20.0..1900.0).contains(&u) && (20.0..1060.0).contains(&v);
        let seen: Vec<usize> = (0..8).filter(|&index| shown(expected[index])).collect();
        assert!(seen.len() >= 5);
        let centres: Vec<[f64; 3]> = seen.iter().map(|&index| PLACES[index]).collect();
        let scene = balls(&centres, 0.03);
        let options = TransportOptions { max_hits: 1, direct_classes: 1, paths: 1, ..TransportOptions::default() };
        let patches = PatchSet::new(16).unwrap();
        let transport = Transport::new(&scene, &camera, patches, SIZE_PX, options).unwrap();
        for index in seen {
            let [u, v] = expected[index];
            let tile = |at: f64| ((at - 32.0).max(0.0) as u32 / TILE)..=((at + 32.0) as u32 / TILE);
            let (mut sums, mut whole) = ([0.0; 2], 0.0);
            for (tx, ty) in tile(v).flat_map(|ty| tile(u).map(move |tx| (tx, ty))) {
                let part = transport.tile(tx, ty);
                for &pixel in &part.covered {
                    let (x, y) = part.place(pixel);
                    let coverage = f64::from(part.coverage[usize::from(pixel)]);
                    sums[0] += coverage * (f64::from(x) + 0.5);
                    sums[1] += coverage * (f64::from(y) + 0.5);
                    whole += coverage;
                }
            }
            let [x, y] = sums.map(|sum| sum / whole);
            assert!(whole > 3.0 && (x - u).hypot(y - v) < 0.08, "({x}, {y}) of {whole} px instead of ({u}, {v})");
        }
    }
}
