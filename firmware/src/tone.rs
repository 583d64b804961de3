//! Tone: linear light (1 = display white) to 8-bit sRGB codes, and back.
//!
//! The curve takes a float's own bits as a logarithm: above [`LOG_BIAS`], 4 bits of octave and 12 bits of place within
//! it. Each of the 16 octaves from 2^-16 to 1 has a cubic in 16-bit fixed point. The bits saturate to 0 and to 65535,
//! which also holds the light between 0 and 1.

/// Slope of the curve's straight part, codes per unit of linear light; nowhere is it steeper.
pub const LINEAR_SLOPE: f32 = 12.92 * 255.0;
/// Steepest slope of the curve over the square root of light: where its straight part ends, `2 sqrt(0.0031308)` times
/// [`LINEAR_SLOPE`] is 368.7.
pub const ROOT_SLOPE: f32 = 369.0;
/// Binary places of a logarithm within its octave.
pub const LOG_BINARY_PLACES: u32 = 12;
/// Bits dropped from a float to leave 12 of its mantissa.
pub const LOG_SHIFT: i32 = 11;
/// What 2^-16 is then; 1 is 65536 above it.
pub const LOG_BIAS: i32 = (127 - 16) << 12;
/// Binary places of a cubic's value in codes.
pub const CODE_SHIFT: i32 = 7;

/// Coefficients `[c0, c1, h2, c3]` of cubics in 16-bit fixed point, one for each of 16 segments; `h2` and `c3` fit bytes.
pub type Cubics = [[i16; 4]; 16];

/// Per octave `[c0, c1, h2, c3]`: `c0 + s (c1 + s (s c3 - 2 h2))` is the code in 1/128, with the half for rounding
/// included, and s is the place within the octave, -1..1. Fitted for the least largest error in this very arithmetic:
/// at most 0.035 codes from the exact curve.
pub const CUBICS: Cubics = [
    [76, 2, 2, 3],
    [83, 6, 0, 0],
    [103, 13, 0, 0],
    [141, 26, 0, 0],
    [218, 51, 0, 0],
    [373, 103, 0, 0],
    [682, 206, 0, 0],
    [1300, 401, 6, 0],
    [2315, 561, 29, 11],
    [3669, 750, 38, 13],
    [5478, 1001, 51, 18],
    [7892, 1336, 68, 24],
    [11113, 1781, 90, 35],
    [15413, 2379, 120, 45],
    [21155, 3176, 161, 60],
    [28818, 4240, 215, 79],
];

/// [`Cubics`] byte by byte, as tables in registers hold them: the upper bytes only where there are any.
#[derive(Clone, Copy, Debug)]
pub struct CubicBytes {
    /// Low and high bytes.
    pub c0: [[u8; 16]; 2],
    /// The same.
    pub c1: [[u8; 16]; 2],
    /// Half of c2.
    pub h2: [u8; 16],
    /// The last.
    pub c3: [u8; 16],
}

impl CubicBytes {
    /// Of these cubics.
    pub const fn of(cubics: &Cubics) -> Self {
        CubicBytes {
            c0: [bytes_of(cubics, 0, 0), bytes_of(cubics, 0, 1)],
            c1: [bytes_of(cubics, 1, 0), bytes_of(cubics, 1, 1)],
            h2: bytes_of(cubics, 2, 0),
            c3: bytes_of(cubics, 3, 0),
        }
    }
}

/// Low and high bytes of a table.
pub const fn low_and_high(table: &[u16; 16]) -> [[u8; 16]; 2] {
    let mut bytes = [[0; 16]; 2];
    let mut at = 0;
    while at < 16 {
        [bytes[0][at], bytes[1][at]] = table[at].to_le_bytes();
        at += 1;
    }
    bytes
}

const fn bytes_of(cubics: &Cubics, which: usize, byte: usize) -> [u8; 16] {
    let mut table = [0; 16];
    let mut segment = 0;
    while segment < 16 {
        assert!(which < 2 || (cubics[segment][which] >= 0 && cubics[segment][which] < 256));
        table[segment] = cubics[segment][which].to_le_bytes()[byte];
        segment += 1;
    }
    table
}

