//! The picture as numbers: linear radiance, whatever the display's exposure.

use super::levels::Levels;
use super::{Picture, Relighter, install};
use crate::weights::PatchWeights;
use rayon::prelude::*;
use relume_firmware::field::Field;
use relume_firmware::relight::{Coefficients, LinearTile, TileLight};
use relume_firmware::tile::TILE_PX;

impl Relighter<'_> {
    /// The linear picture of the newest weights, whatever their exposure was.
    pub fn radiance(&mut self) -> Picture {
        let (width, height) = (self.field.width(), self.field.height());
        let mut picture =
            Picture { width, height, rgb: vec![[0.0; 3]; width * height], alpha: vec![0.0; width * height] };
        let exposure = reading_exposure(&self.given, &self.field);
        let mut levels = Levels::new(&self.field, self.kernel);
        // The same weights were accepted before, and the exposure is finite.
        if levels.set(&self.field, &self.given, exposure).is_err() {
            return picture;
        }
        for level in 1..=levels.top() {
            if self.blocks.iter().any(|block| block.level == level) {
                levels.prepare(&self.field, level, &self.given, exposure);
            }
        }
        let scale = 1.0 / f64::from(exposure);
        let (field, kernel) = (&self.field, self.kernel);
        let max_rank = self.rank_limit.unwrap_or(usize::MAX);
        let sun = self.given.sun.map(|_| (self.sun.plane(), levels.get(0).weights.sun_q16()));
        let (levels, blocks) = (&levels, &self.blocks);
        let (columns, _) = field.response().grid();
        let bands = picture.rgb.par_chunks_mut(width * TILE_PX).zip(picture.alpha.par_chunks_mut(width * TILE_PX));
        install(self.pool.as_ref(), || {
            bands.enumerate().for_each(|(row, (rgb, alpha))| {
                let (mut linear, mut coefficients) = (LinearTile::new(), Coefficients::ZERO);
                for column in 0..columns {
                    let index = row * columns + column;
                    let tile = field.response().tile(index);
                    let weights = &levels.get(blocks[field.response().block_of(index)].level).weights;
                    let light = TileLight { sun, weights, unpacked: &[] };
                    coefficients.project(&tile, weights, kernel, max_rank);
                    coefficients.pixels(field, &tile, &light, kernel, &mut linear);
                    for (k, pixel) in tile.covered().enumerate() {
                        let at = pixel / TILE_PX * width + column * TILE_PX + pixel % TILE_PX;
                        rgb[at] = linear.rgb(k).map(|value| (f64::from(value) * scale) as f32);
                        alpha[at] = tile.coverage.map_or(1.0, |c| f32::from(c[k]) / 255.0);
                    }
                }
            });
        });
        picture
    }
}

/// A power of two that brings the picture near display white, so that fixed point keeps its precision: from the
/// radiance that a white surface would show if it met all the light at once.
fn reading_exposure(weights: &PatchWeights, field: &Field<'_>) -> f32 {
    let set = field.patch_set();
    let sky: f64 = weights
        .radiance
        .iter()
        .enumerate()
        .map(|(patch, rgb)| f64::from(rgb.iter().fold(0.0f32, |m, &v| m.max(v))) * f64::from(set.solid_angle_sr(patch)))
        .sum();
    let sun = weights.sun.map_or(0.0, |sun| f64::from(sun.irradiance.iter().fold(0.0f32, |m, &v| m.max(v))));
    let white = (sky + sun) / std::f64::consts::PI;
    if white > 0.0 { 2f64.powf(-white.log2().ceil()).clamp(1e-30, 1e30) as f32 } else { 1.0 }
}
