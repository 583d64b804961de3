//! AVX2: 16 patches, or 16 pixels, per step.

use super::job::planes;
use super::{Extent, Linear, Projection, Reconstruction, Shown};
use crate::tone::{CODE_SHIFT, CUBICS, CubicBytes, LOG_BIAS, LOG_SHIFT};
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

/// 16 pixels of a channel.
type Pixels = [__m256; 2];

/// # Safety
/// AVX2; lengths as `Kernel::relight` checks them.
#[target_feature(enable = "avx2")]
pub unsafe fn relight(job: &Reconstruction<'_>, linear: Linear<'_>, shown: Option<Shown<'_>>) -> Extent {
    let (out, stride) = shown.map_or((core::ptr::null_mut(), 0), |s| (s.pixels_xrgb.as_mut_ptr(), s.stride));
    let (planes, adds) = planes(linear);
    let mut smallest = [_mm256_set1_epi16(-1); 3];
    let mut faintest = [_mm256_set1_epi32(i32::MAX); 3];
    for x in (0..job.pixels).step_by(16) {
        // SAFETY: x + 16 <= job.pixels.
        let rgb = unsafe { values(job, x, planes.filter(|_| adds), &mut faintest) };
        if let Some(planes) = planes {
            for (value, plane) in rgb.iter().zip(planes) {
                // SAFETY: the planes hold job.pixels values.
                unsafe {
                    _mm256_storeu_ps(plane.add(x), value[0]);
                    _mm256_storeu_ps(plane.add(x + 8), value[1]);
                }
            }
        }
        let logs = rgb.map(|pixels| log16(pixels));
        for c in 0..3 {
            let mut low = logs[c];
            if x + 16 > job.covered {
                low = _mm256_or_si256(low, lanes_from(job.covered as i32 - x as i32));
            }
            smallest[c] = _mm256_min_epu16(smallest[c], low);
        }
        if !out.is_null() {
            // SAFETY: block x/16 begins `stride` words after the one before, and holds 16.
            unsafe { show(logs, out.add(x / 16 * stride)) };
        }
    }
    Extent { smallest_log: smallest.map(|v| least_u16(v)), faintest_log: faintest.map(|v| least_i32(v)) }
}

/// The 16 values from pixel `x` on, by the scalar path's `value`; with what `added` holds. Takes their logarithms
/// over the row scales into `faintest`.
///
/// # Safety
/// AVX2; lengths as `Kernel::relight` checks them, `x + 16 <= job.pixels`; `added`: job.pixels values each.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn values(
    job: &Reconstruction<'_>,
    x: usize,
    added: Option<[*mut f32; 3]>,
    faintest: &mut [__m256i; 3],
) -> [Pixels; 3] {
    let n = job.pixels;
    let mut sums = [[_mm256_setzero_si256(); 2]; 3];
    for j in 0..job.pairs[0].len() {
        // SAFETY: (j * n + x) * 2 + 32 <= pairs * n * 2 <= u.len(); the three slices of pairs have the same length.
        unsafe {
            let at = job.u.as_ptr().add((j * n + x) * 2);
            let u = [
                _mm256_cvtepi8_epi16(_mm_loadu_si128(at.cast())),
                _mm256_cvtepi8_epi16(_mm_loadu_si128(at.add(16).cast())),
            ];
            for (sums, pairs) in sums.iter_mut().zip(&job.pairs) {
                let pair = _mm256_set1_epi32(*pairs.get_unchecked(j));
                for (sum, u) in sums.iter_mut().zip(u) {
                    *sum = _mm256_add_epi32(*sum, _mm256_madd_epi16(u, pair));
                }
            }
        }
    }
    let mut rgb = [[_mm256_setzero_ps(); 2]; 3];
    for c in 0..3 {
        for half in 0..2 {
            let at = c * n + x + 8 * half;
            // SAFETY: rows and the sun's plane hold 3 n u16.
            unsafe {
                let row = floats(job.rows.as_ptr().add(2 * at).cast());
                let value =
                    _mm256_mul_ps(_mm256_mul_ps(_mm256_cvtepi32_ps(sums[c][half]), row), _mm256_set1_ps(job.unit[c]));
                rgb[c][half] = match job.sun {
                    Some((plane, weight)) => {
                        let light = _mm256_mul_ps(floats(plane.as_ptr().add(at).cast()), _mm256_set1_ps(weight[c]));
                        _mm256_add_ps(value, light)
                    }
                    None => value,
                };
                if let Some(added) = added {
                    rgb[c][half] = _mm256_add_ps(_mm256_loadu_ps(added[c].add(x + 8 * half)), rgb[c][half]);
                }
                let bits = _mm256_max_epi32(_mm256_castps_si256(rgb[c][half]), _mm256_setzero_si256());
                faintest[c] = _mm256_min_epi32(faintest[c], _mm256_sub_epi32(bits, _mm256_castps_si256(row)));
            }
        }
    }
    rgb
}

/// # Safety
/// AVX2; eight u16 at `at`.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn floats(at: *const __m128i) -> __m256 {
    // SAFETY: as the caller promises.
    _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(unsafe { _mm_loadu_si128(at) }))
}

/// All bits of the pixels from `count` on, in the order of [`log16`].
#[target_feature(enable = "avx2")]
#[inline]
fn lanes_from(count: i32) -> __m256i {
    let pixels = _mm256_setr_epi16(0, 1, 2, 3, 8, 9, 10, 11, 4, 5, 6, 7, 12, 13, 14, 15);
    _mm256_cmpgt_epi16(pixels, _mm256_set1_epi16((count - 1).max(-1) as i16))
}

