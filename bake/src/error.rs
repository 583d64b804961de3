//! How far a finished field is from the response it was made from, under held-out skies.
//!
//! While the response is in memory its sums under every sky are kept, 12 bytes per covered pixel and sky: less than the
//! field itself takes. When the field is whole, its own pictures, by the kernels that show it, are held against them. This
//! is the sky's light alone: the sun's does not go through the compressed response.

use crate::heldout::TestSky;
use rayon::prelude::*;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::levels::apart;
use relume_firmware::relight::{Coefficients, LinearTile, TileLight};
use relume_firmware::tile::TILE_PIXELS;
use relume_firmware::tone::srgb_code;
use relume_firmware::weights::{Apart, FixedWeights, MOST_STANDOUTS, WeightError};
use serde::{Deserialize, Serialize};

/// Errors of a field's picture under one sky, as the design defines them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SkyError {
    /// The sky.
    pub sky: String,
    /// Relative RMSE: rms of the difference over the mean of the exact picture, a fraction.
    pub rmse: f64,
    /// Largest difference of an 8-bit value, at 0.8 / the 99th percentile of the exact picture.
    pub worst_code: u8,
    /// Share of 8-bit values that differ by more than one.
    pub share_off_by_more_than_one: f64,
}

/// Held-out skies, ready to be summed over responses.
#[derive(Clone, Debug)]
pub struct TestLight {
    skies: Vec<TestSky>,
    /// Per sky `[channel][patch]`.
    by_channel: Vec<[Vec<f64>; 3]>,
}

impl TestLight {
    /// Of these skies.
    pub fn new(skies: Vec<TestSky>) -> Self {
        let channel = |sky: &TestSky, c: usize| sky.radiance.iter().map(|rgb| f64::from(rgb[c])).collect();
        let by_channel = skies.iter().map(|sky| [0, 1, 2].map(|c| channel(sky, c))).collect();
        TestLight { skies, by_channel }
    }

    /// Exact sums of a tile's response, `[pixel][3][patch]`, per sky `[pixel][3]`.
    pub fn sums(&self, response: &[f32]) -> ExactTile {
        let of_sky = |light: &[Vec<f64>; 3]| {
            let patches = light[0].len().max(1);
            let rows = response.chunks_exact(patches).enumerate();
            let terms =
                |at: usize, row: &[f32]| row.iter().zip(&light[at % 3]).map(|(&r, w)| f64::from(r) * w).sum::<f64>();
            rows.map(|(at, row)| terms(at, row) as f32).collect()
        };
        ExactTile(self.by_channel.iter().map(of_sky).collect())
    }

    /// Names of the skies.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.skies.iter().map(|sky| sky.name.as_str())
    }

    /// The errors of `field`, whose tiles' exact sums are `exact`, under every sky.
    ///
    /// # Errors
    /// [`WeightError`], if a sky is not for this field.
    pub fn errors(&self, field: &Field<'_>, exact: &[ExactTile]) -> Result<Vec<SkyError>, WeightError> {
        let skies = self.skies.iter().enumerate();
        skies.map(|(index, sky)| error_under(field, sky, |tile| &exact[tile].0[index])).collect()
    }
}

impl TestLight {
    /// Per tile, in mask order, the largest code error of a pixel's channels under the sky with index `sky`.
    ///
    /// # Errors
    /// [`WeightError`], if the sky is not for this field.
    pub fn code_errors(&self, field: &Field<'_>, exact: &[ExactTile], sky: usize) -> Result<Vec<Vec<u8>>, WeightError> {
        let values = |tile: &ExactTile| tile.0.get(sky).cloned().unwrap_or_default();
        let Some(exposure) = exposure_for(exact.iter().flat_map(values).collect()) else { return Ok(Vec::new()) };
        let weights = weights_of(field, &self.skies[sky], exposure)?;
        let light = TileLight { sun: None, weights: &weights, unpacked: &[] };
        let of_tile = |(index, exact): (usize, &ExactTile)| {
            let codes = shown(field, index, &light).1.map(codes_of);
            let pixels = codes.iter().zip(exact.0[sky].as_chunks::<3>().0);
            let off = |(codes, exact): (&[u8; 3], &[f32; 3])| {
                let each = codes.iter().zip(exact);
                each.map(|(code, &exact)| code.abs_diff(true_code(exact, exposure.into()))).max().unwrap_or(0)
            };
            pixels.map(off).collect()
        };
        Ok(exact.par_iter().enumerate().map(of_tile).collect())
    }
}

/// Exact sums of one tile under every sky.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExactTile(Vec<Vec<f32>>);

impl ExactTile {
    /// Of sums per sky, `[pixel][3]`.
    #[cfg(test)]
    pub(crate) fn of_sums(by_sky: Vec<Vec<f32>>) -> Self {
        ExactTile(by_sky)
    }

    /// Per sky `[pixel][3]`.
    pub fn by_sky(&self) -> impl Iterator<Item = &[f32]> {
        self.0.iter().map(Vec::as_slice)
    }
}

