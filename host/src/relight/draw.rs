//! Drawing: bands of tiles to the framebuffer.

use super::blocks::Block;
use super::levels::Levels;
use super::tiles::TileState;
use relume_firmware::bound::CodeSlope;
use relume_firmware::composite::{Compositor, Target};
use relume_firmware::drawn::{Dimmest, ShownLight};
use relume_firmware::field::Field;
use relume_firmware::relight::{Coefficients, LinearTile, TileLight, UnpackedRows};
use relume_firmware::surface::Surface;
use relume_firmware::tile::{BLOCK_TILES, TILE_PX};

/// Tiles of a band or frame, by what became of them.
#[derive(Clone, Copy, Default)]
pub(super) struct Drew {
    pub(super) drawn: usize,
    pub(super) kept: usize,
    pub(super) empty: usize,
    pub(super) way_back: usize,
    pub(super) bound_linear: f32,
    pub(super) bound_codes: f32,
}

impl Drew {
    pub(super) fn and(self, other: Drew) -> Drew {
        Drew {
            drawn: self.drawn + other.drawn,
            kept: self.kept + other.kept,
            empty: self.empty + other.empty,
            way_back: self.way_back + other.way_back,
            bound_linear: self.bound_linear.max(other.bound_linear),
            bound_codes: self.bound_codes.max(other.bound_codes),
        }
    }
}

/// What all bands of a frame share.
pub(super) struct Drawing<'a> {
    pub(super) field: &'a Field<'a>,
    pub(super) compositor: Compositor<'a>,
    pub(super) levels: &'a Levels,
    pub(super) blocks: &'a [Block],
    pub(super) sun: Option<(&'a [u16], [u32; 3])>,
    pub(super) unpacked: &'a [UnpackedRows<'a>],
    /// Is there an error budget?
    pub(super) for_error: bool,
    pub(super) slope: &'a CodeSlope,
    pub(super) view: u64,
    pub(super) rank_limit: Option<usize>,
    /// Number of the light that is drawn.
    pub(super) moment: u64,
}

impl Drawing<'_> {
    /// Draws one row of tiles.
    pub(super) fn band(&self, row: usize, pixels: &mut [u32], states: &mut [TileState]) -> Drew {
        let width = self.field.width();
        let rows = pixels.len() / width;
        let Ok(mut surface) = Surface::new(pixels, width, rows, width) else { return Drew::default() };
        let mut drew = Drew::default();
        let mut linear = LinearTile::new();
        let across = self.field.response().block_grid().0;
        let columns = states.len();
        for (column, state) in states.iter_mut().enumerate() {
            let index = row * columns + column;
            let block = &self.blocks[row / BLOCK_TILES * across + column / BLOCK_TILES];
            drew.empty += usize::from(state.empty);
            let limited = self.limited(block);
            let coefficients = limited.as_ref().unwrap_or(&block.coefficients);
            let weights = &self.levels.get(block.level).weights;
            let shown = ShownLight { coefficients, weights, sun_q16: self.sun_q16() };
            if state.unchanged(index, self, (block, &shown)) {
                drew.kept += usize::from(!state.empty);
            } else {
                let response = self.field.response();
                if index + 1 < response.tiles() {
                    Coefficients::prefetch_pixels(&response.tile(index + 1), self.compositor.kernel);
                }
                let light = TileLight { sun: self.sun, weights, unpacked: self.unpacked };
                let target =
                    Target { surface: &mut surface, surface_y0: row * TILE_PX, at: (column * TILE_PX, row * TILE_PX) };
                let extent = self.compositor.tile(self.field, index, (coefficients, &light), &mut linear, target);
                if state.empty || self.levels.bounds_on() {
                    let mut dimmest = Dimmest::of_extent(extent);
                    if self.for_error && !state.empty {
                        // An error budget is worth a second look: a dark pixel of a dark row is not at fault.
                        coefficients.pixels(self.field, index, &light, self.compositor.kernel, &mut linear);
                        dimmest = dimmest.with_pixels(&response.tile(index), &linear);
                    }
                    state.note(index, self, (block, &shown), dimmest);
                }
                drew.drawn += usize::from(!state.empty);
                drew.way_back += usize::from(block.level > 0 && !state.empty);
            }
            if !state.empty {
                drew.bound_linear = drew.bound_linear.max(state.shown_bound.0);
                drew.bound_codes = drew.bound_codes.max(state.shown_bound.1);
            }
        }
        drew
    }

    pub(super) fn sun_q16(&self) -> [u32; 3] {
        self.sun.map_or([0; 3], |(_, q16)| q16)
    }

    /// The block's coefficients with no more ranks than the frame allows; `None` if it allows all.
    pub(super) fn limited(&self, block: &Block) -> Option<Coefficients> {
        let limit = self.rank_limit.filter(|&limit| limit < block.coefficients.rank())?;
        let mut coefficients = block.coefficients;
        coefficients.limit_rank(limit);
        Some(coefficients)
    }
}
