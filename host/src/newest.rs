//! The newest of what a thread of its own makes: however long a camera takes or hangs, the picture goes on.

use crate::bell::Bell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, TryLockError};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// After a fault the maker is left alone for so long.
const REST: Duration = Duration::from_millis(200);
/// A maker that has told nothing for so long hangs.
pub const SILENCE: Duration = Duration::from_secs(10);
/// How long a wait goes on after a stop was asked for, at most.
const SLICE: Duration = Duration::from_millis(20);
/// How long the thread has to end after it was told to, before it is left behind: a post ends within a second.
const GRACE: Duration = Duration::from_millis(400);

/// What the thread has to tell.
struct News<T, E> {
    made: T,
    is_new: bool,
    fault: Option<E>,
}

/// What became of the thread since it was asked last.
#[derive(Debug)]
pub enum Told<E> {
    /// There is a newer one; it was handed over.
    New,
    /// Nothing.
    Nothing,
    /// It failed, and tries again.
    Fault(E),
    /// Nothing came for [`SILENCE`]: it hangs, or has ended.
    Silence {
        /// Is there no thread any more?
        has_ended: bool,
    },
}

/// The newest thing that a thread of its own made. Three of them are in use, and go round: nothing is copied.
pub struct Newest<T, E> {
    news: Arc<Mutex<News<T, E>>>,
    stop: Arc<AtomicBool>,
    bell: Arc<OnceLock<Bell>>,
    /// When it was told to.
    stopped: Option<Instant>,
    thread: Option<JoinHandle<()>>,
    heard: Instant,
}

impl<T: Default + Send + 'static, E: Send + 'static> Newest<T, E> {
    /// Starts the thread `name`, which calls `make` again and again, once in `pace` at most, with the number of the call and
    /// something to reuse; it gives false if there is nothing new. The thread ends with a fault that `is_end`.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn start(
        name: &str,
        make: impl FnMut(u64, &mut T) -> Result<bool, E> + Send + 'static,
        is_end: fn(&E) -> bool,
        pace: Duration,
    ) -> std::io::Result<Self> {
        let news = Arc::new(Mutex::new(News { made: T::default(), is_new: false, fault: None }));
        let stop = Arc::new(AtomicBool::new(false));
        let bell = Arc::new(OnceLock::new());
        let (its_news, its_stop, its_bell) = (Arc::clone(&news), Arc::clone(&stop), Arc::clone(&bell));
        let work = move || go_on(make, is_end, (&its_news, &its_bell), (&its_stop, pace));
        let thread = Some(Builder::new().name(name.into()).spawn(work)?);
        Ok(Newest { news, stop, bell, stopped: None, thread, heard: Instant::now() })
    }
}

impl<T, E> Newest<T, E> {
    /// Waits for the first news, no longer than `limit`, and not on when `stop` is set.
    pub fn wait(&mut self, limit: Duration, stop: &AtomicBool) {
        let begun = Instant::now();
        let nothing_new = |news: &News<T, E>| !news.is_new && news.fault.is_none();
        while begun.elapsed() < limit
            && !stop.load(Ordering::Relaxed)
            && nothing_new(&self.news.lock().unwrap_or_else(PoisonError::into_inner))
        {
            std::thread::sleep(SLICE);
        }
    }

    /// Has `bell` ring whenever there is something new to take, from now on; the first bell stays.
    pub fn ring(&self, bell: &Bell) {
        self.bell.get_or_init(|| bell.clone());
    }

