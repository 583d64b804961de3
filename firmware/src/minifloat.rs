//! Bounds in a byte: 5 bits of exponent, 3 of mantissa, always rounded up.

/// Codes 1..=255 stand for `2^lowest * (1 + m/8) * 2^e` with the code's mantissa `m` and exponent `e`; code 0 is 0.
#[derive(Clone, Copy, Debug)]
pub struct Minifloat {
    bias: u32,
}

impl Minifloat {
    /// Codes whose exponents begin at `2^lowest`, -126..=96.
    pub const fn from(lowest: i32) -> Self {
        Minifloat { bias: ((lowest + 127) as u32) << 3 }
    }

    /// The value of a code.
    #[inline]
    pub fn value(self, code: u8) -> f32 {
        if code == 0 { 0.0 } else { self.above_zero(code) }
    }

    /// The same with `2^lowest` for code 0: a little more, never less, and no branch.
    #[inline]
    pub fn above_zero(self, code: u8) -> f32 {
        f32::from_bits((u32::from(code) + self.bias) << 20)
    }

    /// The smallest code whose value is not below `value`; 255 beyond the range.
    pub fn code(self, value: f32) -> u8 {
        if value <= 0.0 {
            return 0;
        }
        (1..=255).find(|&code| self.value(code) >= value).unwrap_or(255)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_round_up_and_cover_the_range() {
        for lowest in [-40, -8] {
            let small = Minifloat::from(lowest);
            for exponent in lowest + 2..lowest + 31 {
                for step in 0..16 {
                    let value = libm::scalbnf(1.0 + step as f32 / 16.0, exponent);
                    let found = small.value(small.code(value));
                    assert!(found >= value && found <= value * 1.13, "{value} {found}");
                }
            }
            assert_eq!((small.code(0.0), small.value(0), small.code(1e30)), (0, 0.0, 255));
        }
    }
}
