//! The merging loop: per strip of pixels and channel, table entries of up to four frames at a time are added, then divided;
//! the channels are laid side by side at last. Tables and sums of one channel fit the nearest cache together.

use super::PixelState;
use super::tables::{Entry, LIMIT_BASE};

/// Pixels worked on at a time.
const PIXELS: usize = 256;
const STRIP: usize = 3 * PIXELS;
/// Frames whose tables are read together.
const TOGETHER: usize = 4;
/// Pixels added in one turn of the loop, and those looked at together for what is rare.
const UNROLLED: usize = 4;
const BLOCK: usize = 16;

/// A frame's codes and the tables of its three channels.
pub(super) struct Source<'a, C, const COUNT: usize> {
    pub codes: &'a [C],
    pub tables: [&'a [Entry; COUNT]; 3],
}

/// What the loop leaves per pixel.
pub(super) struct Merging<'a> {
    /// Radiance, full-well fractions per second.
    pub radiance: &'a mut [[f32; 3]],
    pub state: &'a mut [PixelState],
    /// Pixels whose samples disagree, rising.
    pub suspects: &'a mut Vec<u32>,
    /// What a channel is at least that was clipped in every frame, full-well fractions per second.
    pub least: [f32; 3],
    /// From the tables' relative exposures to seconds.
    pub per_second: f32,
}

/// Sums of a strip, per channel and pixel.
struct Sums<C> {
    of: [[Entry; PIXELS]; 3],
    /// Codes of a last strip that is short, per frame.
    copies: [[C; STRIP]; TOGETHER],
}

/// A strip, channel by channel.
struct Planes {
    radiance: [[f32; PIXELS]; 3],
    /// Squared deviations above their limit, the largest of the channels.
    excess: [f32; PIXELS],
    /// Sum of weights, the least of the channels: 0 where one was clipped in every frame.
    weight: [f32; PIXELS],
}

/// Merges frames of one format; `source(i)` is frame `i`, none after the last.
pub(super) fn merge<'a, C, const COUNT: usize>(
    source: impl Fn(usize) -> Option<Source<'a, C, COUNT>>,
    out: &mut Merging<'_>,
) where
    C: Copy + Default + Into<usize> + 'a,
{
    let mut planes = Planes { radiance: [[0.0; PIXELS]; 3], excess: [0.0; PIXELS], weight: [0.0; PIXELS] };
    let mut sums = Sums { of: [[[0.0; 4]; PIXELS]; 3], copies: [[C::default(); STRIP]; TOGETHER] };
    for number in 0..out.radiance.len().div_ceil(PIXELS) {
        let (from, mut first) = (number * STRIP, 0);
        while let Some(a) = source(first) {
            let rest = [source(first + 1), source(first + 2), source(first + 3)];
            if first == 0 {
                add_group::<_, _, true>(&a, &rest, from, &mut sums)
            } else {
                add_group::<_, _, false>(&a, &rest, from, &mut sums)
            }
            first += TOGETHER;
        }
        planes.excess.fill(f32::NEG_INFINITY);
        planes.weight.fill(f32::INFINITY);
        for (channel, sums) in sums.of.iter().enumerate() {
            planes.divide(channel, sums, out.per_second, out.least[channel]);
        }
        write(&planes, number * PIXELS, out);
    }
}