/// `c0 + s (c1 + s (s c3 - 2 h2))` of a segment, modulo 2^16, with `+ 2 h2` where the curve bends `UP`; `place` is s in
/// 1/32768, products are rounded.
#[inline]
pub(crate) fn cubic<const UP: bool>(cubics: &Cubics, segment: u8, place: i16) -> i16 {
    let [c0, c1, h2, c3] = cubics[usize::from(segment)];
    let product = |a: i16| ((i32::from(a) * i32::from(place) + 0x4000) >> 15) as i16;
    let inner = if UP { product(c3) + 2 * h2 } else { product(c3) - 2 * h2 };
    c0.wrapping_add(product(c1 + product(inner)))
}

/// The 8-bit sRGB code of linear light: the plain sRGB curve (IEC 61966-2-1), clamped and rounded.
///
/// Normative: the vector paths do the same steps.
#[inline]
pub fn code(linear: f32) -> u8 {
    code_by::<false>(&CUBICS, log16(linear))
}

/// The least light of a logarithm, 0..=65536.
pub(crate) fn log16_start(log: u32) -> f32 {
    f32::from_bits((log + LOG_BIAS as u32) << LOG_SHIFT)
}

/// The light's logarithm in 1/4096 octave above 2^-16, roughly; saturated to 16 bits.
#[inline]
pub(crate) fn log16(linear: f32) -> u16 {
    ((linear.to_bits() as i32 >> LOG_SHIFT) - LOG_BIAS).clamp(0, 0xffff) as u16
}

/// The code of a logarithm by the cubic of its octave.
#[inline]
pub(crate) fn code_by<const UP: bool>(cubics: &Cubics, log16: u16) -> u8 {
    (code_q7::<UP>(cubics, log16) >> CODE_SHIFT) as u8
}

/// Code plus a half, in 1/128.
#[inline]
fn code_q7<const UP: bool>(cubics: &Cubics, log16: u16) -> i16 {
    cubic::<UP>(cubics, (log16 >> LOG_BINARY_PLACES) as u8, (log16 << 4 ^ 0x8000) as i16)
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

/// Linear light of every 8-bit code, 1 for white.
#[derive(Clone, Debug)]
pub struct ViewLight([f32; 256]);

impl ViewLight {
    /// Computes the table (1 KiB).
    pub fn new() -> Self {
        ViewLight(core::array::from_fn(|code| srgb_linear(code as f64) as f32))
    }

    /// Linear light of a code.
    #[inline]
    pub fn linear(&self, code: u8) -> f32 {
        self.0[usize::from(code)]
    }

    /// Linear light of all codes.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn table(&self) -> &[f32; 256] {
        &self.0
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

    /// The ends of the floats that share a logarithm, so that nothing between them is left out.
    fn ends(log16: u16) -> [f64; 2] {
        let start = |log: u32| f64::from(log16_start(log));
        let low = if log16 == 0 { 0.0 } else { start(u32::from(log16)) };
        [low, start(u32::from(log16) + 1)]
    }

    #[test]
    fn codes_before_rounding_are_within_a_twentieth_of_the_curve() {
        for log in 0..=u16::MAX {
            let found = f64::from(code_q7::<false>(&CUBICS, log)) / 128.0 - 0.5;
            for light in ends(log) {
                let error = (found - srgb_code(light)).abs();
                assert!(error <= 0.035, "{light}: {error}");
            }
        }
    }

    #[test]
    fn a_logarithm_holds_the_floats_between_its_ends() {
        for log in 1..u16::MAX {
            let [low, high] = ends(log).map(|light| light as f32);
            assert_eq!((log16(low), log16(high), log16(high.next_down())), (log, log + 1, log));
        }
    }

    #[test]
    fn light_out_of_range_is_held() {
        assert_eq!([-0.0, -1e-30, -5.0, f32::NEG_INFINITY, 1e-40].map(code), [0; 5]);
        assert_eq!([1.0, 1.5, 3e38, f32::INFINITY].map(code), [255; 4]);
    }

    #[test]
    fn codes_never_fall_as_light_rises() {
        let codes = || (0..=u16::MAX).map(|log| code_q7::<false>(&CUBICS, log) >> CODE_SHIFT);
        assert!(codes().zip(codes().skip(1)).all(|(a, b)| a <= b));
        assert_eq!((codes().next(), codes().next_back()), (Some(0), Some(255)));
    }

    #[test]
    fn every_code_survives_the_way_to_linear_and_back() {
        let light = ViewLight::new();
        for shown in 0..=255 {
            assert_eq!(code(light.linear(shown)), shown);
        }
    }
}
