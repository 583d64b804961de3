//! `POST.toml`: what a post shows, where it stands, and where its light comes from.
//!
//! Every key is checked: an unknown one is refused with the nearest known name, a value out of range with its range.
//! Paths are relative to the file's own folder. `POST.toml` in this package documents every key.

mod display;
mod reader;
mod sky;
mod view;

pub use display::DisplayConfig;
pub use reader::ConfigError;
pub use sky::{CameraConfig, SkyKind};
pub use view::ViewCamera;

use crate::exposure::{EV_RANGE, ExposureMode};
use crate::relight::Budget;
use crate::sun::Place;
use reader::Reader;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Every key that a post's file may have, dotted.
pub const KEYS: &[&str] = &[
    "title",
    "caption",
    "field",
    "view",
    "view_light",
    "view_response",
    "mask",
    "sky",
    "health",
    "site.latitude",
    "site.longitude",
    "site.elevation_m",
    "site.ground_albedo",
    "weather.turbidity",
    "weather.cloud_cover",
    "weather.seed",
    "camera.frames",
    "camera.lens",
    "camera.response",
    "camera.colour",
    "camera.radiance_scale",
    "camera.light_log",
    "camera.device",
    "camera.controls",
    "camera.size",
    "camera.pixel_format",
    "camera.white_balance_k",
    "camera.max_gain",
    "view_camera.device",
    "view_camera.size",
    "view_camera.pixel_format",
    "view_camera.frames",
    "view_camera.response",
    "display.kind",
    "display.folder",
    "display.every",
    "display.card",
    "display.connector",
    "display.mode",
    "display.rotation_deg",
    "display.format",
    "display.buffers",
    "display.modesetting",
    "run.start",
    "run.step_s",
    "run.speed",
    "run.interval_s",
    "run.frames",
    "run.duration_s",
    "run.light_log",
    "budget.error_codes",
    "budget.time_ms",
    "exposure.mode",
    "exposure.ev",
];

/// Where the post stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Latitude and longitude, degrees, north and east positive.
    pub place: Place,
    /// Metres above the sea.
    pub elevation_m: f64,
    /// Share of light that the ground around throws back, 0 to 1.
    pub ground_albedo: f64,
}

/// The weather of a simulated sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weather {
    /// Haze: 2 is very clear air, 3 a clear day, 10 thick haze.
    pub turbidity: f64,
    /// Share of the sky under cloud, 0 to 1.
    pub cloud_cover: f64,
    /// Which clouds.
    pub seed: u64,
}

/// Which clock the post lives by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClockConfig {
    /// The system's clock, one frame every `interval_s` seconds.
    System {
        /// Seconds between frames.
        interval_s: f64,
    },
    /// A clock of its own: frame `n` shows `start_unix_s + n * step_s`.
    Simulated {
        /// Time of the first frame, Unix seconds.
        start_unix_s: f64,
        /// Seconds from frame to frame.
        step_s: f64,
        /// Simulated seconds per real second; `None` runs as fast as it can.
        speed: Option<f64>,
    },
}

/// When the post stops by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// After this many frames.
    pub frames: Option<u64>,
    /// After this many seconds of the post's own clock.
    pub duration_s: Option<f64>,
}

/// A checked `POST.toml`.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The file itself.
    pub file: PathBuf,
    /// Shown at the foot of the picture, one line; empty for none.
    pub title: String,
    /// Shown below the title, two lines at most; empty for none.
    pub caption: String,
    /// The field file.
    pub field: PathBuf,
    /// A still as the real picture behind, or until there is a live one; black if none.
    pub view: Option<PathBuf>,
    /// The light that the still was taken in; it is relit then, too.
    pub view_light: Option<PathBuf>,
    /// The curve of the camera that took the still; sRGB if none.
    pub view_response: Option<PathBuf>,
    /// What stands in front of the picture, painted.
    pub mask: Option<PathBuf>,
    /// The display adds its light to what is seen through it.
    pub additive: bool,
    /// The camera of a live view.
    pub view_camera: Option<ViewCamera>,
    /// That camera's curve; sRGB if none.
    pub view_camera_response: Option<PathBuf>,
    /// Where the light comes from.
    pub sky: SkyKind,
    /// Where the state is written.
    pub health: PathBuf,
    /// Where the post stands; every sky but a replayed one needs it.
    pub site: Option<Site>,
    /// The weather of a simulated sky.
    pub weather: Weather,
    /// The sky camera.
    pub camera: CameraConfig,
    /// Where pictures go.
    pub display: DisplayConfig,
    /// Which clock the post lives by.
    pub clock: ClockConfig,
    /// When the post stops by itself.
    pub limits: Limits,
    /// Where the light is logged; nowhere if none.
    pub light_log: Option<PathBuf>,
    /// How the exposure is chosen.
    pub exposure: ExposureMode,
    /// What a frame may cost, or be wrong by.
    pub budget: Budget,
}

impl Config {
    /// Reads and checks a post's file; opens none of the files it names.
    ///
    /// # Errors
    /// [`ConfigError`] naming file, key, value and what would be right.
    pub fn load(file: &Path) -> Result<Self, ConfigError> {
        Self::read(file, sky::NEEDED)
    }

    /// The same for a post whose sky camera is yet to be calibrated: its lens may be left out.
    ///
    /// # Errors
    /// As [`Config::load`].
    pub fn load_uncalibrated(file: &Path) -> Result<Self, ConfigError> {
        let needed: Vec<_> = sky::NEEDED.iter().filter(|(_, key, _)| *key != sky::LENS).copied().collect();
        Self::read(file, &needed)
    }

