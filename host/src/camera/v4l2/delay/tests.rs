use super::*;
use crate::camera::{CameraError, CameraLimits};

fn at(exposure_s: f64) -> Exposure {
    Exposure { exposure_s, gain: 1.0 }
}

const MEASURED: Delay = Delay { unchanged_frames: 1, settled_frames: 3, measured: true };

/// Frames of these numbers, all seen, at a mean in proportion to the exposure `mean` gives.
fn told(timeline: &mut Timeline, frames: impl IntoIterator<Item = (u64, f64)>) -> Vec<f64> {
    let mut told = Vec::new();
    for (sequence, mean) in frames {
        timeline.saw(sequence);
        told.push(timeline.exposure_of(sequence, mean).exposure_s);
    }
    told
}

#[test]
fn frames_are_told_apart_by_number() {
    let mut timeline = Timeline::new(MEASURED, at(0.01));
    assert_eq!(told(&mut timeline, [(6, 0.1), (7, 0.1)]), [0.01, 0.01]);
    timeline.requested(at(0.04), timeline.newest());
    assert!((timeline.longest_s() - 0.04).abs() < 1e-12);
    // 7 was complete: 8 is sure to be old, 9 may be either, 10 is the third and new.
    let frames = [(8, 0.1), (9, 0.4), (10, 0.4), (11, 0.4)];
    assert_eq!(told(&mut timeline, frames), [0.01, 0.0, 0.04, 0.04]);
    assert!(!UNKNOWN_EXPOSURE.same_as(&at(1e-6)) && !UNKNOWN_EXPOSURE.same_as(&at(1.0)));
    // Asking for what stands changes nothing.
    timeline.requested(at(0.04), timeline.newest());
    assert_eq!(told(&mut timeline, [(12, 0.4), (13, 0.4)]), [0.04, 0.04]);
}

#[test]
fn lost_frames_count_against_certainty() {
    let mut timeline = Timeline::new(MEASURED, at(0.01));
    assert_eq!(told(&mut timeline, [(7, 0.1)]), [0.01]);
    timeline.requested(at(0.04), timeline.newest());
    // 8 to 10 were lost, and any of them may have been complete: from 10 + 3 on it is sure.
    let frames = [(11, 0.4), (12, 0.4), (13, 0.4)];
    assert_eq!(told(&mut timeline, frames), [0.0, 0.0, 0.04]);
    // A frame that nobody used is known all the same.
    timeline.requested(at(0.01), timeline.newest());
    timeline.saw(14);
    assert_eq!(told(&mut timeline, [(15, 0.1), (16, 0.1)]), [0.0, 0.01]);
}

#[test]
fn frames_that_come_while_a_setting_is_written_may_have_either() {
    let mut timeline = Timeline::new(MEASURED, at(0.01));
    told(&mut timeline, [(7, 0.1)]);
    timeline.saw(8);
    timeline.saw(9);
    timeline.requested(at(0.04), 7);
    let frames = [(10, 0.1), (11, 0.4), (12, 0.4), (13, 0.4)];
    assert_eq!(told(&mut timeline, frames), [0.0, 0.0, 0.04, 0.04]);
}

#[test]
fn requests_before_the_first_frame_and_on_top_of_each_other() {
    let mut timeline = Timeline::new(MEASURED, UNKNOWN_EXPOSURE);
    timeline.requested(at(0.01), timeline.newest());
    assert_eq!(told(&mut timeline, [(0, 0.1), (1, 0.1), (2, 0.1)]), [0.0, 0.0, 0.01]);
    timeline.requested(at(0.02), timeline.newest());
    assert_eq!(told(&mut timeline, [(3, 0.1)]), [0.01]);
    timeline.requested(at(0.04), timeline.newest());
    // 4 may have the first or the second, 5 the second or the third, 6 has the third.
    assert_eq!(told(&mut timeline, [(4, 0.2), (5, 0.4), (6, 0.4), (7, 0.4)]), [0.0, 0.0, 0.04, 0.04]);
    // A setting that failed: nothing is sure until the next.
    timeline.requested(UNKNOWN_EXPOSURE, timeline.newest());
    timeline.requested(at(0.01), timeline.newest());
    assert_eq!(told(&mut timeline, [(8, 0.4), (9, 0.1), (10, 0.1)]), [0.04, 0.0, 0.01]);
}

