//! Frame sizes and rates that the camera offers, and the one agreed on (UVC 1.1, probe and commit).

use crate::descriptors::{CLOCK_HZ, PACKET_BYTES};
use std::fmt;
use std::str::FromStr;

/// Bytes of a probe or commit block.
pub const PROBE_BYTES: usize = 34;
/// Largest width and height, pixels.
pub const MAX_SIDE: u16 = 1920;

/// Size of a picture, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameSize {
    /// Pixels per row; a multiple of 4.
    pub width: u16,
    /// Rows; a multiple of 4.
    pub height: u16,
}

impl FrameSize {
    /// Bytes of a YUYV picture.
    pub fn bytes(self) -> u32 {
        2 * u32::from(self.width) * u32::from(self.height)
    }

    /// Pixels of a picture.
    pub fn pixels(self) -> usize {
        usize::from(self.width) * usize::from(self.height)
    }
}

impl fmt::Display for FrameSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// A text that names no size.
#[derive(Debug, thiserror::Error)]
#[error("{0}: not a picture size; write WxH in pixels, multiples of 4 from 16 to {MAX_SIDE}, as 320x320")]
pub struct BadSize(String);

impl FromStr for FrameSize {
    type Err = BadSize;

    fn from_str(text: &str) -> Result<Self, BadSize> {
        let side = |text: &str| text.parse().ok().filter(|side| (16..=MAX_SIDE).contains(side) && side % 4 == 0);
        let size = text.split_once('x').and_then(|(w, h)| Some(FrameSize { width: side(w)?, height: side(h)? }));
        size.ok_or_else(|| BadSize(text.into()))
    }
}

/// What can be chosen from, from one plug to the next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Offer {
    /// Sizes, the default first.
    pub sizes: Vec<FrameSize>,
    /// Frame intervals, 100 ns, the default (and shortest) first.
    pub intervals_100ns: Vec<u32>,
}

impl Offer {
    /// A size and half of it, where that is a size still; a rate (frames per second, at least 1), half of it, a sixth.
    pub fn new(size: FrameSize, fps: u32) -> Self {
        let half = FrameSize { width: size.width / 8 * 4, height: size.height / 8 * 4 };
        let sizes = if half.width.min(half.height) >= 16 { vec![size, half] } else { vec![size] };
        let shortest = 10_000_000 / fps.max(1);
        Offer { sizes, intervals_100ns: [1, 2, 6].map(|times| shortest * times).to_vec() }
    }

    /// The shortest interval, 100 ns.
    pub fn fastest_100ns(&self) -> u32 {
        self.intervals_100ns.iter().copied().min().unwrap_or(333_333)
    }

    /// The longest interval, 100 ns.
    pub fn slowest_100ns(&self) -> u32 {
        self.intervals_100ns.iter().copied().max().unwrap_or(333_333)
    }

    /// The choice that is made when nobody chooses.
    pub fn default_choice(&self) -> Choice {
        Choice { size_index: 0, interval_100ns: self.fastest_100ns() }
    }

    /// The size of a choice.
    pub fn size(&self, choice: Choice) -> FrameSize {
        self.sizes.get(choice.size_index).or(self.sizes.first()).copied().unwrap_or(FrameSize { width: 16, height: 16 })
    }

    /// The choice nearest to what a probe block asks for; none when the block is too short.
    pub fn read(&self, block: &[u8]) -> Option<Choice> {
        let interval: [u8; 4] = block.get(4..8)?.try_into().ok()?;
        let wanted = u32::from_le_bytes(interval);
        let nearest = self.intervals_100ns.iter().copied().min_by_key(|interval| interval.abs_diff(wanted));
        let size_index = usize::from(*block.get(3)?).checked_sub(1).filter(|&index| index < self.sizes.len());
        (block.len() >= 26).then(|| Choice {
            size_index: size_index.unwrap_or(0),
            interval_100ns: nearest.unwrap_or_else(|| self.fastest_100ns()),
        })
    }

    /// The probe block of a choice.
    pub fn block(&self, choice: Choice) -> [u8; PROBE_BYTES] {
        let mut block = [0; PROBE_BYTES];
        // Hint: the interval stays. Format 1.
        (block[0], block[2], block[3]) = (1, 1, choice.size_index as u8 + 1);
        block[4..8].copy_from_slice(&choice.interval_100ns.to_le_bytes());
        block[18..22].copy_from_slice(&self.size(choice).bytes().to_le_bytes());
        block[22..26].copy_from_slice(&u32::from(PACKET_BYTES).to_le_bytes());
        block[26..30].copy_from_slice(&CLOCK_HZ.to_le_bytes());
        // Framing: frame id and end of frame are sent. Payload version 1, the only one.
        block[30..34].copy_from_slice(&[3, 1, 1, 1]);
        block
    }
}

/// What was chosen from an [`Offer`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Which size.
    pub size_index: usize,
    /// Time between frames, 100 ns.
    pub interval_100ns: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_have_the_layout_of_uvc_1_1() {
        let offer = Offer::new("320x320".parse().unwrap(), 30);
        let block = offer.block(Choice { size_index: 1, interval_100ns: 666_666 });
        // bmHint, bFormatIndex, bFrameIndex, dwFrameInterval; dwMaxVideoFrameSize 18, dwMaxPayloadTransferSize 22.
        assert_eq!(block[..8], [1, 0, 1, 2, 0x2a, 0x2c, 0x0a, 0]);
        assert_eq!(block[18..22], 51_200u32.to_le_bytes());
        assert_eq!(block[22..26], 49_152u32.to_le_bytes());
        assert_eq!(offer.read(&block), Some(Choice { size_index: 1, interval_100ns: 666_666 }));
    }

    #[test]
    fn what_is_not_offered_becomes_the_nearest() {
        let offer = Offer::new("320x320".parse().unwrap(), 30);
        let mut block = offer.block(offer.default_choice());
        block[3] = 7;
        block[4..8].copy_from_slice(&i32::MAX.to_le_bytes());
        assert_eq!(offer.read(&block), Some(Choice { size_index: 0, interval_100ns: 6 * 333_333 }));
        assert_eq!(offer.read(&block[..25]), None);
    }

    #[test]
    fn sizes_are_multiples_of_four_in_range() {
        assert_eq!("320x240".parse::<FrameSize>().unwrap().bytes(), 153_600);
        for bad in ["", "320", "320x", "321x320", "12x320", "320x2000", "-4x4", "320x320x3"] {
            assert!(bad.parse::<FrameSize>().is_err(), "{bad}");
        }
        assert_eq!(Offer::new("16x16".parse().unwrap(), 30).sizes.len(), 1);
    }
}
