use super::*;
use crate::lens::{LensModel, ZENITH_NORTH_UP};
use crate::sun::{Place, dir_world, parse_utc, sun_position};
use crate::sunpath::parameters::{product, rotation};

/// Noise of a seed: normal deviates and choices.
struct Dice(u64);

impl Dice {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// A camera somewhere, and the days of its frames.
struct Scene {
    model: LensModel,
    k: [f64; 4],
    focal_px: f64,
    center_px: [f64; 2],
    /// Turn from level with north up: a vector, degrees.
    turned_deg: [f64; 3],
    latitude_deg: f64,
    days: &'static [&'static str],
    seed: u64,
}

const SIZE: usize = 640;

impl Scene {
    fn truth(&self) -> Lens {
        let turn = rotation(self.turned_deg.map(f64::to_radians));
        let file = LensFile {
            model: self.model,
            focal_px: self.focal_px,
            center_px: self.center_px,
            k: self.k,
            camera_to_world: product(&turn, &ZENITH_NORTH_UP),
            width: Some(SIZE),
            height: Some(SIZE),
            vignetting: [0.0; 3],
            mask: None,
        };
        file.lens("truth").unwrap()
    }

    /// A frame every four minutes: spots off by 0.35 pixels; a quarter without the sun, half of these with something else.
    fn sightings(&self) -> Vec<Sighting> {
        let (lens, mut dice) = (self.truth(), Dice(self.seed));
        let place = Place { latitude_deg: self.latitude_deg, longitude_deg: 12.0 };
        let mut sightings = Vec::new();
        for day in self.days {
            let midnight = parse_utc(&format!("{day}T00:00:00Z")).unwrap();
            for frame in 0..360 {
                let captured_at_s = midnight + 240.0 * f64::from(frame);
                let sun = sun_position(captured_at_s, place).unwrap();
                if sun.altitude_deg < MIN_ALTITUDE_DEG {
                    continue;
                }
                let sun_dir_world = dir_world(sun, 0.0).map(f64::from);
                let mut spots = Vec::new();
                let at =
                    lens.project(sun_dir_world).filter(|at| at.iter().all(|c| (5.0..SIZE as f64 - 5.0).contains(c)));
                if let Some([x, y]) = at.filter(|_| dice.uniform() > 0.25) {
                    spots.push(spot([x + 0.35 * dice.normal(), y + 0.35 * dice.normal()], 10.0));
                    // A lens flare mirrors the sun through the centre.
                    let mirrored = [0, 1].map(|k| self.center_px[k] - 0.6 * ([x, y][k] - self.center_px[k]));
                    spots.push(spot(mirrored, 2.0));
                } else if dice.uniform() > 0.5 {
                    spots.push(spot([dice.uniform() * SIZE as f64, dice.uniform() * SIZE as f64], 5.0));
                }
                sightings.push(Sighting { captured_at_s, sun_dir_world, spots });
            }
        }
        sightings
    }
}

fn spot(position_px: [f64; 2], light: f64) -> Spot {
    Spot { position_px, radius_px: 1.5, light }
}

fn nominal(model: LensModel) -> LensFile {
    LensFile { model, ..Lens::zenith_equidistant(SIZE, SIZE, 180.0).file() }
}

/// Angle between what two lenses say a pixel looks at, rms and worst over the sky that the picture holds, degrees; and the same
/// for the axis alone.
fn off(found: &Lens, truth: &Lens) -> (f64, f64) {
    let mut angles = Vec::new();
    for pixel in (0..SIZE * SIZE).step_by(97) {
        let at = [(pixel % SIZE) as f64 + 0.5, (pixel / SIZE) as f64 + 0.5];
        if let Some(dir) = truth.unproject(at).filter(|dir| dir[1] > 0.08) {
            let other = found.unproject(at).unwrap_or([0.0, -1.0, 0.0]);
            let chord = (0..3).map(|k| (dir[k] - other[k]).powi(2)).sum::<f64>().sqrt();
            angles.push((2.0 * (0.5 * chord).min(1.0).asin()).to_degrees());
        }
    }
    let mean = angles.iter().map(|a| a * a).sum::<f64>() / angles.len() as f64;
    (mean.sqrt(), angles.iter().copied().fold(0.0, f64::max))
}

/// Angle of the rotation between two orientations, degrees.
fn turn_between(a: &Lens, b: &Lens) -> f64 {
    let (a, b) = (a.file().camera_to_world, b.file().camera_to_world);
    let square: f64 = (0..9).map(|i| (a[i / 3][i % 3] - b[i / 3][i % 3]).powi(2)).sum();
    (2.0 * (square / 8.0).sqrt().min(1.0).asin()).to_degrees()
}

const EQUINOX: &[&str] = &["2026-03-20", "2026-03-21"];
const SUMMER: &[&str] = &["2026-06-20", "2026-06-21"];
const WINTER: &[&str] = &["2026-12-20", "2026-12-21"];

