//! NEON (`smlal`): 16 patches, or 8 pixels, per step. Part of the aarch64 baseline.

use super::{LINEAR_LIMIT, Projection, RESIDUAL_SHIFT, Reconstruction, ResidualTerm, SUN_SHIFT};
use crate::relight::LINEAR_BITS;
use crate::tone::{CURVE, LINEAR_SLOPE, LINEAR_UNTIL};
use core::arch::aarch64::*;

/// # Safety
/// Lengths as `Kernel::project` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn project(job: &Projection<'_>, out: &mut [i32]) {
    let stride = job.weights.len();
    for (k, sum) in out.iter_mut().enumerate() {
        let mut acc = [vdupq_n_s32(0); 2];
        for &block in job.lit_blocks {
            let at = usize::from(block) * 16;
            // SAFETY: at + 16 <= stride, and V holds out.len() rows of stride bytes.
            let (v, w) = unsafe {
                (vld1q_s8(job.v.as_ptr().add(k * stride + at).cast()), vld1q_s16_x2(job.weights.as_ptr().add(at)))
            };
            let (low, high) = (vmovl_s8(vget_low_s8(v)), vmovl_high_s8(v));
            acc[0] = vmlal_s16(acc[0], vget_low_s16(low), vget_low_s16(w.0));
            acc[1] = vmlal_high_s16(acc[1], low, w.0);
            acc[0] = vmlal_s16(acc[0], vget_low_s16(high), vget_low_s16(w.1));
            acc[1] = vmlal_high_s16(acc[1], high, w.1);
        }
        *sum = vaddvq_s32(vaddq_s32(acc[0], acc[1]));
    }
}

/// # Safety
/// Lengths as `Kernel::reconstruct` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn reconstruct(job: &Reconstruction<'_>, out: [&mut [i32]; 3]) {
    let n = job.pixels;
    let [out_r, out_g, out_b] = out;
    let out = [out_r.as_mut_ptr(), out_g.as_mut_ptr(), out_b.as_mut_ptr()];
    for x in (0..n).step_by(8) {
        let mut acc = [[vdupq_n_s32(0); 2]; 3];
        for j in 0..job.pairs[0].len() {
            // SAFETY: (j * n + x) * 2 + 16 <= pairs * n * 2 <= u.len().
            let u = unsafe { vld2_s8(job.u.as_ptr().add((j * n + x) * 2).cast()) };
            let (even, odd) = (vmovl_s8(u.0), vmovl_s8(u.1));
            for (acc, pairs) in acc.iter_mut().zip(&job.pairs) {
                // SAFETY: the three slices have the same length.
                let pair = unsafe { *pairs.get_unchecked(j) };
                let (q_even, q_odd) = (pair as i16, (pair >> 16) as i16);
                acc[0] = vmlal_n_s16(acc[0], vget_low_s16(even), q_even);
                acc[1] = vmlal_high_n_s16(acc[1], even, q_even);
                acc[0] = vmlal_n_s16(acc[0], vget_low_s16(odd), q_odd);
                acc[1] = vmlal_high_n_s16(acc[1], odd, q_odd);
            }
        }
        for c in 0..3 {
            let at = c * n + x;
            // SAFETY: rows holds 3 n u16, the sun's plane 3 n u16, each output n i32, and x + 8 <= n.
            unsafe {
                let rows = vreinterpretq_u16_u8(vld1q_u8(job.rows.as_ptr().add(2 * at)));
                let rows = [vmovl_u16(vget_low_u16(rows)), vmovl_high_u16(rows)];
                let mut value = [
                    scale(acc[c][0], rows[0], job.right[c], job.left[c]),
                    scale(acc[c][1], rows[1], job.right[c], job.left[c]),
                ];
                if let Some((plane, weight)) = job.sun {
                    let response = vld1q_u16(plane.as_ptr().add(at));
                    value[0] = vaddq_s32(value[0], sun(vmovl_u16(vget_low_u16(response)), weight[c]));
                    value[1] = vaddq_s32(value[1], sun(vmovl_high_u16(response), weight[c]));
                }
                vst1q_s32(out[c].add(x), value[0]);
                vst1q_s32(out[c].add(x + 4), value[1]);
            }
        }
    }
}

