//! Damage: the rectangles of a picture that a frame has written.

use crate::types::RelumeRect;

/// Collects rectangles in the caller's room; never loses one, but widens the last when the room is full.
pub struct Damage<'a> {
    room: &'a mut [RelumeRect],
    count: usize,
}

impl<'a> Damage<'a> {
    /// Nothing written yet.
    pub fn new(room: &'a mut [RelumeRect]) -> Self {
        Damage { room, count: 0 }
    }

    /// Adds what was written: one tile after the other, left to right, top to bottom.
    pub fn add(&mut self, tile: RelumeRect) {
        let full = self.count == self.room.len();
        if let Some(last) = self.room[..self.count].last_mut() {
            let continues = last.y == tile.y && last.height == tile.height && last.x + last.width == tile.x;
            if continues {
                last.width += tile.width;
                return;
            }
            if full {
                *last = union(*last, tile);
                return;
            }
        }
        if let Some(next) = self.room.get_mut(self.count) {
            *next = tile;
            self.count += 1;
        }
    }

    /// Rectangles in the room.
    pub fn count(&self) -> usize {
        self.count
    }
}

/// The smallest rectangle over both.
fn union(a: RelumeRect, b: RelumeRect) -> RelumeRect {
    let (x, y) = (a.x.min(b.x), a.y.min(b.y));
    let (right, foot) = ((a.x + a.width).max(b.x + b.width), (a.y + a.height).max(b.y + b.height));
    RelumeRect { x, y, width: right - x, height: foot - y }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: RelumeRect = RelumeRect { x: 0, y: 0, width: 0, height: 0 };

    fn tile(column: u32, row: u32) -> RelumeRect {
        RelumeRect { x: 16 * column, y: 16 * row, width: 16, height: 16 }
    }

    fn damage<const ROOM: usize>(tiles: &[(u32, u32)]) -> ([RelumeRect; ROOM], usize) {
        let mut room = [NOTHING; ROOM];
        let mut damage = Damage::new(&mut room);
        tiles.iter().for_each(|&(column, row)| damage.add(tile(column, row)));
        let count = damage.count();
        (room, count)
    }

    #[test]
    fn neighbours_in_a_row_become_one() {
        let (room, count) = damage::<4>(&[(0, 0), (1, 0), (3, 0), (3, 1), (4, 1)]);
        assert_eq!(count, 3);
        assert_eq!(room[0], RelumeRect { width: 32, ..tile(0, 0) });
        assert_eq!(room[1], tile(3, 0));
        assert_eq!(room[2], RelumeRect { width: 32, ..tile(3, 1) });
    }

    #[test]
    fn a_full_room_still_holds_everything() {
        let (room, count) = damage::<2>(&[(0, 0), (2, 0), (1, 1), (5, 3)]);
        assert_eq!((count, room[0]), (2, tile(0, 0)));
        assert_eq!(room[1], RelumeRect { x: 16, y: 0, width: 80, height: 64 });
        assert_eq!(damage::<0>(&[(0, 0)]).1, 0);
    }
}
