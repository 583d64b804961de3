//! `relume demo`: the built-in scene, baked and run through a day.

use super::args::{Command, number};
use crate::failure::Failure;
use std::path::{Path, PathBuf};

pub(super) const COMMAND: Command = Command {
    name: "demo",
    help: "\
relume demo [--out DIR]
relume demo --day [--moments N] [--seed N] [--out DIR]
relume demo --standing [--hours H] [--seed N] [--truth DIR] [--out DIR]
relume demo --standing [--hours H] --export DIR
relume demo --standing --passages N [--seed N] [--out DIR]

Bakes the built-in scene, runs a day from dawn to dusk under a simulated sky camera, and writes pictures, plots and a
summary into DIR (relume-demo if left out). Takes about two minutes on two cores.

  --day        a small bake, then the sky camera's light against the true light from the sun 8 degrees below the horizon
               to 8 degrees below, under passing clouds: day.json and day.png
  --moments N  with --day: moments from dawn to dusk (400 if left out)
  --standing   the site without its temple as a simulated view camera takes it, and the temple put in by the post, against a
               path trace of the site with it: three days, in colour differences: standing.json, standing.png, flicker.html
  --hours H    with --standing: hours from picture to picture (1 if left out)
  --export DIR with --standing: write the site and its skies there for another renderer, and nothing else
  --truth DIR  with --standing: run the moments that it drew there, against its pictures, too
  --passages N with --standing: instead, a cloud passes before the sun, N times, a frame every 3 s: what the exposure of a
               view camera that keeps its own does, and the temple's mean light: passing.json and passing.png
  --seed N     with --day: which clouds; with --standing: which noise, with --passages clouds, too (1 if left out)
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    use lexopt::prelude::Long;
    let (mut out, mut day, mut moments, mut seed) = (PathBuf::from("relume-demo"), false, None, None);
    let (mut standing, mut hours, mut passages) = (false, None, None);
    let (mut export, mut truth) = (None::<PathBuf>, None::<PathBuf>);
    while let Some(arg) = parser.next()? {
        match arg {
            Long("out") => out = parser.value()?.into(),
            Long("day") => day = true,
            Long("standing") => standing = true,
            Long("hours") => hours = Some(number(&mut parser, "--hours", 0.1..=24.0)?),
            Long("passages") => passages = Some(number(&mut parser, "--passages", 1.0..=1000.0)?),
            Long("export") => export = Some(parser.value()?.into()),
            Long("truth") => truth = Some(parser.value()?.into()),
            Long("moments") => moments = Some(number(&mut parser, "--moments", 2.0..=100_000.0)?),
            Long("seed") => seed = Some(number(&mut parser, "--seed", 0.0..=1e9)?),
            other => return Err(other.unexpected().into()),
        }
    }
    match (day, standing) {
        (true, true) => Err(Failure::bad("demo: --day and --standing are two studies; give one")),
        (false, _) if moments.is_some() => Err(Failure::bad("demo: --moments belongs to --day; add it")),
        (_, false) if hours.is_some() => Err(Failure::bad("demo: --hours belongs to --standing; add it")),
        (_, false) if passages.is_some() => Err(Failure::bad("demo: --passages belongs to --standing; add it")),
        (_, _) if passages.is_some() && (hours.is_some() || export.is_some() || truth.is_some()) => {
            Err(Failure::bad("demo: --passages has moments of its own; leave --hours, --export and --truth out"))
        }
        (_, false) if export.is_some() => Err(Failure::bad("demo: --export belongs to --standing; add it")),
        (_, false) if truth.is_some() => Err(Failure::bad("demo: --truth belongs to --standing; add it")),
        (false, false) if seed.is_some() => Err(Failure::bad("demo: --seed belongs to --day or --standing; add one")),
        (true, false) => fast_day(&out, moments.unwrap_or(400.0) as usize, seed.unwrap_or(1.0) as u64),
        (false, true) => match (passages, export) {
            (Some(count), _) => clouds_passing(&out, count as usize, seed.unwrap_or(1.0) as u64),
            (_, Some(_)) if truth.is_some() => {
                Err(Failure::bad("demo: --export is what --truth needs first; give one"))
            }
            (_, Some(folder)) => site_for_others(&folder, hours.unwrap_or(1.0)),
            (_, None) => still_standing(&out, hours.unwrap_or(1.0), seed.unwrap_or(1.0) as u64, truth.as_deref()),
        },
        (false, false) => demo(&out),
    }
}

#[cfg(feature = "demo")]
fn demo(out: &Path) -> Result<(), Failure> {
    crate::demo::run(out)
}

#[cfg(feature = "demo")]
fn fast_day(out: &Path, moments: usize, seed: u64) -> Result<(), Failure> {
    super::say(&crate::demo::fast_day(out, moments, seed)?)
}

#[cfg(feature = "demo")]
fn still_standing(out: &Path, step_h: f64, seed: u64, truth: Option<&Path>) -> Result<(), Failure> {
    super::say(&crate::demo::standing(out, step_h, seed, truth)?)
}

#[cfg(feature = "demo")]
fn clouds_passing(out: &Path, count: usize, seed: u64) -> Result<(), Failure> {
    super::say(&crate::demo::passing(out, count, seed)?)
}

#[cfg(feature = "demo")]
fn site_for_others(out: &Path, step_h: f64) -> Result<(), Failure> {
    super::say(&crate::demo::export(out, step_h)?)
}

#[cfg(not(feature = "demo"))]
fn still_standing(out: &Path, _step_h: f64, _seed: u64, _truth: Option<&Path>) -> Result<(), Failure> {
    demo(out)
}

#[cfg(not(feature = "demo"))]
fn clouds_passing(out: &Path, _count: usize, _seed: u64) -> Result<(), Failure> {
    demo(out)
}

#[cfg(not(feature = "demo"))]
fn site_for_others(out: &Path, _step_h: f64) -> Result<(), Failure> {
    demo(out)
}

#[cfg(not(feature = "demo"))]
fn demo(_out: &Path) -> Result<(), Failure> {
    Err(Failure::bad("demo: this build leaves the baking tool out; build with --features demo"))
}

#[cfg(not(feature = "demo"))]
fn fast_day(out: &Path, _moments: usize, _seed: u64) -> Result<(), Failure> {
    demo(out)
}
