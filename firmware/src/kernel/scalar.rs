//! The normative kernels, in plain integers.

use super::{LINEAR_LIMIT, Projection, RESIDUAL_SHIFT, Reconstruction, ResidualTerm, SUN_SHIFT};
use crate::surface::xrgb;
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

/// See [`super::Kernel::reconstruct`].
pub fn reconstruct(job: &Reconstruction<'_>, out: [&mut [i32]; 3]) {
    let n = job.pixels;
    for (c, out) in out.into_iter().enumerate() {
        for (x, value) in out.iter_mut().enumerate() {
            let mut sum = 0i32;
            for (j, &pair) in job.pairs[c].iter().enumerate() {
                let at = (j * n + x) * 2;
                let (even, odd) = (i32::from(pair as i16), pair >> 16);
                sum = sum.wrapping_add(i32::from(job.u[at] as i8) * even + i32::from(job.u[at + 1] as i8) * odd);
            }
            let at = 2 * (c * n + x);
            let row = i64::from(u16::from_le_bytes([job.rows[at], job.rows[at + 1]]));
            *value = scale(sum, row, job.right[c], job.left[c]);
            if let Some((plane, weight)) = job.sun {
                *value += sun(plane[c * n + x], weight[c]);
            }
        }
    }
}

/// `sum * row`, rounded, shifted right, held in range and shifted left.
fn scale(sum: i32, row: i64, right: u32, left: u32) -> i32 {
    let rounded = (i64::from(sum) * row + (1 << (right - 1))) >> right;
    let limit = LINEAR_LIMIT >> left;
    (rounded as i32).clamp(-limit, limit) << left
}

fn sun(response: u16, weight: u32) -> i32 {
    ((u64::from(response) * u64::from(weight) + (1 << (SUN_SHIFT - 1))) >> SUN_SHIFT) as i32
}

/// See [`super::Kernel::add_residual`].
pub fn add_residual(term: &ResidualTerm<'_>, out: [&mut [i32]; 3]) {
    for (c, out) in out.into_iter().enumerate() {
        for (&code, value) in term.codes[c * term.pixels..].iter().zip(out) {
            *value += (i32::from(code as i8) * term.factor[c] + (1 << (RESIDUAL_SHIFT - 1))) >> RESIDUAL_SHIFT;
        }
    }
}

/// See [`super::Kernel::tone`].
pub fn tone(linear: [&[i32]; 3], out_xrgb: &mut [u32]) {
    for (x, out) in out_xrgb.iter_mut().enumerate() {
        *out = xrgb(linear.map(|plane| tone::code(plane[x])));
    }
}
