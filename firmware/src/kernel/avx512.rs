//! AVX-512 with BW and VNNI: 64 patches, or 16 pixels, per step.

use super::job::planes;
use super::{Extent, Linear, Projection, Reconstruction, Shown, avx2};
use crate::tone::{CODE_SHIFT, CUBICS, LOG_BIAS, LOG_SHIFT};
use crate::weights::MAX_PADDED;
use core::arch::x86_64::*;
use core::mem::MaybeUninit;

/// Patches per step of a projection.
const GROUP: usize = 64;
const GROUPS: usize = MAX_PADDED.div_ceil(GROUP);

/// Weights of 64 patches, the low and the high byte apart, in V's order.
#[derive(Clone, Copy)]
struct Group {
    low: __m512i,
    high: __m512i,
    /// First patch, and those that are lit.
    at: usize,
    present: __mmask64,
}

/// # Safety
/// AVX-512 BW and VNNI; lengths as `Kernel::project` checks them.
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512vnni")]
pub unsafe fn project(job: &Projection<'_>, out: &mut [i32]) {
    let mut groups = [const { MaybeUninit::uninit() }; GROUPS];
    // SAFETY: as the caller promises.
    let Some(groups) = (unsafe { split(job, &mut groups) }) else {
        // SAFETY: as the caller promises; AVX2 is part of this path's needs.
        return unsafe { avx2::project(job, out) };
    };
    let mut k = 0;
    let mut quads = out.chunks_exact_mut(4);
    for sums in &mut quads {
        // SAFETY: V holds out.len() rows, and k + 4 <= out.len().
        sums.copy_from_slice(&unsafe { rows::<4>(job, groups, k) });
        k += 4;
    }
    for sums in quads.into_remainder().chunks_mut(2) {
        // SAFETY: as above, with as many rows as there are sums.
        let both = unsafe { if sums.len() == 2 { rows::<2>(job, groups, k) } else { rows::<1>(job, groups, k) } };
        sums.copy_from_slice(&both[..sums.len()]);
        k += 2;
    }
}

/// The weights' bytes, for the groups with any light. `None`: too many weights, or some are negative, and then their
/// high byte is not what the multiplication takes.
///
/// # Safety
/// AVX-512 BW; lengths as `Kernel::project` checks them.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
unsafe fn split<'g>(job: &Projection<'_>, groups: &'g mut [MaybeUninit<Group>; GROUPS]) -> Option<&'g [Group]> {
    let (mut count, mut signs) = (0, _mm512_setzero_si512());
    let order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
    let mut lit = job.lit_blocks.iter().map(|&block| usize::from(block) * 16).peekable();
    while let Some(first) = lit.next() {
        let at = first / GROUP * GROUP;
        let mut present = 0xffff << (first - at);
        while let Some(next) = lit.next_if(|next| next / GROUP * GROUP == at) {
            present |= 0xffff << (next - at);
        }
        // SAFETY: `present` leaves out what is not lit, and with it what lies beyond the weights.
        let (a, b) = unsafe {
            let from = job.weights.as_ptr().add(at);
            (
                _mm512_maskz_loadu_epi16(present as u32, from),
                _mm512_maskz_loadu_epi16((present >> 32) as u32, from.wrapping_add(32)),
            )
        };
        signs = _mm512_or_si512(signs, _mm512_or_si512(a, b));
        let byte = _mm512_set1_epi16(0xff);
        let low = _mm512_packus_epi16(_mm512_and_si512(a, byte), _mm512_and_si512(b, byte));
        let high = _mm512_packus_epi16(_mm512_srli_epi16::<8>(a), _mm512_srli_epi16::<8>(b));
        let (low, high) = (_mm512_permutexvar_epi64(order, low), _mm512_permutexvar_epi64(order, high));
        groups.get_mut(count)?.write(Group { low, high, at, present });
        count += 1;
    }
    // SAFETY: the first `count` were written.
    (_mm512_movepi16_mask(signs) == 0).then(|| unsafe { groups[..count].assume_init_ref() })
}

