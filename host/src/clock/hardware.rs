//! Hardware clocks, and whether one has kept the time while the power was off.
//!
//! That a board lists one means little: a Raspberry Pi 5 always does, and without its battery it starts at 1970 after every
//! power cut, while the system takes the time up where it was shut down. One that was kept going agrees with the system's
//! clock, which the kernel has set by it.

use std::fs;
use std::path::Path;

/// Where the kernel lists hardware clocks.
pub(super) const CLASS: &str = "/sys/class/rtc";
/// How far a hardware clock may be from the system's, which a time server may have set since, seconds: some years' drift of
/// a usual crystal would be more, but the kernel sets the hardware clock, too, while a time server is heard.
const NEAR_S: f64 = 300.0;
/// Clocks that run a little ahead where files are made, seconds.
pub(super) const GRACE_S: f64 = 3600.0;

/// What a hardware clock shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardwareClock {
    /// Unix seconds, when it was looked at.
    pub unix_s: f64,
    /// Whether that can be the time: after the post was made, and near the system's clock.
    pub is_plausible: bool,
}

impl HardwareClock {
    /// The first plausible clock of those in `class`, else the first; `None` where there is none that tells a time.
    pub(super) fn look(class: &Path, system_unix_s: f64, not_before_unix_s: f64) -> Option<Self> {
        let entries = fs::read_dir(class).into_iter().flatten().flatten();
        let told = entries.filter_map(|entry| fs::read_to_string(entry.path().join("since_epoch")).ok());
        let clocks = told.filter_map(|text| text.trim().parse::<f64>().ok()).map(|unix_s| HardwareClock {
            unix_s,
            is_plausible: unix_s > not_before_unix_s - GRACE_S && (unix_s - system_unix_s).abs() <= NEAR_S,
        });
        clocks.reduce(|found, next| if found.is_plausible || !next.is_plausible { found } else { next })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MADE: f64 = 1_780_000_000.0;
    const SYSTEM: f64 = 1_790_000_000.0;

    fn put(class: &Path, name: &str, text: &str) {
        fs::create_dir_all(class.join(name)).unwrap();
        fs::write(class.join(name).join("since_epoch"), format!("{text}\n")).unwrap();
    }

    #[test]
    fn a_hardware_clock_counts_when_it_can_be_right() {
        let class = tempfile::tempdir().unwrap();
        let look = |system| HardwareClock::look(class.path(), system, MADE);
        assert_eq!(look(SYSTEM), None);
        fs::create_dir(class.path().join("rtc7")).unwrap();
        assert_eq!(look(SYSTEM), None, "it tells no time");
        put(class.path(), "rtc0", "190");
        assert_eq!(look(SYSTEM), Some(HardwareClock { unix_s: 190.0, is_plausible: false }), "no battery: 1970");
        assert!(!look(190.0).unwrap().is_plausible, "not even where the system follows it");
        put(class.path(), "rtc0", "1790000002");
        assert!(look(SYSTEM).unwrap().is_plausible);
        assert!(!look(SYSTEM + 4.0 * 3600.0).unwrap().is_plausible, "hours off");
        assert!(!look(SYSTEM - 4.0 * 3600.0).unwrap().is_plausible, "hours off");
        put(class.path(), "rtc0", "946684800");
        put(class.path(), "rtc1", "1790000002");
        assert!(look(SYSTEM).unwrap().is_plausible, "one of two has a battery");
        put(class.path(), "rtc0", "no number");
        assert!(look(SYSTEM).unwrap().is_plausible);
    }
}
