//! A camera that is opened again when it is lost.

use super::{Camera, CameraError, CameraLimits, Exposure, Frame};
use std::time::{Duration, Instant};

/// How often opening is tried, at most.
const RETRY: Duration = Duration::from_millis(500);

/// How a lost camera is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// Least time from one attempt to open the camera to the next.
    pub retry: Duration,
    /// Longest time that one call waits while there is no camera.
    pub call: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Patience { retry: RETRY, call: RETRY }
    }
}

/// Opens a camera by `F` whenever there is none, and gives it the last exposure asked for: after a replug cameras are at
/// their own settings. While there is no camera every call waits a little and fails, so that callers need no pause.
pub struct Reopening<C, F> {
    open: F,
    camera: Option<C>,
    limits: CameraLimits,
    patience: Patience,
    attempted: Option<Instant>,
    wanted: Option<Exposure>,
    reopenings: u64,
    /// Added to sequence numbers, which start again with the camera.
    sequence_base: u64,
    next_sequence: u64,
}

impl<C: Camera, F: FnMut() -> Result<C, CameraError>> Reopening<C, F> {
    /// Opens the camera.
    ///
    /// # Errors
    /// Why it does not open; use [`Reopening::waiting`] to go on without it.
    pub fn open(mut open: F, patience: Patience) -> Result<Self, CameraError> {
        let camera = open()?;
        let mut reopening = Self::waiting(open, camera.limits(), patience);
        reopening.camera = Some(camera);
        Ok(reopening)
    }

    /// Starts without the camera, which counts as lost. `limits` stand until it is there.
    pub fn waiting(open: F, limits: CameraLimits, patience: Patience) -> Self {
        Reopening {
            open,
            camera: None,
            limits,
            patience,
            attempted: None,
            wanted: None,
            reopenings: 0,
            sequence_base: 0,
            next_sequence: 0,
        }
    }

    /// How often the camera was opened after it had been lost (or not been there).
    pub fn reopenings(&self) -> u64 {
        self.reopenings
    }

    /// The camera, unless it is lost.
    pub fn camera_mut(&mut self) -> Option<&mut C> {
        self.camera.as_mut()
    }

    /// Waits until an attempt is due, no longer than a call may; true when it is.
    fn is_due(&self) -> bool {
        let left = self.attempted.map_or(Duration::ZERO, |at| self.patience.retry.saturating_sub(at.elapsed()));
        std::thread::sleep(left.min(self.patience.call));
        left <= self.patience.call
    }

    fn ensure_open(&mut self) -> Result<(), CameraError> {
        if self.camera.is_some() {
            return Ok(());
        }
        if !self.is_due() {
            return Err(CameraError::Lost);
        }
        self.attempted = Some(Instant::now());
        let mut camera = (self.open)()?;
        if let Some(wanted) = self.wanted {
            camera.request(wanted)?;
        }
        self.limits = camera.limits();
        self.sequence_base = self.next_sequence;
        self.reopenings += 1;
        self.camera = Some(camera);
        Ok(())
    }

    /// Calls the camera, opens it before if need be, lets go of it when it says that it is lost.
    fn with<T>(&mut self, call: impl FnOnce(&mut C) -> Result<T, CameraError>) -> Result<T, CameraError> {
        self.ensure_open()?;
        let camera = self.camera.as_mut().ok_or(CameraError::Lost)?;
        let result = call(camera);
        if matches!(result, Err(CameraError::Lost)) {
            self.camera = None;
        }
        result
    }
}

impl<C: Camera, F: FnMut() -> Result<C, CameraError> + Send> Camera for Reopening<C, F> {
    fn stand_frames(&self) -> u32 {
        self.camera.as_ref().map_or(1, Camera::stand_frames)
    }

