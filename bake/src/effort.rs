//! How finely light is sampled: as the noise that may be left, or the time that there is, asks for.
//!
//! Levels of sampling, each about twice as dear as the one before, are tried on some tiles of the picture, the cheapest first.

use crate::bake::{BakeError, BakeOptions};
use crate::camera::Camera;
use crate::job::Job;
use crate::jobs::Scenes;
use crate::noise::{Noise, covered_tiles, some_of};
use crate::part::Part;
use crate::response::TransportOptions;
use crate::scene::Scene;
use rayon::prelude::*;
use std::fmt;
use std::time::{Duration, Instant};

/// What a bake should come out at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// Noise of single pixels under the noisiest held-out sky, rms over mean, a fraction.
    Noise(f64),
    /// Time from start to end on the threads at hand.
    Time(Duration),
}

/// Classes of strata that aim rays at each patch, paths per seen surface, and patches that share a ray.
type Level = [u32; 3];

const LEVELS: [Level; 9] =
    [[1, 1, 32], [1, 2, 16], [1, 2, 8], [2, 4, 8], [2, 8, 8], [4, 16, 8], [4, 16, 4], [4, 16, 2], [4, 16, 1]];
/// What the estimate of a bake's time leaves for what it does not know.
const MARGIN: f64 = 0.9;

/// The sampling that was chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Effort {
    /// The sampling.
    pub transport: TransportOptions,
    /// Does it keep to the goal?
    pub met: bool,
    /// Noise under the noisiest sky, and that sky.
    pub noise: Option<(f64, String)>,
    /// Time that the bake should take.
    pub takes: Duration,
}

/// Chooses the sampling of a bake.
///
/// # Errors
/// [`BakeError`], as the bake itself would fail.
pub fn choose(scene: &Scene, camera: &Camera, options: &BakeOptions, goal: Goal) -> Result<Effort, BakeError> {
    let scenes = Scenes::new(scene);
    let mut trial = Trial::new(&scenes, camera, options)?;
    let mut chosen: Option<Effort> = None;
    for level in LEVELS {
        let effort = trial.at(level, goal);
        let enough = match goal {
            Goal::Noise(_) => effort.met,
            // The first that takes too long ends the search; the one before it stands.
            Goal::Time(_) if !effort.met => return Ok(chosen.unwrap_or(effort)),
            Goal::Time(_) => false,
        };
        chosen = Some(effort);
        if enough {
            break;
        }
    }
    Ok(chosen.unwrap_or_else(|| trial.at(LEVELS[0], goal)))
}

/// The parts of a bake, on some tiles of which sampling is tried.
struct Trial<'s> {
    /// The virtual geometry first.
    parts: Vec<TriedPart<'s>>,
    own: TransportOptions,
}

impl<'s> Trial<'s> {
    fn new(scenes: &'s Scenes<'s>, camera: &Camera, options: &BakeOptions) -> Result<Self, BakeError> {
        let options = BakeOptions { stack: None, ..options.clone() };
        let parts = scenes.parts().into_iter().map(|part| TriedPart::new(part, camera, &options));
        Ok(Trial { parts: parts.collect::<Result<_, _>>()?, own: options.transport })
    }

    fn at(&mut self, [direct_classes, paths, patch_group]: Level, goal: Goal) -> Effort {
        let transport = TransportOptions { direct_classes, paths, patch_group, ..self.own };
        let tried: Vec<(Noise, Duration)> = self.parts.iter_mut().map(|part| part.at(transport)).collect();
        let takes = tried.iter().map(|(_, takes)| takes).sum();
        let worst = tried.first().and_then(|(noise, _)| noise.worst_sky());
        let noise = worst.map(|worst| (worst.noise, worst.sky.clone()));
        let met = match goal {
            Goal::Noise(most) => noise.as_ref().is_none_or(|(noise, _)| *noise <= most),
            Goal::Time(most) => takes <= most.mul_f64(MARGIN),
        };
        Effort { transport, met, noise, takes }
    }
}

/// One part, and some of its tiles.
struct TriedPart<'s> {
    job: Job<'s>,
    tiles: Vec<(u32, u32)>,
    /// Covered tiles over those tried.
    times: f64,
    /// Of what does not depend on the level, for the whole picture.
    fixed: Duration,
}

impl<'s> TriedPart<'s> {
    fn new(part: Part<'s>, camera: &Camera, options: &BakeOptions) -> Result<Self, BakeError> {
        let started = Instant::now();
        let job = Job::new(part, camera, options)?;
        let prepared = started.elapsed();
        let covered = covered_tiles(&job.transport);
        let tiles = some_of(&covered);
        let times = covered.len() as f64 / tiles.len().max(1) as f64;
        let responses: Vec<_> = tiles.par_iter().map(|&(tx, ty)| job.transport.tile(tx, ty)).collect();
        let started = Instant::now();
        let finish = |(at, response)| Ok(job.compressed(0, vec![job.gathered(at, response)?]));
        let done: Result<Vec<_>, BakeError> = tiles.par_iter().copied().zip(responses).map(finish).collect();
        done?;
        let fixed = prepared + started.elapsed().mul_f64(times);
        Ok(TriedPart { job, tiles, times, fixed })
    }

    /// Noise and the whole part's time with this sampling.
    fn at(&mut self, transport: TransportOptions) -> (Noise, Duration) {
        self.job.transport.options = transport;
        let started = Instant::now();
        let noise = Noise::of(&mut self.job.transport, &self.tiles, &self.job.test_light);
        let takes = self.fixed + (started.elapsed() / 2).mul_f64(self.times);
        (noise, takes)
    }
}

impl fmt::Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TransportOptions { direct_classes, paths, patch_group, .. } = self.transport;
        write!(
            f,
            "sampling: {} rays to a patch, {paths} paths per ray from the eye, one of {patch_group} patches at each turn; ",
            4 * direct_classes
        )?;
        if let Some((noise, sky)) = &self.noise {
            write!(f, "{:.2} % noise in a pixel under the sky '{sky}', the noisiest; ", 100.0 * noise)?;
        }
        write!(f, "{:.0} s", self.takes.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::tests::{SIZE, corner, into_the_corner, options};
    use crate::scene::Role;

    #[test]
    fn receivers_are_tried_too() {
        let mut scene = corner(0.5);
        let options = BakeOptions { size: SIZE, directions: 16, transport: options(3), ..BakeOptions::default() };
        let parts = |scene: &Scene| {
            let scenes = Scenes::new(scene);
            let mut trial = Trial::new(&scenes, &into_the_corner(), &options).unwrap();
            let takes = trial.at(LEVELS[0], Goal::Noise(1.0)).takes;
            let tiles: Vec<usize> = trial.parts.iter().map(|part| part.tiles.len()).collect();
            (tiles, takes >= trial.parts.iter().map(|part| part.fixed).sum())
        };
        assert_eq!(parts(&scene), (vec![1], true));
        scene.roles = vec![Role::Virtual; scene.triangles.len()];
        scene.roles[..2].fill(Role::Receiver);
        let (tiles, all_count) = parts(&scene);
        assert!(tiles.len() == 3 && tiles.iter().all(|&tiles| tiles > 0) && all_count, "{tiles:?}");
    }
}
