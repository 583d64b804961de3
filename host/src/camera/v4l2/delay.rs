//! Which frame has which exposure: the delay from setting to effect, measured, and the settings of the last frames.
//!
//! Writing a setting takes time. Let frame B be the newest one complete before and A the one after. Frames up to
//! B + `unchanged_frames` still have the setting before, frames from A + `settled_frames` on have the new one, and nobody
//! knows about those between: they are reported with [`UNKNOWN_EXPOSURE`], which is the exposure of no request.

mod awaited;
mod measure;

use crate::camera::{Codes, Exposure, Frame};
pub(super) use awaited::{Awaited, measuring};
pub(super) use measure::{Stepped, measure};
use std::collections::VecDeque;

/// The exposure of frames that were taken while it changed: 0 s, which [`Exposure::same_as`] no request is.
pub const UNKNOWN_EXPOSURE: Exposure = Exposure { exposure_s: 0.0, gain: 1.0 };

/// Frames that a new exposure is waited for beyond the delay, while the picture still changes or has not begun to.
pub(super) const MOST_HELD: u32 = 3;
/// A picture is as bright as another within this share of it and this share of white.
const SAME_SHARE: f64 = 0.02;
const SAME_OFFSET: f64 = 0.002;
/// Exposures that differ by less are not told apart by brightness.
const CLEAR_RATIO: f64 = 1.4;
/// Exposures whose last brightness is remembered.
const REMEMBERED: usize = 8;
/// Pixels that a mean is taken over, about.
const MEAN_PIXELS: usize = 4096;

/// Frames from a setting to its effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delay {
    /// So many frames after the newest one complete before it was written still have the setting before.
    pub unchanged_frames: u32,
    /// Counted from the newest frame complete when it had been written, this one and all after it have the new one.
    pub settled_frames: u32,
    /// False when the light did not allow to measure and these are guesses on the safe side.
    pub measured: bool,
}

impl Default for Delay {
    fn default() -> Self {
        Delay { unchanged_frames: 0, settled_frames: 6, measured: false }
    }
}

/// A setting that not all frames have yet.
#[derive(Clone, Copy, Debug)]
struct Change {
    exposure: Exposure,
    /// The newest frames seen before and after it was written; -1 for none.
    before: i64,
    after: i64,
    /// The newest frame that can have been complete after: frames may have been lost unseen.
    complete: Option<i64>,
    held: u32,
}

/// The settings of the frames that come.
#[derive(Clone, Debug)]
pub(super) struct Timeline {
    pub delay: Delay,
    standing: Exposure,
    changes: VecDeque<Change>,
    newest: i64,
    /// The last frame whose exposure is sure, with its mean code as a share of white.
    sure: Option<(Exposure, f64)>,
    /// Number and mean of the last frame that was told its exposure.
    previous: Option<(i64, f64)>,
    /// Exposures and the mean of the last frame that was sure to have them; the oldest is written over.
    remembered: [(Exposure, f64); REMEMBERED],
    oldest: usize,
}

impl Timeline {
    pub(super) fn new(delay: Delay, standing: Exposure) -> Self {
        Timeline {
            delay,
            standing,
            changes: VecDeque::new(),
            newest: -1,
            sure: None,
            previous: None,
            remembered: [(UNKNOWN_EXPOSURE, 0.0); REMEMBERED],
            oldest: 0,
        }
    }

    /// The newest frame that came; -1 for none.
    pub(super) fn newest(&self) -> i64 {
        self.newest
    }

    /// Frames that the newest setting must stand until one of them is sure to have it: those of which it is not known
    /// whether they have it, and one to compare with where nobody knows how bright it will be.
    pub(super) fn stand_frames(&self) -> u32 {
        let newest = self.changes.back().map_or(self.standing, |change| change.exposure);
        let unsure = self.delay.settled_frames.saturating_sub(self.delay.unchanged_frames).max(1);
        unsure + u32::from(self.mean_of(newest).is_none())
    }

    /// How bright the last frame with this exposure was, as a share of white.
    fn mean_of(&self, exposure: Exposure) -> Option<f64> {
        let known = |(of, _): &&(Exposure, f64)| *of != UNKNOWN_EXPOSURE && of.same_as(&exposure);
        self.remembered.iter().find(known).map(|&(_, mean)| mean)
    }

    fn remember(&mut self, exposure: Exposure, mean: f64) {
        if let Some(known) = self.remembered.iter_mut().find(|(of, _)| of.same_as(&exposure)) {
            known.1 = mean;
            return;
        }
        self.remembered[self.oldest] = (exposure, mean);
        self.oldest = (self.oldest + 1) % REMEMBERED;
    }

