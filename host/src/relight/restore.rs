//! Blocks up and down the levels of the way back, as an error budget asks.

use super::Relighter;
use super::budget::Budget;
use relume_firmware::levels::may_be_lower;

impl Relighter<'_> {
    /// Lets every block whose tiles were all well within the error budget try one level less with the new weights.
    pub(super) fn lower_levels(&mut self) {
        let Budget::ErrorCodes(codes) = self.budget else { return };
        let (response, states) = (self.field.response(), &self.states);
        for (index, block) in self.blocks.iter_mut().enumerate().filter(|(_, block)| block.level > 0) {
            let well = |tile: usize| states[tile].empty || may_be_lower(states[tile].shown_bound.1, codes);
            if response.tiles_of(index).all(well) {
                block.set_level(block.level - 1);
            }
        }
    }

    /// Raises the level of every block with a tile whose bound exceeds `codes`; `false` if none can be raised.
    pub(super) fn raise_levels(&mut self, codes: f32) -> bool {
        let (response, top) = (self.field.response(), self.levels.top());
        let mut raised = false;
        for (index, block) in self.blocks.iter_mut().enumerate() {
            let exceeds = |tile: usize| !self.states[tile].empty && self.states[tile].shown_bound.1 > codes;
            if block.level < top && response.tiles_of(index).any(exceeds) {
                block.set_level(block.level + 1);
                raised = true;
            }
        }
        if raised {
            self.project(false);
        }
        raised
    }
}
