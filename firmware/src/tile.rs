//! Tiles of 16x16 px: records, masks and the borrowed parts of one tile's response.

use crate::field::FieldError;
use crate::header::{u16_at, u32_at};

/// Edge of a tile, px.
pub const TILE_PX: usize = 16;
/// Edge of a block, tiles: the tiles of a block share one V, so that it is projected once for all of them.
pub const BLOCK_TILES: usize = 2;
/// Most pixels of a tile.
pub const TILE_PIXELS: usize = TILE_PX * TILE_PX;
/// Length of a tile record, bytes.
pub const TILE_RECORD: usize = 64;
/// Largest rank of a tile. With |q| <= 32767 and |U| <= 127 a sum of 128 products stays below 2^29.
pub const MAX_RANK: usize = 128;
/// Pixels and patches are padded to this many, so that kernels never need a tail.
pub const LANE_PAD: usize = 16;
/// Smallest and largest exponent of a scale.
pub const EXPONENT_RANGE: core::ops::RangeInclusive<i8> = -80..=40;
/// Places in a record count in units of this many bytes.
pub const PLACE_UNIT: usize = 16;
/// The record's place of coverage when all pixels are whole.
pub const ALL_WHOLE: u32 = u32::MAX;

/// Rounds up to a multiple of [`LANE_PAD`].
pub const fn padded(n: usize) -> usize {
    n.div_ceil(LANE_PAD) * LANE_PAD
}

/// A tile record as numbers; [`TileRecord::encode`] gives its 64 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileRecord {
    /// Bit `y*16 + x` is set where the pixel is covered.
    pub mask: [u8; 32],
    /// Place of U, in units of [`PLACE_UNIT`] bytes.
    pub u_place: u32,
    /// Place of V and its scales.
    pub v_place: u32,
    /// Place of the row scales.
    pub rows_place: u32,
    /// Place of coverage, or [`ALL_WHOLE`].
    pub coverage_place: u32,
    /// Covered pixels.
    pub pixels: u16,
    /// Rank of U, even.
    pub rank: u16,
    /// Rank of V, even, at least `rank`; the same for all tiles of a block.
    pub v_rank: u16,
    /// Exponents of the row scales, R G B.
    pub row_exponent: [i8; 3],
    /// Exponents of V's scales, R G B.
    pub v_exponent: [i8; 3],
}

impl TileRecord {
    /// The record's bytes.
    pub fn encode(&self) -> [u8; TILE_RECORD] {
        let mut out = [0u8; TILE_RECORD];
        out[..32].copy_from_slice(&self.mask);
        for (k, place) in [self.u_place, self.v_place, self.rows_place, self.coverage_place].iter().enumerate() {
            out[32 + 4 * k..36 + 4 * k].copy_from_slice(&place.to_le_bytes());
        }
        out[48..50].copy_from_slice(&self.pixels.to_le_bytes());
        out[50..52].copy_from_slice(&self.rank.to_le_bytes());
        for c in 0..3 {
            out[52 + c] = self.row_exponent[c] as u8;
            out[55 + c] = self.v_exponent[c] as u8;
        }
        out[58..60].copy_from_slice(&self.v_rank.to_le_bytes());
        out
    }

    /// The record of [`encode`](Self::encode)'s bytes.
    pub fn decode(b: &[u8; TILE_RECORD]) -> Self {
        let mut mask = [0; 32];
        mask.copy_from_slice(&b[..32]);
        TileRecord {
            mask,
            u_place: u32_at(b, 32),
            v_place: u32_at(b, 36),
            rows_place: u32_at(b, 40),
            coverage_place: u32_at(b, 44),
            pixels: u16_at(b, 48),
            rank: u16_at(b, 50),
            v_rank: u16_at(b, 58),
            row_exponent: [b[52] as i8, b[53] as i8, b[54] as i8],
            v_exponent: [b[55] as i8, b[56] as i8, b[57] as i8],
        }
    }
}

