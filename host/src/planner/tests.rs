use super::*;
use crate::bracket::{MergeSettings, Merger};
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Camera, take_series};
use crate::sun::SunPosition;

const LIMITS: CameraLimits = CameraLimits {
    width: 64,
    height: 64,
    min_exposure_s: 1e-4,
    max_exposure_s: 0.5,
    exposure_step_s: 1e-4,
    max_gain: 16.0,
    delay_frames: 3,
};

/// What a planned series makes of true radiances: clipped, black, or as they are.
fn seen(truth: &[f32], plan: &[Exposure]) -> Merged {
    let products = plan.iter().map(|e| e.product_s() as f32);
    let [shortest, longest] = products.fold([f32::INFINITY, 0.0], |[low, high], p| [low.min(p), high.max(p)]);
    let clip = 0.98 / shortest;
    let see = |&v: &f32| if v * longest < 2e-3 { [0.0; 3] } else { [v.min(clip); 3] };
    Merged {
        width: 64,
        height: 64,
        radiance: truth.iter().map(see).collect(),
        state: truth.iter().map(|&v| if v > clip { PixelState::Clipped } else { PixelState::Valid }).collect(),
        ..Merged::default()
    }
}

/// A sky whose brightest part is `contrast` times its darkest, with a sun of `sun` times that in one pixel.
fn sky(level: f64, contrast: f64, sun: f64) -> Vec<f32> {
    let at = |i: usize| level * contrast.powf(i as f64 / 4095.0) / contrast;
    (0..4096).map(|i| (if i == 2000 { sun * level } else { at(i) }) as f32).collect()
}

/// Follows until the plan stays; the series it took.
fn settle(planner: &mut Planner, truth: &[f32]) -> usize {
    (1..50).find(|_| !planner.follow(&seen(truth, planner.exposures()))).unwrap()
}

#[test]
fn frames_are_those_that_the_sky_needs() {
    for (name, contrast, sun, expected) in [("grey", 3.0, 0.0, 1), ("clear", 40.0, 1e5, 3), ("deep", 4000.0, 1e5, 4)] {
        let mut planner = Planner::new(LIMITS, 4);
        let truth = sky(100.0, contrast, sun);
        assert!(settle(&mut planner, &truth) <= 6, "{name}");
        for _ in 0..30 {
            planner.follow(&seen(&truth, planner.exposures()));
        }
        let plan = planner.exposures();
        assert_eq!(plan.len(), expected, "{name}: {plan:?}");
        assert!(plan.iter().all(|e| LIMITS.nearest(*e).same_as(e)), "{name}: {plan:?}");
        assert!(plan.windows(2).all(|w| w[1].product_s() <= 8.6 * w[0].product_s() || w[0].exposure_s == 1e-4));
        let report = planner.report();
        assert_eq!((report.frames, report.exposure_s[0]), (plan.len(), plan[0].exposure_s));
        let watch = 100.0 * planner.watch().product_s();
        assert!((0.3..0.95).contains(&watch), "{name}: {watch}");
    }
}

#[test]
fn no_frame_is_spent_on_what_does_not_matter() {
    let truth = sky(100.0, 4000.0, 0.0);
    let mut planner = Planner::new(LIMITS, 4);
    // Only the brightest fifth lies in patches that light the picture.
    let importance: Vec<f32> = (0..4096).map(|i| if i > 3300 { 1.0 } else { 1e-4 }).collect();
    planner.set_importance(&importance);
    settle(&mut planner, &truth);
    for _ in 0..30 {
        planner.follow(&seen(&truth, planner.exposures()));
    }
    assert!(planner.exposures().len() <= 2, "{:?}", planner.exposures());
}

#[test]
fn dawn_is_followed_without_a_step_back() {
    let mut planner = Planner::new(LIMITS, 4);
    settle(&mut planner, &sky(1e-3, 10.0, 0.0));
    let (before, mut slowest, mut worst) = (planner.report().changes, 0.0f64, 0.0f64);
    let mut lasts: Vec<f64> = Vec::new();
    // Dawn: 0.475 decades per degree are a tenth of a decade in a minute; a series takes a third of a second.
    for step in 0..4000 {
        let level = 10f64.powf(-3.0 + 6.7 * f64::from(step) / 4000.0);
        let truth = sky(level, 10.0, if level > 10.0 { 1e5 } else { 0.0 });
        let merged = seen(&truth, planner.exposures());
        let clipped = merged.state.iter().filter(|&&s| s == PixelState::Clipped).count();
        let is_shortest = planner.exposures()[0].exposure_s <= LIMITS.min_exposure_s;
        assert!(is_shortest || clipped <= 1 + 4096 / 25, "{level}: {clipped} clipped by {:?}", planner.exposures());
        assert!(merged.radiance.iter().any(|v| v[0] > 0.0), "{level}: black");
        planner.follow(&merged);
        let report = planner.report();
        (slowest, worst) = (slowest.max(report.light_s), worst.max(report.gain));
        if lasts.last() != Some(&planner.ends_s[0]) {
            lasts.push(planner.ends_s[0]);
        }
    }
    let changes = planner.report().changes - before;
    eprintln!(
        "dawn, from 1e-3 to 5e3 and the sun 5e8: {changes} changes, series of {slowest:.2} s at most, gain {worst:.1} at most"
    );
    assert!(changes < 120, "{changes}");
    assert!(lasts.windows(2).all(|pair| pair[1] <= pair[0] * 1.001), "exposures only fall while the light rises");
}

