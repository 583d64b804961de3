//! What Relume is allowed per frame in a run.

use std::time::Duration;

use crate::relight::{self, BudgetError, Relighter};

/// A budget per frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// At most so many ranks per tile.
    Ranks(usize),
    /// Every rank that the field has.
    AllRanks,
    /// At most this error of an 8-bit code, certified.
    Codes(f32),
    /// At most so many milliseconds.
    Milliseconds(f64),
}

impl Budget {
    /// The budgets of a run, cheapest first; the last one is the field at its best.
    pub const ALL: [Budget; 5] =
        [Budget::Ranks(2), Budget::Ranks(4), Budget::Ranks(8), Budget::Ranks(16), Budget::AllRanks];

    /// Makes `relighter` keep to it from the next weights on.
    ///
    /// # Errors
    /// [`BudgetError`], if no frame of its field can.
    pub fn set(self, relighter: &mut Relighter<'_>) -> Result<(), BudgetError> {
        relighter.set_budget(match self {
            Budget::Ranks(_) | Budget::AllRanks => relight::Budget::Field,
            Budget::Codes(codes) => relight::Budget::ErrorCodes(codes),
            Budget::Milliseconds(ms) => relight::Budget::Time(Duration::from_secs_f64(ms.max(0.0) / 1e3)),
        })?;
        match self {
            Budget::Ranks(ranks) => relighter.set_rank_limit(Some(ranks)),
            Budget::Milliseconds(_) => {}
            Budget::AllRanks | Budget::Codes(_) => relighter.set_rank_limit(None),
        }
        Ok(())
    }

    /// Most ranks that a tile may use.
    pub fn max_rank(self) -> usize {
        match self {
            Budget::Ranks(ranks) => ranks,
            _ => relume_firmware::tile::MAX_RANK,
        }
    }
}

impl std::fmt::Display for Budget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Budget::Ranks(ranks) => write!(f, "{ranks} ranks"),
            Budget::AllRanks => f.write_str("all ranks"),
            Budget::Codes(codes) => write!(f, "error {codes} codes"),
            Budget::Milliseconds(ms) => write!(f, "time {ms} ms"),
        }
    }
}
