//! Residuals: what the low-rank form leaves out of single patches, read only while such a patch outshines the sky.
//!
//! ```text
//! RSDT  u32 per tile: place of the tile's block in RSDL, in units of 16 bytes; FFFFFFFF: the tile has none
//! RSDL  per tile: 16 bytes per patch, then the codes
//!    0 u32 place of the patch's codes from the start of the block, in units of 16 bytes; 0: nothing worth keeping
//!    4 f32[3] scale, R G B
//!   codes i8 [3][padded pixels]
//!
//! response[x][c][i] - low-rank form = codes[i][c][x] * scale[i][c]
//! ```

use crate::field::FieldError;
use crate::header::{f32_at, u32_at, vec3_at};
use crate::tile::{PLACE_UNIT, Tile, TileSet};

/// Length of a patch's entry, bytes.
pub const RESIDUAL_ENTRY: usize = 16;
/// The place of a tile without residuals.
pub const NO_RESIDUAL: u32 = u32::MAX;

/// Checked residual layers.
#[derive(Clone, Copy, Debug)]
pub struct Residuals<'a> {
    places: &'a [u8],
    blocks: &'a [u8],
    patches: usize,
}

/// A patch's residual in one tile.
#[derive(Clone, Copy, Debug)]
pub struct PatchResidual<'a> {
    /// Codes `[3][padded pixels]`, i8 as bytes.
    pub codes: &'a [u8],
    /// Scale, R G B.
    pub scale: [f32; 3],
}

impl<'a> Residuals<'a> {
    /// A field without residuals.
    pub(crate) const NONE: Residuals<'static> = Residuals { places: &[], blocks: &[], patches: 0 };

    pub(crate) fn check(places: &'a [u8], blocks: &'a [u8], response: &TileSet<'_>) -> Result<Self, FieldError> {
        let bad = FieldError::Invalid("residuals");
        let residuals = Residuals { places, blocks, patches: response.patches() };
        if places.len() != 4 * response.tiles() {
            return Err(bad);
        }
        for tile in 0..response.tiles() {
            let Some(at) = residuals.block(tile) else { continue };
            let table = blocks.get(at..at + residuals.patches * RESIDUAL_ENTRY).ok_or(bad)?;
            let codes = 3 * response.tile(tile).padded_pixels();
            for entry in table.chunks_exact(RESIDUAL_ENTRY) {
                let place = u32_at(entry, 0) as usize * PLACE_UNIT;
                let fits = place == 0 || at + place + codes <= blocks.len();
                let finite = (4..16).step_by(4).all(|at| f32_at(entry, at).is_finite());
                if !(fits && finite) {
                    return Err(bad);
                }
            }
        }
        Ok(residuals)
    }

    fn block(&self, tile: usize) -> Option<usize> {
        let place = u32_at(self.places.get(4 * tile..4 * tile + 4)?, 0);
        (place != NO_RESIDUAL).then_some(place as usize * PLACE_UNIT)
    }

    /// The residual of `patch` in tile number `index`, if the file keeps one.
    pub fn get(&self, index: usize, tile: &Tile<'_>, patch: usize) -> Option<PatchResidual<'a>> {
        let at = self.block(index).filter(|_| patch < self.patches)?;
        let entry = &self.blocks[at + patch * RESIDUAL_ENTRY..][..RESIDUAL_ENTRY];
        let place = u32_at(entry, 0) as usize * PLACE_UNIT;
        let codes = &self.blocks[at + place..][..3 * tile.padded_pixels()];
        (place != 0).then_some(PatchResidual { codes, scale: vec3_at(entry, 4) })
    }

    /// Bytes of all residuals.
    pub fn bytes(&self) -> usize {
        self.places.len() + self.blocks.len()
    }
}

impl PatchResidual<'_> {
    /// Adds the residual of a patch of this radiance times exposure to linear values, `[channel][padded pixel]`.
    pub fn add(&self, light: [f32; 3], linear: [&mut [f32]; 3]) {
        for (c, plane) in linear.into_iter().enumerate() {
            let factor = light[c] * self.scale[c];
            for (&code, value) in self.codes[c * plane.len()..].iter().zip(plane) {
                *value += f32::from(code as i8) * factor;
            }
        }
    }
}
