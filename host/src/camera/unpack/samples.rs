//! Samples of raw and grey formats.

/// How the samples of a row are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sample {
    /// One byte each.
    Bits8,
    /// MIPI RAW10: four high bytes, then one byte with the four low pairs of bits, the first sample's lowest.
    Packed10,
    /// MIPI RAW12: two high bytes, then one byte with the two low halves, the first sample's lowest.
    Packed12,
    /// Two bytes each, little endian, of which the low bits count: 9 to 16.
    Low(u8),
}

impl Sample {
    /// Bits of a sample.
    pub fn bits(self) -> u8 {
        match self {
            Sample::Bits8 => 8,
            Sample::Packed10 => 10,
            Sample::Packed12 => 12,
            Sample::Low(bits) => bits.clamp(9, 16),
        }
    }

    /// Bytes of a row without padding.
    pub(super) fn row_bytes(self, width: usize) -> usize {
        match self {
            Sample::Bits8 => width,
            Sample::Packed10 => width.div_ceil(4) * 5,
            Sample::Packed12 => width.div_ceil(2) * 3,
            Sample::Low(_) => width * 2,
        }
    }

    /// Reads as many samples as `into` is long: bytes as they are, deeper ones widened to 16 bits.
    pub(super) fn read_row(self, bytes: &[u8], into: &mut [u16]) {
        match self {
            Sample::Bits8 => into.iter_mut().zip(bytes).for_each(|(to, &from)| *to = u16::from(from)),
            Sample::Packed10 => {
                for (to, group) in into.chunks_mut(4).zip(bytes.chunks_exact(5)) {
                    for (i, value) in to.iter_mut().enumerate() {
                        let low = group[4] >> (2 * i) & 3;
                        *value = widened(u16::from(group[i]) << 2 | u16::from(low), 10);
                    }
                }
            }
            Sample::Packed12 => {
                for (to, group) in into.chunks_mut(2).zip(bytes.chunks_exact(3)) {
                    for (i, value) in to.iter_mut().enumerate() {
                        let low = group[2] >> (4 * i) & 15;
                        *value = widened(u16::from(group[i]) << 4 | u16::from(low), 12);
                    }
                }
            }
            Sample::Low(_) => {
                let bits = u32::from(self.bits());
                for (to, pair) in into.iter_mut().zip(bytes.chunks_exact(2)) {
                    *to = widened(u16::from_le_bytes([pair[0], pair[1]]), bits);
                }
            }
        }
    }
}

/// The low `bits` (9..=16) of a sample as 16 bits: shifted up, the high bits repeated below. Bits above count as clipped.
fn widened(sample: u16, bits: u32) -> u16 {
    let sample = u32::from(sample).min((1 << bits) - 1);
    (sample << (16 - bits) | sample >> (2 * bits - 16)) as u16
}
