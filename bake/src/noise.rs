//! What is left to chance in a response: some tiles of the picture, sampled twice by independent random numbers.
//!
//! Both samplings see the same points of the same surfaces, so that half the mean square of their difference is the variance
//! of the light transport and nothing else.

use crate::error::TestLight;
use crate::response::{Transport, TransportOptions};
use crate::strata::hash;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Fewest and most tiles that are sampled twice, and of how many tiles of the picture one is.
const FEWEST: usize = 4;
const MOST: usize = 16;
const ONE_OF: usize = 32;
/// Turns a seed into another one.
const OTHER_SEED: u64 = 0x9e37_79b9_7f4a_7c15;

/// Noise of single pixels: rms over pixels and channels, over the mean.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Pixels that were sampled twice.
    pub pixels: usize,
    /// Of the response to each patch, in the set's order; 0 where it lights nothing.
    pub patches: Vec<f32>,
    /// Of the picture under each held-out sky.
    pub skies: Vec<SkyNoise>,
}

/// Noise under one sky.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkyNoise {
    /// The sky.
    pub sky: String,
    /// Rms of the noise over the mean, a fraction.
    pub noise: f64,
}

impl Noise {
    /// Samples `tiles` twice.
    pub fn of(transport: &mut Transport<'_>, tiles: &[(u32, u32)], light: &TestLight) -> Noise {
        let own = transport.options;
        let first: Vec<Vec<f32>> = sampled(transport, tiles);
        transport.options = TransportOptions { seed: own.seed ^ OTHER_SEED, ..own };
        let second = sampled(transport, tiles);
        transport.options = own;
        Noise::between(&first.concat(), &second.concat(), transport.patches(), light)
    }

    /// Of two responses `[pixel][3][patch]` that chance alone tells apart.
    fn between(first: &[f32], second: &[f32], patches: usize, light: &TestLight) -> Noise {
        let mean: Vec<f32> = first.iter().zip(second).map(|(a, b)| 0.5 * (a + b)).collect();
        let off: Vec<f32> = first.iter().zip(second).map(|(a, b)| a - b).collect();
        let of_patch = |patch: usize| {
            let column = |values: &'_ [f32]| values.iter().skip(patch).step_by(patches.max(1)).copied().collect();
            let (mean, off): (Vec<f32>, Vec<f32>) = (column(&mean), column(&off));
            // Three digits are more than the estimate is good for.
            (relative(&mean, &off) * 1e4).round() as f32 / 1e4
        };
        let (means, offs) = (light.sums(&mean), light.sums(&off));
        let skies = light.names().zip(means.by_sky()).zip(offs.by_sky());
        Noise {
            pixels: first.len() / (3 * patches.max(1)),
            patches: (0..patches).map(of_patch).collect(),
            skies: skies
                .map(|((sky, mean), off)| SkyNoise { sky: sky.to_owned(), noise: relative(mean, off) })
                .collect(),
        }
    }

    /// Noise per patch that `share` of the patches that light something stay below.
    pub fn of_patches(&self, share: f64) -> f32 {
        let mut lit: Vec<f32> = self.patches.iter().copied().filter(|&noise| noise > 0.0).collect();
        lit.sort_unstable_by(f32::total_cmp);
        let last = lit.len().saturating_sub(1) as f64;
        lit.get((share.clamp(0.0, 1.0) * last).round() as usize).copied().unwrap_or(0.0)
    }

    /// The sky under which the noise is largest.
    pub fn worst_sky(&self) -> Option<&SkyNoise> {
        self.skies.iter().max_by(|a, b| a.noise.total_cmp(&b.noise))
    }
}

/// Rms of half a difference's variance, over the mean; 0 of what is black.
fn relative(mean: &[f32], off: &[f32]) -> f64 {
    let count = mean.len().max(1) as f64;
    let mean = mean.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
    let variance = off.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>() / (2.0 * count);
    if mean > 0.0 { variance.sqrt() / mean } else { 0.0 }
}

fn sampled(transport: &Transport<'_>, tiles: &[(u32, u32)]) -> Vec<Vec<f32>> {
    tiles.par_iter().map(|&(tx, ty)| transport.tile(tx, ty).response).collect()
}

