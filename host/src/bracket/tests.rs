use super::*;
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Exposure, take_series};
use crate::sun::SunPosition;

fn flat(code: u8, exposure_s: f64) -> Frame {
    let exposure = Exposure { exposure_s, gain: 1.0 };
    Frame { width: 2, height: 1, codes: Codes::U8(vec![code; 6]), exposure, sequence: 0, captured_at_s: 1.0 }
}

fn merge(frames: &[Frame]) -> Merged {
    let mut merged = Merged::default();
    Merger::new(MergeSettings::default()).merge(frames, &mut merged).unwrap();
    merged
}

#[test]
fn one_exposure_and_many_give_the_same_radiance() {
    let expected = 102.0 / 255.0 / 0.01;
    for frames in [vec![flat(102, 0.01)], vec![flat(255, 0.08), flat(51, 0.005), flat(102, 0.01), flat(204, 0.02)]] {
        let merged = merge(&frames);
        assert!((f64::from(merged.radiance[1][2]) / expected - 1.0).abs() < 1e-4, "{merged:?}");
        assert_eq!(merged.state[0], PixelState::Valid);
    }
}

#[test]
fn white_is_marked_and_black_is_zero() {
    let white = merge(&[flat(255, 0.01), flat(251, 0.001)]);
    assert_eq!(white.state, [PixelState::Clipped; 2]);
    assert!((white.radiance[0][0] / (0.98 / 0.001) - 1.0).abs() < 0.01);
    let black = merge(&[flat(0, 0.01)]);
    assert_eq!((black.radiance[0], black.state[0]), ([0.0; 3], PixelState::Valid));
}

#[test]
fn bad_series_are_refused() {
    let mut merger = Merger::new(MergeSettings::default());
    let mut merged = Merged::default();
    assert_eq!(merger.merge(&[], &mut merged), Err(MergeError::Empty));
    assert_eq!(merger.merge(&[flat(1, 0.0)], &mut merged), Err(MergeError::Exposure(0, 0.0)));
    let mut other = flat(1, 0.1);
    other.width = 3;
    assert_eq!(merger.merge(&[flat(1, 0.1), other], &mut merged), Err(MergeError::Size(1)));
}

#[test]
fn merged_synthetic_frames_equal_the_truth() {
    let mut camera = SyntheticCamera::new(SyntheticSettings { width: 96, height: 96, ..SyntheticSettings::default() });
    let rows = camera.response_curve().iter().enumerate().map(|(i, &v)| [i as f64 / 255.0, v, v, v]).collect();
    let settings = MergeSettings { response: Response::from_rows(rows, "r").unwrap(), ..MergeSettings::default() };
    let exposures = [2e-4, 8e-4, 3.2e-3, 1.28e-2].map(|exposure_s| Exposure { exposure_s, gain: 1.0 });
    let (mut frames, mut merged) = (Vec::new(), Merged::default());
    take_series(&mut camera, &exposures, &mut frames).unwrap();
    Merger::new(settings).merge(&frames, &mut merged).unwrap();
    let (truth, scale) = (camera.truth(), camera.radiance_scale() as f32);
    let mut errors: Vec<f32> = (0..truth.len())
        .filter(|&i| truth[i][1] > 0.0 && merged.state[i] == PixelState::Valid)
        .map(|i| (merged.radiance[i][1] * scale / truth[i][1] - 1.0).abs())
        .collect();
    errors.sort_by(f32::total_cmp);
    let (median, p95) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100]);
    println!("4 frames 2 stops apart: median {median:.4}, p95 {p95:.4}");
    assert!(median < 0.01 && p95 < 0.04, "{median} {p95}");
}

/// Inverse-variance mean in f64, straight from the definition: what the fast loop must equal.
fn oracle(frames: &[Frame], settings: &MergeSettings, noise: SensorNoise, pixel: usize, channel: usize) -> Option<f64> {
    let (mut weighted, mut weight) = (0.0, 0.0);
    for frame in frames {
        let max = f64::from(frame.codes.max());
        let share = f64::from(frame.codes.get(3 * pixel + channel)) / max;
        if share >= settings.clip {
            continue;
        }
        let at = |share: f64| settings.response.fraction(share.clamp(0.0, 1.0), channel);
        let low = if share > 0.0 { at(share - 1.0 / max) } else { -at(1.0 / max) };
        let (fraction, width) = (at(share), 0.5 * (at(share + 1.0 / max) - low));
        let electrons = noise.full_well_electrons / frame.exposure.gain;
        let variance = fraction / electrons
            + (noise.read_noise_electrons / electrons).powi(2)
            + width * width / 12.0
            + (0.005 * fraction).powi(2);
        let t = frame.exposure.product_s();
        weighted += fraction * t / variance;
        weight += t * t / variance;
    }
    (weight > 0.0).then(|| weighted / weight)
}

fn synthetic(settings: SyntheticSettings, times_s: &[f64]) -> (Vec<Frame>, MergeSettings, SyntheticCamera) {
    let mut camera = SyntheticCamera::new(settings);
    let response = Response::from_rows(camera.response_rows(), "r").unwrap();
    let exposures: Vec<Exposure> = times_s.iter().map(|&exposure_s| Exposure { exposure_s, gain: 1.0 }).collect();
    let mut frames = Vec::new();
    take_series(&mut camera, &exposures, &mut frames).unwrap();
    (frames, MergeSettings { response, ..MergeSettings::default() }, camera)
}

const TIMES_S: [f64; 4] = [2e-4, 8e-4, 3.2e-3, 1.28e-2];

fn daylight(size: usize) -> SyntheticSettings {
    let sun = Some(SunPosition { azimuth_deg: 120.0, altitude_deg: 40.0 });
    SyntheticSettings { width: size, height: size, sun, ..SyntheticSettings::default() }
}

