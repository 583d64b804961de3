//! Held-out light around a small thing: none of it is of the kind that the prior is made of (prior/around.rs).

use super::{TestSky, strata};
use relume_firmware::patches::PatchSet;

/// Lights that are shown alone.
const LONE: usize = 3;

type Vec3 = [f64; 3];

/// An even room, one with a window, one with lamps.
pub(super) fn rooms(set: &PatchSet) -> Vec<TestSky> {
    let axis = set.horizon().unwrap_or([0.0, 1.0, 0.0]).map(f64::from);
    let (a, b) = beside(axis);
    let towards = |u: f64, v: f64, w: f64| unit(std::array::from_fn(|k| u * a[k] + v * b[k] + w * axis[k]));
    let window = towards(0.9, 0.3, 0.7);
    let lamps = [(towards(-0.8, 0.4, 0.6), [9.0, 7.0, 4.0]), (towards(0.2, -1.0, 0.9), [30.0, 32.0, 36.0])];
    let near = |dir: Vec3, to: Vec3| dot(dir, to).clamp(-1.0, 1.0).acos();
    let even = |_: Vec3| [1.0; 3];
    let windowed = |dir: Vec3| {
        // A soft-edged square of about 50 degrees.
        let edge = |off: f64| 1.0 / (1.0 + ((off.abs() - 0.43) * 40.0).exp());
        let (right, up) = beside(window);
        let ahead = dot(dir, window).max(1e-3);
        let seen = edge(dot(dir, right) / ahead) * edge(dot(dir, up) / ahead);
        let open = if dot(dir, window) > 0.0 { seen } else { 0.0 };
        [0.3 + 5.0 * open, 0.28 + 6.0 * open, 0.25 + 7.0 * open]
    };
    let lit = |dir: Vec3| {
        let add = |sum: Vec3, (to, rgb): &(Vec3, Vec3)| {
            let share = if near(dir, *to) < 0.1 { 1.0 } else { 0.0 };
            std::array::from_fn(|c| sum[c] + share * rgb[c])
        };
        lamps.iter().fold([0.2; 3], add)
    };
    let of = |name: &str, light: &dyn Fn(Vec3) -> Vec3| {
        let radiance = (0..set.len()).map(|patch| mean_around(set, patch, light)).collect();
        TestSky { name: name.to_owned(), radiance }
    };
    vec![of("even room", &even), of("room with a window", &windowed), of("room with lamps", &lit)]
}

/// Some of the set's own lights, one at a time.
pub(super) fn lone_lights(set: &PatchSet) -> Vec<TestSky> {
    let places = (0..LONE.min(set.len())).map(|k| (2 * k + 1) * set.len() / (2 * LONE.min(set.len())));
    let alone = |patch: usize| {
        let mut radiance = vec![[0.0; 3]; set.len()];
        radiance[patch] = [1.0; 3];
        TestSky { name: format!("patch {patch} alone"), radiance }
    };
    places.map(alone).collect()
}

fn mean_around(set: &PatchSet, patch: usize, light: &dyn Fn(Vec3) -> Vec3) -> [f32; 3] {
    let side = strata(set, patch);
    let at = |k: usize| (k as f32 + 0.5) / side as f32;
    let mut sum = [0.0; 3];
    for k in 0..side * side {
        let rgb = light(set.sample(patch, [at(k / side), at(k % side)]).map(f64::from));
        sum = std::array::from_fn(|c| sum[c] + rgb[c] / (side * side) as f64);
    }
    sum.map(|v| v as f32)
}

fn beside(v: Vec3) -> (Vec3, Vec3) {
    let axis = if v[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let a = unit(cross(axis, v));
    (a, cross(v, a))
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: Vec3) -> Vec3 {
    let length = dot(v, v).sqrt();
    v.map(|c| c / length)
}
