//! The dense sum in whole numbers: per pixel and channel one row of int8 with a scale of its own, times 16-bit weights.
//!
//! |row| <= 127, |weight| <= 32767 and at most 512 patches keep every sum below 2^31. The sun has a column of f32 apart:
//! beside its response the patches' would vanish in the row's scale.
#![allow(unsafe_code)]

use std::sync::Arc;

use super::arena::{Arena, Window};
use super::columns::{Blocks, Columns, USUAL_BLOCK_PX};
use super::rival::Summation;
use crate::weights::PatchWeights;

/// Name in reports.
pub const INT8_NAME: &str = "dense_int8";
/// Rows are filled up with zeros to a multiple of this.
const ROW_ALIGN: usize = 32;
/// Most patches: 512 x 127 x 32767 < 2^31.
pub const MAX_PATCHES: usize = 512;

/// The dense int8 sum.
pub struct Int8 {
    /// `cols` is the padded length of a row; a block holds `[channel][pixel][col]`.
    blocks: Blocks,
    rows: Window,
    /// Per block `[channel][pixel]`.
    scales: Vec<f32>,
    /// The same for the sun; empty without one.
    sun: Vec<f32>,
    patches: usize,
    weights: [Vec<i16>; 3],
    unit: [f32; 3],
    sun_weight: Option<[f32; 3]>,
    dot: Dot,
}

impl Int8 {
    /// Rounds dense columns, of which `patches` are patches and one more may be the sun's.
    ///
    /// # Errors
    /// When the memory cannot be had or there are too many patches.
    pub fn new(dense: &Columns, patches: usize) -> anyhow::Result<Self> {
        anyhow::ensure!(patches <= MAX_PATCHES, "{patches} patches; the sums of at most {MAX_PATCHES} fit 32 bits");
        let from = dense.blocks();
        let blocks = Blocks { cols: patches.next_multiple_of(ROW_ALIGN), block_px: USUAL_BLOCK_PX, ..from };
        let mut rows = Window::own(blocks.len())?;
        let per_row = 3 * blocks.pixels;
        let (mut scales, mut sun) = (vec![0.0; per_row], vec![0.0; if from.cols > patches { per_row } else { 0 }]);
        if let Some(arena) = rows.arena_mut() {
            let codes: &mut [i8] = bytemuck::cast_slice_mut(arena.values_mut());
            for_each_row(dense, &blocks, |at, row| {
                scales[at] = round_row(&row[..patches], &mut codes[at * blocks.cols..][..patches]);
                if let (Some(to), Some(value)) = (sun.get_mut(at), row.get(patches)) {
                    *to = *value;
                }
            });
        }
        let weights = [0, 1, 2].map(|_| vec![0; blocks.cols]);
        Ok(Int8 { blocks, rows, scales, sun, patches, weights, unit: [0.0; 3], sun_weight: None, dot: fastest_dot() })
    }
}

/// Hands every row (pixel and channel) of `dense` to `take`, with its place among the rows of `blocks`.
fn for_each_row(dense: &Columns, blocks: &Blocks, mut take: impl FnMut(usize, &[f32])) {
    let from = dense.blocks();
    let mut row = vec![0.0; from.cols];
    for (block, channel) in (0..from.count()).flat_map(|block| (0..3).map(move |c| (block, c))) {
        let (pixels, columns) = (from.range(block), dense.block(block, channel));
        for (k, pixel) in pixels.clone().enumerate() {
            row.iter_mut().enumerate().for_each(|(col, to)| *to = columns[col * pixels.len() + k]);
            let own = blocks.range(pixel / blocks.block_px);
            take(3 * own.start + channel * own.len() + (pixel - own.start), &row);
        }
    }
}

/// Rounds to int8 by the largest value; returns the scale.
fn round_row(row: &[f32], codes: &mut [i8]) -> f32 {
    let scale = row.iter().fold(0.0f32, |most, v| most.max(v.abs())) / 127.0;
    if scale > 0.0 {
        codes.iter_mut().zip(row).for_each(|(code, v)| *code = (v / scale).round() as i8);
    }
    scale
}

/// `out[x] = (rows[x] . weights) * unit * scales[x]`; rows and weights are a multiple of [`ROW_ALIGN`] long.
type Dot = fn(&[u8], &[i16], &[f32], f32, &mut [f32]);

fn dot_portable(rows: &[u8], weights: &[i16], scales: &[f32], unit: f32, out: &mut [f32]) {
    for ((row, scale), out) in rows.chunks_exact(weights.len()).zip(scales).zip(out) {
        let sum: i32 = row.iter().zip(weights).map(|(&r, &w)| i32::from(r as i8) * i32::from(w)).sum();
        *out = sum as f32 * (unit * scale);
    }
}

