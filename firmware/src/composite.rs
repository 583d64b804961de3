//! Compositing: a relit tile over the view, in linear light, to the surface.

use crate::apart::add_rows;
use crate::coefficients::Coefficients;
use crate::edge::Edges;
use crate::field::Field;
use crate::kernel::{Extent, Kernel, Linear, Shown};
use crate::relight::{LinearTile, TileLight};
use crate::surface::Surface;
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
    pub(crate) fn copy_row(&self, x: usize, y: usize, out: &mut [u32]) {
        let from = y * self.stride + x;
        match self.pixels_xrgb.get(from..from + out.len()) {
            Some(row) => out.copy_from_slice(row),
            None => out.fill(0),
        }
    }
}

/// What the view's linear light is multiplied by in one tile: the logarithm of a factor ([`crate::shade`]) for each of its 256
/// places, row by row, of red, green and blue.
pub type TileShade<'a> = [&'a [u16; TILE_PIXELS]; 3];

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
    /// Relights a tile and writes it: `P + (1 - coverage) * view` per pixel, the view alone where nothing covers it; the view
    /// times `shade`, if there is any. Returns the extent of its linear values. `linear` is a place to work in. The light of the
    /// edge pixels goes to `kept`, if that has room for it ([`Edges::light_len`]).
    ///
    /// A tile without gaps goes straight from the field to the surface; its edge pixels follow.
    pub fn tile(
        &self,
        (field, tile): (&Field<'_>, &Tile<'_>),
        (coefficients, light): (&Coefficients, &TileLight<'_>),
        linear: &mut LinearTile,
        kept: &mut [f32],
        shade: Option<TileShade<'_>>,
        mut target: Target<'_, '_>,
    ) -> Extent {
        let n = tile.padded_pixels();
        let mut room = None;
        let behind = self.behind(tile, shade, target.at, &mut room);
        let has_rows = add_rows(field, tile, light, self.kernel, linear);
        let job = coefficients.job(tile, light.sun);
        let to = match (has_rows, tile.coverage) {
            (true, _) => Linear::Add(linear.planes(n)),
            (false, Some(_)) => Linear::Write(linear.planes(n)),
            (false, None) => Linear::Skip,
        };
        let extent = if tile.pixels() == TILE_PIXELS && target.is_inside() {
            let (x0, y0) = target.at;
            let (pixels_xrgb, stride) = target.surface.from_mut(x0, y0 - target.surface_y0);
            self.kernel.relight(&job, to, Some(Shown { pixels_xrgb, stride }))
        } else {
            let mut buffer = [0u32; TILE_PIXELS];
            let shown = Shown { pixels_xrgb: &mut buffer[..n], stride: TILE_PX };
            let extent = self.kernel.relight(&job, to, Some(shown));
            spread(tile, &buffer, &mut target);
            behind.fill_gaps(tile, &mut target);
            extent
        };
        if tile.coverage.is_some() {
            let edges = Edges::new(tile);
            edges.gather(linear);
            if !kept.is_empty() {
                edges.keep(linear, kept);
            }
            self.edges(&edges, &behind, linear, &mut target);
        }
        extent
    }

    /// Writes what has changed of a tile because the view or its shade has: its edge pixels, whose light was `kept`, and where
    /// nothing covers the view.
    pub fn view_alone(
        &self,
        tile: &Tile<'_>,
        kept: &[f32],
        linear: &mut LinearTile,
        shade: Option<TileShade<'_>>,
        mut target: Target<'_, '_>,
    ) {
        let mut room = None;
        let behind = self.behind(tile, shade, target.at, &mut room);
        behind.fill_gaps(tile, &mut target);
        if !kept.is_empty() {
            let edges = Edges::new(tile);
            edges.recall(kept, linear);
            self.edges(&edges, &behind, linear, &mut target);
        }
    }

    /// What is behind a tile at these pixels of the picture; shaded in `room`, unless it is hidden.
    fn behind<'b>(
        &'b self,
        tile: &Tile<'_>,
        shade: Option<TileShade<'_>>,
        (x0, y0): (usize, usize),
        room: &'b mut Option<[u32; TILE_PIXELS]>,
    ) -> Behind<'b> {
        let shows = tile.pixels() < TILE_PIXELS || tile.coverage.is_some();
        let Some(log_factors) = shade.filter(|_| shows) else { return Behind { view: self.view, at: (x0, y0) } };
        let room = room.insert([0; TILE_PIXELS]);
        let width = TILE_PX.min(self.view.stride.saturating_sub(x0));
        for (row, room) in room.chunks_exact_mut(TILE_PX).enumerate() {
            self.view.copy_row(x0, y0 + row, &mut room[..width]);
        }
        self.kernel.shade(room, log_factors.map(|plane| plane.as_slice()));
        Behind { view: ViewPixels { pixels_xrgb: room, stride: TILE_PX }, at: (0, 0) }
    }

    /// Edge pixels over the view; their light lies at the front of `linear`.
    fn edges(&self, edges: &Edges, behind: &Behind<'_>, linear: &mut LinearTile, target: &mut Target<'_, '_>) {
        let (n, (x0, y0), view) = (edges.padded(), behind.at, behind.view);
        let (mut behind, mut shown) = ([0u32; TILE_PIXELS], [0u32; TILE_PIXELS]);
        for (behind, place) in behind.iter_mut().zip(edges.places()) {
            *behind = view.at(x0 + place % TILE_PX, y0 + place / TILE_PX);
        }
        self.kernel.add_view(&behind[..n], edges.coverage(), self.light, linear.planes(n));
        self.kernel.tone(linear.planes(n).map(|plane| &*plane), &mut shown[..n]);
        let rows = target.rows();
        for (&word, place) in shown.iter().zip(edges.places()).filter(|(_, place)| place / TILE_PX < rows) {
            if let Some(pixel) = target.row_mut(place / TILE_PX).get_mut(place % TILE_PX) {
                *pixel = word;
            }
        }
    }
}

