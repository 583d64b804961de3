//! A sun that saturates the camera: behind veils, in other haze, through a lens that scatters.

use super::*;
use crate::camera::synthetic::Glare;

const TIMES_S: [f64; 4] = [1e-4, 8e-4, 6.4e-3, 5.12e-2];

/// A sun behind a veil of even optical depth before the whole sky, or none, as a camera sees it that it saturates.
fn veiled(capture: &mut Capture, share: f32, seed: u64, altitude_deg: f64) -> (f32, SunSource) {
    let position = SunPosition { azimuth_deg: 150.0, altitude_deg };
    let clear = SkyModel::new(Atmosphere::default(), position, 0.0, 0.0);
    let above = clear.horizontal_irradiance();
    let mut merged = flat(480, [0.0; 3]);
    let clouds = Atmosphere { cloud_cover: 0.45, cloud_seed: seed, ..Atmosphere::default() };
    let rough = crate::clouds::Clouds::new(&clouds, 0.0);
    for (pixel, value) in merged.radiance.iter_mut().enumerate() {
        let at = [(pixel % 480) as f64 + 0.5, (pixel / 480) as f64 + 0.5];
        let seen = capture.lens.unproject(at).filter(|d| d[1] >= 0.0);
        let Some(dir) = seen.map(|d| d.map(|c| c as f32)) else { continue };
        // A veil around the sun that is rough by a tenth, clouds elsewhere.
        let apart = crate::sun::angle_deg(dir, clear.sun_dir()) as f32;
        let veil = share.powf(1.0 + 0.1 * (rough.optical_depth(dir) - 7.0) / 7.0);
        let passed = if apart < 25.0 { veil } else { rough.transmission(dir) };
        let sky = clear.radiance(dir);
        *value = std::array::from_fn(|k| passed * sky[k] + (1.0 - passed) * 0.6 * above[k] / std::f32::consts::PI);
        if apart < 0.6 {
            (*value, merged.state[pixel]) = ([400.0; 3], PixelState::Clipped);
        }
    }
    let found = capture.weights(&merged, Some(position)).unwrap();
    let beam = luminance(clear_beam(altitude_deg as f32, 3.0));
    (found.weights.sun.map_or(0.0, |sun| luminance(sun.irradiance)) / beam, found.sun_source)
}

#[test]
fn a_veiled_sun_is_dimmed_by_what_its_aureole_tells() {
    let lens = Lens::zenith_equidistant(480, 480, 185.0);
    let mut capture = Capture::new(&lens, (480, 480), set(), CaptureSettings::default(), None).unwrap();
    for altitude_deg in [15.0, 40.0, 65.0] {
        for (seed, share) in [(21, 1.0), (22, 0.7), (23, 0.4), (24, 0.15), (25, 0.03)] {
            let (found, source) = veiled(&mut capture, share, seed, altitude_deg);
            eprintln!("sun {altitude_deg} degrees high, {share} of the beam: found {found:.3}, {source:?}");
            let most = if share > 0.5 { 0.3 } else { 0.1 };
            assert!((found - share).abs() < most, "{altitude_deg} {share}: {found}");
            assert!(share == 0.7 || (source == SunSource::Veiled) == (share < 0.5), "{share}: {source:?}");
        }
    }
}

fn camera(atmosphere: Atmosphere, glare: Glare) -> SyntheticCamera {
    let base = SyntheticSettings { width: 240, height: 240, sun: Some(SUN), ..SyntheticSettings::default() };
    SyntheticCamera::new(SyntheticSettings { atmosphere, glare, ..base })
}

fn capture_for(camera: &SyntheticCamera) -> Capture {
    let settings = CaptureSettings { radiance_scale: camera.radiance_scale(), ..CaptureSettings::default() };
    Capture::new(camera.lens(), (240, 240), set(), settings, None).unwrap()
}

/// The sun that is told, and the true one, over the clear sky's.
fn suns(capture: &mut Capture, camera: &mut SyntheticCamera, turbidity: f32) -> [f32; 2] {
    let found = capture.weights(&taken(camera, &TIMES_S), Some(SUN)).unwrap().weights.sun;
    let beam = luminance(clear_beam(SUN.altitude_deg as f32, turbidity));
    [found, camera.sky().sun()].map(|sun| sun.map_or(0.0, |sun| luminance(sun.irradiance)) / beam)
}

#[test]
fn the_sky_tells_its_own_haze() {
    for turbidity in [2.0, 5.0] {
        for cloud_cover in [0.0, 0.3] {
            let atmosphere = Atmosphere { turbidity, cloud_cover, cloud_seed: 4, ..Atmosphere::default() };
            let mut camera = camera(atmosphere, Glare::default());
            let [found, truth] = suns(&mut capture_for(&camera), &mut camera, turbidity);
            eprintln!("turbidity {turbidity}, cover {cloud_cover}: sun {found:.3}, true {truth:.3}");
            // The settings say 3, and are believed a little.
            assert!(truth > 0.99 && (found - truth).abs() < 0.15, "{turbidity} {cloud_cover}: {found} {truth}");
        }
    }
}

#[test]
fn a_lens_that_scatters_shows_the_sun_as_clouds_leave_it() {
    let glare = Glare { veil: 0.005, halo: 0.01, halo_px: 2.5 };
    let clouds = |cloud_cover| Atmosphere { cloud_cover, cloud_seed: 9, ..Atmosphere::default() };
    let mut clear = camera(clouds(0.0), glare);
    let mut capture = capture_for(&clear);
    let [found, _] = suns(&mut capture, &mut clear, 3.0);
    assert!((found - 1.0).abs() < 0.05, "{found}");
    let (mut cloudy, mut between) = (camera(clouds(0.5), glare), 0);
    for minute in 0..90 {
        cloudy.set_time(f64::from(minute) * 60.0);
        let [found, truth] = suns(&mut capture, &mut cloudy, 3.0);
        between += u32::from((0.1..0.9).contains(&truth));
        assert!((found - truth).abs() < 0.15, "minute {minute}: {found} {truth}");
    }
    assert!(between >= 5, "{between}");
}

/// Luminance x solid angle of the patches that reach within 10 degrees of the sun.
fn light_around_sun(weights: &PatchWeights) -> f32 {
    let sun = crate::sun::dir_world(SUN, 0.0);
    let near = (0..set().upper()).filter(|&patch| crate::sun::angle_deg(set().dir_world(patch), sun) < 10.0);
    near.map(|patch| luminance(weights.radiance[patch]) * set().solid_angle_sr(patch)).sum()
}

#[test]
fn what_the_lens_scatters_of_the_sun_is_no_light_of_the_sky() {
    let mut clear = camera(Atmosphere::default(), Glare { veil: 0.0, halo: 0.01, halo_px: 2.5 });
    let mut capture = capture_for(&clear);
    let found = capture.weights(&taken(&mut clear, &TIMES_S), Some(SUN)).unwrap().weights;
    let truth = truth_of(clear.sky());
    let scattered = 0.01 * luminance(truth.sun.unwrap().irradiance);
    let left = (light_around_sun(&found) - light_around_sun(&truth)) / scattered;
    eprintln!("of the scattered light {left:.3} stays in the sky");
    // Nine tenths would, were it not taken out. What falls where the disc itself is seen, or beyond 7 degrees, is not known.
    assert!(left.abs() < 0.35, "{left}");
}
