use super::*;
use crate::bracket::{MergeSettings, Merger};
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Exposure, take_series};
use crate::response::Response;
use crate::skymodel::{Atmosphere, SkyModel};
use crate::sun::dir_world;

mod sun;

const SUN: SunPosition = SunPosition { azimuth_deg: 150.0, altitude_deg: 45.0 };

fn set() -> PatchSet {
    PatchSet::new(256).unwrap()
}

fn flat(size: usize, value: [f32; 3]) -> Merged {
    Merged {
        width: size,
        height: size,
        radiance: vec![value; size * size],
        state: vec![PixelState::Valid; size * size],
        captured_at_s: 0.0,
    }
}

/// A series of a camera that shows the true sky of its moment.
fn taken(camera: &mut SyntheticCamera, times_s: &[f64]) -> Merged {
    let rows = camera.response_curve().iter().enumerate().map(|(i, &v)| [i as f64 / 255.0, v, v, v]).collect();
    let merge = MergeSettings { response: Response::from_rows(rows, "r").unwrap(), ..MergeSettings::default() };
    let exposures: Vec<Exposure> = times_s.iter().map(|&exposure_s| Exposure { exposure_s, gain: 1.0 }).collect();
    let (mut frames, mut merged) = (Vec::new(), Merged::default());
    take_series(camera, &exposures, &mut frames).unwrap();
    Merger::new(merge).merge(&frames, &mut merged).unwrap();
    merged
}

fn capture(settings: SyntheticSettings, times_s: &[f64]) -> (Captured, SyntheticCamera) {
    let mut camera = SyntheticCamera::new(settings);
    let merged = taken(&mut camera, times_s);
    let settings = CaptureSettings { radiance_scale: camera.radiance_scale(), ..CaptureSettings::default() };
    let size = (merged.width, merged.height);
    let mut capture = Capture::new(camera.lens(), size, set(), settings, None).unwrap();
    (capture.weights(&merged, Some(SUN)).unwrap(), camera)
}

/// RMS difference of the upper patches' luminance over its mean.
fn difference(found: &PatchWeights, truth: &PatchWeights) -> f32 {
    let upper = set().upper();
    let pairs = || found.radiance.iter().zip(&truth.radiance).take(upper);
    let square: f32 = pairs().map(|(a, b)| (luminance(*a) - luminance(*b)).powi(2)).sum();
    let mean: f32 = pairs().map(|(_, b)| luminance(*b)).sum::<f32>() / upper as f32;
    (square / upper as f32).sqrt() / mean
}

#[test]
fn a_uniform_sky_gives_uniform_weights_and_the_ground_its_share() {
    let lens = Lens::zenith_equidistant(120, 120, 184.0);
    let mut capture = Capture::new(&lens, (120, 120), set(), CaptureSettings::default(), None).unwrap();
    let total: f64 = capture.shares.shares.iter().map(|share| f64::from(share.omega)).sum();
    assert!((total / std::f64::consts::TAU - 1.0).abs() < 1e-4, "{total}");
    for (patch, &seen) in capture.shares.seen[..256].iter().enumerate() {
        let whole = f64::from(set().solid_angle_sr(patch));
        // Arcs between the corners of pixels that count as whole are worth a few thousandths of the smallest circle.
        assert!((seen / whole - 1.0).abs() < 6e-3, "{patch}: {seen} of {whole}");
    }
    let found = capture.weights(&flat(120, [1.0, 2.0, 3.0]), None).unwrap();
    assert_eq!((found.sun_source, found.filled_patches), (SunSource::NoPosition, 0));
    assert!(found.weights.radiance[..256].iter().all(|v| (v[1] - 2.0).abs() < 1e-4));
    let ground = found.weights.radiance[256][1];
    assert!((ground - 0.2 * 2.0).abs() < 2e-3, "{ground}");
}