/// Adds up to four frames, `FIRST` to nothing.
fn add_group<C, const COUNT: usize, const FIRST: bool>(
    a: &Source<'_, C, COUNT>,
    rest: &[Option<Source<'_, C, COUNT>>; 3],
    from: usize,
    sums: &mut Sums<C>,
) where
    C: Copy + Default + Into<usize>,
{
    match rest {
        [Some(b), Some(c), Some(d)] => add::<_, _, 4, FIRST>([a, b, c, d], from, sums),
        [Some(b), Some(c), None] => add::<_, _, 3, FIRST>([a, b, c], from, sums),
        [Some(b), ..] => add::<_, _, 2, FIRST>([a, b], from, sums),
        _ => add::<_, _, 1, FIRST>([a], from, sums),
    }
}

/// Adds the entries of `N` frames to the sums of the strip that starts at a channel value; `FIRST` forgets those before.
#[inline(always)]
fn add<C, const COUNT: usize, const N: usize, const FIRST: bool>(
    frames: [&Source<'_, C, COUNT>; N],
    from: usize,
    sums: &mut Sums<C>,
) where
    C: Copy + Default + Into<usize>,
{
    let Some(copies) = sums.copies.first_chunk_mut::<N>() else { return };
    let mut sources = frames.iter();
    let codes = copies.each_mut().map(|copy| strip_of(sources.next().map_or(&[], |s| s.codes), from, copy));
    for channel in 0..3 {
        let tables = frames.map(|frame| frame.tables[channel]);
        let (fours, _) = sums.of[channel].as_chunks_mut::<UNROLLED>();
        for (four, sums) in fours.iter_mut().enumerate() {
            for (lane, sum) in sums.iter_mut().enumerate() {
                let at = 3 * (UNROLLED * four + lane) + channel;
                let entry = |i: usize| tables[i][codes[i][at].into()];
                let start = if FIRST { entry(0) } else { plus(*sum, entry(0)) };
                *sum = (1..N).fold(start, |sum, i| plus(sum, entry(i)));
            }
        }
    }
}

#[inline(always)]
fn plus(a: Entry, b: Entry) -> Entry {
    std::array::from_fn(|k| a[k] + b[k])
}

impl Planes {
    /// Radiance = sum of weight x fraction x t / sum of weight x t^2.
    fn divide(&mut self, channel: usize, sums: &[Entry; PIXELS], per_second: f32, least: f32) {
        let radiance = &mut self.radiance[channel];
        for at in 0..PIXELS {
            let [weight, weighted, square, _] = sums[at];
            let mean = weighted / larger(weight, f32::MIN_POSITIVE);
            let excess = square - weighted * mean - LIMIT_BASE;
            radiance[at] = if weight > 0.0 { larger(mean, 0.0) * per_second } else { least };
            self.excess[at] = larger(excess, self.excess[at]);
            self.weight[at] = smaller(weight, self.weight[at]);
        }
    }
}

/// The larger of two numbers, `b` for NaN: one instruction, unlike `f32::max`.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Writes a strip out from a pixel on.
fn write(planes: &Planes, from: usize, out: &mut Merging<'_>) {
    let [red, green, blue] = &planes.radiance;
    let rest = out.radiance[from..].iter_mut();
    for (value, ((r, g), b)) in rest.zip(red.iter().zip(green).zip(blue)) {
        *value = [*r, *g, *b];
    }
    let states = &mut out.state[from..];
    let count = states.len().min(PIXELS);
    states[..count].fill(PixelState::Valid);
    let blocks = planes.excess.chunks(BLOCK).zip(planes.weight.chunks(BLOCK));
    for (number, (states, (excess, weight))) in states[..count].chunks_mut(BLOCK).zip(blocks).enumerate() {
        let pairs = || excess.iter().copied().zip(weight.iter().copied());
        if !pairs().fold(false, |rare, (excess, weight)| rare | (excess > 0.0) | (weight <= 0.0)) {
            continue;
        }
        for (at, (state, (excess, weight))) in states.iter_mut().zip(pairs()).enumerate() {
            if weight <= 0.0 {
                *state = PixelState::Clipped;
            }
            if excess > 0.0 {
                out.suspects.push((from + number * BLOCK + at) as u32);
            }
        }
    }
}

/// The codes of a strip; those of a last one that is short are copied, what follows them does not matter.
fn strip_of<'a, C: Copy + Default>(codes: &'a [C], from: usize, copy: &'a mut [C; STRIP]) -> &'a [C; STRIP] {
    let rest = &codes[from.min(codes.len())..];
    match rest.first_chunk() {
        Some(whole) => whole,
        None => {
            copy[..rest.len()].copy_from_slice(rest);
            copy
        }
    }
}
