use super::*;
use crate::camera::fault::{Fault, FaultyCamera};
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::take_series;
use std::ops::Range;

type Watched = Plausible<FaultyCamera<SyntheticCamera>>;

fn camera(schedule: Vec<(Range<u64>, Fault)>) -> Watched {
    let settings = SyntheticSettings { width: 64, height: 64, delay_frames: 0, ..SyntheticSettings::default() };
    Plausible::new(FaultyCamera::new(SyntheticCamera::new(settings), schedule))
}

const MIDDLE: Exposure = Exposure { exposure_s: 2e-3, gain: 1.0 };
const LONG: Exposure = Exposure { exposure_s: 16e-3, gain: 1.0 };

#[test]
fn a_sky_is_a_sky_at_any_exposure() {
    let mut camera = camera(Vec::new());
    for exposure in [1e-4, 1e-3, 1e-2, 0.1, 0.5].into_iter().cycle().take(40) {
        camera.request(Exposure { exposure_s: exposure, gain: 1.0 }).unwrap();
        camera.frame(&mut Frame::default()).unwrap();
        assert!(!matches!(camera.fault(), Some(PictureFault::Stuck | PictureFault::Noise | PictureFault::Black)));
    }
}

#[test]
fn the_same_picture_again_is_reported_until_a_new_one_comes() {
    let mut camera = camera(vec![(5..12, Fault::Repeated)]);
    camera.request(MIDDLE).unwrap();
    let mut frame = Frame::default();
    let faults: Vec<bool> = (0..14).map(|_| camera.frame(&mut frame).is_err()).collect();
    // Frame 4 is the first of its kind; 5 and 6 repeat it, 7 is the fourth.
    let expected: Vec<bool> = (0..14).map(|i| (7..12).contains(&i)).collect();
    assert_eq!(faults, expected);
    assert_eq!(camera.fault(), None);
}

/// Repeats the frame before, yet tells the exposure asked for, as a camera does whose pictures hang.
struct Hanging(Frame, Exposure);

impl Camera for Hanging {
    fn limits(&self) -> CameraLimits {
        SyntheticCamera::new(SyntheticSettings::default()).limits()
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        self.1 = exposure;
        Ok(exposure)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        into.clone_from(&self.0);
        into.exposure = self.1;
        Ok(())
    }
}

#[test]
fn a_series_of_one_picture_is_no_series() {
    let mut frame = Frame::default();
    let mut sky = camera(Vec::new());
    sky.request(MIDDLE).unwrap();
    sky.frame(&mut frame).unwrap();
    let mut camera = Plausible::new(Hanging(frame, MIDDLE));
    let mut frames = Vec::new();
    take_series(&mut camera, &[MIDDLE, LONG], &mut frames).unwrap();
    assert_eq!(frames.len(), 1, "the first may be right");
    let error = take_series(&mut camera, &[MIDDLE, LONG], &mut frames).unwrap_err();
    assert!(matches!(error, CameraError::Implausible(PictureFault::Stuck)), "{error}");
}

#[test]
fn black_and_white_are_faults_only_where_no_exposure_is_left() {
    let mut camera = camera(vec![(0..4, Fault::Black), (4..8, Fault::White)]);
    let (shortest, longest) = (1e-4, camera.limits().max_exposure_s);
    let mut seen = Vec::new();
    let gain = camera.limits().max_gain;
    let exposures = [(shortest, 1.0), (longest, gain), (shortest, 1.0), (longest, gain)].repeat(2);
    for (exposure_s, gain) in exposures {
        camera.request(Exposure { exposure_s, gain }).unwrap();
        camera.frame(&mut Frame::default()).unwrap();
        seen.push(camera.fault());
    }
    let (black, white) = (Some(PictureFault::Black), Some(PictureFault::White));
    assert_eq!(seen, [None, black, black, black, white, white, white, white]);
    camera.request(MIDDLE).unwrap();
    camera.frame(&mut Frame::default()).unwrap();
    assert_eq!(camera.fault(), None);
}

/// Every code drawn anew, uniformly.
struct Static(u64, f64);

impl Camera for Static {
    fn limits(&self) -> CameraLimits {
        SyntheticCamera::new(SyntheticSettings::default()).limits()
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        Ok(exposure)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        for code in into.codes_u16(80, 60) {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *code = (8000.0 + (self.0 >> 48) as f64 * self.1) as u16;
        }
        Ok(())
    }
}

#[test]
fn noise_is_told_from_pictures_and_from_the_dark() {
    let mut camera = Plausible::new(Static(1, 0.8));
    let error = camera.frame(&mut Frame::default()).unwrap_err();
    assert!(matches!(error, CameraError::Implausible(PictureFault::Noise)), "{error}");
    let mut dark = Plausible::new(Static(1, 0.05));
    for _ in 0..10 {
        dark.frame(&mut Frame::default()).unwrap();
    }
}

#[test]
fn noise_is_noise_though_pixels_share_chroma() {
    let mut state = 1u64;
    let mut byte = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as f64
    };
    let mut frame = Frame::default();
    for pair in frame.codes_u8(320, 320).chunks_exact_mut(6) {
        let (u, v) = (byte() - 128.0, byte() - 128.0);
        // BT.601, limited range: green of two pixels with one chroma, as in YUYV.
        for pixel in pair.chunks_exact_mut(3) {
            pixel[1] = (1.164 * (byte() - 16.0) - 0.391 * u - 0.813 * v).clamp(0.0, 255.0) as u8;
        }
    }
    let look = look(&frame);
    assert!(look.roughness > NOISE_RATIO && look.deviation > NOISE_DEVIATION, "{look:?}");
}
