//! Flat blocks of an exposure series: what a response curve is found from.
//!
//! A block of 8x8 pixels averages noise and quantisation away. A block counts in a frame only when none of its pixels is
//! clipped there; per frame and band of codes the flattest ones are taken, so that every code is seen.

use crate::camera::{Codes, Frame};
use crate::quantile::median;

/// Pixels along a block's side.
const SIDE: usize = 8;
/// Bands of codes per frame, and blocks taken per band.
const BANDS: usize = 32;
const PER_BAND: usize = 6;
/// Code / max from which a pixel counts as clipped.
const CLIP: f64 = 254.0 / 255.0;
/// Least mean code above black, in 255ths of the largest code.
const LEAST: f64 = 1.0;

/// A block in one frame, codes in 255ths of the largest code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The frame's place in the series.
    pub frame: usize,
    /// Mean code above black.
    pub code: f64,
    /// Variance of the pixels' codes.
    pub spread: f64,
    /// Variance of the mean by noise and quantisation.
    pub variance: f64,
}

/// One block of one channel in every frame that shows it unclipped.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Its samples, in the frames' order.
    pub samples: Vec<Sample>,
}

/// Code of pixels that stay dark in every frame, share of the largest code: beyond the lens's circle, or a capped part. None
/// where fewer than 1 % of the blocks are such.
pub fn black_level(frames: &[Frame]) -> Option<f64> {
    let longest = frames.iter().max_by(|a, b| a.exposure.product_s().total_cmp(&b.exposure.product_s()))?;
    let shortest = frames.iter().min_by(|a, b| a.exposure.product_s().total_cmp(&b.exposure.product_s()))?;
    let mut dark = Vec::new();
    let mut count = 0;
    for corner in corners(longest) {
        let (long, short) = (statistics(longest, corner, 1), statistics(shortest, corner, 1));
        count += 1;
        let noise = 3.0 * (long.spread / (SIDE * SIDE) as f64).sqrt() + 0.1;
        // Where noise is cut off at code 0 there is no black level to see.
        if long.lowest > 0.0 && long.mean < 64.0 && (long.mean - short.mean).abs() < noise {
            dark.push(long.mean);
        }
    }
    let is_enough = dark.len() * 100 > count;
    median(&mut dark).filter(|_| is_enough).map(|code| code / 255.0)
}

/// Flat blocks of a channel (0..3); `black` is the code of black, share of the largest code.
pub fn flat_blocks(frames: &[Frame], channel: usize, black: f64) -> Vec<Block> {
    let Some(first) = frames.first() else { return Vec::new() };
    let all: Vec<Block> = corners(first).map(|corner| block(frames, corner, channel, black)).collect();
    let mut taken = vec![false; all.len()];
    for frame in 0..frames.len() {
        let mut bands: Vec<Vec<(f64, usize)>> = vec![Vec::new(); BANDS];
        for (index, block) in all.iter().enumerate().filter(|(_, block)| block.samples.len() > 1) {
            if let Some(sample) = block.samples.iter().find(|sample| sample.frame == frame) {
                let band = (((sample.code + 2.0) / 257.0).ln() / (2.0f64 / 257.0).ln() * BANDS as f64) as usize;
                bands[band.min(BANDS - 1)].push((sample.spread / sample.code.powi(2), index));
            }
        }
        for mut band in bands {
            band.sort_by(|a, b| a.0.total_cmp(&b.0));
            band.iter().take(PER_BAND).for_each(|&(_, index)| taken[index] = true);
        }
    }
    all.into_iter().zip(taken).filter(|(_, taken)| *taken).map(|(block, _)| block).collect()
}

/// Top left pixels of the blocks of a picture.
fn corners(frame: &Frame) -> impl Iterator<Item = [usize; 2]> {
    let (across, down) = (frame.width / SIDE, frame.height / SIDE);
    // At most some ten thousand blocks are looked at.
    let stride = ((across * down) as f64 / 20_000.0).sqrt().ceil().max(1.0) as usize;
    (0..down).step_by(stride).flat_map(move |y| (0..across).step_by(stride).map(move |x| [x * SIDE, y * SIDE]))
}

struct Statistics {
    mean: f64,
    spread: f64,
    lowest: f64,
    highest: f64,
}

/// Mean, variance, smallest and largest of a block's codes, in 255ths of the largest code.
fn statistics(frame: &Frame, corner: [usize; 2], channel: usize) -> Statistics {
    let unit = 255.0 / f64::from(frame.codes.max());
    let (mut sum, mut square, mut lowest, mut highest) = (0.0, 0.0, f64::INFINITY, 0.0f64);
    for row in 0..SIDE {
        for col in 0..SIDE {
            let index = ((corner[1] + row) * frame.width + corner[0] + col) * 3 + channel;
            let code = f64::from(frame.codes.get(index)) * unit;
            sum += code;
            square += code * code;
            (lowest, highest) = (lowest.min(code), highest.max(code));
        }
    }
    let count = (SIDE * SIDE) as f64;
    let mean = sum / count;
    Statistics { mean, spread: ((square - sum * mean) / (count - 1.0)).max(0.0), lowest, highest }
}

fn block(frames: &[Frame], corner: [usize; 2], channel: usize, black: f64) -> Block {
    let sample = |(index, frame): (usize, &Frame)| {
        let found = statistics(frame, corner, channel);
        let code = found.mean - 255.0 * black;
        let step = if matches!(frame.codes, Codes::U8(_)) { 1.0 } else { 255.0 / 65_535.0 };
        let sigma2 = (found.spread / (step * step) - 1.0 / 12.0).max(0.0);
        // Mean square error of the mean of a rounded normal distribution, by the first term of its Fourier series.
        let rounding =
            step * step * (-4.0 * std::f64::consts::PI.powi(2) * sigma2).exp() / (2.0 * std::f64::consts::PI.powi(2));
        let variance = found.spread / (SIDE * SIDE) as f64 + rounding;
        // A pixel at the lowest code may be one whose noise was cut off there.
        let usable = found.highest < 255.0 * CLIP && found.lowest > 0.0 && code > LEAST;
        usable.then_some(Sample { frame: index, code, spread: found.spread, variance })
    };
    Block { samples: frames.iter().enumerate().filter_map(sample).collect() }
}