#[test]
fn masked_parts_are_filled_and_counted() {
    let lens = Lens::zenith_equidistant(120, 120, 184.0);
    let mask: Vec<bool> = (0..120 * 120).map(|i| i % 120 > 30).collect();
    let mut capture = Capture::new(&lens, (120, 120), set(), CaptureSettings::default(), Some(&mask)).unwrap();
    let found = capture.weights(&flat(120, [1.0; 3]), Some(SUN)).unwrap();
    assert!(found.filled_patches > 20 && found.sun_source == SunSource::Covered, "{found:?}");
    assert!(found.weights.radiance[..256].iter().all(|v| (v[0] - 1.0).abs() < 1e-2));
    let none = vec![false; 120 * 120];
    assert!(matches!(
        Capture::new(&lens, (120, 120), set(), CaptureSettings::default(), Some(&none)),
        Err(CaptureError::NoSky)
    ));
    let other = Capture::new(&lens, (60, 60), set(), CaptureSettings::default(), None);
    assert!(matches!(other, Err(CaptureError::Size { .. })));
}

#[test]
fn what_vignetting_took_is_given_back_and_the_lenses_mask_is_kept_to() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("l.json");
    let mask = crate::lens::mask::SkyMask::from_fn(120, 120, |pixel| pixel % 120 < 90);
    mask.save(&folder.path().join("m.png")).unwrap();
    let plain = Lens::zenith_equidistant(120, 120, 184.0).file();
    let vignetting = [-0.4, 0.1, 0.0];
    crate::lens::LensFile { vignetting, mask: Some("m.png".into()), ..plain }.save(&path).unwrap();
    let lens = Lens::load(&path).unwrap();
    let mut capture = Capture::new(&lens, (120, 120), set(), CaptureSettings::default(), None).unwrap();
    // An even sky of radiance 1 behind the lens; what the mask hides is far brighter.
    let mut seen = flat(120, [1.0; 3]);
    for (pixel, value) in seen.radiance.iter_mut().enumerate() {
        let at = [(pixel % 120) as f64 + 0.5, (pixel / 120) as f64 + 0.5];
        let passed = ((at[0] - 60.0).hypot(at[1] - 60.0) / plain_focal() / std::f64::consts::FRAC_PI_2).powi(2);
        let share = 1.0 + passed * (vignetting[0] + passed * vignetting[1]);
        *value = if pixel % 120 < 90 { [share as f32; 3] } else { [50.0; 3] };
    }
    let found = capture.weights(&seen, None).unwrap();
    assert!(found.filled_patches > 10, "{}", found.filled_patches);
    assert!(found.weights.radiance[..256].iter().all(|v| (v[1] - 1.0).abs() < 0.01), "{found:?}");
    assert_eq!(capture.radiance_towards(&lens, [-0.9, 0.436, 0.0]), None, "masked");
    let seen = capture.radiance_towards(&lens, [0.9, 0.436, 0.0]).unwrap();
    assert!((seen[1] - 1.0).abs() < 0.01, "{seen:?}");
}

/// A sky's own weights, by way of a map of it.
fn truth_of(sky: &SkyModel) -> PatchWeights {
    PatchWeights { radiance: crate::split::settled(&sky.map(256), &set(), 0.0), sun: sky.sun() }
}

/// Pixels per radian of a lens of 184 degrees across 120 pixels.
fn plain_focal() -> f64 {
    60.0 / 92f64.to_radians()
}

#[test]
fn a_synthetic_series_comes_back_as_the_skys_own_weights() {
    let base = SyntheticSettings { width: 240, height: 240, sun: Some(SUN), ..SyntheticSettings::default() };
    let (found, camera) = capture(base.clone(), &[1e-4, 8e-4, 3.2e-3, 1.28e-2]);
    let truth = truth_of(camera.sky());
    let off = difference(&found.weights, &truth);
    let sun = found.weights.sun.unwrap().irradiance[1] / truth.sun.unwrap().irradiance[1] - 1.0;
    println!("clear sky, clipped sun: patches {off:.4}, sun {sun:.4}");
    assert!(off < 0.03 && sun.abs() < 0.05 && found.sun_source == SunSource::ClearSkyModel, "{off} {sun}");
    assert_eq!(found.filled_patches, 0);

    // A sensor with the range of eleven 3-stop steps sees the disc itself; the patches' model plays no part then.
    let deep = SyntheticSettings { full_well_radiance_s: 1000.0, max_exposure_s: 200.0, ..base.clone() };
    let times: Vec<f64> = (0..8).map(|i| 1e-4 * 8f64.powi(i)).collect();
    let (found, camera) = capture(deep, &times);
    let truth = truth_of(camera.sky());
    let sun = found.weights.sun.unwrap().irradiance[1] / truth.sun.unwrap().irradiance[1] - 1.0;
    println!("clear sky, measured sun: patches {:.4}, sun {sun:.4}", difference(&found.weights, &truth));
    assert!(sun.abs() < 0.03 && found.sun_source == SunSource::Measured, "{sun} {:?}", found.sun_source);

    let atmosphere = Atmosphere { cloud_cover: 1.0, ..Atmosphere::default() };
    let (found, camera) = capture(SyntheticSettings { atmosphere, ..base }, &[1e-4, 8e-4, 6.4e-3]);
    let off = difference(&found.weights, &truth_of(camera.sky()));
    println!("overcast: patches {off:.4}");
    assert!(off < 0.03 && found.sun_source == SunSource::Covered && found.weights.sun.is_none(), "{off}");
}

