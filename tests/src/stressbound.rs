//! The certified bound of every tile under a light beside the tile's true error against the uncompressed response.

use crate::stressfield::{Matter, StressField};
use relume_firmware::bound::{BoundLight, CodeSlope, DARK_POWER};
use relume_firmware::coefficients::Coefficients;
use relume_firmware::drawn::{Dimmest, DrawnTile, Off, ShownLight, dark_shares};
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::relight::{LinearTile, TileLight};
use relume_firmware::tile::Tile;
use relume_firmware::tone::srgb_code;
use relume_firmware::weights::{Apart, FixedWeights, LightApart};

/// Largest of something over a tile's pixels and channels: linear, over (row scale / 65535)^0.583, and in codes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured {
    /// Radiance times exposure.
    pub plain: f64,
    /// The same, by darkness.
    pub weighted: f64,
    /// 8-bit sRGB codes before rounding.
    pub codes: f64,
}

impl Measured {
    fn of(self, other: Measured, f: fn(f64, f64) -> f64) -> Measured {
        let (plain, weighted) = (f(self.plain, other.plain), f(self.weighted, other.weighted));
        Measured { plain, weighted, codes: f(self.codes, other.codes) }
    }

    /// The larger of each.
    pub fn max(self, other: Measured) -> Measured {
        self.of(other, f64::max)
    }
}

/// Bound and error of a tile, and the largest share of its bound that the error of any channel takes.
#[derive(Clone, Copy, Debug, Default)]
pub struct TileFound {
    /// What the bound says.
    pub bound: Measured,
    /// What is true.
    pub error: Measured,
    /// Error over bound: above 1 the bound is broken.
    pub share: Measured,
}

/// Relights a field and holds it against its uncompressed response.
pub struct Examiner<'a> {
    stress: &'a StressField,
    /// The field.
    pub field: Field<'a>,
    slope: CodeSlope,
    weights: FixedWeights,
    bound_light: BoundLight,
    kernel: Kernel,
    linear: LinearTile,
    /// Ranks used at most.
    pub max_rank: usize,
}

impl<'a> Examiner<'a> {
    /// Of a field, on this machine's fastest path.
    pub fn new(stress: &'a StressField) -> Self {
        Examiner {
            stress,
            field: stress.field(),
            slope: CodeSlope::new(),
            weights: FixedWeights::dark(stress.patches.len()),
            bound_light: BoundLight::DARK,
            kernel: Kernel::detect(),
            linear: LinearTile::new(),
            max_rank: usize::MAX,
        }
    }

    /// Takes a light; the part of it that is `apart` is shown by the patches' own rows.
    ///
    /// # Panics
    /// If the light is refused.
    pub fn set(&mut self, light: &[[f32; 3]], exposure: f32, apart: &[Apart]) {
        self.weights.set(light, None, exposure, LightApart::Some(apart)).expect("a light that is taken");
        self.field.bounds().expect("bounds").light(&self.weights, self.kernel, &mut self.bound_light);
    }

    /// The light, unrounded: radiance times exposure against the response, `[pixel][3]`.
    fn exact(&self, tile: usize, light: &[[f32; 3]], exposure: f32) -> Vec<f64> {
        let rows = self.stress.responses[tile].chunks_exact(light.len()).enumerate();
        let sum = |(at, row): (usize, &[f32])| {
            let terms = row.iter().zip(light).map(|(&r, rgb)| f64::from(r) * f64::from(rgb[at % 3]));
            terms.sum::<f64>() * f64::from(exposure)
        };
        rows.map(sum).collect()
    }

    /// Linear values of a tile, `[pixel][3]`, with their bounds.
    fn shown(&mut self, index: usize) -> (Vec<f32>, Off, DrawnTile) {
        let response = self.field.response();
        let tile = response.tile(index);
        let (mut all, mut used) = (Coefficients::ZERO, Coefficients::ZERO);
        all.project(&tile, &self.weights, self.kernel, usize::MAX);
        used.copy_from(&all);
        used.limit_rank(self.max_rank);
        let block =
            self.field.bounds().expect("bounds").block(response.block_of(index), &self.bound_light, self.kernel);
        let shown = ShownLight { coefficients: &used, weights: &self.weights, unpacked: &[], sun_q16: [0; 3] };
        let off = Off::of((&self.field, &tile), &shown, (&all, &block));
        let light = TileLight { sun: None, weights: &self.weights, unpacked: &[] };
        let extent = used.pixels(&self.field, &tile, &light, self.kernel, &mut self.linear);
        let mut drawn = DrawnTile::NOTHING;
        drawn.set(&shown, Dimmest::of_extent(extent));
        ((0..tile.pixels()).flat_map(|x| self.linear.rgb(x)).collect(), off, drawn)
    }

    /// Bound and error of a tile under the light that was set.
    pub fn tile(&mut self, index: usize, light: &[[f32; 3]], exposure: f32) -> TileFound {
        let exact = self.exact(index, light, exposure);
        let (shown, off, drawn) = self.shown(index);
        let tile = self.field.response().tile(index);
        let codes = drawn.dimmest().codes(&self.slope, &dark_shares(&tile), &off);
        let mut found = TileFound::default();
        for c in 0..3 {
            let [plain, weighted] = [0, 1].map(|kind: usize| f64::from(off.sky[kind][c].most() + off.rows[c]));
            let bound = Measured { plain, weighted, codes: codes.into() };
            for (x, row) in row_shares(&tile, c).enumerate() {
                let (truth, shown) = (exact[3 * x + c], f64::from(shown[3 * x + c]));
                let plain = (truth - shown).abs();
                let code = |light: f64| srgb_code(light.clamp(0.0, 1.0));
                let weighted = plain / f64::from(row.max(1.0 / 65535.0)).powf(DARK_POWER.into());
                let error = Measured { plain, weighted, codes: (code(truth) - code(shown)).abs() };
                found.error = found.error.max(error);
                let share = error.of(bound, |error, bound| if error == 0.0 { 0.0 } else { error / bound });
                // NaN must not slip through as no violation.
                assert!(share.plain.is_finite() && share.weighted.is_finite() && share.codes.is_finite(), "{bound:?}");
                found.share = found.share.max(share);
            }
            found.bound = found.bound.max(bound);
        }
        found
    }

    /// Is the tile's block free of matter of twelve decades, whose bounds would drown all others'?
    pub fn is_plain(&self, index: usize) -> bool {
        let response = self.field.response();
        response.tiles_of(response.block_of(index)).all(|tile| self.stress.matter[tile] != Matter::Decades)
    }

    /// What a pixel's response to each patch is too low by in the field, `[patch]`; `at` counts pixel times 3 + channel.
    pub fn residual(&mut self, index: usize, at: usize) -> Vec<f32> {
        let patches = self.stress.patches.len();
        (0..patches)
            .map(|patch| {
                self.set(&crate::stresslight::alone(patches, patch, 0.5), 1.0, &[]);
                self.stress.responses[index][at * patches + patch] - 2.0 * self.shown(index).0[at]
            })
            .collect()
    }
}

/// Row scales of the tile's pixels over 65535.
fn row_shares<'t>(tile: &Tile<'t>, c: usize) -> impl Iterator<Item = f32> + use<'t> {
    let rows = &tile.rows.as_chunks::<2>().0[c * tile.padded_pixels()..][..tile.pixels()];
    rows.iter().map(|row| f32::from(u16::from_le_bytes(*row)) / 65535.0)
}