    fn limits(&self) -> CameraLimits {
        self.camera.as_ref().map_or(self.limits, Camera::limits)
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        self.wanted = Some(exposure);
        self.with(|camera| camera.request(exposure))
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        self.with(|camera| camera.frame(into))?;
        into.sequence += self.sequence_base;
        self.next_sequence = into.sequence + 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::fault::{Fault, FaultyCamera};
    use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
    use crate::camera::take_series;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    const PATIENCE: Patience = Patience { retry: Duration::from_millis(40), call: Duration::from_millis(15) };
    const WANTED: Exposure = Exposure { exposure_s: 4e-3, gain: 1.0 };

    fn camera(lost_from: u64) -> FaultyCamera<SyntheticCamera> {
        let settings = SyntheticSettings { width: 32, height: 32, delay_frames: 1, ..SyntheticSettings::default() };
        FaultyCamera::new(SyntheticCamera::new(settings), vec![(lost_from..u64::MAX, Fault::Lost)])
    }

    type Faulty = FaultyCamera<SyntheticCamera>;

    /// Opens cameras that live for five frames; `fails` attempts after the first fail.
    fn flaky(fails: u32) -> (Arc<AtomicU32>, impl FnMut() -> Result<Faulty, CameraError> + Send) {
        let attempts = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&attempts);
        let open = move || {
            let attempt = counted.fetch_add(1, Ordering::Relaxed);
            if (1..=fails).contains(&attempt) {
                return Err(CameraError::Busy { path: "/dev/video0".into() });
            }
            Ok(camera(5))
        };
        (attempts, open)
    }

    #[test]
    fn a_lost_camera_comes_back_with_the_exposure_asked_for() {
        let (attempts, open) = flaky(2);
        let mut camera = Reopening::open(open, PATIENCE).unwrap();
        camera.request(WANTED).unwrap();
        let mut frame = Frame::default();
        let mut sequences = Vec::new();
        let mut errors = Vec::new();
        while sequences.len() < 9 {
            match camera.frame(&mut frame) {
                Ok(()) => sequences.push(frame.sequence),
                Err(error) => errors.push(error.to_string()),
            }
        }
        assert_eq!(camera.reopenings(), 1);
        assert_eq!(attempts.load(Ordering::Relaxed), 4);
        assert!(frame.exposure.same_as(&WANTED), "{:?}", frame.exposure);
        assert!(sequences.is_sorted_by(|a, b| a < b), "{sequences:?}");
        assert!(errors.iter().any(|error| error.contains("in use")) && errors[0].contains("gone"), "{errors:?}");
    }

    #[test]
    fn no_call_waits_long_and_none_returns_at_once() {
        let (attempts, open) = flaky(u32::MAX - 1);
        let mut camera = Reopening::open(open, PATIENCE).unwrap();
        let mut frames = Vec::new();
        take_series(&mut camera, &[WANTED; 2], &mut frames).unwrap();
        while camera.frame(&mut Frame::default()).is_ok() {}
        let (start, mut calls) = (Instant::now(), 0);
        while start.elapsed() < Duration::from_millis(400) {
            let call = Instant::now();
            let error = take_series(&mut camera, &[WANTED; 2], &mut frames).unwrap_err();
            assert!(matches!(error, CameraError::Lost | CameraError::Busy { .. }), "{error}");
            assert!(call.elapsed() < Duration::from_millis(200), "{:?}", call.elapsed());
            calls += 1;
        }
        // 400 ms / 40 ms between attempts, 400 ms / 15 ms between calls.
        let attempts = attempts.load(Ordering::Relaxed) - 1;
        assert!((2..=11).contains(&attempts), "{attempts} attempts");
        assert!(calls <= 40, "{calls} calls");
        assert_eq!(camera.reopenings(), 0);
    }

    #[test]
    fn a_camera_may_be_missing_at_first() {
        let limits = camera(0).limits();
        let mut attempts = 0;
        let open = move || {
            attempts += 1;
            if attempts < 3 { Err(CameraError::Lost) } else { Ok(camera(5)) }
        };
        let mut camera = Reopening::waiting(open, limits, PATIENCE);
        assert_eq!(camera.limits(), limits);
        let accepted = (0..100).find_map(|_| camera.request(WANTED).ok()).unwrap();
        assert!(accepted.same_as(&WANTED));
        assert_eq!(camera.reopenings(), 1);
    }
}