#[test]
fn at_night_there_is_no_sun() {
    let lens = Lens::zenith_equidistant(60, 60, 184.0);
    let mut capture = Capture::new(&lens, (60, 60), set(), CaptureSettings::default(), None).unwrap();
    let night = SunPosition { azimuth_deg: 10.0, altitude_deg: -20.0 };
    let found = capture.weights(&flat(60, [0.0; 3]), Some(night)).unwrap();
    assert_eq!((found.sun_source, found.weights.sun), (SunSource::BelowHorizon, None));
    found.weights.check(&set()).unwrap();
}

/// The sky as an ideal camera sees it: the mean over each pixel, of the sky above the horizon and the ground below it.
fn ideal(lens: &Lens, size: usize, sky: &SkyModel) -> Merged {
    let mut merged = flat(size, [0.0; 3]);
    for (pixel, value) in merged.radiance.iter_mut().enumerate() {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for sub in 0..9 {
            let part = |k: usize| (k as f64 + 0.5) / 3.0;
            let at = [(pixel % size) as f64 + part(sub % 3), (pixel / size) as f64 + part(sub / 3)];
            let Some(dir) = lens.unproject(at) else { continue };
            let here = sky.radiance(dir.map(|c| c as f32));
            (sum, count) = (std::array::from_fn(|k| sum[k] + here[k]), count + 1.0);
        }
        *value = sum.map(|v: f32| if count > 0.0 { v / count } else { 0.0 });
    }
    merged
}

/// Relative differences of the upper patches' channels, sorted.
fn differences(found: &[[f32; 3]], truth: &[[f32; 3]], is_compared: impl Fn(usize) -> bool) -> Vec<f32> {
    let pairs = (0..set().upper()).filter(|&patch| is_compared(patch));
    let mut off: Vec<f32> = pairs.flat_map(|p| [0, 1, 2].map(|k| (found[p][k] / truth[p][k] - 1.0).abs())).collect();
    off.sort_by(f32::total_cmp);
    off
}

#[test]
fn geometry_alone_costs_less_than_a_hundredth_of_a_per_cent() {
    for (name, cloud_cover, most) in [("clear", 0.0, 1e-4), ("clouds", 0.5, 4e-4), ("overcast", 1.0, 2e-4)] {
        let sky = SkyModel::new(Atmosphere { cloud_cover, ..Atmosphere::default() }, SUN, 0.0, 0.0);
        let truth = crate::split::settled(&sky.map(720), &set(), 0.0);
        let lens = Lens::zenith_equidistant(480, 480, 185.0);
        let mut capture = Capture::new(&lens, (480, 480), set(), CaptureSettings::default(), None).unwrap();
        let found = capture.weights(&ideal(&lens, 480, &sky), None).unwrap();
        let off = differences(&found.weights.radiance, &truth, |_| true);
        let [median, p95, worst] = [off.len() / 2, off.len() * 95 / 100, off.len() - 1].map(|at| off[at]);
        eprintln!("{name}: median {:.4} %, p95 {:.4} %, worst {:.3} %", 1e2 * median, 1e2 * p95, 1e2 * worst);
        assert!(median < most && worst < 0.02, "{name}: {median} {worst}");
        let irradiance_off = found.irradiance_off(&set());
        assert!(irradiance_off.abs() < 1.5e-2, "{name}: {irradiance_off}");
    }
}

/// A sky over directions, and its horizontal irradiance over pi.
type ClosedForm = (f64, fn([f32; 3]) -> f32);

