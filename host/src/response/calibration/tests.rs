use super::*;
use crate::camera::Exposure;
use crate::camera::synthetic::Curve;

const FILM: [Curve; 3] = [
    Curve::Film { exponent: 0.85, half: 0.35 },
    Curve::Film { exponent: 0.9, half: 0.4 },
    Curve::Film { exponent: 0.8, half: 0.3 },
];

/// A noise-free exposure of a smooth scene over eight stops: codes are the curve's, rounded.
fn frame(curves: [Curve; 3], black: f64, exposure_s: f64) -> Frame {
    let (width, height) = (320, 240);
    let mut frame = Frame { exposure: Exposure { exposure_s, gain: 1.0 }, ..Frame::default() };
    let codes = frame.codes_u16(width, height);
    for (index, code) in codes.iter_mut().enumerate() {
        let (col, row) = ((index / 3 % width) as f64 / 320.0, (index / 3 / width) as f64 / 240.0);
        let light = if row > 0.9 { 0.0 } else { 0.02 * (8.0 * col + 0.5 * (6.0 * row).sin()).exp2() };
        let share = black + (1.0 - black) * curves[index % 3].code((light * exposure_s).min(1.0));
        *code = (65_535.0 * share).round() as u16;
    }
    frame
}

fn series(curves: [Curve; 3], black: f64, factor: f64, count: i32) -> Vec<Frame> {
    (0..count).map(|i| frame(curves, black, 0.1 * factor.powi(i))).collect()
}

fn rms(found: &Calibration, curves: [Curve; 3]) -> f64 {
    let mut all = Vec::new();
    for (channel, curve) in curves.iter().enumerate() {
        for code in 30..=250 {
            let share = f64::from(code) / 255.0;
            let truth = curve.fraction((share - found.black) / (1.0 - found.black));
            if truth > 2e-3 {
                all.push((found.response.fraction(share, channel) / truth).ln().powi(2));
            }
        }
    }
    (all.iter().sum::<f64>() / all.len() as f64).sqrt()
}

#[test]
fn known_curves_come_back_full_well_at_one() {
    for (curves, bound) in [([Curve::Power { gamma: 2.2 }; 3], 0.004), ([Curve::Linear; 3], 0.004), (FILM, 0.03)] {
        let found = calibrate(&series(curves, 0.0, 2.0, 12), Some(0.0)).unwrap();
        let off = rms(&found, curves);
        println!("{curves:?}: {off:.5}");
        assert!(off < bound && found.left_out.is_none(), "{curves:?}: {off} {found:?}");
        assert_eq!(found.response.fraction(1.0, 1), 1.0);
    }
}

#[test]
fn the_black_level_is_found_from_what_stays_dark() {
    let found = calibrate(&series([Curve::Linear; 3], 0.0625, 2.0, 10), None).unwrap();
    assert!((found.black - 0.0625).abs() < 1e-4, "{}", found.black);
    assert!(rms(&found, [Curve::Linear; 3]) < 0.01);
    assert_eq!(found.response.fraction(0.06, 0), 0.0);
}

#[test]
fn a_frame_with_a_wrong_time_is_found_and_left_out() {
    let curves = [Curve::Power { gamma: 2.0 }; 3];
    let mut frames = series(curves, 0.0, 2.0, 10);
    frames[5].exposure.exposure_s *= 0.5;
    frames.rotate_left(3);
    let found = calibrate(&frames, Some(0.0)).unwrap();
    let left_out = found.left_out.unwrap();
    assert!(left_out.frame == 2 && (left_out.factor - 2.0).abs() < 0.05, "{left_out:?}");
    assert!(rms(&found, curves) < 0.005);
}

#[test]
fn what_shows_no_curve_is_refused_in_words() {
    let linear = [Curve::Linear; 3];
    let told = |frames: &[Frame]| calibrate(frames, None).unwrap_err().to_string();
    assert!(told(&[]).contains("two different exposures"));
    assert!(told(&[frame(linear, 0.0, 0.1)]).contains("two different exposures"));
    assert!(told(&[frame(linear, 0.0, 0.1), frame(linear, 0.0, 0.1)]).contains("same exposure"));
    assert!(told(&[frame(linear, 0.0, 1e-9), frame(linear, 0.0, 2e-9)]).contains("black"));
    assert!(told(&[frame(linear, 0.0, 0.1), frame(linear, 0.0, -1.0)]).contains("must be positive"));
    let mut white = series(linear, 0.0, 2.0, 2);
    white.iter_mut().for_each(|f| f.codes_u16(320, 240).fill(65_535));
    assert!(told(&white).contains("shorter"));
    let mut small = frame(linear, 0.0, 0.3);
    small.codes_u16(32, 24);
    assert!(told(&[frame(linear, 0.0, 0.1), small]).contains("another size"));
    assert!(told(&series(linear, 0.0, 1e5, 2)).contains("flat blocks"));
}
