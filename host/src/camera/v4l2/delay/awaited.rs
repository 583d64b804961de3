//! A delay that the light did not allow to measure is measured when there is light: a post that starts before dawn would else
//! wait for guesses all day.

use super::{Delay, UNKNOWN_EXPOSURE};
use crate::camera::{CameraError, Exposure};
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

/// Means, as shares of white, of pictures that another exposure makes clearly darker or brighter.
const USABLE: RangeInclusive<f64> = 0.1..=0.9;
/// Longest exposure times gain of such a picture, seconds: the measurement takes no longer ones, at gain 1.
const LONGEST_S: f64 = super::measure::LONGEST_S;
/// From one attempt to the next.
const AGAIN: Duration = Duration::from_secs(60);

/// Whether a delay may be measured that has been guessed.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::camera::v4l2) struct Awaited {
    has_light: bool,
    tried: Option<Instant>,
}

impl Awaited {
    /// A picture came, with its mean as a share of white.
    pub(in crate::camera::v4l2) fn saw(&mut self, exposure: Exposure, mean: f64) {
        let is_short = exposure != UNKNOWN_EXPOSURE && exposure.product_s() <= LONGEST_S;
        self.has_light |= is_short && USABLE.contains(&mean);
    }

    /// Whether to measure now; then an attempt counts as made.
    pub(in crate::camera::v4l2) fn take_turn(&mut self, delay: Delay, now: Instant) -> bool {
        let is_due = self.tried.is_none_or(|at| now.saturating_duration_since(at) >= AGAIN);
        if delay.measured || !self.has_light || !is_due {
            return false;
        }
        *self = Awaited { has_light: false, tried: Some(now) };
        true
    }
}

/// Opens cameras with `open`, which takes the delay if it is known, and measures it where it is not. A guess is not kept for
/// the next opening.
pub(in crate::camera::v4l2) fn measuring<C>(
    mut known: Option<Delay>,
    mut open: impl FnMut(Option<Delay>) -> Result<C, CameraError>,
    mut measure: impl FnMut(&mut C) -> Result<Delay, CameraError>,
) -> impl FnMut() -> Result<C, CameraError> {
    move || {
        let mut camera = open(known)?;
        if known.is_none() {
            known = Some(measure(&mut camera)?).filter(|delay| delay.measured);
        }
        Ok(camera)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MEASURED: Delay = Delay { unchanged_frames: 1, settled_frames: 3, measured: true };

    fn at(exposure_s: f64) -> Exposure {
        Exposure { exposure_s, gain: 1.0 }
    }

    #[test]
    fn a_guessed_delay_is_measured_once_there_is_light_and_not_again_and_again() {
        let (start, guess) = (Instant::now(), Delay::default());
        let after = |seconds| start + Duration::from_secs(seconds);
        let mut awaited = Awaited::default();
        for (exposure, mean) in [(at(0.1), 0.01), (at(0.5), 0.4), (at(0.001), 0.99), (UNKNOWN_EXPOSURE, 0.4)] {
            awaited.saw(exposure, mean);
            assert!(!awaited.take_turn(guess, start), "{exposure:?} {mean}");
        }
        awaited.saw(at(0.01), 0.4);
        awaited.saw(at(0.01), 0.01);
        assert!(!awaited.take_turn(MEASURED, start), "there is nothing to measure");
        assert!(awaited.take_turn(guess, start));
        awaited.saw(at(0.01), 0.4);
        assert!(!awaited.take_turn(guess, after(59)), "an attempt a minute");
        assert!(awaited.take_turn(guess, after(60)));
        assert!(!awaited.take_turn(guess, after(600)), "no light since");
    }

    #[test]
    fn a_guess_is_measured_anew_at_the_next_opening_and_a_measurement_is_kept() {
        let mut told = Vec::new();
        let mut measured = [Delay::default(), MEASURED].into_iter();
        {
            let open = |known: Option<Delay>| {
                told.push(known);
                Ok(())
            };
            let mut opener = measuring(None, open, |()| measured.next().ok_or(CameraError::Timeout));
            (0..4).for_each(|_| opener().unwrap());
        }
        assert_eq!(told, [None, None, Some(MEASURED), Some(MEASURED)]);
    }
}
