//! Whether the system's clock can have been set since the power came on.
//!
//! A board without a clock of its own takes the time up where it was shut down: the date looks well and the sun is hours
//! off. Where systemd's time service runs, it leaves a mark once it has heard from a time server. Without that service, or
//! with a hardware clock, nothing can be told here, and the date alone is judged.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Folder of the time service and its mark.
const SERVICE: &str = "/run/systemd/timesync";
const MARK: &str = "synchronized";
/// Where hardware clocks are listed.
const HARDWARE: &str = "/sys/class/rtc";
/// How often the mark is looked for.
const INTERVAL: Duration = Duration::from_secs(2);

/// Looks for the mark from time to time; copies share what was found.
#[derive(Clone, Debug)]
pub(super) struct Synchronised {
    /// Folder and mark of the service, unless there is nothing to wait for.
    waited_for: Option<(PathBuf, PathBuf)>,
    found: Arc<AtomicBool>,
    /// Milliseconds after `started` at which to look again.
    next_ms: Arc<AtomicU64>,
    started: Instant,
}

impl Synchronised {
    /// For this machine.
    pub(super) fn of_system() -> Self {
        Self::at(Path::new(SERVICE), Path::new(HARDWARE))
    }

    fn at(service: &Path, hardware: &Path) -> Self {
        let has_clock = std::fs::read_dir(hardware).is_ok_and(|mut clocks| clocks.next().is_some());
        Synchronised {
            waited_for: (!has_clock).then(|| (service.to_owned(), service.join(MARK))),
            found: Arc::default(),
            next_ms: Arc::default(),
            started: Instant::now(),
        }
    }

    /// True unless the clock is known not to have been set.
    pub(super) fn is_likely(&self) -> bool {
        let Some((service, mark)) = &self.waited_for else { return true };
        if self.found.load(Ordering::Relaxed) {
            return true;
        }
        let now_ms = self.started.elapsed().as_millis() as u64;
        if now_ms >= self.next_ms.load(Ordering::Relaxed) {
            self.next_ms.store(now_ms + INTERVAL.as_millis() as u64, Ordering::Relaxed);
            let found = mark.exists() || !service.exists();
            self.found.store(found, Ordering::Relaxed);
            return found;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_services_mark_is_waited_for_where_nothing_else_keeps_time() {
        let folder = tempfile::tempdir().unwrap();
        let (service, hardware) = (folder.path().join("timesync"), folder.path().join("rtc"));
        assert!(Synchronised::at(&service, &hardware).is_likely(), "no service: the date is judged");
        std::fs::create_dir(&service).unwrap();
        let waiting = Synchronised::at(&service, &hardware);
        let copy = waiting.clone();
        assert!(!waiting.is_likely() && !waiting.is_likely());
        std::fs::write(service.join(MARK), "").unwrap();
        waiting.next_ms.store(0, Ordering::Relaxed);
        assert!(waiting.is_likely() && copy.is_likely(), "copies share what was found");
        std::fs::remove_file(service.join(MARK)).unwrap();
        std::fs::create_dir_all(hardware.join("rtc0")).unwrap();
        assert!(Synchronised::at(&service, &hardware).is_likely(), "a clock of its own");
    }
}
