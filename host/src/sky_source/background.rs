//! A sky that is looked at on a thread of its own.

use super::{SkyFault, SkyReading, SkySource};
use crate::bell::Bell;
use crate::clock::{Moment, PostClock};
use crate::newest::{Newest, SILENCE, Told};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// The newest reading of a source that has a thread of its own.
pub struct Background(Newest<SkyReading, SkyFault>);

impl Background {
    /// Starts looking at `source`, once in `pace` at most; `clock` is the post's.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn start(mut source: Box<dyn SkySource + Send>, clock: PostClock, pace: Duration) -> std::io::Result<Self> {
        let look = move |number: u64, reading: &mut SkyReading| source.read(clock.now(number), reading);
        Newest::start("sky", look, |fault| matches!(fault, SkyFault::Ended), pace).map(Background)
    }

    /// Waits for the first news, no longer than `limit`, and not on when `stop` is set.
    pub fn wait(&mut self, limit: Duration, stop: &AtomicBool) {
        self.0.wait(limit, stop);
    }
}

impl SkySource for Background {
    fn read(&mut self, _moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        match self.0.take(into) {
            Told::New => Ok(true),
            Told::Nothing => Ok(false),
            Told::Fault(fault) => Err(fault),
            Told::Silence { has_ended } => {
                let what = if has_ended { "the sky's thread has ended" } else { "the sky camera hangs" };
                Err(SkyFault::Failed(format!("{what}: nothing came for {} s", SILENCE.as_secs())))
            }
        }
    }

    fn ring(&mut self, bell: &Bell) {
        self.0.ring(bell);
    }

    fn stop(&mut self) {
        self.0.stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ClockConfig;
    use crate::weights::PatchWeights;
    use std::time::Instant;

    /// Gives what time it is, then ends.
    struct Once(bool);

    impl SkySource for Once {
        fn read(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
            if std::mem::replace(&mut self.0, true) {
                return Err(SkyFault::Ended);
            }
            let weights = PatchWeights { radiance: vec![[moment.unix_s as f32; 3]], sun: None };
            *into = SkyReading { weights, ..SkyReading::default() };
            Ok(true)
        }
    }

    #[test]
    fn readings_are_of_the_posts_clock_and_the_end_comes_after_them() {
        let clock = ClockConfig::Simulated { start_unix_s: 64.0, step_s: 1.0, speed: None };
        let clock = PostClock::start(clock, None);
        let mut sky = Background::start(Box::new(Once(false)), clock.clone(), Duration::from_millis(300)).unwrap();
        let (mut reading, begun) = (SkyReading::default(), Instant::now());
        let mut wait = || loop {
            match sky.read(clock.now(0), &mut reading) {
                Ok(false) if begun.elapsed() < Duration::from_secs(60) => std::thread::sleep(Duration::from_millis(1)),
                outcome => return (outcome, reading.weights.radiance.clone()),
            }
        };
        let (first, radiance) = wait();
        assert!(matches!(first, Ok(true)));
        assert_eq!(radiance, [[64.0; 3]]);
        assert!(matches!(wait().0, Err(SkyFault::Ended)));
    }
}
