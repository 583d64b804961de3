//! `relume sky capture`: the frames that a sky camera is calibrated by.

use crate::camera::Exposure;
use crate::camera::recording::{Recording, RecordingError};
use crate::camera::series::Series;
use crate::cli::args::{number, place, required, span_s};
use crate::clock::{Moment, PostClock};
use crate::config::{ClockConfig, Config, SkyKind};
use crate::failure::{Failure, OrFail};
use crate::lightmeter::LightMeter;
use crate::relight::FieldFile;
use crate::sky_source::device::Device;
use crate::sun::{format_utc, sun_position};
use crate::sunpath::MIN_ALTITUDE_DEG;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// Most exposures of a series: they are all in memory until they are written.
const MOST: f64 = 24.0;
const EVERY_S: f64 = 300.0;

#[derive(Default)]
struct Options {
    post: Option<PathBuf>,
    series: Option<usize>,
    step_stops: Option<f64>,
    sun: bool,
    every_s: Option<f64>,
    for_s: Option<f64>,
    resume: bool,
    out: Option<PathBuf>,
}

pub(super) fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let post = required(options.post.as_ref(), "POST.toml")?;
    let folder = required(options.out.as_ref(), "-o FRAMES_DIR")?;
    check(&options)?;
    let config = Config::load_uncalibrated(post).or_bad()?;
    let recording = Recording::open(folder, options.resume)?;
    let signals = crate::cli::run::listen()?;
    let device = open(&config)?;
    let mut capturing = Capturing::new(device, recording, &config, &signals.stop);
    let next = match options.series {
        Some(count) => {
            capturing.calibration(count, options.step_stops.unwrap_or(1.0), now(&config))?;
            "relume sky response FRAMES_DIR -o CURVE.csv"
        }
        None => {
            capturing.sun_path(&mut beat(&config, options.every_s.unwrap_or(EVERY_S)), options.for_s)?;
            "relume sky lens FRAMES_DIR --site LAT,LON -o LENS.json"
        }
    };
    eprintln!("{}: {} frames; next: {next}", folder.display(), capturing.recording.len());
    Ok(())
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("series") => o.series = Some(number(parser, "--series", 2.0..=MOST)?.round() as usize),
            Long("step-stops") => o.step_stops = Some(number(parser, "--step-stops", 0.25..=4.0)?),
            Long("sun") => o.sun = true,
            Long("every") => o.every_s = Some(span_s(parser, "--every")?),
            Long("for") => o.for_s = Some(span_s(parser, "--for")?),
            Long("resume") => o.resume = true,
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Value(value) => place(value, &mut [&mut o.post])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(o)
}

fn check(o: &Options) -> Result<(), Failure> {
    match (o.series, o.sun) {
        (Some(_), true) => Err(Failure::bad("sky capture: --series or --sun, not both")),
        (None, false) => Err(Failure::bad("sky capture: choose --series N (for a response) or --sun (for a lens)")),
        (Some(_), false) if o.every_s.is_some() || o.for_s.is_some() => {
            Err(Failure::bad("sky capture: --every and --for belong to --sun"))
        }
        (None, true) if o.step_stops.is_some() => Err(Failure::bad("sky capture: --step-stops belongs to --series")),
        _ => Ok(()),
    }
}

/// The sky camera that the post's file asks for.
fn open(config: &Config) -> Result<Device, Failure> {
    match config.sky {
        SkyKind::Synthetic => Device::open(config, north_deg(config)?).or_bad(),
        #[cfg(feature = "board")]
        SkyKind::Camera => crate::sky_source::live::open_camera(config).map(Device::live).or_runtime(),
        #[cfg(not(feature = "board"))]
        SkyKind::Camera => Err(crate::cli::run::no_drivers(config, "sky = \"camera\"")),
        other => Err(Failure::bad(format!(
            "{}: sky = \"{}\" has no camera that takes frames; write \"camera\", or \"synthetic\" to rehearse",
            config.file.display(),
            other.name()
        ))),
    }
}

/// Where north lies for the simulated camera: as the field has it, 0 while there is none.
fn north_deg(config: &Config) -> Result<f64, Failure> {
    if !config.field.exists() {
        return Ok(0.0);
    }
    let file = FieldFile::open(&config.field).or_bad()?;
    Ok(f64::from(file.field().camera().north_deg))
}

/// The post's clock with another beat; a real camera lives by the system's.
fn beat(config: &Config, every_s: f64) -> PostClock {
    let clock = match config.clock {
        ClockConfig::Simulated { start_unix_s, speed, .. } if config.sky == SkyKind::Synthetic => {
            ClockConfig::Simulated { start_unix_s, step_s: every_s, speed }
        }
        _ => ClockConfig::System { interval_s: every_s },
    };
    let made = std::fs::metadata(&config.field).and_then(|meta| meta.modified()).ok();
    PostClock::start(clock, made)
}

fn now(config: &Config) -> Moment {
    beat(config, EVERY_S).now(0)
}

