//! Pixels whose samples disagree: something passed, or the sky moved. One consistent group of samples is kept.
//!
//! Two samples agree when their channels differ by less than 3.5 standard deviations and 3 % of the larger, and none lies below
//! what the other, clipped, shows at least. A frame's group is all that agrees with it. Groups have a vote per frame, three at
//! most, so that a cloud's long stay before or after outweighs nothing; the reference frame's group has more, so that what moved
//! is shown as it was at one moment; and a group like the sky around most, for a bird is unlike it.

use super::tables::{Fact, Facts, format_of};
use super::{MergeSettings, Merged, PixelState, SensorNoise};
use crate::camera::Frame;

/// Most frames of a series that are looked at together.
pub(super) const MOST_FRAMES: usize = 32;
const SIGMAS: f32 = 3.5;
const SYSTEMATIC: f32 = 0.03;
/// Votes of the reference frame's group, of it where the frame before or after confirms it, and of a group that equals the sky
/// around.
const REFERENCE_VOTES: f32 = 3.0;
const STANDING_VOTES: f32 = 9.0;
const SURROUNDINGS_VOTES: f32 = 6.0;
/// Frames of a group beyond which more do not count.
const MOST_VOTES: u32 = 3;
/// Log distance over which likeness to the surroundings fades.
const LIKENESS: f32 = 0.5;
/// Pixels along a side of the areas whose mean is the surroundings.
const AREA: usize = 16;
/// Pixels of an area that are looked at: every so many in both directions.
const AREA_STEP: usize = 2;

/// A channel of a pixel in one frame.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Radiance, full-well fractions per second.
    radiance: f32,
    /// Its variance.
    variance: f32,
    /// False where clipped: the radiance is then the least it can be.
    usable: bool,
}

/// The frames of a series, no more after the first that is none.
pub(super) type Views<'a> = [Option<View<'a>>; MOST_FRAMES];

/// A frame as ghosts are told by.
pub(super) struct View<'a> {
    pub frame: &'a Frame,
    pub facts: &'a Facts,
    /// Exposure time x gain, corrected, seconds.
    pub product_s: f64,
    pub noise: SensorNoise,
}

impl View<'_> {
    /// Inverse variance of a channel's radiance in this frame; 0 where clipped.
    pub fn weight(&self, pixel: usize, channel: usize) -> f32 {
        1.0 / self.sample(pixel, channel).variance
    }

    fn sample(&self, pixel: usize, channel: usize) -> Sample {
        let fact: Fact = self.facts.channels[channel][usize::from(self.frame.codes.get(pixel * 3 + channel))];
        let t = self.product_s as f32;
        if !fact.usable() {
            return Sample { radiance: self.facts.clip[channel] / t, variance: f32::INFINITY, usable: false };
        }
        let variance = fact.variance(&self.noise, self.frame.exposure.gain) / (t * t);
        Sample { radiance: fact.fraction / t, variance, usable: true }
    }
}

fn agree(a: &[Sample; 3], b: &[Sample; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| {
        let tolerance = |sample: &Sample| SYSTEMATIC * sample.radiance.abs();
        match (a.usable, b.usable) {
            (true, true) => {
                let off = (a.radiance - b.radiance).abs() - tolerance(a).max(tolerance(b));
                off <= 0.0 || off * off <= SIGMAS * SIGMAS * (a.variance + b.variance)
            }
            (true, false) => a.radiance + tolerance(a) + SIGMAS * a.variance.sqrt() >= b.radiance,
            (false, true) => b.radiance + tolerance(b) + SIGMAS * b.variance.sqrt() >= a.radiance,
            (false, false) => true,
        }
    })
}

/// Settles suspect pixels; its buffers are kept.
#[derive(Clone, Debug, Default)]
pub(super) struct GhostFilter {
    /// Mean radiance of the areas of the picture, over pixels that no ghost touches; and how many those are.
    areas: Vec<([f32; 3], f32)>,
    spread: Vec<([f32; 3], f32)>,
    is_suspect: Vec<bool>,
    /// Per area: it holds suspects.
    is_wanted: Vec<bool>,
    across: usize,
}

