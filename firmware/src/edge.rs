//! Edge pixels: those of a tile that are covered partly, so that the view behind mixes with them.

use crate::relight::LinearTile;
use crate::tile::{LANE_PAD, TILE_PIXELS, TILE_PX, Tile, padded};

/// The edge pixels of a tile, in mask order.
#[derive(Clone, Debug)]
pub struct Edges {
    count: usize,
    /// `y * 16 + x` in the tile.
    places: [u8; TILE_PIXELS],
    /// Number among the covered pixels.
    numbers: [u8; TILE_PIXELS],
    /// Coverage in 255ths; 255 from `count` on.
    coverage: [u8; TILE_PIXELS],
}

impl Edges {
    /// Of a tile.
    pub fn new(tile: &Tile<'_>) -> Self {
        let nothing = [0; TILE_PIXELS];
        let mut edges = Edges { count: 0, places: nothing, numbers: nothing, coverage: [255; TILE_PIXELS] };
        let Some(coverage) = tile.coverage else { return edges };
        let mut first = 0;
        for y in 0..TILE_PX {
            let covered = tile.mask_row(y);
            let end = first + covered.count_ones() as usize;
            let shares = &coverage[first..end];
            // Most rows have no edge: they are passed over whole.
            if shares.first_chunk().is_none_or(|shares| u128::from_le_bytes(*shares) != u128::MAX) {
                edges.add_row((y, covered), first, shares);
            }
            first = end;
        }
        edges
    }

    fn add_row(&mut self, (y, mut covered): (usize, u16), first: usize, shares: &[u8]) {
        for (number, &share) in shares.iter().enumerate() {
            if share < 255 {
                self.places[self.count] = (y * TILE_PX) as u8 + covered.trailing_zeros() as u8;
                self.numbers[self.count] = (first + number) as u8;
                self.coverage[self.count] = share;
                self.count += 1;
            }
            covered &= covered - 1;
        }
    }

    /// Floats that the light of a tile's edge pixels takes.
    pub fn light_len(tile: &Tile<'_>) -> usize {
        3 * tile.coverage.unwrap_or(&[]).iter().filter(|&&share| share < 255).count()
    }

    /// Edge pixels.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The same, padded as kernels want it.
    pub(crate) fn padded(&self) -> usize {
        const { assert!(LANE_PAD == 16) };
        padded(self.count)
    }

    /// Where they lie in the tile.
    pub(crate) fn places(&self) -> impl Iterator<Item = usize> + '_ {
        self.places[..self.count].iter().map(|&place| usize::from(place))
    }

    /// Their coverage, padded with whole pixels.
    pub(crate) fn coverage(&self) -> &[u8] {
        &self.coverage[..self.padded()]
    }

    /// Moves their light to the front of the tile's, in the order of the edges.
    pub(crate) fn gather(&self, linear: &mut LinearTile) {
        for plane in &mut linear.0 {
            // No edge has a number below its own place in the list.
            for (to, &from) in self.numbers[..self.count].iter().enumerate() {
                plane[to] = plane[usize::from(from)];
            }
        }
    }

    /// Keeps what [`Edges::gather`] has gathered, `[3][count]`.
    pub(crate) fn keep(&self, linear: &LinearTile, kept: &mut [f32]) {
        for (plane, kept) in linear.0.iter().zip(kept.chunks_exact_mut(self.count.max(1))) {
            kept.copy_from_slice(&plane[..self.count]);
        }
    }

    /// Brings back what was kept.
    pub(crate) fn recall(&self, kept: &[f32], linear: &mut LinearTile) {
        for (plane, kept) in linear.0.iter_mut().zip(kept.chunks_exact(self.count.max(1))) {
            plane[..self.count].copy_from_slice(kept);
        }
    }
}