/// Sums of `ROWS` rows from `k` on; the others are 0.
///
/// # Safety
/// AVX-512 BW and VNNI; V holds the rows.
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512vnni")]
#[inline]
unsafe fn rows<const ROWS: usize>(job: &Projection<'_>, groups: &[Group], k: usize) -> [i32; 4] {
    let stride = job.weights.len();
    let mut low = [_mm512_setzero_si512(); 4];
    let mut high = [_mm512_setzero_si512(); 4];
    for group in groups {
        for row in 0..ROWS {
            // SAFETY: `present` leaves out what lies beyond the row.
            let v = unsafe {
                _mm512_maskz_loadu_epi8(group.present, job.v.as_ptr().add((k + row) * stride + group.at).cast())
            };
            low[row] = _mm512_dpbusd_epi32(low[row], group.low, v);
            high[row] = _mm512_dpbusd_epi32(high[row], group.high, v);
        }
    }
    let mut halves = [_mm256_setzero_si256(); 4];
    for row in 0..ROWS {
        let sum = _mm512_add_epi32(low[row], _mm512_slli_epi32::<8>(high[row]));
        halves[row] = _mm256_add_epi32(_mm512_castsi512_si256(sum), _mm512_extracti64x4_epi64::<1>(sum));
    }
    let four = _mm256_hadd_epi32(_mm256_hadd_epi32(halves[0], halves[1]), _mm256_hadd_epi32(halves[2], halves[3]));
    let four = _mm_add_epi32(_mm256_castsi256_si128(four), _mm256_extracti128_si256::<1>(four));
    let mut sums = [0; 4];
    // SAFETY: room for four i32.
    unsafe { _mm_storeu_si128(sums.as_mut_ptr().cast(), four) };
    sums
}

/// # Safety
/// AVX-512 BW and VNNI; lengths as `Kernel::relight` checks them.
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
pub unsafe fn relight(job: &Reconstruction<'_>, linear: Linear<'_>, shown: Option<Shown<'_>>) -> Extent {
    let (out, stride) = shown.map_or((core::ptr::null_mut(), 0), |s| (s.pixels_xrgb.as_mut_ptr(), s.stride));
    let (planes, adds) = planes(linear);
    let mut smallest = [_mm512_set1_epi16(-1); 2];
    let mut faintest = [_mm512_set1_epi32(i32::MAX); 3];
    for x in (0..job.pixels).step_by(16) {
        // SAFETY: x + 16 <= job.pixels.
        let rgb = unsafe { values(job, x, planes.filter(|_| adds), &mut faintest) };
        if let Some(planes) = planes {
            // SAFETY: the planes hold job.pixels values.
            rgb.iter().zip(planes).for_each(|(value, plane)| unsafe { _mm512_storeu_ps(plane.add(x), *value) });
        }
        let logs = log16(rgb);
        let counts = if x + 16 <= job.covered { u32::MAX } else { words_below(job.covered.saturating_sub(x)) };
        for k in 0..2 {
            smallest[k] = _mm512_mask_min_epu16(smallest[k], counts, smallest[k], logs[k]);
        }
        if !out.is_null() {
            // SAFETY: block x/16 begins `stride` words after the one before, and holds 16.
            unsafe { show(logs, out.add(x / 16 * stride)) };
        }
    }
    Extent { smallest_log: least(smallest), faintest_log: faintest.map(|v| _mm512_reduce_min_epi32(v)) }
}

/// The words of [`log16`]'s order that belong to the first `count` pixels.
#[cold]
fn words_below(count: usize) -> u32 {
    (0..count).fold(0, |words, pixel| words | 0x11 << (pixel / 4 * 8 + pixel % 4))
}

/// The least R, G and B over all words of [`log16`]'s order.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn least([gr, b]: [__m512i; 2]) -> [u16; 3] {
    let words = [gr, b].map(|v| {
        let mut words = [0u16; 32];
        // SAFETY: the array holds 64 bytes.
        unsafe { _mm512_storeu_si512(words.as_mut_ptr().cast(), v) };
        words
    });
    let over = |words: &[u16; 32], at: usize| {
        let part = |k: usize| words[k].min(words[k + 1]).min(words[k + 2].min(words[k + 3]));
        part(at).min(part(at + 8)).min(part(at + 16).min(part(at + 24)))
    };
    [over(&words[0], 4), over(&words[0], 0), over(&words[1], 0)]
}