impl GhostFilter {
    /// Settles the pixels of `suspects` in `merged`; `reference` is the place of the reference frame. Returns how many pixels had samples left out.
    pub fn settle(&mut self, views: &Views<'_>, reference: usize, suspects: &[u32], merged: &mut Merged) -> usize {
        if suspects.is_empty() {
            return 0;
        }
        self.look_around(suspects, merged);
        let mut count = 0;
        for &pixel in suspects {
            let pixel = pixel as usize;
            let mut samples = [[Sample { radiance: 0.0, variance: f32::INFINITY, usable: false }; 3]; MOST_FRAMES];
            let mut frames = 0;
            for (view, sample) in views.iter().flatten().zip(&mut samples) {
                *sample = std::array::from_fn(|channel| view.sample(pixel, channel));
                frames += 1;
            }
            let samples = &samples[..frames];
            let (group, all) = self.group(samples, reference, self.surroundings(pixel, merged.width));
            if group != all {
                count += 1;
                merged.radiance[pixel] = mean(samples, group, all, merged.radiance[pixel]);
            }
        }
        count
    }

    /// The frames of the winning group, and all that measured anything, as bits.
    fn group(&self, samples: &[[Sample; 3]], reference: usize, around: Option<[f32; 3]>) -> (u32, u32) {
        let measures = |i: usize| samples[i].iter().any(|sample| sample.usable);
        let all = (0..samples.len()).filter(|&i| measures(i)).fold(0u32, |bits, i| bits | 1 << i);
        let (mut best, mut most) = (all, f32::NEG_INFINITY);
        let reference_votes = reference_votes(samples, reference, all);
        for i in (0..samples.len()).filter(|&i| measures(i)) {
            let agreeing = |&j: &usize| measures(j) && agree(&samples[i], &samples[j]);
            let group = (0..samples.len()).filter(agreeing).fold(0u32, |bits, j| bits | 1 << j);
            let likeness = around.map_or(0.0, |around| (-distance(&samples[i], around) / LIKENESS).exp());
            let votes = group.count_ones().min(MOST_VOTES) as f32
                + if group >> reference & 1 == 1 { reference_votes } else { 0.0 }
                + SURROUNDINGS_VOTES * likeness;
            if votes > most {
                (best, most) = (group, votes);
            }
        }
        (best, all)
    }

    fn surroundings(&self, pixel: usize, width: usize) -> Option<[f32; 3]> {
        let (col, row) = (pixel % width, pixel / width);
        let (mean, count) = self.areas[row / AREA * self.across + col / AREA];
        (count > 0.0).then_some(mean)
    }

    /// Means without the suspects of the areas that hold some; an area of suspects alone takes those of its neighbours.
    fn look_around(&mut self, suspects: &[u32], merged: &Merged) {
        let down = merged.height.div_ceil(AREA);
        self.across = merged.width.div_ceil(AREA);
        self.areas.clear();
        self.areas.resize(self.across * down, ([0.0; 3], 0.0));
        self.is_wanted.clear();
        self.is_wanted.resize(self.areas.len(), false);
        self.is_suspect.resize(merged.radiance.len(), false);
        for &pixel in suspects {
            self.is_suspect[pixel as usize] = true;
            self.is_wanted[pixel as usize / merged.width / AREA * self.across + pixel as usize % merged.width / AREA] =
                true;
        }
        let mut lacks = false;
        for area in 0..self.areas.len() {
            if self.is_wanted[area] {
                self.areas[area] = self.mean_of(area, merged);
                lacks |= self.areas[area].1 == 0.0;
            }
        }
        if lacks {
            for area in (0..self.areas.len()).filter(|&area| !self.is_wanted[area]) {
                self.areas[area] = self.mean_of(area, merged);
            }
        }
        suspects.iter().for_each(|&pixel| self.is_suspect[pixel as usize] = false);
        let is_empty = |(_, count): &([f32; 3], f32)| *count == 0.0;
        while lacks && self.areas.iter().any(is_empty) && !self.areas.iter().all(is_empty) {
            self.fill_areas(down);
        }
    }

    /// Mean radiance of an area over pixels that are no suspects, and how many those are.
    fn mean_of(&self, area: usize, merged: &Merged) -> ([f32; 3], f32) {
        let (left, top) = (area % self.across * AREA, area / self.across * AREA);
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for row in (top..(top + AREA).min(merged.height)).step_by(AREA_STEP) {
            for col in (left..(left + AREA).min(merged.width)).step_by(AREA_STEP) {
                let pixel = row * merged.width + col;
                if !self.is_suspect[pixel] && merged.state[pixel] == PixelState::Valid {
                    sum = std::array::from_fn(|k| sum[k] + merged.radiance[pixel][k]);
                    count += 1.0;
                }
            }
        }
        (if count > 0.0 { sum.map(|v| v / count) } else { sum }, count)
    }

