//! What Relume is allowed per frame in a run.

use crate::relight::Relighter;

/// A budget per frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// At most so many ranks per tile.
    Ranks(usize),
    /// Every rank that the field has.
    AllRanks,
}

impl Budget {
    /// The budgets of a run, cheapest first; the last one is the field at its best.
    pub const ALL: [Budget; 5] =
        [Budget::Ranks(2), Budget::Ranks(4), Budget::Ranks(8), Budget::Ranks(16), Budget::AllRanks];

    /// Makes `relighter` keep to it from the next weights on.
    pub fn set(self, relighter: &mut Relighter<'_>) {
        relighter.set_max_rank(self.max_rank());
    }

    /// Most ranks that a tile may use.
    pub fn max_rank(self) -> usize {
        match self {
            Budget::Ranks(ranks) => ranks,
            Budget::AllRanks => relume_firmware::tile::MAX_RANK,
        }
    }
}

impl std::fmt::Display for Budget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Budget::Ranks(ranks) => write!(f, "{ranks} ranks"),
            Budget::AllRanks => f.write_str("all ranks"),
        }
    }
}
