//! The surface: a borrowed picture of 0x00RRGGBB words that tiles and the overlay draw on.

use embedded_graphics::Pixel;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::DrawTarget;
use embedded_graphics::primitives::Rectangle;

/// 32-bit pixels 0x00RRGGBB (DRM's XRGB8888 on a little-endian machine), rows `stride` words apart.
#[derive(Debug)]
pub struct Surface<'a> {
    pixels_xrgb: &'a mut [u32],
    width: usize,
    height: usize,
    stride: usize,
}

/// The buffer does not hold the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceError {
    /// Words needed.
    pub need: usize,
    /// Words given.
    pub have: usize,
}

impl core::fmt::Display for SurfaceError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "surface needs {} pixels, the buffer has {}", self.need, self.have)
    }
}

impl core::error::Error for SurfaceError {}

impl<'a> Surface<'a> {
    /// Borrows `pixels_xrgb` as `height` rows of `width` pixels, `stride` words apart.
    ///
    /// # Errors
    /// If the buffer is too short or `stride < width`.
    pub fn new(pixels_xrgb: &'a mut [u32], width: usize, height: usize, stride: usize) -> Result<Self, SurfaceError> {
        let need = height.saturating_sub(1).saturating_mul(stride).saturating_add(width);
        if stride < width || pixels_xrgb.len() < need {
            return Err(SurfaceError { need: need.max(width), have: pixels_xrgb.len() });
        }
        Ok(Surface { pixels_xrgb, width, height, stride })
    }

    /// Width, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// One row, `y < height()`.
    pub fn row_mut(&mut self, y: usize) -> &mut [u32] {
        &mut self.pixels_xrgb[y * self.stride..][..self.width]
    }

    /// All words from a pixel on, and the words from row to row; nothing if the pixel is outside.
    pub fn from_mut(&mut self, x: usize, y: usize) -> (&mut [u32], usize) {
        (self.pixels_xrgb.get_mut(y * self.stride + x..).unwrap_or_default(), self.stride)
    }

    /// The part of the surface that a rectangle covers.
    fn clip(&self, area: &Rectangle) -> Rectangle {
        area.intersection(&Rectangle::new(Point::zero(), self.size()))
    }
}

/// Packs 8-bit RGB as 0x00RRGGBB.
#[inline]
pub fn xrgb([r, g, b]: [u8; 3]) -> u32 {
    u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b)
}

/// Unpacks 0x00RRGGBB.
#[inline]
pub fn rgb(xrgb: u32) -> [u8; 3] {
    [(xrgb >> 16) as u8, (xrgb >> 8) as u8, xrgb as u8]
}

impl OriginDimensions for Surface<'_> {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Surface<'_> {
    type Color = Rgb888;
    type Error = core::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        for Pixel(at, color) in pixels {
            let (Ok(x), Ok(y)) = (usize::try_from(at.x), usize::try_from(at.y)) else { continue };
            if x < self.width && y < self.height {
                self.row_mut(y)[x] = xrgb([color.r(), color.g(), color.b()]);
            }
        }
        Ok(())
    }

    fn fill_contiguous<I: IntoIterator<Item = Rgb888>>(
        &mut self,
        area: &Rectangle,
        colors: I,
    ) -> Result<(), Self::Error> {
        let kept = self.clip(area);
        let mut colors = colors.into_iter();
        for y in area.rows() {
            for x in area.columns() {
                let Some(color) = colors.next() else { return Ok(()) };
                if kept.contains(Point::new(x, y)) {
                    self.row_mut(y as usize)[x as usize] = xrgb([color.r(), color.g(), color.b()]);
                }
            }
        }
        Ok(())
    }

    fn fill_solid(&mut self, area: &Rectangle, color: Rgb888) -> Result<(), Self::Error> {
        let kept = self.clip(area);
        let word = xrgb([color.r(), color.g(), color.b()]);
        for y in kept.rows() {
            let columns = kept.columns();
            self.row_mut(y as usize)[columns.start as usize..columns.end as usize].fill(word);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use embedded_graphics::primitives::{Circle, Primitive, PrimitiveStyle};
    use embedded_graphics::{Drawable, mock_display::MockDisplay};
    use std::vec;

    #[test]
    fn fills_are_clipped_and_leave_the_stride_alone() {
        let mut pixels = vec![7u32; 10 * 4];
        let mut surface = Surface::new(&mut pixels, 8, 4, 10).unwrap();
        surface.fill_solid(&Rectangle::new(Point::new(-3, 1), Size::new(100, 2)), Rgb888::RED).unwrap();
        let colors = (0..9).map(|k| Rgb888::new(k, 0, 0));
        surface.fill_contiguous(&Rectangle::new(Point::new(6, 3), Size::new(3, 3)), colors).unwrap();
        for (at, &word) in pixels.iter().enumerate() {
            let expected = match (at % 10, at / 10) {
                (0..8, 1 | 2) => 0xff_0000,
                (6, 3) => 0,
                (7, 3) => 0x01_0000,
                _ => 7,
            };
            assert_eq!(word, expected, "{at}");
        }
    }

    #[test]
    fn draws_what_the_mock_display_of_embedded_graphics_draws() {
        let circle = Circle::new(Point::new(3, 2), 11).into_styled(PrimitiveStyle::with_stroke(Rgb888::GREEN, 2));
        let mut mock = MockDisplay::<Rgb888>::new();
        circle.draw(&mut mock).unwrap();
        let mut pixels = vec![0u32; 20 * 20];
        circle.draw(&mut Surface::new(&mut pixels, 20, 20, 20).unwrap()).unwrap();
        for (at, &word) in pixels.iter().enumerate() {
            let drawn = mock.get_pixel(Point::new((at % 20) as i32, (at / 20) as i32)).is_some();
            assert_eq!(word != 0, drawn, "{at}");
        }
    }

    #[test]
    fn a_short_buffer_is_refused() {
        assert!(Surface::new(&mut [0; 31], 8, 4, 8).is_err());
        assert!(Surface::new(&mut [0; 32], 8, 4, 7).is_err());
    }
}