#[test]
fn a_picture_that_has_not_settled_is_held_back_but_not_for_ever() {
    let mut timeline = Timeline::new(MEASURED, at(0.01));
    told(&mut timeline, [(7, 0.1)]);
    timeline.requested(at(0.04), timeline.newest());
    // One frame later than measured: 10 shows no change, 11 is not yet like its neighbour.
    let frames = [(8, 0.1), (9, 0.1), (10, 0.1), (11, 0.4), (12, 0.4)];
    assert_eq!(told(&mut timeline, frames), [0.01, 0.0, 0.0, 0.0, 0.04]);
    // Time and gain one after the other: 15 has one of them only.
    timeline.requested(at(0.01), timeline.newest());
    // 16 looks as this exposure did before.
    let frames = [(13, 0.4), (14, 0.4), (15, 0.2), (16, 0.1), (17, 0.1)];
    assert_eq!(told(&mut timeline, frames), [0.04, 0.0, 0.0, 0.01, 0.01]);
    // A picture that never follows.
    timeline.requested(at(0.04), timeline.newest());
    let frames = (18..25).map(|sequence| (sequence, 0.1));
    assert_eq!(told(&mut timeline, frames), [0.01, 0.0, 0.0, 0.0, 0.0, 0.04, 0.04]);
}

#[test]
fn settings_in_close_order_are_told_apart_once_their_brightness_is_known() {
    // Settings show after exactly two frames of this camera, measured as one to three.
    let (delay, series) = (Delay { unchanged_frames: 1, settled_frames: 3, measured: true }, [0.01, 0.02, 0.04, 0.08]);
    let mut timeline = Timeline::new(delay, at(0.01));
    let (mut sequence, mut shown) = (10, vec![0.01; 3]);
    timeline.saw(9);
    for round in 0..3 {
        let mut found = Vec::new();
        for exposure in series {
            timeline.requested(at(exposure), timeline.newest());
            let stand = timeline.stand_frames();
            assert_eq!(stand, if round == 0 { 3 } else { 2 }, "round {round}, {exposure} s");
            for _ in 0..stand {
                shown.push(exposure);
                let real = shown[shown.len() - 3];
                let told = told(&mut timeline, [(sequence, 10.0 * real)])[0];
                assert!(told == 0.0 || told == real, "frame {sequence}: {told} for {real}");
                found.push(told);
                sequence += 1;
            }
        }
        for exposure in series.into_iter().take(if round == 0 { 0 } else { 3 }) {
            assert!(found.contains(&exposure), "round {round}: {found:?}");
        }
    }
}

#[test]
fn black_white_and_late_readers_wait_for_nothing() {
    for mean in [0.0, 1.0] {
        let mut timeline = Timeline::new(MEASURED, at(0.01));
        told(&mut timeline, [(7, mean)]);
        timeline.requested(at(0.04), timeline.newest());
        assert_eq!(told(&mut timeline, [(8, mean), (9, mean), (10, mean)]), [0.01, 0.0, 0.04], "{mean}");
    }
    let mut timeline = Timeline::new(MEASURED, at(0.01));
    told(&mut timeline, [(7, 0.1)]);
    timeline.requested(at(0.04), timeline.newest());
    (8..15).for_each(|sequence| timeline.saw(sequence));
    assert_eq!(told(&mut timeline, [(15, 0.4)]), [0.04]);
}

#[test]
fn means_are_shares_of_white() {
    let mut frame = Frame::default();
    frame.codes_u8(200, 100).fill(51);
    assert!((mean_share(&frame) - 0.2).abs() < 1e-12);
    frame.codes_u16(2, 1).copy_from_slice(&[0, 65535, 0, 0, 0, 65535]);
    assert!((mean_share(&frame) - 1.0 / 3.0).abs() < 1e-12);
    assert!(mean_share(&Frame::default()).abs() < 1e-12);
}

