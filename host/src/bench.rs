//! `relume bench`: time per frame against error on this machine, beside a dense f32 sum by OpenBLAS in the same run.
//!
//! All methods turn the same weights into 8-bit sRGB codes of the same covered pixels, one thread, taking turns frame by
//! frame under changing skies; the medians of their CPU times are compared. Nothing is kept from the frame before, except
//! the sun's visibility while the sun stands still. Reading files is not counted.

mod bandwidth;
mod clock;
mod dense;
mod error;
mod facts;
mod figure;
mod matrix;
mod method;
mod openblas;
mod relume;
mod report;
mod skies;
mod sums;

pub use error::{Errors, Summary, compare, exposure_for, srgb_code, summarise};
pub use figure::figure;
pub use openblas::LIBRARY_VARIABLE;
pub use report::{BenchReport, DENSE_NAME, MethodReport, RELUME_NAME};

use std::path::PathBuf;

use crate::exact::Stack;
use anyhow::Context;
use dense::Dense;
use method::{BenchSky, Method};
use openblas::Blas;
use relume_firmware::field::Field;
use relume_firmware::tile::MAX_RANK;

use crate::relight::FieldFile;

/// What to compare.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The field.
    pub field: PathBuf,
    /// The stack it was baked with; without it only times are measured.
    pub stack: Option<PathBuf>,
    /// Radiance maps to light it with; two simulated skies are always added.
    pub skies: Vec<PathBuf>,
}

/// Frames timed per method.
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
    let stack_sun = stack.as_ref().and_then(Stack::sun_dir_world);
    let mut skies = skies::load_skies(&options.skies, &field, stack_sun)?;
    if stack.is_some() {
        skies::leave_out_foreign_suns(&mut skies, stack_sun).iter().for_each(|note| remark(note));
    } else {
        skies::gather_suns(&mut skies);
    }
    let mut dense = dense_sum(&field, &covered, stack.is_none() || stack_sun.is_some());
    match &stack {
        Some(stack) => sum_stack(stack, &covered, &mut skies, dense.as_mut())?,
        None => expose_by_field(&field, &covered, &mut skies)?,
    }
    let sunny = skies.iter().find(|sky| sky.weights.sun.is_some());
    if let Some(sky) = sunny {
        let took_ms = 1e3 * relume::sun_trace_s(field, sky)?;
        remark(&format!("tracing the sun takes {took_ms:.1} ms whenever it has moved; not part of the frames below"));
    }
    let mut methods: Vec<Box<dyn Method + '_>> = Vec::new();
    methods.extend(dense.map(|dense| Box::new(dense) as Box<dyn Method>));
    for ranks in relume::RANK_BUDGETS.into_iter().map(Some).chain([None]) {
        methods.push(Box::new(relume::Relume::new(field, covered.clone(), ranks)));
    }
    let methods = study(&mut methods, &skies)?;
    Ok(finish(&field, covered.len(), sunny.is_some(), &skies, methods))
}

fn remark(line: &str) {
    eprintln!("bench: {line}");
}

/// The rival, or a remark why it is left out.
fn dense_sum(field: &Field<'_>, covered: &[u32], has_sun: bool) -> Option<Dense> {
    let patches = field.patch_set().len();
    let needed = Dense::bytes(covered.len(), patches, has_sun);
    let made = Blas::load().map_err(anyhow::Error::from).and_then(|blas| {
        if let Some(available) = bandwidth::available_memory() {
            let mib = |bytes: usize| bytes >> 20;
            anyhow::ensure!(needed < available / 4 * 3, "needs {} MiB of {} MiB", mib(needed), mib(available));
        }
        Dense::new(blas, covered.to_vec(), field.width() * field.height(), patches, has_sun)
    });
    match made {
        Ok(dense) => {
            let forced = std::env::var("OPENBLAS_CORETYPE").map(|core| format!(", OPENBLAS_CORETYPE={core} is set"));
            remark(&format!("{}{}", dense.describe(), forced.unwrap_or_default()));
            Some(dense)
        }
        Err(error) => {
            remark(&format!("{DENSE_NAME} is left out: {error:#}"));
            None
        }
    }
}

