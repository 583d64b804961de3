//! NEON (`smlal`): 16 patches, or 16 pixels, per step. Part of the aarch64 baseline.

use super::job::planes;
use super::{Extent, Linear, Projection, Reconstruction, Shown};
use crate::tone::{CODE_SHIFT, CUBICS, CubicBytes, LOG_BIAS, LOG_SHIFT};
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

/// Eight pixels of a channel.
type Pixels = [float32x4_t; 2];
/// Sums of eight pixels, per channel.
pub type Sums = [[int32x4_t; 2]; 3];

/// # Safety
/// Lengths as `Kernel::relight` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn relight(job: &Reconstruction<'_>, linear: Linear<'_>, shown: Option<Shown<'_>>) -> Extent {
    // SAFETY: as the caller promises.
    unsafe { relight_by(job, linear, shown, |x| sums(job, x)) }
}

/// The same with the integer sums of the eight pixels from a pixel on given by `sums`.
///
/// # Safety
/// Lengths as `Kernel::relight` checks them.
#[target_feature(enable = "neon")]
#[inline]
pub unsafe fn relight_by(
    job: &Reconstruction<'_>,
    linear: Linear<'_>,
    shown: Option<Shown<'_>>,
    sums: impl Fn(usize) -> Sums,
) -> Extent {
    let (out, stride) = shown.map_or((core::ptr::null_mut(), 0), |s| (s.pixels_xrgb.as_mut_ptr(), s.stride));
    let (planes, adds) = planes(linear);
    let mut smallest = [vdupq_n_u16(u16::MAX); 3];
    let mut faintest = [vdupq_n_s32(i32::MAX); 3];
    for x in (0..job.pixels).step_by(16) {
        let mut logs = [[vdupq_n_u16(0); 2]; 3];
        for half in 0..2 {
            let x = x + 8 * half;
            let sums = sums(x);
            let others = lanes_from(job.covered.saturating_sub(x));
            for c in 0..3 {
                // SAFETY: x + 8 <= job.pixels.
                let value = unsafe { values(job, (x, c), sums[c], planes.filter(|_| adds), &mut faintest[c]) };
                if let Some(planes) = planes {
                    // SAFETY: the planes hold job.pixels values.
                    unsafe {
                        vst1q_f32(planes[c].add(x), value[0]);
                        vst1q_f32(planes[c].add(x + 4), value[1]);
                    }
                }
                let log = log16(value);
                logs[c][half] = log;
                smallest[c] = vminq_u16(smallest[c], vmaxq_u16(log, others));
            }
        }
        if !out.is_null() {
            // SAFETY: block x/16 begins `stride` words after the one before, and holds 16.
            unsafe { show(logs, out.add(x / 16 * stride)) };
        }
    }
    Extent { smallest_log: smallest.map(|v| vminvq_u16(v)), faintest_log: faintest.map(|v| vminvq_s32(v)) }
}

/// Integer sums of the eight pixels from `x` on. Even and odd ranks stay in lanes of their own until the end.
///
/// # Safety
/// Lengths as `Kernel::relight` checks them, `x + 8 <= job.pixels`.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn sums(job: &Reconstruction<'_>, x: usize) -> Sums {
    let count = job.pairs[0].len();
    if count == 0 {
        return [[vdupq_n_s32(0); 2]; 3];
    }
    // SAFETY: (j * n + x) * 2 + 16 <= pairs * n * 2 <= u.len() for j < pairs, and the three slices of pairs have the
    // same length.
    let load = |j: usize| unsafe {
        let u = vld1q_s8(job.u.as_ptr().add((j * job.pixels + x) * 2).cast());
        ([vmovl_s8(vget_low_s8(u)), vmovl_high_s8(u)], job.pairs.map(|pairs| all_lanes(pairs.as_ptr().add(j))))
    };
    let (u, pairs) = load(0);
    let first =
        |u: int16x8_t, pair: int16x8_t| [vmull_s16(vget_low_s16(u), vget_low_s16(pair)), vmull_high_s16(u, pair)];
    let mut sums = pairs.map(|pair| [first(u[0], pair), first(u[1], pair)]);
    for j in 1..count {
        let (u, pairs) = load(j);
        for (sums, pair) in sums.iter_mut().zip(pairs) {
            for (sums, u) in sums.iter_mut().zip(u) {
                sums[0] = vmlal_s16(sums[0], vget_low_s16(u), vget_low_s16(pair));
                sums[1] = vmlal_high_s16(sums[1], u, pair);
            }
        }
    }
    sums.map(|sums| sums.map(|[low, high]| vpaddq_s32(low, high)))
}

