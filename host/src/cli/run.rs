//! `relume run`: the post.

mod view;

use super::args::{Command, place, required};
use super::relight::relight_still;
use crate::clock::PostClock;
use crate::config::{ClockConfig, Config, DisplayConfig, SkyKind};
use crate::display::Display;
use crate::display::headless::Headless;
use crate::exposure::ExposureMode;
use crate::fading::Fading;
use crate::failure::{Failure, OrFail};
use crate::importance::importance;
use crate::lightlog::LightLog;
use crate::painter::field::FieldPainter;
use crate::post::{Parts, Post, PostReport, Signals};
use crate::relight::FieldFile;
use crate::sky_source::SkySource;
use crate::sky_source::background::Background;
use crate::sky_source::captured::CapturedSky;
#[cfg(feature = "board")]
use crate::sky_source::live::LiveSky;
use crate::sky_source::logged::LoggedSky;
use crate::sky_source::simulated::SimulatedSky;
use crate::view::Still;
use crate::view::curve::ViewCurve;
use crate::view::mask::Mask;
use crate::watchdog::Watchdog;
use relume_firmware::field::Field;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

pub(super) const COMMAND: Command = Command {
    name: "run",
    help: "\
relume run POST.toml [--setup] [--json]

Captures, relights, composites and shows until told to stop (Ctrl-C, SIGTERM) or until a limit of [run] is reached.
`relume check POST.toml` tells beforehand what is wrong. The state stands in health.json; SIGUSR1 writes the picture shown
to screenshot.png beside it, and a live view to view.png.

  --setup   for whoever installs the post: a compass of view, north and sun, and the state even when it is well
  --json    what the post did, as one JSON object on standard output when it ends
",
    act,
};

/// How often a sky without a real camera is asked.
const MODEL_PACE: Duration = Duration::from_secs(1);
/// How long the first picture waits for the first light.
const FIRST_LIGHT: Duration = Duration::from_secs(3);

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let Arguments { file, json, setup } = arguments(&mut parser)?;
    let config = Config::load(&file).or_bad()?;
    let signals = listen()?;
    let report = open(&config, setup, &signals)?;
    eprintln!("{} frames, {} drawn anew; ended: {}", report.frames, report.frames_changed, report.ended);
    eprintln!("{}", report.health.totals);
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

/// Ctrl-C and SIGTERM end the loop cleanly at the next frame; SIGUSR1 has a screenshot written.
pub(super) fn listen() -> Result<Signals, Failure> {
    let signals = Signals::default();
    let stop = &signals.stop;
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        // A second signal ends the program at once, should the loop hang.
        signal_hook::flag::register_conditional_shutdown(signal, 1, stop.clone()).or_runtime()?;
        signal_hook::flag::register(signal, stop.clone()).or_runtime()?;
    }
    signal_hook::flag::register(signal_hook::consts::SIGUSR1, signals.picture.clone()).or_runtime()?;
    Ok(signals)
}

/// Opens the post of a file and runs it to its end; `setup` shows the installer's labels.
///
/// # Errors
/// [`Failure`]: bad input where a file that it names cannot be used, else a failure at run time.
pub(crate) fn open(config: &Config, setup: bool, signals: &Signals) -> Result<PostReport, Failure> {
    // The program shows one field until it ends.
    let file: &'static FieldFile = Box::leak(Box::new(FieldFile::open(&config.field).or_bad()?));
    let field = file.field();
    let (width, height) = (field.width(), field.height());
    let made = std::fs::metadata(&config.field).and_then(|meta| meta.modified()).ok();
    let mut painter = painter(config, file)?;
    painter.set_budget(config.budget).or_bad()?;
    let view = view::live_view(config, (width, height), &signals.stop)?;
    if view.is_some() {
        painter.expect_live_view();
    }
    if matches!(config.clock, ClockConfig::System { .. }) {
        painter.trace_behind(crate::painter::field::SUN_STEP_DEG).or_runtime()?;
    }
    let clock = PostClock::start(config.clock, made);
    let parts = Parts {
        sky: sky_source(config, &field, &clock, &signals.stop)?,
        view,
        display: display(config, (width, height))?,
        painter: Box::new(painter),
        clock,
    };
    let mut post = Post::new(config, parts);
    if let Some(path) = &config.light_log {
        post.log_light(LightLog::create(path).or_bad()?);
    }
    if let Some(site) = config.site {
        post.fade_by(Fading::new(site, config.weather, *field.patch_set(), f64::from(field.camera().north_deg)));
    }
    if let Some(watchdog) = Watchdog::of_this_service() {
        post.feed(watchdog);
    }
    if setup {
        post.set_up(field.camera());
    }
    post.run(signals)
}