/// The fastest path of this processor.
fn fastest_dot() -> Dot {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return |rows, weights, scales, unit, out| unsafe { avx2::dot(rows, weights, scales, unit, out) };
    }
    dot_portable
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    /// Four rows at a time share the loads of the weights.
    #[target_feature(enable = "avx2")]
    pub fn dot(rows: &[u8], weights: &[i16], scales: &[f32], unit: f32, out: &mut [f32]) {
        let stride = weights.len();
        let fours = rows.chunks(4 * stride).zip(scales.chunks(4)).zip(out.chunks_mut(4));
        for ((rows, scales), out) in fours {
            if out.len() < 4 || scales.len() < 4 || rows.len() < 4 * stride {
                super::dot_portable(rows, weights, scales, unit, out);
                continue;
            }
            let mut sums = [_mm256_setzero_si256(); 4];
            for at in (0..stride / 16 * 16).step_by(16) {
                // SAFETY: at + 16 <= stride weights of two bytes.
                let w = unsafe { _mm256_loadu_si256(weights.as_ptr().add(at).cast()) };
                for (k, sum) in sums.iter_mut().enumerate() {
                    // SAFETY: k < 4 and at + 16 <= stride, in 4 * stride bytes.
                    let r = unsafe { _mm_loadu_si128(rows.as_ptr().add(k * stride + at).cast()) };
                    *sum = _mm256_add_epi32(*sum, _mm256_madd_epi16(_mm256_cvtepi8_epi16(r), w));
                }
            }
            for k in 0..4 {
                out[k] = total(sums[k]) as f32 * (unit * scales[k]);
            }
        }
    }

    #[target_feature(enable = "avx2")]
    fn total(lanes: __m256i) -> i32 {
        let four = _mm_add_epi32(_mm256_castsi256_si128(lanes), _mm256_extracti128_si256::<1>(lanes));
        let two = _mm_add_epi32(four, _mm_shuffle_epi32::<0b00_00_11_10>(four));
        _mm_cvtsi128_si32(_mm_add_epi32(two, _mm_shuffle_epi32::<1>(two)))
    }
}

impl Summation for Int8 {
    fn name(&self) -> &'static str {
        INT8_NAME
    }

    fn budget(&self) -> Option<String> {
        None
    }

    fn blocks(&self) -> Blocks {
        self.blocks
    }

    fn project(&mut self, weights: &PatchWeights, scale: f32) {
        for c in 0..3 {
            let most = weights.radiance.iter().fold(0.0f32, |most, rgb| most.max(rgb[c]));
            let to_q15 = if most > 0.0 { 32767.0 / most } else { 0.0 };
            let rounded = weights.radiance.iter().map(|rgb| (rgb[c] * to_q15).round() as i16);
            self.weights[c].iter_mut().zip(rounded.take(self.patches)).for_each(|(to, w)| *to = w);
            self.unit[c] = most / 32767.0 * scale;
        }
        self.sun_weight = weights.sun.map(|sun| sun.irradiance.map(|v| v * scale));
    }

    fn sum(&self, block: usize, out: [&mut [f32]; 3]) {
        let pixels = self.blocks.range(block);
        for (c, out) in out.into_iter().enumerate() {
            let rows = &self.rows.bytes()[self.blocks.place(block, c)];
            let at = 3 * pixels.start + c * pixels.len();
            (self.dot)(rows, &self.weights[c], &self.scales[at..at + pixels.len()], self.unit[c], out);
            if let (Some(weight), Some(sun)) = (self.sun_weight, self.sun.get(at..at + pixels.len())) {
                out.iter_mut().zip(sun).for_each(|(out, response)| *out += weight[c] * response);
            }
        }
    }

    fn bytes_read(&self, sun: bool) -> usize {
        let apart = if sun { self.scales.len() + self.sun.len() } else { self.scales.len() };
        self.blocks.len() + apart * size_of::<f32>()
    }

    fn move_on(&mut self) {
        self.rows.move_on();
    }

    fn wander(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()> {
        self.rows.wander(arena)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_path_gives_the_whole_number_sum_at_its_largest() {
        let (cols, count) = (MAX_PATCHES, 7);
        let rows: Vec<u8> = (0..count * cols).map(|k| [127i8, -127, (k % 200) as i8][k / cols % 3] as u8).collect();
        let weights: Vec<i16> = (0..cols).map(|i| if i < 500 { 32767 } else { i as i16 }).collect();
        let scales: Vec<f32> = (1..=count).map(|x| x as f32).collect();
        let row = |x: usize| rows[x * cols..][..cols].iter().zip(&weights);
        let exact: Vec<f32> = (0..count)
            .map(|x| row(x).map(|(&r, &w)| i64::from(r as i8) * i64::from(w)).sum::<i64>() as f32 * (0.5 * scales[x]))
            .collect();
        for dot in [dot_portable, fastest_dot()] {
            let mut out = vec![0.0; count];
            dot(&rows, &weights, &scales, 0.5, &mut out);
            assert_eq!(out, exact);
        }
    }

    #[test]
    fn a_row_is_rounded_by_its_largest_value() {
        let mut codes = [0; 3];
        assert_eq!(round_row(&[0.5, -2.54, 1.27], &mut codes), 0.02);
        assert_eq!(codes, [25, -127, 64]);
        assert_eq!(round_row(&[0.0; 3], &mut codes), 0.0);
    }
}