/// Eight pixels of channel `c` from `x` on, by the scalar path's `value`; no fused multiply-add, which rounds once less.
/// With what `added` holds. Takes their logarithms over the row scales into `faintest`.
///
/// # Safety
/// Lengths as `Kernel::relight` checks them, `x + 8 <= job.pixels`; `added`: job.pixels values each.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn values(
    job: &Reconstruction<'_>,
    (x, c): (usize, usize),
    sums: [int32x4_t; 2],
    added: Option<[*mut f32; 3]>,
    faintest: &mut int32x4_t,
) -> Pixels {
    let at = c * job.pixels + x;
    // SAFETY: rows and the sun's plane hold 3 n u16.
    unsafe {
        let rows = floats(vreinterpretq_u16_u8(vld1q_u8(job.rows.as_ptr().add(2 * at))));
        let patches = |half: usize| vmulq_n_f32(vmulq_f32(vcvtq_f32_s32(sums[half]), rows[half]), job.unit[c]);
        let mut value = [patches(0), patches(1)];
        if let Some((plane, weight)) = job.sun {
            let response = floats(vld1q_u16(plane.as_ptr().add(at)));
            let lit = |half: usize| vaddq_f32(value[half], vmulq_n_f32(response[half], weight[c]));
            value = [lit(0), lit(1)];
        }
        if let Some(added) = added {
            let add = |half: usize| vaddq_f32(vld1q_f32(added[c].add(x + 4 * half)), value[half]);
            value = [add(0), add(1)];
        }
        for half in 0..2 {
            let bits = vmaxq_s32(vreinterpretq_s32_f32(value[half]), vdupq_n_s32(0));
            *faintest = vminq_s32(*faintest, vsubq_s32(bits, vreinterpretq_s32_f32(rows[half])));
        }
        value
    }
}

#[target_feature(enable = "neon")]
#[inline]
fn floats(values: uint16x8_t) -> Pixels {
    [vcvtq_f32_u32(vmovl_u16(vget_low_u16(values))), vcvtq_f32_u32(vmovl_high_u16(values))]
}

/// All bits of the lanes from `count` on.
#[target_feature(enable = "neon")]
#[inline]
fn lanes_from(count: usize) -> uint16x8_t {
    const LANES: [u16; 8] = [0, 1, 2, 3, 4, 5, 6, 7];
    // SAFETY: eight u16.
    vcgeq_u16(unsafe { vld1q_u16(LANES.as_ptr()) }, vdupq_n_u16(count as u16))
}

/// One pair in all lanes. Assembly, because the compiler must not see that all lanes are alike: it would then take the
/// other factor's upper half out by an instruction of its own, where `smlal2` needs none.
///
/// # Safety
/// An i32 at `pair`.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn all_lanes(pair: *const i32) -> int16x8_t {
    let lanes;
    // SAFETY: reads one i32, which the caller vouches for.
    unsafe {
        core::arch::asm!(
            "ld1r {{ {lanes:v}.4s }}, [{pair}]",
            lanes = lateout(vreg) lanes, pair = in(reg) pair,
            options(pure, readonly, nostack, preserves_flags)
        );
    }
    lanes
}

/// # Safety
/// Lengths as `Kernel::tone` checks them.
#[target_feature(enable = "neon")]
pub unsafe fn tone(linear: [&[f32]; 3], out_xrgb: &mut [u32]) {
    for x in (0..out_xrgb.len()).step_by(16) {
        // SAFETY: the planes and the output have the same length, a multiple of 16.
        unsafe {
            let eight = |at: *const f32| log16([vld1q_f32(at), vld1q_f32(at.add(4))]);
            let logs = linear.map(|plane| {
                let at = plane.as_ptr().add(x);
                [eight(at), eight(at.add(8))]
            });
            show(logs, out_xrgb.as_mut_ptr().add(x));
        }
    }
}

/// The scalar path's `log16`. Subtracting saturates, so that no negative float wraps; narrowing saturates to 0..=65535.
#[target_feature(enable = "neon")]
#[inline]
fn log16(value: Pixels) -> uint16x8_t {
    let above = |v: float32x4_t| vqsubq_s32(vreinterpretq_s32_f32(v), vdupq_n_s32(LOG_BIAS << LOG_SHIFT));
    vqshrun_high_n_s32::<LOG_SHIFT>(vqshrun_n_s32::<LOG_SHIFT>(above(value[0])), above(value[1]))
}

/// Sixteen pixels as 0x00RRGGBB, of their logarithms.
///
/// # Safety
/// Room for 16 words at `out`.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn show(logs: [[uint16x8_t; 2]; 3], out: *mut u32) {
    // SAFETY: as the caller promises.
    unsafe { write(logs.map(|logs| codes(logs)), out) }
}