#[test]
fn gain_keeps_series_short_until_there_is_no_more() {
    let mut planner = Planner::new(LIMITS, 4);
    settle(&mut planner, &sky(0.5, 10.0, 0.0));
    let dusk = planner.report();
    assert!(dusk.light_s < 1.2 * LATENCY_S && dusk.gain > 1.5, "{dusk:?}");
    settle(&mut planner, &sky(1e-3, 10.0, 0.0));
    let night = planner.report();
    assert!(night.gain == LIMITS.max_gain && night.exposure_s[1] == LIMITS.max_exposure_s, "{night:?}");
    let mut slow = Planner::new(LIMITS, 4);
    slow.set_latency_s(2.0);
    settle(&mut slow, &sky(0.5, 10.0, 0.0));
    assert!(slow.report().gain <= dusk.gain / 2.0, "{:?}", slow.report());
}

/// Pink noise: the sum of first-order low passes an octave apart, standard deviation about 1.
struct Pink([f64; 8], u64);

impl Pink {
    fn next(&mut self) -> f64 {
        let mut sum = 0.0;
        for (octave, value) in self.0.iter_mut().enumerate() {
            self.1 = self.1.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let white = (self.1 >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
            let pole = 1.0 - 0.5f64.powi(octave as i32 + 1);
            *value = pole * *value + (12.0 * (1.0 - pole * pole)).sqrt() * white;
            sum += *value;
        }
        sum / 8f64.sqrt()
    }
}

#[test]
fn flickering_clouds_do_not_make_the_plan_flap() {
    for (seed, deviation, most) in [(101, 0.10, 1), (102, 0.15, 12), (103, 0.25, 80)] {
        let mut planner = Planner::new(LIMITS, 4);
        let mut pink = Pink([0.0; 8], seed);
        settle(&mut planner, &sky(100.0, 40.0, 1e5));
        for _ in 0..30 {
            planner.follow(&seen(&sky(100.0, 40.0, 1e5), planner.exposures()));
        }
        let before = planner.report().changes;
        let mut plans: Vec<Vec<Exposure>> = Vec::new();
        for _ in 0..2000 {
            let truth = sky(100.0 * (deviation * pink.next()).exp(), 40.0, 1e5);
            planner.follow(&seen(&truth, planner.exposures()));
            plans.push(planner.exposures().to_vec());
        }
        let changes = planner.report().changes - before;
        let flaps = plans.windows(4).filter(|w| w[1] != w[0] && (w[2] == w[0] || w[3] == w[0])).count();
        assert!(flaps <= 2 * most as usize / 10, "{deviation}: {flaps} flaps");
        eprintln!("pink flicker of {:.0} %: {changes} changes in 2000 series", 100.0 * deviation);
        assert!(changes <= most, "{deviation}: {changes}");
    }
}

#[test]
fn black_and_white_pictures_are_searched_through() {
    for level in [1e-2, 5e3] {
        let mut planner = Planner::new(LIMITS, 4);
        let truth = sky(level, 10.0, 0.0);
        settle(&mut planner, &truth);
        let merged = seen(&truth, planner.exposures());
        assert!(merged.radiance.iter().filter(|v| v[0] > 0.0).count() > 3000, "{level}: {:?}", planner.exposures());
    }
    let mut planner = Planner::new(LIMITS, 1);
    assert_eq!(planner.exposures().len(), 1);
    planner.follow(&seen(&vec![0.0; 4096], planner.exposures()));
    planner.follow(&Merged::default());
    assert_eq!(planner.exposures().len(), 1);
}

#[test]
fn a_camera_is_followed_from_noon_to_night() {
    let settings = SyntheticSettings { width: 48, height: 48, delay_frames: 0, ..SyntheticSettings::default() };
    for altitude_deg in [60.0, 5.0, -4.0] {
        let sun = Some(SunPosition { azimuth_deg: 180.0, altitude_deg });
        let mut camera = SyntheticCamera::new(SyntheticSettings { sun, gamma: 1.0, ..settings.clone() });
        let mut planner = Planner::new(camera.limits(), 4);
        let mut merger = Merger::new(MergeSettings::default());
        let (mut frames, mut merged) = (Vec::new(), Merged::default());
        for _ in 0..40 {
            let plan = planner.exposures();
            assert!(plan.len() <= 4 && plan.windows(2).all(|w| w[0].product_s() < w[1].product_s()), "{plan:?}");
            take_series(&mut camera, plan, &mut frames).unwrap();
            merger.merge(&frames, &mut merged).unwrap();
            planner.follow(&merged);
        }
        assert!(!planner.follow(&merged), "{altitude_deg}");
        let clipped = merged.state.iter().filter(|&&s| s == PixelState::Clipped).count();
        assert!(clipped < 48 * 48 / 50, "{altitude_deg}: {clipped}");
        assert!(merged.radiance.iter().any(|v| v[1] > 0.0));
    }
}
