//! Compressed blocks and tiles as the bytes of the field's layers (firmware/src/field.rs).

use crate::compress::{BlockBound, Compressed, PatchRows};
use relume_firmware::bound::GROUP;
use relume_firmware::tile::{ALL_WHOLE, LANE_PAD, MAX_RANK, TILE_PX, TileRecord, padded};
use relume_firmware::wayback::{REST, STRIP, WAY_ENTRY};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The bytes of one tile of a tile set; places in `record` are still open.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TileBytes {
    /// Mask, counts and exponents.
    #[serde(with = "record_bytes")]
    pub record: TileRecord,
    /// `rank/2` planes of padded pixel pairs.
    pub u: Vec<u8>,
    /// The block's `[3][v_rank][padded patches]`, then scales u16 `[3][v_rank]`.
    pub v: Vec<u8>,
    /// u16 `[3][padded pixels]`.
    pub rows: Vec<u8>,
}

/// A record as the bytes that it has in the field.
mod record_bytes {
    use relume_firmware::tile::{TILE_RECORD, TileRecord};
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    pub(super) fn serialize<S: Serializer>(record: &TileRecord, to: S) -> Result<S::Ok, S::Error> {
        record.encode().as_slice().serialize(to)
    }

    pub(super) fn deserialize<'d, D: Deserializer<'d>>(from: D) -> Result<TileRecord, D::Error> {
        let bytes = Vec::<u8>::deserialize(from)?;
        let bytes: [u8; TILE_RECORD] = bytes.try_into().map_err(|_| D::Error::custom("no tile record"))?;
        Ok(TileRecord::decode(&bytes))
    }
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
    /// Encodes the pixels `tile` of a block, which are those of `mask`, for `patches` patches.
    pub fn new(block: &Compressed, tile: Range<usize>, mask: [u8; 32], patches: usize) -> Self {
        let rank = block.ranks.get(tile.start).map_or(0, |&rank| rank.min(MAX_RANK));
        let (pixels, n) = (tile.len(), padded(tile.len()));
        let mut u = vec![0u8; rank * n];
        for (x, pixel) in tile.clone().enumerate() {
            for k in 0..rank {
                u[(k / 2 * n + x) * 2 + k % 2] = block.u[pixel * block.rank + k] as u8;
            }
        }
        let mut rows = vec![0u8; 6 * n];
        let mut row_exponent = [0; 3];
        // A black channel goes by the others, so that bounds that count in its units stay near.
        let lit = |c: usize| block.row_scale[tile.clone()].iter().any(|scale| scale[c] > 0.0);
        for c in 0..3 {
            let (exponent, codes) = block_scale(block.row_scale[tile.clone()].iter().map(|scale| scale[c]));
            row_exponent[c] = exponent;
            for (x, code) in codes.iter().enumerate() {
                rows[2 * (c * n + x)..][..2].copy_from_slice(&code.to_le_bytes());
            }
        }
        if let Some(most) = (0..3).filter(|&c| lit(c)).map(|c| row_exponent[c]).max() {
            (0..3).filter(|&c| !lit(c)).for_each(|c| row_exponent[c] = most);
        }
        let (v, v_exponent) = v_bytes(block, patches);
        let record = TileRecord {
            mask,
            u_place: 0,
            v_place: 0,
            rows_place: 0,
            coverage_place: ALL_WHOLE,
            pixels: pixels as u16,
            rank: rank as u16,
            v_rank: block.rank as u16,
            row_exponent,
            v_exponent,
        };
        TileBytes { record, u, v, rows }
    }

    /// What a row scale of 65535 means, per channel.
    pub fn row_top(&self) -> [f32; 3] {
        self.record.row_exponent.map(|exponent| 65535.0 * 2f32.powi(i32::from(exponent)))
    }
}

/// `V` and its scales, and their exponents.
fn v_bytes(block: &Compressed, patches: usize) -> (Vec<u8>, [i8; 3]) {
    let (rank, stride) = (block.rank, padded(patches));
    let mut v = vec![0u8; 3 * rank * stride];
    let mut scales = Vec::with_capacity(6 * rank);
    let mut v_exponent = [0; 3];
    for c in 0..3 {
        for k in 0..rank {
            let from = &block.v[c][k * patches..(k + 1) * patches];
            let to = &mut v[(c * rank + k) * stride..][..patches];
            to.iter_mut().zip(from).for_each(|(to, &from)| *to = from as u8);
        }
        let (exponent, codes) = block_scale(block.v_scale[c].iter().copied());
        v_exponent[c] = exponent;
        scales.extend(codes.iter().flat_map(|code| code.to_le_bytes()));
    }
    v.append(&mut scales);
    (v, v_exponent)
}

