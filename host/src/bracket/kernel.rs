//! The merging loop: table entries of up to four frames at a time are added per channel value, then divided.

use super::PixelState;
use super::tables::{Entry, LIMIT_BASE};

/// Pixels and channel values worked on at a time: their sums stay in the nearest cache.
const PIXELS: usize = 256;
const STRIP: usize = 3 * PIXELS;
/// Frames whose tables are read together.
const TOGETHER: usize = 4;

type Strip = [Entry; STRIP];

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

/// Merges frames of one format; `source(i)` is frame `i`, none after the last.
pub(super) fn merge<'a, C, const COUNT: usize>(
    source: impl Fn(usize) -> Option<Source<'a, C, COUNT>>,
    out: &mut Merging<'_>,
) where
    C: Copy + Default + Into<usize> + 'a,
{
    let mut sums: Strip = [[0.0; 4]; STRIP];
    let strips = out.radiance.chunks_mut(PIXELS).zip(out.state.chunks_mut(PIXELS));
    for (number, (radiance, state)) in strips.enumerate() {
        sums.fill([0.0; 4]);
        let (from, mut first) = (number * STRIP, 0);
        while let Some(a) = source(first) {
            match (source(first + 1), source(first + 2), source(first + 3)) {
                (Some(b), Some(c), Some(d)) => add([&a, &b, &c, &d], from, &mut sums),
                (Some(b), Some(c), None) => add([&a, &b, &c], from, &mut sums),
                (Some(b), ..) => add([&a, &b], from, &mut sums),
                _ => add([&a], from, &mut sums),
            }
            first += TOGETHER;
        }
        let found = divide(&sums);
        let first_pixel = (number * PIXELS) as u32;
        for (at, (radiance, state)) in radiance.iter_mut().zip(state).enumerate() {
            let values = [found[3 * at], found[3 * at + 1], found[3 * at + 2]];
            let measured = values.map(|value| value.mean >= 0.0);
            *radiance =
                std::array::from_fn(|k| if measured[k] { values[k].mean * out.per_second } else { out.least[k] });
            *state = if measured == [true; 3] { PixelState::Valid } else { PixelState::Clipped };
            if values.iter().any(|value| value.excess > 0.0) {
                out.suspects.push(first_pixel + at as u32);
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

/// Adds the entries of `N` frames to the sums of the strip that starts at a channel value.
#[inline(always)]
fn add<C, const COUNT: usize, const N: usize>(frames: [&Source<'_, C, COUNT>; N], from: usize, sums: &mut Strip)
where
    C: Copy + Default + Into<usize>,
{
    let mut copies = [[C::default(); STRIP]; N];
    let mut sources = frames.iter();
    let codes = copies.each_mut().map(|copy| strip_of(sources.next().map_or(&[], |s| s.codes), from, copy));
    for channel in 0..3 {
        let tables = frames.map(|frame| frame.tables[channel]);
        for at in (channel..STRIP).step_by(3) {
            let mut sum = sums[at];
            for i in 0..N {
                let entry = tables[i][codes[i][at].into()];
                sum = std::array::from_fn(|k| sum[k] + entry[k]);
            }
            sums[at] = sum;
        }
    }
}

/// A channel value of a strip.
#[derive(Clone, Copy)]
struct Found {
    /// Relative radiance; below 0 where nothing was measured.
    mean: f32,
    /// Squared deviations above their limit.
    excess: f32,
}

/// Radiance = sum of weight x fraction x t / sum of weight x t^2.
fn divide(sums: &Strip) -> [Found; STRIP] {
    std::array::from_fn(|at| {
        let [weight, weighted, square, limit] = sums[at];
        let mean = weighted / weight.max(f32::MIN_POSITIVE);
        let excess = square - weighted * mean - limit - LIMIT_BASE;
        Found { mean: if weight > 0.0 { mean.max(0.0) } else { -1.0 }, excess }
    })
}