/// One pass over the stack: the exact picture of every sky, their exposures, and the dense sum's columns.
fn sum_stack(
    stack: &Stack,
    covered: &[u32],
    skies: &mut Vec<BenchSky>,
    mut dense: Option<&mut Dense>,
) -> anyhow::Result<()> {
    let mut sums = sums::Sums::new(skies.len(), covered.len());
    for patch in 0..stack.len() {
        let image = stack.pixels(patch, covered)?;
        sums.add(skies, patch, &image);
        if let Some(dense) = dense.as_deref_mut() {
            dense.set_column(patch, &image);
        }
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
fn expose_by_field(field: &Field<'_>, covered: &[u32], skies: &mut [BenchSky]) -> anyhow::Result<()> {
    let mut relume = relume::Relume::new(*field, covered.to_vec(), None);
    for sky in skies {
        let shown: Vec<[f64; 3]> = relume.radiance(sky)?.iter().map(|rgb| rgb.map(f64::from)).collect();
        sky.exposure = exposure_for(&shown).unwrap_or(1.0) as f32;
    }
    Ok(())
}

/// Errors, then times, of all methods.
fn study(methods: &mut [Box<dyn Method + '_>], skies: &[BenchSky]) -> anyhow::Result<Vec<MethodReport>> {
    let mut reports = Vec::with_capacity(methods.len());
    for method in methods.iter_mut() {
        let name = method.name();
        let errors = method::errors(method.as_mut(), skies).with_context(|| name)?;
        let summary = summarise(&errors);
        if name == RELUME_NAME {
            remark_errors(&method.budget().unwrap_or_default(), skies, &errors);
        }
        reports.push(MethodReport {
            name: name.to_owned(),
            budget: method.budget(),
            cpu_ms_per_frame: 0.0,
            rmse_median: summary.map(|s| s.rmse_median),
            rmse_worst: summary.map(|s| s.rmse_worst),
            worst_code: summary.map(|s| s.worst_code),
            share_off_by_more_than_one: summary.map(|s| s.share_off_by_more_than_one),
            times_faster_than_dense_f32_openblas: None,
        });
    }
    for (report, seconds) in reports.iter_mut().zip(method::time(methods, skies, FRAMES)?) {
        report.cpu_ms_per_frame = 1e3 * seconds;
    }
    Ok(reports)
}

/// The log tells each sky's figures; the report only the median and the worst.
fn remark_errors(budget: &str, skies: &[BenchSky], errors: &[Errors]) {
    for (sky, e) in skies.iter().filter(|sky| sky.exact.is_some()).zip(errors) {
        let sun = if sky.weights.sun.is_some() { "with sun" } else { "no sun" };
        let [r, g, b] = e.bias.map(|bias| 100.0 * bias);
        remark(&format!(
            "{budget}, {} ({sun}): RMSE {:.3} %, bias {r:+.3} {g:+.3} {b:+.3} %, worst code {}, {:.3} % off by more than one",
            sky.name,
            100.0 * e.rmse,
            e.worst_code,
            100.0 * e.share_off_by_more_than_one
        ));
    }
}

fn finish(field: &Field<'_>, covered: usize, sun: bool, skies: &[BenchSky], methods: Vec<MethodReport>) -> BenchReport {
    let bandwidth = bandwidth::read_bandwidth();
    remark(&format!(
        "one thread reads {:.1} GB/s from a buffer of {} MiB",
        1e-9 * bandwidth.bytes_per_s,
        bandwidth.buffer_bytes >> 20
    ));
    let read = facts::bytes_read(field, MAX_RANK, sun) as f64;
    let whole = methods.iter().rev().find(|m| m.name == RELUME_NAME);
    let seconds = whole.map_or(f64::INFINITY, |m| 1e-3 * m.cpu_ms_per_frame);
    let mut report = BenchReport {
        skies: skies.iter().map(|sky| sky.name.clone()).collect(),
        bytes_per_covered_pixel: read / covered as f64,
        bytes_stored_per_covered_pixel: field.file_bytes() as f64 / covered as f64,
        share_of_read_bandwidth: read / seconds / bandwidth.bytes_per_s,
        methods,
    };
    report.compare_with_dense();
    report
}
