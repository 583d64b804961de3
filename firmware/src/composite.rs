//! Compositing: a relit tile over the view, in linear light, to the surface.

use crate::kernel::Kernel;
use crate::relight::LinearTile;
use crate::surface::{Surface, rgb, xrgb};
use crate::tile::{TILE_PIXELS, TILE_PX, Tile};
use crate::tone::{self, ViewLight};

/// The real view behind: 0x00RRGGBB sRGB pixels, rows `stride` words apart.
#[derive(Clone, Copy, Debug)]
pub struct ViewPixels<'a> {
    /// Pixels.
    pub pixels_xrgb: &'a [u32],
    /// Words from row to row.
    pub stride: usize,
}

impl ViewPixels<'_> {
    #[inline]
    fn at(&self, x: usize, y: usize) -> u32 {
        self.pixels_xrgb.get(y * self.stride + x).copied().unwrap_or(0)
    }

    /// Copies a part of row `y` from `x` on; what the view lacks is black.
    fn copy_row(&self, x: usize, y: usize, out: &mut [u32]) {
        let from = y * self.stride + x;
        match self.pixels_xrgb.get(from..from + out.len()) {
            Some(row) => out.copy_from_slice(row),
            None => out.fill(0),
        }
    }
}

/// What all tiles of a frame are composited with.
#[derive(Clone, Copy, Debug)]
pub struct Compositor<'a> {
    /// The view behind.
    pub view: ViewPixels<'a>,
    /// The view's codes in linear light.
    pub light: &'a ViewLight,
    /// Kernel path.
    pub kernel: Kernel,
}

impl Compositor<'_> {
    /// Writes one tile: `P + (1 - coverage) * view` per pixel, the view alone where nothing covers it.
    ///
    /// `x0`, `y0` is the tile's top left pixel, `coverage` as [`crate::field::Field::coverage`] gives it; `surface`
    /// holds the rows of the picture from `surface_y0` on.
    pub fn tile(
        &self,
        tile: &Tile<'_>,
        linear: &LinearTile,
        coverage: Option<&[u8]>,
        (x0, y0): (usize, usize),
        (surface, surface_y0): (&mut Surface<'_>, usize),
    ) {
        let mut shown = [0u32; TILE_PIXELS];
        let n = tile.padded_pixels();
        self.kernel.tone([&linear.0[0][..n], &linear.0[1][..n], &linear.0[2][..n]], &mut shown[..n]);
        let width = TILE_PX.min(surface.width().saturating_sub(x0));
        let height = TILE_PX.min((surface_y0 + surface.height()).saturating_sub(y0));
        let whole = tile.pixels() == TILE_PIXELS && coverage.is_none();
        let mut next = 0;
        for y in 0..height {
            let row = &mut surface.row_mut(y0 + y - surface_y0)[x0..x0 + width];
            let own = &shown[y * TILE_PX..][..TILE_PX];
            if whole {
                // A row of known length is copied without a call.
                match <&mut [u32; TILE_PX]>::try_from(&mut *row) {
                    Ok(row) => row.copy_from_slice(own),
                    Err(_) => row.copy_from_slice(&own[..width]),
                }
                continue;
            }
            let covered = u16::from_le_bytes([tile.record.mask[2 * y], tile.record.mask[2 * y + 1]]);
            if covered == 0 {
                self.view.copy_row(x0, y0 + y, row);
                continue;
            }
            for (x, out) in row.iter_mut().enumerate() {
                if covered >> x & 1 == 0 {
                    *out = self.view.at(x0 + x, y0 + y);
                    continue;
                }
                *out = match coverage.map_or(255, |c| c[next]) {
                    255 => shown[next],
                    alpha => self.over(linear.rgb(next), alpha, self.view.at(x0 + x, y0 + y)),
                };
                next += 1;
            }
        }
    }

    /// `P + (1 - coverage) * view` in linear light.
    fn over(&self, premultiplied: [i32; 3], coverage: u8, view: u32) -> u32 {
        let behind = rgb(view);
        let mut codes = [0; 3];
        for c in 0..3 {
            let light = self.light.linear_q20(behind[c]) * u32::from(255 - coverage);
            codes[c] = tone::code(premultiplied[c].saturating_add(((light + 127) / 255) as i32));
        }
        xrgb(codes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_covered_white_over_black_and_over_white() {
        let light = ViewLight::new();
        let view = ViewPixels { pixels_xrgb: &[], stride: 0 };
        let compositor = Compositor { view, light: &light, kernel: Kernel::SCALAR };
        // Half of white light is code 188 in sRGB (255 * (1.055 * 0.502^(1/2.4) - 0.055) = 187.9).
        let half = (1 << 20) * 128 / 255;
        assert_eq!(compositor.over([half; 3], 128, 0), 0x00bc_bcbc);
        assert_eq!(compositor.over([half; 3], 128, 0x00ff_ffff), 0x00ff_ffff);
        assert_eq!(compositor.over([0; 3], 1, 0x0012_3456), 0x0012_3456);
    }
}
