//! What skipping saves: small changes of a clear sky, a sky that clouds over, a still sky, without
//! and with a live view. Pictures are compared with
//! those of a second relighter that skips nothing; no stack is needed.

use anyhow::Context;
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;
use serde::Serialize;

use super::clock::median;
use super::error::{exposure_for, unrounded_code};
use super::intime::{self, InTime};
use super::oracle::Oracle;
use super::stage::Stage;
use super::tilemap::TileMap;
use crate::relight::FrameCounters;
use crate::weights::{PatchWeights, SunWeight};

/// Directions towards which patches change.
const DIRECTIONS: usize = 12;
/// Patches nearest to a direction that change.
const NEAREST: usize = 13;
/// What their light is multiplied by.
const FACTORS: [f64; 2] = [1.05, 1.5];
/// Frames timed per direction.
const REPEATS: usize = 5;
/// A sky clouds over in so many seconds.
const RAMP_S: usize = 10;
const FRAMES_PER_S: usize = 30;
/// Frames of a still sky.
const STILL_FRAMES: usize = 40;

/// Skipping under one sky.
#[derive(Clone, Debug, Serialize)]
pub struct SkippingReport {
    /// Was the sun up, standing still?
    pub has_sun: bool,
    /// Tiles with geometry.
    pub tiles: usize,
    /// CPU time of a full frame of the clear sky, milliseconds.
    pub full_frame_cpu_ms: f64,
    /// The 13 patches nearest a direction change; one entry per factor.
    pub nearest_patches: Vec<NearestPatches>,
    /// From clear to overcast in 10 s at 30 frames a second.
    pub clear_to_overcast: Ramp,
    /// The same weights again.
    pub still_sky: Still,
    /// The same before a view that changes with every frame.
    pub live_view: Still,
    /// From clear to overcast within time budgets.
    pub in_time: Vec<InTime>,
}

/// Small changes of the sky in 12 directions.
#[derive(Clone, Debug, Serialize)]
pub struct NearestPatches {
    /// What the light of the patches is multiplied by.
    pub factor: f64,
    /// CPU time of a full frame / that of the change, median of the directions.
    pub times_less_than_full_frame_median: f64,
    /// The same for the direction that gains least.
    pub times_less_than_full_frame_worst: f64,
    /// CPU time of the change, median, milliseconds.
    pub cpu_ms: f64,
    /// Tiles that an oracle redraws, mean of the directions.
    pub tiles_drawn_by_oracle: f64,
    /// What a frame did, mean of the directions.
    pub counters: Counts,
}

/// Counters of frames, mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    /// Tiles drawn.
    pub tiles_drawn: f64,
    /// Tiles of which only the view behind was changed.
    pub tiles_composited: f64,
    /// Tiles kept.
    pub tiles_kept: f64,
    /// Blocks projected from scratch.
    pub blocks_projected: f64,
    /// Blocks to which only changed patches were added.
    pub blocks_stepped: f64,
    /// Blocks that were not projected, because none of their tiles could show the change.
    pub blocks_spared: f64,
    /// Patches read.
    pub patches_changed: f64,
}

/// A sky that clouds over.
#[derive(Clone, Debug, Serialize)]
pub struct Ramp {
    /// Frames after the first.
    pub frames: usize,
    /// Tiles drawn in all of them.
    pub tiles_drawn: usize,
    /// Tiles drawn by an oracle that knows each tile's true change since it drew it last.
    pub tiles_drawn_by_oracle: usize,
    /// The one / the other.
    pub times_oracle: Option<f64>,
    /// CPU time of a frame, median, milliseconds.
    pub cpu_ms: f64,
    /// What a frame did, mean.
    pub counters: Counts,
}

/// The same weights again.
#[derive(Clone, Debug, Serialize)]
pub struct Still {
    /// CPU time of a frame, median, milliseconds.
    pub cpu_ms: f64,
    /// The same as a share of a full frame's.
    pub share_of_full_frame: f64,
    /// What a frame did, mean.
    pub counters: Counts,
}

