//! Arbitrary lights under an error budget: each patch alone, a torch, a sun that was left in the sky.

use anyhow::Context;
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;
use serde::Serialize;

use super::bounds::{TileTruth, share_below_error, truth};
use super::clock::median;
use super::error::exposure_for;
use super::method::BenchSky;
use super::stage::Stage;
use super::tilemap::TileMap;
use crate::exact::Stack;
use crate::relight::Budget;
use crate::weights::PatchWeights;

/// The budget, codes.
const BUDGET_CODES: f32 = 4.0;
/// A torch's patches are no higher than this, as the sine of the altitude.
const LOW: f32 = 0.25;
/// What a sun left in the sky is brighter by than its patch.
const SUN_TIMES_SKY: f32 = 1e4;

/// Lights under [`BUDGET_CODES`], each from scratch, against the stack.
#[derive(Clone, Debug, Serialize)]
pub struct LightsReport {
    /// The budget.
    pub budget_codes: f64,
    /// CPU time of an ordinary full frame between them: a clear sky without the sun, no budget; median, milliseconds.
    pub full_frame_cpu_ms: f64,
    /// Patches that fewer than 1 % of the values see; they are left out.
    pub patches_unseen: usize,
    /// Each of the others alone.
    pub single_patches: SinglePatches,
    /// Three neighbouring low patches.
    pub torch: Option<OneLight>,
    /// A clear sky with one patch 10000 times as bright.
    pub sun_left_in_sky: Option<OneLight>,
}

/// Each patch alone.
#[derive(Clone, Debug, Serialize)]
pub struct SinglePatches {
    /// How many.
    pub patches: usize,
    /// Of them, those whose certified bound is beyond the budget at the end of the way back.
    pub patches_beyond_budget: usize,
    /// The one with the largest true error.
    pub worst_error: Option<OneLight>,
    /// The one with the largest certified bound.
    pub worst_bound: Option<OneLight>,
    /// CPU time of its frame / an ordinary full frame's, median.
    pub times_full_frame_median: f64,
    /// The same, slowest.
    pub times_full_frame_worst: f64,
    /// Worst share of tiles whose bound is below their true error; anything but 0 is a fault.
    pub share_of_tiles_below_error: f64,
}

/// One light under the budget.
#[derive(Clone, Debug, Serialize)]
pub struct OneLight {
    /// The patches that were lit (of a sky: made brighter).
    pub patches: Vec<usize>,
    /// Largest true error of an 8-bit code, against the exact code before rounding.
    pub error_codes: f64,
    /// Certified bound.
    pub bound_codes: f64,
    /// CPU time of the frame, milliseconds.
    pub cpu_ms: f64,
    /// The same / an ordinary full frame's.
    pub times_full_frame: f64,
    /// Tiles that took more of the way back than the patches that outshine the sky.
    pub tiles_way_back: usize,
    /// Share of tiles whose bound is below their true error.
    pub share_of_tiles_below_error: f64,
}

/// What lights are tried on.
struct Trial<'a> {
    covered: &'a [u32],
    map: TileMap,
    /// Under the error budget.
    stage: Stage<'a>,
    ordinary: Stage<'a>,
    clear: &'a PatchWeights,
    clear_exposure: f32,
    ordinary_s: Vec<f64>,
}

impl Trial<'_> {
    /// `None`: nobody sees it.
    fn light(
        &mut self,
        patches: &[usize],
        weights: &PatchWeights,
        exact: &[[f64; 3]],
    ) -> anyhow::Result<Option<OneLight>> {
        let Some(exposure) = exposure_for(exact).map(|exposure| exposure as f32).filter(|e| e.is_finite()) else {
            return Ok(None);
        };
        let relighter = &mut self.stage.relighter;
        relighter.set_budget(Budget::Field)?;
        relighter.set_budget(Budget::ErrorCodes(BUDGET_CODES))?;
        let (took_s, counters) = self.stage.full_frame(weights, exposure)?;
        self.ordinary_s.push(self.ordinary.full_frame(self.clear, self.clear_exposure)?.0);
        let place = (self.covered, &self.map);
        let stage = &mut self.stage;
        let tiles = truth(&mut stage.relighter, &stage.framebuffer, place, exact, f64::from(exposure));
        let largest = |of: fn(&TileTruth) -> f64| tiles.iter().map(of).fold(0.0, f64::max);
        Ok(Some(OneLight {
            patches: patches.to_vec(),
            error_codes: largest(|tile| tile.codes.1),
            bound_codes: largest(|tile| tile.codes.0),
            cpu_ms: 1e3 * took_s,
            times_full_frame: 0.0,
            tiles_way_back: counters.tiles_way_back,
            share_of_tiles_below_error: share_below_error(&tiles),
        }))
    }
}