#[test]
fn the_fast_loop_equals_the_definition_in_f64() {
    let noise = SensorNoise { full_well_electrons: 8000.0, read_noise_electrons: 7.0 };
    for (bits, count) in [(8, 4), (8, 1), (8, 3), (12, 2)] {
        let (frames, settings, _) = synthetic(SyntheticSettings { bits, ..daylight(75) }, &TIMES_S[..count]);
        let settings = MergeSettings { noise: Some(noise), ..settings };
        let mut merged = Merged::default();
        let mut merger = Merger::new(settings.clone());
        merger.merge(&frames, &mut merged).unwrap();
        let ghosts = merger.report().ghost_pixels;
        let mut off = 0;
        for pixel in 0..merged.radiance.len() {
            for channel in 0..3 {
                let found = f64::from(merged.radiance[pixel][channel]);
                match oracle(&frames, &settings, noise, pixel, channel) {
                    Some(expected) => off += usize::from((found - expected).abs() > 2e-4 * expected + 1e-6),
                    None => assert_eq!(merged.state[pixel], PixelState::Clipped),
                }
            }
        }
        // Pixels of which samples were left out differ, and no others.
        assert!(off <= 3 * ghosts && ghosts < 75 * 75 / 50, "{bits} {count}: {off} {ghosts}");
    }
}

#[test]
fn the_sensors_noise_is_found_from_the_frames() {
    for (electrons, read) in [(4000.0, 8.0), (20_000.0, 6.0)] {
        let sensor = SyntheticSettings { full_well_electrons: electrons, read_noise_electrons: read, ..daylight(200) };
        let (frames, settings, _) = synthetic(sensor, &[4e-4, 8e-4, 1.6e-3, 3.2e-3]);
        let mut merger = Merger::new(settings);
        merger.merge(&frames, &mut Merged::default()).unwrap();
        let found = merger.report().noise;
        assert!((found.full_well_electrons / electrons).ln().abs() < 0.25, "{electrons}: {found:?}");
    }
}

#[test]
fn a_misreported_exposure_is_corrected() {
    for (place, factor) in [(0, 2.0), (2, 0.5), (3, 1.3)] {
        let (mut frames, settings, camera) = synthetic(daylight(120), &[2e-4, 6e-4, 1.8e-3, 5.4e-3]);
        frames[place].exposure.exposure_s *= factor;
        let mut merged = Merged::default();
        let mut merger = Merger::new(settings);
        merger.merge(&frames, &mut merged).unwrap();
        let found = merger.report().exposure_factors.clone();
        assert!((found[place] * factor - 1.0).abs() < 0.03, "{place}: {found:?}");
        assert!(found.iter().enumerate().all(|(i, &f)| i == place || f == 1.0), "{found:?}");
        let (truth, scale) = (camera.truth(), camera.radiance_scale() as f32);
        let centre = 60 * 120 + 45;
        assert!((merged.radiance[centre][1] * scale / truth[centre][1] - 1.0).abs() < 0.1);
    }
}

#[test]
fn birds_leave_no_trace() {
    let ghosts = crate::camera::synthetic::Ghosts { birds: 8, bird_px: 4.0, ..Default::default() };
    let settings = SyntheticSettings { ghosts, ..daylight(200) };
    let (frames, settings, camera) = synthetic(settings, &[4e-4, 8e-4, 1.6e-3, 3.2e-3, 6.4e-3]);
    let mut merged = Merged::default();
    let mut merger = Merger::new(settings);
    merger.merge(&frames, &mut merged).unwrap();
    let mask = camera.ghost_mask(&frames.iter().map(|frame| frame.sequence).collect::<Vec<_>>());
    let (truth, scale) = (camera.truth(), camera.radiance_scale() as f32);
    let mut errors: Vec<f32> = (0..truth.len())
        .filter(|&i| mask[i] && merged.state[i] == PixelState::Valid)
        .map(|i| (merged.radiance[i][1] * scale / truth[i][1] - 1.0).abs())
        .collect();
    errors.sort_by(f32::total_cmp);
    let (median, p95) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100]);
    println!("birds: median {median:.4}, p95 {p95:.4}, {} pixels", merger.report().ghost_pixels);
    assert!(errors.len() > 500 && median < 0.02 && p95 < 0.1, "{median} {p95}");
}

#[test]
fn every_bad_series_gives_a_picture_without_nan() {
    let (good, settings, _) = synthetic(daylight(64), &TIMES_S);
    let filled = |code: u8| {
        let mut frames = good.clone();
        frames.iter_mut().for_each(|frame| frame.codes_u8(64, 64).fill(code));
        frames
    };
    let mut one_code = filled(100);
    for frame in &mut one_code {
        frame.codes_u8(64, 64).iter_mut().enumerate().for_each(|(i, code)| *code += (i * 7 % 3 == 0) as u8);
    }
    let mut stuck = good.clone();
    for frame in &mut stuck {
        (0..64).for_each(|row| frame.codes_u8(64, 64)[(row * 64 + 20) * 3..(row * 64 + 20) * 3 + 3].fill(255));
    }
    let mut wrong = good.clone();
    wrong[1].exposure.exposure_s *= 2.0;
    let same = vec![good[1].clone(); 4];
    for frames in [filled(0), filled(255), good[..1].to_vec(), same, wrong, one_code, stuck, good.clone()] {
        let mut merger = Merger::new(settings.clone());
        let mut merged = Merged::default();
        for _ in 0..2 {
            merger.merge(&frames, &mut merged).unwrap();
            assert!(merged.radiance.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
        }
        let sigma = merger.uncertainty(&frames, &merged);
        assert!(sigma.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    }
}
