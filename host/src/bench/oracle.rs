//! Tiles that an oracle redraws: it knows what every value of the picture is, and has nothing to bound.

use super::tilemap::TileMap;

/// A tile is redrawn once any of its codes, before rounding, has changed by this much since it was last drawn.
const HALF_CODE: f32 = 0.5;

/// Redraws exactly the tiles that have changed by half a code since they were last drawn.
#[derive(Clone, Debug)]
pub struct Oracle {
    map: TileMap,
    /// Codes of the covered pixels when their tile was last drawn; empty before the first frame.
    drawn: Vec<[f32; 3]>,
    redraw: Vec<bool>,
}

impl Oracle {
    /// An oracle that has drawn nothing yet.
    pub fn new(map: TileMap) -> Self {
        let redraw = vec![false; map.tiles()];
        Oracle { map, drawn: Vec::new(), redraw }
    }

    /// Takes the codes, before rounding, of all covered pixels now, and says how many tiles are drawn.
    pub fn frame(&mut self, codes: &[[f32; 3]]) -> usize {
        let first = self.drawn.len() != codes.len();
        if first {
            self.drawn = codes.to_vec();
        }
        self.redraw.fill(false);
        for (k, (now, drawn)) in codes.iter().zip(&self.drawn).enumerate() {
            let changed = now.iter().zip(drawn).any(|(now, drawn)| (now - drawn).abs() >= HALF_CODE);
            self.redraw[self.map.tile_of(k)] |= changed || first;
        }
        for (k, (now, drawn)) in codes.iter().zip(&mut self.drawn).enumerate() {
            if self.redraw[self.map.tile_of(k)] {
                *drawn = *now;
            }
        }
        self.redraw.iter().filter(|redraw| **redraw).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn change_is_counted_since_a_tile_was_last_drawn() {
        // Two tiles with two pixels each.
        let mut oracle = Oracle::new(TileMap::of_width(32, 2, &[0, 1, 16, 17]));
        let codes = |a: f32, b: f32| [[10.0; 3], [10.0, 10.0 + a, 10.0], [20.0; 3], [20.0, 20.0, 20.0 + b]];
        assert_eq!(oracle.frame(&codes(0.0, 0.0)), 2);
        assert_eq!(oracle.frame(&codes(0.25, 0.49)), 0);
        // Small steps add up, whichever way they go.
        assert_eq!(oracle.frame(&codes(0.5, 0.49)), 1);
        assert_eq!(oracle.frame(&codes(0.75, -0.5)), 1);
        assert_eq!(oracle.frame(&codes(0.0, 0.0)), 1 + 1);
        assert_eq!(oracle.frame(&codes(0.25, 0.25)), 0);
    }
}
