//! What the factors leave out, patch by patch: the way back for light that no prior expects.
//!
//! One patch far brighter than its neighbours (haze around the sun, a lamp) shows the factors' error of that patch
//! alone. Its residual, read only while the patch is bright, takes that error away.

use super::CompressedTile;

/// Residuals of a tile: `response[x][c][i] - tile[x][c][i] ~ codes[i][c][x] * scale[i][c]`.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchResiduals {
    /// `[patch][3][pixel]`, -127..=127.
    pub codes: Vec<i8>,
    /// `[patch]`, per channel.
    pub scale: Vec<[f32; 3]>,
}

/// The residuals of `tile` against the response `[pixel][3][patch]` that it was made from.
pub fn patch_residuals(response: &[f32], patches: usize, tile: &CompressedTile) -> PatchResiduals {
    let mut columns = vec![0.0f32; patches * 3 * tile.pixels];
    for (index, row) in response.chunks_exact(patches.max(1)).enumerate().take(tile.pixels * 3) {
        let (pixel, channel) = (index / 3, index % 3);
        let mut shown = tile.row(pixel, channel);
        shown.resize(patches, 0.0);
        for (patch, (r, s)) in row.iter().zip(shown).enumerate() {
            columns[(patch * 3 + channel) * tile.pixels + pixel] = r - s;
        }
    }
    let mut residuals = PatchResiduals { codes: vec![0; columns.len()], scale: vec![[0.0; 3]; patches] };
    let pairs = columns.chunks_exact(tile.pixels.max(1)).zip(residuals.codes.chunks_exact_mut(tile.pixels.max(1)));
    for (index, (column, codes)) in pairs.enumerate() {
        let step = column.iter().fold(0.0f32, |top, r| top.max(r.abs())) / 127.0;
        if step > 0.0 && step.is_finite() {
            residuals.scale[index / 3][index % 3] = step;
            codes.iter_mut().zip(column).for_each(|(code, r)| *code = (r / step).round() as i8);
        }
    }
    residuals
}
