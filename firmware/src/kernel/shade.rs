//! The view in the light that the virtual geometry leaves it, 16 pixels at once: see [`crate::shade`].

use crate::shade::shaded;

/// See [`super::Kernel::shade`].
pub fn scalar(pixels_xrgb: &mut [u32], log_factors: [&[u16]; 3]) {
    for (x, pixel) in pixels_xrgb.iter_mut().enumerate() {
        *pixel = shaded(*pixel, log_factors.map(|plane| plane[x]));
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::shade as avx2;

#[cfg(target_arch = "x86_64")]
mod x86 {
    use crate::kernel::avx2::{codes_by, cubic, table, write};
    use crate::shade::{CODES, FACTOR_ONE, LOGS, NEAR_BLACK, NEAR_BLACK_CODES};
    use crate::tone::{CubicBytes, low_and_high};
    use core::arch::x86_64::*;

    /// # Safety
    /// AVX2; lengths as `Kernel::shade` checks them.
    #[target_feature(enable = "avx2")]
    pub unsafe fn shade(pixels_xrgb: &mut [u32], log_factors: [&[u16]; 3]) {
        let pixels = pixels_xrgb.as_mut_ptr();
        for x in (0..pixels_xrgb.len()).step_by(16) {
            // SAFETY: all slices hold as many values, a multiple of 16.
            unsafe {
                let words = [0, 8].map(|half| _mm256_loadu_si256(pixels.add(x + half).cast()));
                let channels = [
                    words.map(|words| _mm256_srli_epi32::<16>(words)),
                    words.map(|words| _mm256_srli_epi32::<8>(words)),
                    words,
                ];
                let mut codes = [_mm256_setzero_si256(); 3];
                for (c, shown) in codes.iter_mut().enumerate() {
                    let bytes = channels[c].map(|words| _mm256_and_si256(words, _mm256_set1_epi32(255)));
                    let factor = _mm256_loadu_si256(log_factors[c].as_ptr().add(x).cast());
                    // Packing leaves the pixels in the order 0..4, 8..12, 4..8, 12..16.
                    let factor = _mm256_permute4x64_epi64::<0b11_01_10_00>(factor);
                    let logs = multiplied(logs_of_codes(_mm256_packus_epi32(bytes[0], bytes[1])), factor);
                    *shown = codes_by::<true>(const { &CubicBytes::of(&CODES) }, logs);
                }
                write(codes, pixels.add(x));
            }
        }
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn logs_of_codes(code: __m256i) -> __m256i {
        let top = _mm256_set1_epi16(-0x8000);
        let place = _mm256_xor_si256(_mm256_slli_epi16::<12>(code), top);
        let log = cubic::<false>(const { &CubicBytes::of(&LOGS) }, _mm256_srli_epi16::<4>(code), place);
        // Codes that are not near black get a set top bit, which makes the byte zero.
        let beyond = _mm256_set1_epi8(0x80u8.wrapping_sub(NEAR_BLACK_CODES) as i8);
        let low = _mm256_adds_epu8(_mm256_or_si256(code, top), beyond);
        let high = _mm256_or_si256(_mm256_slli_epi16::<8>(code), _mm256_set1_epi16(0x80));
        let high = _mm256_adds_epu8(high, beyond);
        let near_black = const { &low_and_high(&NEAR_BLACK) };
        let near_black = _mm256_or_si256(
            _mm256_shuffle_epi8(table(&near_black[0]), low),
            _mm256_shuffle_epi8(table(&near_black[1]), high),
        );
        _mm256_add_epi16(log, near_black)
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn multiplied(log: __m256i, factor: __m256i) -> __m256i {
        let one = _mm256_set1_epi16(FACTOR_ONE as i16);
        let darker = _mm256_subs_epu16(log, _mm256_subs_epu16(one, factor));
        _mm256_adds_epu16(darker, _mm256_subs_epu16(factor, one))
    }
}

#[cfg(target_arch = "aarch64")]
pub use arm::shade as neon;

#[cfg(target_arch = "aarch64")]
mod arm {
    use crate::kernel::neon::{codes_by, cubic, looked_up, write};
    use crate::shade::{CODES, FACTOR_ONE, LOGS, NEAR_BLACK};
    use crate::tone::{CubicBytes, low_and_high};
    use core::arch::aarch64::*;

    /// # Safety
    /// Lengths as `Kernel::shade` checks them.
    #[target_feature(enable = "neon")]
    pub unsafe fn shade(pixels_xrgb: &mut [u32], log_factors: [&[u16]; 3]) {
        let pixels = pixels_xrgb.as_mut_ptr();
        for x in (0..pixels_xrgb.len()).step_by(16) {
            // SAFETY: all slices hold as many values, a multiple of 16.
            unsafe {
                let uint8x16x4_t(b, g, r, _) = vld4q_u8(pixels.add(x).cast());
                let mut codes = [r, g, b];
                for (code, factors) in codes.iter_mut().zip(log_factors) {
                    let factors = [0, 8].map(|half| vld1q_u16(factors.as_ptr().add(x + half)));
                    let logs = logs_of_codes(*code);
                    let logs = [multiplied(logs[0], factors[0]), multiplied(logs[1], factors[1])];
                    *code = codes_by::<true>(const { &CubicBytes::of(&CODES) }, logs);
                }
                write(codes, pixels.add(x));
            }
        }
    }

    #[target_feature(enable = "neon")]
    #[inline]
    fn logs_of_codes(codes: uint8x16_t) -> [uint16x8_t; 2] {
        let place = vshlq_n_u8::<4>(codes);
        let place = [vshll_n_u8::<8>(vget_low_u8(place)), vshll_high_n_u8::<8>(place)];
        let place = place.map(|place| vreinterpretq_s16_u16(veorq_u16(place, vdupq_n_u16(0x8000))));
        let logs = cubic::<false>(const { &CubicBytes::of(&LOGS) }, vshrq_n_u8::<4>(codes), place);
        // Codes that are not near black lie beyond the table's end.
        let near_black = const { &low_and_high(&NEAR_BLACK) };
        let [low, high] = [looked_up(&near_black[0], codes), looked_up(&near_black[1], codes)];
        let near_black = [vreinterpretq_u16_u8(vzip1q_u8(low, high)), vreinterpretq_u16_u8(vzip2q_u8(low, high))];
        [vaddq_u16(logs[0], near_black[0]), vaddq_u16(logs[1], near_black[1])]
    }

    #[target_feature(enable = "neon")]
    #[inline]
    fn multiplied(log: uint16x8_t, factor: uint16x8_t) -> uint16x8_t {
        let one = vdupq_n_u16(FACTOR_ONE);
        vqaddq_u16(vqsubq_u16(log, vqsubq_u16(one, factor)), vqsubq_u16(factor, one))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use crate::kernel::Kernel;
    use crate::kernel::tests::Random;
    use crate::shade::log_factor;
    use crate::tone::{srgb_code, srgb_linear};
    use std::vec::Vec;

    fn shaded(kernel: Kernel, view: &[u32], log_factors: [&[u16]; 3]) -> Vec<u32> {
        let mut pixels = view.to_vec();
        kernel.shade(&mut pixels, log_factors);
        pixels
    }

    #[test]
    fn every_path_shades_the_same_and_as_the_curve_says() {
        let mut random = Random(5);
        for n in [0, 16, 48, 256] {
            let view: Vec<u32> = (0..n).map(|_| random.below(1 << 24) as u32 | 0xab00_0000).collect();
            let factors: Vec<f32> = (0..3 * n).map(|_| random.below(4000) as f32 / 1000.0).collect();
            let logs: Vec<u16> = factors.iter().map(|&factor| log_factor(factor)).collect();
            let planes = [0, 1, 2].map(|c| &logs[c * n..(c + 1) * n]);
            let normative = shaded(Kernel::SCALAR, &view, planes);
            for kernel in Kernel::paths() {
                assert_eq!(shaded(kernel, &view, planes), normative, "{} {n}", kernel.name());
            }
            for (x, (found, view)) in normative.iter().zip(&view).enumerate() {
                for c in 0..3 {
                    let code = |word: u32| f64::from(word.to_be_bytes()[1 + c]);
                    let lit = srgb_linear(code(*view)) * f64::from(factors[c * n + x]);
                    let expected = srgb_code(lit.min(1.0));
                    assert!((code(*found) - expected).abs() <= 0.56, "{x} {c}: {found:06x} {expected}");
                }
            }
        }
    }

    #[test]
    fn every_path_shades_every_code_by_every_factor_the_same() {
        let view: Vec<u32> = (0..256).map(|code| 0x0001_0101 * code).collect();
        for factor in (0..=u16::MAX).step_by(257).chain([53247, 53248, 53249]) {
            let planes = [0, 1, 2].map(|c: u16| [factor.wrapping_add(c); 256]);
            let planes = planes.each_ref().map(|plane| plane.as_slice());
            for kernel in Kernel::paths() {
                let found = shaded(kernel, &view, planes);
                assert_eq!(found, shaded(Kernel::SCALAR, &view, planes), "{} {factor}", kernel.name());
            }
        }
    }
}
