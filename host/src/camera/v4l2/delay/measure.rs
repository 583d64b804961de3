//! Measures the delay: steps the exposure between two values and counts frames until the picture follows.

use super::Delay;
use crate::camera::{CameraError, CameraLimits, Exposure};

/// From one exposure of the search to the next, as a factor.
const SEARCH_STEP: f64 = 4.0;
/// Longest exposure of the search, seconds: longer ones take longer than they are worth.
pub(super) const LONGEST_S: f64 = 0.13;
/// Frames after which every camera has settled.
const SETTLED: u32 = 9;
/// Two pictures differ clearly when their means differ by this share of white.
const CLEAR: f64 = 0.06;
/// Steps between the two exposures.
const ROUNDS: u32 = 6;
/// Frames that a step is waited for.
const PATIENCE: u32 = 20;
/// Frames in a row that make sure of it.
const SURE: u32 = 3;
/// Waits for a frame that may fail, in all.
const TIMEOUTS: u32 = 3;

/// A camera whose every frame can be had.
pub(in crate::camera::v4l2) trait Stepped {
    fn limits(&self) -> CameraLimits;
    /// Waits a share of the time between frames, so that steps come at all phases of a frame.
    fn pause(&mut self, share: f64);
    /// Throws away what is ready; the numbers of the newest complete frames before and after.
    fn set(&mut self, exposure: Exposure) -> Result<[i64; 2], CameraError>;
    /// The next frame's number and mean code as a share of white.
    fn next(&mut self) -> Result<(u64, f64), CameraError>;
}

/// An exposure and the mean that it gives.
type Level = (Exposure, f64);

/// Measures; a guess on the safe side where the light shows no difference.
pub(in crate::camera::v4l2) fn measure(camera: &mut impl Stepped) -> Result<Delay, CameraError> {
    let Some(mut levels) = find_levels(camera)? else { return Ok(Delay::default()) };
    let mut delay = Delay { unchanged_frames: u32::MAX, settled_frames: 1, measured: true };
    // The search leaves the second exposure standing.
    levels.swap(0, 1);
    for round in 0..ROUNDS {
        let phase = f64::from(round) / f64::from(ROUNDS);
        let Some((left, settled)) = step(camera, phase, levels[0].1, levels[1])? else { return Ok(Delay::default()) };
        delay.unchanged_frames = delay.unchanged_frames.min(left.saturating_sub(1));
        delay.settled_frames = delay.settled_frames.max(settled);
        levels.swap(0, 1);
    }
    Ok(delay)
}

/// Two exposures whose pictures differ clearly, the shorter first; the search goes up from the shortest.
fn find_levels(camera: &mut impl Stepped) -> Result<Option<[Level; 2]>, CameraError> {
    let limits = camera.limits();
    let longest_s = limits.max_exposure_s.min(LONGEST_S);
    let mut darkest: Option<Level> = None;
    let mut wanted_s = limits.min_exposure_s;
    loop {
        let exposure = Exposure { exposure_s: wanted_s.min(longest_s), gain: 1.0 };
        camera.set(exposure)?;
        let mut mean = 0.0;
        for _ in 0..SETTLED {
            mean = patiently(camera)?.1;
        }
        match darkest {
            Some(dark) if mean - dark.1 >= CLEAR => return Ok(Some([dark, (exposure, mean)])),
            // As long as nothing shows, the longer one serves as well.
            Some(dark) if mean - dark.1 >= CLEAR / 4.0 => {}
            _ => darkest = Some((exposure, mean)),
        }
        if wanted_s >= longest_s {
            return Ok(None);
        }
        wanted_s *= SEARCH_STEP;
    }
}

/// The frames, counted from the newest complete before, in which the picture first left the old mean and, from the newest
/// complete after, from which on it kept to the new one; `None` if it never did.
fn step(
    camera: &mut impl Stepped,
    phase: f64,
    from: f64,
    (exposure, to): Level,
) -> Result<Option<(u32, u32)>, CameraError> {
    camera.pause(phase);
    let [before, after] = camera.set(exposure)?;
    let (mut left, mut settled, mut in_a_row) = (None, None, 0);
    for _ in 0..PATIENCE {
        let (sequence, mean) = patiently(camera)?;
        let since = |frame: i64| u32::try_from(sequence as i64 - frame).unwrap_or(0);
        let moved = (mean - from) / (to - from);
        if moved > 0.25 {
            left.get_or_insert(since(before));
        }
        if moved > 0.75 {
            settled.get_or_insert(since(after));
            in_a_row += 1;
        } else {
            (settled, in_a_row) = (None, 0);
        }
        if in_a_row == SURE {
            return Ok(left.zip(settled));
        }
    }
    Ok(None)
}

fn patiently(camera: &mut impl Stepped) -> Result<(u64, f64), CameraError> {
    for _ in 1..TIMEOUTS {
        match camera.next() {
            Err(CameraError::Timeout) => {}
            other => return other,
        }
    }
    camera.next()
}