/// Tries them; `None` where the field has no bounds.
///
/// # Errors
/// If the stack cannot be read, or the field refuses weights.
pub fn run(stack: &Stack, field: Field<'_>, covered: &[u32], clear: &BenchSky) -> anyhow::Result<Option<LightsReport>> {
    if field.bounds().is_none() {
        return Ok(None);
    }
    let clear = PatchWeights { sun: None, ..clear.weights.clone() };
    let mut ordinary = Stage::new(field);
    let clear_exposure =
        exposure_for(&ordinary.radiance(&clear, covered)?).context("the clear sky lights nothing")? as f32;
    let mut trial = Trial {
        covered,
        map: TileMap::new(&field, covered),
        stage: Stage::new(field),
        ordinary,
        clear: &clear,
        clear_exposure,
        ordinary_s: Vec::new(),
    };
    let set = field.patch_set();
    let (mut singles, mut means) = (Vec::new(), Vec::with_capacity(set.len()));
    for patch in 0..set.len() {
        let image: Vec<[f64; 3]> = stack.pixels(patch, covered)?.iter().map(|rgb| rgb.map(f64::from)).collect();
        means.push(image.iter().flatten().sum::<f64>());
        singles.extend(trial.light(&[patch], &lit(set, &[patch]), &image)?);
    }
    let torch_patches = torch(set, &means);
    let sun_patch = brightest(&clear);
    let mut sun_left = clear.clone();
    sun_left.radiance[sun_patch] = sun_left.radiance[sun_patch].map(|v| v * SUN_TIMES_SKY);
    let torch_weights = lit(set, &torch_patches);
    let exact = stack.sums(&[torch_weights.clone(), sun_left.clone()], covered)?;
    let mut torch = trial.light(&torch_patches, &torch_weights, &exact[0])?;
    let mut sun_left = trial.light(&[sun_patch], &sun_left, &exact[1])?;

    let full_frame_cpu_ms = 1e3 * median(&trial.ordinary_s);
    for light in singles.iter_mut().chain(&mut torch).chain(&mut sun_left) {
        light.times_full_frame = light.cpu_ms / full_frame_cpu_ms;
    }
    Ok(Some(LightsReport {
        budget_codes: f64::from(BUDGET_CODES),
        full_frame_cpu_ms,
        patches_unseen: set.len() - singles.len(),
        single_patches: sum_up(&singles),
        torch,
        sun_left_in_sky: sun_left,
    }))
}

/// Some patches alone, all equally bright.
fn lit(set: &PatchSet, patches: &[usize]) -> PatchWeights {
    let mut radiance = vec![[0.0; 3]; set.len()];
    patches.iter().for_each(|&patch| radiance[patch] = [1.0; 3]);
    PatchWeights { radiance, sun: None }
}

/// The low patch that lights the picture most (`means` per patch) and its two nearest low neighbours.
fn torch(set: &PatchSet, means: &[f64]) -> Vec<usize> {
    let mut low: Vec<usize> = (0..set.upper()).filter(|&patch| set.dir_world(patch)[1] < LOW).collect();
    let Some(&first) = low.iter().max_by(|&&a, &&b| means[a].total_cmp(&means[b])) else { return Vec::new() };
    let to = set.dir_world(first);
    let near = |patch: usize| set.dir_world(patch).iter().zip(to).map(|(a, b)| a * b).sum::<f32>();
    low.sort_by(|&a, &b| near(b).total_cmp(&near(a)));
    low.truncate(3);
    low
}

fn brightest(weights: &PatchWeights) -> usize {
    let bright = |rgb: &[f32; 3]| rgb[0].max(rgb[1]).max(rgb[2]);
    let of = weights.radiance.iter().enumerate();
    of.max_by(|a, b| bright(a.1).total_cmp(&bright(b.1))).map_or(0, |(patch, _)| patch)
}

