//! The picture into a screen's memory: turned as the panel hangs, in the screen's pixel format, changed areas only.

use super::Frame;
use std::ops::Range;

/// By how much the picture is turned on the screen, clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rotation {
    /// As it is.
    #[default]
    None,
    /// A quarter turn: the picture's top is at the screen's right edge.
    Quarter,
    /// Upside down.
    Half,
    /// Three quarters: the picture's top is at the screen's left edge.
    ThreeQuarters,
}

impl Rotation {
    /// The rotation by `degrees`: 0, 90, 180 or 270.
    pub fn from_degrees(degrees: u64) -> Option<Self> {
        match degrees {
            0 => Some(Rotation::None),
            90 => Some(Rotation::Quarter),
            180 => Some(Rotation::Half),
            270 => Some(Rotation::ThreeQuarters),
            _ => None,
        }
    }

    fn quarters(self) -> u8 {
        self as u8
    }

    /// This rotation and then `other`.
    pub fn and(self, other: Rotation) -> Rotation {
        match (self.quarters() + other.quarters()) % 4 {
            0 => Rotation::None,
            1 => Rotation::Quarter,
            2 => Rotation::Half,
            _ => Rotation::ThreeQuarters,
        }
    }

    /// The size that a picture of `size` takes on the screen.
    pub fn turned(self, (width, height): (usize, usize)) -> (usize, usize) {
        if matches!(self, Rotation::None | Rotation::Half) { (width, height) } else { (height, width) }
    }
}

/// How a screen's memory holds a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PixelFormat {
    /// `0x00RRGGBB`, DRM's `XR24`.
    #[default]
    Xrgb8888,
    /// Ten bits each, red highest, DRM's `XR30`.
    Xrgb2101010,
}

impl PixelFormat {
    /// A pixel `0x00RRGGBB` in this format, as the screen's memory has it (little endian).
    fn pack(self, pixel: u32) -> u32 {
        match self {
            PixelFormat::Xrgb8888 => pixel.to_le(),
            PixelFormat::Xrgb2101010 => {
                let [_, r, g, b] = pixel.to_be_bytes().map(u32::from);
                // The high bits again below: 0 stays 0 and 255 becomes 1023.
                let ten = |code: u32| code << 2 | code >> 6;
                (ten(r) << 20 | ten(g) << 10 | ten(b)).to_le()
            }
        }
    }
}

/// Where and how a picture lies in a screen's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// How the picture is turned.
    pub rotation: Rotation,
    /// The format of the memory.
    pub format: PixelFormat,
    /// Screen column and row of the turned picture's upper left corner.
    pub corner: (usize, usize),
    /// Words from one row of the memory to the next.
    pub stride: usize,
}

impl Placement {
    /// In the middle of a screen. `None` if the picture does not fit.
    pub fn centred(
        picture: (usize, usize),
        screen: (usize, usize),
        rotation: Rotation,
        format: PixelFormat,
        stride: usize,
    ) -> Option<Self> {
        let (width, height) = rotation.turned(picture);
        let corner = (screen.0.checked_sub(width)? / 2, screen.1.checked_sub(height)? / 2);
        Some(Placement { rotation, format, corner, stride })
    }

    /// Writes an area (rows, columns) of the picture to the screen's memory. What lies outside either is left out.
    pub fn write(&self, frame: &Frame<'_>, (rows, columns): (Range<usize>, Range<usize>), memory: &mut [u32]) {
        for y in rows {
            let Some(from) = frame.pixels_bgrx.get(y * frame.width + columns.start..y * frame.width + columns.end)
            else {
                return;
            };
            let (first, step) = self.line(frame, columns.start, y);
            if step == 1 {
                let Some(to) = memory.get_mut(first..first + from.len()) else { return };
                match self.format {
                    PixelFormat::Xrgb8888 if cfg!(target_endian = "little") => to.copy_from_slice(from),
                    format => to.iter_mut().zip(from).for_each(|(to, from)| *to = format.pack(*from)),
                }
            } else {
                let mut at = first;
                for pixel in from {
                    let Some(to) = memory.get_mut(at) else { return };
                    *to = self.format.pack(*pixel);
                    at = at.wrapping_add_signed(step);
                }
            }
        }
    }