/// Borrowed parts of one tile; shapes in `field.rs`.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a> {
    /// Number of the tile, in row-major order.
    pub index: usize,
    /// The record.
    pub record: TileRecord,
    /// U, `rank/2` planes of padded pixel pairs, i8 as bytes.
    pub u: &'a [u8],
    /// V, `[3][v_rank][padded patches]`, i8 as bytes.
    pub v: &'a [u8],
    /// Scales of V, `[3][v_rank]` u16, little-endian.
    pub v_scale: &'a [u8],
    /// Row scales, `[3][padded pixels]` u16, little-endian.
    pub rows: &'a [u8],
    /// Where this tile's slot begins in a plane that is laid out like the row scales (elements, not bytes).
    pub plane_at: usize,
    /// Coverage of the covered pixels in mask order, 255 = whole; `None` where all are whole.
    pub coverage: Option<&'a [u8]>,
}

impl<'a> Tile<'a> {
    /// Covered pixels.
    pub fn pixels(&self) -> usize {
        usize::from(self.record.pixels)
    }

    /// Covered pixels, padded.
    pub fn padded_pixels(&self) -> usize {
        padded(self.pixels())
    }

    /// Rank of U: ranks that this tile needs.
    pub fn rank(&self) -> usize {
        usize::from(self.record.rank)
    }

    /// Rank of V: ranks that any tile of the block needs.
    pub fn v_rank(&self) -> usize {
        usize::from(self.record.v_rank)
    }

    /// Scales of all ranks of channel `c`.
    pub fn v_scales(&self, c: usize) -> impl Iterator<Item = u16> + Clone + use<'a> {
        let scales = &self.v_scale.as_chunks::<2>().0[c * self.v_rank()..][..self.v_rank()];
        scales.iter().map(|scale| u16::from_le_bytes(*scale))
    }

    /// Row scales of channel `c` as stored, of the covered pixels in their order.
    pub fn row_codes(&self, c: usize) -> impl Iterator<Item = u16> + use<'a> {
        let rows = &self.rows.as_chunks::<2>().0[c * self.padded_pixels()..][..self.pixels()];
        rows.iter().map(|row| u16::from_le_bytes(*row))
    }

    /// What one count of a row scale of channel `c` means.
    pub fn row_unit(&self, c: usize) -> f32 {
        // The checked range is that of normal floats.
        f32::from_bits(((i32::from(self.record.row_exponent[c]) + 127) as u32) << 23)
    }

    /// What the largest row scale (65535) of channel `c` means.
    pub fn row_top(&self, c: usize) -> f32 {
        65535.0 * self.row_unit(c)
    }

    /// The covered pixels as `y*16 + x`, ascending: the order of everything stored per pixel.
    pub fn covered(&self) -> impl Iterator<Item = usize> + use<> {
        covered_pixels(self.record.mask)
    }

    /// The covered pixels of row `y`, one bit each.
    pub(crate) fn mask_row(&self, y: usize) -> u16 {
        u16::from_le_bytes([self.record.mask[2 * y], self.record.mask[2 * y + 1]])
    }

    /// A tile of a mask and nothing else.
    #[cfg(test)]
    pub(crate) fn bare(mask: [u8; 32]) -> Tile<'static> {
        let mut record = TileRecord::decode(&[0; TILE_RECORD]);
        (record.mask, record.pixels) = (mask, mask.iter().map(|b| b.count_ones() as u16).sum());
        Tile { index: 0, record, u: &[], v: &[], v_scale: &[], rows: &[], plane_at: 0, coverage: None }
    }

    /// Bytes of U and row scales that a full reconstruction reads.
    pub fn bytes(&self) -> usize {
        self.u.len() + self.rows.len()
    }
}

/// Set bits of a mask as `y*16 + x`, ascending.
pub fn covered_pixels(mask: [u8; 32]) -> impl Iterator<Item = usize> {
    let mut byte = 0;
    let mut bits = mask[0];
    core::iter::from_fn(move || {
        while bits == 0 {
            byte += 1;
            bits = *mask.get(byte)?;
        }
        let bit = bits.trailing_zeros() as usize;
        bits &= bits - 1;
        Some(byte * 8 + bit)
    })
}

