//! Fits to simulated stills of known cameras.

use super::doubt::places;
use super::*;
use crate::camera::Optics;
use glam::DMat3;

/// Xorshift64* (Vigna 2016).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (std::f64::consts::TAU * self.unit()).cos()
    }
}

fn stand() -> Stand {
    let level = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let turned = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(0.12) * DMat3::from_rotation_z(0.03);
    Stand { rotation: (turned * level).transpose(), eye: DVec3::new(12.0, 1.7, -30.0) }
}

/// 4000x3000 px; the fisheye sees 95 degrees from its axis.
fn truths() -> [Model; 2] {
    let radial = Optics {
        principal_px: [2021.0, 1488.0],
        k: [-0.17, 0.06, -0.01, 0.0],
        ..Optics::ideal(Projection::Radial, [4000, 3000], 3300.0)
    };
    let fisheye = Optics {
        principal_px: [1990.0, 1512.0],
        k: [0.02, -0.006, 0.001, 0.0],
        ..Optics::ideal(Projection::KannalaBrandt, [4000, 3000], 1480.0)
    };
    [radial, fisheye].map(|optics| Model::new(stand(), &optics, 25.0))
}

/// Points all over the still of `truth`, 15 to 40 m away, with this much noise.
fn clicked(truth: &Model, count: usize, noise_px: f64, random: &mut Random) -> Vec<Point> {
    let cell = |index: usize| [(index % 4) as f64, (index / 4 % 3) as f64];
    let point = |index: usize| {
        let at = cell(index).map(|c| 1000.0 * (c + 0.05 + 0.9 * random.unit()));
        let distance = 15.0 + 25.0 * random.unit();
        let world = truth.stand.eye + truth.dir_world(at).unwrap() * distance;
        let position_px = at.map(|px| px + noise_px * random.normal());
        Point { line: index + 2, position_px, world }
    };
    (0..count).map(point).collect()
}

/// Off by: picture (rms, px), orientation (degrees), position (m).
fn off(truth: &Model, found: &Model, points: &[Point]) -> [f64; 3] {
    let (a, b) = (truth.projector(), found.projector());
    let both = places(truth, points).into_iter().filter_map(|place| a.project(place).zip(b.project(place)));
    let squares: Vec<f64> = both.map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).collect();
    let turn = glam::DQuat::from_mat3(&(truth.stand.rotation * found.stand.rotation.transpose()));
    let angle = 2.0 * turn.xyz().length().asin().to_degrees();
    let picture = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    [picture, angle, truth.stand.eye.distance(found.stand.eye)]
}

#[test]
fn exact_points_give_the_camera_itself() {
    for truth in truths() {
        let points = clicked(&truth, 36, 0.0, &mut Random(77));
        let options = Options { noise_px: 0.01, ..Options::default() };
        let found = fit(&points, truth.size_px, &options).unwrap();
        let [picture, angle, moved] = off(&truth, &found.model, &points);
        assert_eq!(found.model.projection, truth.projection);
        assert!(picture < 0.05 && angle < 0.002 && moved < 0.001, "{picture} px, {angle} degrees, {moved} m");
    }
}

#[test]
fn errors_are_as_large_as_the_fit_says() {
    let mut sums = [0.0; 3];
    let mut random = Random(20_261_128);
    let mut count = 0.0;
    for truth in truths() {
        for points_there in [12, 12, 12, 24, 24] {
            let points = clicked(&truth, points_there, 0.5, &mut random);
            let found = fit(&points, truth.size_px, &Options::default()).unwrap();
            let expected = [found.doubt.picture_px, found.doubt.orientation_deg, found.doubt.position_m];
            let errors = off(&truth, &found.model, &points);
            for (sum, (error, expected)) in sums.iter_mut().zip(errors.into_iter().zip(expected)) {
                assert!(error < 4.5 * expected, "{errors:?} off, where {expected:?} is expected");
                *sum += (error / expected).powi(2);
            }
            assert!((0.25..1.0).contains(&found.noise_px), "noise {}", found.noise_px);
            count += 1.0;
        }
    }
    let ratios = sums.map(|sum| (sum / count).sqrt());
    assert!(ratios.iter().all(|ratio| (0.5..1.7).contains(ratio)), "errors over standard errors: {ratios:?}");
}