    /// A setting was written, before which frame `before` was the newest and after which the newest seen now is.
    pub(super) fn requested(&mut self, exposure: Exposure, before: i64) {
        let last = self.changes.back().map_or(self.standing, |change| change.exposure);
        if last != exposure || exposure == UNKNOWN_EXPOSURE {
            self.changes.push_back(Change { exposure, before, after: self.newest, complete: None, held: 0 });
        }
    }

    /// A frame came, whether it is used or not.
    pub(super) fn saw(&mut self, sequence: u64) {
        let sequence = i64::try_from(sequence).unwrap_or(i64::MAX);
        for change in &mut self.changes {
            if sequence > change.after && change.complete.is_none() {
                change.complete = Some(sequence - 1);
            }
        }
        self.newest = self.newest.max(sequence);
    }

    /// The longest exposure that a frame to come may have, seconds.
    pub(super) fn longest_s(&self) -> f64 {
        self.changes.iter().fold(self.standing.exposure_s, |longest, change| longest.max(change.exposure.exposure_s))
    }

    /// The exposure of a frame that was seen, by its number and its mean code as a share of white.
    pub(super) fn exposure_of(&mut self, sequence: u64, mean: f64) -> Exposure {
        let sequence = i64::try_from(sequence).unwrap_or(i64::MAX);
        let exposure = self.by_number(sequence, mean);
        self.previous = Some((sequence, mean));
        match exposure {
            Some(exposure) => {
                self.sure = Some((exposure, mean));
                self.remember(exposure, mean);
                exposure
            }
            None => UNKNOWN_EXPOSURE,
        }
    }

    /// `None` where it is not sure.
    fn by_number(&mut self, sequence: i64, mean: f64) -> Option<Exposure> {
        let (unchanged, settled) = (i64::from(self.delay.unchanged_frames), i64::from(self.delay.settled_frames));
        let (mut is_sure, mut passed) = (true, None);
        for (index, change) in self.changes.iter().enumerate() {
            if change.complete.is_some_and(|complete| sequence >= complete + settled) {
                (is_sure, passed) = (true, Some(index));
            } else if sequence > change.before + unchanged {
                is_sure = false;
            }
        }
        if let Some(index) = passed {
            if self.holds(index, sequence, mean) {
                return None;
            }
            self.standing = self.changes[index].exposure;
            self.changes.drain(..=index);
        }
        (is_sure && self.standing != UNKNOWN_EXPOSURE).then_some(self.standing)
    }

    /// Whether the picture shows that a change, due by its number, is late: it is neither as bright as the frame before nor
    /// as when this exposure was seen last, or as bright as before the change though the exposure is clearly another and
    /// the picture has room to show it.
    fn holds(&mut self, index: usize, sequence: i64, mean: f64) -> bool {
        let settled = i64::from(self.delay.settled_frames);
        let is_expected = self.mean_of(self.changes[index].exposure).is_some_and(|known| is_near(mean, known));
        let change = &mut self.changes[index];
        let since_due = change.complete.map_or(0, |complete| sequence - complete - settled);
        let is_steady = match self.previous {
            Some((number, before)) if number > change.after => is_near(mean, before),
            // Nobody looked in between; a late reader need not wait.
            _ => since_due >= i64::from(MOST_HELD),
        };
        let is_old = self.sure.is_some_and(|(exposure, before)| {
            let ratio = change.exposure.product_s() / exposure.product_s();
            let room = (before * (ratio - 1.0)).min(1.0 - before).abs();
            let is_clear = !(1.0 / CLEAR_RATIO..=CLEAR_RATIO).contains(&ratio) && room > 3.0 * tolerance(before);
            is_clear && is_near(mean, before)
        });
        if change.held >= MOST_HELD || ((is_steady || is_expected) && !is_old) {
            return false;
        }
        change.held += 1;
        change.complete = change.complete.map(|complete| complete + 1);
        true
    }
}

fn tolerance(mean: f64) -> f64 {
    SAME_SHARE * mean + SAME_OFFSET
}

fn is_near(mean: f64, before: f64) -> bool {
    (mean - before).abs() <= tolerance(before)
}

/// Mean of a picture's codes as a share of white, over an even choice of its pixels.
pub(super) fn mean_share(frame: &Frame) -> f64 {
    let pixels = frame.width * frame.height;
    let step = (pixels / MEAN_PIXELS).max(1);
    let (sum, count) = match &frame.codes {
        Codes::U8(codes) => sum_of(codes, step),
        Codes::U16(codes) => sum_of(codes, step),
    };
    sum / (count.max(1) as f64 * f64::from(frame.codes.max()))
}

fn sum_of<T: Copy + Into<u64>>(codes: &[T], step: usize) -> (f64, usize) {
    let chosen = codes.chunks_exact(3).step_by(step);
    let sum: u64 = chosen.clone().flatten().map(|&code| code.into()).sum();
    (sum as f64, chosen.len() * 3)
}

#[cfg(test)]
mod tests;