/// A checked set of tiles: the response, or the indirect sunlight.
#[derive(Clone, Copy, Debug)]
pub struct TileSet<'a> {
    records: &'a [u8],
    u: &'a [u8],
    v: &'a [u8],
    rows: &'a [u8],
    coverage: &'a [u8],
    tiles: (u32, u32),
    patches: usize,
    covered: usize,
}

impl<'a> TileSet<'a> {
    pub(crate) fn check(
        [records, u, v, rows, coverage]: [&'a [u8]; 5],
        tiles: (u32, u32),
        (width, height): (u32, u32),
        patches: usize,
    ) -> Result<Self, FieldError> {
        if records.len() != tiles.0 as usize * tiles.1 as usize * TILE_RECORD {
            return Err(FieldError::Invalid("number of tiles"));
        }
        let mut set = TileSet { records, u, v, rows, coverage, tiles, patches, covered: 0 };
        let mut rows_end = 0;
        for index in 0..set.tiles() {
            let record = TileRecord::decode(set.record(index));
            set.check_record(&record)?;
            let rows_at = record.rows_place as usize * PLACE_UNIT;
            if rows_at < rows_end {
                return Err(FieldError::Invalid("order of the row scales"));
            }
            rows_end = rows_at + 6 * padded(usize::from(record.pixels));
            let (tx, ty) = (index as u32 % tiles.0, index as u32 / tiles.0);
            let edge = TILE_PX as u32;
            let (w, h) = ((width - tx * edge).min(edge) as usize, (height - ty * edge).min(edge) as usize);
            if covered_pixels(record.mask).any(|p| p % TILE_PX >= w || p / TILE_PX >= h) {
                return Err(FieldError::Invalid("tile mask (outside the picture)"));
            }
            set.covered += usize::from(record.pixels);
        }
        set.check_blocks()?;
        set.check_codes()?;
        Ok(set)
    }

    /// No code of U and V may be -128: sums are bounded by 127 (see [`crate::weights`]).
    fn check_codes(&self) -> Result<(), FieldError> {
        let beyond = |codes: &[u8]| codes.iter().fold(false, |any, &code| any | (code == i8::MIN as u8));
        for block in 0..self.blocks() {
            let mut covered = self.tiles_of(block).map(|index| self.tile(index)).filter(|tile| tile.pixels() > 0);
            let Some(first) = covered.next() else { continue };
            if beyond(first.v) || beyond(first.u) || covered.any(|tile| beyond(tile.u)) {
                return Err(FieldError::Invalid("code of a tile (-128)"));
            }
        }
        Ok(())
    }

    /// All covered tiles of a block must name the same V.
    fn check_blocks(&self) -> Result<(), FieldError> {
        for block in 0..self.blocks() {
            let mut records = self.tiles_of(block).map(|tile| TileRecord::decode(self.record(tile)));
            let Some(first) = records.find(|record| record.pixels > 0) else { continue };
            let same =
                |r: &TileRecord| (r.v_place, r.v_rank, r.v_exponent) == (first.v_place, first.v_rank, first.v_exponent);
            if records.any(|record| record.pixels > 0 && !same(&record)) {
                return Err(FieldError::Invalid("V of a block"));
            }
        }
        Ok(())
    }

    fn check_record(&self, record: &TileRecord) -> Result<(), FieldError> {
        let bits: u32 = record.mask.iter().map(|b| b.count_ones()).sum();
        if bits != u32::from(record.pixels) {
            return Err(FieldError::Invalid("tile mask"));
        }
        let rank = usize::from(record.rank);
        let v_rank = usize::from(record.v_rank);
        if v_rank > MAX_RANK || rank > v_rank || rank % 2 != 0 || v_rank % 2 != 0 {
            return Err(FieldError::Invalid("tile rank"));
        }
        if record.row_exponent.iter().chain(&record.v_exponent).any(|e| !EXPONENT_RANGE.contains(e)) {
            return Err(FieldError::Invalid("tile exponent"));
        }
        let fits = |place: u32, len: usize, layer: &[u8]| place as usize * PLACE_UNIT + len <= layer.len();
        let n = padded(usize::from(record.pixels));
        let v_bytes = 3 * v_rank * (padded(self.patches) + 2);
        let whole = record.coverage_place == ALL_WHOLE;
        let places = fits(record.u_place, rank * n, self.u)
            && fits(record.v_place, v_bytes, self.v)
            && fits(record.rows_place, 6 * n, self.rows)
            && (whole || fits(record.coverage_place, n, self.coverage));
        if places { Ok(()) } else { Err(FieldError::Invalid("place of a tile")) }
    }

    pub(crate) fn record(&self, tile: usize) -> &'a [u8; TILE_RECORD] {
        &self.records.as_chunks().0[tile]
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.tiles.0 as usize * self.tiles.1 as usize
    }