fn error_under<'e>(
    field: &Field<'_>,
    sky: &TestSky,
    exact: impl Fn(usize) -> &'e [f32] + Sync,
) -> Result<SkyError, WeightError> {
    let tiles = field.response().tiles();
    let values: Vec<f32> = (0..tiles).flat_map(|tile| exact(tile).iter().copied()).collect();
    let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len().max(1) as f64;
    let count = values.len().max(1) as f64;
    let Some(exposure) = exposure_for(values) else {
        return Ok(SkyError { sky: sky.name.clone(), ..SkyError::default() });
    };
    let weights = weights_of(field, sky, exposure)?;
    let light = TileLight { sun: None, weights: &weights, unpacked: &[] };
    let of_tile = |tile: usize| Difference::of(field, tile, &light, exact(tile), f64::from(exposure));
    // Added in order, so that any number of threads gives the same bytes.
    let all = (0..tiles)
        .into_par_iter()
        .map(of_tile)
        .collect::<Vec<_>>()
        .into_iter()
        .fold(Difference::default(), Difference::and);
    Ok(SkyError {
        sky: sky.name.clone(),
        rmse: (all.square / count).sqrt() / mean,
        worst_code: all.worst_code,
        share_off_by_more_than_one: all.off as f64 / count,
    })
}

/// A sky's weights, bright patches set apart as a post does it.
fn weights_of(field: &Field<'_>, sky: &TestSky, exposure: f32) -> Result<Box<FixedWeights>, WeightError> {
    let mut room = [Apart::default(); MOST_STANDOUTS];
    let apart = apart(0, field, &sky.radiance, Kernel::detect(), &mut room);
    let mut weights = Box::new(FixedWeights::dark(field.patch_set().len()));
    weights.set(&sky.radiance, None, exposure, apart)?;
    Ok(weights)
}

/// What a picture, or a part of it, is off by.
#[derive(Clone, Copy, Debug, Default)]
struct Difference {
    /// Sum of squares, in radiance.
    square: f64,
    worst_code: u8,
    /// Values off by more than one.
    off: usize,
}

impl Difference {
    fn and(self, other: Difference) -> Difference {
        Difference {
            square: self.square + other.square,
            worst_code: self.worst_code.max(other.worst_code),
            off: self.off + other.off,
        }
    }

    /// Of one tile as the kernels show it.
    fn of(field: &Field<'_>, index: usize, light: &TileLight<'_>, exact: &[f32], exposure: f64) -> Difference {
        let (linear, shown) = shown(field, index, light);
        let mut all = Difference::default();
        for (pixel, exact) in exact.as_chunks::<3>().0.iter().enumerate() {
            let (codes, light) = (codes_of(shown[pixel]), linear.rgb(pixel));
            for c in 0..3 {
                let truth = f64::from(exact[c]);
                let off = codes[c].abs_diff(true_code(exact[c], exposure));
                all = all.and(Difference {
                    square: (f64::from(light[c]) / exposure - truth).powi(2),
                    worst_code: off,
                    off: usize::from(off > 1),
                });
            }
        }
        all
    }
}

/// One tile as the kernels show it: linear, and as codes.
fn shown(field: &Field<'_>, index: usize, light: &TileLight<'_>) -> (LinearTile, [u32; TILE_PIXELS]) {
    let (tile, kernel) = (field.response().tile(index), Kernel::detect());
    let (mut linear, mut coefficients, mut shown) = (LinearTile::new(), Coefficients::ZERO, [0u32; TILE_PIXELS]);
    coefficients.project(&tile, light.weights, kernel, usize::MAX);
    coefficients.pixels(field, &tile, light, kernel, &mut linear);
    let n = tile.padded_pixels();
    kernel.tone(linear.planes(n).map(|plane| &*plane), &mut shown[..n]);
    (linear, shown)
}

/// The 8-bit codes, red, green and blue, of a pixel as the kernels show it.
fn codes_of(shown: u32) -> [u8; 3] {
    let [_, codes @ ..] = shown.to_be_bytes();
    codes
}

/// The code that a radiance should be shown as.
fn true_code(radiance: f32, exposure: f64) -> u8 {
    srgb_code((f64::from(radiance) * exposure).clamp(0.0, 1.0)).round() as u8
}

/// 0.8 / the 99th percentile (linear between neighbours); `None` of what is not lit.
pub(crate) fn exposure_for(mut values: Vec<f32>) -> Option<f32> {
    let place = 0.99 * values.len().checked_sub(1)? as f64;
    let (_, &mut low, above) = values.select_nth_unstable_by(place as usize, f32::total_cmp);
    let high = above.iter().copied().min_by(f32::total_cmp).unwrap_or(low);
    let bright = f64::from(low) + f64::from(high - low) * place.fract();
    Some((0.8 / bright) as f32).filter(|exposure| exposure.is_finite() && bright > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_response_times_light() {
        let sky = TestSky { name: "two patches".into(), radiance: vec![[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]] };
        let light = TestLight::new(vec![sky]);
        let response = [1.0, 0.5, 1.0, 0.5, 1.0, 0.5, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0];
        assert_eq!(light.sums(&response), ExactTile(vec![vec![6.0, 12.0, 18.0, 10.0, 4.0, 0.0]]));
        assert_eq!(light.sums(&[]), ExactTile(vec![vec![]]));
    }

    #[test]
    fn exposure_is_four_fifths_of_the_percentile() {
        let values: Vec<f32> = (0..300).rev().map(|k| k as f32).collect();
        assert!((exposure_for(values).unwrap() - 0.8 / 296.01).abs() < 1e-7);
        assert_eq!((exposure_for(vec![]), exposure_for(vec![0.0; 9])), (None, None));
    }
}
