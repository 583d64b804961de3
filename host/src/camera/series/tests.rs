use super::*;
use crate::camera::CameraLimits;
use crate::camera::fault::{Fault, FaultyCamera};
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};

const fn of(exposure_s: f64) -> Exposure {
    Exposure { exposure_s, gain: 1.0 }
}

const EXPOSURES: [Exposure; 4] = [of(1e-4), of(8e-4), of(6.4e-3), of(5.12e-2)];

fn camera(delay_frames: u32) -> SyntheticCamera {
    let settings =
        SyntheticSettings { width: 24, height: 24, gamma: 1.0, delay_frames, ..SyntheticSettings::default() };
    SyntheticCamera::new(settings)
}

fn is_whole(series: &Series) -> bool {
    let frames = series.frames();
    let in_order = frames.iter().zip(&EXPOSURES).all(|(frame, exposure)| frame.exposure.same_as(exposure));
    frames.len() == EXPOSURES.len() && in_order
}

/// Loses frames at the given calls, and refuses requests at others.
struct Losing {
    inner: SyntheticCamera,
    lost: Vec<u32>,
    refused: Vec<u32>,
    frames: u32,
    requests: u32,
}

impl Losing {
    fn new(delay_frames: u32, lost: &[u32], refused: &[u32]) -> Self {
        let (lost, refused) = (lost.to_vec(), refused.to_vec());
        Losing { inner: camera(delay_frames), lost, refused, frames: 0, requests: 0 }
    }
}

impl Camera for Losing {
    fn limits(&self) -> CameraLimits {
        self.inner.limits()
    }
    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        self.requests += 1;
        if self.refused.contains(&self.requests) {
            return Err(CameraError::Device { path: "test".into(), what: "busy".into() });
        }
        self.inner.request(exposure)
    }
    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        self.frames += 1;
        if self.lost.contains(&self.frames) {
            self.inner.frame(into)?;
        }
        self.inner.frame(into)
    }
}

#[test]
fn a_series_takes_one_delay_and_its_own_frames() {
    for delay in 0..=6 {
        let (mut camera, mut series) = (camera(delay), Series::default());
        for _ in 0..3 {
            series.take(&mut camera, &EXPOSURES).unwrap();
            assert!(is_whole(&series), "{delay}");
            assert!(series.calls() <= delay.max(1) + EXPOSURES.len() as u32, "{delay}: {} frames", series.calls());
        }
        // What a frame says of its exposure is what it shows: codes of a linear camera rise with it.
        let mean = |frame: &Frame| (0..frame.codes.len()).map(|i| f64::from(frame.codes.get(i))).sum::<f64>();
        let means: Vec<f64> = series.frames().iter().map(mean).collect();
        assert!(
            means.windows(2).all(|pair| pair[1] > 3.0 * pair[0] || pair[1] > 50.0 * 24.0 * 24.0 * 3.0),
            "{means:?}"
        );
    }
}

#[test]
fn lost_frames_are_asked_for_again() {
    for delay in 2..=6 {
        for lost in 1..=delay + 4 {
            let (mut camera, mut series) = (Losing::new(delay, &[lost], &[]), Series::default());
            series.take(&mut camera, &EXPOSURES).unwrap();
            assert!(is_whole(&series), "delay {delay}, frame {lost} lost");
            assert!(series.calls() <= 2 * delay + 9, "delay {delay}, frame {lost} lost: {} frames", series.calls());
        }
    }
}

#[test]
fn repeated_frames_count_once() {
    for delay in 2..=6 {
        for at in 1..10 {
            let mut camera = FaultyCamera::new(camera(delay), vec![(at..at + 1, Fault::Repeated)]);
            let mut series = Series::default();
            series.take(&mut camera, &EXPOSURES).unwrap();
            assert!(is_whole(&series), "delay {delay}, frame {at} repeated");
            let mut sequences: Vec<u64> = series.frames().iter().map(|frame| frame.sequence).collect();
            sequences.dedup();
            assert_eq!(sequences.len(), 4, "{sequences:?}");
        }
    }
}

#[test]
fn a_refused_request_is_made_again_and_the_others_do_not_wait() {
    let (mut camera, mut series) = (Losing::new(3, &[], &[2]), Series::default());
    series.take(&mut camera, &EXPOSURES).unwrap();
    assert!(is_whole(&series));
    // Refused for good.
    let (mut camera, mut series) = (Losing::new(3, &[], &[2, 5, 6]), Series::default());
    series.take(&mut camera, &EXPOSURES).unwrap();
    assert_eq!(series.frames().len(), 3);
    assert!(series.frames()[1].exposure.same_as(&EXPOSURES[2]), "what came stands in order");
    let (mut camera, mut series) = (Losing::new(3, &[], &[1, 2, 3, 4, 5, 6, 7, 8]), Series::default());
    assert!(matches!(series.take(&mut camera, &EXPOSURES), Err(CameraError::Device { .. })));
}

#[test]
fn memory_is_that_of_the_first_series() {
    let (mut camera, mut series) = (Losing::new(2, &[9, 15, 16], &[6]), Series::default());
    let mut places: Vec<usize> = Vec::new();
    for round in 0..6 {
        series.take(&mut camera, &EXPOSURES).unwrap();
        let place = |frame: &Frame| match &frame.codes {
            crate::camera::Codes::U8(codes) => codes.as_ptr() as usize,
            crate::camera::Codes::U16(_) => 0,
        };
        let all = series.slots.iter().chain([&series.spare]).map(place);
        // The spare frame has its memory from the second series on, if not before.
        if round < 2 {
            places = all.collect();
        } else {
            assert!(all.into_iter().all(|at| places.contains(&at)), "{round}");
        }
    }
}