/// The field over what is behind it.
fn painter<'f>(config: &Config, file: &'f FieldFile) -> Result<FieldPainter<'f>, Failure> {
    let field = file.field();
    let (width, height) = (field.width(), field.height());
    let still = match config.view.as_ref().filter(|_| !config.additive) {
        Some(path) => {
            let curve = ViewCurve::load_named(config.view_response.as_deref()).or_bad()?;
            Still::load_sized(path, (width, height), curve.as_ref()).or_bad()?
        }
        None => Still::black(width, height),
    };
    has_what_measures(config, file)?;
    if config.additive {
        eprintln!("notice: an optical display only adds light: real ground takes no shadow, and nothing gets darker");
    }
    let mut painter = FieldPainter::new(field, still, 0);
    if !config.additive {
        painter.show_receivers(file.receivers());
    }
    let mask = config.mask.as_ref().map(|path| Mask::load_sized(path, width, height).or_bad()).transpose()?;
    painter.put_behind(mask);
    if let Some(path) = &config.view_light {
        relight_still(&mut painter, path, &field)?;
    }
    Ok(painter)
}

/// Refuses an exposure by receivers that the field does not have.
pub(super) fn has_what_measures(config: &Config, file: &FieldFile) -> Result<(), Failure> {
    if config.exposure != ExposureMode::View || file.receivers().is_some() {
        return Ok(());
    }
    let (post, field) = (config.file.display(), config.field.display());
    Err(Failure::bad(format!(
        "{post}: exposure.mode = \"view\" measures by receivers, and {field} has none: mark the ground as relume = receiver and \
         bake again, or use \"auto\""
    )))
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

/// The source of light that the post's file asks for. By the system's clock it has a thread of its own; by a simulated one
/// every frame has its own light.
fn sky_source(
    config: &Config,
    field: &Field<'_>,
    clock: &PostClock,
    stop: &AtomicBool,
) -> Result<Box<dyn SkySource>, Failure> {
    let source = open_source(config, field)?;
    if matches!(config.clock, ClockConfig::Simulated { .. }) || config.sky == SkyKind::Logged {
        return Ok(source);
    }
    let pace = if config.sky == SkyKind::Camera { Duration::ZERO } else { MODEL_PACE };
    let mut sky = Background::start(source, clock.clone(), pace).or_runtime()?;
    sky.wait(FIRST_LIGHT, stop);
    Ok(Box::new(sky))
}

/// The source itself.
pub(super) fn open_source(config: &Config, field: &Field<'_>) -> Result<Box<dyn SkySource + Send>, Failure> {
    let (patches, north_deg) = (*field.patch_set(), f64::from(field.camera().north_deg));
    match (config.sky, config.site) {
        (SkyKind::Logged, _) => {
            let log = config.camera.light_log.as_deref().unwrap_or(&config.file);
            Ok(Box::new(LoggedSky::open(log, patches.len()).or_bad()?))
        }
        #[cfg(feature = "board")]
        (SkyKind::Camera, _) => Ok(Box::new(LiveSky::new(config, patches, north_deg, importance(field)).or_bad()?)),
        #[cfg(not(feature = "board"))]
        (SkyKind::Camera, _) => Err(no_drivers(config, "sky = \"camera\"")),
        (SkyKind::Simulated, Some(site)) => Ok(Box::new(SimulatedSky::new(site, config.weather, patches, north_deg))),
        _ => Ok(Box::new(CapturedSky::open(config, patches, north_deg).or_bad()?.with_importance(&importance(field)))),
    }
}
