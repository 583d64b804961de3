//! What a frame may cost or be wrong by.

use std::time::Duration;

/// What the caller allows per frame.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Budget {
    /// All ranks of the field, and rows only of patches that outshine the sky.
    #[default]
    Field,
    /// The largest error of an 8-bit code, against the uncompressed response; the frame takes the time it takes.
    ErrorCodes(f32),
    /// The time of a frame, from the weights to the picture. Tiles that would not get done wait for the next frames as they
    /// are, those that would change least, and the counters' bound says how far they are off. What has never been drawn
    /// does not wait.
    Time(Duration),
}

/// Why a budget was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BudgetError {
    /// Not more than half a code, which rounding alone takes.
    #[error("an error budget of {0} codes; rounding alone takes 0.5, so give more, for example 2")]
    Codes(f32),
    /// No time.
    #[error("a time budget of 0; give milliseconds per frame, for example 10")]
    Time,
    /// The field has no bounds or no way back.
    #[error("the field has no error bounds, which an error budget needs; bake it again with this release")]
    NoBounds,
}

/// Frames that a tile's time is learned from.
const FRAMES: usize = 5;
/// However little time there is, one tile in so many is drawn, so that every picture is finished some day.
const SLOWEST: usize = 16;

/// How long a tile takes, from the frames before: the median, which a frame that was interrupted does not move.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pace {
    tile_s: [f64; FRAMES],
    frames: usize,
}

impl Pace {
    /// Learns from a frame that drew `tiles` tiles in `took`.
    pub(super) fn follow(&mut self, took: Duration, tiles: usize) {
        if tiles > 0 {
            self.tile_s[self.frames % FRAMES] = took.as_secs_f64() / tiles as f64;
            self.frames += 1;
        }
    }

    /// Tiles that get done in `left` on the field's `tiles`. The more time, the more tiles; all while nothing is known.
    pub(super) fn tiles_in(&self, left: Duration, tiles: usize) -> usize {
        let mut known = self.tile_s;
        let known = &mut known[..self.frames.min(FRAMES)];
        known.sort_unstable_by(f64::total_cmp);
        let least = tiles.div_ceil(SLOWEST);
        known.get(known.len() / 2).map_or(tiles, |tile_s| ((left.as_secs_f64() / tile_s) as usize).clamp(least, tiles))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_time_is_never_fewer_tiles() {
        let ms = Duration::from_millis;
        let mut pace = Pace::default();
        assert_eq!(pace.tiles_in(ms(0), 64), 64, "nothing is known yet");
        // 0.1 ms a tile, and one frame that something came between.
        for took in [2, 2, 90, 2] {
            pace.follow(ms(took), 20);
        }
        pace.follow(ms(7), 0);
        let tiles: Vec<usize> = [0, 1, 3, 5, 6, 7, 100].map(|left| pace.tiles_in(ms(left), 64)).to_vec();
        assert_eq!(tiles, [4, 10, 30, 50, 60, 64, 64]);
    }
}
