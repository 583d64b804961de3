//! Rows of patches apart: their codes out of bit planes ([`crate::wayback`]), and the light of their squares.

use crate::wayback::{Strip, strips};

/// One patch's light on a tile, as [`super::Kernel::add_rows`] takes it.
#[derive(Clone, Copy, Debug)]
pub struct RowsLight<'a> {
    /// Codes `[3][padded pixels]`.
    pub codes: &'a [u8],
    /// What a squared code times a count of the row scale stands for, per channel.
    pub unit: [f32; 3],
}

/// Places of green, red and blue, in which order strips hold them.
const STORED: [usize; 3] = [1, 0, 2];

impl Strip<'_> {
    /// Where the codes of the stored channel number `c` go, out of `[3][pixels]`.
    fn place(&self, c: usize, pixels: usize) -> core::ops::Range<usize> {
        let first = STORED[c] * pixels + self.first;
        first..first + self.pixels
    }

    /// What is added to the bits of the stored channel number `c` in every pixel; as in all of this, modulo 256.
    fn lift(&self, c: usize) -> u8 {
        (self.base[c] << self.shift) as u8
    }

    /// The bit planes of the stored channel number `c`, lowest first, and what a bit of each stands for.
    fn planes_of(&self, c: usize) -> impl Iterator<Item = (&[u8], u8)> {
        let of_bit = |bit: usize| 1u8.checked_shl(bit as u32).unwrap_or(0);
        self.planes[c].chunks_exact(self.plane_bytes()).enumerate().map(move |(bit, plane)| (plane, of_bit(bit)))
    }
}

/// See [`super::Kernel::unpack_rows`].
pub fn unpack_scalar(bytes: &[u8], pixels: usize, codes: &mut [u8]) {
    for strip in strips(bytes, pixels) {
        for x in 0..strip.pixels {
            let sum = |c: usize| {
                let bits = strip.planes_of(c).map(|(plane, value)| (plane[x / 8] >> (x % 8) & 1) * value);
                bits.fold(strip.lift(c), u8::wrapping_add)
            };
            let green = sum(0);
            for (c, code) in [green, green.wrapping_add(sum(1)), green.wrapping_add(sum(2))].into_iter().enumerate() {
                codes[strip.place(c, pixels).start + x] = code;
            }
        }
    }
}

