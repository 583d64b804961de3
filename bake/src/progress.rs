//! How far a job is and how long it still takes: a bar on a terminal, a line now and then in a log.

use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// The first line of a log, and the least time between two.
const LINE_EVERY: Duration = Duration::from_secs(60);

/// Shows how far a job is on stderr. Shared by all threads.
pub struct Progress {
    bar: ProgressBar,
    name: String,
    begun: Instant,
    /// Lines of a log that were due, written or not.
    lines: AtomicU64,
}

impl Progress {
    /// For `steps` steps of the job `name`.
    pub fn new(name: &str, steps: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr_with_hz(5));
        let style = ProgressStyle::with_template("{prefix} [{bar:32}] {percent:>3} %  {elapsed} gone, {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> "));
        bar.set_prefix(name.to_owned());
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_millis(500));
        }
        Progress { bar, name: name.to_owned(), begun: Instant::now(), lines: AtomicU64::new(0) }
    }

    /// One more step is done.
    pub fn step(&self) {
        self.bar.inc(1);
        let gone = self.begun.elapsed();
        let due = gone.as_secs() / LINE_EVERY.as_secs();
        if self.bar.is_hidden() && self.lines.fetch_max(due, Ordering::Relaxed) < due {
            let (done, all) = (self.bar.position(), self.bar.length().unwrap_or_default());
            eprintln!("{}: {}", self.name, Line { done, all, gone });
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A line of a log.
struct Line {
    done: u64,
    all: u64,
    gone: Duration,
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let left = self.gone.as_secs_f64() * self.all.saturating_sub(self.done) as f64 / self.done.max(1) as f64;
        let minutes = |seconds: f64| (seconds / 60.0).ceil();
        write!(
            f,
            "{} %, {} min gone, about {} min left",
            100 * self.done / self.all.max(1),
            minutes(self.gone.as_secs_f64()),
            minutes(left)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_tells_how_long_the_rest_takes_at_this_pace() {
        let line = |done, all, seconds| Line { done, all, gone: Duration::from_secs(seconds) }.to_string();
        assert_eq!(line(30, 120, 600), "25 %, 10 min gone, about 30 min left");
        assert_eq!(line(120, 120, 61), "100 %, 2 min gone, about 0 min left");
        assert_eq!(line(0, 0, 0), "0 %, 0 min gone, about 0 min left");
    }
}
