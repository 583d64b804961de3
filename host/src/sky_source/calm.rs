//! A sky that stands still: one look now and then instead of series after series.
//!
//! When some series in a row gave the same weights, the sky is calm: from then on the camera keeps one exposure, one frame
//! is looked at every [`WATCH_S`] seconds, and a whole series is taken every [`SERIES_S`] seconds. Block by block such a
//! frame is compared with that of the last series; when a block or the number of clipped pixels (the sun's disc) has moved,
//! the next series is taken at once.

use crate::camera::{Codes, Frame};
use crate::map::luminance;
use crate::weights::PatchWeights;

/// Seconds from look to look while the sky is calm.
pub const WATCH_S: f64 = 0.25;
/// Seconds from series to series while the sky is calm.
pub const SERIES_S: f64 = 5.0;
/// Series in a row that must agree.
const STILL_SERIES: u32 = 4;
/// How far weights that agree are apart, of all light.
const STILL: f32 = 0.006;
/// Blocks of a picture, a side.
const BLOCKS: usize = 16;
/// Change of a block's mean that is seen, of the mean and of white.
const MOVED: [f32; 2] = [0.03, 0.004];
/// Change of the number of clipped samples that is seen, of the number and of all samples.
const CLIPPED: [f32; 2] = [0.3, 2e-4];
/// Every so many pixels of a row are looked at.
const STRIDE: usize = 2;

/// What is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// A whole series.
    Series,
    /// One frame.
    Look,
    /// Nothing yet.
    Nothing,
}

/// Block means of a picture, as shares of white, and its share of clipped samples.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Blocks {
    means: [f32; BLOCKS * BLOCKS],
    clipped: f32,
}

/// Watches a sky for movement. `unix_s` below is the time of the post's clock.
#[derive(Debug, Default)]
pub struct Calm {
    is_on: bool,
    still: u32,
    first: PatchWeights,
    seen: Option<Blocks>,
    series_s: f64,
    look_s: f64,
}

impl Calm {
    /// `is_on` false: every look is a series.
    pub fn new(is_on: bool) -> Self {
        Calm { is_on, ..Calm::default() }
    }

    /// Does the sky stand still?
    pub fn is_calm(&self) -> bool {
        self.is_on && self.still >= STILL_SERIES && self.seen.is_some()
    }

    /// Forgets everything: the next look is a series.
    pub fn wake(&mut self) {
        (self.still, self.seen) = (0, None);
    }

    /// What is due at a time.
    pub fn due(&self, unix_s: f64) -> Due {
        let since = |then: f64, pace: f64| !(0.0..pace).contains(&(unix_s - then));
        if !self.is_calm() || since(self.series_s, SERIES_S) {
            Due::Series
        } else if since(self.look_s, WATCH_S) {
            Due::Look
        } else {
            Due::Nothing
        }
    }

    /// Takes in a series: its weights, the frame of the exposure to watch by (none if it did not come), and whether the
    /// exposures stay.
    pub fn series(&mut self, unix_s: f64, weights: &PatchWeights, watched: Option<&Frame>, exposures_stay: bool) {
        (self.series_s, self.look_s) = (unix_s, unix_s);
        self.seen = watched.map(blocks);
        if exposures_stay && self.still > 0 && agree(&self.first, weights) {
            self.still += 1;
        } else {
            self.first.radiance.clone_from(&weights.radiance);
            self.first.sun = weights.sun;
            self.still = 1;
        }
    }

    /// Takes in one frame; true if something has moved.
    pub fn look(&mut self, unix_s: f64, frame: &Frame) -> bool {
        self.look_s = unix_s;
        let Some(seen) = &self.seen else { return true };
        let now = blocks(frame);
        let differs = |(a, b): (&f32, &f32)| (a - b).abs() > MOVED[0] * a.max(*b) + MOVED[1];
        let [part, least] = CLIPPED;
        let blinks = (now.clipped - seen.clipped).abs() > part * now.clipped.max(seen.clipped) + least;
        let moved = blinks || now.means.iter().zip(&seen.means).any(differs);
        if moved {
            self.wake();
        }
        moved
    }
}

