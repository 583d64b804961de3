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

/// Sums of [`FrameCounters`] over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct CounterTotals {
    /// Tiles drawn, but for those of frames that were exposed anew.
    pub tiles_drawn: u64,
    /// Tiles drawn in frames that were exposed anew, which redraws them all.
    pub tiles_drawn_exposed_anew: u64,
    /// Tiles before which only the view changed.
    pub tiles_composited: u64,
    /// Tiles with geometry that were left as they were.
    pub tiles_kept: u64,
    /// Tiles that had to wait for a later frame.
    pub tiles_waiting: u64,
    /// Tiles without geometry.
    pub tiles_empty: u64,
    /// Tiles drawn with more of the way back.
    pub tiles_way_back: u64,
    /// Blocks projected from scratch.
    pub blocks_projected: u64,
    /// Blocks to which only changed patches were added.
    pub blocks_stepped: u64,
    /// Blocks that were not projected, because no tile of them could show the change.
    pub blocks_spared: u64,
    /// Patches read by projections.
    pub patches_changed: u64,
    /// Frames in which the sun was up and not traced.
    pub suns_spared: u64,
    /// Times the sun was traced.
    pub suns_traced: u64,
}

impl CounterTotals {
    /// Adds a frame, in which the exposure was changed or not.
    pub fn add(&mut self, frame: &FrameCounters, is_exposed_anew: bool) {
        let drawn = if is_exposed_anew { &mut self.tiles_drawn_exposed_anew } else { &mut self.tiles_drawn };
        *drawn += frame.tiles_drawn as u64;
        let sums = [
            (&mut self.tiles_composited, frame.tiles_composited),
            (&mut self.tiles_kept, frame.tiles_kept),
            (&mut self.tiles_waiting, frame.tiles_waiting),
            (&mut self.tiles_empty, frame.tiles_empty),
            (&mut self.tiles_way_back, frame.tiles_way_back),
            (&mut self.blocks_projected, frame.blocks_projected),
            (&mut self.blocks_stepped, frame.blocks_stepped),
            (&mut self.blocks_spared, frame.blocks_spared),
            (&mut self.patches_changed, frame.patches_changed),
            (&mut self.suns_spared, usize::from(frame.sun_up && !frame.sun_traced)),
            (&mut self.suns_traced, usize::from(frame.sun_traced)),
        ];
        sums.into_iter().for_each(|(sum, count)| *sum += count as u64);
    }
}

impl std::fmt::Display for CounterTotals {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "tiles: {} drawn, {} because of the exposure, {} only composited, {} kept, {} waited, {} empty; blocks: {} projected, \
             {} stepped, {} spared; sun: {} traced, {} spared",
            self.tiles_drawn,
            self.tiles_drawn_exposed_anew,
            self.tiles_composited,
            self.tiles_kept,
            self.tiles_waiting,
            self.tiles_empty,
            self.blocks_projected,
            self.blocks_stepped,
            self.blocks_spared,
            self.suns_traced,
            self.suns_spared
        )
    }
}

impl FrameCounters {
    /// Notes that nothing was done for the light since the frame before.
    pub(super) fn count_no_light(&mut self) {
        *self = self.without_light();
    }

    /// The same without what was done for the light.
    pub(super) fn without_light(self) -> Self {
        let mut counters = FrameCounters { sun_traced: false, patches_changed: 0, ..self };
        counters.count_blocks([0; 3]);
        counters
    }

    /// Blocks projected from scratch, stepped and spared.
    pub(super) fn blocks_counted(&self) -> [usize; 3] {
        [self.blocks_projected, self.blocks_stepped, self.blocks_spared]
    }

    /// Notes [`FrameCounters::blocks_counted`].
    pub(super) fn count_blocks(&mut self, counts: [usize; 3]) {
        [self.blocks_projected, self.blocks_stepped, self.blocks_spared] = counts;
    }
}
