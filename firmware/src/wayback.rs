//! The way back: the rows of single patches, read only where the factors of a tile are not good enough for the light.
//!
//! ```text
//! WAYT  u32 per tile: place of the tile's block in WAYD, in units of 16 bytes; FFFFFFFF: the tile has none
//! WAYD  per tile: 8 bytes per patch, together a multiple of 16; then the patches' strips
//!    0 u32 bytes from the block's start to the patch's first strip
//!    4 u8 unit in quarters of an octave: 2^(-unit / 4)     5 u8 rest, a minifloat from 2^-1 (minifloat.rs)
//!    6 u16 largest code of any pixel and channel
//!   strip  64 padded pixels, the last one what is left of them (a multiple of 16)
//!    0 u8 bits of green | bits of red << 4                1 u8 bits of blue | shift << 4
//!    2 u8 base of green    3 i8 base of red - green       4 i8 base of blue - green      (all times 2^shift)
//!    5 bit planes of pixels / 8 bytes: bit x % 8 of byte x / 8 belongs to pixel x; green's planes, red's, blue's, lowest
//!      bit first
//!
//! green = base + bits; red = green + base + bits; blue = green + base + bits       (0..=16000)
//! response[x][c][i] = row * unit * code[c][x]^2        with row = rows[c][x] 2^re[c]
//! |sqrt(true) - sqrt(row * unit) * code| <= sqrt(row * unit) / 2, beside at most
//!   rest * unit * 65535 * 2^re[c] * (rows[c][x] / 65535)^0.583
//! ```
//!
//! In the square root the error is the same whatever the code, and light of several patches is a sum of squares: by the
//! triangle inequality the root of their sum is off by at most `sqrt(row * sum_i weight_i unit_i) / 2`. The sRGB curve
//! over that root is nowhere steeper than [`crate::tone::ROOT_SLOPE`], so the error in codes has one bound for every
//! light. What takes the way back is left out of the weights that the factors see.

use crate::field::FieldError;
use crate::header::{u16_at, u32_at};
use crate::kernel::Kernel;
use crate::minifloat::Minifloat;
use crate::tile::{PLACE_UNIT, TILE_PIXELS, Tile, TileSet};

/// Largest code: differences of two channels, over their base in whole 2^shift, take 15 planes at most.
pub const CODE_TOP: u16 = 16_000;
/// Length of a patch's entry, bytes.
pub const WAY_ENTRY: usize = 8;
/// Pixels of a strip.
pub const STRIP: usize = 64;
/// Bytes of a strip before its planes.
pub const STRIP_HEADER: usize = 5;
/// The place of a tile without rows.
pub const NO_WAY: u32 = u32::MAX;

/// The codes of what is beyond half a step of the root, in units.
pub const REST: Minifloat = Minifloat::from(-1);
/// Bytes of a tile's strips that are asked for ahead: most take no more.
const PREFETCHED: usize = 384;
/// More than single precision loses of a sum over all patches.
const SUM_LOSS: f32 = 2e-5;

/// What code 1 stands for, over row scale.
pub fn way_unit(quarters: u8) -> f32 {
    const PARTS: [f32; 4] = [1.0, 0.840_896_4, core::f32::consts::FRAC_1_SQRT_2, 0.594_603_55];
    libm::scalbnf(PARTS[usize::from(quarters % 4)], -i32::from(quarters / 4))
}

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
    /// From the first strip on.
    strips: &'a [u8],
    pixels: usize,
}

/// What is known of all codes of one patch in one tile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowFacts {
    /// What `code^2 * row scale code * 2^re` is multiplied by.
    pub unit: f32,
    /// Largest code of any pixel and channel.
    pub top: u16,
    /// What is beyond half a step of the root, in response per row scale (times 65535 * 2^re: response).
    pub rest: f32,
}

impl RowFacts {
    /// Do the codes fit bytes?
    pub fn fit_bytes(&self) -> bool {
        self.top <= u16::from(u8::MAX)
    }

    /// Largest response that the codes stand for, over row scale.
    pub fn largest(&self) -> f32 {
        let top = f32::from(self.top);
        self.unit * top * top
    }

    /// No true response is larger, over row scale; as `rest` counts it.
    pub fn most(&self) -> f32 {
        let root = f32::from(self.top) + 0.5;
        self.unit * root * root + self.rest
    }

    /// Largest error of any pixel in all, as `rest` counts it.
    pub fn error(&self) -> f32 {
        let top = f32::from(self.top);
        self.unit * (top + 0.25 + top * top * SUM_LOSS) + self.rest
    }
}

