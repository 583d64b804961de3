//! `relume bench`: time per frame against error on this machine, beside other ways to the same picture in the same run.
//!
//! All methods turn the same weights into 8-bit sRGB codes of the same covered pixels, taking turns frame by frame under
//! changing skies; the medians of their CPU times are compared, on one thread and on two. Nothing is kept from the frame
//! before, except the sun's visibility while the sun stands still. Reading files is not counted. The rivals:
//!
//! - the dense f32 sum of the paper by OpenBLAS, and the same in int8 rows;
//! - global principal components, 16, 32 and 64 per channel, by OpenBLAS;
//! - 8 to 64 lights chosen live from the sky by median cut, the sum of their images by OpenBLAS.
//!
//! Two conditions: the same field frame after frame, and copies of it in turn that hold four times the last-level cache,
//! while the rivals' frames wander through as much memory.
//!
//! Beside that: the certified bounds against the true errors, arbitrary lights under an error budget, and what skipping
//! saves when the sky changes a little, clouds over or stands still.

mod arbitrary;
mod arena;
mod bandwidth;
mod beyond;
mod bounds;
mod budget;
mod cache;
mod clock;
mod columns;
mod copies;
mod dense;
mod error;
mod facts;
mod figure;
mod int8;
mod intime;
mod lights;
mod method;
mod openblas;
mod oracle;
mod pca;
pub mod postloop;
mod relume;
mod report;
mod rival;
mod rivals;
mod sample;
mod skies;
mod skipping;
mod skycamera;
mod stage;
mod study;
mod sums;
mod tilemap;

pub use arbitrary::{LightsReport, OneLight, SinglePatches};
pub use bandwidth::{Bandwidth, read_bandwidth};
pub use bounds::{BoundsReport, SkyBounds};
pub use budget::Budget;
pub use clock::{cpu_s, median};
pub use error::{Errors, Summary, compare, exposure_for, srgb_code, summarise, unrounded_code};
pub use figure::figure;
pub use openblas::LIBRARY_VARIABLE;
pub use report::{BenchReport, DENSE_NAME, MethodReport, RELUME_NAME, Section, SkyErrors, Timing};
pub use skies::SkyMap;
pub use skipping::{Counts, NearestPatches, Ramp, SkippingReport, Still};

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;

use crate::exact::Stack;
use crate::relight::FieldFile;
use crate::weights::PatchWeights;
use anyhow::Context;
use method::{BenchSky, Method};
use relume_firmware::field::Field;
use relume_firmware::tile::MAX_RANK;
use rivals::Rivals;

/// What to compare.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The field.
    pub field: PathBuf,
    /// The stack it was baked with; without it only times are measured.
    pub stack: Option<PathBuf>,
    /// Radiance maps to light it with; nine simulated skies are always added.
    pub skies: Vec<SkyMap>,
    /// Error budgets, 8-bit codes; none: [`Budget::ERRORS`].
    pub error_codes: Vec<f32>,
    /// Time budgets for a sky that clouds over, milliseconds a frame; none: shares of what a full frame takes.
    pub times_ms: Vec<f64>,
    /// Leave out the run beyond the caches.
    pub in_cache_only: bool,
    /// Size of the last-level cache, bytes, where the system's answer is not to be taken.
    pub last_level_cache_bytes: Option<usize>,
}

/// Least frames timed per method and number of threads.
const FRAMES: usize = 40;

