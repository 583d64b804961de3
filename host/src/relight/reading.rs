//! The picture as numbers: linear radiance, whatever the display's exposure.

use super::blocks::Block;
use super::levels::Levels;
use super::{Picture, Relighter, install};
use crate::weights::PatchWeights;
use rayon::prelude::*;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::relight::{Coefficients, LinearTile, TileLight};
use relume_firmware::tile::{TILE_PX, Tile};

impl Relighter<'_> {
    /// The linear picture of the newest weights, whatever their exposure was.
    pub fn radiance(&mut self) -> Picture {
        let (width, height) = (self.field.width(), self.field.height());
        let mut picture =
            Picture { width, height, rgb: vec![[0.0; 3]; width * height], alpha: vec![0.0; width * height] };
        let pool = self.pool.take();
        if let Some(reading) = self.reading() {
            let columns = reading.field.response().grid().0;
            let bands = picture.rgb.par_chunks_mut(width * TILE_PX).zip(picture.alpha.par_chunks_mut(width * TILE_PX));
            install(pool.as_ref(), || {
                bands.enumerate().for_each(|(row, (rgb, alpha))| {
                    let mut linear = LinearTile::new();
                    for column in 0..columns {
                        let tile = reading.field.response().tile(row * columns + column);
                        reading.tile(&tile, &mut linear);
                        for (k, pixel) in tile.covered().enumerate() {
                            let at = pixel / TILE_PX * width + column * TILE_PX + pixel % TILE_PX;
                            rgb[at] = reading.radiance(&linear, k);
                            alpha[at] = tile.coverage.map_or(1.0, |c| f32::from(c[k]) / 255.0);
                        }
                    }
                });
            });
        }
        self.pool = pool;
        picture
    }

    /// Channel values of that picture, of the covered pixels of tiles that are spread over it: of about `tiles` of them, of
    /// all if there are fewer. `values` is reused.
    pub fn sample_radiance(&mut self, tiles: usize, values: &mut Vec<f32>) {
        values.clear();
        let with_geometry = self.counters.tiles - self.states.iter().filter(|state| state.empty).count();
        let step = (with_geometry / tiles.max(1)).max(1);
        let Some(reading) = self.reading() else { return };
        let response = reading.field.response();
        let covered = (0..response.tiles()).map(|index| response.tile(index)).filter(|tile| tile.pixels() > 0);
        let mut linear = LinearTile::new();
        for tile in covered.step_by(step) {
            reading.tile(&tile, &mut linear);
            values.extend((0..tile.pixels()).flat_map(|k| reading.radiance(&linear, k)));
        }
    }

    /// Brings the newest weights to an exposure of their own, ready to be read; `None` if there is nothing to read.
    fn reading(&mut self) -> Option<Reading<'_>> {
        let exposure = reading_exposure(&self.given, &self.field);
        let levels = self.reading.get_or_insert_with(|| Box::new(Levels::new(&self.field, self.kernel)));
        // The same weights were accepted before, and the exposure is finite.
        levels.set(&self.field, (&self.given.radiance, self.given.sun), exposure).ok()?;
        for level in 1..=levels.top() {
            if self.blocks.iter().any(|block| block.level == level) {
                levels.prepare(&self.field, level, &self.given, exposure);
            }
        }
        Some(Reading {
            field: &self.field,
            blocks: &self.blocks,
            sun: self.given.sun.map(|_| (self.sun.plane(), levels.get(0).weights.sun_q16())),
            levels,
            kernel: self.kernel,
            max_rank: self.rank_limit.unwrap_or(usize::MAX),
            scale: 1.0 / f64::from(exposure),
        })
    }
}

/// What the tiles of one reading share.
struct Reading<'a> {
    field: &'a Field<'a>,
    blocks: &'a [Block],
    levels: &'a Levels,
    sun: Option<(&'a [u16], [u32; 3])>,
    kernel: Kernel,
    max_rank: usize,
    /// From linear values to radiance.
    scale: f64,
}

impl Reading<'_> {
    /// Linear values of a tile.
    fn tile(&self, tile: &Tile<'_>, linear: &mut LinearTile) {
        let level = self.blocks[self.field.response().block_of(tile.index)].level;
        let weights = &self.levels.get(level).weights;
        let light = TileLight { sun: self.sun, weights, unpacked: &[] };
        let mut coefficients = Coefficients::ZERO;
        coefficients.project(tile, weights, self.kernel, self.max_rank);
        coefficients.pixels(self.field, tile, &light, self.kernel, linear);
    }

    /// The radiance of pixel `k` of a tile's linear values.
    fn radiance(&self, linear: &LinearTile, k: usize) -> [f32; 3] {
        linear.rgb(k).map(|value| (f64::from(value) * self.scale) as f32)
    }
}

/// A power of two that brings the picture near display white, so that fixed point keeps its precision.
fn reading_exposure(weights: &PatchWeights, field: &Field<'_>) -> f32 {
    power_of_two(white_light(weights, field))
}

/// The power of two that brings `white` just below display white.
pub(super) fn power_of_two(white: f64) -> f32 {
    if white > 0.0 { 2f64.powf(-white.log2().ceil()).clamp(1e-30, 1e30) as f32 } else { 1.0 }
}

/// The radiance that a white surface would show if it met all the light at once.
pub(super) fn white_light(weights: &PatchWeights, field: &Field<'_>) -> f64 {
    let set = field.patch_set();
    let sky: f64 = weights
        .radiance
        .iter()
        .enumerate()
        .map(|(patch, rgb)| f64::from(rgb.iter().fold(0.0f32, |m, &v| m.max(v))) * f64::from(set.solid_angle_sr(patch)))
        .sum();
    let sun = weights.sun.map_or(0.0, |sun| f64::from(sun.irradiance.iter().fold(0.0f32, |m, &v| m.max(v))));
    (sky + sun) / std::f64::consts::PI
}
