//! Whether the system's clock can have been set since the power came on.
//!
//! A board without a clock of its own takes the time up where it was shut down: the date looks well and the sun is hours
//! off. Where systemd's time service runs, it leaves a mark once it has heard from a time server. Without that service, or
//! with a hardware clock that has kept the time, nothing is waited for, and the date alone is judged.

use super::hardware::{self, HardwareClock};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Folder of the time service and its mark.
const SERVICE: &str = "/run/systemd/timesync";
const MARK: &str = "synchronized";
/// How often the mark is looked for.
const INTERVAL: Duration = Duration::from_secs(2);

/// Looks for the mark from time to time; copies share what was found.
#[derive(Clone, Debug)]
pub(super) struct Synchronised {
    /// As it was when the program started.
    hardware: Option<HardwareClock>,
    service: PathBuf,
    mark: PathBuf,
    found: Arc<AtomicBool>,
    /// Milliseconds after `started` at which to look again.
    next_ms: Arc<AtomicU64>,
    started: Instant,
}

impl Synchronised {
    /// For this machine, whose clock shows `system_unix_s`; no post was made before `not_before_unix_s`.
    pub(super) fn of_system(system_unix_s: f64, not_before_unix_s: f64) -> Self {
        let hardware = HardwareClock::look(Path::new(hardware::CLASS), system_unix_s, not_before_unix_s);
        Self::with(hardware, Path::new(SERVICE))
    }

    pub(super) fn with(hardware: Option<HardwareClock>, service: &Path) -> Self {
        Synchronised {
            hardware,
            service: service.to_owned(),
            mark: service.join(MARK),
            found: Arc::default(),
            next_ms: Arc::default(),
            started: Instant::now(),
        }
    }

    /// The machine's hardware clock as it was at the start, if it has one.
    pub(super) fn hardware(&self) -> Option<HardwareClock> {
        self.hardware
    }

    /// Whether the time service has heard from a time server.
    pub(super) fn has_heard(&self) -> bool {
        self.mark.exists()
    }

    /// True unless the clock is known not to have been set.
    pub(super) fn is_likely(&self) -> bool {
        if self.hardware.is_some_and(|clock| clock.is_plausible) || self.found.load(Ordering::Relaxed) {
            return true;
        }
        let now_ms = self.started.elapsed().as_millis() as u64;
        if now_ms >= self.next_ms.load(Ordering::Relaxed) {
            self.next_ms.store(now_ms + INTERVAL.as_millis() as u64, Ordering::Relaxed);
            let found = self.has_heard() || !self.service.exists();
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
        let service = folder.path().join("timesync");
        assert!(Synchronised::with(None, &service).is_likely(), "no service: the date is judged");
        std::fs::create_dir(&service).unwrap();
        let without_battery = Some(HardwareClock { unix_s: 190.0, is_plausible: false });
        for hardware in [None, without_battery] {
            let waiting = Synchronised::with(hardware, &service);
            let copy = waiting.clone();
            assert!(!waiting.is_likely() && !waiting.is_likely(), "{hardware:?}");
            std::fs::write(service.join(MARK), "").unwrap();
            waiting.next_ms.store(0, Ordering::Relaxed);
            assert!(waiting.is_likely() && copy.is_likely(), "copies share what was found");
            std::fs::remove_file(service.join(MARK)).unwrap();
        }
        let kept = Some(HardwareClock { unix_s: 1.79e9, is_plausible: true });
        assert!(Synchronised::with(kept, &service).is_likely(), "a clock of its own");
    }
}
