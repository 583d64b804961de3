//! The way back: every patch's rows once more, each on its own (firmware/src/wayback.rs).
//!
//! Light that no prior expects (one patch far brighter than its neighbours, a lamp) shows the factors' error of its
//! patch. Such a patch is taken out of the factors' weights and its own rows are added instead. A patch's unit is such that
//! [`WHITE_CODE`] stands for display white in its own picture, at the exposure that shows the patch alone: where the small
//! picture that tells this white is right, the patch alone is bound to 3.4 codes, rounding included. It cannot tell the white
//! of a patch that about one pixel in a hundred sees: there the unit is the finest that holds the tile's brightest pixel.

use super::Compressed;
use relume_firmware::bound::DARK_POWER;
use relume_firmware::wayback::{CODE_TOP, way_unit};
use std::ops::Range;

/// Code of display white under the patch alone, in the tile's brightest row.
const WHITE_CODE: f64 = 66.0;
/// Display white over the 99th percentile of what a light shows (the design's exposure).
const WHITE_TIMES_PERCENTILE: f32 = 1.25;
const PERCENTILE: f64 = 0.99;
/// A white that asks for a finer unit than any code can hold.
const FINEST: f32 = f32::MIN_POSITIVE;

/// The response that display white is under each patch alone, `[patch]`; 0 where it lights nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Whites(Vec<f32>);

impl Whites {
    /// From responses `[pixel][3][patch]` spread over the picture. Where these may be too few to tell, the darker white that
    /// two standard deviations leave possible is taken; of a patch that about one pixel in a hundred sees that is none at
    /// all, and its rows get the finest unit that holds them.
    pub fn of(response: &[f32], patches: usize) -> Self {
        let pixels = (response.len() / (3 * patches.max(1))).max(1) as f64;
        let doubt = 2.0 * (PERCENTILE * (1.0 - PERCENTILE) / pixels).sqrt();
        let white = |patch: usize| {
            let mut values: Vec<f32> = response.iter().skip(patch).step_by(patches.max(1)).copied().collect();
            values.sort_unstable_by(f32::total_cmp);
            let Some(last) = values.len().checked_sub(1) else { return 0.0 };
            let level = |share: f64| values[(share.clamp(0.0, 1.0) * last as f64) as usize];
            let (darkest, brightest) = (level(PERCENTILE - doubt), level(PERCENTILE + doubt));
            match (darkest > 0.0, brightest > 0.0) {
                (true, _) => darkest * WHITE_TIMES_PERCENTILE,
                (false, true) => FINEST,
                // What fewer see than the percentile counts has no exposure of its own: the brightest pixel is its white.
                (false, false) => values[last].max(0.0),
            }
        };
        Whites((0..patches).map(white).collect())
    }
}

/// One patch's rows in one tile: `response / row scale ~ way_unit(quarters) * code^2`.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchRows {
    /// `[pixel]` of green, red, blue.
    pub codes: [Vec<u16>; 3],
    /// Of the unit.
    pub quarters: u8,
    /// What is beyond half a step of the root in any pixel and channel, in units over what a row scale of 65535 means and
    /// over (row scale / 65535)^0.583.
    pub rest_units: f32,
}

/// The rows of a tile, `[patch]`: the pixels `pixels` of `response` (`[pixel][3][patch]`), which `block` was made from.
/// `row_top` is what a row scale of 65535 means, per channel.
pub fn tile_rows(
    response: &[f32],
    whites: &Whites,
    block: &Compressed,
    pixels: Range<usize>,
    row_top: [f32; 3],
) -> Vec<PatchRows> {
    let lit = |c: usize| pixels.clone().any(|pixel| block.row_scale[pixel][c] > 0.0);
    let brightest = (0..3).filter(|&c| lit(c)).map(|c| row_top[c]).fold(0.0f32, f32::max);
    let unit_of = |white: f32| f64::from(white) / f64::from(brightest) / (WHITE_CODE * WHITE_CODE);
    let patches = whites.0.len();
    let of_patch = |(patch, &white): (usize, &f32)| {
        let own = PatchResponse { response: &response[patch..], patches, block, pixels: pixels.clone(), row_top };
        own.rows(unit_of(white))
    };
    whites.0.iter().enumerate().map(of_patch).collect()
}