/// Sixteen pixels' codes as 0x00RRGGBB.
///
/// # Safety
/// Room for 16 words at `out`.
#[target_feature(enable = "neon")]
#[inline]
pub(super) unsafe fn write([r, g, b]: [uint8x16_t; 3], out: *mut u32) {
    let gb = [vreinterpretq_u16_u8(vzip1q_u8(b, g)), vreinterpretq_u16_u8(vzip2q_u8(b, g))];
    let r = [vmovl_u8(vget_low_u8(r)), vmovl_high_u8(r)];
    for half in 0..2 {
        // SAFETY: as the caller promises.
        unsafe {
            let at = out.add(8 * half);
            vst1q_u32(at, vreinterpretq_u32_u16(vzip1q_u16(gb[half], r[half])));
            vst1q_u32(at.add(4), vreinterpretq_u32_u16(vzip2q_u16(gb[half], r[half])));
        }
    }
}

/// [`crate::tone::code`] of 16 pixels.
#[target_feature(enable = "neon")]
#[inline]
fn codes(logs: [uint16x8_t; 2]) -> uint8x16_t {
    codes_by::<false>(const { &CubicBytes::of(&CUBICS) }, logs)
}

/// Codes of 16 logarithms by the cubic of each octave.
#[target_feature(enable = "neon")]
#[inline]
pub(super) fn codes_by<const UP: bool>(bytes: &CubicBytes, logs: [uint16x8_t; 2]) -> uint8x16_t {
    let octave = vshrq_n_u8::<4>(vuzp2q_u8(vreinterpretq_u8_u16(logs[0]), vreinterpretq_u8_u16(logs[1])));
    let place = logs.map(|logs| vreinterpretq_s16_u16(veorq_u16(vshlq_n_u16::<4>(logs), vdupq_n_u16(0x8000))));
    let [low, high] = cubic::<UP>(bytes, octave, place);
    vshrn_high_n_u16::<CODE_SHIFT>(vshrn_n_u16::<CODE_SHIFT>(low), high)
}

/// One byte of a table for each of 16 lanes; 0 beyond its end.
#[target_feature(enable = "neon")]
#[inline]
pub(super) fn looked_up(bytes: &[u8; 16], at: uint8x16_t) -> uint8x16_t {
    // SAFETY: the table holds 16 bytes.
    vqtbl1q_u8(unsafe { vld1q_u8(bytes.as_ptr()) }, at)
}

/// [`crate::tone::cubic`] of 16 lanes.
#[target_feature(enable = "neon")]
#[inline]
pub(super) fn cubic<const UP: bool>(bytes: &CubicBytes, segment: uint8x16_t, place: [int16x8_t; 2]) -> [uint16x8_t; 2] {
    let (c3, h2) = (looked_up(&bytes.c3, segment), looked_up(&bytes.h2, segment));
    let c1 = [looked_up(&bytes.c1[0], segment), looked_up(&bytes.c1[1], segment)];
    let c0 = [looked_up(&bytes.c0[0], segment), looked_up(&bytes.c0[1], segment)];
    let c3 = [vmovl_u8(vget_low_u8(c3)), vmovl_high_u8(c3)];
    let c2 = [vshll_n_u8::<1>(vget_low_u8(h2)), vshll_high_n_u8::<1>(h2)];
    // Widening as they add costs less than putting low and high bytes together.
    let add = |half: usize, to: int16x8_t, [low, high]: [uint8x16_t; 2]| {
        let to = vreinterpretq_u16_s16(to);
        vreinterpretq_s16_u16(if half == 0 {
            vaddq_u16(vaddw_u8(to, vget_low_u8(low)), vshll_n_u8::<8>(vget_low_u8(high)))
        } else {
            vaddq_u16(vaddw_high_u8(to, low), vshll_high_n_u8::<8>(high))
        })
    };
    [0, 1].map(|half| {
        let place = place[half];
        let (first, c2) = (vqrdmulhq_s16(vreinterpretq_s16_u16(c3[half]), place), vreinterpretq_s16_u16(c2[half]));
        let inner = if UP { vaddq_s16(first, c2) } else { vsubq_s16(first, c2) };
        let middle = add(half, vqrdmulhq_s16(inner, place), c1);
        vreinterpretq_u16_s16(add(half, vqrdmulhq_s16(middle, place), c0))
    })
}

/// See [`super::Kernel::prefetch`].
pub fn prefetch<T: Copy>(values: &[T]) {
    for byte in (0..size_of_val(values)).step_by(64) {
        // SAFETY: a prefetch reads nothing that the program can see, and the address lies in the slice.
        unsafe {
            let line = values.as_ptr().cast::<u8>().add(byte);
            core::arch::asm!("prfm pldl1keep, [{0}]", in(reg) line, options(nostack, readonly, preserves_flags));
        }
    }
}
