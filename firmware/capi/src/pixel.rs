//! Pixels in the caller's format, a row of a tile at a time.

use crate::types::{
    RELUME_FORMAT_ARGB8888, RELUME_FORMAT_RGB565, RELUME_FORMAT_XRGB8888, RELUME_FORMAT_XRGB2101010, RelumeError,
};
use relume_firmware::kernel::Kernel;
use relume_firmware::relight::LinearTile;
use relume_firmware::surface::{rgb, xrgb};
use relume_firmware::tile::{TILE_PIXELS, TILE_PX, Tile};
use relume_firmware::tone;

/// A pixel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 0x00RRGGBB.
    Xrgb8888,
    /// 0xAARRGGBB, premultiplied.
    Argb8888,
    /// 5 + 6 + 5 bits.
    Rgb565,
    /// 10 bits per channel.
    Xrgb2101010,
}

impl Format {
    /// The format of this number.
    pub fn new(number: u32) -> Result<Self, RelumeError> {
        match number {
            RELUME_FORMAT_XRGB8888 => Ok(Format::Xrgb8888),
            RELUME_FORMAT_ARGB8888 => Ok(Format::Argb8888),
            RELUME_FORMAT_RGB565 => Ok(Format::Rgb565),
            RELUME_FORMAT_XRGB2101010 => Ok(Format::Xrgb2101010),
            _ => Err(RelumeError::Format),
        }
    }

    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        if self == Format::Rgb565 { 2 } else { 4 }
    }

    /// A row of words (0x00RRGGBB; 0xAARRGGBB for [`Format::Argb8888`]) as this format's bytes; how many there are.
    pub fn row(self, words: &[u32], out: &mut [u8; 4 * TILE_PX]) -> usize {
        let size = self.bytes();
        for (bytes, &word) in out.chunks_exact_mut(size).zip(words) {
            match self {
                Format::Xrgb8888 | Format::Argb8888 => bytes.copy_from_slice(&word.to_ne_bytes()),
                Format::Rgb565 => bytes.copy_from_slice(&rgb565(word).to_ne_bytes()),
                Format::Xrgb2101010 => bytes.copy_from_slice(&xrgb2101010(word).to_ne_bytes()),
            }
        }
        size * words.len().min(TILE_PX)
    }
}

/// The nearest codes of 5, 6 and 5 bits.
fn rgb565(word: u32) -> u16 {
    let [r, g, b] = rgb(word);
    let nearest = |code: u8, most: u16| (u16::from(code) * most + 127) / 255;
    nearest(r, 31) << 11 | nearest(g, 63) << 5 | nearest(b, 31)
}

/// 8-bit codes widened so that 255 becomes 1023.
fn xrgb2101010(word: u32) -> u32 {
    let [r, g, b] = rgb(word).map(|code| u32::from(code) << 2 | u32::from(code) >> 6);
    r << 20 | g << 10 | b
}

/// A tile as 0xAARRGGBB, `[y][x]`, 0 where nothing covers it. The colour is that of the covered part, as a code, times
/// coverage: display hardware blends codes, not light.
pub fn premultiplied(tile: &Tile<'_>, linear: &LinearTile, kernel: Kernel) -> [u32; TILE_PIXELS] {
    let (mut shown, mut out) = ([0u32; TILE_PIXELS], [0u32; TILE_PIXELS]);
    let n = tile.padded_pixels();
    kernel.tone([&linear.0[0][..n], &linear.0[1][..n], &linear.0[2][..n]], &mut shown[..n]);
    for (k, pixel) in tile.covered().enumerate() {
        let alpha = tile.coverage.map_or(255, |c| c[k]);
        let colour = match alpha {
            255 => shown[k],
            0 => 0,
            _ => xrgb(linear.rgb(k).map(|value| covered_code(value, alpha))),
        };
        out[pixel] = u32::from(alpha) << 24 | colour;
    }
    out
}

/// The code of `premultiplied / coverage`, times coverage.
fn covered_code(premultiplied: f32, alpha: u8) -> u8 {
    let colour = tone::code(premultiplied * 255.0 / f32::from(alpha));
    ((u32::from(colour) * u32::from(alpha) + 127) / 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_goes_to_the_nearest_of_a_smaller_format() {
        for code in 0..=255u32 {
            let word = rgb565(code * 0x01_0101);
            let near = |found: u16, most: f64| (f64::from(found) / most * 255.0 - f64::from(code)).abs() * most / 255.0;
            assert!(near(word >> 11, 31.0) <= 0.5 && near(word >> 5 & 63, 63.0) <= 0.5 && near(word & 31, 31.0) <= 0.5);
            let wide = xrgb2101010(code * 0x01_0101);
            let exact = f64::from(code) * 1023.0 / 255.0;
            assert!([20, 10, 0].iter().all(|at| (f64::from(wide >> at & 1023) - exact).abs() < 1.0), "{code}");
        }
        assert_eq!((rgb565(0xff_0000), rgb565(0x00_ff00), rgb565(0x00_00ff)), (0xf800, 0x07e0, 0x001f));
        assert_eq!(xrgb2101010(0xff_ffff), 0x3fff_ffff);
    }

    #[test]
    fn an_edge_keeps_the_colour_of_what_covers_it() {
        assert_eq!(covered_code(1.0, 255), 255);
        // Half covered by white: half the light, the colour white, times one half.
        assert_eq!(covered_code(128.0 / 255.0, 128), 128);
        // By a mid grey of code 188.
        let grey = tone::srgb_linear(188.0);
        assert_eq!(covered_code((grey * 51.0 / 255.0) as f32, 51), (188.0f64 * 0.2).round() as u8);
        assert_eq!((covered_code(-5.0, 3), covered_code(f32::MAX, 1)), (0, 1));
    }

    #[test]
    fn rows_are_the_formats_bytes() {
        let mut out = [9u8; 64];
        assert_eq!(Format::Rgb565.row(&[0xff_0000, 0x00_00ff], &mut out), 4);
        assert_eq!([u16::from_ne_bytes([out[0], out[1]]), u16::from_ne_bytes([out[2], out[3]])], [0xf800, 0x001f]);
        assert_eq!(out[4], 9);
        assert_eq!(Format::Xrgb8888.row(&[0x12_3456; 3], &mut out), 12);
        assert_eq!(out[..4], 0x12_3456u32.to_ne_bytes());
    }
}
