use super::*;
use std::sync::Arc;

fn small() -> SyntheticSettings {
    SyntheticSettings { width: 64, height: 64, gamma: 1.0, ..SyntheticSettings::default() }
}

#[test]
fn codes_follow_truth_and_exposure_after_the_delay() {
    let mut camera = SyntheticCamera::new(small());
    let wanted = camera.request(Exposure { exposure_s: 1.23e-3, gain: 1.0 }).unwrap();
    assert!((wanted.exposure_s - 1.2e-3).abs() < 1e-12);
    let mut frame = Frame::default();
    for expected in [1e-4, 1e-4, 1.2e-3] {
        camera.frame(&mut frame).unwrap();
        assert!((frame.exposure.exposure_s - expected).abs() < 1e-12, "{:?}", frame.exposure);
    }
    let truth = camera.truth();
    for (pixel, value) in truth.iter().enumerate() {
        for (k, &value) in value.iter().enumerate() {
            let fraction = f64::from(value) * 1.2e-3 / camera.radiance_scale();
            let spread = (fraction / 1e4 + (5e-4f64).powi(2)).sqrt() * 255.0;
            let expected = 255.0 * fraction.min(1.0);
            let off = (f64::from(frame.codes.get(pixel * 3 + k)) - expected).abs();
            assert!(fraction > 0.97 || off < 5.0 * spread + 0.6, "{pixel} {k}: {off}");
        }
    }
}

#[test]
fn the_suns_disc_keeps_its_irradiance() {
    let settings = SyntheticSettings { width: 480, height: 480, ..small() };
    let mut camera = SyntheticCamera::new(settings);
    camera.frame(&mut Frame::default()).unwrap();
    let sun = camera.sky().sun().unwrap();
    let (mut sum, truth) = (0.0, camera.truth());
    for (pixel, value) in truth.iter().enumerate() {
        let at = [(pixel % 480) as f64 + 0.5, (pixel / 480) as f64 + 0.5];
        let dir = camera.lens().unproject(at).unwrap();
        if (0..3).map(|k| dir[k] * f64::from(sun.dir_world[k])).sum::<f64>() > 1.0f64.to_radians().cos() {
            let background = f64::from(camera.sky().radiance(dir.map(|c| c as f32))[1]);
            sum += (f64::from(value[1]) - background) * camera.lens().solid_angle_sr(at).unwrap();
        }
    }
    assert!((sum / f64::from(sun.irradiance[1]) - 1.0).abs() < 0.02, "{sum} {sun:?}");
}

#[test]
fn the_same_seed_gives_the_same_frames() {
    let frames = |seed| {
        let mut camera = SyntheticCamera::new(SyntheticSettings { seed, ..small() });
        let mut frame = Frame::default();
        camera.frame(&mut frame).unwrap();
        camera.frame(&mut frame).unwrap();
        frame
    };
    assert_eq!(frames(3), frames(3));
    assert_ne!(frames(3).codes, frames(4).codes);
}

#[test]
fn black_level_and_bits_show_in_the_codes() {
    let dark = SunPosition { azimuth_deg: 0.0, altitude_deg: -60.0 };
    let settings = SyntheticSettings { black: 0.0625, bits: 12, sun: Some(dark), ..small() };
    let mut frame = Frame::default();
    SyntheticCamera::new(settings).frame(&mut frame).unwrap();
    let codes: Vec<f64> = (0..frame.codes.len()).map(|i| f64::from(frame.codes.get(i))).collect();
    let mean = codes.iter().sum::<f64>() / codes.len() as f64;
    let spread = (codes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / codes.len() as f64).sqrt();
    assert!((mean / 65_535.0 - 0.0625).abs() < 1e-4, "{mean}");
    // Read noise of 5 of 10,000 electrons over 15/16 of the codes.
    assert!((spread / 65_535.0 / (5e-4 * 0.9375) - 1.0).abs() < 0.1, "{spread}");
    let unit = 65_535.0 / 4095.0;
    assert!(codes.iter().all(|c| ((c / unit).round() * unit).round() == *c));
}

#[test]
fn a_map_is_seen_in_the_cameras_own_primaries() {
    let map = Arc::new(RadianceMap::from_fn(32, |_| [1.0, 2.0, 4.0]));
    let camera_from_rec709 = [[0.5, 0.25, 0.0], [0.0, 1.0, 0.0], [0.0, 0.5, 0.5]];
    let settings = SyntheticSettings { map: Some(map), camera_from_rec709, vignetting: 0.2, ..small() };
    let camera = SyntheticCamera::new(settings);
    let centre = 32 * 64 + 32;
    assert_eq!((camera.truth()[centre], camera.truth_camera()[centre]), ([1.0, 2.0, 4.0], [1.0, 2.0, 3.0]));
    let edge = camera.truth_at_sensor(0)[32 * 64 + 1][1];
    assert!((edge / 2.0 - 0.8).abs() < 0.02, "{edge}");
}

#[test]
fn frames_are_dropped_and_repeated_as_often_as_told() {
    let settings = SyntheticSettings { dropped_share: 0.2, repeated_share: 0.1, width: 8, height: 8, ..small() };
    let mut camera = SyntheticCamera::new(settings);
    let mut frame = Frame::default();
    let numbers: Vec<u64> = (0..1000)
        .map(|_| {
            camera.frame(&mut frame).unwrap();
            frame.sequence
        })
        .collect();
    let repeated = numbers.windows(2).filter(|pair| pair[1] == pair[0]).count();
    assert!((60..150).contains(&repeated), "{repeated}");
    let dropped = camera.sequence as usize - 1000;
    assert!((150..300).contains(&dropped), "{dropped}");
    assert!(numbers.windows(2).all(|pair| pair[1] >= pair[0]));
}

#[test]
fn ghosts_are_in_the_pictures_and_birds_not_in_the_truth() {
    let ghosts = Ghosts { birds: 2, bird_px: 4.0, ..Ghosts::default() };
    let sun = Some(SunPosition { azimuth_deg: 0.0, altitude_deg: 30.0 });
    let mut camera = SyntheticCamera::new(SyntheticSettings { ghosts, sun, ..small() });
    let (mut frame, mut masks) = (Frame::default(), Vec::new());
    for _ in 0..3 {
        camera.frame(&mut frame).unwrap();
        masks.push(frame.sequence);
    }
    let mask = camera.ghost_mask(&masks);
    let count = mask.iter().filter(|&&m| m).count();
    assert!((100..400).contains(&count), "{count}");
    assert_eq!(camera.truth_at_sensor(1), camera.truth_camera());
    assert!(camera.ghost_mask(&masks[..1]).iter().all(|&m| !m));
}
