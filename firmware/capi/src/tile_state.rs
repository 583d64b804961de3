//! What a tile shows, whether that may stay, and how right it is.

use crate::block_state::Projected;
use crate::frame::{Target, ViewIdentity};
use relume_firmware::bound::{CodeSlope, dark_share};
use relume_firmware::coefficients::TileReach;
use relume_firmware::field::Field;
use relume_firmware::kernel::Extent;
use relume_firmware::relight::{Coefficients, SUN_UNIT};
use relume_firmware::tile::{TILE_PIXELS, Tile};
use relume_firmware::weights::{Apart, FixedWeights, MAX_STANDOUTS};

/// A tile is kept when no code of it changes by more than this before rounding.
const HALF_CODE: f32 = 0.5;
/// Rounding of an 8-bit code, and what the tone kernel's curve is off by.
const CODE_ROUNDING: f32 = 0.55;

/// The light of a frame beside the blocks' coefficients.
#[derive(Clone, Copy)]
pub struct FrameLight<'a> {
    /// The light's number.
    pub number: u64,
    /// The sun's weight; 0: no sun.
    pub sun_q16: [u32; 3],
    /// Patches apart: shown by their own rows.
    pub weights: &'a FixedWeights,
    /// Turns bounds on light into bounds on codes.
    pub slope: &'a CodeSlope,
}

/// What a tile was last drawn with.
#[derive(Clone, Copy)]
struct Drawn {
    coefficients: Coefficients,
    sun_q16: [u32; 3],
    apart: [Apart; MAX_STANDOUTS],
    apart_count: usize,
    extent: Extent,
    /// Bounds on its error, `[plain, weighted][channel]`.
    bound: [[f32; 3]; 2],
    view: ViewIdentity,
    target: Target,
}

/// One tile's state from frame to frame.
pub struct TileState {
    drawn: Option<Drawn>,
    /// Number of the light that the tile was last found to show, or near enough; 0: none.
    judged_light: u64,
    /// Number of the sun's direction that the tile's plane was traced for; 0: none.
    pub traced_sun: u64,
    /// Largest change of the sun's response since the tile was last drawn, in 1/32768, summed over retracings.
    sun_drift: u32,
    /// Largest value of the sun's response before and after the newest tracing, in 1/32768.
    sun_peak: u32,
    /// [`dark_share`] of the smallest row scale that is not black, per channel.
    dark_share: [f32; 3],
    /// Bounds on what is shown now: linear, and codes with rounding.
    pub shown_bound: (f32, f32),
    /// Does the view show through anywhere?
    shows_view: bool,
    /// Has the tile no geometry?
    pub empty: bool,
}

impl TileState {
    /// A tile that was never drawn.
    pub fn new(field: &Field<'_>, index: usize) -> Self {
        let tile = field.response().tile(index);
        TileState {
            drawn: None,
            judged_light: 0,
            traced_sun: 0,
            sun_drift: 0,
            sun_peak: 0,
            dark_share: darkest_row(&tile).map(dark_share),
            shown_bound: (0.0, 0.0),
            shows_view: tile.pixels() < TILE_PIXELS || field.coverage(index).is_some(),
            empty: tile.pixels() == 0,
        }
    }

    /// Takes a new response to the sun of direction number `sun` over the old one.
    pub fn take_sun(&mut self, sun: u64, slot: &mut [u16], fresh: &[u16]) {
        let (mut largest, mut peak) = (0, 0);
        for (old, &new) in slot.iter_mut().zip(fresh) {
            largest = largest.max(old.abs_diff(new));
            peak = peak.max(*old).max(new);
            *old = new;
        }
        self.sun_drift = self.sun_drift.saturating_add(u32::from(largest));
        self.sun_peak = u32::from(peak);
        self.traced_sun = sun;
        self.judged_light = 0;
    }

    /// Was the tile drawn here and over this view?
    pub fn in_place(&self, target: Target, view: ViewIdentity) -> bool {
        self.drawn.as_ref().is_some_and(|drawn| drawn.target == target && (!self.shows_view || drawn.view == view))
    }

    /// Does the tile show light number `light` already?
    pub fn shows_light(&self, light: u64) -> bool {
        self.empty || self.judged_light == light
    }

