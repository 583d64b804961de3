//! Compositing: a relit tile over the view, in linear light, to the surface.

use crate::relight::LinearTile;
use crate::surface::{Surface, rgb, xrgb};
use crate::tile::{TILE_PX, Tile};
use crate::tone::ToneTables;

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
}

/// Writes one tile: `P + (1 - coverage) * view` per pixel, the view alone where nothing covers it.
///
/// `x0`, `y0` is the tile's top left pixel, `coverage` as [`crate::field::Field::coverage`] gives it; `surface` holds
/// the rows from `surface_y0` on.
pub fn composite_tile(
    tile: &Tile<'_>,
    linear: &LinearTile,
    coverage: Option<&[u8]>,
    view: &ViewPixels<'_>,
    (x0, y0): (usize, usize),
    tones: &ToneTables,
    (surface, surface_y0): (&mut Surface<'_>, usize),
) {
    let mut covered = tile.covered().enumerate().peekable();
    let width = TILE_PX.min(surface.width().saturating_sub(x0));
    let height = TILE_PX.min((surface_y0 + surface.height()).saturating_sub(y0));
    for y in 0..height {
        let row = &mut surface.row_mut(y0 + y - surface_y0)[x0..x0 + width];
        for (x, out) in row.iter_mut().enumerate() {
            *out = match covered.next_if(|&(_, at)| at == y * TILE_PX + x) {
                None => view.at(x0 + x, y0 + y),
                Some((k, _)) => match coverage.map_or(255, |c| c[k]) {
                    255 => xrgb(linear.rgb(k).map(|value| tones.code(value))),
                    alpha => over(linear.rgb(k), alpha, view.at(x0 + x, y0 + y), tones),
                },
            };
        }
    }
}

/// `P + (1 - coverage) * view` in linear light.
fn over(premultiplied: [i32; 3], coverage: u8, view: u32, tones: &ToneTables) -> u32 {
    let behind = rgb(view);
    let mut codes = [0; 3];
    for c in 0..3 {
        let light = tones.linear_q20(behind[c]) * u32::from(255 - coverage);
        codes[c] = tones.code(premultiplied[c].saturating_add(((light + 127) / 255) as i32));
    }
    xrgb(codes)
}
