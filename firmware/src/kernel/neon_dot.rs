//! NEON with `sdot`: 16-bit factors as two signed bytes, 16 products an instruction. Not on every ARMv8 processor (the
//! Cortex-A72 lacks it). The intrinsics are not stable, hence assembly.

use super::neon::{self, Sums};
use super::{Extent, Linear, Projection, Reconstruction, Shown};
use crate::tile::MAX_RANK;
use crate::weights::MAX_PADDED;
use core::arch::aarch64::*;
use core::mem::MaybeUninit;

/// Largest number of two signed bytes, `256 * high + low`. What is larger takes the way of `smlal`.
const LARGEST: i16 = 256 * 127 + 127;

/// `acc + sum of four products` per lane, all of `b`.
///
/// # Safety
/// The processor must have `sdot`.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn dot(mut acc: int32x4_t, a: int8x16_t, b: int8x16_t) -> int32x4_t {
    // SAFETY: arithmetic in registers; the caller has checked for the instruction.
    unsafe {
        core::arch::asm!(
            ".arch_extension dotprod",
            "sdot {acc:v}.4s, {a:v}.16b, {b:v}.16b",
            acc = inout(vreg) acc, a = in(vreg) a, b = in(vreg) b,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    acc
}

/// `acc + sum of four products` per lane, the four of `b` at `LANE`.
///
/// # Safety
/// The processor must have `sdot`.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn dot_lane<const LANE: usize>(mut acc: int32x4_t, a: int8x16_t, b: int8x16_t) -> int32x4_t {
    // SAFETY: arithmetic in registers; the caller has checked for the instruction.
    unsafe {
        core::arch::asm!(
            ".arch_extension dotprod",
            "sdot {acc:v}.4s, {a:v}.16b, {b:v}.4b[{lane}]",
            acc = inout(vreg) acc, a = in(vreg) a, b = in(vreg) b, lane = const LANE,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    acc
}

/// Low and high bytes of 16 weights.
type Digits = [int8x16_t; 2];

/// # Safety
/// The processor must have `sdot`; lengths as `Kernel::project` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn project(job: &Projection<'_>, out: &mut [i32]) {
    let mut digits = [const { MaybeUninit::<Digits>::uninit() }; MAX_PADDED / 16];
    let mut largest = vdupq_n_s16(0);
    for (&block, digits) in job.lit_blocks.iter().zip(&mut digits) {
        // SAFETY: every block lies in the weights.
        let w = unsafe { vld1q_s16_x2(job.weights.as_ptr().add(usize::from(block) * 16)) };
        largest = vmaxq_s16(largest, vmaxq_s16(w.0, w.1));
        let low = vmovn_high_s16(vmovn_s16(w.0), w.1);
        digits.write([low, vrshrn_high_n_s16::<8>(vrshrn_n_s16::<8>(w.0), w.1)]);
    }
    let blocks = job.lit_blocks.len();
    if vmaxvq_s16(largest) > LARGEST || blocks > digits.len() {
        // SAFETY: as the caller promises.
        return unsafe { neon::project(job, out) };
    }
    // SAFETY: the digits of all lit blocks were written.
    let digits = unsafe { digits[..blocks].assume_init_ref() };
    let mut pairs = out.chunks_exact_mut(2);
    let mut k = 0;
    for sums in &mut pairs {
        // SAFETY: V holds out.len() rows, and k + 2 <= out.len().
        sums.copy_from_slice(&unsafe { rows::<2>(job, digits, k) });
        k += 2;
    }
    for sum in pairs.into_remainder() {
        // SAFETY: as above, for one row.
        [*sum] = unsafe { rows::<1>(job, digits, k) };
    }
}

/// Sums of the rows from `k` on.
///
/// # Safety
/// The processor must have `sdot`; V holds the rows.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn rows<const ROWS: usize>(job: &Projection<'_>, digits: &[Digits], k: usize) -> [i32; ROWS] {
    let stride = job.weights.len();
    let mut acc = [[vdupq_n_s32(0); 2]; ROWS];
    for (&block, digits) in job.lit_blocks.iter().zip(digits) {
        for (row, acc) in acc.iter_mut().enumerate() {
            // SAFETY: V holds the rows, of `stride` bytes each, and every block lies in a row.
            unsafe {
                let v = vld1q_s8(job.v.as_ptr().add((k + row) * stride + usize::from(block) * 16).cast());
                acc[0] = dot(acc[0], v, digits[0]);
                acc[1] = dot(acc[1], v, digits[1]);
            }
        }
    }
    acc.map(|[low, high]| vaddvq_s32(vaddq_s32(low, vshlq_n_s32::<8>(high))))
}

