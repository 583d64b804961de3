use super::*;
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Exposure, take_series};

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
