//! Pictures come one light at a time, blocks want all lights at once: a file without a name turns one into the other.
//!
//! Layout: per block with coverage, per picture, `[32][32][3]` f32 in this machine's order.

use relume_firmware::tile::{BLOCK_TILES, TILE_PX};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Edge of a block, px.
pub(super) const EDGE: usize = BLOCK_TILES * TILE_PX;
/// Values of a block in one picture.
const VALUES: usize = EDGE * EDGE * 3;
const NONE: u32 = u32::MAX;

/// The file.
pub(super) struct Spool {
    file: File,
    pictures: usize,
    size: (usize, usize),
    columns: usize,
    /// Per block its place, or [`NONE`].
    places: Vec<u32>,
}

impl Spool {
    /// Room in `folder` for `pictures` pictures of `size` px; blocks without coverage take none.
    pub(super) fn new(folder: &Path, pictures: usize, size: (usize, usize), coverage: &[f32]) -> std::io::Result<Self> {
        let (columns, rows) = (size.0.div_ceil(EDGE), size.1.div_ceil(EDGE));
        let mut covered = vec![false; columns * rows];
        for (at, _) in coverage.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            covered[at / size.0 / EDGE * columns + at % size.0 / EDGE] = true;
        }
        let mut next = 0;
        let place = |covered: bool| {
            let place = if covered { next } else { NONE };
            next += u32::from(covered);
            place
        };
        let places = covered.into_iter().map(place).collect();
        Ok(Spool { file: tempfile::tempfile_in(folder)?, pictures, size, columns, places })
    }

    /// Bytes that it takes when it is full.
    pub(super) fn bytes(&self) -> u64 {
        let blocks = self.places.iter().filter(|&&place| place != NONE).count();
        (blocks * self.pictures * VALUES * 4) as u64
    }

    /// Writes picture number `picture`, `[y][x][3]`. Any thread, any order.
    pub(super) fn write(&self, picture: usize, rgb: &[f32]) -> std::io::Result<()> {
        let mut bytes = vec![0u8; VALUES * 4];
        for (block, &place) in self.places.iter().enumerate().filter(|(_, place)| **place != NONE) {
            let (x0, y0) = (block % self.columns * EDGE, block / self.columns * EDGE);
            let width = EDGE.min(self.size.0 - x0);
            // What lies beyond the picture is 0, not what another block had there.
            bytes.fill(0);
            for y in y0..(y0 + EDGE).min(self.size.1) {
                let row = &rgb[3 * (y * self.size.0 + x0)..][..3 * width];
                let to = &mut bytes[12 * (y - y0) * EDGE..][..12 * width];
                to.as_chunks_mut::<4>().0.iter_mut().zip(row).for_each(|(to, value)| *to = value.to_ne_bytes());
            }
            self.file.write_all_at(&bytes, (place as usize * self.pictures + picture) as u64 * bytes.len() as u64)?;
        }
        Ok(())
    }

    /// A block's values, `[picture][32][32][3]`; `None` for one without coverage.
    pub(super) fn read(&self, block: usize) -> std::io::Result<Option<Vec<f32>>> {
        let place = self.places[block];
        if place == NONE {
            return Ok(None);
        }
        let mut bytes = vec![0u8; self.pictures * VALUES * 4];
        let from = u64::from(place) * bytes.len() as u64;
        self.file.read_exact_at(&mut bytes, from)?;
        Ok(Some(bytes.as_chunks::<4>().0.iter().map(|value| f32::from_ne_bytes(*value)).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_cut_from_pictures() {
        let (folder, size) = (tempfile::tempdir().unwrap(), (70, 33));
        // Nothing covered in the block of columns 32 to 63 of the first row.
        let share = |at: usize| if (32..64).contains(&(at % 70)) && at / 70 < 32 { 0.0 } else { 1.0 };
        let coverage: Vec<f32> = (0..size.0 * size.1).map(share).collect();
        let spool = Spool::new(folder.path(), 2, size, &coverage).unwrap();
        assert_eq!(spool.bytes(), 5 * 2 * 12288);
        for picture in [1, 0] {
            let value = |k: usize| (picture * 1_000_000 + k) as f32;
            spool.write(picture, &(0..3 * size.0 * size.1).map(value).collect::<Vec<_>>()).unwrap();
        }
        assert!(spool.read(1).unwrap().is_none());
        let last = spool.read(5).unwrap().unwrap();
        // Column 69, row 32 is (5, 0) of the last block.
        assert_eq!(last[VALUES + 3 * 5 + 1], (1_000_000 + 3 * (32 * 70 + 69) + 1) as f32);
        assert_eq!((last[3 * 6], last[3 * EDGE]), (0.0, 0.0));
    }
}