impl Counts {
    fn mean(of: &[FrameCounters]) -> Self {
        let mean = |value: fn(&FrameCounters) -> usize| {
            of.iter().map(|counters| value(counters) as f64).sum::<f64>() / of.len().max(1) as f64
        };
        Counts {
            tiles_drawn: mean(|c| c.tiles_drawn),
            tiles_composited: mean(|c| c.tiles_composited),
            tiles_kept: mean(|c| c.tiles_kept),
            blocks_projected: mean(|c| c.blocks_projected),
            blocks_stepped: mean(|c| c.blocks_stepped),
            blocks_spared: mean(|c| c.blocks_spared),
            patches_changed: mean(|c| c.patches_changed),
        }
    }
}

/// A relighter that skips, and one that does not.
pub(super) struct Trial<'a> {
    covered: &'a [u32],
    map: TileMap,
    /// Skips.
    stage: Stage<'a>,
    /// Skips nothing.
    other: Stage<'a>,
    pub(super) exposure: f32,
}

/// Measures from a clear sky towards an overcast one, also within `times_ms`, milliseconds a frame. A sun stays where it is.
///
/// # Errors
/// If the field refuses the weights, or the sky lights nothing.
pub fn run(
    field: Field<'_>,
    covered: &[u32],
    (clear, overcast): (&PatchWeights, &PatchWeights),
    times_ms: &[f64],
) -> anyhow::Result<SkippingReport> {
    let mut other = Stage::new(field);
    let exposure = exposure_for(&other.radiance(clear, covered)?).context("the clear sky lights nothing")? as f32;
    let map = TileMap::new(&field, covered);
    let mut trial = Trial { covered, map, stage: Stage::new(field), other, exposure };
    let full = (0..STILL_FRAMES).map(|_| Ok(trial.stage.full_frame(clear, exposure)?.0));
    let full_s = median(&full.collect::<anyhow::Result<Vec<f64>>>()?);
    let still = trial.still(clear, full_s)?;
    let live = live_view(Stage::new(field), (clear, exposure), full_s)?;
    let changes = |&factor: &f64| trial.nearest(field.patch_set(), clear, factor);
    Ok(SkippingReport {
        has_sun: clear.sun.is_some(),
        tiles: (0..field.response().tiles()).filter(|&tile| field.response().tile(tile).pixels() > 0).count(),
        full_frame_cpu_ms: 1e3 * full_s,
        nearest_patches: FACTORS.iter().map(changes).collect::<anyhow::Result<_>>()?,
        clear_to_overcast: trial.ramp(clear, overcast)?,
        still_sky: still,
        live_view: live,
        in_time: intime::run(&mut trial, field, (clear, overcast), (full_s, times_ms))?,
    })
}

/// A still sky before a live view. The stage is its own: what a live view needs is kept from its second picture on.
fn live_view(mut stage: Stage<'_>, (sky, exposure): (&PatchWeights, f32), full_s: f64) -> anyhow::Result<Still> {
    for _ in 0..2 {
        stage.frame_of_live_view(sky, exposure)?;
    }
    let frames = (0..STILL_FRAMES).map(|_| stage.frame_of_live_view(sky, exposure));
    Ok(Still::of(frames.collect::<anyhow::Result<Vec<_>>>()?, full_s))
}

impl Still {
    fn of(frames: Vec<(f64, FrameCounters)>, full_s: f64) -> Self {
        let (took, counters): (Vec<f64>, Vec<FrameCounters>) = frames.into_iter().unzip();
        let seconds = median(&took);
        Still { cpu_ms: 1e3 * seconds, share_of_full_frame: seconds / full_s, counters: Counts::mean(&counters) }
    }
}

