//! Tiles from frame to frame: what they showed when they were last drawn, and whether that still does.

use super::blocks::Block;
use super::draw::Drawing;
use relume_firmware::bound::{CodeSlope, dark_share};
use relume_firmware::coefficients::TileReach;
use relume_firmware::field::Field;
use relume_firmware::kernel::Extent;
use relume_firmware::relight::{Coefficients, LinearTile, SUN_UNIT};
use relume_firmware::tile::{TILE_PIXELS, Tile};
use relume_firmware::weights::{Apart, FixedWeights, MAX_STANDOUTS};

/// What a tile showed when it was last drawn.
#[derive(Clone, Debug)]
struct Drawn {
    coefficients: Coefficients,
    sun_q16: [u32; 3],
    /// Patches that were shown by their own rows; on levels above 0 only that there were some.
    apart: [Apart; MAX_STANDOUTS],
    apart_count: usize,
    level: usize,
    view: u64,
    /// Light that no pixel falls below, per channel.
    smallest: [f32; 3],
    /// Light over (row scale / 65535) that no pixel falls below.
    brightness: [f32; 3],
    /// Bounds on its error, `[plain, weighted][channel]`.
    bound: [[f32; 3]; 2],
}

/// One tile's state.
#[derive(Clone, Debug)]
pub(super) struct TileState {
    /// Valid where `is_drawn`.
    drawn: Drawn,
    pub(super) is_drawn: bool,
    /// Largest change of the sun's response plane since the tile was last drawn, in 1/32768, summed over retracings.
    pub(super) sun_drift: u32,
    /// Largest value of the sun's response plane, in 1/32768.
    pub(super) sun_peak: u32,
    /// Does the view show through anywhere?
    shows_view: bool,
    pub(super) empty: bool,
    /// See [`TileReach`].
    reach: Vec<f32>,
    /// [`dark_share`] of the smallest row scale that is not black, per channel.
    dark_share: [f32; 3],
    /// Bounds of what is shown now: linear, and codes with rounding.
    pub(super) shown_bound: (f32, f32),
}

/// Rounding of an 8-bit code, and what the tone kernel's curve is off by.
const CODE_ROUNDING: f32 = 0.55;
/// A tile is kept when it changes by less than this.
const HALF_CODE: f32 = 0.5;

impl TileState {
    pub(super) fn new(field: &Field<'_>, index: usize) -> Self {
        let tile = field.response().tile(index);
        let mut reach = vec![0.0; 6 * tile.rank()];
        TileReach::measure(&tile, &mut reach);
        TileState {
            drawn: Drawn {
                coefficients: Coefficients::ZERO,
                sun_q16: [0; 3],
                apart: [Apart::default(); MAX_STANDOUTS],
                apart_count: 0,
                level: 0,
                view: 0,
                smallest: [0.0; 3],
                brightness: [0.0; 3],
                bound: [[0.0; 3]; 2],
            },
            is_drawn: false,
            sun_drift: 0,
            sun_peak: 0,
            shows_view: tile.pixels() < TILE_PIXELS || field.coverage(index).is_some(),
            empty: tile.pixels() == 0,
            reach,
            dark_share: darkest_row(&tile).map(dark_share),
            shown_bound: (0.0, 0.0),
        }
    }

    /// May tile number `index` stay as it is? Also brings `shown_bound` up to date if so.
    pub(super) fn unchanged(&mut self, index: usize, drawing: &Drawing<'_>, block: &Block) -> bool {
        if !self.is_drawn || (self.shows_view && self.drawn.view != drawing.view) || self.drawn.level != block.level {
            return false;
        }
        if self.empty {
            return true;
        }
        let tile = drawing.field.response().tile(index);
        let weights = &drawing.levels.get(block.level).weights;
        let Some(rows) = self.rows_change(index, &tile, drawing, weights) else { return false };
        let limited = drawing.limited(block);
        let coefficients = limited.as_ref().unwrap_or(&block.coefficients);
        let mut moved = coefficients.change_bound(&self.drawn.coefficients, &tile, &TileReach(&self.reach));
        for c in 0..3 {
            moved.iter_mut().for_each(|kind| kind[c] += rows[c]);
        }
        let sun = self.sun_change(drawing.sun_q16());
        let codes = self.codes(drawing.slope, moved, sun);
        if codes >= HALF_CODE {
            return false;
        }
        for (moved, bound) in moved.iter_mut().flatten().zip(self.drawn.bound.iter().flatten()) {
            *moved += bound;
        }
        self.note_bound(drawing.slope, moved, sun);
        true
    }

    /// Remembers what is shown from now on.
    pub(super) fn note(&mut self, index: usize, drawing: &Drawing<'_>, block: &Block, dimmest: Dimmest) {
        let tile = drawing.field.response().tile(index);
        let weights = &drawing.levels.get(block.level).weights;
        let limited = drawing.limited(block);
        let coefficients = limited.as_ref().unwrap_or(&block.coefficients);
        let rounding = coefficients.rounding_bound(&block.coefficients, &tile);
        let rows = rows_error(index, &tile, drawing.field, weights);
        let drawn = &mut self.drawn;
        drawn.coefficients.copy_from(coefficients);
        drawn.sun_q16 = drawing.sun_q16();
        drawn.apart_count = 0;
        for apart in weights.apart().take(MAX_STANDOUTS) {
            drawn.apart[drawn.apart_count] = apart;
            drawn.apart_count += 1;
        }
        (drawn.level, drawn.view) = (block.level, drawing.view);
        (drawn.smallest, drawn.brightness) = (dimmest.smallest, dimmest.brightness);
        drawn.bound = block.bound;
        for kind in &mut drawn.bound {
            (0..3).for_each(|c| kind[c] += rounding[c] + rows[c]);
        }
        self.is_drawn = true;
        self.sun_drift = 0;
        let bound = self.drawn.bound;
        self.note_bound(drawing.slope, bound, [0.0; 3]);
    }

