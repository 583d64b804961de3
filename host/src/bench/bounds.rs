//! The certified bound against the true error, tile by tile, and what it costs. It covers the sky's light, so skies with
//! the sun up are left out.

use relume_firmware::field::Field;
use serde::Serialize;

use super::clock::{cpu_s, median};
use super::error::unrounded_code;
use super::method::BenchSky;
use super::tilemap::TileMap;
use crate::relight::{Framebuffer, Relighter, View};

/// Tiles without a code of this or more are dark.
const DARK_CODE: f64 = 16.0;
/// Frames timed with bounds, and as many without.
const FRAMES: usize = 60;

/// Bounds under all skies without a sun.
#[derive(Clone, Debug, Serialize)]
pub struct BoundsReport {
    /// Worst sky's; see [`SkyBounds::looseness`].
    pub looseness_worst: Option<f64>,
    /// Worst sky's over dark tiles.
    pub looseness_dark_worst: Option<f64>,
    /// Worst sky's share of tiles whose bound is below their true error; anything but 0 is a fault.
    pub share_of_tiles_below_error: f64,
    /// CPU time of a full frame with bounds, milliseconds.
    pub with_bounds_cpu_ms: f64,
    /// The same without bounds and without remembering what was drawn, which skipping needs.
    pub without_bounds_cpu_ms: f64,
    /// The bounds' part of the time with them; at most, as that memory is in it.
    pub share_of_frame_time: f64,
    /// Sky by sky.
    pub per_sky: Vec<SkyBounds>,
}

/// Bounds under one sky. Linear values are radiance times exposure, 1 = display white.
#[derive(Clone, Debug, Serialize)]
pub struct SkyBounds {
    /// Name of the sky.
    pub sky: String,
    /// Tiles with geometry.
    pub tiles: usize,
    /// Those of them without a code of 16 or more.
    pub tiles_dark: usize,
    /// Largest bound over the tiles.
    pub bound_linear: f64,
    /// Largest true error over the tiles.
    pub error_linear: f64,
    /// The one / the other.
    pub looseness: Option<f64>,
    /// The same over dark tiles alone; `None`: there are none.
    pub looseness_dark: Option<f64>,
    /// Largest bound in codes, rounding included.
    pub bound_codes: f64,
    /// Largest true error in codes: 8-bit code shown against the exact code before rounding.
    pub error_codes: f64,
    /// Share of tiles whose bound is below their true error, linear or in codes.
    pub share_of_tiles_below_error: f64,
}

/// One tile's bounds and true errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileTruth {
    /// Bound and largest true error, linear.
    pub linear: (f64, f64),
    /// Bound and largest true error, codes.
    pub codes: (f64, f64),
    /// Largest exact code.
    pub brightest_code: f64,
}

impl TileTruth {
    /// Is a bound not kept?
    pub fn is_below_error(&self) -> bool {
        self.linear.0 < self.linear.1 || self.codes.0 < self.codes.1
    }
}

/// Largest bound / largest error; `None` where there is no error.
pub fn looseness(of: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let (bound, error) = of.fold((0.0f64, 0.0f64), |all, (bound, error)| (all.0.max(bound), all.1.max(error)));
    (error > 0.0).then(|| bound / error)
}

/// Share of tiles whose bound is below their true error.
pub fn share_below_error(tiles: &[TileTruth]) -> f64 {
    tiles.iter().filter(|tile| tile.is_below_error()).count() as f64 / tiles.len().max(1) as f64
}

/// What a relighter shows and promises at the moment, against the exact picture of the covered pixels.
pub fn truth(
    relighter: &mut Relighter<'_>,
    framebuffer: &Framebuffer,
    (covered, map): (&[u32], &TileMap),
    exact: &[[f64; 3]],
    exposure: f64,
) -> Vec<TileTruth> {
    let picture = relighter.radiance();
    let each = |k: usize, error: &dyn Fn(usize) -> f64| {
        debug_assert!(k < exact.len());
        (0..3).map(error).fold(0.0, f64::max)
    };
    let linear = map.largest(|k| {
        let shown = picture.rgb[covered[k] as usize];
        each(k, &|c| (f64::from(shown[c]) - exact[k][c]).abs() * exposure)
    });
    let codes = map.largest(|k| {
        let [_, shown @ ..] = framebuffer.pixels[covered[k] as usize].to_be_bytes();
        each(k, &|c| (f64::from(shown[c]) - unrounded_code(exact[k][c] * exposure)).abs())
    });
    let brightest = map.largest(|k| each(k, &|c| unrounded_code(exact[k][c] * exposure)));
    let tile = |(index, bound): (usize, Option<(f32, f32)>)| {
        let (bound_linear, bound_codes) = bound?;
        Some(TileTruth {
            linear: (f64::from(bound_linear), linear[index]?),
            codes: (f64::from(bound_codes), codes[index]?),
            brightest_code: brightest[index]?,
        })
    };
    relighter.tile_bounds().enumerate().filter_map(tile).collect()
}

