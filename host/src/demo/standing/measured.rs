//! The view camera's pose and lens, as an installer measures them: twelve marks clicked on a still, fitted as `relume-bake
//! camera` fits them, and written and read as a camera file.

use std::path::Path;

use relume_bake::camera::{Camera, CameraView, Optics, Projection};
use relume_bake::geometry::Geometry;
use relume_bake::pose::points::Point;
use relume_bake::pose::{Options, USUAL_NOISE_PX, fit};
use relume_bake::random::Random;
use relume_bake::scene::Scene;

use crate::failure::{Failure, OrFail};
use crate::outfile::write_whole;

/// Width and height of the still, px.
const STILL_PX: [u32; 2] = [1920, 1280];
/// Where the lens's axis meets the still, px off its middle.
const OFF_MIDDLE_PX: [f64; 2] = [14.0, -9.0];
/// Distortion k1..k3: a barrel, 7 % at the corners.
const K: [f64; 4] = [-0.22, 0.06, 0.0, 0.0];
/// One mark in each part of the still, across and down.
const MARKS: (u32, u32) = (4, 3);
/// Places of a part that are tried for ground or ruin before a mark is held up there, as on a pole.
const TRIES: u32 = 40;

/// The camera as it is: the pinhole's place and focal length behind a lens that distorts.
pub(super) fn true_camera(pinhole: &Camera) -> Camera {
    let [width, height] = STILL_PX.map(f64::from);
    let focal_px = 0.5 * height / (0.5 * pinhole.fov_y_deg.to_radians()).tan();
    let principal_px = [0.5 * width + OFF_MIDDLE_PX[0], 0.5 * height + OFF_MIDDLE_PX[1]];
    let optics = Optics { k: K, principal_px, ..Optics::ideal(Projection::Radial, STILL_PX, focal_px) };
    Camera { optics: Some(optics), ..*pinhole }
}

/// The camera as twelve marks on its still tell, each clicked with the usual noise, by way of the camera file `path`.
pub(super) fn measured_camera(truth: &Camera, real: &Scene, seed: u64, path: &Path) -> Result<Camera, Failure> {
    let points = marks(truth, real, &mut Random::new(seed));
    let found = fit(&points, STILL_PX, &Options::default()).or_runtime()?;
    let text = found.camera(truth.north_deg).to_json();
    write_whole(path, |file| std::io::Write::write_all(file, text.as_bytes()))?;
    Camera::load(path).or_runtime()
}

/// How far the measured camera shows the places that the true one shows from where they are, in pixels of a picture `width`
/// pixels wide: rms over the picture and the largest, at the distance of the site's middle.
pub(super) fn reprojection_px(truth: &Camera, found: &Camera, width: u32) -> [f64; 2] {
    let [a, b] = [truth, found].map(|camera| camera.view(STILL_PX[0], STILL_PX[1]));
    let distance_m = distance_m(truth);
    let scale = f64::from(width) / f64::from(STILL_PX[0]);
    let off = |step: u32| {
        let at = [(step % 25) as f32 / 24.0 * STILL_PX[0] as f32, (step / 25) as f32 / 16.0 * STILL_PX[1] as f32];
        let place = a.position + a.direction(at[0], at[1])?.as_dvec3() * distance_m;
        let seen = b.project(place)?;
        Some(scale * (seen[0] - f64::from(at[0])).hypot(seen[1] - f64::from(at[1])))
    };
    let all: Vec<f64> = (0..25 * 17).filter_map(off).collect();
    let rms = (all.iter().map(|off| off * off).sum::<f64>() / all.len().max(1) as f64).sqrt();
    [rms, all.into_iter().fold(0.0, f64::max)]
}

fn distance_m(camera: &Camera) -> f64 {
    (0..3).map(|c| (camera.target[c] - camera.position[c]).powi(2)).sum::<f64>().sqrt()
}

/// The marks, where the still shows them to whoever clicks.
fn marks(truth: &Camera, real: &Scene, chance: &mut Random) -> Vec<Point> {
    let geometry = Geometry::new(real);
    let view = truth.view(STILL_PX[0], STILL_PX[1]);
    let mut points = Vec::new();
    for part in 0..MARKS.0 * MARKS.1 {
        let (column, row) = (part % MARKS.0, part / MARKS.0);
        let mut at = [0.0; 2];
        let mut world = None;
        for _ in 0..TRIES {
            at = [(column, MARKS.0, STILL_PX[0]), (row, MARKS.1, STILL_PX[1])]
                .map(|(k, of, side)| f64::from(side) * (f64::from(k) + chance.unit()) / f64::from(of));
            world = seen(&geometry, &view, at);
            if world.is_some() {
                break;
            }
        }
        let held_up =
            view.direction(at[0] as f32, at[1] as f32).map(|dir| view.position + dir.as_dvec3() * distance_m(truth));
        let Some(world) = world.or(held_up) else { continue };
        let clicked = at.map(|px| px + USUAL_NOISE_PX * chance.normal());
        points.push(Point { line: points.len() + 1, position_px: clicked, world });
    }
    points
}

/// The place of the real site that the still shows there.
fn seen(geometry: &Geometry<'_>, view: &CameraView, at: [f64; 2]) -> Option<glam::DVec3> {
    let dir = view.direction(at[0] as f32, at[1] as f32)?;
    let hit = geometry.closest(view.position.as_vec3().into(), dir.into(), 0)?;
    Some(view.position + dir.as_dvec3() * f64::from(hit.distance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_bake::demo_scene;

    #[test]
    fn marks_with_the_usual_noise_tell_pose_and_lens() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, pinhole) = demo_scene::site();
        let (truth, real) = (true_camera(&pinhole), scene.real());
        // Whoever took the lens for a pinhole would be far off.
        assert!(reprojection_px(&truth, &pinhole, 240)[1] > 4.0);
        assert!(reprojection_px(&truth, &truth, 240)[1] < 1e-3);
        for seed in [3, 4] {
            let file = folder.path().join("camera.json");
            let found = measured_camera(&truth, &real, seed, &file).unwrap();
            let told: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
            let k1 = told["lens"]["k"][0].as_f64().unwrap();
            assert!(told["lens"]["model"] == "radial" && (-0.25..-0.15).contains(&k1), "{told}");
            let [rms, worst] = reprojection_px(&truth, &found, STILL_PX[0]);
            // Of many such stills half are off by more than 1 px rms.
            assert!(rms < 2.0 && worst < 12.0, "{rms} {worst} px of the still");
        }
    }
}