/// Measures. What deserves a remark on the way goes to stderr.
///
/// # Errors
/// If the field, the stack or a map cannot be used, or stack and field do not belong together.
pub fn run(options: &Options) -> anyhow::Result<BenchReport> {
    let file = FieldFile::open(&options.field)?;
    let field = file.field();
    let covered = facts::covered(&field);
    anyhow::ensure!(!covered.is_empty(), "{}: no pixel is covered; bake another view", options.field.display());
    let stack = options.stack.as_deref().map(Stack::open).transpose()?;
    stack.as_ref().map_or(Ok(()), |stack| stack.check_field(&field))?;
    let mut skies = skies_of(options, &field, stack.as_ref())?;
    let has_sun = stack.as_ref().is_none_or(|stack| stack.sun_dir_world().is_some());
    let (mut rivals, note) = Rivals::new(&covered, field.width() * field.height(), field.patch_set().len(), has_sun)?;
    remark(&note);
    let own = Rc::new(RefCell::new(relume::Relighters::new(vec![field]).context("no field")?));
    let own_at = |budget| relume::Relume::new(Rc::clone(&own), covered.as_slice().into(), budget);
    match &stack {
        Some(stack) => sum_stack(stack, &covered, &mut skies, &mut rivals)?,
        None => expose_by_field(own_at(Budget::AllRanks), &mut skies)?,
    }
    let pool = rival::pool(study::THREADS.into_iter().max().unwrap_or(1))?;
    let (rivals, notes) = rivals.into_methods(field.patch_set(), &pool, stack.is_some());
    notes.iter().for_each(|note| remark(note));
    let own = own_methods(field, own_at, &covered, &options.error_codes)?;
    let cache_bytes = options.last_level_cache_bytes.or_else(cache::last_level_bytes).unwrap_or(0);
    let scale = study::Scale { covered_px: covered.len(), bandwidth: bandwidth::read_bandwidth(cache_bytes)? };
    let ground = beyond::Ground { path: &options.field, field, cache_bytes, covered: &covered, scale };
    let mut report = both_conditions(&ground, rivals, own, &skies, options.in_cache_only)?;
    further_sections(&mut report, field, stack.as_ref(), (&covered, &skies), &options.times_ms)?;
    Ok(report)
}

/// Relume under all its budgets; `own_at` makes one that shares its relighter with others.
fn own_methods<'f>(
    field: Field<'f>,
    own_at: impl Fn(Budget) -> relume::Relume<'f>,
    covered: &[u32],
    error_codes: &[f32],
) -> anyhow::Result<Vec<Box<dyn Method + 'f>>> {
    let errors = match (field.bounds(), error_codes) {
        (None, _) => {
            remark("error budgets are left out: the field has no bounds");
            Vec::new()
        }
        (_, []) => Budget::ERRORS.to_vec(),
        (_, codes) => codes.iter().map(|&codes| Budget::Codes(codes)).collect(),
    };
    let all = Budget::RANKS.into_iter().chain(errors);
    let one = |budget: Budget| -> anyhow::Result<Box<dyn Method + 'f>> {
        if !budget.learns() {
            return Ok(Box::new(own_at(budget)));
        }
        let alone = Rc::new(RefCell::new(relume::Relighters::new(vec![field]).context("no field")?));
        Ok(Box::new(relume::Relume::new(alone, covered.into(), budget)))
    };
    all.map(one).collect()
}

/// Bounds, arbitrary lights and skipping.
fn further_sections(
    report: &mut BenchReport,
    field: Field<'_>,
    stack: Option<&Stack>,
    (covered, skies): (&[u32], &[BenchSky]),
    times_ms: &[f64],
) -> anyhow::Result<()> {
    let of = |name: &str| skies.iter().find(|sky| sky.name == name);
    let (Some(clear), Some(overcast)) = (of(skies::CLEAR), of(skies::OVERCAST)) else {
        remark("the simulated skies light nothing; lights and skipping are left out");
        return Ok(());
    };
    if let Some(stack) = stack {
        report.bounds = bounds::run(field, covered, skies)?;
        report.lights = arbitrary::run(stack, field, covered, clear)?;
    }
    let without = |sky: &BenchSky| PatchWeights { sun: None, ..sky.weights.clone() };
    report.skipping.push(skipping::run(field, covered, (&without(clear), &without(overcast)), times_ms)?);
    if clear.has_sun() {
        report.skipping.push(skipping::run(field, covered, (&clear.weights, &overcast.weights), times_ms)?);
    }
    Ok(())
}

