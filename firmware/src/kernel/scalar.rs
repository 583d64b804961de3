//! The normative kernels: integer sums, then single precision step by step.

use super::{Extent, Linear, Projection, Reconstruction, Shown};
use crate::surface::xrgb;
use crate::tile::TILE_PX;
use crate::tone;

/// See [`super::Kernel::project`].
pub fn project(job: &Projection<'_>, out: &mut [i32]) {
    let stride = job.weights.len();
    for (row, sum) in job.v.chunks_exact(stride).zip(out) {
        *sum = 0;
        for &block in job.lit_blocks {
            let at = usize::from(block) * 16;
            for (&v, &w) in row[at..at + 16].iter().zip(&job.weights[at..at + 16]) {
                *sum = sum.wrapping_add(i32::from(v as i8) * i32::from(w));
            }
        }
    }
}

/// See [`super::Kernel::relight`].
pub fn relight(job: &Reconstruction<'_>, mut linear: Linear<'_>, mut shown: Option<Shown<'_>>) -> Extent {
    let mut extent = Extent::EMPTY;
    for x in 0..job.pixels {
        let mut rgb = [0.0; 3];
        for (c, shown) in rgb.iter_mut().enumerate() {
            let (value, row) = value(job, c, x);
            *shown = match &mut linear {
                Linear::Skip => value,
                Linear::Write(planes) => {
                    planes[c][x] = value;
                    value
                }
                Linear::Add(planes) => {
                    planes[c][x] += value;
                    planes[c][x]
                }
            };
            let log = (shown.to_bits() as i32).max(0) - row.to_bits() as i32;
            extent.faintest_log[c] = extent.faintest_log[c].min(log);
        }
        if x < job.covered {
            let logs = extent.smallest_log.iter_mut().zip(rgb);
            logs.for_each(|(log, value)| *log = (*log).min(tone::log16(value)));
        }
        if let Some(shown) = &mut shown {
            shown.pixels_xrgb[x / TILE_PX * shown.stride + x % TILE_PX] = xrgb(rgb.map(tone::code));
        }
    }
    extent
}

/// `(sum * row) * unit + response * weight`, each operation rounded by itself, and the row scale.
fn value(job: &Reconstruction<'_>, c: usize, x: usize) -> (f32, f32) {
    let n = job.pixels;
    let mut sum = 0i32;
    for (j, &pair) in job.pairs[c].iter().enumerate() {
        let at = (j * n + x) * 2;
        let (even, odd) = (i32::from(pair as i16), pair >> 16);
        sum = sum.wrapping_add(i32::from(job.u[at] as i8) * even + i32::from(job.u[at + 1] as i8) * odd);
    }
    let at = 2 * (c * n + x);
    let row = f32::from(u16::from_le_bytes([job.rows[at], job.rows[at + 1]]));
    let value = sum as f32 * row * job.unit[c];
    (job.sun.map_or(value, |(plane, weight)| value + f32::from(plane[c * n + x]) * weight[c]), row)
}

/// See [`super::Kernel::tone`].
pub fn tone(linear: [&[f32]; 3], out_xrgb: &mut [u32]) {
    for (x, out) in out_xrgb.iter_mut().enumerate() {
        *out = xrgb(linear.map(|plane| tone::code(plane[x])));
    }
}
