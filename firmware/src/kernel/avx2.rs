//! AVX2: 16 patches, or 8 pixels, per step.

use super::{LINEAR_LIMIT, Projection, RESIDUAL_SHIFT, Reconstruction, ResidualTerm, SUN_SHIFT};
use crate::relight::LINEAR_BITS;
use crate::tone::{CURVE, LINEAR_SLOPE, LINEAR_UNTIL};
use core::arch::x86_64::*;

/// # Safety
/// AVX2; lengths as `Kernel::project` checks them.
#[target_feature(enable = "avx2")]
pub unsafe fn project(job: &Projection<'_>, out: &mut [i32]) {
    let stride = job.weights.len();
    let mut groups = out.chunks_exact_mut(4);
    let mut k = 0;
    // Four rows at a time: each block of weights is loaded once for all of them, and their sums fold together.
    for sums in &mut groups {
        let mut acc = [_mm256_setzero_si256(); 4];
        for &block in job.lit_blocks {
            let at = usize::from(block) * 16;
            // SAFETY: at + 16 <= stride.
            let w = unsafe { _mm256_loadu_si256(job.weights.as_ptr().add(at).cast()) };
            for (row, acc) in acc.iter_mut().enumerate() {
                // SAFETY: V holds out.len() rows of stride bytes, and k + row < out.len().
                let v = unsafe { _mm_loadu_si128(job.v.as_ptr().add((k + row) * stride + at).cast()) };
                *acc = _mm256_add_epi32(*acc, _mm256_madd_epi16(_mm256_cvtepi8_epi16(v), w));
            }
        }
        let pairs = [_mm256_hadd_epi32(acc[0], acc[1]), _mm256_hadd_epi32(acc[2], acc[3])];
        let four = _mm256_hadd_epi32(pairs[0], pairs[1]);
        let four = _mm_add_epi32(_mm256_castsi256_si128(four), _mm256_extracti128_si256::<1>(four));
        // SAFETY: the group holds four i32.
        unsafe { _mm_storeu_si128(sums.as_mut_ptr().cast(), four) };
        k += 4;
    }
    for (row, sum) in groups.into_remainder().iter_mut().enumerate() {
        let mut acc = _mm256_setzero_si256();
        for &block in job.lit_blocks {
            let at = usize::from(block) * 16;
            // SAFETY: at + 16 <= stride, V holds out.len() rows of stride bytes, and k + row < out.len().
            let (v, w) = unsafe {
                (
                    _mm_loadu_si128(job.v.as_ptr().add((k + row) * stride + at).cast()),
                    _mm256_loadu_si256(job.weights.as_ptr().add(at).cast()),
                )
            };
            acc = _mm256_add_epi32(acc, _mm256_madd_epi16(_mm256_cvtepi8_epi16(v), w));
        }
        *sum = horizontal_sum(acc);
    }
}

#[target_feature(enable = "avx2")]
fn horizontal_sum(acc: __m256i) -> i32 {
    let half = _mm_add_epi32(_mm256_castsi256_si128(acc), _mm256_extracti128_si256::<1>(acc));
    let half = _mm_add_epi32(half, _mm_shuffle_epi32::<0b01_00_11_10>(half));
    let half = _mm_add_epi32(half, _mm_shuffle_epi32::<0b10_11_00_01>(half));
    _mm_cvtsi128_si32(half)
}

/// # Safety
/// AVX2; lengths as `Kernel::reconstruct` checks them.
#[target_feature(enable = "avx2")]
pub unsafe fn reconstruct(job: &Reconstruction<'_>, out: [&mut [i32]; 3]) {
    let n = job.pixels;
    let [out_r, out_g, out_b] = out;
    let out = [out_r.as_mut_ptr(), out_g.as_mut_ptr(), out_b.as_mut_ptr()];
    for x in (0..n).step_by(8) {
        let mut acc = [_mm256_setzero_si256(); 3];
        for j in 0..job.pairs[0].len() {
            // SAFETY: (j * n + x) * 2 + 16 <= pairs * n * 2 <= u.len().
            let u = unsafe { _mm_loadu_si128(job.u.as_ptr().add((j * n + x) * 2).cast()) };
            let u = _mm256_cvtepi8_epi16(u);
            for (acc, pairs) in acc.iter_mut().zip(&job.pairs) {
                // SAFETY: the three slices have the same length.
                let pair = unsafe { *pairs.get_unchecked(j) };
                *acc = _mm256_add_epi32(*acc, _mm256_madd_epi16(u, _mm256_set1_epi32(pair)));
            }
        }
        for c in 0..3 {
            let at = c * n + x;
            // SAFETY: rows holds 3 n u16, the sun's plane 3 n u16, each output n i32, and x + 8 <= n.
            unsafe {
                let rows = _mm_loadu_si128(job.rows.as_ptr().add(2 * at).cast());
                let mut value = scale(acc[c], _mm256_cvtepu16_epi32(rows), job.right[c], job.left[c]);
                if let Some((plane, weight)) = job.sun {
                    let response = _mm_loadu_si128(plane.as_ptr().add(at).cast());
                    value = _mm256_add_epi32(value, sun(_mm256_cvtepu16_epi32(response), weight[c]));
                }
                _mm256_storeu_si256(out[c].add(x).cast(), value);
            }
        }
    }
}