/// Measures; `None` where the field has no bounds, or no sky is without sun.
///
/// # Errors
/// If the field refuses a sky.
pub fn run(field: Field<'_>, covered: &[u32], skies: &[BenchSky]) -> anyhow::Result<Option<BoundsReport>> {
    let skies: Vec<&BenchSky> = skies.iter().filter(|sky| !sky.has_sun()).collect();
    if field.bounds().is_none() || skies.is_empty() {
        return Ok(None);
    }
    let (mut relighter, view) = (Relighter::new(field, 1), View::new(field.width(), field.height(), Vec::new()));
    let mut framebuffer = Framebuffer::new(field.width(), field.height());
    let map = TileMap::new(&field, covered);
    let mut per_sky = Vec::new();
    for sky in &skies {
        let Some(exact) = &sky.exact else { continue };
        relighter.invalidate();
        relighter.set_weights(&sky.weights, sky.exposure)?;
        relighter.draw(&view, &mut framebuffer);
        let exposure = f64::from(sky.exposure);
        let tiles = truth(&mut relighter, &framebuffer, (covered, &map), exact, exposure);
        per_sky.push(sky_bounds(sky.name.clone(), &tiles));
    }
    let (with_s, without_s) = times(field, &skies)?;
    let worst = |of: &dyn Fn(&SkyBounds) -> Option<f64>| per_sky.iter().filter_map(of).reduce(f64::max);
    Ok(Some(BoundsReport {
        looseness_worst: worst(&|sky| sky.looseness),
        looseness_dark_worst: worst(&|sky| sky.looseness_dark),
        share_of_tiles_below_error: worst(&|sky| Some(sky.share_of_tiles_below_error)).unwrap_or(0.0),
        with_bounds_cpu_ms: 1e3 * with_s,
        without_bounds_cpu_ms: 1e3 * without_s,
        share_of_frame_time: (with_s - without_s) / with_s,
        per_sky,
    }))
}

fn sky_bounds(sky: String, tiles: &[TileTruth]) -> SkyBounds {
    let dark = || tiles.iter().filter(|tile| tile.brightest_code < DARK_CODE);
    let largest = |of: fn(&TileTruth) -> f64| tiles.iter().map(of).fold(0.0, f64::max);
    SkyBounds {
        sky,
        tiles: tiles.len(),
        tiles_dark: dark().count(),
        bound_linear: largest(|tile| tile.linear.0),
        error_linear: largest(|tile| tile.linear.1),
        looseness: looseness(tiles.iter().map(|tile| tile.linear)),
        looseness_dark: looseness(dark().map(|tile| tile.linear)),
        bound_codes: largest(|tile| tile.codes.0),
        error_codes: largest(|tile| tile.codes.1),
        share_of_tiles_below_error: share_below_error(tiles),
    }
}

/// CPU seconds of a full frame with bounds and without, in turns.
fn times(field: Field<'_>, skies: &[&BenchSky]) -> anyhow::Result<(f64, f64)> {
    let view = View::new(field.width(), field.height(), Vec::new());
    let mut framebuffer = Framebuffer::new(field.width(), field.height());
    let mut relighters = [Relighter::new(field, 1), Relighter::new(field, 1)];
    let mut took = [Vec::with_capacity(FRAMES), Vec::with_capacity(FRAMES)];
    for (frame, sky) in skies.iter().cycle().take(FRAMES + skies.len()).enumerate() {
        // The first round draws what is drawn only once.
        if frame == skies.len() {
            relighters[1].set_bounds(false);
        }
        for turn in [frame % 2, 1 - frame % 2] {
            let start = cpu_s();
            relighters[turn].invalidate();
            relighters[turn].set_weights(&sky.weights, sky.exposure)?;
            relighters[turn].draw(&view, &mut framebuffer);
            if frame >= skies.len() {
                took[turn].push(cpu_s() - start);
            }
        }
    }
    Ok((median(&took[0]), median(&took[1])))
}

impl std::fmt::Display for BoundsReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let times = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}x"));
        writeln!(f, "\nbounds on the sky's light (skies without sun); {:.1} % of a frame's time at most", {
            100.0 * self.share_of_frame_time
        })?;
        for sky in &self.per_sky {
            writeln!(
                f,
                "{:<26} bound / error {:>6}, {} dark of {} tiles {:>6}; codes {:.2} / {:.2}; {:.2} % of tiles below error",
                sky.sky,
                times(sky.looseness),
                sky.tiles_dark,
                sky.tiles,
                times(sky.looseness_dark),
                sky.bound_codes,
                sky.error_codes,
                100.0 * sky.share_of_tiles_below_error
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(linear: (f64, f64), codes: (f64, f64), brightest_code: f64) -> TileTruth {
        TileTruth { linear, codes, brightest_code }
    }

    #[test]
    fn looseness_is_largest_bound_over_largest_error() {
        // Not the largest ratio: that would be 9.
        let tiles = [tile((0.9, 0.1), (2.0, 1.0), 200.0), tile((0.5, 0.4), (3.0, 1.5), 15.9)];
        let sky = sky_bounds("a".into(), &tiles);
        assert_eq!((sky.looseness, sky.looseness_dark), (Some(0.9 / 0.4), Some(0.5 / 0.4)));
        assert_eq!((sky.tiles, sky.tiles_dark, sky.bound_codes, sky.error_codes), (2, 1, 3.0, 1.5));
        assert_eq!(sky.share_of_tiles_below_error, 0.0);
        assert_eq!(looseness([(1.0, 0.0)].into_iter()), None);
    }

    #[test]
    fn a_bound_below_the_error_is_counted() {
        let good = tile((0.2, 0.1), (2.0, 1.0), 100.0);
        let tiles = [good, tile((0.1, 0.2), (2.0, 1.0), 100.0), tile((0.2, 0.1), (1.0, 1.5), 100.0), good];
        assert_eq!(share_below_error(&tiles), 0.5);
    }
}
