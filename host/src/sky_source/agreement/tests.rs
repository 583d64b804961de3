use super::*;
use crate::bracket::{MergeSettings, Merged, Merger};
use crate::camera::series::Series;
use crate::camera::synthetic::{Curve, Ghosts, SyntheticCamera, SyntheticSettings};
use crate::camera::{Camera, Exposure};
use crate::capture::{Capture, CaptureSettings};
use crate::planner::Planner;
use crate::response::Response;
use crate::skymodel::Atmosphere;
use crate::sun::sun_position;
use relume_firmware::patches::PatchSet;

#[test]
fn the_median_of_enough_series_counts() {
    let mut agreement = Usual::default();
    for number in 0..FEWEST - 1 {
        agreement.add(Some(number as f64));
        agreement.add(None);
    }
    assert_eq!(agreement.median(), None);
    agreement.add(Some(f64::NAN));
    agreement.add(Some(1e9));
    assert_eq!(agreement.median(), Some(4.0));
    (0..LATEST).for_each(|_| agreement.add(Some(-0.2)));
    assert_eq!(agreement.median(), Some(-0.2));
    assert_eq!(disagreement(Some(0.9 * TOLD), true), None);
    assert_eq!(disagreement(None, true), None);
    let told = disagreement(Some(-0.2), false).unwrap();
    assert!(told.contains("-13 % per stop") && told.contains("camera.response is missing"), "{told}");
}

/// The median slope over series that the planner asks for, one every `step_s` from a moment on, merged by a curve.
fn slope(settings: SyntheticSettings, curve: Option<&Response>, step_s: f64) -> Option<f64> {
    let start_unix_s = settings.start_unix_s;
    let mut camera = SyntheticCamera::new(settings);
    let own = Response::from_rows(camera.response_rows(), "its own").unwrap();
    let response = curve.cloned().unwrap_or(own);
    let mut merger = Merger::new(MergeSettings { response, ..MergeSettings::default() });
    let mut planner = Planner::new(camera.limits(), crate::sky_source::captured::SERIES);
    let (mut series, mut merged, mut agreement) = (Series::default(), Merged::default(), Usual::default());
    for number in 0..24 {
        camera.set_time(start_unix_s + step_s * f64::from(number));
        let exposures: Vec<Exposure> = planner.exposures().to_vec();
        series.take(&mut camera, &exposures).unwrap();
        merger.merge(series.frames(), &mut merged).unwrap();
        planner.follow(&merged);
        agreement.add(merger.report().slope);
    }
    agreement.median()
}

fn camera(seed: u64, start_unix_s: f64) -> SyntheticSettings {
    let ghosts = Ghosts {
        birds: 6,
        bird_px: 3.0,
        clouds: 3,
        cloud_px: 20.0,
        cloud_px_per_frame: 2.0,
        seed,
        ..Ghosts::default()
    };
    let curves = [None, Some([Curve::Srgb; 3]), Some([Curve::Linear; 3])][(seed % 3) as usize];
    let cloud_cover = [0.0, 0.4, 0.8][(seed / 3 % 3) as usize];
    SyntheticSettings {
        width: 96,
        height: 96,
        sky_rows: 64,
        atmosphere: Atmosphere { cloud_cover, cloud_seed: seed, ..Atmosphere::default() },
        start_unix_s,
        ghosts,
        curves,
        seed,
        ..SyntheticSettings::default()
    }
}

/// A June day and its dusk.
const TIMES_UNIX_S: [f64; 4] = [1_782_043_200.0, 1_782_065_000.0, 1_782_070_500.0, 1_782_073_000.0];

#[test]
fn noise_clouds_birds_and_dusk_are_not_told_and_another_curve_is() {
    let mut most = 0.0f64;
    for (number, seed) in (6100..6109).enumerate() {
        let found = slope(camera(seed, TIMES_UNIX_S[number % 4]), None, 5.0);
        println!("{seed} at {}: {found:?}", TIMES_UNIX_S[number % 4]);
        most = most.max(found.map_or(0.0, f64::abs));
    }
    println!("most of honest cameras: {most:.4}");
    assert!(most < 0.5 * TOLD, "{most}");
    // Power laws 6 % beside the camera's, and no curve at all, where one is needed.
    let power = |gamma: f64| {
        let rows = (0..=255).map(|code| f64::from(code) / 255.0).map(|share| {
            let light = share.powf(gamma);
            [share, light, light, light]
        });
        Response::from_rows(rows.collect(), "another").unwrap()
    };
    let gamma = SyntheticSettings::default().gamma;
    for (curve, least) in [(power(1.06 * gamma), TOLD), (power(gamma / 1.06), TOLD), (Response::default(), 0.3)] {
        let found = slope(SyntheticSettings { curves: None, ..camera(6111, TIMES_UNIX_S[0]) }, Some(&curve), 5.0);
        println!("another curve: {found:?}");
        assert!(found.is_some_and(|slope| slope.abs() > least), "{found:?}");
    }
}

/// The usual distance of the sun from its place, by a lens that is turned about the zenith.
fn astray_deg(settings: SyntheticSettings, turned_deg: f64) -> Option<f64> {
    let (start_unix_s, place) = (settings.start_unix_s, settings.place);
    let mut camera = SyntheticCamera::new(settings);
    let (sin, cos) = turned_deg.to_radians().sin_cos();
    let lens = camera.lens().turned([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]);
    let set = PatchSet::new(64).unwrap();
    let capture = Capture::new(&lens, (96, 96), set, CaptureSettings::default(), None).unwrap();
    let mut planner = Planner::new(camera.limits(), crate::sky_source::captured::SERIES);
    let mut merger = Merger::new(MergeSettings {
        response: Response::from_rows(camera.response_rows(), "its own").unwrap(),
        ..MergeSettings::default()
    });
    let (mut series, mut merged, mut usual) = (Series::default(), Merged::default(), Usual::default());
    for number in 0..24 {
        let unix_s = start_unix_s + 120.0 * f64::from(number);
        camera.set_time(unix_s);
        let exposures: Vec<Exposure> = planner.exposures().to_vec();
        series.take(&mut camera, &exposures).unwrap();
        merger.merge(series.frames(), &mut merged).unwrap();
        planner.follow(&merged);
        usual.add(capture.sun_astray_deg(&merged, sun_position(unix_s, place).unwrap()));
    }
    usual.median()
}

#[test]
fn clouds_do_not_lead_the_sun_astray_and_a_turned_lens_does() {
    for (number, seed) in (6200..6206).enumerate() {
        let time_unix_s = TIMES_UNIX_S[number % 2];
        let found = astray_deg(camera(seed, time_unix_s), 0.0);
        println!("{seed}: {found:?}");
        assert!(found.is_none_or(|angle_deg| angle_deg < 0.5 * ASTRAY_DEG), "{found:?}");
    }
    let clear = SyntheticSettings { ghosts: Ghosts::default(), ..camera(6201, TIMES_UNIX_S[0]) };
    let clear = SyntheticSettings { atmosphere: Atmosphere::default(), ..clear };
    for turned_deg in [8.0, 90.0] {
        let found = astray_deg(clear.clone(), turned_deg).expect("a sun in the clear");
        println!("turned {turned_deg}: {found}");
        assert!(sun_astray(Some(found)).is_some_and(|told| told.contains("lens")), "{found}");
    }
    assert!(astray_deg(clear, 0.0).expect("a sun in the clear") < 1.0);
}
