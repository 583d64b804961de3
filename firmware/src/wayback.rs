//! The way back: the rows of single patches, read only where the factors of a tile are not good enough for the light.
//!
//! ```text
//! WAYT  u32 per tile: place of the tile's block in WAYD, in units of 16 bytes; FFFFFFFF: the tile has none
//! WAYD  per tile: f32 unit, 12 bytes reserved (0); 8 bytes per patch, together a multiple of 16; bit planes
//!    0 u16 bit planes of the patches before this one
//!    2 u8 bits of green | bits of red << 4           3 u8 bits of blue | exponent << 4
//!    4 u8 base of green, 0..127    5 i8 base of red - green    6 i8 base of blue - green
//!    7 u8 error, a minifloat from 2^-8 (minifloat.rs)
//!   plane  n' / 8 bytes: bit x % 8 of byte x / 8 belongs to pixel x; green's planes, red's, blue's, lowest bit first
//!
//! green = base + bits; red = green + base + bits; blue = green + base + bits       (0..127)
//! response[x][c][i] = rows[c][x] 2^re[c] * unit * 2^exponent * code[c][x]^2
//! error: |response - true| <= value(error) * unit * 65535 * 2^re[c] * (rows[c][x] / 65535)^0.583
//! ```
//!
//! The square spends its steps where the display's curve does. A patch that takes the way back is left out of the
//! weights that the factors see.

use crate::field::FieldError;
use crate::header::{f32_at, u16_at, u32_at};
use crate::minifloat::Minifloat;
use crate::tile::{PLACE_UNIT, TILE_PIXELS, Tile, TileSet};

/// Largest code.
pub const CODE_TOP: f32 = 127.0;
/// Most doublings of the unit.
pub const MAX_UNIT_EXPONENT: u8 = 15;
/// Bytes before the entries.
pub const WAY_HEADER: usize = 16;
/// Length of a patch's entry, bytes.
pub const WAY_ENTRY: usize = 8;
/// The place of a tile without rows.
pub const NO_WAY: u32 = u32::MAX;

/// The codes of errors, in units.
pub const ERROR: Minifloat = Minifloat::from(-8);

/// Checked way-back layers.
#[derive(Clone, Copy, Debug)]
pub struct WayBack<'a> {
    places: &'a [u8],
    blocks: &'a [u8],
    patches: usize,
}

/// One patch's rows in one tile.
#[derive(Clone, Copy, Debug)]
pub struct PatchRows<'a> {
    entry: &'a [u8],
    planes: &'a [u8],
    plane_bytes: usize,
    unit: f32,
}

/// Codes of one patch in one tile, `[red, green, blue][padded pixel]`.
#[derive(Clone, Debug)]
pub struct RowCodes(pub [[u8; TILE_PIXELS]; 3]);

impl Default for RowCodes {
    fn default() -> Self {
        RowCodes([[0; TILE_PIXELS]; 3])
    }
}

impl<'a> WayBack<'a> {
    /// A field without way back.
    pub(crate) const NONE: WayBack<'static> = WayBack { places: &[], blocks: &[], patches: 0 };

    pub(crate) fn check(places: &'a [u8], blocks: &'a [u8], response: &TileSet<'_>) -> Result<Self, FieldError> {
        let bad = FieldError::Invalid("way back");
        let way = WayBack { places, blocks, patches: response.patches() };
        if places.len() != 4 * response.tiles() {
            return Err(bad);
        }
        for tile in 0..response.tiles() {
            let Some(at) = way.block(tile) else { continue };
            let table = way.entries_end();
            let head = blocks.get(at..at + table).ok_or(bad)?;
            let unit = f32_at(head, 0);
            let plane_bytes = response.tile(tile).padded_pixels() / 8;
            let room = (blocks.len() - at - table).checked_div(plane_bytes).unwrap_or(0);
            let fits = (0..way.patches).all(|patch| {
                let entry = &head[WAY_HEADER + patch * WAY_ENTRY..];
                usize::from(u16_at(entry, 0)) + planes_of(entry).iter().sum::<usize>() <= room
                    && planes_of(entry).iter().all(|&bits| bits <= 8)
            });
            if !(fits && unit.is_finite() && unit >= 0.0) {
                return Err(bad);
            }
        }
        Ok(way)
    }

    fn entries_end(&self) -> usize {
        WAY_HEADER + (self.patches * WAY_ENTRY).next_multiple_of(PLACE_UNIT)
    }