/// Errors, times in cache, then times beyond it.
fn both_conditions<'a>(
    ground: &beyond::Ground<'a>,
    rivals: Vec<Box<dyn Method>>,
    own: Vec<Box<dyn Method + 'a>>,
    skies: &[BenchSky],
    in_cache_only: bool,
) -> anyhow::Result<BenchReport> {
    let rival_count = rivals.len();
    let mut methods: Vec<Box<dyn Method + 'a>> = rivals.into_iter().map(|rival| rival as Box<dyn Method>).collect();
    methods.extend(own);
    let errors = measure_errors(&mut methods, skies)?;
    let mut in_cache = beyond::section(&ground.field, 1, 0, ground.cache_bytes);
    let turns = (FRAMES.next_multiple_of(skies.len()), method::Turn::FrameAfterFrame);
    study::fill(&mut in_cache, &mut methods, skies, turns, ground.scale)?;
    let sunny = skies.iter().find(|sky| sky.has_sun());
    let sun_trace_s = sunny.map(|sky| relume::sun_trace_s(ground.field, sky)).transpose()?;
    let mut report = assemble(&ground.field, skies, errors, in_cache, ground.scale);
    report.sun_trace_cpu_ms = sun_trace_s.map(|seconds| 1e3 * seconds);
    if !in_cache_only {
        methods.truncate(rival_count);
        match beyond::run(ground, methods, skies, sun_trace_s.unwrap_or(0.0)) {
            Ok(section) => report.beyond_cache = Some(section),
            Err(error) => remark(&format!("the run beyond the caches is left out: {error:#}")),
        }
    }
    Ok(report)
}

fn skies_of(options: &Options, field: &Field<'_>, stack: Option<&Stack>) -> anyhow::Result<Vec<BenchSky>> {
    let stack_sun = stack.and_then(Stack::sun_dir_world);
    let mut skies = skies::load_skies(&options.skies, field, stack_sun)?;
    match stack {
        Some(_) => skies::leave_out_foreign_suns(&mut skies, stack_sun).iter().for_each(|note| remark(note)),
        None => skies::gather_suns(&mut skies),
    }
    Ok(skies)
}

fn remark(line: &str) {
    eprintln!("bench: {line}");
}

/// One pass over the stack: the exact picture of every sky, their exposures, and the rivals' columns.
fn sum_stack(stack: &Stack, covered: &[u32], skies: &mut Vec<BenchSky>, rivals: &mut Rivals) -> anyhow::Result<()> {
    let mut sums = sums::Sums::new(skies.len(), covered.len());
    for patch in 0..stack.len() {
        let image = stack.pixels(patch, covered)?;
        sums.add(skies, patch, &image);
        rivals.set_column(patch, &image);
    }
    for (sky, exact) in skies.iter_mut().zip(sums.finish()) {
        match exposure_for(&exact) {
            Some(exposure) => (sky.exposure, sky.exact) = (exposure as f32, Some(exact)),
            None => remark(&format!("sky {}: lights nothing; left out", sky.name)),
        }
    }
    skies.retain(|sky| sky.exact.is_some());
    anyhow::ensure!(!skies.is_empty(), "no sky lights anything; give other maps");
    Ok(())
}

/// Without a stack the field's own picture sets the exposures.
fn expose_by_field(mut relume: relume::Relume<'_>, skies: &mut [BenchSky]) -> anyhow::Result<()> {
    for sky in skies {
        let shown: Vec<[f64; 3]> = relume.radiance(sky)?.iter().map(|rgb| rgb.map(f64::from)).collect();
        sky.exposure = exposure_for(&shown).unwrap_or(1.0) as f32;
    }
    Ok(())
}

