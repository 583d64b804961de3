//! The clock a post lives by: the system's, or one of its own for replays and benches.

mod synchronised;

use crate::config::ClockConfig;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use synchronised::Synchronised;

/// 2025-01-01: no post was built before, so an earlier clock has lost its time.
const EARLIEST_UNIX_S: f64 = 1_735_689_600.0;
/// How long a wait goes on after a stop was asked for, at most.
const SLICE: Duration = Duration::from_millis(50);

/// A moment by the post's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Unix seconds.
    pub unix_s: f64,
    /// False when the clock cannot be right; the sun's place must not be taken from it.
    pub trusted: bool,
}

/// The post's clock.
#[derive(Clone, Debug)]
pub struct PostClock {
    config: ClockConfig,
    started: Instant,
    not_before_unix_s: f64,
    synchronised: Synchronised,
}

impl PostClock {
    /// Starts the clock. A system clock that shows a time before `not_before` (when the field was made) is not trusted, nor
    /// one that waits for a time server and has nothing else to keep the time by.
    pub fn start(config: ClockConfig, not_before: Option<SystemTime>) -> Self {
        let made = not_before.map_or(0.0, unix_s);
        PostClock {
            config,
            started: Instant::now(),
            not_before_unix_s: made.max(EARLIEST_UNIX_S),
            synchronised: Synchronised::of_system(),
        }
    }

    /// The time of frame `number`, now.
    pub fn now(&self, number: u64) -> Moment {
        match self.config {
            ClockConfig::System { .. } => self.judge(unix_s(SystemTime::now())),
            ClockConfig::Simulated { start_unix_s, step_s, .. } => {
                Moment { unix_s: start_unix_s + number as f64 * step_s, trusted: true }
            }
        }
    }

    fn judge(&self, unix_s: f64) -> Moment {
        // An hour of grace: files copied from a machine whose clock runs a little ahead.
        let is_late_enough = unix_s > self.not_before_unix_s - 3600.0;
        Moment { unix_s, trusted: is_late_enough && self.synchronised.is_likely() }
    }

    /// False where the system's clock waits for a time server and has nothing else to keep the time by.
    pub fn may_be_set(&self) -> bool {
        self.synchronised.is_likely()
    }

    /// Waits until frame `number` is due; returns early when `stop` is set.
    pub fn wait_for(&self, number: u64, stop: &AtomicBool) {
        let pace_s = match self.config {
            ClockConfig::System { interval_s } => interval_s,
            ClockConfig::Simulated { step_s, speed: Some(speed), .. } => step_s / speed,
            ClockConfig::Simulated { speed: None, .. } => return,
        };
        let due = Duration::try_from_secs_f64(pace_s * number as f64).unwrap_or(Duration::MAX);
        while !stop.load(Ordering::Relaxed) {
            match due.checked_sub(self.started.elapsed()) {
                Some(left) if !left.is_zero() => std::thread::sleep(left.min(SLICE)),
                _ => return,
            }
        }
    }

    /// `simulated`, `system`, or `not trusted`.
    pub fn state(&self, moment: Moment) -> &'static str {
        match (self.config, moment.trusted) {
            (ClockConfig::Simulated { .. }, _) => "simulated",
            (ClockConfig::System { .. }, true) => "system",
            (ClockConfig::System { .. }, false) => "not trusted",
        }
    }
}

fn unix_s(time: SystemTime) -> f64 {
    time.duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_simulated_clock_steps_and_does_not_wait() {
        let config = ClockConfig::Simulated { start_unix_s: 100.0, step_s: 60.0, speed: None };
        let clock = PostClock::start(config, None);
        clock.wait_for(1_000_000, &AtomicBool::new(false));
        assert_eq!(clock.now(3), Moment { unix_s: 280.0, trusted: true });
    }

    #[test]
    fn a_clock_before_the_field_was_made_is_not_trusted() {
        let made = UNIX_EPOCH + Duration::from_secs(1_800_000_000);
        let clock = PostClock::start(ClockConfig::System { interval_s: 1.0 }, Some(made));
        assert!(!clock.judge(1_790_000_000.0).trusted);
        assert!(clock.judge(1_800_000_001.0).trusted);
        let clock = PostClock::start(ClockConfig::System { interval_s: 1.0 }, None);
        assert!(!clock.judge(0.0).trusted, "1970, a board without a battery clock");
    }

    #[test]
    fn a_stop_ends_the_wait_at_once() {
        let clock = PostClock::start(ClockConfig::System { interval_s: 3600.0 }, None);
        let begun = Instant::now();
        clock.wait_for(1, &AtomicBool::new(true));
        assert!(begun.elapsed() < Duration::from_secs(5));
    }
}
