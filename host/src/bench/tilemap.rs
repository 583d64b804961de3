//! Which tile a covered pixel belongs to, and the largest of a list of values in every tile.

use relume_firmware::field::Field;
use relume_firmware::tile::TILE_PX;

/// The tile of every covered pixel, in the order of everything the bench compares.
#[derive(Clone, Debug)]
pub struct TileMap {
    tile_of: Vec<u32>,
    tiles: usize,
}

impl TileMap {
    /// The tiles of `field` for the pixels at the places `covered` (`y * width + x`).
    pub fn new(field: &Field<'_>, covered: &[u32]) -> Self {
        Self::of_width(field.width(), field.response().tiles(), covered)
    }

    /// The same for a picture of `width_px` with `tiles` tiles.
    pub fn of_width(width_px: usize, tiles: usize, covered: &[u32]) -> Self {
        let across = width_px.div_ceil(TILE_PX);
        let tile = |&at: &u32| (at as usize / width_px / TILE_PX * across + at as usize % width_px / TILE_PX) as u32;
        TileMap { tile_of: covered.iter().map(tile).collect(), tiles }
    }

    /// Number of tiles, empty ones included.
    pub fn tiles(&self) -> usize {
        self.tiles
    }

    /// The tile of covered pixel number `k`.
    pub fn tile_of(&self, k: usize) -> usize {
        self.tile_of[k] as usize
    }

    /// The largest value in every tile, where pixel number `k` has `value(k)`; `None` for empty tiles.
    pub fn largest(&self, value: impl Fn(usize) -> f64) -> Vec<Option<f64>> {
        let mut out: Vec<Option<f64>> = vec![None; self.tiles];
        for (k, &tile) in self.tile_of.iter().enumerate() {
            let slot = &mut out[tile as usize];
            *slot = Some(slot.unwrap_or(0.0).max(value(k)));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_in_each_tile_by_hand() {
        // 40 px wide: three tiles across. Pixels (15, 0), (16, 0), (39, 17).
        let map = TileMap::of_width(40, 6, &[15, 16, 17 * 40 + 39]);
        assert_eq!([0, 1, 2].map(|k| map.tile_of(k)), [0, 1, 5]);
        let largest = TileMap::of_width(40, 6, &[0, 15, 16]).largest(|k| [3.0, 2.0, 7.0][k]);
        assert_eq!(largest, [Some(3.0), Some(7.0), None, None, None, None]);
    }
}