    fn read(file: &Path, needed: &[sky::Needed]) -> Result<Self, ConfigError> {
        let r = Reader::open(file, KEYS)?;
        let missing = |key: &str, what: &str| r.fault(format!("{key} is missing: {what}"));
        let (display, site) = (display::display(&r)?, site(&r)?);
        let field = r.path("field")?.ok_or_else(|| missing("field", "name the field file to show"))?;
        let (sky, camera) = sky::sky(&r, site, needed)?;
        view::check(&r)?;
        Ok(Config {
            file: file.to_path_buf(),
            title: r.text("title", 120)?.unwrap_or_default(),
            caption: r.text("caption", 400)?.unwrap_or_default(),
            field,
            view: r.path("view")?,
            view_light: r.path("view_light")?,
            view_response: r.path("view_response")?,
            mask: r.path("mask")?,
            additive: display::is_additive(&r)?,
            view_camera: view::view_camera(&r, &camera)?,
            view_camera_response: r.path("view_camera.response")?,
            sky,
            health: r.path("health")?.unwrap_or_else(|| display.health(file)),
            site,
            weather: Weather {
                turbidity: r.number("weather.turbidity", 1.7..=10.0)?.unwrap_or(3.0),
                cloud_cover: r.number("weather.cloud_cover", 0.0..=1.0)?.unwrap_or(0.0),
                seed: r.whole("weather.seed", 0..=u64::from(u32::MAX))?.unwrap_or(1),
            },
            camera,
            clock: clock(&r, display.interval_s())?,
            display,
            limits: Limits {
                frames: r.whole("run.frames", 1..=1_000_000_000)?,
                duration_s: r.number("run.duration_s", 1e-3..=1e9)?,
            },
            light_log: r.path("run.light_log")?,
            exposure: exposure(&r)?,
            budget: budget(&r)?,
        })
    }
}

fn site(r: &Reader) -> Result<Option<Site>, ConfigError> {
    let latitude_deg = r.number("site.latitude", -90.0..=90.0)?;
    let longitude_deg = r.number("site.longitude", -180.0..=180.0)?;
    let elevation_m = r.number("site.elevation_m", -450.0..=9000.0)?.unwrap_or(0.0);
    let ground_albedo = r.number("site.ground_albedo", 0.0..=1.0)?.unwrap_or(0.2);
    match (latitude_deg, longitude_deg) {
        (Some(latitude_deg), Some(longitude_deg)) => {
            Ok(Some(Site { place: Place { latitude_deg, longitude_deg }, elevation_m, ground_albedo }))
        }
        (None, None) if !r.has_table("site") => Ok(None),
        (None, _) => Err(r.fault("site.latitude is missing: degrees, north positive".into())),
        (_, None) => Err(r.fault("site.longitude is missing: degrees, east positive".into())),
    }
}

fn clock(r: &Reader, interval_by_default_s: f64) -> Result<ClockConfig, ConfigError> {
    let start = r.moment("run.start")?;
    let step_s = r.number("run.step_s", 1e-3..=86_400.0)?;
    let speed = r.number("run.speed", 1e-3..=1e6)?;
    let interval_s = r.number("run.interval_s", 1e-3..=3600.0)?;
    match (start, step_s, speed, interval_s) {
        (Some(_), _, _, Some(_)) => Err(r.fault(
            "run.interval_s belongs to the system's clock and run.start sets another; remove one of them".into(),
        )),
        (Some(start_unix_s), step_s, speed, None) => {
            Ok(ClockConfig::Simulated { start_unix_s, step_s: step_s.unwrap_or(60.0), speed })
        }
        (None, None, None, interval_s) => {
            Ok(ClockConfig::System { interval_s: interval_s.unwrap_or(interval_by_default_s) })
        }
        (None, ..) => Err(r.fault("run.step_s and run.speed need run.start, the time of the first frame".into())),
    }
}

fn exposure(r: &Reader) -> Result<ExposureMode, ConfigError> {
    let modes = [("auto", ExposureMode::Auto), ("fixed", ExposureMode::Fixed(0.0)), ("view", ExposureMode::View)];
    let mode = r.choice("exposure.mode", &modes)?.unwrap_or(ExposureMode::Auto);
    match (mode, r.number("exposure.ev", EV_RANGE)?) {
        (ExposureMode::Fixed(_), Some(ev)) => Ok(ExposureMode::Fixed(ev)),
        (ExposureMode::Fixed(_), None) => {
            Err(r.fault("exposure.ev is missing: exposure.mode = \"fixed\" shows radiance x 2^ev".into()))
        }
        (mode, None) => Ok(mode),
        (_, Some(_)) => Err(r.fault("exposure.ev is only used with exposure.mode = \"fixed\"".into())),
    }
}

fn budget(r: &Reader) -> Result<Budget, ConfigError> {
    let codes = r.number("budget.error_codes", 0.6..=255.0)?;
    let time_ms = r.number("budget.time_ms", 0.01..=10_000.0)?;
    match (codes, time_ms) {
        (Some(_), Some(_)) => Err(r.fault(
            "budget.error_codes and budget.time_ms exclude each other: one lets the frame take the time it takes, the other \
             gets the error it gets; remove one"
                .into(),
        )),
        (Some(codes), None) => Ok(Budget::ErrorCodes(codes as f32)),
        (None, Some(time_ms)) => Ok(Budget::Time(Duration::from_secs_f64(time_ms / 1e3))),
        (None, None) => Ok(Budget::Field),
    }
}

#[cfg(test)]
mod tests;