    fn fill_areas(&mut self, down: usize) {
        self.spread.clone_from(&self.areas);
        for at in 0..self.areas.len() {
            if self.areas[at].1 > 0.0 {
                continue;
            }
            let (col, row) = (at % self.across, at / self.across);
            let (mut sum, mut count) = ([0.0; 3], 0.0);
            for row in row.saturating_sub(1)..(row + 2).min(down) {
                for col in col.saturating_sub(1)..(col + 2).min(self.across) {
                    let (mean, found) = self.areas[row * self.across + col];
                    if found > 0.0 {
                        sum = std::array::from_fn(|k| sum[k] + mean[k]);
                        count += 1.0;
                    }
                }
            }
            if count > 0.0 {
                self.spread[at] = (sum.map(|v| v / count), 1.0);
            }
        }
        std::mem::swap(&mut self.areas, &mut self.spread);
    }
}

/// Votes for what the reference frame shows: many where the frame before or after shows the same, none where those two show
/// the same and it does not, for then something passed in that moment.
fn reference_votes(samples: &[[Sample; 3]], reference: usize, all: u32) -> f32 {
    let measures = |&i: &usize| all >> i & 1 == 1;
    let before = (0..reference).rev().find(measures);
    let after = (reference + 1..samples.len()).find(measures);
    let (Some(before), Some(after)) = (before, after) else { return REFERENCE_VOTES };
    let same = |a: usize, b: usize| agree(&samples[a], &samples[b]);
    if same(reference, before) || same(reference, after) {
        STANDING_VOTES
    } else if same(before, after) {
        0.0
    } else {
        REFERENCE_VOTES
    }
}

/// Mean log distance of a frame's usable channels from the surroundings.
fn distance(samples: &[Sample; 3], around: [f32; 3]) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (sample, around) in samples.iter().zip(around).filter(|(sample, _)| sample.usable) {
        sum += (sample.radiance.max(1e-12) / around.max(1e-12)).ln().abs();
        count += 1.0;
    }
    sum / f32::max(count, 1.0)
}

/// Inverse-variance mean over the frames of a group; a channel that none of them measures is taken from all.
fn mean(samples: &[[Sample; 3]], group: u32, all: u32, before: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|channel| {
        let over = |frames: u32| {
            let (mut weighted, mut weight) = (0.0, 0.0);
            for (_, sample) in samples.iter().enumerate().filter(|(i, _)| frames >> i & 1 == 1) {
                let sample = sample[channel];
                if sample.usable {
                    weighted += sample.radiance / sample.variance;
                    weight += 1.0 / sample.variance;
                }
            }
            (weight > 0.0).then(|| f32::max(weighted / weight, 0.0))
        };
        over(group).or_else(|| over(all)).unwrap_or(before[channel])
    })
}

/// The frame with the most pixels well above black and below clipping.
pub(super) fn reference_of(views: &Views<'_>, pixels: usize) -> usize {
    let stride = (pixels / 2048).max(1) | 1;
    let well = |view: &View<'_>| {
        let in_range = |pixel: &usize| {
            let fact = view.facts.channels[1][usize::from(view.frame.codes.get(pixel * 3 + 1))];
            (0.02..1.0).contains(&fact.fraction)
        };
        (0..pixels).step_by(stride).filter(in_range).count()
    };
    let counts = views.iter().flatten().map(well).enumerate();
    counts.max_by_key(|&(place, count)| (count, std::cmp::Reverse(place))).map_or(0, |(place, _)| place)
}

/// A view per frame of a series.
pub(super) fn views<'a>(
    frames: &'a [Frame],
    facts: &'a [Option<Facts>; 2],
    products_s: &'a [f64],
    noise: SensorNoise,
) -> impl Iterator<Item = View<'a>> {
    frames.iter().zip(products_s).filter_map(move |(frame, &product_s)| {
        Some(View { frame, facts: facts[format_of(frame)].as_ref()?, product_s, noise })
    })
}

impl MergeSettings {
    /// Share of pixels that may be suspect; beyond, curve or times are wrong and no pixel is judged.
    pub(super) const MOST_SUSPECT: f64 = 0.4;
}
