//! Tiles from frame to frame: what they showed when they were last drawn, and whether that still does.

use super::blocks::Block;
use super::draw::Drawing;
use super::shading::BackdropVersion;
use super::standing::Stand;
use relume_firmware::coefficients::{Sides, TileReach};
use relume_firmware::drawn::{Dimmest, DrawnTile, HALF_CODE, Off, ShownLight, SunDrift, dark_shares};
use relume_firmware::edge::Edges;
use relume_firmware::tile::{TILE_PIXELS, Tile};

/// One tile's state.
#[derive(Clone, Debug)]
pub(super) struct TileState {
    /// Valid where `is_drawn`, as are `moment`, `level` and `view`.
    drawn: DrawnTile,
    pub(super) is_drawn: bool,
    /// The newest moment whose light the tile was found to show.
    moment: u64,
    level: usize,
    view: BackdropVersion,
    pub(super) sun: SunDrift,
    /// How much the tile must be drawn: 0 if it may stay, the codes it may be off by times the frames it is so already, or
    /// infinite if nothing is known.
    pub(super) urgency: f32,
    /// Does it wait for a later frame?
    pub(super) waits: bool,
    frames_waited: u32,
    /// Does the view show through anywhere?
    shows_view: bool,
    /// Light of the edge pixels ([`Edges`]), while the view is live.
    edges: Vec<f32>,
    /// Is it the light that is shown?
    edges_kept: bool,
    pub(super) empty: bool,
    /// See [`TileReach`].
    reach: Vec<f32>,
    dark_shares: [f32; 3],
    /// How far the sky's light of `moment` has moved since the tile was drawn; `None`: known of its block only.
    moved: Option<[[Sides; 3]; 2]>,
    /// How far what is shown may be from the light of `moment`, where `moved` is known.
    off: Off,
    /// Was it drawn with the newest frame?
    drawn_now: bool,
    /// Have its pixels been written since they were asked for last?
    pub(super) is_new: bool,
    /// Bounds of what is shown now: linear, and codes with rounding.
    pub(super) shown_bound: (f32, f32),
}

impl TileState {
    pub(super) fn new(tile: &Tile<'_>) -> Self {
        let mut reach = vec![0.0; TileReach::len_of(tile)];
        TileReach::measure(tile, &mut reach);
        TileState {
            drawn: DrawnTile::NOTHING,
            is_drawn: false,
            moment: 0,
            level: 0,
            view: BackdropVersion::NONE,
            sun: SunDrift::default(),
            urgency: f32::INFINITY,
            waits: false,
            frames_waited: 0,
            shows_view: tile.pixels() < TILE_PIXELS || tile.coverage.is_some(),
            edges: Vec::new(),
            edges_kept: Edges::light_len(tile) == 0,
            empty: tile.pixels() == 0,
            reach,
            dark_shares: dark_shares(tile),
            moved: None,
            off: Off::default(),
            drawn_now: false,
            is_new: false,
            shown_bound: (0.0, 0.0),
        }
    }