/// What is behind one tile: whose top left pixel lies there in it.
struct Behind<'a> {
    view: ViewPixels<'a>,
    at: (usize, usize),
}

impl Behind<'_> {
    /// The view where nothing covers it.
    fn fill_gaps(&self, tile: &Tile<'_>, target: &mut Target<'_, '_>) {
        let (x0, y0) = self.at;
        for y in 0..target.rows() {
            let row = target.row_mut(y);
            for run in runs(!tile.mask_row(y)) {
                let open = run.start..run.end.min(row.len());
                if !open.is_empty() {
                    self.view.copy_row(x0 + open.start, y0 + y, &mut row[open]);
                }
            }
        }
    }
}

/// Covered pixels' codes to their places.
fn spread(tile: &Tile<'_>, shown: &[u32; TILE_PIXELS], target: &mut Target<'_, '_>) {
    let mut next = 0;
    for y in 0..target.rows() {
        let covered = tile.mask_row(y);
        let row = target.row_mut(y);
        let mut own = next;
        for run in runs(covered) {
            let kept = run.start..run.end.min(row.len());
            if !kept.is_empty() {
                row[kept.clone()].copy_from_slice(&shown[own..own + kept.len()]);
            }
            own += run.len();
        }
        next += covered.count_ones() as usize;
    }
}

/// The runs of ones in a row's bits: masks are made of few, and what lies in one is copied whole.
fn runs(bits: u16) -> impl Iterator<Item = core::ops::Range<usize>> {
    let mut left = u32::from(bits);
    core::iter::from_fn(move || {
        let from = left.trailing_zeros();
        let end = from + left.checked_shr(from)?.trailing_ones();
        left &= u32::MAX.checked_shl(end).unwrap_or(0);
        Some(from as usize..end as usize)
    })
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
        let mut pixels = [crate::surface::xrgb([crate::tone::code(premultiplied); 3])];
        let mut surface = Surface::new(&mut pixels, 1, 1, 1).unwrap();
        let edges = Edges::new(&Tile { coverage: Some(&[coverage]), ..Tile::bare(mask) });
        let mut target = Target { surface: &mut surface, surface_y0: 0, at: (0, 0) };
        let behind = Behind { view, at: (0, 0) };
        compositor.edges(&edges, &behind, &mut linear, &mut target);
        pixels[0]
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
        let pixels_xrgb: [u32; 64] = core::array::from_fn(|k| 1000 + k as u32);
        let behind = Behind { view: ViewPixels { pixels_xrgb: &pixels_xrgb, stride: 16 }, at: (0, 0) };
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
            let mut target = Target { surface: &mut surface, surface_y0: 0, at: (0, 0) };
            spread(&tile, &shown, &mut target);
            behind.fill_gaps(&tile, &mut target);
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
