//! What all rivals share: a sum over blocks of covered pixels, toned and written while it is in the nearest cache.
//!
//! They get every help that costs their method nothing: threads over whole blocks with OpenBLAS single-threaded in each,
//! large pages, exposure folded into the weights. Their 8-bit codes come from the same tone kernel as Relume's, and they
//! need no compositing: they store the codes of covered pixels and leave the others alone.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;
use relume_firmware::kernel::Kernel;

use super::arena::Arena;
use super::columns::Blocks;
use super::method::{BenchSky, Method, Shown};
use super::sample::Sample;
use crate::weights::PatchWeights;

/// A way to sum the covered pixels.
pub trait Summation: Sync {
    /// Name for the report.
    fn name(&self) -> &'static str;
    /// How much it may use, if it takes such a thing.
    fn budget(&self) -> Option<String>;
    /// Pixels and blocks.
    fn blocks(&self) -> Blocks;
    /// Takes the weights of a frame times `scale`; part of the frame's time.
    fn project(&mut self, weights: &PatchWeights, scale: f32);
    /// The values of one block, one slice per channel.
    fn sum(&self, block: usize, out: [&mut [f32]; 3]);
    /// Bytes that a frame reads.
    fn bytes_read(&self, sun: bool) -> usize;
    /// Before each frame: on to other numbers, where the memory is larger than the caches.
    fn move_on(&mut self);
    /// From now on other numbers for every frame, out of `arena`.
    ///
    /// # Errors
    /// When the arena is too small.
    fn wander(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()>;
}

/// One thread's room for a block.
struct Scratch {
    linear: [Vec<f32>; 3],
    shown: Vec<u32>,
}

impl Scratch {
    fn new(block_px: usize) -> Self {
        // The tone kernel takes a multiple of 16.
        let padded = block_px.next_multiple_of(16);
        let linear = [0, 1, 2].map(|_| vec![0.0; padded]);
        Scratch { linear, shown: vec![0; padded] }
    }
}

/// A sum made into a method: the same tone, framebuffer and threads for all.
pub struct Rival<S> {
    sum: S,
    sample: Arc<Sample>,
    kernel: Kernel,
    scratch: Vec<Scratch>,
    pool: Arc<rayon::ThreadPool>,
    threads: usize,
    framebuffer: Vec<u32>,
}

impl<S: Summation> Rival<S> {
    /// A rival that sums `sample` of a picture of `picture_px` pixels.
    pub fn new(sum: S, sample: Arc<Sample>, picture_px: usize, pool: Arc<rayon::ThreadPool>) -> Self {
        let scratch = (0..pool.current_num_threads().max(1)).map(|_| Scratch::new(sum.blocks().block_px)).collect();
        Rival { sum, sample, kernel: Kernel::detect(), scratch, pool, threads: 1, framebuffer: vec![0; picture_px] }
    }

    fn draw(&mut self) {
        let blocks = self.sum.blocks();
        let share = blocks.count().div_ceil(self.threads).max(1);
        let (sum, kernel, places) = (&self.sum, self.kernel, self.sample.places.as_slice());
        // Places ascend, so each thread's pixels are a stretch of the framebuffer of their own.
        let (mut rest, mut from, mut jobs) = (self.framebuffer.as_mut_slice(), 0, Vec::with_capacity(self.threads));
        for (first, scratch) in (0..blocks.count()).step_by(share).zip(&mut self.scratch) {
            let range = first..(first + share).min(blocks.count());
            let next = places.get(blocks.range(range.end - 1).end).map_or(from + rest.len(), |&at| at as usize);
            let (own, others) = rest.split_at_mut(next - from);
            jobs.push(Job { range, pixels: own, from, scratch });
            (rest, from) = (others, next);
        }
        let work = |job: Job<'_>| draw_blocks(sum, kernel, places, job);
        match self.threads {
            1 => jobs.into_iter().for_each(work),
            _ => self.pool.install(|| jobs.into_par_iter().with_max_len(1).for_each(work)),
        }
    }
}

struct Job<'a> {
    range: Range<usize>,
    /// The stretch of the framebuffer that starts at pixel `from`.
    pixels: &'a mut [u32],
    from: usize,
    scratch: &'a mut Scratch,
}

fn draw_blocks(sum: &impl Summation, kernel: Kernel, places: &[u32], job: Job<'_>) {
    let Job { range, pixels, from, scratch } = job;
    for block in range {
        let places = &places[sum.blocks().range(block)];
        let (n, padded) = (places.len(), places.len().next_multiple_of(16));
        let [red, green, blue] = &mut scratch.linear;
        sum.sum(block, [&mut red[..n], &mut green[..n], &mut blue[..n]]);
        let [red, green, blue] = &scratch.linear;
        let shown = &mut scratch.shown[..padded];
        kernel.tone([&red[..padded], &green[..padded], &blue[..padded]], shown);
        let mut done = 0;
        for run in places.chunk_by(|a, b| a + 1 == *b) {
            let at = run[0] as usize - from;
            if let Some(row) = pixels.get_mut(at..at + run.len()) {
                row.copy_from_slice(&shown[done..done + run.len()]);
            }
            done += run.len();
        }
    }
}

impl<S: Summation> Method for Rival<S> {
    fn name(&self) -> &'static str {
        self.sum.name()
    }

    fn budget(&self) -> Option<String> {
        self.sum.budget()
    }

    fn sample(&self) -> Option<&Sample> {
        Some(&self.sample)
    }

    fn set_threads(&mut self, threads: usize) {
        self.threads = threads.clamp(1, self.scratch.len());
    }

    fn bytes_read(&self, sky: &BenchSky) -> usize {
        self.sum.bytes_read(sky.has_sun())
    }

    fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()> {
        self.sum.move_on();
        self.sum.project(&sky.weights, sky.exposure);
        self.draw();
        Ok(())
    }

    fn show(&mut self, sky: &BenchSky) -> anyhow::Result<Shown> {
        self.frame(sky)?;
        let codes = self.sample.places.iter().map(|&at| {
            let [_, r, g, b] = self.framebuffer[at as usize].to_be_bytes();
            [r, g, b]
        });
        let codes = codes.collect();
        self.sum.project(&sky.weights, 1.0);
        let mut radiance = Vec::with_capacity(self.sample.places.len());
        for block in 0..self.sum.blocks().count() {
            let n = self.sum.blocks().range(block).len();
            let [red, green, blue] = &mut self.scratch[0].linear;
            self.sum.sum(block, [&mut red[..n], &mut green[..n], &mut blue[..n]]);
            radiance.extend((0..n).map(|k| [red[k], green[k], blue[k]]));
        }
        Ok(Shown { radiance, codes, bound_codes: None })
    }

    fn go_beyond_caches(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()> {
        self.sum.wander(arena)
    }
}

/// The pool that all rivals work in.
///
/// # Errors
/// When the system gives no threads.
pub fn pool(threads: usize) -> anyhow::Result<Arc<rayon::ThreadPool>> {
    Ok(Arc::new(rayon::ThreadPoolBuilder::new().num_threads(threads).build()?))
}