/// The scalar path's `scale`: `vrshl` by a negative count is a rounding shift right.
#[target_feature(enable = "neon")]
fn scale(sum: int32x4_t, row: uint32x4_t, right: u32, left: u32) -> int32x4_t {
    let row = vreinterpretq_s32_u32(row);
    let count = vdupq_n_s64(-i64::from(right));
    let low = vrshlq_s64(vmull_s32(vget_low_s32(sum), vget_low_s32(row)), count);
    let high = vrshlq_s64(vmull_high_s32(sum, row), count);
    let value = vcombine_s32(vmovn_s64(low), vmovn_s64(high));
    let limit = LINEAR_LIMIT >> left;
    let value = vmaxq_s32(vminq_s32(value, vdupq_n_s32(limit)), vdupq_n_s32(-limit));
    vshlq_s32(value, vdupq_n_s32(left as i32))
}

#[target_feature(enable = "neon")]
fn sun(response: uint32x4_t, weight: u32) -> int32x4_t {
    const SHIFT: i32 = SUN_SHIFT as i32;
    let weight = vdup_n_u32(weight);
    let low = vrshrn_n_u64::<SHIFT>(vmull_u32(vget_low_u32(response), weight));
    let high = vrshrn_n_u64::<SHIFT>(vmull_u32(vget_high_u32(response), weight));
    vreinterpretq_s32_u32(vcombine_u32(low, high))
}

/// # Safety
/// Lengths as `Kernel::add_residual` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn add_residual(term: &ResidualTerm<'_>, out: [&mut [i32]; 3]) {
    const SHIFT: i32 = RESIDUAL_SHIFT as i32;
    let n = term.pixels;
    for (c, out) in out.into_iter().enumerate() {
        for x in (0..n).step_by(8) {
            // SAFETY: the codes hold 3 n bytes, the output n i32, and x + 8 <= n.
            unsafe {
                let codes = vmovl_s8(vld1_s8(term.codes.as_ptr().add(c * n + x).cast()));
                let low = vmulq_n_s32(vmovl_s16(vget_low_s16(codes)), term.factor[c]);
                let high = vmulq_n_s32(vmovl_high_s16(codes), term.factor[c]);
                let at = out.as_mut_ptr().add(x);
                vst1q_s32(at, vaddq_s32(vld1q_s32(at), vrshrq_n_s32::<SHIFT>(low)));
                vst1q_s32(at.add(4), vaddq_s32(vld1q_s32(at.add(4)), vrshrq_n_s32::<SHIFT>(high)));
            }
        }
    }
}

/// # Safety
/// Lengths as `Kernel::tone` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn tone(linear: [&[i32]; 3], out_xrgb: &mut [u32]) {
    for x in (0..out_xrgb.len()).step_by(4) {
        // SAFETY: the planes and the output have the same length, a multiple of 8.
        let [r, g, b] = linear.map(|plane| unsafe { codes(vld1q_s32(plane.as_ptr().add(x))) });
        let word = vorrq_u32(vorrq_u32(vshlq_n_u32::<16>(r), vshlq_n_u32::<8>(g)), b);
        // SAFETY: as above.
        unsafe { vst1q_u32(out_xrgb.as_mut_ptr().add(x), word) };
    }
}

/// [`crate::tone::code`], step by step in the same order; no fused multiply-add, which would round once less.
#[target_feature(enable = "neon")]
fn codes(linear: int32x4_t) -> uint32x4_t {
    let held = vmaxq_s32(vminq_s32(linear, vdupq_n_s32(1 << LINEAR_BITS)), vdupq_n_s32(0));
    let x = vmulq_n_f32(vcvtq_f32_s32(held), 1.0 / (1 << LINEAR_BITS) as f32);
    let t = vsqrtq_f32(vsqrtq_f32(x));
    let mut bright = vdupq_n_f32(CURVE[0]);
    for &coefficient in &CURVE[1..] {
        bright = vaddq_f32(vmulq_f32(bright, t), vdupq_n_f32(coefficient));
    }
    let dark = vmulq_n_f32(x, LINEAR_SLOPE);
    let code = vbslq_f32(vcleq_f32(x, vdupq_n_f32(LINEAR_UNTIL)), dark, bright);
    vcvtq_u32_f32(vaddq_f32(code, vdupq_n_f32(0.5)))
}

/// See [`super::Kernel::prefetch`].
pub fn prefetch(bytes: &[u8]) {
    for line in bytes.chunks(64) {
        // SAFETY: a prefetch reads nothing that the program can see, and the address lies in the slice.
        unsafe {
            core::arch::asm!("prfm pldl1keep, [{0}]", in(reg) line.as_ptr(), options(nostack, readonly, preserves_flags));
        }
    }
}