impl Trial<'_> {
    fn still(&mut self, sky: &PatchWeights, full_s: f64) -> anyhow::Result<Still> {
        let frames = (0..STILL_FRAMES).map(|_| self.stage.frame(sky, self.exposure));
        Ok(Still::of(frames.collect::<anyhow::Result<Vec<_>>>()?, full_s))
    }

    fn nearest(&mut self, set: &PatchSet, clear: &PatchWeights, factor: f64) -> anyhow::Result<NearestPatches> {
        let (mut ratios, mut took_s, mut counters, mut truly) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for direction in directions() {
            let mut changed = clear.clone();
            for patch in nearest(set, direction) {
                changed.radiance[patch] = changed.radiance[patch].map(|v| v * factor as f32);
            }
            let (mut full, mut step) = (Vec::new(), Vec::new());
            for repeat in 0..REPEATS {
                full.push(self.stage.full_frame(clear, self.exposure)?.0);
                let (took, counts) = self.stage.frame(&changed, self.exposure)?;
                step.push(took);
                counters.extend((repeat == 0).then_some(counts));
            }
            ratios.push(median(&full) / median(&step));
            took_s.push(median(&step));
            let mut oracle = Oracle::new(self.map.clone());
            oracle.frame(&self.codes(clear)?);
            truly += oracle.frame(&self.codes(&changed)?);
        }
        Ok(NearestPatches {
            factor,
            times_less_than_full_frame_median: median(&ratios),
            times_less_than_full_frame_worst: ratios.iter().copied().fold(f64::INFINITY, f64::min),
            cpu_ms: 1e3 * median(&took_s),
            tiles_drawn_by_oracle: truly as f64 / DIRECTIONS as f64,
            counters: Counts::mean(&counters),
        })
    }

    fn ramp(&mut self, clear: &PatchWeights, overcast: &PatchWeights) -> anyhow::Result<Ramp> {
        let mut oracle = Oracle::new(self.map.clone());
        self.stage.full_frame(clear, self.exposure)?;
        oracle.frame(&self.codes(clear)?);
        let frames = RAMP_S * FRAMES_PER_S;
        let (mut by_oracle, mut took_s, mut counters) = (0, Vec::new(), Vec::new());
        for frame in 1..=frames {
            let sky = mix(clear, overcast, frame as f32 / frames as f32);
            let (took, counts) = self.stage.frame(&sky, self.exposure)?;
            by_oracle += oracle.frame(&self.codes(&sky)?);
            took_s.push(took);
            counters.push(counts);
        }
        let drawn = counters.iter().map(|counters| counters.tiles_drawn).sum();
        Ok(Ramp {
            frames,
            tiles_drawn: drawn,
            tiles_drawn_by_oracle: by_oracle,
            times_oracle: (by_oracle > 0).then(|| drawn as f64 / by_oracle as f64),
            cpu_ms: 1e3 * median(&took_s),
            counters: Counts::mean(&counters),
        })
    }

    /// Largest distance of a covered pixel's code in this picture from that before rounding with nothing skipped.
    pub(super) fn code_error(&mut self, sky: &PatchWeights, pixels_xrgb: &[u32]) -> anyhow::Result<f64> {
        let codes = self.codes(sky)?;
        let pixels = self.covered.iter().map(|&at| pixels_xrgb[at as usize].to_be_bytes());
        let off = pixels.zip(&codes).flat_map(|([_, rgb @ ..], exact)| {
            rgb.into_iter().zip(exact).map(|(shown, &exact)| (f64::from(shown) - f64::from(exact)).abs())
        });
        Ok(off.fold(0.0, f64::max))
    }

    /// Codes of the covered pixels, before rounding, with nothing skipped.
    fn codes(&mut self, sky: &PatchWeights) -> anyhow::Result<Vec<[f32; 3]>> {
        let exposure = f64::from(self.exposure);
        let radiance = self.other.radiance(sky, self.covered)?;
        Ok(radiance.iter().map(|rgb| rgb.map(|value| unrounded_code(value * exposure) as f32)).collect())
    }
}

/// Directions spread over the hemisphere.
fn directions() -> impl Iterator<Item = [f32; 3]> {
    let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    (0..DIRECTIONS).map(move |k| {
        let up = (k as f32 + 0.5) / DIRECTIONS as f32;
        let (sin, cos) = (k as f32 * golden).sin_cos();
        let radius = (1.0 - up * up).sqrt();
        [radius * sin, up, radius * cos]
    })
}

/// The upper patches nearest to a direction.
fn nearest(set: &PatchSet, to: [f32; 3]) -> Vec<usize> {
    let near = |patch: usize| set.dir_world(patch).iter().zip(to).map(|(a, b)| a * b).sum::<f32>();
    let mut patches: Vec<usize> = (0..set.upper()).collect();
    patches.sort_by(|&a, &b| near(b).total_cmp(&near(a)));
    patches.truncate(NEAREST);
    patches
}

/// `share` of the way from one sky to another; the sun stays where `from` has it.
pub(super) fn mix(from: &PatchWeights, to: &PatchWeights, share: f32) -> PatchWeights {
    let between = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|c| a[c] + share * (b[c] - a[c]));
    let sun = from.sun.map(|sun| {
        let end = to.sun.map_or([0.0; 3], |to| to.irradiance);
        SunWeight { irradiance: between(sun.irradiance, end), ..sun }
    });
    PatchWeights { radiance: from.radiance.iter().zip(&to.radiance).map(|(a, b)| between(*a, *b)).collect(), sun }
}

