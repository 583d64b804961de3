//! Compositing: a relit tile over the view, in linear light, to the surface.

use crate::coefficients::Coefficients;
use crate::field::Field;
use crate::kernel::{Extent, Kernel, Linear, Shown};
use crate::relight::{LinearTile, TileLight, add_rows};
use crate::surface::{Surface, rgb};
use crate::tile::{TILE_PIXELS, TILE_PX, Tile};
use crate::tone::ViewLight;

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

/// Where a tile is drawn.
#[derive(Debug)]
pub struct Target<'a, 's> {
    /// The rows of the picture from `surface_y0` on.
    pub surface: &'a mut Surface<'s>,
    /// The picture's row that is the surface's first.
    pub surface_y0: usize,
    /// The tile's top left pixel in the picture.
    pub at: (usize, usize),
}

impl Target<'_, '_> {
    /// The part of row `y` of the tile that the surface holds.
    fn row_mut(&mut self, y: usize) -> &mut [u32] {
        let (x0, y0) = self.at;
        let end = (x0 + TILE_PX).min(self.surface.width());
        &mut self.surface.row_mut(y0 + y - self.surface_y0)[x0..end]
    }

    /// Does the surface hold the whole square?
    fn is_inside(&self) -> bool {
        self.rows() == TILE_PX && self.at.0 + TILE_PX <= self.surface.width()
    }

    /// Rows of the tile that the surface holds.
    fn rows(&self) -> usize {
        TILE_PX.min((self.surface_y0 + self.surface.height()).saturating_sub(self.at.1))
    }
}

