//! What Relume is allowed per frame in a run.

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
}

impl Budget {
    /// The ranks of a run, cheapest first.
    pub const RANKS: [Budget; 4] = [Budget::Ranks(2), Budget::Ranks(4), Budget::Ranks(8), Budget::AllRanks];
    /// The errors of a run.
    pub const ERRORS: [Budget; 3] = [Budget::Codes(4.0), Budget::Codes(2.0), Budget::Codes(1.5)];

    /// Does a relighter under it learn from one frame to the next, so that it needs one of its own?
    pub fn learns(self) -> bool {
        matches!(self, Budget::Codes(_))
    }

    /// Makes `relighter` keep to it from the next weights on. An error budget starts from scratch: what earlier weights
    /// needed of the way back is forgotten.
    ///
    /// # Errors
    /// [`BudgetError`], if no frame of its field can.
    pub fn set(self, relighter: &mut Relighter<'_>) -> Result<(), BudgetError> {
        if matches!(self, Budget::Codes(_)) {
            relighter.set_budget(relight::Budget::Field)?;
        }
        relighter.set_budget(match self {
            Budget::Ranks(_) | Budget::AllRanks => relight::Budget::Field,
            Budget::Codes(codes) => relight::Budget::ErrorCodes(codes),
        })?;
        match self {
            Budget::Ranks(ranks) => relighter.set_rank_limit(Some(ranks)),
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
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_error_budgets_learn() {
        assert!(Budget::ERRORS.iter().all(|budget| budget.learns()));
        assert!(!Budget::RANKS.iter().any(|budget| budget.learns()));
        assert_eq!(Budget::ERRORS[0].to_string(), "error 4 codes");
    }
}