fn sum_up(lights: &[OneLight]) -> SinglePatches {
    let worst = |of: fn(&OneLight) -> f64| lights.iter().max_by(|a, b| of(a).total_cmp(&of(b))).cloned();
    let times: Vec<f64> = lights.iter().map(|light| light.times_full_frame).collect();
    SinglePatches {
        patches: lights.len(),
        patches_beyond_budget: lights.iter().filter(|light| light.bound_codes > f64::from(BUDGET_CODES)).count(),
        worst_error: worst(|light| light.error_codes),
        worst_bound: worst(|light| light.bound_codes),
        times_full_frame_median: median(&times),
        times_full_frame_worst: times.iter().copied().fold(0.0, f64::max),
        share_of_tiles_below_error: lights.iter().map(|light| light.share_of_tiles_below_error).fold(0.0, f64::max),
    }
}

impl LightsReport {
    /// Worst share of tiles whose bound is below their true error.
    pub fn share_of_tiles_below_error(&self) -> f64 {
        let others = self.torch.iter().chain(&self.sun_left_in_sky).map(|light| light.share_of_tiles_below_error);
        others.fold(self.single_patches.share_of_tiles_below_error, f64::max)
    }
}

impl std::fmt::Display for LightsReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let all = &self.single_patches;
        writeln!(
            f,
            "\nlights under a budget of {} codes; an ordinary full frame {:.3} ms\n\
             {} patches alone ({} unseen left out): {} beyond the budget; {:.1}x a full frame's time, {:.1}x at worst",
            self.budget_codes,
            self.full_frame_cpu_ms,
            all.patches,
            self.patches_unseen,
            all.patches_beyond_budget,
            all.times_full_frame_median,
            all.times_full_frame_worst
        )?;
        let named = [
            ("patch with the worst error", &all.worst_error),
            ("patch with the worst bound", &all.worst_bound),
            ("torch", &self.torch),
            ("sun left in the sky", &self.sun_left_in_sky),
        ];
        for (name, light) in named.into_iter().filter_map(|(name, light)| Some((name, light.as_ref()?))) {
            writeln!(
                f,
                "{name:<26} {:?}: error {:.2} codes, bound {:.2}; {:.3} ms, {:.1}x; {} tiles on the way back",
                light.patches,
                light.error_codes,
                light.bound_codes,
                light.cpu_ms,
                light.times_full_frame,
                light.tiles_way_back
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torch_is_three_low_neighbours_around_the_brightest() {
        let set = PatchSet::new(256).unwrap();
        let mut means = vec![0.0; set.len()];
        let high = (0..set.upper()).find(|&patch| set.dir_world(patch)[1] > 0.9).unwrap();
        let low = (0..set.upper()).rfind(|&patch| set.dir_world(patch)[1] < 0.2).unwrap();
        (means[high], means[low]) = (9.0, 5.0);
        let torch = torch(&set, &means);
        assert!(torch.len() == 3 && torch[0] == low, "{torch:?}");
        let to = set.dir_world(low);
        let cosine = |&patch: &usize| set.dir_world(patch).iter().zip(to).map(|(a, b)| a * b).sum::<f32>();
        assert!(torch.iter().all(|patch| set.dir_world(*patch)[1] < LOW && cosine(patch) > 0.9), "{torch:?}");
    }

    #[test]
    fn the_worst_lights_are_named() {
        let light = |patch, error_codes, bound_codes, times_full_frame| OneLight {
            patches: vec![patch],
            error_codes,
            bound_codes,
            cpu_ms: 1.0,
            times_full_frame,
            tiles_way_back: 0,
            share_of_tiles_below_error: if patch == 3 { 0.25 } else { 0.0 },
        };
        let all = sum_up(&[light(1, 2.0, 3.0, 1.0), light(2, 1.0, 4.1, 2.0), light(3, 0.5, 4.0, 9.0)]);
        assert_eq!(all.worst_error.unwrap().patches, [1]);
        assert_eq!(all.worst_bound.unwrap().patches, [2]);
        assert_eq!((all.patches, all.patches_beyond_budget), (3, 1));
        assert_eq!((all.times_full_frame_median, all.times_full_frame_worst), (2.0, 9.0));
        assert_eq!(all.share_of_tiles_below_error, 0.25);
    }
}