/// Four coefficients of each channel: low and high bytes of R, of G, of B, and nothing.
type Quad = [[i8; 4]; 8];

/// # Safety
/// The processor must have `sdot`; lengths as `Kernel::relight` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn relight(job: &Reconstruction<'_>, linear: Linear<'_>, shown: Option<Shown<'_>>) -> Extent {
    let mut quads = [const { MaybeUninit::uninit() }; MAX_RANK / 4];
    match split(job, &mut quads) {
        // SAFETY: as the caller promises.
        Some(quads) => unsafe { neon::relight_by(job, linear, shown, |x| sums(job, quads, x)) },
        // SAFETY: as the caller promises.
        None => unsafe { neon::relight(job, linear, shown) },
    }
}

/// The coefficients' bytes. `None`: too many coefficients, or one is too large.
fn split<'q>(job: &Reconstruction<'_>, quads: &'q mut [MaybeUninit<Quad>; MAX_RANK / 4]) -> Option<&'q [Quad]> {
    let count = job.pairs[0].len().div_ceil(2);
    let mut fits = count <= quads.len();
    for (at, quad) in quads.iter_mut().enumerate().take(count) {
        let mut bytes = [[0; 4]; 8];
        for (c, pairs) in job.pairs.iter().enumerate() {
            for (k, &pair) in pairs[2 * at..].iter().take(2).enumerate() {
                for (odd, q) in [pair as i16, (pair >> 16) as i16].into_iter().enumerate() {
                    fits &= q <= LARGEST;
                    bytes[2 * c][2 * k + odd] = q as i8;
                    bytes[2 * c + 1][2 * k + odd] = (q.wrapping_add(128) >> 8) as i8;
                }
            }
        }
        quad.write(bytes);
    }
    // SAFETY: the first `count` were written.
    fits.then(|| unsafe { quads[..count].assume_init_ref() })
}

/// Integer sums of the eight pixels from `x` on.
///
/// # Safety
/// The processor must have `sdot`; lengths as `Kernel::relight` checks them, `x + 8 <= job.pixels`.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn sums(job: &Reconstruction<'_>, quads: &[Quad], x: usize) -> Sums {
    let (pairs, n) = (job.pairs[0].len(), job.pixels);
    let mut low = [[vdupq_n_s32(0); 2]; 3];
    let mut high = low;
    for (at, quad) in quads.iter().enumerate() {
        // SAFETY: plane j < pairs of U holds n pairs, x + 8 <= n; a quad is 32 bytes; the instruction is there.
        unsafe {
            let plane = |j: usize| vld1q_s16(job.u.as_ptr().add((j * n + x) * 2).cast());
            let first = plane(2 * at);
            let second = if 2 * at + 1 < pairs { plane(2 * at + 1) } else { vdupq_n_s16(0) };
            let u = [vreinterpretq_s8_s16(vzip1q_s16(first, second)), vreinterpretq_s8_s16(vzip2q_s16(first, second))];
            let q = [vld1q_s8(quad[0].as_ptr()), vld1q_s8(quad[4].as_ptr())];
            for (half, u) in u.into_iter().enumerate() {
                low[0][half] = dot_lane::<0>(low[0][half], u, q[0]);
                high[0][half] = dot_lane::<1>(high[0][half], u, q[0]);
                low[1][half] = dot_lane::<2>(low[1][half], u, q[0]);
                high[1][half] = dot_lane::<3>(high[1][half], u, q[0]);
                low[2][half] = dot_lane::<0>(low[2][half], u, q[1]);
                high[2][half] = dot_lane::<1>(high[2][half], u, q[1]);
            }
        }
    }
    let whole = |low: int32x4_t, high: int32x4_t| vaddq_s32(low, vshlq_n_s32::<8>(high));
    [0, 1, 2].map(|c| [whole(low[c][0], high[c][0]), whole(low[c][1], high[c][1])])
}
