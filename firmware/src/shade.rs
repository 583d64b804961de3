//! Shading: the view's sRGB codes -> logarithms -> plus logarithms of factors -> codes.
//!
//! What real ground shows in the shadow of what is not there is its light times a factor. In logarithms that is a sum, and
//! all of it fits 16 bits: light in 1/4096 octave above 2^-16 (65536 would be display white), factors in 1/4096 octave above
//! 2^-13. Both ways between codes and logarithms are cubics in 16-bit fixed point like those of [`crate::tone`], one for each
//! of 16 segments; a factor of one gives every code back.

use crate::surface::xrgb;
use crate::tone::{Cubics, LOG_BINARY_PLACES, code_by, cubic};

/// A factor of one.
pub const FACTOR_ONE: u16 = 13 << LOG_BINARY_PLACES;
/// No factor is larger: 2^3.
pub const BRIGHTEST: f32 = 8.0;
/// Codes below this have a logarithm each, because a straight line is no cubic of its own logarithm.
pub const NEAR_BLACK_CODES: u8 = 16;

/// Their logarithms; black's is too low to be seen after any factor.
pub const NEAR_BLACK: [u16; NEAR_BLACK_CODES as usize] =
    [0, 17671, 21767, 24163, 25863, 27181, 28259, 29170, 29959, 30655, 31277, 31854, 32410, 32945, 33460, 33957];

/// Per 16 codes `[c0, c1, h2, c3]`: `c0 + s (c1 + s (s c3 - 2 h2))`, modulo 2^16, is the logarithm, s the place among them,
/// -1..1. At most 1.2 / 4096 octave from the exact one. Nothing for those near black.
pub const LOGS: Cubics = [
    [0, 0, 0, 0],
    [37788u16 as i16, 2983, 160, 47],
    [42768u16 as i16, 2100, 78, 16],
    [46448u16 as i16, 1620, 47, 8],
    [49366u16 as i16, 1319, 31, 3],
    [51785u16 as i16, 1112, 22, 2],
    [53851u16 as i16, 961, 16, 2],
    [55654u16 as i16, 847, 13, 0],
    [57253u16 as i16, 756, 10, 0],
    [58691u16 as i16, 684, 8, 0],
    [59995u16 as i16, 623, 7, 0],
    [61190u16 as i16, 573, 6, 0],
    [62292u16 as i16, 530, 5, 0],
    [63315u16 as i16, 493, 5, 0],
    [64269u16 as i16, 461, 4, 0],
    [65162u16 as i16, 432, 4, 0],
];

/// Per octave `[c0, c1, h2, c3]`: `c0 + s (c1 + s (s c3 + 2 h2))` is the code in 1/128, with the half for rounding included,
/// s the place within the octave, -1..1. At most 0.03 codes from the exact curve.
pub const CODES: Cubics = [
    [73, 3, 0, 0],
    [83, 6, 0, 0],
    [100, 12, 1, 1],
    [137, 25, 2, 1],
    [210, 49, 4, 3],
    [355, 101, 9, 2],
    [646, 201, 18, 5],
    [1230, 400, 28, 0],
    [2215, 570, 21, 2],
    [3537, 762, 28, 1],
    [5301, 1016, 37, 3],
    [7657, 1357, 49, 3],
    [10801, 1810, 65, 6],
    [14997, 2415, 87, 9],
    [20597, 3226, 117, 9],
    [28073, 4304, 156, 15],
];

/// The logarithm of a factor, for [`shaded`]: 0 and less are the least, [`BRIGHTEST`] and more the largest.
#[inline]
pub fn log_factor(factor: f32) -> u16 {
    let bits = factor.max(f32::MIN_POSITIVE).to_bits();
    let octave = (bits >> 23) as i32 - 127;
    // log2 of 1..2, exact at both ends, elsewhere to 1.2e-4.
    let part = f32::from_bits(bits & 0x7f_ffff | 0x3f80_0000) - 1.0;
    let log = part + part * (1.0 - part) * (0.438_726 + part * (part * 0.082_130_5 - 0.239_058));
    let above = (octave as f32 + log) * f32::from(1u16 << LOG_BINARY_PLACES) + f32::from(FACTOR_ONE);
    // Saturates.
    (above + 0.5) as u16
}