impl std::fmt::Display for SkippingReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sun = if self.has_sun { "with the sun" } else { "without a sun" };
        writeln!(f, "\nskipping, clear sky {sun}: full frame {:.3} ms, {} tiles", self.full_frame_cpu_ms, self.tiles)?;
        for n in &self.nearest_patches {
            writeln!(
                f,
                "13 patches x {:<4} {:.3} ms, {:.1}x less ({:.1}x at worst); tiles drawn {:.1}, by an oracle {:.1}; \
                 blocks projected {:.1}, stepped {:.1}, spared {:.1}; patches read {:.1}",
                n.factor,
                n.cpu_ms,
                n.times_less_than_full_frame_median,
                n.times_less_than_full_frame_worst,
                n.counters.tiles_drawn,
                n.tiles_drawn_by_oracle,
                n.counters.blocks_projected,
                n.counters.blocks_stepped,
                n.counters.blocks_spared,
                n.counters.patches_changed
            )?;
        }
        let (ramp, still, live) = (&self.clear_to_overcast, &self.still_sky, &self.live_view);
        writeln!(
            f,
            "clear to overcast: tiles drawn {}, by an oracle {}, {:.2}x; {:.3} ms a frame\n\
             still sky: {:.4} ms, {:.2} % of a full frame; tiles kept {:.0}\n\
             still sky, live view: {:.4} ms, {:.2} % of a full frame; tiles composited {:.0}, kept {:.0}, drawn {:.0}",
            ramp.tiles_drawn,
            ramp.tiles_drawn_by_oracle,
            ramp.times_oracle.unwrap_or(f64::NAN),
            ramp.cpu_ms,
            still.cpu_ms,
            100.0 * still.share_of_full_frame,
            still.counters.tiles_kept,
            live.cpu_ms,
            100.0 * live.share_of_full_frame,
            live.counters.tiles_composited,
            live.counters.tiles_kept,
            live.counters.tiles_drawn
        )?;
        self.in_time.iter().try_for_each(|budget| write!(f, "{budget}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_fill_the_hemisphere_and_find_their_patches() {
        let set = PatchSet::new(256).unwrap();
        let all: Vec<[f32; 3]> = directions().collect();
        assert_eq!(all.len(), 12);
        let length = |d: &[f32; 3]| d.iter().map(|v| v * v).sum::<f32>();
        assert!(all.iter().all(|d| d[1] > 0.0 && (length(d) - 1.0).abs() < 1e-5));
        for direction in all {
            let near = nearest(&set, direction);
            let cosine = |patch: usize| set.dir_world(patch).iter().zip(direction).map(|(a, b)| a * b).sum::<f32>();
            let farthest = near.iter().map(|&patch| cosine(patch)).fold(1.0, f32::min);
            let others = (0..set.upper()).filter(|patch| !near.contains(patch));
            assert!(near.len() == 13 && others.into_iter().all(|patch| cosine(patch) <= farthest));
        }
    }

    #[test]
    fn a_mix_starts_and_ends_with_its_skies() {
        let sun = SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: [8.0; 3] };
        let clear = PatchWeights { radiance: vec![[1.0, 2.0, 3.0]; 2], sun: Some(sun) };
        let overcast = PatchWeights { radiance: vec![[5.0; 3]; 2], sun: None };
        assert_eq!(mix(&clear, &overcast, 0.0), clear);
        let end = mix(&clear, &overcast, 1.0);
        assert_eq!((end.radiance, end.sun.map(|sun| sun.irradiance)), (overcast.radiance.clone(), Some([0.0; 3])));
        assert_eq!(mix(&clear, &overcast, 0.25).radiance[1], [2.0, 2.75, 3.5]);
    }

    #[test]
    fn counts_are_means() {
        let one = |tiles_drawn| FrameCounters { tiles_drawn, patches_changed: 13, ..FrameCounters::default() };
        let mean = Counts::mean(&[one(2), one(5)]);
        assert_eq!((mean.tiles_drawn, mean.patches_changed), (3.5, 13.0));
    }
}
