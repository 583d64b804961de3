//! Tone: linear light (1/2^20 of display white) to 8-bit sRGB codes, and back.

use crate::relight::LINEAR_BITS;

/// Up to here the curve is a straight line (linear light).
pub const LINEAR_UNTIL: f32 = 0.003_130_8;
/// Slope of that line, codes per unit of linear light.
pub const LINEAR_SLOPE: f32 = 12.92 * 255.0;
/// Above it, codes as a polynomial in the fourth root of linear light, highest power first: a Chebyshev fit to
/// `255 * (1.055 x^(1/2.4) - 0.055)`, at most 0.0005 codes off.
pub const CURVE: [f32; 7] = [16.542_696, -78.039_43, 162.886_22, -213.936_16, 346.857_5, 35.898_08, -15.208_646];

/// The 8-bit sRGB code of a linear value in 1/2^20 of white: the plain sRGB curve (IEC 61966-2-1), clamped and rounded.
///
/// Normative, with the roundings of IEEE 754 single precision in this order (no fused multiply-add): the vector paths
/// do the same steps.
#[inline]
pub fn code(linear_q20: i32) -> u8 {
    let held = linear_q20.clamp(0, 1 << LINEAR_BITS);
    let x = held as f32 * (1.0 / (1 << LINEAR_BITS) as f32);
    let t = libm::sqrtf(libm::sqrtf(x));
    let bright = CURVE[1..].iter().fold(CURVE[0], |sum, coefficient| sum * t + coefficient);
    let value = if x <= LINEAR_UNTIL { x * LINEAR_SLOPE } else { bright };
    (value + 0.5) as u8
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

/// Linear light of every 8-bit code, in 1/2^20 of white.
#[derive(Clone, Debug)]
pub struct ViewLight([u32; 256]);

impl ViewLight {
    /// Computes the table (1 KiB).
    pub fn new() -> Self {
        ViewLight(core::array::from_fn(|code| {
            libm::rint(srgb_linear(code as f64) * f64::from(1u32 << LINEAR_BITS)) as u32
        }))
    }

    /// Linear light of a code, in 1/2^20 of white.
    #[inline]
    pub fn linear_q20(&self, code: u8) -> u32 {
        self.0[usize::from(code)]
    }
}

impl Default for ViewLight {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_the_rounded_curve() {
        for q20 in 0..=1i32 << 20 {
            let exact = srgb_code(f64::from(q20) / f64::from(1 << 20));
            let error = (f64::from(code(q20)) - exact).abs();
            assert!(error <= 0.5 + 0.0006, "{q20}: {error}");
        }
        assert_eq!((code(-5), code(i32::MIN), code(i32::MAX)), (0, 0, 255));
    }

    #[test]
    fn codes_never_fall_as_light_rises() {
        let mut last = 0;
        for q20 in 0..=1i32 << 20 {
            assert!(code(q20) >= last);
            last = code(q20);
        }
    }

    #[test]
    fn every_code_survives_the_way_to_linear_and_back() {
        let light = ViewLight::new();
        for shown in 0..=255 {
            assert_eq!(code(light.linear_q20(shown) as i32), shown);
        }
    }
}
