//! The RGB picture that charts and contact sheets are drawn on.

use std::path::Path;

use embedded_graphics::mono_font::iso_8859_1::{FONT_6X10, FONT_8X13, FONT_9X15_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, RgbColor, Size};
use embedded_graphics::primitives::Rectangle;
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};

use crate::picture::{PictureError, write_png};

/// Lines and markers are drawn this many times larger in each direction, then averaged.
pub const OVERSAMPLE: u32 = 3;

/// Small text: ticks and legends.
pub(super) const SMALL: &MonoFont<'static> = &FONT_6X10;
/// Text of axis labels and captions.
pub(super) const MEDIUM: &MonoFont<'static> = &FONT_8X13;
/// Titles.
pub(super) const LARGE: &MonoFont<'static> = &FONT_9X15_BOLD;

/// An 8-bit sRGB picture, row 0 at the top; an `embedded-graphics` draw target of [`Rgb888`]. Drawing outside is ignored.
#[derive(Clone, Debug, PartialEq)]
pub struct Canvas {
    width: u32,
    height: u32,
    pixels: Vec<[u8; 3]>,
}

impl Canvas {
    /// A canvas of one colour.
    pub fn new(width: u32, height: u32, fill: Rgb888) -> Self {
        let pixels = vec![[fill.r(), fill.g(), fill.b()]; width as usize * height as usize];
        Canvas { width, height, pixels }
    }

    /// A canvas from pixels `0x00RRGGBB`, row-major; missing pixels are black, surplus ones are ignored.
    pub fn from_xrgb(width: u32, height: u32, pixels: &[u32]) -> Self {
        let mut canvas = Canvas::new(width, height, Rgb888::BLACK);
        for (to, &from) in canvas.pixels.iter_mut().zip(pixels) {
            let [_, r, g, b] = from.to_be_bytes();
            *to = [r, g, b];
        }
        canvas
    }

    /// Pixels per row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, row-major, sRGB.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// Copies `picture` with its top left corner at `(x, y)`; what falls outside is cut off.
    pub fn paste(&mut self, picture: &Canvas, x: u32, y: u32) {
        let columns = picture.width.min(self.width.saturating_sub(x)) as usize;
        for row in 0..picture.height.min(self.height.saturating_sub(y)) {
            let from = row as usize * picture.width as usize;
            let to = (row + y) as usize * self.width as usize + x as usize;
            self.pixels[to..to + columns].copy_from_slice(&picture.pixels[from..from + columns]);
        }
    }

    /// The picture at `1 / factor` of its size, each pixel the mean of `factor x factor`; surplus edges are cut off.
    pub fn reduced(&self, factor: u32) -> Canvas {
        let factor = factor.max(1);
        let mut small = Canvas::new(self.width / factor, self.height / factor, Rgb888::BLACK);
        for y in 0..small.height {
            for x in 0..small.width {
                let mut sum = [0u32; 3];
                for row in y * factor..(y + 1) * factor {
                    let from = row as usize * self.width as usize + (x * factor) as usize;
                    for pixel in &self.pixels[from..from + factor as usize] {
                        sum.iter_mut().zip(pixel).for_each(|(sum, &code)| *sum += u32::from(code));
                    }
                }
                let count = factor * factor;
                small.pixels[(y * small.width + x) as usize] = sum.map(|sum| ((sum + count / 2) / count) as u8);
            }
        }
        small
    }

    /// The picture turned by a quarter, anticlockwise: for the label of an upright axis.
    pub fn turned(&self) -> Canvas {
        let mut turned = Canvas::new(self.height, self.width, Rgb888::BLACK);
        for y in 0..self.height {
            for x in 0..self.width {
                let to = (self.width - 1 - x) * self.height + y;
                turned.pixels[to as usize] = self.pixels[(y * self.width + x) as usize];
            }
        }
        turned
    }

    /// Writes the picture as a PNG. The file appears whole or not at all.
    ///
    /// # Errors
    /// [`PictureError`] when the canvas is empty or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), PictureError> {
        let pixels: Vec<u32> = self.pixels.iter().map(|&[r, g, b]| u32::from_be_bytes([0, r, g, b])).collect();
        write_png(path, self.width as usize, self.height as usize, &pixels)
    }

    /// Draws one line of text; `anchor` is its middle, start or end (by `alignment`) at half its height.
    pub(super) fn text(
        &mut self,
        text: &str,
        anchor: (i32, i32),
        font: &'static MonoFont<'static>,
        ink: Rgb888,
        at: Alignment,
    ) {
        let style = TextStyleBuilder::new().alignment(at).baseline(Baseline::Middle).build();
        let text = Text::with_text_style(text, Point::new(anchor.0, anchor.1), MonoTextStyle::new(font, ink), style);
        let Ok(_) = text.draw(self);
    }
}

/// Width in pixels of one line of text.
pub(super) fn text_width(text: &str, font: &MonoFont<'_>) -> i32 {
    let advance = font.character_size.width + font.character_spacing;
    (text.chars().count() as u32 * advance) as i32
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = core::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        for Pixel(at, color) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y))
                && x < self.width
                && y < self.height
            {
                self.pixels[y as usize * self.width as usize + x as usize] = [color.r(), color.g(), color.b()];
            }
        }
        Ok(())
    }

    fn fill_solid(&mut self, area: &Rectangle, color: Rgb888) -> Result<(), Self::Error> {
        let area = area.intersection(&Rectangle::new(Point::zero(), self.size()));
        let Some(end) = area.bottom_right() else { return Ok(()) };
        for y in area.top_left.y..=end.y {
            let row = y as usize * self.width as usize;
            self.pixels[row + area.top_left.x as usize..=row + end.x as usize].fill([color.r(), color.g(), color.b()]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reducing_averages_and_turning_four_times_is_nothing() {
        let canvas = Canvas::from_xrgb(4, 2, &[0, 0x20_40_60, 10, 10, 0x20_00_00, 0, 30, 30]);
        assert_eq!(canvas.reduced(2).pixels(), [[16, 16, 24], [0, 0, 20]]);
        assert_eq!(canvas.turned().turned().turned().turned(), canvas);
        assert_eq!(canvas.turned().pixels()[6], canvas.pixels()[0]);
    }

    #[test]
    fn drawing_and_pasting_outside_is_cut_off() {
        let mut canvas = Canvas::new(3, 3, Rgb888::BLACK);
        canvas.paste(&Canvas::new(4, 4, Rgb888::WHITE), 2, 1);
        canvas.fill_solid(&Rectangle::new(Point::new(-5, -5), Size::new(6, 6)), Rgb888::RED).unwrap();
        assert_eq!(canvas.pixels()[0], [255, 0, 0]);
        assert_eq!(canvas.pixels().iter().filter(|pixel| **pixel == [255; 3]).count(), 2);
        canvas.text("far outside", (-500, 900), SMALL, Rgb888::WHITE, Alignment::Left);
    }

    #[test]
    fn a_saved_picture_is_read_back_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let canvas = Canvas::from_xrgb(2, 1, &[0x01_02_03, 0xff_80_00]);
        let path = folder.path().join("a.png");
        canvas.save(&path).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgb8().into_raw(), [1, 2, 3, 255, 128, 0]);
        assert!(canvas.save(&folder.path().join("no/such/a.png")).is_err());
    }
}
