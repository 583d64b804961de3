//! Drawing: bands of tiles to the framebuffer.

use super::blocks::Block;
use super::levels::Levels;
use super::shading::Backdrop;
use super::tiles::TileState;
use relume_firmware::apart::UnpackedRows;
use relume_firmware::bound::CodeSlope;
use relume_firmware::composite::{Compositor, Target};
use relume_firmware::drawn::{Dimmest, ShownLight};
use relume_firmware::field::Field;
use relume_firmware::relight::{Coefficients, LinearTile, TileLight};
use relume_firmware::surface::Surface;
use relume_firmware::tile::{BLOCK_TILES, TILE_PX, Tile};

/// Tiles of a band or frame, by what became of them.
#[derive(Clone, Copy, Default)]
pub(super) struct Drew {
    pub(super) drawn: usize,
    pub(super) kept: usize,
    pub(super) composited: usize,
    pub(super) waiting: usize,
    pub(super) empty: usize,
    pub(super) way_back: usize,
    pub(super) beyond_budget: usize,
    pub(super) bound_linear: f32,
    pub(super) bound_codes: f32,
}

impl Drew {
    pub(super) fn and(self, other: Drew) -> Drew {
        Drew {
            drawn: self.drawn + other.drawn,
            kept: self.kept + other.kept,
            composited: self.composited + other.composited,
            waiting: self.waiting + other.waiting,
            empty: self.empty + other.empty,
            way_back: self.way_back + other.way_back,
            beyond_budget: self.beyond_budget + other.beyond_budget,
            bound_linear: self.bound_linear.max(other.bound_linear),
            bound_codes: self.bound_codes.max(other.bound_codes),
        }
    }
}

/// What becomes of a tile.
enum Fate {
    /// It stays as it is.
    Stays,
    /// Its light stays; another view is put behind it.
    ChangesView,
    /// It is drawn.
    IsDrawn,
}

/// What all bands of a frame share.
pub(super) struct Drawing<'a> {
    pub(super) field: &'a Field<'a>,
    pub(super) tiles: &'a [Tile<'a>],
    pub(super) compositor: Compositor<'a>,
    pub(super) levels: &'a Levels,
    pub(super) blocks: &'a [Block],
    pub(super) sun: Option<(&'a [u16], [u32; 3])>,
    pub(super) unpacked: &'a [UnpackedRows<'a>],
    /// Is there a time budget? Then it is known what is drawn.
    pub(super) for_time: bool,
    /// The error budget; infinite without one.
    pub(super) most_codes: f32,
    pub(super) slope: &'a CodeSlope,
    pub(super) behind: Backdrop<'a>,
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
            let tile = &self.tiles[index];
            let block = &self.blocks[row / BLOCK_TILES * across + column / BLOCK_TILES];
            drew.empty += usize::from(state.empty);
            let limited = self.limited(block);
            let shown = self.light(block, limited.as_ref());
            if !self.for_time {
                state.judge(tile, self, (block, &shown));
            }
            let one = usize::from(!state.empty);
            let at = (column * TILE_PX, row * TILE_PX);
            let target = Target { surface: &mut surface, surface_y0: row * TILE_PX, at };
            match self.fate(index, state) {
                Fate::Stays if state.waits => drew.waiting += one,
                Fate::Stays => drew.kept += one,
                Fate::ChangesView => {
                    state.is_new = true;
                    let (edges, shade) =
                        (state.change_view(self.behind.version_of(index)), self.behind.shade_of(index));
                    self.compositor.view_alone(tile, edges, &mut linear, shade, target);
                    *(if state.waits { &mut drew.waiting } else { &mut drew.composited }) += one;
                }
                Fate::IsDrawn => {
                    state.is_new = true;
                    self.draw(tile, (state, block), &shown, &mut linear, target);
                    drew.drawn += one;
                    drew.way_back += one * usize::from(block.level > 0);
                }
            }
            if !state.empty {
                drew.bound_linear = drew.bound_linear.max(state.shown_bound.0);
                drew.bound_codes = drew.bound_codes.max(state.shown_bound.1);
                drew.beyond_budget += usize::from(state.shown_bound.1 > self.most_codes);
            }
        }
        drew
    }

    /// Finds how urgent tile number `index` is, before any is drawn.
    pub(super) fn judge(&self, index: usize, state: &mut TileState) {
        let block = &self.blocks[self.field.response().block_of(index)];
        let limited = self.limited(block);
        state.judge(&self.tiles[index], self, (block, &self.light(block, limited.as_ref())));
    }

    /// The light of a block, with no more ranks than the frame allows.
    pub(super) fn light<'l>(&'l self, block: &'l Block, limited: Option<&'l Coefficients>) -> ShownLight<'l> {
        let coefficients = limited.unwrap_or(&block.coefficients);
        let weights = &self.levels.get(block.level).weights;
        ShownLight { coefficients, weights, unpacked: self.unpacked, sun_q16: self.sun_q16() }
    }

    /// What becomes of a tile that was judged.
    fn fate(&self, index: usize, state: &TileState) -> Fate {
        let light_stays = state.urgency == 0.0 || state.waits;
        match (light_stays, state.shows_other_view(self.behind.version_of(index))) {
            (true, false) => Fate::Stays,
            (true, true) if state.knows_edges() => Fate::ChangesView,
            _ => Fate::IsDrawn,
        }
    }

    /// Draws a tile.
    fn draw(
        &self,
        tile: &Tile<'_>,
        (state, block): (&mut TileState, &Block),
        shown: &ShownLight<'_>,
        linear: &mut LinearTile,
        target: Target<'_, '_>,
    ) {
        let light = TileLight { sun: self.sun, weights: shown.weights, unpacked: self.unpacked };
        if let Some(next) = self.tiles.get(tile.index + 1) {
            light.prefetch(next, self.compositor.kernel);
        }
        let with = (shown.coefficients, &light);
        let (edges, shade) = (state.edges_mut(), self.behind.shade_of(tile.index));
        let extent = self.compositor.tile((self.field, tile), with, linear, edges, shade, target);
        if state.empty || self.levels.bounds_on() {
            state.note(tile, self, (block, shown), Dimmest::of_extent(extent));
        }
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
