//! Which tiles of a picture have changed, so that nothing else is copied to a screen.

use relume_firmware::tile::TILE_PX;
use std::ops::Range;

/// A mark for each 16x16 tile of a picture, row by row; tiles at the right and lower edge may be cut off.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    width: usize,
    height: usize,
    columns: usize,
    marks: Vec<bool>,
    count: usize,
}

impl Damage {
    /// No tile of a picture of `width` x `height` pixels.
    pub fn none(width: usize, height: usize) -> Self {
        let columns = width.div_ceil(TILE_PX);
        let marks = vec![false; columns * height.div_ceil(TILE_PX)];
        Damage { width, height, columns, marks, count: 0 }
    }

    /// Every tile of a picture of `width` x `height` pixels.
    pub fn whole(width: usize, height: usize) -> Self {
        let mut damage = Damage::none(width, height);
        damage.mark_all();
        damage
    }

    /// Width and height of the picture, px.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Is nothing marked?
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Marked tiles.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Marks a tile by its number, row by row.
    pub fn mark(&mut self, tile: usize) {
        if let Some(mark) = self.marks.get_mut(tile) {
            self.count += usize::from(!*mark);
            *mark = true;
        }
    }

    /// Marks all tiles.
    pub fn mark_all(&mut self) {
        self.marks.fill(true);
        self.count = self.marks.len();
    }

    /// Marks the tiles that an area of pixels lies in.
    pub fn mark_area(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let (rows, columns) = (tiles(rows, self.height), tiles(columns, self.width));
        for row in rows {
            columns.clone().for_each(|column| self.mark(row * self.columns + column));
        }
    }

    /// Is any tile marked that an area of pixels lies in?
    pub fn touches(&self, rows: Range<usize>, columns: Range<usize>) -> bool {
        let (mut rows, columns) = (tiles(rows, self.height), tiles(columns, self.width));
        self.count > 0 && rows.any(|row| columns.clone().any(|column| self.marks[row * self.columns + column]))
    }

    /// Marks what `other` marks. Both must be of one size.
    pub fn add(&mut self, other: &Damage) {
        debug_assert_eq!(self.size(), other.size());
        if other.count == other.marks.len() {
            return self.mark_all();
        }
        if other.count > 0 {
            (0..other.marks.len()).filter(|&tile| other.marks[tile]).for_each(|tile| self.mark(tile));
        }
    }

    /// Takes all marks away.
    pub fn clear(&mut self) {
        if self.count > 0 {
            self.marks.fill(false);
            self.count = 0;
        }
    }

    /// The marked areas: rows and columns of pixels, neighbouring tiles of a row as one.
    pub fn areas(&self) -> impl Iterator<Item = (Range<usize>, Range<usize>)> {
        let rows = if self.count == 0 { 0 } else { self.marks.len() / self.columns.max(1) };
        (0..rows).flat_map(move |row| {
            let (mut next, from) = (0, row * self.columns);
            let marks = &self.marks[from..from + self.columns];
            std::iter::from_fn(move || {
                let first = next + marks[next..].iter().position(|&mark| mark)?;
                let after = marks[first..].iter().position(|&mark| !mark).map_or(marks.len(), |length| first + length);
                next = after;
                let cut = |tile: usize, most: usize| (tile * TILE_PX).min(most);
                Some((cut(row, self.height)..cut(row + 1, self.height), cut(first, self.width)..cut(after, self.width)))
            })
        })
    }
}

fn tiles(pixels: Range<usize>, most: usize) -> Range<usize> {
    let end = pixels.end.min(most);
    if pixels.start >= end { 0..0 } else { pixels.start / TILE_PX..end.div_ceil(TILE_PX) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_cover_the_marked_tiles_and_nothing_else() {
        let mut damage = Damage::none(50, 20);
        [0, 1, 3, 6].into_iter().for_each(|tile| damage.mark(tile));
        damage.mark(99);
        assert_eq!(damage.count(), 4);
        let areas: Vec<_> = damage.areas().collect();
        assert_eq!(areas, [(0..16, 0..32), (0..16, 48..50), (16..20, 32..48)]);
        damage.clear();
        assert!(damage.is_empty() && damage.areas().next().is_none());
        assert_eq!(Damage::none(0, 0).areas().count(), 0);
    }

    #[test]
    fn areas_mark_the_tiles_they_lie_in() {
        let mut damage = Damage::none(32, 64);
        damage.mark_area(15..33, 0..32);
        assert_eq!(damage.areas().map(|(rows, _)| rows).collect::<Vec<_>>(), [0..16, 16..32, 32..48]);
        assert!(damage.touches(40..50, 3..4) && !damage.touches(48..64, 0..32) && !damage.touches(5..5, 0..32));
        damage.mark_area(60..600, 16..99);
        assert_eq!(damage.count(), 7);
        assert!(damage.touches(63..64, 20..21) && !damage.touches(63..64, 0..16));
    }

    #[test]
    fn damage_adds_up() {
        let (mut sum, mut one) = (Damage::none(40, 40), Damage::none(40, 40));
        one.mark(4);
        sum.mark(0);
        sum.add(&one);
        assert_eq!(sum.count(), 2);
        sum.add(&Damage::whole(40, 40));
        assert_eq!((sum.count(), sum.areas().count()), (9, 3));
    }
}