/// Tiles whose corners or middle see something, row by row.
pub fn covered_tiles(transport: &Transport<'_>) -> Vec<(u32, u32)> {
    let (columns, rows) = transport.tiles();
    let all: Vec<(u32, u32)> = (0..rows).flat_map(|ty| (0..columns).map(move |tx| (tx, ty))).collect();
    let is_covered = |&(tx, ty): &(u32, u32)| {
        let [x0, y0, w, h] = transport.tile_rectangle(tx, ty);
        let (right, bottom) = (x0 + w - 1, y0 + h - 1);
        let places = [(x0 + w / 2, y0 + h / 2), (x0, y0), (right, y0), (x0, bottom), (right, bottom)];
        places.iter().any(|&(x, y)| transport.seen(x, y).0.iter().any(Option::is_some))
    };
    let covered: Vec<bool> = all.par_iter().map(is_covered).collect();
    all.into_iter().zip(covered).filter(|(_, covered)| *covered).map(|(tile, _)| tile).collect()
}

/// Some of the covered tiles, one by chance out of each stretch of them.
pub fn some_of(covered: &[(u32, u32)]) -> Vec<(u32, u32)> {
    let count = (covered.len() / ONE_OF).clamp(FEWEST, MOST).min(covered.len());
    let first = |k: usize| k * covered.len() / count;
    (0..count).map(|k| covered[first(k) + hash(k as u32) as usize % (first(k + 1) - first(k))]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heldout::TestSky;
    use crate::response::tests::{SIZE, corner, into_the_corner, options};
    use relume_firmware::patches::PatchSet;

    #[test]
    fn noise_of_known_variance_is_found() {
        let sky = TestSky { name: "even".into(), radiance: vec![[1.0; 3]; 2] };
        let light = TestLight::new(vec![sky]);
        // Patch 0 has mean 1 and noise 0.1, patch 1 mean 2 and noise 0.1; independent of each other.
        let mut state = 1u32;
        let mut gaussian = || {
            let unit = |state: &mut u32| {
                *state = hash(*state);
                f64::from(*state) / f64::from(u32::MAX)
            };
            ((0..12).map(|_| unit(&mut state)).sum::<f64>() - 6.0) as f32 * 0.1
        };
        let mut response = || -> Vec<f32> { (0..60_000).map(|at| [1.0, 2.0][at % 2] + gaussian()).collect() };
        let (first, second) = (response(), response());
        let noise = Noise::between(&first, &second, 2, &light);
        assert_eq!(noise.pixels, 10_000);
        let near = |found: f64, truth: f64| assert!((found / truth - 1.0).abs() < 0.03, "{found} for {truth}");
        near(f64::from(noise.patches[0]), 0.1);
        near(f64::from(noise.patches[1]), 0.05);
        near(noise.worst_sky().unwrap().noise, 0.1 * 2f64.sqrt() / 3.0);
        near(f64::from(noise.of_patches(1.0)), 0.1);
    }

    #[test]
    fn noise_is_what_many_seeds_scatter_by() {
        let set = PatchSet::new(16).unwrap();
        let sky = TestSky { name: "even".into(), radiance: vec![[1.0; 3]; set.len()] };
        let light = TestLight::new(vec![sky]);
        let scene = corner(0.6);
        let transport = |seed: u64| {
            let options = TransportOptions { seed, direct_classes: 1, paths: 1, ..options(3) };
            Transport::new(&scene, &into_the_corner(), set, SIZE, options).unwrap()
        };
        let pictures: Vec<Vec<f32>> = (100..124).map(|seed| transport(seed).tile(0, 0).response).collect();
        let count = pictures.len() as f64;
        let (mut variance, mut mean) = (0.0, 0.0);
        for value in 0..pictures[0].len() / set.len() {
            let of = |picture: &Vec<f32>| picture[value * set.len()..][..set.len()].iter().sum::<f32>().into();
            let sums: Vec<f64> = pictures.iter().map(of).collect();
            let middle = sums.iter().sum::<f64>() / count;
            variance += sums.iter().map(|sum| (sum - middle).powi(2)).sum::<f64>() / (count - 1.0);
            mean += middle;
        }
        let values = (pictures[0].len() / set.len()) as f64;
        let truth = (variance / values).sqrt() / (mean / values);
        let found = Noise::of(&mut transport(1), &[(0, 0)], &light).worst_sky().unwrap().noise;
        assert!(truth > 0.01 && (found / truth - 1.0).abs() < 0.15, "{found} for {truth}");
    }

    #[test]
    fn tiles_are_spread_and_none_is_taken_twice() {
        for count in [1, 3, 5, 97, 1024, 8160] {
            let covered: Vec<(u32, u32)> = (0..count).map(|k| (k, 0)).collect();
            let some = some_of(&covered);
            assert!(!some.is_empty() && some.len() <= MOST);
            assert!(some.windows(2).all(|pair| pair[0].0 < pair[1].0), "{some:?}");
        }
    }
}
