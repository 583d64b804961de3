//! The clock a post lives by, and what keeps its time.

use crate::clock::{HardwareClock, PostClock};
use crate::config::{ClockConfig, Config};
use crate::sun::format_utc;
use std::time::SystemTime;

/// Whether the post's clock can be right, in words.
pub(super) fn clock(config: &Config) -> Result<String, String> {
    let made = std::fs::metadata(&config.field).and_then(|meta| meta.modified()).ok();
    let clock = PostClock::start(config.clock, made);
    let now = clock.now(0);
    let shown = format_utc(now.unix_s);
    if let ClockConfig::Simulated { .. } = config.clock {
        return Ok(format!("a simulated clock starts at {shown}"));
    }
    let keeper = keeper(clock.hardware(), clock.has_heard());
    match (now.trusted, clock.may_be_set()) {
        (true, _) => Ok(format!("the system's clock shows {shown}; {keeper}")),
        (false, false) => Err(format!("the system's clock shows {shown}, which may be hours off; {keeper}")),
        (false, true) => Err(format!(
            "the system's clock shows {shown}, before the field was made ({}); set it, or connect a time server",
            made.and_then(|made| made.duration_since(SystemTime::UNIX_EPOCH).ok())
                .map_or_else(|| "?".into(), |made| format_utc(made.as_secs_f64()))
        )),
    }
}

/// What keeps the time, as far as can be told: a time server that was heard, or a hardware clock.
fn keeper(hardware: Option<HardwareClock>, has_heard: bool) -> String {
    let server = if has_heard { "a time server has set it" } else { "no time server has been heard" };
    match hardware {
        Some(HardwareClock { is_plausible: true, .. }) => format!("{server}; the hardware clock agrees"),
        Some(HardwareClock { unix_s, .. }) => {
            let cure = if has_heard { "give it a battery" } else { "connect a time server, or give it a battery" };
            format!("{server}; the hardware clock showed {}, which cannot be right: {cure}", format_utc(unix_s))
        }
        None if has_heard => format!("{server}; there is no hardware clock"),
        None => format!("{server}, and there is no hardware clock: connect one, or compare with a watch"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_keeps_the_time_is_named() {
        let clock = |unix_s, is_plausible| Some(HardwareClock { unix_s, is_plausible });
        let stopped = keeper(clock(190.0, false), false);
        assert!(stopped.contains("1970-01-01T00:03:10Z") && stopped.contains("give it a battery"), "{stopped}");
        assert!(stopped.contains("no time server") && stopped.contains("connect a time server"), "{stopped}");
        assert_eq!(keeper(clock(1.79e9, true), true), "a time server has set it; the hardware clock agrees");
        assert!(!keeper(clock(190.0, false), true).contains("connect"), "it was heard");
        assert!(keeper(None, false).contains("no hardware clock"));
    }
}