    /// Would the tile change by less than half a code? Remembers it if so, and how right the tile still is.
    pub fn may_stay(&mut self, field: &Field<'_>, index: usize, projected: &Projected, light: FrameLight<'_>) -> bool {
        let Some(drawn) = &self.drawn else { return false };
        let tile = field.response().tile(index);
        let rows = rows_change((field, index, &tile), &drawn.apart[..drawn.apart_count], light.weights);
        let mut moved = projected.coefficients.change_bound(&drawn.coefficients, &tile, &TileReach(&[]));
        for kind in &mut moved {
            kind.iter_mut().zip(rows).for_each(|(moved, rows)| *moved += rows);
        }
        let sun = self.sun_change(drawn, light.sun_q16);
        if self.codes(light.slope, &drawn.extent, moved, sun) >= HALF_CODE {
            return false;
        }
        for (moved, bound) in moved.iter_mut().flatten().zip(drawn.bound.iter().flatten()) {
            *moved += bound;
        }
        self.shown_bound = self.bound_of(light.slope, &drawn.extent, moved, sun);
        self.judged_light = light.number;
        true
    }

    /// Notes that the tile was drawn.
    pub fn note_drawn(
        &mut self,
        (field, index): (&Field<'_>, usize),
        projected: &Projected,
        (light, extent): (FrameLight<'_>, Extent),
        (target, view): (Target, ViewIdentity),
    ) {
        let Projected { coefficients, mut bound } = *projected;
        let tile = field.response().tile(index);
        let rounding = coefficients.rounding_bound(&coefficients, &tile);
        let rows = rows_error((field, index, &tile), light.weights);
        for kind in &mut bound {
            kind.iter_mut().zip(rounding.iter().zip(rows)).for_each(|(bound, (a, b))| *bound += a + b);
        }
        let mut apart = [Apart::default(); MAX_STANDOUTS];
        let apart_count = apart.iter_mut().zip(light.weights.apart()).map(|(own, other)| *own = other).count();
        let sun_q16 = light.sun_q16;
        self.shown_bound = self.bound_of(light.slope, &extent, bound, [0.0; 3]);
        self.drawn = Some(Drawn { coefficients, sun_q16, apart, apart_count, extent, bound, view, target });
        self.judged_light = light.number;
        self.sun_drift = 0;
    }

    /// A bound on the change of the sun's light since the tile was drawn, per channel.
    fn sun_change(&self, drawn: &Drawn, sun_q16: [u32; 3]) -> [f32; 3] {
        core::array::from_fn(|c| {
            let (old, new) = (drawn.sun_q16[c], sun_q16[c]);
            let moved = self.sun_drift as f32 * old.max(new) as f32;
            (moved + old.abs_diff(new) as f32 * self.sun_peak as f32) * SUN_UNIT
        })
    }

    /// Linear and, with rounding, in codes: what is shown when the sky's light is within `sky` and the sun's within `sun`.
    fn bound_of(&self, slope: &CodeSlope, extent: &Extent, sky: [[f32; 3]; 2], sun: [f32; 3]) -> (f32, f32) {
        (sky[0].into_iter().fold(0.0, f32::max), self.codes(slope, extent, sky, sun) + CODE_ROUNDING)
    }

    /// The largest change of a code that a change of the sky's light within `sky` and of the sun's within `sun` makes
    /// in a tile of linear values within `extent`.
    fn codes(&self, slope: &CodeSlope, extent: &Extent, sky: [[f32; 3]; 2], sun: [f32; 3]) -> f32 {
        let smallest = extent.smallest();
        let code = |c: usize| {
            let after = smallest[c] - sky[0][c] - sun[c];
            let by_sun = if sun[c] > 0.0 { slope.above(after) * sun[c] } else { 0.0 };
            slope.codes(sky[0][c], sky[1][c], smallest[c], self.dark_share[c]) + by_sun
        };
        code(0).max(code(1)).max(code(2))
    }
}

/// A bound on what the rows of patches apart change in a tile, per channel; it holds over
/// (row scale / 65535)^0.583, too.
fn rows_change((field, index, tile): (&Field<'_>, usize, &Tile<'_>), old: &[Apart], new: &FixedWeights) -> [f32; 3] {
    let mut sum = [0.0f32; 3];
    let mut add = |patch: u16, before: [f32; 3], after: [f32; 3]| {
        let Some(rows) = field.way_back().get(index, tile, usize::from(patch)) else { return };
        let largest = rows.largest();
        for (c, sum) in sum.iter_mut().enumerate() {
            *sum += (after[c] - before[c]).abs() * largest * tile.row_top(c) * 1.0001;
        }
    };
    for apart in new.apart() {
        let before = old.iter().find(|o| o.patch == apart.patch).map_or([0.0; 3], |o| o.light);
        add(apart.patch, before, apart.light);
    }
    for gone in old.iter().filter(|o| new.apart().all(|a| a.patch != o.patch)) {
        add(gone.patch, gone.light, [0.0; 3]);
    }
    sum
}

/// A bound on the error of the rows of patches apart, plain and weighted.
fn rows_error((field, index, tile): (&Field<'_>, usize, &Tile<'_>), weights: &FixedWeights) -> [f32; 3] {
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
