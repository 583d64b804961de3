//! Adding the light of the view behind pixels that are covered partly.

use crate::tone::ViewLight;

/// Share of the view that shows beside a coverage of 255ths.
const SHARE: f32 = 1.0 / 255.0;

/// See [`super::Kernel::add_view`]: `(light of the code) * ((255 - coverage) * SHARE)`, each operation rounded by itself.
pub fn scalar(view_xrgb: &[u32], coverage: &[u8], light: &ViewLight, planes: [&mut [f32]; 3]) {
    for (c, plane) in planes.into_iter().enumerate() {
        for ((value, &behind), &alpha) in plane.iter_mut().zip(view_xrgb).zip(coverage) {
            let code = (behind >> (16 - 8 * c)) as u8;
            *value += light.linear(code) * (f32::from(255 - alpha) * SHARE);
        }
    }
}

/// # Safety
/// AVX2; lengths as `Kernel::add_view` checks them.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub unsafe fn avx2(view_xrgb: &[u32], coverage: &[u8], light: &ViewLight, planes: [&mut [f32]; 3]) {
    use core::arch::x86_64::*;
    let table = light.table().as_ptr();
    let planes = planes.map(<[f32]>::as_mut_ptr);
    for x in (0..view_xrgb.len()).step_by(8) {
        // SAFETY: all slices hold as many values, a multiple of 16; codes are below 256, the table's length.
        unsafe {
            let behind = _mm256_loadu_si256(view_xrgb.as_ptr().add(x).cast());
            let alpha = _mm256_cvtepu8_epi32(_mm_loadl_epi64(coverage.as_ptr().add(x).cast()));
            let free = _mm256_cvtepi32_ps(_mm256_sub_epi32(_mm256_set1_epi32(255), alpha));
            let share = _mm256_mul_ps(free, _mm256_set1_ps(SHARE));
            let codes = [_mm256_srli_epi32::<16>(behind), _mm256_srli_epi32::<8>(behind), behind];
            for (codes, plane) in codes.into_iter().zip(planes) {
                let codes = _mm256_and_si256(codes, _mm256_set1_epi32(255));
                let added = _mm256_mul_ps(_mm256_i32gather_ps::<4>(table, codes), share);
                let at = plane.add(x);
                _mm256_storeu_ps(at, _mm256_add_ps(_mm256_loadu_ps(at), added));
            }
        }
    }
}

/// # Safety
/// Lengths as `Kernel::add_view` checks them.
#[cfg(target_arch = "aarch64")]
#[target_feature(enable = "neon")]
pub unsafe fn neon(view_xrgb: &[u32], coverage: &[u8], light: &ViewLight, planes: [&mut [f32]; 3]) {
    use core::arch::aarch64::*;
    let planes = planes.map(<[f32]>::as_mut_ptr);
    for x in (0..view_xrgb.len()).step_by(8) {
        // SAFETY: all slices hold as many values, a multiple of 16.
        unsafe {
            let free = vmovl_u8(vsub_u8(vdup_n_u8(255), vld1_u8(coverage.as_ptr().add(x))));
            let halves = [vmovl_u16(vget_low_u16(free)), vmovl_high_u16(free)];
            for (half, free) in halves.into_iter().enumerate() {
                let share = vmulq_n_f32(vcvtq_f32_u32(free), SHARE);
                let first = x + 4 * half;
                for (c, plane) in planes.into_iter().enumerate() {
                    // There is no gather: a table of 1 KiB is looked up code by code.
                    let behind = |k: usize| light.linear((*view_xrgb.get_unchecked(first + k) >> (16 - 8 * c)) as u8);
                    let behind = [behind(0), behind(1), behind(2), behind(3)];
                    let at = plane.add(first);
                    vst1q_f32(at, vaddq_f32(vld1q_f32(at), vmulq_f32(vld1q_f32(behind.as_ptr()), share)));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use crate::kernel::Kernel;
    use crate::tone::ViewLight;
    use std::vec::Vec;

    #[test]
    fn every_path_adds_the_same_view() {
        let light = ViewLight::new();
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 32) as u32
        };
        for n in [0, 16, 48, 256] {
            let view: Vec<u32> = (0..n).map(|_| next()).collect();
            let coverage: Vec<u8> = (0..n).map(|k| [0, 1, 254, 255, next() as u8][k % 5]).collect();
            let before: Vec<f32> = (0..3 * n).map(|_| next() as f32 / 2e9).collect();
            let added = |kernel: Kernel| {
                let mut planes = before.clone();
                let (r, rest) = planes.split_at_mut(n);
                let (g, b) = rest.split_at_mut(n);
                kernel.add_view(&view, &coverage, &light, [r, g, b]);
                planes.into_iter().map(f32::to_bits).collect::<Vec<u32>>()
            };
            for kernel in Kernel::paths() {
                assert_eq!(added(kernel), added(Kernel::SCALAR), "{} {n}", kernel.name());
            }
            // By the definition, in f64: the view's channels in the order of the planes, by what is free.
            for (at, found) in added(Kernel::SCALAR).into_iter().enumerate() {
                let (c, x) = (at / n, at % n);
                let code = view[x].to_be_bytes()[1 + c];
                let share = f64::from(255 - coverage[x]) / 255.0;
                let expected = f64::from(before[at]) + crate::tone::srgb_linear(f64::from(code)) * share;
                assert!((f64::from(f32::from_bits(found)) - expected).abs() < 1e-6, "{at}");
            }
        }
    }
}
