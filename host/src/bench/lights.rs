//! The paper's way on: few lights, chosen live. Median cut (Debevec, *A median cut algorithm for light probe sampling*,
//! 2005) over the patches of the current sky: K regions of equal light, each shown by the image of the patch nearest its
//! centroid; then the dense f32 sum of those K images by OpenBLAS.

use std::sync::Arc;

use relume_firmware::patches::PatchSet;

use super::arena::Arena;
use super::columns::{Blocks, Columns};
use super::openblas::Blas;
use super::rival::Summation;
use crate::map::luminance;
use crate::weights::PatchWeights;

/// Name in reports.
pub const LIGHTS_NAME: &str = "median_cut_lights_openblas";
/// Numbers of lights that are tried: powers of two, as the cut halves.
pub const LIGHTS: [usize; 4] = [8, 16, 32, 64];

/// A patch as the cut sees it.
#[derive(Clone, Copy)]
struct Point {
    patch: usize,
    dir: [f32; 3],
    azimuth: f32,
    altitude: f32,
    /// Luminance x solid angle.
    energy: f32,
}

/// A region's light: the patch whose image stands for it, and the radiance that image is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// The patch.
    pub patch: usize,
    /// RGB radiance of that patch that carries the region's whole light.
    pub radiance: [f32; 3],
}

/// Chooses lights for one set of patches.
pub struct MedianCut {
    points: Vec<Point>,
    solid_angles_sr: Vec<f32>,
    lights: Vec<Light>,
}

impl MedianCut {
    /// A cut over the patches of `set`.
    pub fn new(set: &PatchSet) -> Self {
        let point = |patch| {
            let dir = set.dir_world(patch);
            let (azimuth, altitude) = (dir[2].atan2(dir[0]), dir[1].clamp(-1.0, 1.0).asin());
            Point { patch, dir, azimuth, altitude, energy: 0.0 }
        };
        let solid_angles_sr = (0..set.len()).map(|patch| set.solid_angle_sr(patch)).collect();
        MedianCut { points: (0..set.len()).map(point).collect(), solid_angles_sr, lights: Vec::new() }
    }

    /// At most `2^halvings` lights that carry all of the sky's light.
    pub fn lights(&mut self, radiance: &[[f32; 3]], halvings: u32) -> &[Light] {
        for point in &mut self.points {
            point.energy = luminance(radiance[point.patch]) * self.solid_angles_sr[point.patch];
        }
        self.lights.clear();
        cut(&mut self.points, halvings, radiance, &self.solid_angles_sr, &mut self.lights);
        &self.lights
    }
}

/// Halves a region by light along its longer side, until `halvings` are done or one patch is left.
fn cut(region: &mut [Point], halvings: u32, radiance: &[[f32; 3]], sr: &[f32], lights: &mut Vec<Light>) {
    if halvings == 0 || region.len() < 2 {
        lights.extend(light_of(region, radiance, sr));
        return;
    }
    let span = |value: fn(&Point) -> f32| {
        let range = region.iter().map(value).fold((f32::MAX, f32::MIN), |r, v| (r.0.min(v), r.1.max(v)));
        range.1 - range.0
    };
    let middle = region.iter().map(|point| point.altitude).sum::<f32>() / region.len() as f32;
    if span(|point| point.azimuth) * middle.cos() > span(|point| point.altitude) {
        region.sort_unstable_by(|a, b| a.azimuth.total_cmp(&b.azimuth));
    } else {
        region.sort_unstable_by(|a, b| a.altitude.total_cmp(&b.altitude));
    }
    let half = 0.5 * region.iter().map(|point| point.energy).sum::<f32>();
    let (mut sum, mut at) = (0.0, 0);
    while at + 1 < region.len() && sum + 0.5 * region[at].energy <= half {
        sum += region[at].energy;
        at += 1;
    }
    let (low, high) = region.split_at_mut(at.max(1));
    cut(low, halvings - 1, radiance, sr, lights);
    cut(high, halvings - 1, radiance, sr, lights);
}

fn light_of(region: &[Point], radiance: &[[f32; 3]], sr: &[f32]) -> Option<Light> {
    let (mut centroid, mut power) = ([0.0f32; 3], [0.0f32; 3]);
    for point in region {
        for c in 0..3 {
            centroid[c] += point.dir[c] * point.energy;
            power[c] += radiance[point.patch][c] * sr[point.patch];
        }
    }
    let near = |point: &Point| (0..3).map(|c| point.dir[c] * centroid[c]).sum::<f32>();
    let patch = region.iter().max_by(|a, b| near(a).total_cmp(&near(b)))?.patch;
    Some(Light { patch, radiance: power.map(|v| v / sr[patch]) })
}