/// One patch's response in one tile.
struct PatchResponse<'a> {
    /// `[pixel of the block][3]`, `patches` apart.
    response: &'a [f32],
    patches: usize,
    block: &'a Compressed,
    pixels: Range<usize>,
    row_top: [f32; 3],
}

impl PatchResponse<'_> {
    fn value(&self, pixel: usize, c: usize) -> f64 {
        f64::from(self.response[(pixel * 3 + c) * self.patches])
    }

    fn scale(&self, pixel: usize, c: usize) -> f64 {
        f64::from(self.block.row_scale[pixel][c])
    }

    /// What errors count by: over the power of the row scale that the weighted bound is relative to, which also covers the
    /// plain one.
    fn dark(&self, pixel: usize, c: usize) -> f64 {
        let top = f64::from(self.row_top[c]);
        top * (self.scale(pixel, c) / top).max(1.0 / 65535.0).powf(DARK_POWER.into())
    }

    /// Response over row scale.
    fn share(&self, pixel: usize, c: usize) -> f64 {
        let scale = self.scale(pixel, c);
        if scale > 0.0 { self.value(pixel, c) / scale } else { self.value(pixel, c).abs() / self.dark(pixel, c) }
    }

    /// `None`: the channel is black there whatever its code.
    fn code(&self, pixel: usize, c: usize, unit: f64) -> Option<u16> {
        let root = (self.share(pixel, c).max(0.0) / unit).sqrt();
        (self.scale(pixel, c) > 0.0).then(|| root.round().min(f64::from(CODE_TOP)) as u16)
    }

    fn rows(&self, wanted_unit: f64) -> PatchRows {
        let pixels = || self.pixels.clone();
        let top = pixels().flat_map(|pixel| [0, 1, 2].map(|c| self.share(pixel, c))).fold(0.0, f64::max);
        let quarters = quarters_of(wanted_unit, top);
        let unit = f64::from(way_unit(quarters));
        let green: Vec<u16> = pixels().map(|pixel| self.code(pixel, 1, unit).unwrap_or(0)).collect();
        // A channel that is black whatever its code takes green's.
        let like_green =
            |c: usize| pixels().zip(&green).map(|(pixel, green)| self.code(pixel, c, unit).unwrap_or(*green)).collect();
        let codes = [green.clone(), like_green(0), like_green(2)];
        let mut rest = 0.0f64;
        for (codes, c) in codes.iter().zip([1, 0, 2]) {
            for (pixel, &code) in pixels().zip(codes) {
                let off = beyond(self.value(pixel, c), self.scale(pixel, c) * unit, f64::from(code));
                rest = rest.max(off / (self.dark(pixel, c) * unit));
            }
        }
        PatchRows { codes, quarters, rest_units: (rest * 1.0001) as f32 }
    }
}

/// The largest unit not above `wanted` whose codes reach `top`.
fn quarters_of(wanted: f64, top: f64) -> u8 {
    let wanted = if wanted > 0.0 && wanted.is_finite() { wanted } else { top / (WHITE_CODE * WHITE_CODE) };
    let largest = f64::from(CODE_TOP) - 1.0;
    let quarters = |unit: f64| -4.0 * unit.log2();
    // Both are limits: of a unit of no light at all nothing is left but the smallest.
    let (fine, coarse) = (quarters(wanted).ceil(), quarters(top / (largest * largest)).floor());
    fine.min(coarse).clamp(0.0, 255.0) as u8
}

/// How far `value` is from all that is within half a step of the root from `code`.
fn beyond(value: f64, step: f64, code: f64) -> f64 {
    let (low, high) = ((code - 0.5).max(0.0).powi(2) * step, (code + 0.5).powi(2) * step);
    let off = (low - value).max(value - high).max(0.0);
    // A root that lies right between two codes.
    if off <= 1e-9 * high { 0.0 } else { off }
}
