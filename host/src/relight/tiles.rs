//! Tiles from frame to frame: what they showed when they were last drawn, and whether that still does.

use super::blocks::Block;
use super::draw::Drawing;
use relume_firmware::coefficients::TileReach;
use relume_firmware::drawn::{Dimmest, DrawnTile, HALF_CODE, Off, ShownLight, SunDrift, dark_shares};
use relume_firmware::field::Field;
use relume_firmware::tile::TILE_PIXELS;

/// One tile's state.
#[derive(Clone, Debug)]
pub(super) struct TileState {
    /// Valid where `is_drawn`, as are `moment`, `level` and `view`.
    drawn: DrawnTile,
    pub(super) is_drawn: bool,
    /// The newest moment whose light the tile was found to show.
    moment: u64,
    level: usize,
    view: u64,
    pub(super) sun: SunDrift,
    /// Does the view show through anywhere?
    shows_view: bool,
    pub(super) empty: bool,
    /// See [`TileReach`].
    reach: Vec<f32>,
    dark_shares: [f32; 3],
    /// Bounds of what is shown now: linear, and codes with rounding.
    pub(super) shown_bound: (f32, f32),
}

impl TileState {
    pub(super) fn new(field: &Field<'_>, index: usize) -> Self {
        let tile = field.response().tile(index);
        let mut reach = vec![0.0; 6 * tile.rank()];
        TileReach::measure(&tile, &mut reach);
        TileState {
            drawn: DrawnTile::NOTHING,
            is_drawn: false,
            moment: 0,
            level: 0,
            view: 0,
            sun: SunDrift::default(),
            shows_view: tile.pixels() < TILE_PIXELS || field.coverage(index).is_some(),
            empty: tile.pixels() == 0,
            reach,
            dark_shares: dark_shares(&tile),
            shown_bound: (0.0, 0.0),
        }
    }

    /// May tile number `index` stay as it is in `light`? Also brings `shown_bound` up to date if so.
    pub(super) fn unchanged(
        &mut self,
        index: usize,
        drawing: &Drawing<'_>,
        (block, light): (&Block, &ShownLight<'_>),
    ) -> bool {
        let level = block.level;
        if !self.is_drawn || (self.shows_view && self.view != drawing.view) || self.level != level {
            return false;
        }
        if self.empty || self.moment == drawing.moment {
            return true;
        }
        // With as many patches apart as on higher levels only the same light can be compared.
        if level > 0 {
            return false;
        }
        let moved = self.drawn.moved((drawing.field, index), light, &TileReach(&self.reach), &self.sun);
        if self.drawn.codes(drawing.slope, &self.dark_shares, &moved) >= HALF_CODE {
            return false;
        }
        self.note_bound(index, drawing, (block, light), &moved);
        self.moment = drawing.moment;
        true
    }

    /// Remembers what is shown from now on.
    pub(super) fn note(
        &mut self,
        index: usize,
        drawing: &Drawing<'_>,
        (block, light): (&Block, &ShownLight<'_>),
        dimmest: Dimmest,
    ) {
        self.drawn.set(light, dimmest);
        (self.is_drawn, self.moment) = (true, drawing.moment);
        (self.level, self.view) = (block.level, drawing.view);
        self.sun.reset();
        self.note_bound(index, drawing, (block, light), &Off::default());
    }

    /// `moved`: how far what is shown may be from what `light` would show.
    fn note_bound(
        &mut self,
        index: usize,
        drawing: &Drawing<'_>,
        (block, light): (&Block, &ShownLight<'_>),
        moved: &Off,
    ) {
        let error = Off::of((drawing.field, index), light, (&block.coefficients, &block.bound)).and(moved);
        self.shown_bound = (error.linear(), self.drawn.codes_rounded(drawing.slope, &self.dark_shares, &error));
    }
}