    /// Has the thread end as soon as it can, without waiting for that.
    pub fn stop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.stopped.get_or_insert_with(Instant::now);
    }

    /// Exchanges `into` for what is newer, if anything is. Never waits: the thread holds the lock for no longer than such an
    /// exchange, and a frame does not even wait for that.
    pub fn take(&mut self, into: &mut T) -> Told<E> {
        let mut told = match self.news.try_lock() {
            Ok(told) => told,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return Told::Nothing,
        };
        if std::mem::take(&mut told.is_new) {
            std::mem::swap(&mut told.made, into);
            self.heard = Instant::now();
            return Told::New;
        }
        if let Some(fault) = told.fault.take() {
            self.heard = Instant::now();
            return Told::Fault(fault);
        }
        if self.heard.elapsed() < SILENCE {
            return Told::Nothing;
        }
        self.heard = Instant::now();
        Told::Silence { has_ended: self.thread.as_ref().is_none_or(JoinHandle::is_finished) }
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

/// Makes one after another until the maker ends or `stop` is set.
fn go_on<T: Default, E>(
    mut make: impl FnMut(u64, &mut T) -> Result<bool, E>,
    is_end: fn(&E) -> bool,
    (news, bell): (&Mutex<News<T, E>>, &OnceLock<Bell>),
    (stop, pace): (&AtomicBool, Duration),
) {
    let mut made = T::default();
    for number in 0.. {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let begun = Instant::now();
        let outcome = make(number, &mut made);
        let mut told = news.lock().unwrap_or_else(PoisonError::into_inner);
        match outcome {
            Ok(false) => {
                drop(told);
                rest(SLICE, stop);
            }
            Ok(true) => {
                std::mem::swap(&mut told.made, &mut made);
                (told.is_new, told.fault) = (true, None);
                drop(told);
                // Whoever is woken must find the lock free.
                bell.get().iter().for_each(|bell| bell.ring());
                rest(pace.saturating_sub(begun.elapsed()), stop);
            }
            Err(fault) => {
                let has_ended = is_end(&fault);
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

impl<T, E> Drop for Newest<T, E> {
    fn drop(&mut self) {
        self.stop();
        let (Some(thread), Some(stopped)) = (self.thread.take(), self.stopped) else { return };
        while !thread.is_finished() {
            if stopped.elapsed() > GRACE {
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
    use std::sync::mpsc::{Sender, channel};

    const END: &str = "end";

    /// Makes what it is sent; waits for it like a slow camera.
    fn started() -> (Sender<Result<u32, &'static str>>, Newest<u32, &'static str>) {
        let (sender, receiver) = channel::<Result<u32, &'static str>>();
        let make = move |_: u64, into: &mut u32| {
            *into = receiver.recv().unwrap_or(Err(END))?;
            Ok(true)
        };
        (sender, Newest::start("maker", make, |fault| *fault == END, Duration::ZERO).unwrap())
    }

    /// What comes within a minute.
    fn wait(newest: &mut Newest<u32, &'static str>, into: &mut u32) -> Told<&'static str> {
        let begun = Instant::now();
        loop {
            match newest.take(into) {
                Told::Nothing if begun.elapsed() < Duration::from_secs(60) => {
                    std::thread::sleep(Duration::from_millis(1));
                }
                told => return told,
            }
        }
    }

    #[test]
    fn the_newest_comes_and_nothing_waits_for_it() {
        let (sender, mut newest) = started();
        let (mut got, begun) = (0, Instant::now());
        assert!(matches!(newest.take(&mut got), Told::Nothing));
        assert!(begun.elapsed() < Duration::from_secs(5));
        for number in 1..=5 {
            sender.send(Ok(number)).unwrap();
        }
        // Whichever the thread has reached; those before are gone.
        let mut last = 0;
        while last < 5 {
            assert!(matches!(wait(&mut newest, &mut got), Told::New));
            assert!(got > last, "{got} after {last}");
            last = got;
        }
    }

    #[test]
    fn the_bell_rings_when_there_is_something_to_take() {
        let (sender, mut newest) = started();
        let bell = Bell::for_this_thread();
        newest.ring(&bell);
        sender.send(Ok(3)).unwrap();
        let begun = Instant::now();
        while !bell.take() {
            bell.wait(Duration::from_secs(60));
            assert!(begun.elapsed() < Duration::from_secs(60));
        }
        let mut got = 0;
        assert!(matches!(newest.take(&mut got), Told::New));
    }

    #[test]
    fn a_fault_is_told_once_the_next_success_cures_it_and_an_end_ends() {
        let (sender, mut newest) = started();
        let mut got = 0;
        sender.send(Err("unplugged")).unwrap();
        assert!(matches!(wait(&mut newest, &mut got), Told::Fault("unplugged")));
        sender.send(Ok(7)).unwrap();
        assert!(matches!(wait(&mut newest, &mut got), Told::New));
        assert_eq!(got, 7);
        drop(sender);
        assert!(matches!(wait(&mut newest, &mut got), Told::Fault(END)));
    }

    #[test]
    fn a_hanging_maker_does_not_hold_up_the_end() {
        let (_sender, newest) = started();
        let begun = Instant::now();
        drop(newest);
        assert!(begun.elapsed() < Duration::from_secs(10));
    }

    #[test]
    fn a_stop_ends_the_wait_for_the_first_and_the_thread() {
        let (sender, mut newest) = started();
        let begun = Instant::now();
        newest.wait(Duration::from_secs(1000), &AtomicBool::new(true));
        newest.stop();
        // The thread ends after what it has in hand, though its maker would go on.
        sender.send(Ok(1)).unwrap();
        while !newest.thread.as_ref().unwrap().is_finished() {
            assert!(begun.elapsed() < Duration::from_secs(100));
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