/// The 16 values from pixel `x` on, by the scalar path's `value`; with what `added` holds. Takes their logarithms
/// over the row scales into `faintest`.
///
/// # Safety
/// AVX-512 BW and VNNI; lengths as `Kernel::relight` checks them, `x + 16 <= job.pixels`; `added`: job.pixels values each.
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
#[inline]
unsafe fn values(
    job: &Reconstruction<'_>,
    x: usize,
    added: Option<[*mut f32; 3]>,
    faintest: &mut [__m512i; 3],
) -> [__m512; 3] {
    let n = job.pixels;
    let mut sums = [_mm512_setzero_si512(); 3];
    for j in 0..job.pairs[0].len() {
        // SAFETY: (j * n + x) * 2 + 32 <= pairs * n * 2 <= u.len(); the three slices of pairs have the same length.
        unsafe {
            let u = _mm512_cvtepi8_epi16(_mm256_loadu_si256(job.u.as_ptr().add((j * n + x) * 2).cast()));
            for (sum, pairs) in sums.iter_mut().zip(&job.pairs) {
                *sum = _mm512_dpwssd_epi32(*sum, u, _mm512_set1_epi32(*pairs.get_unchecked(j)));
            }
        }
    }
    let mut rgb = [_mm512_setzero_ps(); 3];
    for c in 0..3 {
        let at = c * n + x;
        // SAFETY: rows and the sun's plane hold 3 n u16.
        unsafe {
            let row = floats(job.rows.as_ptr().add(2 * at).cast());
            let value = _mm512_mul_ps(_mm512_mul_ps(_mm512_cvtepi32_ps(sums[c]), row), _mm512_set1_ps(job.unit[c]));
            rgb[c] = match job.sun {
                Some((plane, weight)) => {
                    let light = _mm512_mul_ps(floats(plane.as_ptr().add(at).cast()), _mm512_set1_ps(weight[c]));
                    _mm512_add_ps(value, light)
                }
                None => value,
            };
            if let Some(added) = added {
                rgb[c] = _mm512_add_ps(_mm512_loadu_ps(added[c].add(x)), rgb[c]);
            }
            let bits = _mm512_max_epi32(_mm512_castps_si512(rgb[c]), _mm512_setzero_si512());
            faintest[c] = _mm512_min_epi32(faintest[c], _mm512_sub_epi32(bits, _mm512_castps_si512(row)));
        }
    }
    rgb
}

/// # Safety
/// AVX-512; sixteen u16 at `at`.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn floats(at: *const __m256i) -> __m512 {
    // SAFETY: as the caller promises.
    _mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(unsafe { _mm256_loadu_si256(at) }))
}

/// # Safety
/// AVX-512 BW; lengths as `Kernel::tone` checks them.
#[target_feature(enable = "avx512f,avx512bw")]
pub unsafe fn tone(linear: [&[f32]; 3], out_xrgb: &mut [u32]) {
    for x in (0..out_xrgb.len()).step_by(16) {
        // SAFETY: the planes and the output have the same length, a multiple of 16.
        unsafe {
            show(log16(linear.map(|plane| _mm512_loadu_ps(plane.as_ptr().add(x)))), out_xrgb.as_mut_ptr().add(x))
        };
    }
}

/// The scalar path's `log16` of 16 pixels: per 128 bits four pixels' green, then their red; and their blue twice.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn log16(rgb: [__m512; 3]) -> [__m512i; 2] {
    let [r, g, b] = rgb.map(|value| {
        let bits = _mm512_srai_epi32::<{ LOG_SHIFT as u32 }>(_mm512_castps_si512(value));
        _mm512_sub_epi32(bits, _mm512_set1_epi32(LOG_BIAS))
    });
    [_mm512_packus_epi32(g, r), _mm512_packus_epi32(b, b)]
}

/// Sixteen pixels' codes as 0x00RRGGBB.
///
/// # Safety
/// AVX-512 BW; room for 16 words at `out`.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
unsafe fn show(logs: [__m512i; 2], out: *mut u32) {
    let [gr, b] = logs.map(|log| codes(log));
    let gb = _mm512_or_si512(_mm512_slli_epi16::<8>(gr), b);
    let r = _mm512_shuffle_epi32::<0b01_00_11_10>(gr);
    // SAFETY: as the caller promises.
    unsafe { _mm512_storeu_si512(out.cast(), _mm512_unpacklo_epi16(gb, r)) };
}

/// [`crate::tone::code`] of 32 logarithms.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn codes(log: __m512i) -> __m512i {
    let place = _mm512_xor_si512(_mm512_slli_epi16::<4>(log), _mm512_set1_epi16(-0x8000));
    let octave = _mm512_srli_epi16::<12>(log);
    let coefficient = |table: &[i16; 32]| {
        // SAFETY: the table holds 64 bytes.
        _mm512_permutexvar_epi16(octave, unsafe { _mm512_loadu_si512(table.as_ptr().cast()) })
    };
    let inner = _mm512_mulhrs_epi16(coefficient(const { &table(3) }), place);
    let inner = _mm512_sub_epi16(inner, coefficient(const { &table(2) }));
    let middle = _mm512_add_epi16(coefficient(const { &table(1) }), _mm512_mulhrs_epi16(inner, place));
    let q7 = _mm512_add_epi16(coefficient(const { &table(0) }), _mm512_mulhrs_epi16(middle, place));
    _mm512_srli_epi16::<{ CODE_SHIFT as u32 }>(q7)
}

/// A coefficient of every octave, twice over, and c2 whole.
const fn table(which: usize) -> [i16; 32] {
    let mut table = [0; 32];
    let mut k = 0;
    while k < 32 {
        table[k] = CUBICS[k % 16][which] * if which == 2 { 2 } else { 1 };
        k += 1;
    }
    table
}
