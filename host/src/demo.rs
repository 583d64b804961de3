//! `relume demo`: bakes a site built in code, runs a day over it under the synthetic sky camera, and measures itself.
//!
//! Per moment: exposure series -> radiance -> weights -> relight -> composite over the view -> framebuffer. Measured are
//! - the error of relighting by the sky against the exact f64 sum over the uncompressed stack, for every picture (both
//!   without the sun, of which a stack holds one direction only);
//! - the error of everything against an independent path trace of the scene under the unsplit sky, at three moments:
//!   with the weights of the true sky, and with those that the camera measured;
//! - the work that was skipped.

mod backdrop;
mod compare;
mod day;
mod eye;
mod fast;
mod figures;
mod report;
mod site;
mod standing;
mod trace;

pub use fast::fast_day;
pub use standing::{export, passing, standing};

use std::path::Path;
use std::time::Instant;

use crate::failure::{Failure, OrFail};

/// Runs the demonstration and writes its results into the folder `out`, which is made if need be.
///
/// # Errors
/// [`Failure`]: bad input when `out` cannot be used, a failure at run time for all else.
pub fn run(out: &Path) -> Result<(), Failure> {
    let started = Instant::now();
    let bad_folder =
        |error| Failure::bad(format!("--out {}: {error}; name a folder that can be written", out.display()));
    std::fs::create_dir_all(out).map_err(bad_folder)?;
    let scratch = tempfile::Builder::new().prefix(".relume-demo-").tempdir_in(out).map_err(bad_folder)?;
    let site = site::Site::bake(scratch.path())?;
    eprintln!("{}", site.told());
    let stack = site.open_stack()?;
    let mut day = day::Day::new(&site, &stack)?;
    let hours = day.half_hours()?;
    let drift = day.drift(&hours)?;
    eprintln!("day: {} pictures, then {} in a row under drifting clouds", hours.len(), drift.len());
    let traces = trace::three(&site, &mut day, &hours)?;
    figures::write(out, &hours, &drift, &traces)?;
    let report = report::Report::new(&site, &hours, &drift, &traces, started.elapsed());
    report.save(&out.join("report.json"))?;
    scratch.close().or_runtime()?;
    report.say(out)
}
