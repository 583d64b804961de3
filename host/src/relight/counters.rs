//! What one frame did, what it was spared, and how right it is.

/// Counts and bounds of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameCounters {
    /// Tiles of the field.
    pub tiles: usize,
    /// Tiles without geometry: nothing is stored or read for them.
    pub tiles_empty: usize,
    /// Tiles drawn.
    pub tiles_drawn: usize,
    /// Tiles with geometry whose light was left as it was, and only the view behind was changed.
    pub tiles_composited: usize,
    /// Tiles with geometry that changed but wait for a later frame, because a time budget left none for them.
    pub tiles_waiting: usize,
    /// Tiles with geometry left as they were, because they would change by less than half a code.
    pub tiles_kept: usize,
    /// Tiles of receivers whose light has changed.
    pub receiver_tiles_drawn: usize,
    /// Tiles whose block took more of the way back than the patches that outshine the sky.
    pub tiles_way_back: usize,
    /// Tiles whose bound is above the error budget, because the field has no more for them.
    pub tiles_beyond_budget: usize,
    /// Blocks (2 x 2 tiles) with geometry.
    pub blocks: usize,
    /// Blocks whose coefficients were projected from scratch.
    pub blocks_projected: usize,
    /// Blocks to whose coefficients only the changed patches were added.
    pub blocks_stepped: usize,
    /// Blocks that were not projected, because no patch changed so much that any of their tiles could show it.
    pub blocks_spared: usize,
    /// Patches of the field.
    pub patches: usize,
    /// Patches without light: not read.
    pub patches_dark: usize,
    /// Patches that were read by this frame's projections.
    pub patches_changed: usize,
    /// Patches that outshine the sky and are shown by their own rows.
    pub patches_apart: usize,
    /// Most ranks that any tile was allowed; `None`: all it has.
    pub rank_limit: Option<usize>,
    /// Was there sun?
    pub sun_up: bool,
    /// Was the sun's response traced anew for this frame?
    pub sun_traced: bool,
    /// No linear value of the sky's light is further from the uncompressed response's than this (1 = display white);
    /// `None` where the field has no bounds.
    pub bound_linear: Option<f32>,
    /// No 8-bit code is further from that of the uncompressed response than this, rounding included.
    pub bound_codes: Option<f32>,
}

impl FrameCounters {
    /// Blocks projected from scratch, stepped and spared.
    pub(super) fn blocks_counted(&self) -> [usize; 3] {
        [self.blocks_projected, self.blocks_stepped, self.blocks_spared]
    }

    /// Notes [`FrameCounters::blocks_counted`].
    pub(super) fn count_blocks(&mut self, counts: [usize; 3]) {
        [self.blocks_projected, self.blocks_stepped, self.blocks_spared] = counts;
    }
}