    /// The word of picture pixel (x, y), and the step to that of the pixel right of it.
    fn line(&self, frame: &Frame<'_>, x: usize, y: usize) -> (usize, isize) {
        let (right, below) = (frame.width - 1 - x, frame.height - 1 - y);
        let stride = self.stride as isize;
        let (column, row, step) = match self.rotation {
            Rotation::None => (x, y, 1),
            Rotation::Quarter => (below, x, stride),
            Rotation::Half => (right, below, -1),
            Rotation::ThreeQuarters => (y, right, -stride),
        };
        ((self.corner.1 + row) * self.stride + self.corner.0 + column, step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::damage::Damage;

    /// Pixels 1..=6 of a picture of 3x2, on a screen of 5x4 with rows of 8 words.
    fn shown(rotation: Rotation, screen: (usize, usize)) -> Vec<Vec<u32>> {
        let (pixels, damage) = ([1, 2, 3, 4, 5, 6], Damage::whole(3, 2));
        let frame = Frame { width: 3, height: 2, pixels_bgrx: &pixels, number: 0, damage: &damage };
        let placement = Placement::centred((3, 2), screen, rotation, PixelFormat::Xrgb8888, 8).unwrap();
        let mut memory = vec![0; 8 * screen.1];
        damage.areas().for_each(|area| placement.write(&frame, area, &mut memory));
        memory.chunks(8).map(|row| row[..screen.0].to_vec()).collect()
    }

    #[test]
    fn pictures_turn_clockwise_about_the_middle() {
        assert_eq!(shown(Rotation::None, (5, 4)), [[0; 5], [0, 1, 2, 3, 0], [0, 4, 5, 6, 0], [0; 5]]);
        assert_eq!(shown(Rotation::Half, (3, 2)), [[6, 5, 4], [3, 2, 1]]);
        assert_eq!(shown(Rotation::Quarter, (2, 3)), [[4, 1], [5, 2], [6, 3]]);
        assert_eq!(shown(Rotation::ThreeQuarters, (2, 3)), [[3, 6], [2, 5], [1, 4]]);
        assert_eq!(shown(Rotation::Quarter, (4, 3)), [[0, 4, 1, 0], [0, 5, 2, 0], [0, 6, 3, 0]]);
    }

    #[test]
    fn only_the_areas_asked_for_are_written() {
        let (pixels, damage) = (vec![7; 40 * 20], Damage::none(40, 20));
        let frame = Frame { width: 40, height: 20, pixels_bgrx: &pixels, number: 0, damage: &damage };
        for rotation in [Rotation::None, Rotation::Quarter, Rotation::Half, Rotation::ThreeQuarters] {
            let screen = rotation.turned((40, 20));
            let placement = Placement::centred((40, 20), screen, rotation, PixelFormat::Xrgb8888, screen.0).unwrap();
            let mut memory = vec![0; 800];
            placement.write(&frame, (16..20, 32..40), &mut memory);
            assert_eq!(memory.iter().filter(|&&word| word == 7).count(), 32, "{rotation:?}");
        }
    }

    #[test]
    fn ten_bits_keep_black_white_and_order() {
        let pack = |pixel| PixelFormat::Xrgb2101010.pack(pixel);
        assert_eq!(pack(0x00ff_0000), 1023 << 20);
        assert_eq!(pack(0x0000_ff00), 1023 << 10);
        assert_eq!(pack(0x0000_00ff), 1023);
        // Within half a step of the same share of white.
        for code in 0..256u32 {
            assert!((f64::from(pack(code)) - f64::from(code) * 1023.0 / 255.0).abs() <= 0.76, "{code}");
        }
    }

    #[test]
    fn a_picture_larger_than_the_screen_is_refused() {
        let place = |rotation| Placement::centred((3, 2), (2, 3), rotation, PixelFormat::Xrgb8888, 2);
        assert!(place(Rotation::None).is_none() && place(Rotation::Quarter).is_some());
        assert_eq!(Rotation::Quarter.and(Rotation::Half), Rotation::ThreeQuarters);
        assert_eq!(Rotation::ThreeQuarters.and(Rotation::Quarter), Rotation::None);
    }
}
