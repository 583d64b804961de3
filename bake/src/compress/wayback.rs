//! The way back: every patch's rows once more, each on its own (firmware/src/wayback.rs).
//!
//! Light that no prior expects (one patch far brighter than its neighbours, a lamp) shows the factors' error of its
//! patch. Such a patch is taken out of the factors' weights and its own rows are added instead.

use super::Compressed;
use relume_firmware::bound::DARK_POWER;
use relume_firmware::wayback::{CODE_TOP, MAX_UNIT_EXPONENT};

/// Code that stands for a patch's share of light when all patches are alike, times [`FAIR_TIMES`].
const FAIR_CODE: f32 = 100.0;
const FAIR_TIMES: f32 = 4.0;

/// One patch's rows in one tile: `response / row scale ~ unit * 2^exponent * code^2`.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchRows {
    /// `[pixel]` of green, red, blue, 0..=127.
    pub codes: [Vec<u8>; 3],
    /// Doublings of the unit.
    pub exponent: u8,
    /// Largest error of any pixel and channel, in units, over what a row scale of 65535 means and over
    /// (row scale / 65535)^0.583.
    pub error_units: f32,
}

/// All patches of one tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileRows {
    /// Response per row scale that code 1 stands for.
    pub unit: f32,
    /// `[patch]`.
    pub patches: Vec<PatchRows>,
}

/// The rows of a tile: pixels from `first` of `response` (`[pixel][3][patch]`), which `block` was made from. `row_top`
/// is what a row scale of 65535 means, per channel.
pub fn tile_rows(
    response: &[f32],
    patches: usize,
    block: &Compressed,
    pixels: std::ops::Range<usize>,
    row_top: [f32; 3],
) -> TileRows {
    let scale = |pixel: usize, c: usize| block.row_scale[pixel][c];
    let row = |pixel: usize, c: usize| &response[(pixel * 3 + c) * patches..][..patches];
    let (mut sum, mut lit) = (0.0f64, 0usize);
    let channels = || pixels.clone().flat_map(|pixel| [0, 1, 2].map(|c| (pixel, c)));
    for (pixel, c) in channels().filter(|&(pixel, c)| scale(pixel, c) > 0.0) {
        sum += f64::from(row(pixel, c).iter().sum::<f32>() / scale(pixel, c));
        lit += 1;
    }
    let fair = (sum / (lit.max(1) * patches.max(1)) as f64) as f32;
    let unit = if fair > 0.0 && fair.is_finite() {
        fair * FAIR_TIMES / (FAIR_CODE * FAIR_CODE)
    } else {
        // All codes are 0: the unit only measures what is left out.
        let left_out =
            |(pixel, c): (usize, usize)| row(pixel, c).iter().fold(0.0f32, |top, r| top.max(r.abs())) / row_top[c];
        Some(channels().map(left_out).fold(0.0, f32::max)).filter(|&unit| unit > 0.0 && unit.is_finite()).unwrap_or(1.0)
    };
    let of_patch = |patch: usize| {
        let share = |pixel: usize, c: usize| {
            let scale = scale(pixel, c);
            if scale > 0.0 { (row(pixel, c)[patch] / (scale * unit)).max(0.0) } else { f32::NAN }
        };
        let wanted = [1, 0, 2].map(|c| pixels.clone().map(|pixel| share(pixel, c)).collect::<Vec<f32>>());
        let top = wanted.iter().flatten().fold(0.0f32, |top, v| top.max(*v));
        let doublings = (top / (CODE_TOP * CODE_TOP)).log2().ceil().clamp(0.0, f32::from(MAX_UNIT_EXPONENT));
        let exponent = doublings as u8;
        let step = 2f32.powi(i32::from(exponent));
        // Not a number: the channel is black in this pixel, and its code says nothing.
        let code = |share: &f32| if share.is_nan() { 0 } else { (share / step).sqrt().round().min(CODE_TOP) as u8 };
        let green: Vec<u8> = wanted[0].iter().map(code).collect();
        // A channel that is black whatever its code takes green's.
        let like_green = |of: &[f32]| -> Vec<u8> {
            of.iter().zip(&green).map(|(share, &green)| if share.is_nan() { green } else { code(share) }).collect()
        };
        let codes = [green.clone(), like_green(&wanted[1]), like_green(&wanted[2])];
        let mut error = 0.0f32;
        for (codes, c) in codes.iter().zip([1, 0, 2]) {
            for (pixel, &code) in pixels.clone().zip(codes) {
                let shown = scale(pixel, c) * unit * step * f32::from(code) * f32::from(code);
                // Over the power of the row scale that the weighted bound is relative to, which also covers the plain one.
                let dark = (scale(pixel, c) / row_top[c]).max(1.0 / 65535.0).powf(DARK_POWER);
                error = error.max((row(pixel, c)[patch] - shown).abs() / (row_top[c] * unit * dark));
            }
        }
        PatchRows { codes, exponent, error_units: error * 1.0001 }
    };
    TileRows { unit, patches: (0..patches).map(of_patch).collect() }
}