/// See [`super::Kernel::add_rows`].
pub fn add_scalar(lights: &[RowsLight<'_>], rows: &[u8], planes: [&mut [f32]; 3]) {
    let n = planes[0].len();
    for (c, plane) in planes.into_iter().enumerate() {
        for (x, value) in plane.iter_mut().enumerate() {
            let at = c * n + x;
            let sum = lights.iter().fold(0.0, |sum, light| {
                let code = f32::from(light.codes[at]);
                sum + code * code * light.unit[c]
            });
            *value += sum * f32::from(u16::from_le_bytes([rows[2 * at], rows[2 * at + 1]]));
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::{add as add_avx2, unpack as unpack_avx2};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{RowsLight, Strip, strips};
    use core::arch::x86_64::*;

    /// # Safety
    /// AVX2; lengths as `Kernel::unpack_rows` checks them.
    #[target_feature(enable = "avx2")]
    pub unsafe fn unpack(bytes: &[u8], pixels: usize, codes: &mut [u8]) {
        for strip in strips(bytes, pixels) {
            let mut green = [_mm256_setzero_si256(); 2];
            for c in 0..3 {
                let own = channel(&strip, c);
                let own = if c == 0 { own } else { [0, 1].map(|k| _mm256_add_epi8(green[k], own[k])) };
                if c == 0 {
                    green = own;
                }
                store(own, &mut codes[strip.place(c, pixels)]);
            }
        }
    }

    /// The strip's 64 pixels of a stored channel, without green.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn channel(strip: &Strip<'_>, c: usize) -> [__m256i; 2] {
        // Byte 2 k and 2 k + 1 of a word of four to the lanes of pixels 16 k to 16 k + 15.
        let spread = _mm256_setr_epi64x(0, 0x0101_0101_0101_0101, 0x0202_0202_0202_0202, 0x0303_0303_0303_0303);
        let pick = _mm256_set1_epi64x(0x8040_2010_0804_0201_u64 as i64);
        let mut sums = [_mm256_set1_epi8(strip.lift(c) as i8); 2];
        for (plane, value) in strip.planes_of(c) {
            let mut word = [0; 8];
            word[..plane.len()].copy_from_slice(plane);
            let word = u64::from_le_bytes(word);
            let value = _mm256_set1_epi8(value as i8);
            for (sum, four) in sums.iter_mut().zip([word as i32, (word >> 32) as i32]) {
                let bits = _mm256_and_si256(_mm256_shuffle_epi8(_mm256_set1_epi32(four), spread), pick);
                *sum = _mm256_add_epi8(*sum, _mm256_and_si256(_mm256_cmpeq_epi8(bits, pick), value));
            }
        }
        sums
    }

    /// As many of the 64 as `codes` has room for, a multiple of 16.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn store(sums: [__m256i; 2], codes: &mut [u8]) {
        let (whole, rest) = codes.as_chunks_mut::<32>();
        for (to, sums) in whole.iter_mut().zip(sums) {
            // SAFETY: 32 bytes.
            unsafe { _mm256_storeu_si256(to.as_mut_ptr().cast(), sums) };
        }
        if let Some(to) = rest.first_chunk_mut::<16>() {
            // SAFETY: 16 bytes.
            unsafe { _mm_storeu_si128(to.as_mut_ptr().cast(), _mm256_castsi256_si128(sums[whole.len().min(1)])) };
        }
    }

    /// # Safety
    /// AVX2; lengths as `Kernel::add_rows` checks them.
    #[target_feature(enable = "avx2")]
    pub unsafe fn add(lights: &[RowsLight<'_>], rows: &[u8], planes: [&mut [f32]; 3]) {
        let n = planes[0].len();
        let planes = planes.map(<[f32]>::as_mut_ptr);
        for x in (0..n).step_by(16) {
            let mut sums = [[_mm256_setzero_ps(); 2]; 3];
            for light in lights {
                for (c, sums) in sums.iter_mut().enumerate() {
                    let unit = _mm256_set1_ps(light.unit[c]);
                    for (half, sum) in sums.iter_mut().enumerate() {
                        // SAFETY: codes hold 3 n bytes, n is a multiple of 16.
                        let codes = unsafe { _mm_loadl_epi64(light.codes.as_ptr().add(c * n + x + 8 * half).cast()) };
                        let codes = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(codes));
                        *sum = _mm256_add_ps(*sum, _mm256_mul_ps(_mm256_mul_ps(codes, codes), unit));
                    }
                }
            }
            for (c, sums) in sums.into_iter().enumerate() {
                for (half, sum) in sums.into_iter().enumerate() {
                    let at = x + 8 * half;
                    // SAFETY: rows hold 3 n u16, planes n values each.
                    unsafe {
                        let row = _mm_loadu_si128(rows.as_ptr().add(2 * (c * n + at)).cast());
                        let row = _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(row));
                        let to = planes[c].add(at);
                        _mm256_storeu_ps(to, _mm256_add_ps(_mm256_loadu_ps(to), _mm256_mul_ps(sum, row)));
                    }
                }
            }
        }
    }
}

#[cfg(target_arch = "aarch64")]
pub use arm::{add as add_neon, unpack as unpack_neon};

#[cfg(target_arch = "aarch64")]
mod arm {
    use super::{RowsLight, Strip, strips};
    use core::arch::aarch64::*;

    /// # Safety
    /// Lengths as `Kernel::unpack_rows` checks them.
    #[target_feature(enable = "neon")]
    pub unsafe fn unpack(bytes: &[u8], pixels: usize, codes: &mut [u8]) {
        for strip in strips(bytes, pixels) {
            for x in (0..strip.pixels).step_by(16) {
                let green = sixteen(&strip, 0, x);
                let all = [green, vaddq_u8(green, sixteen(&strip, 1, x)), vaddq_u8(green, sixteen(&strip, 2, x))];
                for (c, sixteen) in all.into_iter().enumerate() {
                    let to = &mut codes[strip.place(c, pixels)][x..x + 16];
                    // SAFETY: 16 bytes.
                    unsafe { vst1q_u8(to.as_mut_ptr(), sixteen) };
                }
            }
        }
    }

    /// 16 pixels of a stored channel from pixel `x` of the strip on, without green.
    #[target_feature(enable = "neon")]
    #[inline]
    fn sixteen(strip: &Strip<'_>, c: usize, x: usize) -> uint8x16_t {
        let pick = vreinterpretq_u8_u64(vdupq_n_u64(0x8040_2010_0804_0201));
        strip.planes_of(c).fold(vdupq_n_u8(strip.lift(c)), |sum, (plane, value)| {
            let bits = vcombine_u8(vdup_n_u8(plane[x / 8]), vdup_n_u8(plane[x / 8 + 1]));
            vaddq_u8(sum, vandq_u8(vtstq_u8(bits, pick), vdupq_n_u8(value)))
        })
    }