#[rustfmt::skip]
fn scenes() -> [(&'static str, Scene); 7] {
    use LensModel::{Equidistant, Equisolid, KannalaBrandt};
    let scene = |model, k, focal_px, center_px, turned_deg, latitude_deg, days, seed| {
        Scene { model, k, focal_px, center_px, turned_deg, latitude_deg, days, seed }
    };
    let no = [0.0; 4];
    let bent = [-0.045, 0.008, -0.003, 0.0];
    [
        ("equidistant, level, 48 N, June", scene(Equidistant, no, 198.0, [323.1, 315.8], [0.0, 8.0, 0.0], 48.0, SUMMER, 2101)),
        ("equisolid, turned 140, 41 N, March", scene(Equisolid, no, 215.0, [312.0, 326.5], [2.0, 140.0, -3.0], 41.0, EQUINOX, 2102)),
        ("kannala_brandt, tilted 20, 48 N, June", scene(KannalaBrandt, bent, 205.0, [325.0, 317.0], [18.0, 30.0, 9.0], 48.0, SUMMER, 2103)),
        ("kannala_brandt, level, 5 S, March", scene(KannalaBrandt, bent, 205.0, [318.0, 327.0], [1.0, -60.0, 1.0], -5.0, EQUINOX, 2104)),
        ("equidistant, tilted 35, 35 S, June", scene(Equidistant, no, 190.0, [320.0, 320.0], [-33.0, 10.0, 12.0], -35.0, SUMMER, 2105)),
        ("equisolid, level, 62 N, June", scene(Equisolid, no, 220.0, [329.0, 311.0], [0.5, 200.0, 0.4], 62.0, SUMMER, 2106)),
        ("equidistant, level, 48 N, December", scene(Equidistant, no, 198.0, [323.1, 315.8], [1.0, 8.0, 0.0], 48.0, WINTER, 2107)),
    ]
}

#[test]
fn lenses_come_back_at_any_tilt_latitude_and_season() {
    let mut within_goal = 0;
    for (name, scene) in scenes() {
        let truth = scene.truth();
        let fit = fit(&scene.sightings(), &nominal(scene.model)).unwrap_or_else(|error| panic!("{name}: {error}"));
        let (rms_px, _) = fit.rms();
        let (sky, worst) = off(&fit.lens, &truth);
        let turn = turn_between(&fit.lens, &truth);
        println!(
            "{name}: {} frames, {rms_px:.2} px; true error: orientation {turn:.3} (said {:.3}), sky {sky:.3} (said {:.3}), worst {worst:.3} \
             (said {:.3}); held {:?}",
            fit.found.len(),
            fit.orientation_error_deg,
            fit.sky_error_deg,
            fit.worst_sky_error_deg,
            fit.held
        );
        // The spots' own noise is 0.35 pixels per axis, 0.49 together.
        assert!(rms_px < 0.55, "{name}: {rms_px}");
        // Where a path does not tell the whole sky to a tenth of a degree, the fit must know.
        assert!(sky < 0.1 || fit.sky_error_deg > 0.1, "{name}: {sky}");
        within_goal += usize::from(sky < 0.1);
        assert!(sky < 4.0 * fit.sky_error_deg + 0.01 && turn < 4.0 * fit.orientation_error_deg + 0.01, "{name}");
    }
    assert!(within_goal >= 6, "{within_goal} of 7 scenes");
}

#[test]
fn a_path_of_two_hours_leaves_the_lens_at_its_nominal_values_and_says_so() {
    let (_, scene) = &scenes()[0];
    let few: Vec<Sighting> = scene.sightings().into_iter().skip(120).take(28).collect();
    let fit = fit(&few, &nominal(LensModel::KannalaBrandt)).unwrap();
    println!("{:?}: said {:.2} degrees over the sky", fit.held, fit.sky_error_deg);
    for name in ["center_px[0]", "center_px[1]", "k[0]", "k[1]"] {
        assert!(fit.held.contains(&name), "{:?}", fit.held);
    }
    assert_eq!(fit.lens.file().center_px, nominal(LensModel::KannalaBrandt).center_px);
    assert!(fit.sky_error_deg > 0.5);
}

#[test]
fn what_is_no_path_of_the_sun_is_refused() {
    let (_, scene) = &scenes()[0];
    let seen = scene.sightings();
    assert_eq!(
        fit(&seen[..7], &nominal(LensModel::Equidistant)).err().map(|e| e.to_string().contains("only")),
        Some(true)
    );
    let mut dice = Dice(99);
    let random: Vec<Sighting> = seen
        .iter()
        .map(|s| Sighting { spots: vec![spot([dice.uniform() * 640.0, dice.uniform() * 640.0], 1.0)], ..s.clone() })
        .collect();
    let error = fit(&random, &nominal(LensModel::KannalaBrandt)).err();
    assert!(matches!(error, Some(PathError::NoPath { .. })), "{error:?}");
    let flipped: Vec<Sighting> = seen.iter().map(|s| mirrored(s, &nominal(LensModel::Equidistant))).collect();
    assert_eq!(fit(&flipped, &nominal(LensModel::Equidistant)).err(), Some(PathError::Mirrored));
}