/// Codes of one patch in one tile, `[red, green, blue][padded pixel]`.
#[derive(Clone, Debug)]
pub struct RowCodes(pub [[u16; TILE_PIXELS]; 3]);

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
            let block = blocks.get(at..).ok_or(bad)?;
            let entries = block.get(..way.patches * WAY_ENTRY).ok_or(bad)?;
            let pixels = response.tile(tile).padded_pixels();
            let fits = |entry: &[u8]| strips_end(block, u32_at(entry, 0) as usize, pixels).is_some();
            if !entries.chunks_exact(WAY_ENTRY).all(fits) {
                return Err(bad);
            }
        }
        Ok(way)
    }

    fn block(&self, tile: usize) -> Option<usize> {
        let place = u32_at(self.places.get(4 * tile..4 * tile + 4)?, 0);
        (place != NO_WAY).then_some(place as usize * PLACE_UNIT)
    }

    /// The rows of `patch` in a tile, if the file has them.
    pub fn get(&self, tile: &Tile<'_>, patch: usize) -> Option<PatchRows<'a>> {
        let (block, entry) = self.entry(tile.index, patch)?;
        // That the strips fit was checked; whoever asks for no more than the entry must not wait for their headers.
        Some(PatchRows { entry, strips: block.get(u32_at(entry, 0) as usize..)?, pixels: tile.padded_pixels() })
    }

    /// The block of a tile and a patch's entry in it.
    fn entry(&self, index: usize, patch: usize) -> Option<(&'a [u8], &'a [u8])> {
        let block = &self.blocks[self.block(index).filter(|_| patch < self.patches)?..];
        Some((block, &block[patch * WAY_ENTRY..][..WAY_ENTRY]))
    }

    /// Asks for a patch's entry.
    pub fn prefetch_entry(&self, index: usize, patch: usize, kernel: Kernel) {
        if let Some((_, entry)) = self.entry(index, patch) {
            kernel.prefetch(entry);
        }
    }

    /// Asks for what unpacking a patch's rows will read first; its entry should be there already.
    pub fn prefetch_rows(&self, index: usize, patch: usize, kernel: Kernel) {
        if let Some((block, entry)) = self.entry(index, patch)
            && let Some(strips) = block.get(u32_at(entry, 0) as usize..)
        {
            kernel.prefetch(&strips[..strips.len().min(PREFETCHED)]);
        }
    }

    /// Bytes of all rows.
    pub fn bytes(&self) -> usize {
        self.places.len() + self.blocks.len()
    }
}

/// Pixels of each strip of a tile.
fn strip_pixels(pixels: usize) -> impl Iterator<Item = usize> {
    (0..pixels).step_by(STRIP).map(move |first| STRIP.min(pixels - first))
}

/// Bit planes of green, red and blue.
fn planes_of(strip: &[u8]) -> [usize; 3] {
    [strip[0] & 15, strip[0] >> 4, strip[1] & 15].map(usize::from)
}

/// 64 padded pixels of one patch's rows, or what is left of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strip<'a> {
    /// Number of its first pixel.
    pub(crate) first: usize,
    /// Pixels, a multiple of 16.
    pub(crate) pixels: usize,
    /// Power of two of the bases.
    pub(crate) shift: u8,
    /// Of green, red - green and blue - green.
    pub(crate) base: [i16; 3],
    /// Bit planes of the same.
    pub(crate) planes: [&'a [u8]; 3],
}

impl Strip<'_> {
    /// Bytes of a bit plane.
    pub(crate) fn plane_bytes(&self) -> usize {
        self.pixels / 8
    }
}

/// The strips of a tile of so many pixels, which begin at `bytes`.
#[inline]
pub(crate) fn strips(mut bytes: &[u8], pixels: usize) -> impl Iterator<Item = Strip<'_>> {
    let mut first = 0;
    strip_pixels(pixels).map(move |pixels| {
        let (header, rest) = bytes.split_at(STRIP_HEADER);
        let [green, red, blue] = planes_of(header).map(|planes| planes * (pixels / 8));
        let (green, rest) = rest.split_at(green);
        let (red, rest) = rest.split_at(red);
        let (blue, rest) = rest.split_at(blue);
        let base = [i16::from(header[2]), i16::from(header[3] as i8), i16::from(header[4] as i8)];
        let strip = Strip { first, pixels, shift: header[1] >> 4, base, planes: [green, red, blue] };
        (first, bytes) = (first + pixels, rest);
        strip
    })
}