/// A tile's block of WAYD (firmware/src/wayback.rs).
pub fn way_block(patches: &[PatchRows], pixels: usize) -> Vec<u8> {
    let mut block = vec![0u8; (patches.len() * WAY_ENTRY).next_multiple_of(LANE_PAD)];
    for (patch, rows) in patches.iter().enumerate() {
        let place = block.len() as u32;
        let top = rows.codes.iter().flatten().copied().max().unwrap_or(0);
        let entry = &mut block[patch * WAY_ENTRY..][..WAY_ENTRY];
        entry[..4].copy_from_slice(&place.to_le_bytes());
        (entry[4], entry[5]) = (rows.quarters, REST.code(rows.rest_units));
        entry[6..].copy_from_slice(&top.to_le_bytes());
        for first in (0..pixels).step_by(STRIP) {
            let strip = first..pixels.min(first + STRIP);
            push_strip(&mut block, rows.codes.each_ref().map(|codes| &codes[strip.clone()]));
        }
    }
    block
}

/// One strip of green, red and blue codes.
fn push_strip(block: &mut Vec<u8>, [green, red, blue]: [&[u16]; 3]) {
    let over_green = |of: &[u16]| of.iter().zip(green).map(|(&a, &g)| i32::from(a) - i32::from(g)).collect();
    let parts: [Vec<i32>; 3] = [green.iter().map(|&g| i32::from(g)).collect(), over_green(red), over_green(blue)];
    let lowest = parts.each_ref().map(|part| part.iter().copied().min().unwrap_or(0));
    let fits =
        |shift: i32| lowest[0] >> shift <= 255 && lowest[1..].iter().all(|low| (-128..128).contains(&(low >> shift)));
    let shift = (0..15).find(|&shift| fits(shift)).unwrap_or(15);
    let bases = lowest.map(|low| low >> shift);
    let mut bits = [0u8; 3];
    for ((part, base), bits) in parts.iter().zip(bases).zip(&mut bits) {
        let top = part.iter().map(|code| (code - (base << shift)) as u32).max().unwrap_or(0);
        *bits = (32 - top.leading_zeros()) as u8;
    }
    block.extend([bits[0] | bits[1] << 4, bits[2] | (shift as u8) << 4]);
    block.extend(bases.map(|base| base as u8));
    let plane_bytes = padded(green.len()) / 8;
    for ((part, base), bits) in parts.iter().zip(bases).zip(bits) {
        for bit in 0..bits {
            let from = block.len();
            block.resize(from + plane_bytes, 0);
            for (x, code) in part.iter().enumerate() {
                block[from + x / 8] |= (((code - (base << shift)) >> bit & 1) as u8) << (x % 8);
            }
        }
    }
}

/// A block's record of BNDT (firmware/src/bound.rs).
pub fn bound_record(bound: &BlockBound, modes: usize, patches: usize) -> Vec<u8> {
    let dims = padded(modes + patches.div_ceil(GROUP));
    let scalars = bound.scale.iter().chain(&bound.reach).flatten();
    let mut record: Vec<u8> = scalars.flat_map(|value| value.to_le_bytes()).collect();
    for codes in bound.codes.iter().flatten() {
        let from = record.len();
        record.extend_from_slice(codes);
        record.resize(from + dims, 0);
    }
    record
}

/// The scales that the field's 16 bits hold instead of these.
pub(crate) fn decoded_scales(scales: &[f32]) -> Vec<f32> {
    let (exponent, codes) = block_scale(scales.iter().copied());
    codes.iter().map(|&code| f32::from(code) * 2f32.powi(i32::from(exponent))).collect()
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
    use relume_firmware::wayback::CODE_TOP;

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

    /// Neighbours whose channels are as far apart as codes can be, either way round, come back as they were.
    #[test]
    fn rows_of_opposite_colours_fit_their_strips() {
        let top = CODE_TOP;
        let codes =
            |first: u16, second: u16| (0..16).map(|x| [first, second, x][usize::from(x).min(2)]).collect::<Vec<_>>();
        let patch = PatchRows { codes: [codes(0, top), codes(top, 0), codes(top, 1)], quarters: 0, rest_units: 0.0 };
        let mut strip = Vec::new();
        push_strip(&mut strip, patch.codes.each_ref().map(Vec::as_slice));
        let (green, red, blue) = (strip[0] & 15, strip[0] >> 4, strip[1] & 15);
        assert_eq!(strip.len(), 5 + 2 * usize::from(green + red + blue));
        let (shift, mut at) = (strip[1] >> 4, 5);
        let mut part = |planes: u8, base: i32| -> Vec<i32> {
            let bit = |x: usize, k: u8| i32::from(strip[at + 2 * usize::from(k) + x / 8] >> (x % 8) & 1) << k;
            let bits = |x: usize| (0..planes).map(|k| bit(x, k)).sum::<i32>();
            let part = (0..16).map(|x| (base << shift) + bits(x)).collect();
            at += 2 * usize::from(planes);
            part
        };
        let over =
            [part(green, strip[2].into()), part(red, (strip[3] as i8).into()), part(blue, (strip[4] as i8).into())];
        for x in 0..16 {
            let read = [over[0][x], over[0][x] + over[1][x], over[0][x] + over[2][x]];
            assert_eq!(read, patch.codes.each_ref().map(|codes| i32::from(codes[x])), "{x}");
        }
    }

    #[test]
    fn masks_number_pixels_by_16_whatever_the_tile_width() {
        let mask = mask_of(&[0, 5, 11], 5);
        let set: Vec<usize> = relume_firmware::tile::covered_pixels(mask).collect();
        assert_eq!(set, [0, 16, 33]);
    }
}