/// Are two lights the same but for noise?
fn agree(a: &PatchWeights, b: &PatchWeights) -> bool {
    if a.radiance.len() != b.radiance.len() || a.sun.is_some() != b.sun.is_some() {
        return false;
    }
    let (mut apart, mut light) = (0.0, 0.0);
    for (&a, &b) in a.radiance.iter().zip(&b.radiance) {
        apart += (luminance(a) - luminance(b)).abs();
        light += luminance(a).max(luminance(b));
    }
    let suns = a.sun.zip(b.sun).map(|(a, b)| [luminance(a.irradiance), luminance(b.irradiance)]);
    let sun_stays = suns.is_none_or(|[a, b]| (a - b).abs() <= 3.0 * STILL * a.max(b));
    apart <= STILL * light && sun_stays
}

fn blocks(frame: &Frame) -> Blocks {
    match &frame.codes {
        Codes::U8(codes) => sum_blocks(codes, frame.width, frame.height, 255.0),
        Codes::U16(codes) => sum_blocks(codes, frame.width, frame.height, 65535.0),
    }
}

fn sum_blocks<T: Copy + Into<f32>>(codes: &[T], width: usize, height: usize, white: f32) -> Blocks {
    let (mut sums, mut counts, mut clipped, mut all) = ([0.0f32; BLOCKS * BLOCKS], [0.0f32; BLOCKS * BLOCKS], 0.0, 0.0);
    for (y, row) in codes.chunks_exact((3 * width).max(1)).enumerate().step_by(STRIDE) {
        for (x, pixel) in row.chunks_exact(3).enumerate().step_by(STRIDE) {
            let block = y * BLOCKS / height * BLOCKS + x * BLOCKS / width;
            let value: f32 = pixel[1].into() / white;
            sums[block] += value;
            counts[block] += 1.0;
            all += 1.0;
            clipped += f32::from(u8::from(value > 0.97));
        }
    }
    let means = std::array::from_fn(|block| sums[block] / counts[block].max(1.0));
    Blocks { means, clipped: clipped / f32::max(all, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(value: f32) -> PatchWeights {
        PatchWeights { radiance: vec![[value; 3]; 64], sun: None }
    }

    fn frame(code: u8, spot: Option<u8>) -> Frame {
        let mut frame = Frame::default();
        frame.codes_u8(64, 48).fill(code);
        if let (Some(spot), Codes::U8(codes)) = (spot, &mut frame.codes) {
            codes[3 * (20 * 64 + 30)..][..30].fill(spot);
        }
        frame
    }

    fn settled() -> Calm {
        let mut calm = Calm::new(true);
        for second in 0..5 {
            let expected = if second < 4 { Due::Series } else { Due::Look };
            assert_eq!(calm.due(f64::from(second)), expected, "{second}");
            calm.series(f64::from(second), &weights(1.0), Some(&frame(80, None)), true);
        }
        calm
    }

    #[test]
    fn a_still_sky_is_looked_at_now_and_then() {
        let mut calm = settled();
        assert!(calm.is_calm());
        assert_eq!([calm.due(4.1), calm.due(4.3), calm.due(9.1)], [Due::Nothing, Due::Look, Due::Series]);
        assert!(!calm.look(4.3, &frame(81, None)));
        assert_eq!(calm.due(4.4), Due::Nothing);
        // A clock that was set wakes it.
        assert_eq!(calm.due(-1000.0), Due::Series);
    }

    #[test]
    fn what_moves_wakes_it() {
        for moved in [frame(88, None), frame(72, None), frame(80, Some(160))] {
            let mut calm = settled();
            assert!(calm.look(4.3, &moved));
            assert_eq!(calm.due(4.31), Due::Series);
        }
        let mut calm = settled();
        calm.series(5.0, &weights(1.02), Some(&frame(80, None)), true);
        assert!(!calm.is_calm(), "other weights");
        let mut calm = settled();
        calm.series(5.0, &weights(1.0), Some(&frame(80, None)), false);
        assert!(!calm.is_calm(), "other exposures");
        let mut calm = settled();
        calm.series(5.0, &weights(1.0), None, true);
        assert!(!calm.is_calm(), "nothing to watch by");
    }

    #[test]
    fn the_disc_is_watched_too() {
        let mut calm = Calm::new(true);
        let sun = frame(80, Some(255));
        (0..5).for_each(|second| calm.series(f64::from(second), &weights(1.0), Some(&sun), true));
        assert!(!calm.look(5.0, &sun));
        assert!(calm.look(5.3, &frame(80, Some(100))));
        assert!(!Calm::new(false).is_calm());
    }
}