    pub(super) fn reach(&self) -> TileReach<'_> {
        TileReach(&self.reach)
    }

    /// Makes room for the light of the edge pixels: the view is live.
    pub(super) fn keep_edges(&mut self, tile: &Tile<'_>) {
        self.edges.resize(Edges::light_len(tile), 0.0);
    }

    /// Where the light of the edge pixels goes when the tile is drawn.
    pub(super) fn edges_mut(&mut self) -> &mut [f32] {
        self.edges_kept |= !self.edges.is_empty();
        &mut self.edges
    }

    /// Does another view show through the tile than this one?
    pub(super) fn shows_other_view(&self, view: BackdropVersion) -> bool {
        self.shows_view && self.view != view
    }

    /// Is the light of its edge pixels known, so that another view can be put behind it?
    pub(super) fn knows_edges(&self) -> bool {
        self.edges_kept
    }

    /// Notes that another view is put behind it; the light of its edge pixels.
    pub(super) fn change_view(&mut self, view: BackdropVersion) -> &[f32] {
        self.view = view;
        &self.edges
    }

    /// Finds how urgent the tile is in `light`. Also brings `shown_bound` up to date if it may stay or wait.
    pub(super) fn judge(&mut self, tile: &Tile<'_>, drawing: &Drawing<'_>, (block, light): (&Block, &ShownLight<'_>)) {
        let level = block.level;
        self.waits = false;
        self.urgency = if !self.is_drawn || self.level != level {
            f32::INFINITY
        } else if self.empty || self.moment == drawing.moment {
            0.0
        } else if level > 0 {
            // With as many patches apart as on higher levels only the same light can be compared.
            f32::INFINITY
        } else if let Some(bound) = block.standing.stays() {
            (self.moment, self.shown_bound, self.moved) = (drawing.moment, bound, None);
            0.0
        } else {
            self.change(tile, drawing, (block, light)) * (1.0 + self.frames_waited as f32)
        };
    }

    /// Lets the tile wait for a later frame.
    pub(super) fn wait(&mut self) {
        self.waits = true;
        self.frames_waited = self.frames_waited.saturating_add(1);
    }

    /// Codes by which the light may have changed since the tile was drawn; 0 for less than a half.
    fn change(&mut self, tile: &Tile<'_>, drawing: &Drawing<'_>, (block, light): (&Block, &ShownLight<'_>)) -> f32 {
        let tile = (drawing.field, tile);
        let error = Off::of(tile, light, (&block.coefficients, &block.bound));
        let moved = self.drawn.moved(tile, light, (&self.reach(), &self.sun), &error);
        self.moved = Some(moved.sky);
        let codes = self.drawn.dimmest().codes(drawing.slope, &self.dark_shares, &moved);
        let changed = codes >= HALF_CODE;
        if !changed || drawing.for_time {
            self.note_bound(drawing, error.and_moved(&moved));
        }
        if changed {
            return codes;
        }
        self.moment = drawing.moment;
        0.0
    }

    /// Remembers what is shown from now on.
    pub(super) fn note(
        &mut self,
        tile: &Tile<'_>,
        drawing: &Drawing<'_>,
        (block, light): (&Block, &ShownLight<'_>),
        dimmest: Dimmest,
    ) {
        self.drawn.set(light, dimmest);
        (self.is_drawn, self.moment) = (true, drawing.moment);
        self.frames_waited = 0;
        (self.level, self.view) = (block.level, drawing.behind.version_of(tile.index));
        self.sun.reset();
        (self.moved, self.drawn_now) = (Some(Default::default()), true);
        self.note_bound(drawing, Off::of((drawing.field, tile), light, (&block.coefficients, &block.bound)));
    }

    /// How far the sky's light has moved, if the tile shows that of `moment` and nothing but the sky's has moved.
    pub(super) fn stand(&self, moment: u64, sun_q16: [u32; 3]) -> Option<Stand> {
        let alike = self.is_drawn && self.moment == moment && self.level == 0 && self.sun.is_still();
        let (dimmest, dark_shares) = (self.drawn.dimmest(), self.dark_shares);
        let stand =
            Stand { moved: self.moved?, off: self.off, by_factors: self.drawn.is_by_factors(), dimmest, dark_shares };
        (alike && self.drawn.is_under(sun_q16)).then_some(stand)
    }

    /// Will it be drawn whatever the light of its block, before this view?
    pub(super) fn must_be_drawn(&self, view: BackdropVersion) -> bool {
        !self.empty && (!self.is_drawn || self.shows_other_view(view) && !self.knows_edges())
    }

    /// Was it drawn since this was asked last?
    pub(super) fn was_drawn(&mut self) -> bool {
        std::mem::take(&mut self.drawn_now)
    }

    /// `error`: how far what is shown may be from what is meant.
    fn note_bound(&mut self, drawing: &Drawing<'_>, error: Off) {
        self.off = error;
        self.shown_bound =
            (error.linear(), self.drawn.dimmest().codes_rounded(drawing.slope, &self.dark_shares, &error));
    }
}