/// A camera, what it is told to take, and where its frames go.
struct Capturing<'a> {
    device: Device,
    meter: LightMeter,
    series: Series,
    recording: Recording,
    config: &'a Config,
    stop: &'a AtomicBool,
}

impl<'a> Capturing<'a> {
    fn new(mut device: Device, recording: Recording, config: &'a Config, stop: &'a AtomicBool) -> Self {
        let meter = LightMeter::new(device.camera().limits());
        Capturing { device, meter, series: Series::default(), recording, config, stop }
    }

    /// One exposure series over the light that is there.
    fn calibration(&mut self, count: usize, step_stops: f64, moment: Moment) -> Result<(), Failure> {
        if !moment.trusted {
            eprintln!("notice: the clock cannot be right ({}), nor then captured_at", format_utc(moment.unix_s));
        }
        self.meter.look(&mut self.device, |device| device.at(moment.unix_s)).or_runtime()?;
        let exposures = self.meter.calibration(count, step_stops);
        let limits = self.device.camera().limits();
        let (min, max) = (limits.min_exposure_s, limits.max_exposure_s);
        if exposures.len() < 2 {
            let file = self.config.file.display();
            return Err(Failure::bad(format!(
                "{file}: the camera takes exposures from {min} to {max} s only, of which no series can be made; use one whose \
                 exposure can be set"
            )));
        }
        if exposures.len() < count {
            eprintln!("notice: {} of {count} exposures lie within the camera's {min} to {max} s", exposures.len());
        }
        let missing = self.take(&exposures, moment)?;
        if missing > 0 {
            eprintln!("notice: {missing} of {} frames did not come; take the series again", exposures.len());
        }
        Ok(())
    }

    /// Moment after moment while the sun is up. A camera that fails is asked again in the next one.
    fn sun_path(&mut self, clock: &mut PostClock, for_s: Option<f64>) -> Result<(), Failure> {
        let (before, mut told) = (self.recording.len(), String::new());
        let mut first_unix_s = None;
        for number in 0.. {
            let moment = clock.now(number);
            let since_s = moment.unix_s - *first_unix_s.get_or_insert(moment.unix_s);
            if self.stop.load(Ordering::Relaxed) || for_s.is_some_and(|most| since_s > most) {
                break;
            }
            let why_not = self.sun_moment(moment)?;
            if let Some(why) = why_not.filter(|why| *why != told) {
                eprintln!("{} {why}", format_utc(moment.unix_s));
                told = why;
            }
            clock.wait(self.stop);
        }
        if self.recording.len() == before && !self.stop.load(Ordering::Relaxed) {
            return Err(Failure::runtime(format!("sky capture: no frame was taken: {told}")));
        }
        Ok(())
    }

    /// The frames of one moment; or why there are none.
    fn sun_moment(&mut self, moment: Moment) -> Result<Option<String>, Failure> {
        if !moment.trusted {
            return Ok(Some("the clock cannot be right, and the lens would be turned by it: set it".into()));
        }
        let Some(site) = self.config.site else { return Ok(Some("there is no [site]".into())) };
        let sun = sun_position(moment.unix_s, site.place).or_bad()?;
        if sun.altitude_deg < MIN_ALTITUDE_DEG {
            return Ok(Some(format!("the sun is not {MIN_ALTITUDE_DEG} degrees high")));
        }
        if let Err(error) = self.meter.look(&mut self.device, |device| device.at(moment.unix_s)) {
            return Ok(Some(Failure::Runtime(error).to_string()));
        }
        match self.take(&self.meter.sun_path(), moment) {
            Err(TakeError::Camera(error)) => Ok(Some(error.to_string())),
            Err(other) => Err(other.into()),
            Ok(_) => {
                eprintln!("{} {} frames in all", format_utc(moment.unix_s), self.recording.len());
                Ok(None)
            }
        }
    }

    /// Takes and writes a frame per exposure; how many did not come. Frames count by the exposure read back, so that those
    /// in which a new one does not show yet are none.
    fn take(&mut self, exposures: &[Exposure], moment: Moment) -> Result<usize, TakeError> {
        self.series.take(self.device.at(moment.unix_s), exposures)?;
        for frame in self.series.frames() {
            if self.stop.load(Ordering::Relaxed) {
                break;
            }
            self.recording.add(frame)?;
        }
        Ok(exposures.len() - self.series.frames().len())
    }
}

/// Why frames were not taken.
#[derive(Debug, thiserror::Error)]
enum TakeError {
    /// Another time they may be.
    #[error(transparent)]
    Camera(#[from] crate::camera::CameraError),
    /// They cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

impl From<TakeError> for Failure {
    fn from(error: TakeError) -> Self {
        match error {
            TakeError::Camera(camera) => Failure::Runtime(camera.into()),
            TakeError::Recording(recording) => recording.into(),
        }
    }
}

#[cfg(test)]
mod tests;
