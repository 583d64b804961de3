//! The jobs of a bake, one per part of the field, counted through: blocks of the virtual geometry first, then those of the
//! receivers with it, then those of the receivers without it.

use crate::assembly::Assembly;
use crate::bake::{BakeError, BakeOptions, Baked};
use crate::camera::Camera;
use crate::job::{DoneBlock, Job, block_count, in_order};
use crate::part::Part;
use crate::progress::Progress;
use crate::scene::Scene;
use std::ops::Range;
use std::time::Duration;

/// What light meets in the parts of a bake.
pub struct Scenes<'s> {
    whole: &'s Scene,
    /// What is really there, where receivers are marked.
    real: Option<Scene>,
}

impl<'s> Scenes<'s> {
    /// Of a scene whose roles are marked.
    pub fn new(whole: &'s Scene) -> Self {
        Scenes { whole, real: whole.has_receivers().then(|| whole.real()) }
    }

    /// The parts of its field.
    pub fn parts(&self) -> Vec<Part<'_>> {
        let mut parts = vec![Part::of_virtual(self.whole)];
        if let Some(real) = &self.real {
            parts.extend([Part::with_virtual(self.whole), Part::without_virtual(real, self.whole)]);
        }
        parts
    }
}

/// Number of all blocks of a bake of `scene` at `size`, px.
pub fn all_blocks(scene: &Scene, size: (u32, u32)) -> u32 {
    let parts = if scene.has_receivers() { 3 } else { 1 };
    parts * block_count(size)
}

/// The jobs of a bake.
pub struct Jobs<'s>(Vec<Job<'s>>);

impl<'s> Jobs<'s> {
    /// Prepares a bake.
    ///
    /// # Errors
    /// [`BakeError`].
    pub fn new(scenes: &'s Scenes<'s>, camera: &Camera, options: &BakeOptions) -> Result<Self, BakeError> {
        let jobs: Result<Vec<_>, _> = scenes.parts().into_iter().map(|part| Job::new(part, camera, options)).collect();
        Ok(Jobs(jobs?))
    }

    /// The job of the virtual geometry.
    pub fn main(&self) -> &Job<'s> {
        &self.0[0]
    }

    /// Number of all blocks.
    pub fn blocks(&self) -> u32 {
        self.0.len() as u32 * self.main().blocks()
    }

    /// Bakes the blocks `numbers` and hands each to `done`, in order and as soon as those before it are done.
    ///
    /// # Errors
    /// [`BakeError`] of a stack or of `done`.
    pub fn run(
        &self,
        numbers: Range<u32>,
        progress: bool,
        done: impl FnMut(DoneBlock) -> Result<(), BakeError> + Send,
    ) -> Result<(), BakeError> {
        let bar = progress.then(|| Progress::new("bake", u64::from(numbers.end.saturating_sub(numbers.start))));
        let each = self.main().blocks();
        let make = |number: u32| Ok(DoneBlock { number, ..self.0[(number / each) as usize].block(number % each)? });
        in_order(numbers, bar.as_ref(), make, done)
    }
}

/// Blocks of all jobs, in order -> a whole field.
pub struct Intake {
    parts: Vec<Assembly>,
    each: u32,
}

impl Intake {
    /// Of the blocks of these jobs.
    pub fn new(jobs: &Jobs<'_>) -> Self {
        Intake { parts: jobs.0.iter().map(Assembly::new).collect(), each: jobs.main().blocks() }
    }

    /// Number of the block that comes next.
    pub fn next(&self) -> u32 {
        self.parts.iter().map(Assembly::next).sum()
    }

    /// Takes the next block; one that is there already is left out.
    pub fn push(&mut self, done: DoneBlock) {
        let (part, number) = ((done.number / self.each) as usize, done.number % self.each);
        if done.number == self.next() {
            self.parts[part].push(DoneBlock { number, ..done });
        }
    }

    /// The field, once all blocks are there.
    ///
    /// # Errors
    /// [`BakeError`]: nothing of the scene is lit, or a stack cannot be written.
    pub fn finish(
        self,
        jobs: Jobs<'_>,
        camera: &Camera,
        options: &BakeOptions,
        took: Duration,
    ) -> Result<Baked, BakeError> {
        let mut parts = self.parts.into_iter().zip(jobs.0);
        let Some((mut assembly, job)) = parts.next() else { return Err(BakeError::NothingVirtual) };
        let baked: Result<Vec<_>, _> =
            parts.map(|(assembly, job)| assembly.finish(job, camera, options, took)).collect();
        if let [with, without] = &baked?[..] {
            assembly.set_receivers(with, without)?;
        }
        assembly.finish(job, camera, options, took)
    }
}