/// Where the strips that begin at `from` end; `None` where the block has no room for them.
fn strips_end(block: &[u8], from: usize, pixels: usize) -> Option<usize> {
    strip_pixels(pixels).try_fold(from, |at, pixels| {
        let planes: usize = planes_of(block.get(at..)?.get(..STRIP_HEADER)?).iter().sum();
        let end = at + STRIP_HEADER + planes * (pixels / 8);
        (end <= block.len()).then_some(end)
    })
}

impl PatchRows<'_> {
    /// Bytes that it takes to read them.
    pub fn bytes(&self) -> usize {
        self.entry.len() + strips_end(self.strips, 0, self.pixels).unwrap_or(0)
    }

    /// What is known of all its codes.
    pub fn facts(&self) -> RowFacts {
        let unit = way_unit(self.entry[4]);
        RowFacts { unit, top: u16_at(self.entry, 6), rest: REST.value(self.entry[5]) * unit }
    }

    /// Unpacks the codes of all padded pixels to bytes, `[3][pixels]` R G B, where [`RowFacts::fit_bytes`].
    ///
    /// # Panics
    /// If `codes` has room for more or less.
    pub fn decode_bytes(&self, kernel: Kernel, codes: &mut [u8]) {
        kernel.unpack_rows(self.strips, self.pixels, codes);
    }

    /// Unpacks the codes of all padded pixels.
    pub fn decode(&self, out: &mut RowCodes) {
        let [red, green, blue] = &mut out.0;
        for strip in strips(self.strips, self.pixels) {
            let (place, base) =
                (strip.first..strip.first + strip.pixels, strip.base.map(|base| (base << strip.shift) as u16));
            let green = &mut green[place.clone()];
            green.fill(base[0]);
            add_planes(strip.planes[0], strip.plane_bytes(), green);
            for (of, c) in [(&mut *red, 1), (&mut *blue, 2)] {
                let of = &mut of[place.clone()];
                of.iter_mut().zip(green.iter()).for_each(|(code, green)| *code = green.wrapping_add(base[c]));
                add_planes(strip.planes[c], strip.plane_bytes(), of);
            }
        }
    }
}

/// Adds `2^k` where bit plane `k` is set, 8 pixels at a time (wrapping: a damaged file stays harmless).
fn add_planes(planes: &[u8], plane_bytes: usize, codes: &mut [u16]) {
    for (place, codes) in codes.as_chunks_mut::<8>().0.iter_mut().enumerate().take(plane_bytes) {
        // Eight planes fill the bytes of a word; what is above comes on top.
        let mut high = 0;
        for planes in planes.chunks(8 * plane_bytes) {
            let bits = planes.iter().skip(place).step_by(plane_bytes).enumerate();
            let bytes = bits.fold(0u64, |sum, (k, bits)| sum | ones(*bits) << k).to_le_bytes();
            codes.iter_mut().zip(bytes).for_each(|(code, byte)| *code = code.wrapping_add(u16::from(byte) << high));
            high += 8;
        }
    }
}

/// One in every byte whose bit is set.
fn ones(bits: u8) -> u64 {
    const SPREAD: u64 = 0x0101_0101_0101_0101;
    const PICK: u64 = 0x8040_2010_0804_0201;
    let picked = (u64::from(bits) * SPREAD) & PICK;
    // Adding 7F carries into the top bit of each byte that is not 0.
    ((((picked & !(SPREAD << 7)) + SPREAD * 0x7f) | picked) >> 7) & SPREAD
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_add_their_bits() {
        let planes: [u8; 22] = core::array::from_fn(|k| (k * 89 + 37) as u8);
        let mut codes = [3u16; 16];
        add_planes(&planes, 2, &mut codes);
        for (x, code) in codes.iter().enumerate() {
            let bit = |plane: usize| u16::from(planes[plane * 2 + x / 8] >> (x % 8) & 1);
            assert_eq!(*code, 3 + (0..11).map(|plane| bit(plane) << plane).sum::<u16>(), "{x}");
        }
    }

    #[test]
    fn units_are_quarters_of_octaves() {
        for quarters in 0..=255u8 {
            let exact = libm::exp2(-f64::from(quarters) / 4.0);
            assert!((f64::from(way_unit(quarters)) / exact - 1.0).abs() < 1e-6);
        }
    }
}
