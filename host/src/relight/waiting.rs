//! Which tiles are drawn when there is no time for all that changed: the oldest and most changed first.

use super::tiles::TileState;

/// Chooses the tiles of a frame. It keeps its memory from frame to frame.
#[derive(Clone, Debug)]
pub(super) struct Choice {
    /// Urgency and number of the tiles that may wait.
    may_wait: Vec<(f32, usize)>,
}

impl Choice {
    /// For a field of `tiles` tiles.
    pub(super) fn new(tiles: usize) -> Self {
        Choice { may_wait: Vec::with_capacity(tiles) }
    }

    /// Lets all but the `most` most urgent tiles wait, except those that must be drawn.
    pub(super) fn choose(&mut self, states: &mut [TileState], most: usize) {
        let must = states.iter().filter(|state| !state.empty && state.urgency == f32::INFINITY).count();
        let urgent = states.iter().enumerate().filter(|(_, state)| state.urgency > 0.0 && state.urgency.is_finite());
        self.may_wait.clear();
        self.may_wait.extend(urgent.map(|(index, state)| (state.urgency, index)));
        let most = most.saturating_sub(must);
        if most < self.may_wait.len() {
            // Tiles of one urgency go in their order, so that a choice depends on nothing else.
            self.may_wait.select_nth_unstable_by(most, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            self.may_wait[most..].iter().for_each(|&(_, index)| states[index].wait());
        }
    }
}