impl Compositor<'_> {
    /// Relights tile number `index` and writes it: `P + (1 - coverage) * view` per pixel, the view alone where nothing
    /// covers it. Returns the extent of its linear values. `linear` is a place to work in.
    ///
    /// A tile that is all covered goes straight from the field to the surface.
    pub fn tile(
        &self,
        field: &Field<'_>,
        index: usize,
        (coefficients, light): (&Coefficients, &TileLight<'_>),
        linear: &mut LinearTile,
        mut target: Target<'_, '_>,
    ) -> Extent {
        let tile = field.response().tile(index);
        let n = tile.padded_pixels();
        let coverage = field.coverage(index);
        let has_rows = add_rows(field, index, light, self.kernel, linear);
        if n == TILE_PIXELS && tile.pixels() == n && coverage.is_none() && !has_rows && target.is_inside() {
            let (x0, y0) = target.at;
            let (pixels_xrgb, stride) = target.surface.from_mut(x0, y0 - target.surface_y0);
            let job = coefficients.job(&tile, light.sun);
            return self.kernel.relight(&job, Linear::Skip, Some(Shown { pixels_xrgb, stride }));
        }
        let mut buffer = [0u32; TILE_PIXELS];
        let shown = Shown { pixels_xrgb: &mut buffer[..n], stride: TILE_PX };
        let job = coefficients.job(&tile, light.sun);
        let extent = if has_rows {
            self.kernel.relight(&job, Linear::Add(linear.planes(n)), Some(shown))
        } else if coverage.is_some() {
            coefficients.reconstruct(&tile, light.sun, self.kernel, linear)
        } else {
            self.kernel.relight(&job, Linear::Skip, Some(shown))
        };
        if let Some(coverage) = coverage {
            self.add_view(&tile, coverage, linear, target.at);
            self.kernel.tone(linear.planes(n).map(|plane| &*plane), &mut buffer[..n]);
        }
        self.spread(&tile, &buffer, &mut target);
        extent
    }

    /// Adds the light of the view behind pixels that cover only partly.
    fn add_view(&self, tile: &Tile<'_>, coverage: &[u8], linear: &mut LinearTile, (x0, y0): (usize, usize)) {
        for (k, (pixel, &alpha)) in tile.covered().zip(coverage).enumerate() {
            if alpha == 255 {
                continue;
            }
            let behind = rgb(self.view.at(x0 + pixel % TILE_PX, y0 + pixel / TILE_PX));
            let share = f32::from(255 - alpha) * (1.0 / 255.0);
            for (plane, code) in linear.0.iter_mut().zip(behind) {
                plane[k] += self.light.linear(code) * share;
            }
        }
    }

    /// Covered pixels' codes to their places, and the view between them.
    fn spread(&self, tile: &Tile<'_>, shown: &[u32; TILE_PIXELS], target: &mut Target<'_, '_>) {
        let (x0, y0) = target.at;
        let mut next = 0;
        for y in 0..target.rows() {
            let covered = u16::from_le_bytes([tile.record.mask[2 * y], tile.record.mask[2 * y + 1]]);
            let row = target.row_mut(y);
            let width = row.len();
            if covered != u16::MAX {
                self.view.copy_row(x0, y0 + y, row);
            }
            // A mask is runs of covered pixels: copy them whole.
            let (mut left, mut own) = (u32::from(covered), next);
            while left != 0 {
                let from = left.trailing_zeros();
                let run = (left >> from).trailing_ones();
                let end = (from + run) as usize;
                let kept = from as usize..end.min(width);
                if !kept.is_empty() {
                    row[kept.clone()].copy_from_slice(&shown[own..own + kept.len()]);
                }
                own += run as usize;
                left &= !0 << end;
            }
            next += covered.count_ones() as usize;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn over(premultiplied: f32, coverage: u8, view: u32) -> u32 {
        let light = ViewLight::new();
        let view = ViewPixels { pixels_xrgb: &[view], stride: 1 };
        let compositor = Compositor { view, light: &light, kernel: Kernel::SCALAR };
        let mut linear = LinearTile([[premultiplied; TILE_PIXELS]; 3]);
        let mut mask = [0; 32];
        mask[0] = 1;
        let tile = Tile::bare(mask);
        compositor.add_view(&tile, &[coverage], &mut linear, (0, 0));
        let mut shown = [0; 16];
        compositor.kernel.tone(linear.planes(16).map(|plane| &*plane), &mut shown);
        shown[0]
    }

    #[test]
    fn half_covered_white_over_black_and_over_white() {
        // Half of white light is code 188 in sRGB (255 * (1.055 * 0.502^(1/2.4) - 0.055) = 187.9).
        let half = 128.0 / 255.0;
        assert_eq!(over(half, 128, 0), 0x00bc_bcbc);
        assert_eq!(over(half, 128, 0x00ff_ffff), 0x00ff_ffff);
        assert_eq!(over(0.0, 1, 0x0012_3456), 0x0012_3456);
        assert_eq!(over(0.5, 255, 0x00ff_ffff), over(0.5, 255, 0));
    }

    #[test]
    fn spread_pixels_fill_the_mask_and_the_view_the_rest() {
        let light = ViewLight::new();
        let behind: [u32; 64] = core::array::from_fn(|k| 1000 + k as u32);
        let compositor =
            Compositor { view: ViewPixels { pixels_xrgb: &behind, stride: 16 }, light: &light, kernel: Kernel::SCALAR };
        let masks = [0u16, 0xffff, 0b1011_0000_1110_0001, 0x8001];
        let mut mask = [0; 32];
        for (bytes, row) in mask.chunks_exact_mut(2).zip(masks) {
            bytes.copy_from_slice(&row.to_le_bytes());
        }
        let tile = Tile::bare(mask);
        let shown = core::array::from_fn(|k| k as u32);
        // Whole, and cut off at the right and below.
        for (width, height) in [(16, 4), (13, 3), (1, 1)] {
            let mut pixels = [7u32; 80];
            let mut surface = Surface::new(&mut pixels, width, height, 20).unwrap();
            compositor.spread(&tile, &shown, &mut Target { surface: &mut surface, surface_y0: 0, at: (0, 0) });
            let mut next = 0;
            for (at, &found) in pixels.iter().enumerate() {
                let (x, y) = (at % 20, at / 20);
                let covered = x < 16 && masks[y] >> x & 1 == 1;
                next += u32::from(covered);
                let expected = match (x < width && y < height, covered) {
                    (false, _) => 7,
                    (true, true) => next - 1,
                    (true, false) => 1000 + (y * 16 + x) as u32,
                };
                assert_eq!(found, expected, "{x} {y} of {width} {height}");
            }
        }
    }
}