    /// `sun` is what the sun's light may have changed by since.
    fn note_bound(&mut self, slope: &CodeSlope, bound: [[f32; 3]; 2], sun: [f32; 3]) {
        let linear = (0..3).fold(0.0f32, |all, c| all.max(bound[0][c] + sun[c]));
        self.shown_bound = (linear, self.codes(slope, bound, sun) + CODE_ROUNDING);
    }

    /// The largest change of a code that a change of the sky's light within `sky` and of the sun's within `sun` makes.
    fn codes(&self, slope: &CodeSlope, sky: [[f32; 3]; 2], sun: [f32; 3]) -> f32 {
        let Drawn { smallest, brightness, .. } = self.drawn;
        let code = |c: usize| {
            let sun_codes = if sun[c] > 0.0 { slope.above(smallest[c] - sky[0][c] - sun[c]) * sun[c] } else { 0.0 };
            slope.codes(sky[0][c], sky[1][c], brightness[c], self.dark_share[c]) + sun_codes
        };
        code(0).max(code(1)).max(code(2))
    }

    /// A bound on the change of the sun's light since the tile was drawn, per channel.
    fn sun_change(&self, sun_q16: [u32; 3]) -> [f32; 3] {
        core::array::from_fn(|c| {
            let drawn = self.drawn.sun_q16[c];
            let moved = self.sun_drift as f32 * drawn.max(sun_q16[c]) as f32;
            (moved + drawn.abs_diff(sun_q16[c]) as f32 * self.sun_peak as f32) * SUN_UNIT
        })
    }

    /// A bound on what the rows of patches apart change; `None` where it is not worth finding out.
    fn rows_change(
        &self,
        index: usize,
        tile: &Tile<'_>,
        drawing: &Drawing<'_>,
        weights: &FixedWeights,
    ) -> Option<[f32; 3]> {
        let drawn = &self.drawn.apart[..self.drawn.apart_count];
        if self.drawn.level > 0 {
            return drawing.same_weights.then_some([0.0; 3]);
        }
        let mut sum = [0.0f32; 3];
        let mut add = |patch: u16, before: [f32; 3], after: [f32; 3]| {
            let Some(rows) = drawing.field.way_back().get(index, tile, usize::from(patch)) else { return };
            let largest = rows.largest();
            for (c, sum) in sum.iter_mut().enumerate() {
                *sum += (after[c] - before[c]).abs() * largest * tile.row_top(c) * 1.0001;
            }
        };
        for apart in weights.apart() {
            let before = drawn.iter().find(|d| d.patch == apart.patch).map_or([0.0; 3], |d| d.light);
            add(apart.patch, before, apart.light);
        }
        for gone in drawn.iter().filter(|d| weights.apart().all(|a| a.patch != d.patch)) {
            add(gone.patch, gone.light, [0.0; 3]);
        }
        Some(sum)
    }
}

/// A bound on the error of the rows of patches apart, plain and weighted.
fn rows_error(index: usize, tile: &Tile<'_>, field: &Field<'_>, weights: &FixedWeights) -> [f32; 3] {
    let mut sum = [0.0f32; 3];
    for apart in weights.apart() {
        if let Some(rows) = field.way_back().get(index, tile, usize::from(apart.patch)) {
            let error = rows.error();
            (0..3).for_each(|c| sum[c] += error * apart.light[c] * tile.row_top(c) * 1.0001);
        }
    }
    sum
}

fn darkest_row(tile: &Tile<'_>) -> [f32; 3] {
    let n = tile.padded_pixels();
    core::array::from_fn(|c| {
        let rows = tile.rows.as_chunks::<2>().0[c * n..][..tile.pixels()].iter();
        let darkest = rows.map(|row| u16::from_le_bytes(*row)).filter(|&row| row > 0).min();
        f32::from(darkest.unwrap_or(u16::MAX)) / 65535.0
    })
}

/// How dim a tile's pixels are, per channel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dimmest {
    /// Light that no pixel falls below.
    pub(super) smallest: [f32; 3],
    /// Light over (row scale / 65535) that no pixel falls below.
    pub(super) brightness: [f32; 3],
}

impl Dimmest {
    /// From what the kernel tells: no row scale is above 65535.
    pub(super) fn of(extent: Extent) -> Self {
        Dimmest { smallest: extent.smallest(), brightness: extent.smallest() }
    }
}

/// Light over (row scale / 65535) that no pixel falls below, from a tile's linear values; black rows do not count.
pub(super) fn brightness_of(tile: &Tile<'_>, linear: &LinearTile) -> [f32; 3] {
    let n = tile.padded_pixels();
    core::array::from_fn(|c| {
        let rows = tile.rows.as_chunks::<2>().0[c * n..][..tile.pixels()].iter().map(|row| u16::from_le_bytes(*row));
        let lit = rows.zip(&linear.0[c]).filter(|(row, _)| *row > 0);
        lit.map(|(row, light)| light * 65535.0 / f32::from(row)).fold(f32::INFINITY, f32::min)
    })
}
