//! Relighting of one tile: coefficients -> linear pixels.

pub use crate::coefficients::Coefficients;
use crate::field::Field;
use crate::kernel::{Kernel, Reconstruction};
use crate::tile::{TILE_PIXELS, Tile};
use crate::weights::Standout;

/// Binary places of a linear value: `1 << LINEAR_BITS` shows as display white.
pub const LINEAR_BITS: i32 = 20;

/// Light beside the projected patches, the same for all tiles of a picture.
#[derive(Clone, Copy, Debug)]
pub struct TileLight<'a> {
    /// The sun's response plane of the whole field (u16 in 1/32768, laid out like the row scales) and its weight
    /// ([`crate::weights::FixedWeights::sun_q16`]); `None`: no sun.
    pub sun: Option<(&'a [u16], [u32; 3])>,
    /// Patches whose residuals are read ([`crate::weights::FixedWeights::standouts`]).
    pub standouts: &'a [Standout],
}

impl Coefficients {
    /// Linear values of all padded pixels of the tile (1/2^20 of display white, premultiplied) into `out`.
    ///
    /// `sun` is the sun's response plane of the whole field (u16 in 1/32768, laid out like the row scales) and its
    /// weight ([`crate::weights::FixedWeights::sun_q16`]).
    pub fn reconstruct(&self, tile: &Tile<'_>, sun: Option<(&[u16], [u32; 3])>, kernel: Kernel, out: &mut LinearTile) {
        let n = tile.padded_pixels();
        let pairs = self.rank() / 2;
        let job = Reconstruction {
            u: tile.u,
            pixels: n,
            pairs: [&self.pairs[0][..pairs], &self.pairs[1][..pairs], &self.pairs[2][..pairs]],
            rows: tile.rows,
            right: self.right.map(u32::from),
            left: self.left.map(u32::from),
            sun: sun.map(|(plane, weight)| (&plane[tile.plane_at..tile.plane_at + 3 * n], weight)),
        };
        let [r, g, b] = &mut out.0;
        kernel.reconstruct(&job, [&mut r[..n], &mut g[..n], &mut b[..n]]);
    }

    /// Asks for what the pixels of this tile will read.
    pub fn prefetch_pixels(tile: &Tile<'_>, kernel: Kernel) {
        kernel.prefetch(tile.u);
        kernel.prefetch(tile.rows);
    }

    /// Linear values of tile number `index` of `field` with all that belongs to its picture: patches, the sun, and the
    /// residuals of patches that outshine the sky.
    pub fn pixels(&self, field: &Field<'_>, index: usize, light: &TileLight<'_>, kernel: Kernel, out: &mut LinearTile) {
        let tile = field.response().tile(index);
        self.reconstruct(&tile, light.sun, kernel, out);
        let n = tile.padded_pixels();
        for standout in light.standouts {
            if let Some(residual) = field.residuals().get(index, &tile, usize::from(standout.patch)) {
                let [r, g, b] = &mut out.0;
                kernel.add_residual(&residual.term(standout.light, n), [&mut r[..n], &mut g[..n], &mut b[..n]]);
            }
        }
    }
}

/// Linear values of one tile, `[channel][covered pixel]` in 1/2^20 of display white, premultiplied by coverage.
#[derive(Clone, Debug)]
pub struct LinearTile(pub [[i32; TILE_PIXELS]; 3]);

impl LinearTile {
    /// All zero.
    pub const fn new() -> Self {
        LinearTile([[0; TILE_PIXELS]; 3])
    }

    /// RGB of the covered pixel number `x` of the tile.
    pub fn rgb(&self, x: usize) -> [i32; 3] {
        [self.0[0][x], self.0[1][x], self.0[2][x]]
    }
}

impl Default for LinearTile {
    fn default() -> Self {
        Self::new()
    }
}