    /// # Safety
    /// Lengths as `Kernel::add_rows` checks them.
    #[target_feature(enable = "neon")]
    pub unsafe fn add(lights: &[RowsLight<'_>], rows: &[u8], planes: [&mut [f32]; 3]) {
        let n = planes[0].len();
        for (c, plane) in planes.into_iter().enumerate() {
            for (x, to) in plane.as_chunks_mut::<8>().0.iter_mut().enumerate() {
                let at = c * n + 8 * x;
                let mut sums = [vdupq_n_f32(0.0); 2];
                for light in lights {
                    // SAFETY: codes hold 3 n bytes.
                    let codes = unsafe { vld1_u8(light.codes.as_ptr().add(at)) };
                    let squares = vmull_u8(codes, codes);
                    let halves = [vmovl_u16(vget_low_u16(squares)), vmovl_high_u16(squares)];
                    for (sum, half) in sums.iter_mut().zip(halves) {
                        *sum = vaddq_f32(*sum, vmulq_n_f32(vcvtq_f32_u32(half), light.unit[c]));
                    }
                }
                // SAFETY: rows hold 3 n u16, which may lie anywhere.
                let row = vreinterpretq_u16_u8(unsafe { vld1q_u8(rows.as_ptr().add(2 * at)) });
                let row = [vmovl_u16(vget_low_u16(row)), vmovl_high_u16(row)];
                for ((to, sum), row) in to.as_chunks_mut::<4>().0.iter_mut().zip(sums).zip(row) {
                    // SAFETY: four values.
                    unsafe {
                        let value = vld1q_f32(to.as_ptr());
                        vst1q_f32(to.as_mut_ptr(), vaddq_f32(value, vmulq_f32(sum, vcvtq_f32_u32(row))));
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::RowsLight;
    use crate::kernel::Kernel;
    use crate::kernel::tests::Random;
    use crate::wayback::{STRIP, STRIP_HEADER};
    use std::vec;
    use std::vec::Vec;

    /// Strips of any bits, and as many bytes as they take.
    fn strips_of(pixels: usize, random: &mut Random) -> Vec<u8> {
        let mut bytes = vec![];
        for first in (0..pixels).step_by(STRIP) {
            let bits: [usize; 3] = core::array::from_fn(|_| random.below(12));
            bytes.push((bits[0] | bits[1] << 4) as u8);
            bytes.push((bits[2] | random.below(16) << 4) as u8);
            let planes = bits.iter().sum::<usize>() * STRIP.min(pixels - first) / 8;
            bytes.extend((2..STRIP_HEADER + planes).map(|_| random.below(256) as u8));
        }
        bytes
    }

    #[test]
    fn every_path_unpacks_the_same_codes() {
        let mut random = Random(3);
        for pixels in (16..=256).step_by(16).chain([0]).cycle().take(400) {
            let bytes = strips_of(pixels, &mut random);
            let unpacked = |kernel: Kernel| {
                let mut codes = vec![7; 3 * pixels];
                kernel.unpack_rows(&bytes, pixels, &mut codes);
                codes
            };
            for kernel in Kernel::paths() {
                assert_eq!(unpacked(kernel), unpacked(Kernel::SCALAR), "{} {pixels}", kernel.name());
            }
        }
    }

    #[test]
    fn every_path_adds_the_same_light_and_near_the_exact_sum() {
        let mut random = Random(9);
        for (n, count) in [(16, 1), (48, 3), (256, 8), (256, 0), (0, 2)] {
            let codes: Vec<Vec<u8>> =
                (0..count).map(|_| (0..3 * n).map(|_| random.below(256) as u8).collect()).collect();
            let unit = |k: usize| [1e-12 * (k + 1) as f32, 3e-13, 0.0];
            let lights: Vec<RowsLight<'_>> =
                codes.iter().enumerate().map(|(k, codes)| RowsLight { codes, unit: unit(k) }).collect();
            let rows: Vec<u8> = (0..6 * n).map(|_| random.below(256) as u8).collect();
            let by = |kernel: Kernel| {
                let mut planes = vec![0.25f32; 3 * n];
                let (r, rest) = planes.split_at_mut(n);
                let (g, b) = rest.split_at_mut(n);
                kernel.add_rows(&lights, &rows, [r, g, b]);
                planes
            };
            let expected = by(Kernel::SCALAR);
            for kernel in Kernel::paths() {
                let alike = by(kernel).iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(alike, "{} {n}", kernel.name());
            }
            for (at, found) in expected.into_iter().enumerate() {
                let row = f64::from(u16::from_le_bytes([rows[2 * at], rows[2 * at + 1]]));
                let of = |light: &RowsLight<'_>| f64::from(light.codes[at]).powi(2) * f64::from(light.unit[at / n]);
                let exact = 0.25 + lights.iter().map(of).sum::<f64>() * row;
                assert!((f64::from(found) - exact).abs() <= 1e-6 * exact, "{at}: {found} {exact}");
            }
        }
    }
}
