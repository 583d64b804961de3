//! Relighting of one tile: coefficients -> linear pixels.

use crate::apart::{UnpackedRows, add_rows};
pub use crate::coefficients::Coefficients;
use crate::field::Field;
use crate::kernel::{Extent, Kernel, Linear, Reconstruction, UNIT_LIMIT};
use crate::tile::{TILE_PIXELS, Tile};
use crate::weights::FixedWeights;

/// Light beside the projected patches, the same for all tiles of a picture.
#[derive(Clone, Copy, Debug)]
pub struct TileLight<'a> {
    /// The sun's response plane of the whole field (u16 in 1/32768, laid out like the row scales) and its weight
    /// ([`crate::weights::FixedWeights::sun_q16`]); `None`: no sun.
    pub sun: Option<(&'a [u16], [u32; 3])>,
    /// The weights that the coefficients came from: patches that they set apart are added by their own rows.
    pub weights: &'a FixedWeights,
    /// Those of them whose rows are unpacked already, best in the order of the weights.
    pub unpacked: &'a [UnpackedRows<'a>],
}

impl TileLight<'_> {
    /// Asks for what the pixels of this tile will read.
    pub fn prefetch(&self, tile: &Tile<'_>, kernel: Kernel) {
        kernel.prefetch_stream(tile.u);
        kernel.prefetch_stream(tile.rows);
        let slot = tile.plane_at..tile.plane_at + 3 * tile.padded_pixels();
        if let Some((plane, _)) = self.sun {
            kernel.prefetch_stream(&plane[slot.clone()]);
        }
        for (place, apart) in self.weights.apart().enumerate() {
            if let Some(unpacked) = UnpackedRows::of(self.unpacked, place, apart.patch) {
                kernel.prefetch_stream(&unpacked.codes[slot.clone()]);
            }
        }
    }
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
        let pairs = self.rank().min(tile.rank()) / 2;
        let unit = |c: usize| (self.unit[c] * tile.row_unit(c)).min(UNIT_LIMIT);
        Reconstruction {
            u: tile.u,
            pixels: n,
            covered: tile.pixels(),
            pairs: [&self.pairs[0][..pairs], &self.pairs[1][..pairs], &self.pairs[2][..pairs]],
            rows: tile.rows,
            unit: [unit(0), unit(1), unit(2)],
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

    /// Linear values of a tile of `field` with all that belongs to its picture: factors, the sun, and the
    /// rows of patches that are set apart.
    pub fn pixels(
        &self,
        field: &Field<'_>,
        tile: &Tile<'_>,
        light: &TileLight<'_>,
        kernel: Kernel,
        out: &mut LinearTile,
    ) -> Extent {
        let has_rows = add_rows(field, tile, light, kernel, out);
        let planes = out.planes(tile.padded_pixels());
        let linear = if has_rows { Linear::Add(planes) } else { Linear::Write(planes) };
        kernel.relight(&self.job(tile, light.sun), linear, None)
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
