//! What a frame is taken with, what takes effect when, and what the camera chooses by itself.

use crate::controls::{Control, Controls, NEUTRAL_K};
use std::collections::VecDeque;
use std::fmt;

/// What a frame is taken with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Exposure time, 100 us.
    pub exposure_100us: u32,
    /// Value of the gain control, 0..=255.
    pub gain: i32,
    /// White balance temperature, K.
    pub temperature_k: i32,
}

impl Settings {
    /// Exposure time, seconds.
    pub fn exposure_s(&self) -> f64 {
        f64::from(self.exposure_100us) * 1e-4
    }
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "exposure {} gain {} temperature {}", self.exposure_100us, self.gain, self.temperature_k)
    }
}

/// Delays settings: a frame is taken with what stood `latency` frames before it started, so that what is set during
/// frame N shows in frame N + latency + 1 first.
#[derive(Clone, Debug, Default)]
pub struct Delay {
    /// Newest first.
    stood: VecDeque<Settings>,
}

impl Delay {
    /// A frame starts: what stands now goes in, what the frame is taken with comes out.
    pub fn start_frame(&mut self, standing: Settings, latency: usize) -> Settings {
        self.stood.push_front(standing);
        self.stood.truncate(latency + 1);
        self.stood.back().copied().unwrap_or(standing)
    }
}

/// Luma that automatic exposure brings the picture's mean to.
const TARGET_LUMA: f64 = 110.0;
/// Automatic exposure leaves a mean within this factor alone.
const STEADY: f64 = 1.08;

/// Automatic exposure and white balance.
#[derive(Clone, Debug)]
pub struct Automatic {
    exposure_100us: f64,
    temperature_k: i32,
}

impl Default for Automatic {
    fn default() -> Self {
        Automatic { exposure_100us: 156.0, temperature_k: NEUTRAL_K }
    }
}

/// Means of a YUYV picture, every 16th pair of pixels: luma and the two chromas.
fn means(yuyv: &[u8]) -> [f64; 3] {
    let mut sums = [0u32; 3];
    let mut count = 0u32;
    for pair in yuyv.chunks_exact(4).step_by(16) {
        sums[0] += u32::from(pair[0]);
        sums[1] += u32::from(pair[1]);
        sums[2] += u32::from(pair[3]);
        count += 1;
    }
    sums.map(|sum| f64::from(sum) / f64::from(count.max(1)))
}

impl Automatic {
    /// Sees a picture that was taken and chooses what is automatic by `controls` for those to come: the exposure goes half
    /// the way (as a power law of 2.2 would have it) to a mean luma of 110, at most `longest_100us`; the temperature steps
    /// towards equal chromas.
    pub fn see(&mut self, yuyv: &[u8], controls: &Controls, longest_100us: f64) {
        let [luma, blue, red] = means(yuyv);
        if !controls.is_manual() {
            self.follow(luma, longest_100us);
        }
        if controls.get(Control::WhiteBalanceAuto) == 1 && (blue - red).abs() > 3.0 {
            let step = if blue > red { 100 } else { -100 };
            self.temperature_k = (self.temperature_k + step).clamp(2800, 10_000);
        }
    }

    fn follow(&mut self, luma: f64, longest_100us: f64) {
        let wanted = (TARGET_LUMA - 16.0) / (luma - 16.0).max(1.0);
        if !(1.0 / STEADY..STEADY).contains(&wanted) {
            self.exposure_100us *= wanted.powf(1.1).clamp(0.25, 4.0);
        }
        self.exposure_100us = self.exposure_100us.clamp(1.0, longest_100us.max(1.0));
    }

    /// What stands now, by the controls and by these choices.
    pub fn settings(&self, controls: &Controls) -> Settings {
        let manual = controls.is_manual();
        let automatic_white = controls.get(Control::WhiteBalanceAuto) == 1;
        Settings {
            exposure_100us: if manual {
                controls.get(Control::ExposureTime) as u32
            } else {
                self.exposure_100us.round() as u32
            },
            gain: controls.get(Control::Gain),
            temperature_k: if automatic_white { self.temperature_k } else { controls.get(Control::WhiteBalance) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(exposure_100us: u32) -> Settings {
        Settings { exposure_100us, gain: 0, temperature_k: NEUTRAL_K }
    }

    #[test]
    fn what_is_set_during_a_frame_shows_latency_and_one_frames_later() {
        for latency in [0, 2, 3] {
            let mut delay = Delay::default();
            let mut taken = Vec::new();
            for frame in 0..20 {
                // Frame 9 has started when 500 is set.
                let standing = if frame <= 9 { 100 } else { 500 };
                taken.push(delay.start_frame(settings(standing), latency).exposure_100us);
            }
            let first = taken.iter().position(|&exposure| exposure == 500).unwrap();
            assert_eq!(first, 9 + latency + 1);
        }
    }

    #[test]
    fn automatic_exposure_finds_its_mean_and_stays() {
        let mut automatic = Automatic::default();
        let mut exposures = Vec::new();
        for _ in 0..40 {
            let standing = automatic.settings(&Controls::default()).exposure_100us;
            // A grey picture: luma = 219 (0.02 exposure)^(1/2.2).
            let luma = 16.0 + 219.0 * (f64::from(standing) * 0.02).powf(1.0 / 2.2).min(1.0);
            automatic.see(&[luma as u8, 128, luma as u8, 128].repeat(64), &Controls::default(), 10_000.0);
            exposures.push(standing);
        }
        // 94 / 219 = 0.429 -> fraction 0.156 -> 7.8.
        let last = exposures[39];
        assert!((7..=9).contains(&last) && exposures[30..].iter().all(|&e| e == last), "{exposures:?}");
    }

    #[test]
    fn automatic_exposure_keeps_to_its_longest_and_white_balance_follows_the_picture() {
        let mut automatic = Automatic::default();
        for _ in 0..100 {
            automatic.see(&[16, 140, 16, 120].repeat(64), &Controls::default(), 333.0);
        }
        let standing = automatic.settings(&Controls::default());
        assert_eq!((standing.exposure_100us, standing.temperature_k), (333, 10_000));
        let mut controls = Controls::default();
        controls.force(Control::WhiteBalanceAuto, 0);
        controls.force(Control::ExposureMode, 1);
        let held = automatic.clone();
        automatic.see(&[235, 140, 235, 120].repeat(64), &controls, 333.0);
        assert_eq!(automatic.settings(&controls), settings(156));
        let default = Controls::default();
        assert_eq!(automatic.settings(&default), held.settings(&default), "what is manual is left alone");
    }
}