/// A pixel of the view (0x00RRGGBB, sRGB), its linear light multiplied by factors of red, green and blue, given by their
/// logarithms. Normative: what [`crate::kernel::Kernel::shade`] does.
#[inline]
pub fn shaded(view_xrgb: u32, log_factors: [u16; 3]) -> u32 {
    let [_, r, g, b] = view_xrgb.to_be_bytes();
    let shade = |code: u8, factor: u16| code_by::<true>(&CODES, multiplied(log_of_code(code), factor));
    xrgb([shade(r, log_factors[0]), shade(g, log_factors[1]), shade(b, log_factors[2])])
}

#[inline]
fn multiplied(log: u16, factor: u16) -> u16 {
    log.saturating_sub(FACTOR_ONE.saturating_sub(factor)).saturating_add(factor.saturating_sub(FACTOR_ONE))
}

#[inline]
fn log_of_code(code: u8) -> u16 {
    let near_black = NEAR_BLACK.get(usize::from(code)).copied().unwrap_or(0);
    let place = (u16::from(code) << 12 ^ 0x8000) as i16;
    near_black.wrapping_add(cubic::<false>(&LOGS, code >> 4, place) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tone::{srgb_code, srgb_linear};

    fn light(log: u16) -> f64 {
        libm::exp2(f64::from(log) / 4096.0 - 16.0)
    }

    #[test]
    fn logarithms_of_codes_are_within_their_bound() {
        for code in 1..=255 {
            let exact = (libm::log2(srgb_linear(f64::from(code))) + 16.0) * 4096.0;
            assert!((f64::from(log_of_code(code)) - exact.min(65535.0)).abs() <= 1.2, "{code}");
        }
    }

    #[test]
    fn codes_of_logarithms_are_within_theirs_and_never_fall() {
        let mut last = 0;
        for log in 0..=u16::MAX {
            let found = code_by::<true>(&CODES, log);
            let error = (f64::from(found) - srgb_code(light(log))).abs();
            assert!(error <= 0.53 && found >= last, "{log}: {error}");
            last = found;
        }
    }

    #[test]
    fn a_factor_of_one_gives_every_code_back() {
        assert_eq!(log_factor(1.0), FACTOR_ONE);
        for code in 0..=255 {
            assert_eq!(shaded(0x0001_0101 * code, [FACTOR_ONE; 3]), 0x0001_0101 * code);
        }
    }

    #[test]
    fn logarithms_of_factors_are_rounded_ones() {
        for k in 0..100_000 {
            let factor = libm::exp2f(k as f32 / 6250.0 - 13.0).min(7.998);
            let exact = (libm::log2(f64::from(factor)) + 13.0) * 4096.0;
            assert!((f64::from(log_factor(factor)) - exact).abs() <= 1.0, "{factor}: {exact}");
        }
        assert_eq!([0.0, -3.0, f32::NAN, 1e-30].map(log_factor), [0; 4]);
        assert_eq!([8.0, 1e30, f32::INFINITY].map(log_factor), [u16::MAX; 3]);
    }

    #[test]
    fn nothing_is_darker_than_black_and_white_light_can_go_out() {
        assert_eq!(shaded(0x00ff_ffff, [0; 3]), 0);
        assert_eq!(shaded(0, [u16::MAX; 3]), 0);
        assert_eq!(shaded(0x00ff_80ff, [u16::MAX; 3]), 0x00ff_ffff);
        // A quarter of white is code 137, and so is half of code 188 (sRGB).
        let log_factors = [log_factor(0.25), log_factor(0.5), FACTOR_ONE];
        assert_eq!(shaded(0x00ff_bcff, log_factors), 0x0089_89ff);
    }
}