    /// Tiles per row and per column.
    pub fn grid(&self) -> (usize, usize) {
        (self.tiles.0 as usize, self.tiles.1 as usize)
    }

    /// Blocks per row and per column.
    pub fn block_grid(&self) -> (usize, usize) {
        let (columns, rows) = self.grid();
        (columns.div_ceil(BLOCK_TILES), rows.div_ceil(BLOCK_TILES))
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        let (columns, rows) = self.block_grid();
        columns * rows
    }

    /// The block of a tile.
    pub fn block_of(&self, tile: usize) -> usize {
        let columns = self.grid().0.max(1);
        tile / columns / BLOCK_TILES * self.block_grid().0 + tile % columns / BLOCK_TILES
    }

    /// The tiles of a block, ascending.
    pub fn tiles_of(&self, block: usize) -> impl Iterator<Item = usize> + use<> {
        let ((columns, rows), across) = (self.grid(), self.block_grid().0.max(1));
        let (x0, y0) = (block % across * BLOCK_TILES, block / across * BLOCK_TILES);
        let tiles = (0..BLOCK_TILES).flat_map(move |y| (0..BLOCK_TILES).map(move |x| (x0 + x, y0 + y)));
        tiles.filter(move |&(x, y)| x < columns && y < rows).map(move |(x, y)| y * columns + x)
    }

    /// Bytes of a block's V and its scales, which its tiles share.
    pub fn v_bytes(&self, block: usize) -> usize {
        let covered = self.tiles_of(block).map(|index| self.tile(index)).find(|tile| tile.pixels() > 0);
        covered.map_or(0, |tile| tile.v.len() + tile.v_scale.len())
    }

    /// Covered pixels of all tiles.
    pub fn covered(&self) -> usize {
        self.covered
    }

    /// Patches of each V row (without padding).
    pub fn patches(&self) -> usize {
        self.patches
    }

    /// Elements of a plane that is laid out like the row scales.
    pub fn plane_len(&self) -> usize {
        self.rows.len() / 2
    }

    /// One tile, `index < tiles()`.
    pub fn tile(&self, index: usize) -> Tile<'a> {
        let record = TileRecord::decode(self.record(index));
        let (n, rank) = (padded(usize::from(record.pixels)), usize::from(record.rank));
        let part =
            |layer: &'a [u8], place: u32, skip: usize, len: usize| &layer[place as usize * PLACE_UNIT + skip..][..len];
        let v_rank = usize::from(record.v_rank);
        let v_bytes = 3 * v_rank * padded(self.patches);
        let has_coverage = record.coverage_place != ALL_WHOLE;
        let coverage = has_coverage.then(|| part(self.coverage, record.coverage_place, 0, usize::from(record.pixels)));
        Tile {
            index,
            record,
            u: part(self.u, record.u_place, 0, rank * n),
            v: part(self.v, record.v_place, 0, v_bytes),
            v_scale: part(self.v, record.v_place, v_bytes, 6 * v_rank),
            rows: part(self.rows, record.rows_place, 0, 6 * n),
            plane_at: record.rows_place as usize * PLACE_UNIT / 2,
            coverage,
        }
    }
}
