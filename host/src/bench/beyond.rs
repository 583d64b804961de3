//! The run beyond the caches: copies of the field in turn, and rivals whose frames wander through as much memory.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use anyhow::Context;
use relume_firmware::field::Field;

use super::arena::Arena;
use super::bandwidth::available_memory;
use super::budget::Budget;
use super::copies::FieldCopies;
use super::method::{BenchSky, Method, Turn};
use super::relume::{Relighters, Relume};
use super::report::Section;
use super::study::{self, Scale};

/// The bytes of all copies are so many times the last-level cache.
const TIMES_CACHE: usize = 4;
/// Frames timed per method and number of threads.
const FRAMES: usize = 12;
/// Tracing the sun for all copies may take so long, seconds of CPU time; if it takes longer, the suns are left out.
const MOST_TRACING_S: f64 = 40.0;

/// What the run stands on.
pub struct Ground<'a> {
    /// The field file.
    pub path: &'a Path,
    /// The field.
    pub field: Field<'a>,
    /// Size of the last-level cache, bytes.
    pub cache_bytes: usize,
    /// Covered pixels.
    pub covered: &'a [u32],
    /// What the figures are related to.
    pub scale: Scale,
}

/// A section without times.
pub fn section(field: &Field<'_>, copies: usize, rivals_bytes: usize, cache_bytes: usize) -> Section {
    Section {
        field_copies: copies,
        field_bytes: copies * FieldCopies::bytes_each(field),
        rivals_bytes,
        last_level_cache_bytes: cache_bytes,
        sun_included: false,
        timings: Vec::new(),
    }
}

/// Times `rivals` and the field at its best; `sun_trace_s` is what tracing the sun takes for one copy.
///
/// # Errors
/// When the cache's size is unknown or there is not enough memory.
pub fn run(
    ground: &Ground<'_>,
    rivals: Vec<Box<dyn Method + '_>>,
    skies: &[BenchSky],
    sun_trace_s: f64,
) -> anyhow::Result<Section> {
    anyhow::ensure!(ground.cache_bytes > 0, "the size of the last-level cache is not known; give it with --cache");
    let wanted = TIMES_CACHE * ground.cache_bytes;
    let count = wanted.div_ceil(FieldCopies::bytes_each(&ground.field).max(1));
    let largest = rivals.iter().flat_map(|rival| skies.iter().map(|sky| rival.bytes_read(sky))).max().unwrap_or(0);
    let arena_bytes = wanted + largest;
    let mib = |bytes: usize| bytes >> 20;
    if let Some(available) = available_memory() {
        let needed = wanted + arena_bytes;
        anyhow::ensure!(needed < available / 4 * 3, "needs {} MiB of {} MiB", mib(needed), mib(available));
    }
    let copies = FieldCopies::map(ground.path, &ground.field, count)?;
    let mut arena = Arena::zeros(arena_bytes)?;
    arena.fill_made_up();
    let arena = Arc::new(arena);
    let mut methods = rivals;
    methods.iter_mut().try_for_each(|rival| rival.go_beyond_caches(&arena))?;

    let relighters = Relighters::new(copies.fields()?).context("no copy of the field")?;
    let shared = Rc::new(RefCell::new(relighters));
    methods.push(Box::new(Relume::new(shared, ground.covered.into(), Budget::AllRanks)));
    let mut skies = skies.to_vec();
    let tracings = (count * study::THREADS.len()) as f64;
    if sun_trace_s * tracings > MOST_TRACING_S {
        skies.iter_mut().for_each(|sky| sky.weights.sun = None);
        super::remark("beyond the caches the suns are left out: tracing them for every copy would take too long");
    }
    let mut section = section(&ground.field, count, arena_bytes, ground.cache_bytes);
    study::fill(&mut section, &mut methods, &skies, (FRAMES.max(skies.len()), Turn::Cold), ground.scale)?;
    Ok(section)
}
