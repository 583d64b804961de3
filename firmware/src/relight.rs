//! Relighting of one tile: coefficients -> linear pixels.

pub use crate::coefficients::Coefficients;
use crate::field::Field;
use crate::kernel::{Extent, Kernel, Linear, Reconstruction};
use crate::tile::{TILE_PIXELS, Tile};
use crate::weights::Standout;

/// Light beside the projected patches, the same for all tiles of a picture.
#[derive(Clone, Copy, Debug)]
pub struct TileLight<'a> {
    /// The sun's response plane of the whole field (u16 in 1/32768, laid out like the row scales) and its weight
    /// ([`crate::weights::FixedWeights::sun_q16`]); `None`: no sun.
    pub sun: Option<(&'a [u16], [u32; 3])>,
    /// Patches whose residuals are read ([`crate::weights::FixedWeights::standouts`]).
    pub standouts: &'a [Standout],
}

/// Unit of the sun's response (1/32768) times its weight (1/65536).
pub const SUN_UNIT: f32 = 1.0 / (1u64 << 31) as f32;

impl Coefficients {
    /// The kernel's job: this tile's pixels.
    ///
    /// `sun` is the sun's response plane of the whole field (u16 in 1/32768, laid out like the row scales) and its
    /// weight ([`crate::weights::FixedWeights::sun_q16`]).
    pub fn job<'a>(&'a self, tile: &Tile<'a>, sun: Option<(&'a [u16], [u32; 3])>) -> Reconstruction<'a> {
        let n = tile.padded_pixels();
        let pairs = self.rank() / 2;
        Reconstruction {
            u: tile.u,
            pixels: n,
            covered: tile.pixels(),
            pairs: [&self.pairs[0][..pairs], &self.pairs[1][..pairs], &self.pairs[2][..pairs]],
            rows: tile.rows,
            unit: self.unit,
            sun: sun.map(|(plane, weight)| {
                (&plane[tile.plane_at..tile.plane_at + 3 * n], weight.map(|q16| q16 as f32 * SUN_UNIT))
            }),
        }
    }

    /// Linear values of all padded pixels of the tile (1 = display white, premultiplied) into `out`, with a sun as
    /// [`Coefficients::job`] takes it.
    pub fn reconstruct(
        &self,
        tile: &Tile<'_>,
        sun: Option<(&[u16], [u32; 3])>,
        kernel: Kernel,
        out: &mut LinearTile,
    ) -> Extent {
        kernel.relight(&self.job(tile, sun), Linear::Write(out.planes(tile.padded_pixels())), None)
    }

    /// Asks for what the pixels of this tile will read.
    pub fn prefetch_pixels(tile: &Tile<'_>, kernel: Kernel) {
        kernel.prefetch(tile.u);
        kernel.prefetch(tile.rows);
    }

    /// Linear values of tile number `index` of `field` with all that belongs to its picture: patches, the sun, and the
    /// residuals of patches that outshine the sky. Tells whether there were residuals: the extent then lacks them.
    pub fn pixels(
        &self,
        field: &Field<'_>,
        index: usize,
        light: &TileLight<'_>,
        kernel: Kernel,
        out: &mut LinearTile,
    ) -> (Extent, bool) {
        let tile = field.response().tile(index);
        let extent = self.reconstruct(&tile, light.sun, kernel, out);
        let mut added = false;
        for standout in light.standouts {
            if let Some(residual) = field.residuals().get(index, &tile, usize::from(standout.patch)) {
                residual.add(standout.light, out.planes(tile.padded_pixels()));
                added = true;
            }
        }
        (extent, added)
    }
}

/// Linear values of one tile, `[channel][covered pixel]`, 1 = display white, premultiplied by coverage.
#[derive(Clone, Debug)]
pub struct LinearTile(pub [[f32; TILE_PIXELS]; 3]);

impl LinearTile {
    /// All zero.
    pub const fn new() -> Self {
        LinearTile([[0.0; TILE_PIXELS]; 3])
    }

    /// RGB of the covered pixel number `x` of the tile.
    pub fn rgb(&self, x: usize) -> [f32; 3] {
        [self.0[0][x], self.0[1][x], self.0[2][x]]
    }

    /// The first `n` pixels of each channel.
    pub fn planes(&mut self, n: usize) -> [&mut [f32]; 3] {
        self.0.each_mut().map(|plane| &mut plane[..n])
    }
}

impl Default for LinearTile {
    fn default() -> Self {
        Self::new()
    }
}
