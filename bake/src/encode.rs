//! A compressed tile as the bytes of the field's layers (firmware/src/field.rs).

use crate::compress::{CompressedTile, PatchResiduals};
use relume_firmware::residual::RESIDUAL_ENTRY;
use relume_firmware::tile::{ALL_WHOLE, MAX_RANK, PLACE_UNIT, TILE_PX, TileRecord, padded};

/// The bytes of one tile of a tile set; places in `record` are still open.
#[derive(Clone, Debug)]
pub struct TileBytes {
    /// Mask, counts and exponents.
    pub record: TileRecord,
    /// `rank/2` planes of padded pixel pairs.
    pub u: Vec<u8>,
    /// `[3][rank][padded patches]`, then scales u16 `[3][rank]`.
    pub v: Vec<u8>,
    /// u16 `[3][padded pixels]`.
    pub rows: Vec<u8>,
}

/// The mask of a tile: `covered` holds indices `y * width + x` of a tile `width` pixels wide.
pub fn mask_of(covered: &[u16], width: u32) -> [u8; 32] {
    let mut mask = [0; 32];
    for &index in covered {
        let (x, y) = (usize::from(index) % width as usize, usize::from(index) / width as usize);
        let bit = y * TILE_PX + x;
        mask[bit / 8] |= 1 << (bit % 8);
    }
    mask
}

impl TileBytes {
    /// Encodes a tile whose covered pixels are those of `mask`, for `patches` patches.
    pub fn new(tile: &CompressedTile, mask: [u8; 32], patches: usize) -> Self {
        let rank = tile.rank.min(MAX_RANK);
        let (n, stride) = (padded(tile.pixels), padded(patches));
        let mut u = vec![0u8; rank * n];
        for x in 0..tile.pixels {
            for k in 0..rank {
                u[(k / 2 * n + x) * 2 + k % 2] = tile.u[x * tile.rank + k] as u8;
            }
        }
        let mut v = vec![0u8; 3 * rank * stride];
        let mut scales = Vec::with_capacity(6 * rank);
        let mut rows = vec![0u8; 6 * n];
        let (mut v_exponent, mut row_exponent) = ([0; 3], [0; 3]);
        for c in 0..3 {
            for k in 0..rank {
                let from = &tile.v[c][k * patches..(k + 1) * patches];
                let to = &mut v[(c * rank + k) * stride..][..patches];
                to.iter_mut().zip(from).for_each(|(to, &from)| *to = from as u8);
            }
            let (exponent, codes) = block_scale(tile.v_scale[c].iter().take(rank).copied());
            v_exponent[c] = exponent;
            scales.extend(codes.iter().flat_map(|code| code.to_le_bytes()));
            let (exponent, codes) = block_scale(tile.row_scale.iter().map(|scale| scale[c]));
            row_exponent[c] = exponent;
            for (x, code) in codes.iter().enumerate() {
                rows[2 * (c * n + x)..][..2].copy_from_slice(&code.to_le_bytes());
            }
        }
        v.append(&mut scales);
        let record = TileRecord {
            mask,
            u_place: 0,
            v_place: 0,
            rows_place: 0,
            coverage_place: ALL_WHOLE,
            pixels: tile.pixels as u16,
            rank: rank as u16,
            row_exponent,
            v_exponent,
        };
        TileBytes { record, u, v, rows }
    }
}

/// A residual that never exceeds this response is not kept: a patch of 30 times the sky's mean radiance would show it
/// as less than a third of a code in white paint (30 * 1e-4 / 3 of white paint's response to the whole sky).
const RESIDUAL_FLOOR: f32 = 3e-5;

/// A tile's block of RSDL (firmware/src/residual.rs); empty when no patch leaves anything worth keeping.
pub fn residual_block(residuals: &PatchResiduals, pixels: usize) -> Vec<u8> {
    let patches = residuals.scale.len();
    let n = padded(pixels);
    let mut block = vec![0u8; patches * RESIDUAL_ENTRY];
    for (patch, scale) in residuals.scale.iter().enumerate() {
        if scale.iter().all(|s| 127.0 * s < RESIDUAL_FLOOR) {
            continue;
        }
        let place = (block.len() / PLACE_UNIT) as u32;
        let entry = &mut block[patch * RESIDUAL_ENTRY..][..RESIDUAL_ENTRY];
        entry[..4].copy_from_slice(&place.to_le_bytes());
        for (c, s) in scale.iter().enumerate() {
            entry[4 + 4 * c..8 + 4 * c].copy_from_slice(&s.to_le_bytes());
        }
        for codes in residuals.codes[patch * 3 * pixels..][..3 * pixels].chunks_exact(pixels) {
            block.extend(codes.iter().map(|&code| code as u8));
            block.resize(block.len() + n - pixels, 0);
        }
    }
    if block.len() == patches * RESIDUAL_ENTRY { Vec::new() } else { block }
}

/// Scales that are not negative as u16 with one power of two, so that the largest uses all 16 bits.
fn block_scale(scales: impl Iterator<Item = f32> + Clone) -> (i8, Vec<u16>) {
    let largest = scales.clone().fold(0.0f32, f32::max);
    if largest <= 0.0 {
        return (0, scales.map(|_| 0).collect());
    }
    let range = relume_firmware::tile::EXPONENT_RANGE;
    let exponent = (f64::from(largest) / 65535.0).log2().ceil() as i32;
    let exponent = exponent.clamp(i32::from(*range.start()), i32::from(*range.end()));
    let unit = 2f64.powi(exponent);
    let codes = scales.map(|scale| (f64::from(scale) / unit).round().min(65535.0) as u16).collect();
    (exponent as i8, codes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_scales_keep_16_bits_of_the_largest() {
        let scales = [0.37f32, 1e-4, 0.0, 0.2];
        let (exponent, codes) = block_scale(scales.iter().copied());
        assert!(codes[0] >= 32767 && codes[2] == 0);
        for (scale, code) in scales.iter().zip(&codes) {
            let unit = 2f64.powi(i32::from(exponent));
            assert!((f64::from(*scale) - f64::from(*code) * unit).abs() <= 0.5 * unit);
        }
        assert_eq!(block_scale([0.0, 0.0].into_iter()), (0, vec![0, 0]));
    }

    #[test]
    fn masks_number_pixels_by_16_whatever_the_tile_width() {
        let mask = mask_of(&[0, 5, 11], 5);
        let set: Vec<usize> = relume_firmware::tile::covered_pixels(mask).collect();
        assert_eq!(set, [0, 16, 33]);
    }
}
