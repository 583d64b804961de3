//! The clock a post lives by: the system's, or one of its own for replays and benches.

mod hardware;
mod synchronised;

use crate::bell::Bell;
use crate::config::ClockConfig;
pub use hardware::HardwareClock;
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
    /// When the newest frame was due, after the start.
    due: Duration,
    not_before_unix_s: f64,
    synchronised: Synchronised,
}

impl PostClock {
    /// Starts the clock. A system clock that shows a time before `not_before` (when the field was made) is not trusted, nor
    /// one that waits for a time server and has no hardware clock that can be right.
    pub fn start(config: ClockConfig, not_before: Option<SystemTime>) -> Self {
        let not_before_unix_s = not_before.map_or(0.0, unix_s).max(EARLIEST_UNIX_S);
        PostClock {
            config,
            started: Instant::now(),
            due: Duration::ZERO,
            not_before_unix_s,
            synchronised: Synchronised::of_system(unix_s(SystemTime::now()), not_before_unix_s),
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
        let is_late_enough = unix_s > self.not_before_unix_s - hardware::GRACE_S;
        Moment { unix_s, trusted: is_late_enough && self.synchronised.is_likely() }
    }

    /// False where the system's clock waits for a time server and has nothing else to keep the time by.
    pub fn may_be_set(&self) -> bool {
        self.synchronised.is_likely()
    }

    /// The machine's hardware clock as it was at the start, if it has one.
    pub fn hardware(&self) -> Option<HardwareClock> {
        self.synchronised.hardware()
    }

    /// Whether the system's time service has heard from a time server.
    pub fn has_heard(&self) -> bool {
        self.synchronised.has_heard()
    }

    /// Waits until the next frame is due; returns early when `stop` is set. Frames that were missed are left out.
    pub fn wait(&mut self, stop: &AtomicBool) {
        self.wait_until(stop, |left| {
            std::thread::sleep(left);
            false
        });
    }

    /// The same, but by the system's clock it returns early when `bell` rings too; the beat stays as it was. By a clock of its
    /// own a frame more would be a moment more.
    pub fn wait_or_ring(&mut self, stop: &AtomicBool, bell: &Bell) {
        if !matches!(self.config, ClockConfig::System { .. }) {
            return self.wait(stop);
        }
        self.wait_until(stop, |left| {
            bell.wait(left);
            bell.take()
        });
    }

    /// Waits in `slice`s until the next frame is due, `stop` is set or a slice tells that it is enough.
    fn wait_until(&mut self, stop: &AtomicBool, mut slice: impl FnMut(Duration) -> bool) {
        let Some(pace_s) = self.pace_s() else { return };
        let pace = Duration::try_from_secs_f64(pace_s).unwrap_or(Duration::MAX);
        let due = next_due(self.due, self.started.elapsed(), pace);
        while !stop.load(Ordering::Relaxed) {
            match due.checked_sub(self.started.elapsed()) {
                Some(left) if !left.is_zero() => {
                    if slice(left.min(SLICE)) {
                        return;
                    }
                }
                _ => break,
            }
        }
        self.due = due;
    }

    /// From frame to frame; `None` where nothing is waited for.
    fn pace_s(&self) -> Option<f64> {
        match self.config {
            ClockConfig::System { interval_s } => Some(interval_s),
            ClockConfig::Simulated { step_s, speed, .. } => speed.map(|speed| step_s / speed),
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

/// When the frame after the one that was due at `last` is due: a `pace` later, or at the newest of such moments that has
/// passed. A frame that is late by less than a pace thus leaves the beat as it was, and whoever was held up for longer goes on
/// in the beat instead of running after it.
fn next_due(last: Duration, now: Duration, pace: Duration) -> Duration {
    let passed = now.saturating_sub(last).as_nanos().checked_div(pace.as_nanos()).unwrap_or(1);
    last.saturating_add(pace.saturating_mul(passed.clamp(1, u128::from(u32::MAX)) as u32))
}

fn unix_s(time: SystemTime) -> f64 {
    time.duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_simulated_clock_steps_and_does_not_wait() {
        let config = ClockConfig::Simulated { start_unix_s: 100.0, step_s: 60.0, speed: None };
        let mut clock = PostClock::start(config, None);
        clock.wait(&AtomicBool::new(false));
        assert_eq!(clock.now(3), Moment { unix_s: 280.0, trusted: true });
    }

    #[test]
    fn a_clock_before_the_field_was_made_is_not_trusted() {
        let made = UNIX_EPOCH + Duration::from_secs(1_800_000_000);
        let mut clock = PostClock::start(ClockConfig::System { interval_s: 1.0 }, Some(made));
        clock.synchronised = Synchronised::with(None, Path::new("no/time/service"));
        assert!(!clock.judge(1_790_000_000.0).trusted);
        assert!(clock.judge(1_800_000_001.0).trusted);
        let clock = PostClock::start(ClockConfig::System { interval_s: 1.0 }, None);
        assert!(!clock.judge(0.0).trusted, "1970, a board without a battery clock");
    }

    #[test]
    fn a_bell_ends_the_wait_and_leaves_the_beat() {
        let mut clock = PostClock::start(ClockConfig::System { interval_s: 1000.0 }, None);
        let (bell, stop, begun) = (Bell::for_this_thread(), AtomicBool::new(false), Instant::now());
        let ringing = bell.clone();
        let ringer = std::thread::spawn(move || ringing.ring());
        clock.wait_or_ring(&stop, &bell);
        ringer.join().unwrap();
        bell.ring();
        clock.wait_or_ring(&stop, &bell);
        assert!(begun.elapsed() < Duration::from_secs(500));
        assert_eq!(clock.due, Duration::ZERO, "the frame that is due is still to come");
        assert!(!bell.take(), "one ring, one frame");
    }

    #[test]
    fn a_clock_of_its_own_does_not_hear_the_bell() {
        let config = ClockConfig::Simulated { start_unix_s: 0.0, step_s: 1.0, speed: Some(20.0) };
        let (mut clock, bell) = (PostClock::start(config, None), Bell::for_this_thread());
        bell.ring();
        let begun = Instant::now();
        clock.wait_or_ring(&AtomicBool::new(false), &bell);
        assert!(begun.elapsed() >= Duration::from_millis(25), "{:?}", begun.elapsed());
    }

    #[test]
    fn a_stop_ends_the_wait_at_once() {
        let mut clock = PostClock::start(ClockConfig::System { interval_s: 3600.0 }, None);
        let begun = Instant::now();
        clock.wait(&AtomicBool::new(true));
        assert!(begun.elapsed() < Duration::from_secs(5));
    }

    #[test]
    fn missed_frames_are_left_out_and_the_beat_is_kept() {
        let ms = Duration::from_millis;
        let next = |last, now| next_due(ms(last), ms(now), ms(100));
        assert_eq!(next(0, 30), ms(100), "in time");
        assert_eq!(next(100, 230), ms(200), "a little late: the beat stays");
        assert_eq!(next(100, 1730), ms(1700), "held up: sixteen beats on, at once");
        assert_eq!(next(1700, 1735), ms(1800), "and in the beat again");
        // A loop whose frames take 10 ms, after a start of 5 s: one frame at once, then one a beat.
        let (mut due, mut now, mut shown) = (ms(0), ms(5000), Vec::new());
        for _ in 0..4 {
            due = next_due(due, now, ms(100));
            now = now.max(due);
            shown.push(now);
            now += ms(10);
        }
        assert_eq!(shown, [5000, 5100, 5200, 5300].map(ms));
        assert_eq!(next_due(ms(7), ms(1 << 40), Duration::ZERO), ms(7), "no pace: at once");
        assert_eq!(next_due(ms(7), ms(8), Duration::MAX), Duration::MAX);
    }

    #[test]
    fn a_clock_that_was_held_up_waits_again_after_one_frame() {
        let mut clock = PostClock::start(ClockConfig::System { interval_s: 0.05 }, None);
        clock.started -= Duration::from_secs(500);
        let (stop, begun) = (AtomicBool::new(false), Instant::now());
        (0..4).for_each(|_| clock.wait(&stop));
        // The first at once, three more in the beat; 10,000 missed frames would not wait at all.
        assert!(begun.elapsed() >= Duration::from_millis(100), "{:?}", begun.elapsed());
    }
}