#[target_feature(enable = "avx2")]
#[inline]
fn least_u16(lanes: __m256i) -> u16 {
    let four = _mm_min_epu16(_mm256_castsi256_si128(lanes), _mm256_extracti128_si256::<1>(lanes));
    _mm_extract_epi16::<0>(_mm_minpos_epu16(four)) as u16
}

#[target_feature(enable = "avx2")]
#[inline]
fn least_i32(lanes: __m256i) -> i32 {
    let four = _mm_min_epi32(_mm256_castsi256_si128(lanes), _mm256_extracti128_si256::<1>(lanes));
    let two = _mm_min_epi32(four, _mm_shuffle_epi32::<0b01_00_11_10>(four));
    _mm_cvtsi128_si32(_mm_min_epi32(two, _mm_shuffle_epi32::<0b10_11_00_01>(two)))
}

/// # Safety
/// AVX2; lengths as `Kernel::tone` checks them.
#[target_feature(enable = "avx2")]
pub unsafe fn tone(linear: [&[f32]; 3], out_xrgb: &mut [u32]) {
    for x in (0..out_xrgb.len()).step_by(16) {
        // SAFETY: the planes and the output have the same length, a multiple of 16.
        unsafe {
            let rgb = linear
                .map(|plane| [_mm256_loadu_ps(plane.as_ptr().add(x)), _mm256_loadu_ps(plane.as_ptr().add(x + 8))]);
            show(rgb.map(|pixels| log16(pixels)), out_xrgb.as_mut_ptr().add(x));
        }
    }
}

/// Sixteen pixels as 0x00RRGGBB, of their logarithms.
///
/// # Safety
/// AVX2; room for 16 words at `out`.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn show(logs: [__m256i; 3], out: *mut u32) {
    // SAFETY: as the caller promises.
    unsafe { write(logs.map(|logs| codes(logs)), out) }
}

/// Sixteen pixels' codes, in the order of [`log16`], as 0x00RRGGBB.
///
/// # Safety
/// AVX2; room for 16 words at `out`.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) unsafe fn write([r, g, b]: [__m256i; 3], out: *mut u32) {
    let gb = _mm256_or_si256(_mm256_slli_epi16::<8>(g), b);
    // Unpacking undoes the order that packing left.
    // SAFETY: as the caller promises.
    unsafe {
        _mm256_storeu_si256(out.cast(), _mm256_unpacklo_epi16(gb, r));
        _mm256_storeu_si256(out.add(8).cast(), _mm256_unpackhi_epi16(gb, r));
    }
}

/// The scalar path's `log16` of 16 pixels, ordered 0..4, 8..12, 4..8, 12..16.
#[target_feature(enable = "avx2")]
#[inline]
fn log16(linear: Pixels) -> __m256i {
    let [low, high] = linear
        .map(|v| _mm256_sub_epi32(_mm256_srai_epi32::<LOG_SHIFT>(_mm256_castps_si256(v)), _mm256_set1_epi32(LOG_BIAS)));
    _mm256_packus_epi32(low, high)
}

/// [`crate::tone::code`] of 16 logarithms.
#[target_feature(enable = "avx2")]
#[inline]
fn codes(log: __m256i) -> __m256i {
    codes_by::<false>(const { &CubicBytes::of(&CUBICS) }, log)
}

/// Codes of 16 logarithms by the cubic of each octave.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn codes_by<const UP: bool>(bytes: &CubicBytes, log: __m256i) -> __m256i {
    let place = _mm256_xor_si256(_mm256_slli_epi16::<4>(log), _mm256_set1_epi16(-0x8000));
    _mm256_srli_epi16::<CODE_SHIFT>(cubic::<UP>(bytes, _mm256_srli_epi16::<12>(log), place))
}

/// [`crate::tone::cubic`] of 16 lanes.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn cubic<const UP: bool>(bytes: &CubicBytes, segment: __m256i, place: __m256i) -> __m256i {
    // The segment in the low or the high byte of each lane; a set top bit makes the other byte zero.
    let low = _mm256_or_si256(segment, _mm256_set1_epi16(-0x8000));
    let high = _mm256_or_si256(_mm256_slli_epi16::<8>(segment), _mm256_set1_epi16(0x80));
    let wide = |[low_bytes, high_bytes]: &[[u8; 16]; 2]| {
        _mm256_or_si256(_mm256_shuffle_epi8(table(low_bytes), low), _mm256_shuffle_epi8(table(high_bytes), high))
    };
    let c3 = _mm256_shuffle_epi8(table(&bytes.c3), low);
    let h2 = _mm256_shuffle_epi8(table(&bytes.h2), low);
    let (c1, c0) = (wide(&bytes.c1), wide(&bytes.c0));
    let (first, c2) = (_mm256_mulhrs_epi16(c3, place), _mm256_add_epi16(h2, h2));
    let inner = if UP { _mm256_add_epi16(first, c2) } else { _mm256_sub_epi16(first, c2) };
    let middle = _mm256_add_epi16(c1, _mm256_mulhrs_epi16(inner, place));
    _mm256_add_epi16(c0, _mm256_mulhrs_epi16(middle, place))
}

#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn table(bytes: &[u8; 16]) -> __m256i {
    // SAFETY: the table holds 16 bytes.
    _mm256_broadcastsi128_si256(unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) })
}

/// See [`super::Kernel::widely`].
///
/// # Safety
/// AVX2.
#[target_feature(enable = "avx2")]
pub unsafe fn widely<L: super::Loops>(work: L) -> L::Out {
    work.run()
}

/// See [`super::Kernel::prefetch`].
pub fn prefetch<T: Copy>(values: &[T]) {
    for byte in (0..size_of_val(values)).step_by(64) {
        // SAFETY: a prefetch reads nothing that the program can see, and the address lies in the slice.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().cast::<i8>().add(byte)) };
    }
}
