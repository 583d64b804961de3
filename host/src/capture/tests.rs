use super::*;
use crate::bracket::{MergeSettings, Merger};
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Exposure, take_series};
use crate::response::Response;

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

fn capture(settings: SyntheticSettings, times_s: &[f64]) -> (Captured, SyntheticCamera) {
    let mut camera = SyntheticCamera::new(settings);
    let rows = camera.response_curve().iter().enumerate().map(|(i, &v)| [i as f64 / 255.0, v, v, v]).collect();
    let merge = MergeSettings { response: Response::from_rows(rows, "r").unwrap(), ..MergeSettings::default() };
    let exposures: Vec<Exposure> = times_s.iter().map(|&exposure_s| Exposure { exposure_s, gain: 1.0 }).collect();
    let (mut frames, mut merged) = (Vec::new(), Merged::default());
    take_series(&mut camera, &exposures, &mut frames).unwrap();
    Merger::new(merge).merge(&frames, &mut merged).unwrap();
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
    let total: f32 = capture.pixels.iter().map(|p| p.omega).sum();
    assert!((total / std::f32::consts::TAU - 1.0).abs() < 5e-3, "{total}");
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

/// Pixels per radian of a lens of 184 degrees across 120 pixels.
fn plain_focal() -> f64 {
    60.0 / 92f64.to_radians()
}

#[test]
fn a_synthetic_series_comes_back_as_the_skys_own_weights() {
    let base = SyntheticSettings { width: 240, height: 240, sun: Some(SUN), ..SyntheticSettings::default() };
    let (found, camera) = capture(base.clone(), &[1e-4, 8e-4, 3.2e-3, 1.28e-2]);
    let truth = camera.sky().weights(&set());
    let off = difference(&found.weights, &truth);
    let sun = found.weights.sun.unwrap().irradiance[1] / truth.sun.unwrap().irradiance[1] - 1.0;
    println!("clear sky, clipped sun: patches {off:.4}, sun {sun:.4}");
    assert!(off < 0.03 && sun.abs() < 0.05 && found.sun_source == SunSource::ClearSkyModel, "{off} {sun}");
    assert_eq!(found.filled_patches, 0);

    // A sensor with the range of eleven 3-stop steps sees the disc itself; the patches' model plays no part then.
    let deep = SyntheticSettings { full_well_radiance_s: 1000.0, max_exposure_s: 200.0, ..base.clone() };
    let times: Vec<f64> = (0..8).map(|i| 1e-4 * 8f64.powi(i)).collect();
    let (found, camera) = capture(deep, &times);
    let truth = camera.sky().weights(&set());
    let sun = found.weights.sun.unwrap().irradiance[1] / truth.sun.unwrap().irradiance[1] - 1.0;
    println!("clear sky, measured sun: patches {:.4}, sun {sun:.4}", difference(&found.weights, &truth));
    assert!(sun.abs() < 0.03 && found.sun_source == SunSource::Measured, "{sun} {:?}", found.sun_source);

    let atmosphere = Atmosphere { cloud_cover: 1.0, ..Atmosphere::default() };
    let (found, camera) = capture(SyntheticSettings { atmosphere, ..base }, &[1e-4, 8e-4, 6.4e-3]);
    let off = difference(&found.weights, &camera.sky().weights(&set()));
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
