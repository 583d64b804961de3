//! `relume run`: the post.

use super::args::{Command, place, required};
use crate::clock::PostClock;
use crate::config::{Config, DisplayConfig, SkyKind};
use crate::display::Display;
use crate::display::headless::Headless;
use crate::failure::{Failure, OrFail};
use crate::painter::field::FieldPainter;
use crate::post::{Parts, Post, PostReport};
use crate::relight::FieldFile;
use crate::sky_source::SkySource;
use crate::sky_source::captured::CapturedSky;
use crate::sky_source::simulated::SimulatedSky;
use crate::view::Still;
use relume_firmware::field::Field;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

pub(super) const COMMAND: Command = Command {
    name: "run",
    help: "\
relume run POST.toml [--setup] [--json]

Captures, relights, composites and shows until told to stop (Ctrl-C, SIGTERM) or until a limit of [run] is reached.
`relume check POST.toml` tells beforehand what is wrong. The state stands in health.json.

  --setup   for whoever installs the post: a compass of view, north and sun, and the state even when it is well
  --json    what the post did, as one JSON object on standard output when it ends
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let Arguments { file, json, setup } = arguments(&mut parser)?;
    let config = Config::load(&file).or_bad()?;
    let stop = stop_on_signal()?;
    let report = run(&config, setup, &stop)?;
    eprintln!("{} frames, {} drawn anew; ended: {}", report.frames, report.frames_changed, report.ended);
    if json { super::say_json(&report) } else { Ok(()) }
}

struct Arguments {
    file: PathBuf,
    json: bool,
    setup: bool,
}

fn arguments(parser: &mut lexopt::Parser) -> Result<Arguments, Failure> {
    use lexopt::prelude::{Long, Value};
    let (mut file, mut json, mut setup) = (None, false, false);
    while let Some(arg) = parser.next()? {
        match arg {
            Long("json") => json = true,
            Long("setup") => setup = true,
            Value(value) => place(value, &mut [&mut file])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(Arguments { file: required(file, "POST.toml")?, json, setup })
}

/// A flag that Ctrl-C and SIGTERM set; the loop ends cleanly at the next frame.
fn stop_on_signal() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        // A second signal ends the program at once, should the loop hang.
        signal_hook::flag::register_conditional_shutdown(signal, 1, stop.clone()).or_runtime()?;
        signal_hook::flag::register(signal, stop.clone()).or_runtime()?;
    }
    Ok(stop)
}

fn run(config: &Config, setup: bool, stop: &AtomicBool) -> Result<PostReport, Failure> {
    let file = FieldFile::open(&config.field).or_bad()?;
    let field = file.field();
    let (width, height) = (field.width(), field.height());
    let still = match &config.view {
        Some(path) => Still::load_sized(path, width, height).or_bad()?,
        None => Still::black(width, height),
    };
    let made = std::fs::metadata(&config.field).and_then(|meta| meta.modified()).ok();
    let mut painter = FieldPainter::new(field, still, 0);
    painter.set_budget(config.budget).or_bad()?;
    let parts = Parts {
        sky: sky_source(config, &field)?,
        display: display(config, (width, height))?,
        painter: Box::new(painter),
        clock: PostClock::start(config.clock, made),
    };
    let mut post = Post::new(config, parts);
    if setup {
        post.set_up(field.camera());
    }
    post.run(stop)
}

/// The display that the post's file asks for.
fn display(config: &Config, picture: (usize, usize)) -> Result<Box<dyn Display>, Failure> {
    match &config.display {
        DisplayConfig::Headless { folder, every } => Ok(Box::new(Headless::open(folder, *every, picture)?)),
        #[cfg(feature = "board")]
        DisplayConfig::Kms(screen) => Ok(Box::new(crate::display::kms::Kms::open(screen, picture)?)),
        #[cfg(not(feature = "board"))]
        DisplayConfig::Kms(_) => Err(no_drivers(config, "display.kind = \"kms\"")),
    }
}

/// What only a build for devices can do.
#[cfg(not(feature = "board"))]
pub(super) fn no_drivers(config: &Config, what: &str) -> Failure {
    let file = config.file.display();
    Failure::bad(format!("{file}: {what}: this build has no drivers; build with --features board"))
}

/// The source of light that the post's file asks for.
pub(super) fn sky_source(config: &Config, field: &Field<'_>) -> Result<Box<dyn SkySource>, Failure> {
    let (patches, north_deg) = (*field.patch_set(), f64::from(field.camera().north_deg));
    match (config.sky, config.site) {
        (SkyKind::Simulated, Some(site)) => Ok(Box::new(SimulatedSky::new(site, config.weather, patches, north_deg))),
        _ => Ok(Box::new(CapturedSky::open(config, patches, north_deg).or_bad()?)),
    }
}
