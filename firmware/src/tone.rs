//! Tone: linear light (1/2^20 of display white) to 8-bit sRGB codes, and back.

use crate::relight::LINEAR_BITS;

/// The plain sRGB curve (IEC 61966-2-1) with clamping and rounding, as tables.
///
/// Linear values are cut to 1/65536 of white. Below 1/16 of white every such step has its entry; above, one entry
/// serves 16 steps, less than 0.15 code apart.
#[derive(Clone, Debug)]
pub struct ToneTables {
    dark: [u8; 4096],
    bright: [u8; 4096],
    linear: [u32; 256],
}

/// sRGB code (0..=255, not rounded) of linear light 0..=1 (IEC 61966-2-1).
pub fn srgb_code(linear: f64) -> f64 {
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 };
    255.0 * encoded
}

/// Linear light of an sRGB code 0..=255 (IEC 61966-2-1).
pub fn srgb_linear(code: f64) -> f64 {
    let encoded = code / 255.0;
    if encoded <= 0.040_45 { encoded / 12.92 } else { libm::pow((encoded + 0.055) / 1.055, 2.4) }
}

/// The steepest slope of the curve, codes per unit of linear light.
pub const STEEPEST_CODES: f32 = 12.92 * 255.0;

impl ToneTables {
    /// Computes the tables (9 KiB).
    pub fn new() -> Self {
        let mut tables = ToneTables { dark: [0; 4096], bright: [0; 4096], linear: [0; 256] };
        let code = |linear: f64| libm::rint(srgb_code(linear)) as u8;
        for k in 0..4096 {
            tables.dark[k] = code(k as f64 / 65536.0);
            tables.bright[k] = code((k as f64 * 16.0 + 7.5) / 65536.0);
        }
        for (k, linear) in tables.linear.iter_mut().enumerate() {
            *linear = libm::rint(srgb_linear(k as f64) * f64::from(1u32 << LINEAR_BITS)) as u32;
        }
        tables
    }

    /// Code of a linear value in 1/2^20 of white; negative values show as 0, values above white as 255.
    #[inline]
    pub fn code(&self, linear_q20: i32) -> u8 {
        const DROP: u32 = LINEAR_BITS as u32 - 16;
        let q16 = ((linear_q20.clamp(0, 1 << LINEAR_BITS) + (1 << (DROP - 1))) >> DROP).min(65535) as usize;
        if q16 < 4096 { self.dark[q16] } else { self.bright[q16 >> 4] }
    }

    /// Linear light of a code, in 1/2^20 of white.
    #[inline]
    pub fn linear_q20(&self, code: u8) -> u32 {
        self.linear[usize::from(code)]
    }
}

impl Default for ToneTables {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn codes_follow_the_curve_to_less_than_a_sixth_of_a_code_beyond_rounding() {
        let tables = ToneTables::new();
        for q20 in (0..=1i32 << 20).step_by(3) {
            let exact = srgb_code(f64::from(q20) / f64::from(1 << 20));
            let error = (f64::from(tables.code(q20)) - exact).abs();
            assert!(error <= 0.5 + 0.15, "{q20}: {error}");
        }
        assert_eq!((tables.code(-5), tables.code(i32::MIN), tables.code(i32::MAX)), (0, 0, 255));
    }

    #[test]
    fn codes_never_fall_as_light_rises() {
        let tables = ToneTables::new();
        let mut last = 0;
        for q20 in 0..=1i32 << 20 {
            let code = tables.code(q20);
            assert!(code >= last);
            last = code;
        }
    }

    #[test]
    fn every_code_survives_the_way_to_linear_and_back() {
        let tables = ToneTables::new();
        for code in 0..=255 {
            assert_eq!(tables.code(tables.linear_q20(code) as i32), code);
        }
    }
}
