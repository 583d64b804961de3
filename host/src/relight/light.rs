//! Light instead of codes: the linear values of all tiles, kept from frame to frame for whoever shows them otherwise.

use super::counters::FrameCounters;
use super::draw::{Drawing, Drew};
use super::shading::Backdrop;
use super::{Relighter, View};
use relume_firmware::relight::LinearTile;

impl Relighter<'_> {
    /// Floats that the linear values of all tiles take: `[tile][channel][padded covered pixel]`, laid out like the row scales.
    pub fn light_len(&self) -> usize {
        self.field.response().plane_len()
    }

    /// Brings the linear values of the newest weights (1 = display white) up to date in `light`: only of tiles that may change
    /// by half a code or more since they were written. [`Relighter::take_written`] tells which. Budgets do not count here.
    pub fn keep_light(&mut self, light: &mut [f32]) -> FrameCounters {
        let behind = Backdrop { view: &View::nothing(), shading: None };
        if let Some(still) = self.still(&behind) {
            return still;
        }
        self.catch_up(None);
        self.find_standing();
        let mut states = std::mem::take(&mut self.states);
        let drew = self.with_drawing(&behind, |drawing| {
            let mut linear = LinearTile::new();
            let tiles = states.iter_mut().enumerate();
            tiles
                .map(|(index, state)| drawing.keep(index, state, (&mut linear, &mut *light)))
                .fold(Drew::default(), Drew::and)
        });
        self.states = states;
        let counters = self.count(&drew);
        self.remember_standing();
        self.shown = self.settled.then_some((counters, behind.version(), self.moment));
        self.new_weights = false;
        counters
    }

    /// Calls `each` with the tiles that were written since this was asked last.
    pub fn take_written(&mut self, mut each: impl FnMut(usize)) {
        for (index, state) in self.states.iter_mut().enumerate() {
            if std::mem::take(&mut state.is_new) {
                each(index);
            }
        }
    }
}

impl Drawing<'_> {
    /// Writes the linear values of tile number `index` into its place in `light`, if they may have changed.
    fn keep(&self, index: usize, state: &mut super::TileState, (linear, light): (&mut LinearTile, &mut [f32])) -> Drew {
        if state.empty {
            return Drew { empty: 1, ..Drew::default() };
        }
        let (tile, block) = (&self.tiles[index], &self.blocks[self.field.response().block_of(index)]);
        let shown = self.light(block, None);
        state.judge(tile, self, (block, &shown));
        if state.urgency == 0.0 {
            return Drew { kept: 1, ..Drew::default() };
        }
        let with =
            relume_firmware::relight::TileLight { sun: self.sun, weights: shown.weights, unpacked: self.unpacked };
        let extent = shown.coefficients.pixels(self.field, tile, &with, self.compositor.kernel, linear);
        let n = tile.padded_pixels();
        for (plane, kept) in linear.planes(n).into_iter().zip(light[tile.plane_at..tile.plane_at + 3 * n].chunks_mut(n))
        {
            kept.copy_from_slice(plane);
        }
        state.is_new = true;
        state.note(tile, self, (block, &shown), relume_firmware::drawn::Dimmest::of_extent(extent));
        Drew { drawn: 1, ..Drew::default() }
    }
}