#[test]
fn points_of_one_wall_do() {
    let [truth, _] = truths();
    let mut random = Random(5);
    let wall = DVec3::new(0.3, 0.1, 1.0).normalize();
    let forward = truth.stand.rotation.row(2);
    let middle = truth.stand.eye + 25.0 * forward;
    let mut points = clicked(&truth, 24, 0.0, &mut random);
    for point in &mut points {
        let ray = (point.world - truth.stand.eye).normalize();
        point.world = truth.stand.eye + ray * ((middle - truth.stand.eye).dot(wall) / ray.dot(wall));
        point.position_px = point.position_px.map(|px| px + 0.5 * random.normal());
    }
    let found = fit(&points, truth.size_px, &Options::default()).unwrap();
    let [picture, angle, moved] = off(&truth, &found.model, &points);
    assert!(picture < 4.0 * found.doubt.picture_px && angle < 4.0 * found.doubt.orientation_deg, "{picture} {angle}");
    assert!(moved < 4.0 * found.doubt.position_m && moved < 1.0, "{moved} m, {} expected", found.doubt.position_m);
}

#[test]
fn points_that_do_not_fit_are_named() {
    let mut random = Random(41);
    for truth in truths() {
        let mut points = clicked(&truth, 14, 0.5, &mut random);
        points[3].position_px[0] += 14.0;
        points[9].world += DVec3::new(0.0, 1.5, 0.0);
        points[12].world = truth.stand.eye - 8.0 * truth.stand.rotation.row(2);
        let found = fit(&points, truth.size_px, &Options::default()).unwrap();
        let named: Vec<usize> = found.strays().map(|seen| seen.point.line).collect();
        assert_eq!(named, [5, 11, 14]);
        assert!((10.0..20.0).contains(&found.seen[3].off_px()), "{}", found.seen[3].off_px());
        let told = found.warnings().join("\n");
        assert!(told.contains("line 5: the point is 1") && told.contains("line 11: "), "{told}");
        // What does not fit has no part in the fit.
        points.retain(|point| !named.contains(&point.line));
        let without = fit(&points, truth.size_px, &Options::default()).unwrap();
        let [picture, ..] = off(&without.model, &found.model, &points);
        assert!(picture < 0.02, "{picture}");
    }
}

#[test]
fn nonsense_is_refused_and_a_mirrored_world_told() {
    let [truth, _] = truths();
    let mut random = Random(9);
    let mut points = clicked(&truth, 14, 0.5, &mut random);
    points.iter_mut().for_each(|point| point.world.x *= -1.0);
    assert_eq!(fit(&points, truth.size_px, &Options::default()).unwrap_err(), PoseError::Mirrored);
    for point in &mut points {
        point.position_px = [4000.0 * random.unit(), 3000.0 * random.unit()];
    }
    let refused = fit(&points, truth.size_px, &Options::default()).unwrap_err();
    assert!(matches!(refused, PoseError::NoFit { count: 14, .. }), "{refused}");
}

#[test]
fn the_camera_file_shows_what_the_fit_does() {
    for truth in truths() {
        let points = clicked(&truth, 12, 0.5, &mut Random(3));
        let found = fit(&points, truth.size_px, &Options::default()).unwrap();
        let camera = Camera::parse(&found.camera(12.0).to_json(), std::path::Path::new("cam.json")).unwrap();
        assert_eq!(camera.north_deg, 12.0);
        let view = camera.view(4000, 3000);
        for point in &points {
            let [a, b] = [view.project(point.world), found.model.projector().project(point.world)].map(Option::unwrap);
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-6, "{a:?} {b:?}");
        }
    }
}