#[test]
fn irradiance_is_that_of_closed_forms() {
    // Uniform: pi L. CIE overcast, L (1 + 2 sin h) / 3: 7 pi L / 9. L cos^2 towards the east: pi L / 4 on the ground.
    let lens = Lens::zenith_equidistant(360, 360, 185.0);
    let skies: [ClosedForm; 3] = [(1.0, |_| 1.0), (7.0 / 9.0, |d| (1.0 + 2.0 * d[1]) / 3.0), (0.25, |d| d[0] * d[0])];
    let mask: Vec<bool> = (0..360 * 360).map(|i| i % 360 > 60 || i / 360 < 200).collect();
    for (share, sky) in skies {
        let mut merged = flat(360, [0.0; 3]);
        for (pixel, value) in merged.radiance.iter_mut().enumerate() {
            let dir = lens.unproject([(pixel % 360) as f64 + 0.5, (pixel / 360) as f64 + 0.5]);
            *value = [dir.map_or(0.0, |d| sky(d.map(|c| c as f32))); 3];
        }
        for (mask, most) in [(None, 8e-3), (Some(&mask[..]), 2e-2)] {
            let mut capture = Capture::new(&lens, (360, 360), set(), CaptureSettings::default(), mask).unwrap();
            let found = capture.weights(&merged, None).unwrap();
            let (pixels, patches) = (found.sky_irradiance[1], found.weights.horizontal_irradiance(&set())[1]);
            let expected = share * std::f64::consts::PI;
            assert!((pixels / expected - 1.0).abs() < most, "{share}: {pixels} {expected}");
            assert!((patches / expected - 1.0).abs() < most, "{share}: {patches} {expected}");
            assert!((pixels / expected - 1.0).abs() < 2e-3 || mask.is_some(), "{share}: {pixels} {expected}");
            assert!(found.irradiance_off(&set()).abs() < 8e-3, "{share}");
            let ground = f64::from(found.weights.radiance[260][1]);
            assert!((ground / (0.2 * patches / std::f64::consts::PI) - 1.0).abs() < 1e-5);
            assert_eq!(found.filled_share.iter().any(|&v| v > 0.0), mask.is_some());
        }
    }
}

/// Median relative difference of the weights of a series from those of the camera's own noiseless picture, apart from
/// patches within 12 degrees of the sun.
fn series_off(seed: u64, times_s: &[f64], cloud_cover: f32) -> f32 {
    let atmosphere = Atmosphere { cloud_cover, cloud_seed: seed, ..Atmosphere::default() };
    let base =
        SyntheticSettings { width: 480, height: 480, sun: Some(SUN), atmosphere, seed, ..SyntheticSettings::default() };
    let (found, camera) = capture(base, times_s);
    let scale = camera.radiance_scale() as f32;
    let mut truth = flat(480, [0.0; 3]);
    truth.radiance = camera.truth().iter().map(|rgb| rgb.map(|v| v / scale)).collect();
    let settings = CaptureSettings { radiance_scale: camera.radiance_scale(), ..CaptureSettings::default() };
    let mut capture = Capture::new(camera.lens(), (480, 480), set(), settings, None).unwrap();
    let truth = capture.weights(&truth, Some(SUN)).unwrap();
    let sun_dir = dir_world(SUN, 0.0);
    let is_apart = |patch: usize| crate::sun::angle_deg(set().dir_world(patch), sun_dir) > 12.0;
    let off = differences(&found.weights.radiance, &truth.weights.radiance, is_apart);
    off[off.len() / 2]
}

#[test]
fn weights_of_a_series_are_those_of_the_true_picture() {
    let fourteen: Vec<f64> =
        (0..14).map(|i| 1e-4 * 2f64.powi(i).min(5000.0)).map(|t| (t / 1e-4).round() * 1e-4).collect();
    for (seed, cover) in [(201, 0.0), (202, 0.4), (203, 1.0)] {
        let many = series_off(seed, &fourteen, cover);
        let four = series_off(seed, &[1e-4, 8e-4, 6.4e-3, 5.12e-2], cover);
        eprintln!("cover {cover}: 14 frames {:.4} %, 4 frames {:.4} %", 100.0 * many, 100.0 * four);
        assert!(many < 1.2e-3 && four < 1.2e-3, "{cover}: {many} {four}");
    }
}
