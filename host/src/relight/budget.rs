//! What a frame may cost or be wrong by.

use std::time::Duration;

/// What the caller allows per frame.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Budget {
    /// All ranks of the field, and rows only of patches that outshine the sky.
    #[default]
    Field,
    /// The largest error of an 8-bit code, against the uncompressed response; the frame takes the time it takes.
    ErrorCodes(f32),
    /// The time of a frame; the error is what it gets to, and the counters say which bound that is.
    Time(Duration),
}

/// Why a budget was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BudgetError {
    /// Not more than half a code, which rounding alone takes.
    #[error("an error budget of {0} codes; rounding alone takes 0.5, so give more, for example 2")]
    Codes(f32),
    /// No time.
    #[error("a time budget of 0; give milliseconds per frame, for example 10")]
    Time,
    /// The field has no bounds or no way back.
    #[error("the field has no error bounds, which an error budget needs; bake it again with this release")]
    NoBounds,
}

/// Finds the ranks that fit into a time, from what the frames before took.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// Ranks allowed per tile; `None`: all.
    pub(super) rank_limit: Option<usize>,
    largest_rank: usize,
}

/// Share of the time that must be free before a rank more is tried.
const ROOM: f64 = 0.75;

impl Pace {
    pub(super) fn new(largest_rank: usize) -> Self {
        Pace { rank_limit: None, largest_rank: largest_rank.max(2) }
    }

    /// Forgets all limits.
    pub(super) fn free(&mut self) {
        self.rank_limit = None;
    }

    /// Learns from a frame that drew everything in `took`.
    pub(super) fn follow(&mut self, took: Duration, allowed: Duration) {
        let share = took.as_secs_f64() / allowed.as_secs_f64().max(1e-9);
        let now = self.rank_limit.unwrap_or(self.largest_rank);
        if share > 1.0 {
            // Ranks are only a part of a frame's cost: go down at least one step.
            let fit = (now as f64 / share) as usize & !1;
            self.rank_limit = Some(fit.min(now.saturating_sub(2)).max(2));
        } else if share < ROOM {
            let next = now + 2;
            self.rank_limit = (next < self.largest_rank).then_some(next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_follow_the_time() {
        let mut pace = Pace::new(20);
        let ms = Duration::from_millis;
        pace.follow(ms(20), ms(10));
        assert_eq!(pace.rank_limit, Some(10));
        pace.follow(ms(9), ms(10));
        assert_eq!(pace.rank_limit, Some(10));
        pace.follow(ms(30), ms(10));
        pace.follow(ms(30), ms(10));
        assert_eq!(pace.rank_limit, Some(2));
        for _ in 0..10 {
            pace.follow(ms(1), ms(10));
        }
        assert_eq!(pace.rank_limit, None);
    }
}
