//! A sky that is looked at on a thread of its own: however long a camera takes or hangs, the picture goes on.

use super::{SkyFault, SkyReading, SkySource};
use crate::clock::PostClock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// After a fault the source is left alone for so long.
const REST: Duration = Duration::from_millis(200);
/// A source that has told nothing for so long hangs.
const SILENCE: Duration = Duration::from_secs(10);
/// How long a wait goes on after a stop was asked for, at most.
const SLICE: Duration = Duration::from_millis(20);
/// How long the end waits for the thread before it leaves it behind.
const GRACE: Duration = Duration::from_millis(500);

/// What the thread has to tell.
#[derive(Default)]
struct News {
    reading: SkyReading,
    is_new: bool,
    fault: Option<SkyFault>,
}

/// The newest reading of a source that has a thread of its own.
pub struct Background {
    news: Arc<Mutex<News>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    heard: Instant,
}

impl Background {
    /// Starts looking at `source`, once in `pace` at most; `clock` is the post's.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn start(source: Box<dyn SkySource + Send>, clock: PostClock, pace: Duration) -> std::io::Result<Self> {
        let (news, stop) = (Arc::new(Mutex::new(News::default())), Arc::new(AtomicBool::new(false)));
        let (its_news, its_stop) = (Arc::clone(&news), Arc::clone(&stop));
        let look = move || look(source, &clock, &its_news, (&its_stop, pace));
        let thread = Some(Builder::new().name("sky".into()).spawn(look)?);
        Ok(Background { news, stop, thread, heard: Instant::now() })
    }

    /// Waits for the first news, no longer than `limit`.
    pub fn wait(&mut self, limit: Duration) {
        let begun = Instant::now();
        let nothing_new = |news: &News| !news.is_new && news.fault.is_none();
        while begun.elapsed() < limit && nothing_new(&self.news.lock().unwrap_or_else(PoisonError::into_inner)) {
            std::thread::sleep(SLICE);
        }
    }
}

/// Waits for `span`, but not on when `stop` is set.
fn rest(span: Duration, stop: &AtomicBool) {
    let begun = Instant::now();
    while !stop.load(Ordering::Relaxed)
        && let Some(left) = span.checked_sub(begun.elapsed())
    {
        std::thread::sleep(left.min(SLICE));
    }
}

/// Looks again and again until the source ends or `stop` is set.
fn look(
    mut source: Box<dyn SkySource + Send>,
    clock: &PostClock,
    news: &Mutex<News>,
    (stop, pace): (&AtomicBool, Duration),
) {
    let mut reading = SkyReading::default();
    for number in 0.. {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let begun = Instant::now();
        let outcome = source.read(clock.now(number), &mut reading);
        let mut told = news.lock().unwrap_or_else(PoisonError::into_inner);
        match outcome {
            Ok(false) => {
                drop(told);
                rest(SLICE, stop);
            }
            Ok(true) => {
                std::mem::swap(&mut told.reading, &mut reading);
                (told.is_new, told.fault) = (true, None);
                drop(told);
                rest(pace.saturating_sub(begun.elapsed()), stop);
            }
            Err(fault) => {
                let has_ended = matches!(fault, SkyFault::Ended);
                told.fault = Some(fault);
                drop(told);
                if has_ended {
                    return;
                }
                rest(REST, stop);
            }
        }
    }
}

impl SkySource for Background {
    fn read(&mut self, _moment: crate::clock::Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        // The thread holds the lock for no longer than a swap; a frame does not even wait for that.
        let mut told = match self.news.try_lock() {
            Ok(told) => told,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return Ok(false),
        };
        if std::mem::take(&mut told.is_new) {
            std::mem::swap(&mut told.reading, into);
            self.heard = Instant::now();
            return Ok(true);
        }
        if let Some(fault) = told.fault.take() {
            self.heard = Instant::now();
            return Err(fault);
        }
        if self.heard.elapsed() < SILENCE {
            return Ok(false);
        }
        self.heard = Instant::now();
        let ended = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
        let what = if ended { "the sky's thread has ended" } else { "the sky camera hangs" };
        Err(SkyFault::Failed(format!("{what}: nothing came for {} s", SILENCE.as_secs())))
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let (Some(thread), begun) = (self.thread.take(), Instant::now()) else { return };
        while !thread.is_finished() {
            if begun.elapsed() > GRACE {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        // A panic of the thread was reported when it happened.
        let _ = thread.join();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Moment;
    use crate::config::ClockConfig;
    use crate::weights::PatchWeights;
    use std::sync::mpsc::{Receiver, Sender, channel};

    /// Gives what it is sent; waits for it like a slow camera.
    struct Sent(Receiver<Result<f32, SkyFault>>);

    impl SkySource for Sent {
        fn read(&mut self, _moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
            let radiance = self.0.recv().map_err(|_| SkyFault::Ended)??;
            let weights = PatchWeights { radiance: vec![[radiance; 3]], sun: None };
            *into = SkyReading { weights, ..SkyReading::default() };
            Ok(true)
        }
    }

    fn started() -> (Sender<Result<f32, SkyFault>>, Background) {
        let (sender, receiver) = channel();
        let clock = PostClock::start(ClockConfig::System { interval_s: 1.0 }, None);
        (sender, Background::start(Box::new(Sent(receiver)), clock, Duration::ZERO).unwrap())
    }

    /// What comes within a minute.
    fn wait(sky: &mut Background, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let begun = Instant::now();
        loop {
            match sky.read(Moment { unix_s: 0.0, trusted: true }, into) {
                Ok(false) if begun.elapsed() < Duration::from_secs(60) => std::thread::sleep(Duration::from_millis(1)),
                outcome => return outcome,
            }
        }
    }

    #[test]
    fn the_newest_reading_comes_and_nothing_waits_for_it() {
        let (sender, mut sky) = started();
        let mut reading = SkyReading::default();
        let begun = Instant::now();
        assert!(matches!(sky.read(Moment { unix_s: 0.0, trusted: true }, &mut reading), Ok(false)));
        assert!(begun.elapsed() < Duration::from_secs(5));
        sender.send(Ok(0.25)).unwrap();
        assert!(matches!(wait(&mut sky, &mut reading), Ok(true)));
        assert_eq!(reading.weights.radiance, [[0.25; 3]]);
    }

    #[test]
    fn a_fault_is_told_once_and_the_next_reading_cures_it() {
        let (sender, mut sky) = started();
        let mut reading = SkyReading::default();
        sender.send(Err(SkyFault::Failed("unplugged".into()))).unwrap();
        assert!(matches!(wait(&mut sky, &mut reading), Err(SkyFault::Failed(what)) if what == "unplugged"));
        sender.send(Ok(0.5)).unwrap();
        assert!(matches!(wait(&mut sky, &mut reading), Ok(true)));
        drop(sender);
        assert!(matches!(wait(&mut sky, &mut reading), Err(SkyFault::Ended)));
    }

    #[test]
    fn a_hanging_source_does_not_hold_up_the_end() {
        let (_sender, sky) = started();
        let begun = Instant::now();
        drop(sky);
        assert!(begun.elapsed() < Duration::from_secs(10));
    }
}