/// The scalar path's `scale`: the low 32 bits of `product >> right` are the value, since it fits an i32 for
/// `right >= 16` (|product| < 2^29 * 2^16) and the bits needed lie below bit 64 for `right <= 32`.
#[target_feature(enable = "avx2")]
fn scale(sum: __m256i, row: __m256i, right: u32, left: u32) -> __m256i {
    let round = _mm256_set1_epi64x(1 << (right - 1));
    let value = scaled_product::<true>(sum, row, round, right);
    let limit = LINEAR_LIMIT >> left;
    let value = _mm256_max_epi32(_mm256_min_epi32(value, _mm256_set1_epi32(limit)), _mm256_set1_epi32(-limit));
    _mm256_sll_epi32(value, _mm_cvtsi32_si128(left as i32))
}

#[target_feature(enable = "avx2")]
fn sun(response: __m256i, weight: u32) -> __m256i {
    let round = _mm256_set1_epi64x(1 << (SUN_SHIFT - 1));
    scaled_product::<false>(response, _mm256_set1_epi32(weight as i32), round, SUN_SHIFT)
}

#[target_feature(enable = "avx2")]
fn scaled_product<const SIGNED: bool>(a: __m256i, b: __m256i, round: __m256i, right: u32) -> __m256i {
    let count = _mm_cvtsi32_si128(right as i32);
    let (a_odd, b_odd) = (_mm256_srli_epi64::<32>(a), _mm256_srli_epi64::<32>(b));
    let (even, odd) = if SIGNED {
        (_mm256_mul_epi32(a, b), _mm256_mul_epi32(a_odd, b_odd))
    } else {
        (_mm256_mul_epu32(a, b), _mm256_mul_epu32(a_odd, b_odd))
    };
    let even = _mm256_srl_epi64(_mm256_add_epi64(even, round), count);
    let odd = _mm256_srl_epi64(_mm256_add_epi64(odd, round), count);
    _mm256_blend_epi32::<0b1010_1010>(even, _mm256_slli_epi64::<32>(odd))
}

/// # Safety
/// AVX2; lengths as `Kernel::add_residual` checks them.
#[target_feature(enable = "avx2")]
pub unsafe fn add_residual(term: &ResidualTerm<'_>, out: [&mut [i32]; 3]) {
    let n = term.pixels;
    let round = _mm256_set1_epi32(1 << (RESIDUAL_SHIFT - 1));
    for (c, out) in out.into_iter().enumerate() {
        let factor = _mm256_set1_epi32(term.factor[c]);
        for x in (0..n).step_by(8) {
            // SAFETY: the codes hold 3 n bytes, the output n i32, and x + 8 <= n.
            unsafe {
                let codes = _mm256_cvtepi8_epi32(_mm_loadl_epi64(term.codes.as_ptr().add(c * n + x).cast()));
                let product = _mm256_add_epi32(_mm256_mullo_epi32(codes, factor), round);
                let at = out.as_mut_ptr().add(x).cast();
                let sum =
                    _mm256_add_epi32(_mm256_loadu_si256(at), _mm256_srai_epi32::<{ RESIDUAL_SHIFT as i32 }>(product));
                _mm256_storeu_si256(at, sum);
            }
        }
    }
}

/// # Safety
/// AVX2; lengths as `Kernel::tone` checks them.
#[target_feature(enable = "avx2")]
pub unsafe fn tone(linear: [&[i32]; 3], out_xrgb: &mut [u32]) {
    for x in (0..out_xrgb.len()).step_by(8) {
        // SAFETY: the planes and the output have the same length, a multiple of 8.
        let [r, g, b] = linear.map(|plane| unsafe { codes(_mm256_loadu_si256(plane.as_ptr().add(x).cast())) });
        let word = _mm256_or_si256(_mm256_or_si256(_mm256_slli_epi32::<16>(r), _mm256_slli_epi32::<8>(g)), b);
        // SAFETY: as above.
        unsafe { _mm256_storeu_si256(out_xrgb.as_mut_ptr().add(x).cast(), word) };
    }
}

/// [`crate::tone::code`], step by step in the same order.
#[target_feature(enable = "avx2")]
fn codes(linear: __m256i) -> __m256i {
    let held = _mm256_max_epi32(_mm256_min_epi32(linear, _mm256_set1_epi32(1 << LINEAR_BITS)), _mm256_setzero_si256());
    let x = _mm256_mul_ps(_mm256_cvtepi32_ps(held), _mm256_set1_ps(1.0 / (1 << LINEAR_BITS) as f32));
    let t = _mm256_sqrt_ps(_mm256_sqrt_ps(x));
    let mut bright = _mm256_set1_ps(CURVE[0]);
    for &coefficient in &CURVE[1..] {
        bright = _mm256_add_ps(_mm256_mul_ps(bright, t), _mm256_set1_ps(coefficient));
    }
    let dark = _mm256_mul_ps(x, _mm256_set1_ps(LINEAR_SLOPE));
    let is_dark = _mm256_cmp_ps::<_CMP_LE_OQ>(x, _mm256_set1_ps(LINEAR_UNTIL));
    let code = _mm256_blendv_ps(bright, dark, is_dark);
    _mm256_cvttps_epi32(_mm256_add_ps(code, _mm256_set1_ps(0.5)))
}

/// See [`super::Kernel::prefetch`].
pub fn prefetch(bytes: &[u8]) {
    for line in bytes.chunks(64) {
        // SAFETY: a prefetch reads nothing that the program can see, and the address lies in the slice.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast()) };
    }
}
