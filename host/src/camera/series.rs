//! Exposure series: one frame for each of several exposures, with requests written ahead of the frames that show them.
//!
//! A request shows some frames after it was written. Who waits for each before writing the next pays that delay once per
//! exposure. Here the next request is written as soon as the one before has stood for [`Camera::stand_frames`], and frames
//! are matched by the exposure that the driver says they had: N exposures take about N frames and one delay. What was lost
//! on the way is asked for once more, one by one.

use super::{Camera, CameraError, Exposure, Frame};

/// Frames that are waited for beyond the camera's delay.
const PATIENCE: u32 = 3;

/// Takes series into memory that is reused.
#[derive(Debug, Default)]
pub struct Series {
    /// One per exposure; those that came stand first after a series.
    slots: Vec<Frame>,
    /// What the camera made of each exposure asked for; none while it is not asked for, or was refused.
    accepted: Vec<Option<Exposure>>,
    found: Vec<bool>,
    spare: Frame,
    /// Frames that came, and calls for one that were made, in the newest series.
    taken: usize,
    calls: u32,
    /// Did any frame come?
    came: bool,
    last_sequence: Option<u64>,
}

/// A camera that will give nothing more in this series.
fn is_gone(error: &CameraError) -> bool {
    matches!(error, CameraError::Lost | CameraError::Ended)
}

impl Series {
    /// The frames that came, in the order in which their exposures were asked for.
    pub fn frames(&self) -> &[Frame] {
        &self.slots[..self.taken]
    }

    /// How many frames the camera was asked for in the newest series.
    pub fn calls(&self) -> u32 {
        self.calls
    }

    /// Takes one frame per exposure. A frame counts for an exposure when the value read back is the one that the camera
    /// accepted; one that comes twice counts once. Exposures that do not come in time are left out.
    ///
    /// # Errors
    /// The last [`CameraError`] when no frame at all came.
    pub fn take(&mut self, camera: &mut dyn Camera, exposures: &[Exposure]) -> Result<(), CameraError> {
        self.prepare(exposures.len());
        let mut failure = self.pipelined(camera, exposures);
        for (index, &exposure) in exposures.iter().enumerate() {
            let is_hopeless = failure.as_ref().is_some_and(is_gone) || !self.found.contains(&true);
            if !self.found[index] && !is_hopeless {
                failure = self.alone(camera, exposure, index).err().or(failure);
            }
        }
        self.gather();
        if self.taken > 0 { Ok(()) } else { Err(self.told(failure)) }
    }

    /// Why nothing was taken: frames that came showed another exposure; without any frame nothing is known of theirs.
    fn told(&self, failure: Option<CameraError>) -> CameraError {
        match (failure, self.accepted.iter().flatten().next()) {
            (None | Some(CameraError::Timeout), Some(&exposure)) if self.came => {
                CameraError::NoSuchExposure { exposure, frames: self.calls }
            }
            (failure, _) => failure.unwrap_or(CameraError::Timeout),
        }
    }

    fn prepare(&mut self, count: usize) {
        if self.slots.len() < count {
            self.slots.resize_with(count, Frame::default);
        }
        self.accepted.clear();
        self.accepted.resize(count, None);
        self.found.clear();
        self.found.resize(count, false);
        (self.taken, self.calls, self.came) = (0, 0, false);
    }

    /// Writes all requests, as close behind each other as the camera allows, and takes what comes. The last error.
    fn pipelined(&mut self, camera: &mut dyn Camera, exposures: &[Exposure]) -> Option<CameraError> {
        let patience = camera.limits().delay_frames + PATIENCE;
        let (mut asked, mut stood, mut hard, mut failure) = (0, u32::MAX, 0, None);
        loop {
            let is_waiting = (0..asked).any(|index| self.accepted[index].is_some() && !self.found[index]);
            let is_over = asked == exposures.len() && (!is_waiting || stood >= patience);
            if is_over || hard > exposures.len() || failure.as_ref().is_some_and(is_gone) {
                return failure;
            }
            if asked < exposures.len() && (stood >= camera.stand_frames() || !is_waiting) {
                match camera.request(exposures[asked]) {
                    Ok(accepted) => (self.accepted[asked], stood) = (Some(accepted), 0),
                    Err(error) => (hard, failure) = (hard + 1, Some(error)),
                }
                asked += 1;
                continue;
            }
            stood = stood.saturating_add(1);
            match self.next(camera) {
                Ok(()) => self.match_spare(asked),
                Err(CameraError::Timeout) => failure = Some(CameraError::Timeout),
                Err(error) => (hard, failure) = (hard + 1, Some(error)),
            }
        }
    }

    /// The next frame into the spare one.
    fn next(&mut self, camera: &mut dyn Camera) -> Result<(), CameraError> {
        self.calls += 1;
        let outcome = camera.frame(&mut self.spare);
        self.came |= outcome.is_ok();
        outcome
    }

    /// Gives the spare frame to the first of the exposures asked for that it shows and that has none yet.
    fn match_spare(&mut self, asked: usize) {
        if self.last_sequence.replace(self.spare.sequence) == Some(self.spare.sequence) {
            return;
        }
        let shows = |index: &usize| {
            let is_it = |accepted: Exposure| accepted.same_as(&self.spare.exposure);
            !self.found[*index] && self.accepted[*index].is_some_and(is_it)
        };
        if let Some(index) = (0..asked).find(shows) {
            std::mem::swap(&mut self.slots[index], &mut self.spare);
            self.found[index] = true;
        }
    }

    /// Asks for one exposure and waits for it.
    fn alone(&mut self, camera: &mut dyn Camera, exposure: Exposure, index: usize) -> Result<(), CameraError> {
        self.accepted.fill(None);
        let accepted = camera.request(exposure)?;
        self.accepted[index] = Some(accepted);
        let frames = camera.limits().delay_frames + PATIENCE;
        for _ in 0..frames {
            match self.next(camera) {
                Ok(()) => self.match_spare(index + 1),
                Err(CameraError::Timeout) => {}
                Err(error) => return Err(error),
            }
            if self.found[index] {
                return Ok(());
            }
        }
        Err(CameraError::NoSuchExposure { exposure: accepted, frames })
    }

    /// Moves the frames that came to the front, in order.
    fn gather(&mut self) {
        for index in 0..self.found.len() {
            if self.found[index] {
                self.slots.swap(self.taken, index);
                self.taken += 1;
            }
        }
    }
}

/// Takes one frame per exposure, in order, into `frames` (reused; its length becomes the number of frames that came); see
/// [`Series::take`].
///
/// # Errors
/// The last [`CameraError`] when no frame at all came.
pub fn take_series(
    camera: &mut dyn Camera,
    exposures: &[Exposure],
    frames: &mut Vec<Frame>,
) -> Result<(), CameraError> {
    let mut series = Series { slots: std::mem::take(frames), ..Series::default() };
    let taken = series.take(camera, exposures);
    series.slots.truncate(series.taken);
    *frames = series.slots;
    taken
}

#[cfg(test)]
mod tests;