/// The sum of K images; the sun keeps an image of its own.
pub struct Lights {
    blas: Arc<Blas>,
    columns: Columns,
    cut: MedianCut,
    halvings: u32,
    /// Column and weight per channel of every image that is summed.
    chosen: Vec<(usize, [f32; 3])>,
}

impl Lights {
    /// `count` lights (a power of two) over the columns that [`super::dense::Dense`] sums.
    pub fn new(blas: Arc<Blas>, columns: Columns, set: &PatchSet, count: usize) -> Self {
        Lights { blas, columns, cut: MedianCut::new(set), halvings: count.ilog2(), chosen: Vec::new() }
    }
}

impl Summation for Lights {
    fn name(&self) -> &'static str {
        LIGHTS_NAME
    }

    fn budget(&self) -> Option<String> {
        Some(format!("{} lights", 1 << self.halvings))
    }

    fn blocks(&self) -> Blocks {
        self.columns.blocks()
    }

    fn project(&mut self, weights: &PatchWeights, scale: f32) {
        let lights = self.cut.lights(&weights.radiance, self.halvings);
        let scaled = |rgb: [f32; 3]| rgb.map(|v| v * scale);
        self.chosen.clear();
        self.chosen.extend(lights.iter().map(|light| (light.patch, scaled(light.radiance))));
        self.chosen.extend(weights.sun.map(|sun| (weights.radiance.len(), scaled(sun.irradiance))));
        // In the order in which they lie in memory.
        self.chosen.sort_unstable_by_key(|(column, _)| *column);
    }

    fn sum(&self, block: usize, out: [&mut [f32]; 3]) {
        for (channel, out) in out.into_iter().enumerate() {
            let columns = self.columns.block(block, channel);
            out.fill(0.0);
            for (column, weight) in &self.chosen {
                if let Some(image) = columns.get(column * out.len()..(column + 1) * out.len()) {
                    self.blas.saxpy(weight[channel], image, out);
                }
            }
        }
    }

    fn bytes_read(&self, sun: bool) -> usize {
        3 * self.blocks().pixels * ((1 << self.halvings) + usize::from(sun)) * size_of::<f32>()
    }

    fn move_on(&mut self) {
        self.columns.move_on();
    }

    fn wander(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()> {
        self.columns.wander(arena)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn power(lights: &[Light], set: &PatchSet) -> f64 {
        lights.iter().map(|l| f64::from(l.radiance[1]) * f64::from(set.solid_angle_sr(l.patch))).sum()
    }

    #[test]
    fn no_light_is_lost_and_halves_are_even() {
        let set = PatchSet::new(256).unwrap();
        // Below the horizon patches are 16 times as large: as much light for each patch.
        let even = |i: usize| if i < set.upper() { 1.0 } else { 1.0 / 16.0 };
        let radiance: Vec<[f32; 3]> =
            (0..set.len()).map(|i| [1.0, 1.0 + (i % 7) as f32, 2.0].map(|v| v * even(i))).collect();
        let all: f64 = (0..set.len()).map(|i| f64::from(radiance[i][1]) * f64::from(set.solid_angle_sr(i))).sum();
        let mut cut = MedianCut::new(&set);
        for halvings in 0..=6 {
            let lights = cut.lights(&radiance, halvings).to_vec();
            assert!(
                lights.len() == 1 << halvings || (halvings > 4 && lights.len() > 1 << (halvings - 1)),
                "{lights:?}"
            );
            assert!((power(&lights, &set) / all - 1.0).abs() < 1e-5);
        }
        let eight = cut.lights(&radiance, 3).to_vec();
        let largest = eight.iter().map(|l| power(&[*l], &set)).fold(0.0, f64::max);
        assert!(largest < 1.5 * all / 8.0, "{largest} of {all}");
    }

    #[test]
    fn a_bright_patch_is_found_where_it_stands() {
        let set = PatchSet::new(256).unwrap();
        let mut radiance = vec![[1e-6; 3]; set.len()];
        radiance[77] = [5.0, 6.0, 7.0];
        let lights = MedianCut::new(&set).lights(&radiance, 3).to_vec();
        let bright = lights.iter().max_by(|a, b| a.radiance[1].total_cmp(&b.radiance[1])).unwrap();
        assert!(bright.patch == 77 && (bright.radiance[1] - 6.0).abs() < 0.01, "{bright:?}");
    }

    #[test]
    fn as_many_lights_as_patches_are_the_sky_itself() {
        let set = PatchSet::new(64).unwrap();
        let radiance: Vec<[f32; 3]> = (0..set.len()).map(|i| [1.0 + i as f32, 2.0, 3.0]).collect();
        let mut lights = MedianCut::new(&set).lights(&radiance, 20).to_vec();
        lights.sort_by_key(|light| light.patch);
        assert_eq!(lights.len(), set.len());
        assert!(lights.iter().zip(&radiance).all(|(l, r)| (l.radiance[0] / r[0] - 1.0).abs() < 1e-5));
    }
}
