//! Faults on top of any camera, for tests and rehearsals: what real ones do when things go wrong.

use super::{Camera, CameraError, CameraLimits, Codes, Exposure, Frame};
use std::ops::Range;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// Frames do not come in time.
    Timeout,
    /// The camera is unplugged; requests fail too.
    Lost,
    /// The frame before is handed out again.
    Repeated,
    /// Frames are black.
    Black,
    /// Frames are white.
    White,
    /// The exposure read back is wrong by this factor.
    Misreported(f64),
    /// One column keeps one code.
    StuckColumn(usize, u8),
}

/// A camera with faults at given frames.
pub struct FaultyCamera<C> {
    inner: C,
    schedule: Vec<(Range<u64>, Fault)>,
    asked: u64,
    last: Option<Frame>,
}

impl<C: Camera> FaultyCamera<C> {
    /// Wraps a camera; each fault holds for the calls of `frame` numbered (from 0) by its range.
    pub fn new(inner: C, schedule: Vec<(Range<u64>, Fault)>) -> Self {
        FaultyCamera { inner, schedule, asked: 0, last: None }
    }

    /// The camera inside.
    pub fn inner_mut(&mut self) -> &mut C {
        &mut self.inner
    }

    fn fault(&self, at: u64) -> Option<Fault> {
        self.schedule.iter().find(|(range, _)| range.contains(&at)).map(|&(_, fault)| fault)
    }
}

fn fill(codes: &mut Codes, share: f64) {
    match codes {
        Codes::U8(codes) => codes.fill((share * 255.0) as u8),
        Codes::U16(codes) => codes.fill((share * 65535.0) as u16),
    }
}

fn stick(frame: &mut Frame, column: usize, code: u8) {
    let width = frame.width;
    let hits = |index: &usize| width > 0 && (index / 3) % width == column;
    match &mut frame.codes {
        Codes::U8(codes) => (0..codes.len()).filter(hits).for_each(|i| codes[i] = code),
        Codes::U16(codes) => (0..codes.len()).filter(hits).for_each(|i| codes[i] = u16::from(code) * 257),
    }
}

impl<C: Camera> Camera for FaultyCamera<C> {
    fn stand_frames(&self) -> u32 {
        self.inner.stand_frames()
    }

    fn limits(&self) -> CameraLimits {
        self.inner.limits()
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        match self.fault(self.asked) {
            // A lost camera comes back when the schedule says so; the failed request counts as time passing.
            Some(Fault::Lost) => {
                self.asked += 1;
                Err(CameraError::Lost)
            }
            _ => self.inner.request(exposure),
        }
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        let fault = self.fault(self.asked);
        self.asked += 1;
        match fault {
            Some(Fault::Timeout) => return Err(CameraError::Timeout),
            Some(Fault::Lost) => return Err(CameraError::Lost),
            Some(Fault::Repeated) => {
                if let Some(last) = &self.last {
                    into.clone_from(last);
                    return Ok(());
                }
            }
            _ => {}
        }
        self.inner.frame(into)?;
        match fault {
            Some(Fault::Black) => fill(&mut into.codes, 0.0),
            Some(Fault::White) => fill(&mut into.codes, 1.0),
            Some(Fault::Misreported(factor)) => into.exposure.exposure_s *= factor,
            Some(Fault::StuckColumn(column, code)) => stick(into, column, code),
            _ => {}
        }
        if self.schedule.iter().any(|(_, fault)| *fault == Fault::Repeated) {
            self.last = Some(into.clone());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
    use crate::camera::take_series;

    fn camera(schedule: Vec<(Range<u64>, Fault)>) -> FaultyCamera<SyntheticCamera> {
        let settings = SyntheticSettings { width: 48, height: 48, delay_frames: 1, ..SyntheticSettings::default() };
        FaultyCamera::new(SyntheticCamera::new(settings), schedule)
    }

    const SERIES: [Exposure; 2] = [Exposure { exposure_s: 1e-3, gain: 1.0 }, Exposure { exposure_s: 8e-3, gain: 1.0 }];

    #[test]
    fn late_frames_are_waited_for_and_a_lost_camera_ends_the_series() {
        let mut frames = Vec::new();
        take_series(&mut camera(vec![(1..3, Fault::Timeout)]), &SERIES, &mut frames).unwrap();
        assert_eq!(frames.len(), 2);
        let silent = take_series(&mut camera(vec![(0..99, Fault::Timeout)]), &SERIES, &mut frames);
        assert!(matches!(silent, Err(CameraError::Timeout)), "no frame at all: {silent:?}");
        take_series(&mut camera(vec![(2..99, Fault::Lost)]), &SERIES, &mut frames).unwrap();
        assert_eq!(frames.len(), 1);
        let mut lost = camera(vec![(0..2, Fault::Lost)]);
        assert!(matches!(take_series(&mut lost, &SERIES, &mut frames), Err(CameraError::Lost)));
        assert!(matches!(take_series(&mut lost, &SERIES, &mut frames), Err(CameraError::Lost)));
        take_series(&mut lost, &SERIES, &mut frames).unwrap();
    }

    #[test]
    fn pictures_are_spoilt_as_told() {
        let mut frame = Frame::default();
        let schedule = vec![(0..1, Fault::White), (1..2, Fault::Repeated), (2..3, Fault::StuckColumn(7, 9))];
        let mut camera = camera(schedule);
        camera.frame(&mut frame).unwrap();
        assert!((0..frame.codes.len()).all(|i| frame.codes.get(i) == 255));
        let first = frame.sequence;
        camera.frame(&mut frame).unwrap();
        assert_eq!(frame.sequence, first);
        camera.frame(&mut frame).unwrap();
        assert_eq!(frame.codes.get((20 * 48 + 7) * 3 + 1), 9);
    }
}