/// The errors of all methods; their times are filled in later.
fn measure_errors(methods: &mut [Box<dyn Method + '_>], skies: &[BenchSky]) -> anyhow::Result<Vec<MethodReport>> {
    let mut reports = Vec::with_capacity(methods.len());
    for method in methods.iter_mut() {
        let name = method.name();
        let errors = method::errors(method.as_mut(), skies).with_context(|| name)?;
        let compared: Vec<&BenchSky> = skies.iter().filter(|sky| sky.exact.is_some()).collect();
        if name == RELUME_NAME && method.budget() == Some(Budget::AllRanks.to_string()) {
            remark_errors(&compared, &errors);
        }
        let summary = summarise(&errors);
        let worst = |sun: bool, of: fn(&Errors) -> Option<f64>| {
            let own = compared.iter().zip(&errors).filter(|(sky, _)| sky.has_sun() == sun);
            own.filter_map(|(_, e)| of(e)).reduce(f64::max)
        };
        reports.push(MethodReport {
            name: name.to_owned(),
            budget: method.budget(),
            cpu_ms_per_frame: 0.0,
            rmse_median: summary.map(|s| s.rmse_median),
            rmse_worst: summary.map(|s| s.rmse_worst),
            rmse_worst_without_sun: worst(false, |e| Some(e.rmse)),
            rmse_worst_with_sun: worst(true, |e| Some(e.rmse)),
            worst_code: summary.map(|s| s.worst_code),
            share_off_by_more_than_one: summary.map(|s| s.share_off_by_more_than_one),
            code_error_worst_without_sun: worst(false, |e| Some(e.code_error)),
            bound_codes_worst_without_sun: worst(false, |e| e.bound_codes),
            times_faster_than_dense_f32_openblas: None,
            errors_per_sky: compared.iter().zip(&errors).map(|(sky, e)| sky_errors(sky, e)).collect(),
        });
    }
    Ok(reports)
}

fn sky_errors(sky: &BenchSky, errors: &Errors) -> SkyErrors {
    SkyErrors {
        sky: sky.name.clone(),
        has_sun: sky.has_sun(),
        rmse: errors.rmse,
        worst_code: errors.worst_code,
        share_off_by_more_than_one: errors.share_off_by_more_than_one,
        code_error: errors.code_error,
        bound_codes: errors.bound_codes,
    }
}

/// The log tells each sky's figures of the field at its best.
fn remark_errors(skies: &[&BenchSky], errors: &[Errors]) {
    for (sky, e) in skies.iter().zip(errors) {
        let sun = if sky.has_sun() { "with sun" } else { "no sun" };
        let [r, g, b] = e.bias.map(|bias| 100.0 * bias);
        remark(&format!(
            "{} ({sun}): RMSE {:.3} %, bias {r:+.3} {g:+.3} {b:+.3} %, worst code {}, {:.3} % off by more than one",
            sky.name,
            100.0 * e.rmse,
            e.worst_code,
            100.0 * e.share_off_by_more_than_one
        ));
    }
}

fn assemble(
    field: &Field<'_>,
    skies: &[BenchSky],
    mut methods: Vec<MethodReport>,
    in_cache: Section,
    scale: study::Scale,
) -> BenchReport {
    for method in &mut methods {
        if let Some(timing) = in_cache.timing(&method.name, method.budget.as_deref(), 1) {
            method.cpu_ms_per_frame = timing.cpu_ms_per_frame;
            method.times_faster_than_dense_f32_openblas = timing.times_faster_than_dense_f32_openblas;
        }
    }
    let covered_px = scale.covered_px;
    let sunny = skies.iter().filter(|sky| sky.has_sun()).count();
    let timing = in_cache.timing(RELUME_NAME, Some(&Budget::AllRanks.to_string()), 1);
    BenchReport {
        skies: skies.iter().map(|sky| sky.name.clone()).collect(),
        skies_with_sun: sunny,
        width_px: field.width(),
        height_px: field.height(),
        covered_px,
        bytes_per_covered_pixel: facts::bytes_read(field, MAX_RANK, sunny > 0) as f64 / covered_px as f64,
        bytes_stored_per_covered_pixel: field.file_bytes() as f64 / covered_px as f64,
        share_of_read_bandwidth: timing.map_or(0.0, |timing| timing.share_of_read_bandwidth),
        read_bandwidth_one_thread_bytes_per_cpu_s: scale.bandwidth.one_thread_bytes_per_cpu_s,
        read_bandwidth_two_threads_bytes_per_cpu_s: scale.bandwidth.two_threads_bytes_per_cpu_s,
        read_bandwidth_buffer_bytes: scale.bandwidth.buffer_bytes,
        sun_trace_cpu_ms: None,
        methods,
        in_cache,
        beyond_cache: None,
        bounds: None,
        lights: None,
        skipping: Vec::new(),
    }
}