    fn block(&self, tile: usize) -> Option<usize> {
        let place = u32_at(self.places.get(4 * tile..4 * tile + 4)?, 0);
        (place != NO_WAY).then_some(place as usize * PLACE_UNIT)
    }

    /// The rows of `patch` in tile number `index`, if the file has them.
    pub fn get(&self, index: usize, tile: &Tile<'_>, patch: usize) -> Option<PatchRows<'a>> {
        let at = self.block(index).filter(|_| patch < self.patches)?;
        let entry = &self.blocks[at + WAY_HEADER + patch * WAY_ENTRY..][..WAY_ENTRY];
        let plane_bytes = tile.padded_pixels() / 8;
        let planes: usize = planes_of(entry).iter().sum();
        let from = at + self.entries_end() + usize::from(u16_at(entry, 0)) * plane_bytes;
        let unit = f32_at(self.blocks, at);
        Some(PatchRows { entry, planes: &self.blocks[from..][..planes * plane_bytes], plane_bytes, unit })
    }

    /// Bytes of all rows.
    pub fn bytes(&self) -> usize {
        self.places.len() + self.blocks.len()
    }
}

/// Bit planes of green, red and blue.
fn planes_of(entry: &[u8]) -> [usize; 3] {
    [entry[2] & 15, entry[2] >> 4, entry[3] & 15].map(usize::from)
}

impl PatchRows<'_> {
    /// Bytes that it takes to read them.
    pub fn bytes(&self) -> usize {
        self.entry.len() + self.planes.len()
    }

    /// What `code^2 * row scale code * 2^re` is multiplied by.
    pub fn unit(&self) -> f32 {
        libm::scalbnf(self.unit, i32::from(self.entry[3] >> 4))
    }

    /// Largest response that the codes can stand for, over row scale.
    pub fn largest(&self) -> f32 {
        self.unit() * CODE_TOP * CODE_TOP
    }

    /// Largest error of any pixel, in response per row scale (times 65535 * 2^re: response).
    pub fn error(&self) -> f32 {
        ERROR.value(self.entry[7]) * self.unit
    }

    /// Unpacks the codes of all padded pixels.
    pub fn decode(&self, out: &mut RowCodes) {
        let n = self.plane_bytes * 8;
        let [green_bits, red_bits, blue_bits] = planes_of(self.entry);
        let (green_planes, rest) = self.planes.split_at(green_bits * self.plane_bytes);
        let (red_planes, blue_planes) = rest.split_at(red_bits * self.plane_bytes);
        let [red, green, blue] = &mut out.0;
        let (red, green, blue) = (&mut red[..n], &mut green[..n], &mut blue[..n]);
        green.fill(self.entry[4]);
        add_planes(green_planes, self.plane_bytes, green);
        for (of, base, planes, bits) in
            [(red, self.entry[5], red_planes, red_bits), (blue, self.entry[6], blue_planes, blue_bits)]
        {
            of.iter_mut().zip(green.iter()).for_each(|(code, green)| *code = green.wrapping_add(base));
            debug_assert_eq!(planes.len(), bits * self.plane_bytes);
            add_planes(planes, self.plane_bytes, of);
        }
    }
}

/// Adds `2^k` where bit plane `k` is set, 8 pixels at a time (wrapping: a damaged file stays harmless).
fn add_planes(planes: &[u8], plane_bytes: usize, codes: &mut [u8]) {
    const SPREAD: u64 = 0x0101_0101_0101_0101;
    const PICK: u64 = 0x8040_2010_0804_0201;
    for (k, plane) in planes.chunks_exact(plane_bytes.max(1)).enumerate() {
        for (bits, codes) in plane.iter().zip(codes.as_chunks_mut::<8>().0) {
            let picked = (u64::from(*bits) * SPREAD) & PICK;
            // One in every byte that has its bit: adding 7F carries into the top bit of each byte that is not 0.
            let ones = ((((picked & !(SPREAD << 7)) + SPREAD * 0x7f) | picked) >> 7) & SPREAD;
            let bytes = (ones << k).to_le_bytes();
            codes.iter_mut().zip(bytes).for_each(|(code, bit)| *code = code.wrapping_add(bit));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_add_their_bits() {
        let planes = [0b1010_0101u8, 0xff, 0b0000_1111, 0x01];
        let mut codes = [3u8; 16];
        add_planes(&planes, 2, &mut codes);
        for (x, code) in codes.iter().enumerate() {
            let bit = |plane: usize| planes[plane * 2 + x / 8] >> (x % 8) & 1;
            assert_eq!(*code, 3 + bit(0) + 2 * bit(1), "{x}");
        }
    }
}