/// A camera that shows a setting `late[i]` frames after the newest complete one, i counting settings; every `half`th
/// change passes through a frame of both exposures.
struct Bench {
    light: f64,
    late: Vec<u64>,
    half: bool,
    /// Frames that pass while a setting is written.
    slow: u64,
    sequence: u64,
    settings: Vec<(u64, f64)>,
    timeouts: u32,
}

impl Bench {
    fn new(light: f64, late: Vec<u64>) -> Self {
        Bench { light, late, half: false, slow: 0, sequence: 100, settings: vec![(0, 0.01)], timeouts: 0 }
    }

    fn mean(&self, exposure_s: f64) -> f64 {
        (exposure_s * self.light).min(1.0)
    }
}

impl Stepped for Bench {
    fn limits(&self) -> CameraLimits {
        CameraLimits {
            width: 4,
            height: 4,
            min_exposure_s: 1e-4,
            max_exposure_s: 0.5,
            exposure_step_s: 1e-4,
            max_gain: 1.0,
            delay_frames: 6,
        }
    }

    fn pause(&mut self, _: f64) {}

    fn set(&mut self, exposure: Exposure) -> Result<[i64; 2], CameraError> {
        let late = self.late[self.settings.len() % self.late.len()];
        let before = self.sequence;
        self.sequence += self.slow;
        self.settings.push((self.sequence + late, exposure.exposure_s));
        Ok([before as i64, self.sequence as i64])
    }

    fn next(&mut self) -> Result<(u64, f64), CameraError> {
        self.timeouts += 1;
        if self.timeouts.is_multiple_of(17) {
            return Err(CameraError::Timeout);
        }
        self.sequence += 1;
        let by = |sequence: u64| self.settings.iter().rev().find(|(from, _)| *from <= sequence).unwrap().1;
        let (now, next) = (self.mean(by(self.sequence)), self.mean(by(self.sequence + 1)));
        let mixed = if self.half { 0.5 * (now + next) } else { now };
        Ok((self.sequence, mixed))
    }
}

#[test]
fn the_delay_is_the_largest_seen_and_certainty_the_smallest() {
    let delay = |late: Vec<u64>| measure(&mut Bench::new(20.0, late)).unwrap();
    assert_eq!(delay(vec![1]), Delay { unchanged_frames: 0, settled_frames: 1, measured: true });
    assert_eq!(delay(vec![4]), Delay { unchanged_frames: 3, settled_frames: 4, measured: true });
    assert_eq!(delay(vec![2, 3, 2, 4, 3]), Delay { unchanged_frames: 1, settled_frames: 4, measured: true });
    // What comes before a setting is written has no part in the delay after it.
    let mut slow = Bench { slow: 2, ..Bench::new(20.0, vec![3]) };
    assert_eq!(measure(&mut slow).unwrap(), Delay { unchanged_frames: 4, settled_frames: 3, measured: true });
    // A frame that is half old and half new is neither.
    let mut halves = Bench { half: true, ..Bench::new(20.0, vec![3]) };
    assert_eq!(measure(&mut halves).unwrap(), Delay { unchanged_frames: 1, settled_frames: 3, measured: true });
}

#[test]
fn light_from_dusk_to_noon_serves_and_the_rest_is_a_guess() {
    for light in [2.0, 20.0, 200.0, 2000.0] {
        assert!(measure(&mut Bench::new(light, vec![3])).unwrap().measured, "{light}");
    }
    for light in [0.0, 0.1, 1e5] {
        assert_eq!(measure(&mut Bench::new(light, vec![3])).unwrap(), Delay::default(), "{light}");
    }
    // A camera that never follows.
    assert!(!measure(&mut Bench::new(20.0, vec![1000])).unwrap().measured);
}
