//! The light as a camera sees it: series -> radiance -> weights. The camera is real, simulated or replayed.
//!
//! Memory is that of the first series. A series of which frames are missing is merged from those that came.

use super::agreement::{ASTRAY_EVERY, Usual};
use super::calm::{Calm, Due};
use super::device::Device;
use super::{SeriesTimes, SkyFault, SkyReading, SkySource, SunSource};
use crate::bracket::{MergeSettings, Merged, Merger};
use crate::camera::plausible::PictureFault;
use crate::camera::series::Series;
use crate::camera::{Camera, CameraError, Exposure, Frame};
use crate::capture::{self, Capture, CaptureSettings, Captured};
use crate::clock::Moment;
use crate::colour::CameraColour;
use crate::config::{ClockConfig, Config};
use crate::lens::Lens;
use crate::planner::Planner;
use crate::response::Response;
use crate::sun::{Place, SunPosition, sun_position};
use relume_firmware::patches::PatchSet;
use std::time::Instant;

/// Most exposures of one series.
pub const SERIES: usize = 4;
/// Series that a camera may take until its exposures fit the light.
const ATTEMPTS: usize = 6;
/// A series that clips more of the sky than this is blind.
const BLINDED_SHARE: f64 = 0.5;
/// With the sun higher than this no sky is black to a camera, under whatever clouds, degrees.
const DAY_ALTITUDE_DEG: f64 = 5.0;

/// A camera's series as weights.
pub struct CapturedSky {
    device: Device,
    planner: Planner,
    merger: Merger,
    capture: Capture,
    place: Option<Place>,
    series: Series,
    merged: Merged,
    captured: Captured,
    calm: Calm,
    slopes: Usual,
    astray: Usual,
    /// Where the sun stood in the last series, if that is still to be judged by it.
    unjudged: Option<SunPosition>,
    number: u64,
    watched: Frame,
    expected: usize,
    /// Series in a row that were left out until exposures fit.
    waited: usize,
}

impl CapturedSky {
    /// Reads the files of lens, response and colours, without a camera.
    ///
    /// # Errors
    /// What is wrong with them, in one line.
    pub fn check_files(config: &Config) -> anyhow::Result<()> {
        config.camera.lens.as_ref().map(|path| Lens::load(path)).transpose()?;
        config.camera.response.as_ref().map(|path| Response::load(path)).transpose()?;
        config.camera.colour.as_ref().map(|path| CameraColour::load(path)).transpose()?;
        Ok(())
    }

    /// Opens the camera, lens and response curve that the post's file names.
    ///
    /// # Errors
    /// What is wrong with those files, in one line.
    pub fn open(config: &Config, patches: PatchSet, north_deg: f64) -> anyhow::Result<Self> {
        Self::with_device(Device::open(config, north_deg)?, config, patches, north_deg)
    }

    /// The same with a real camera that is open, whose lens the post's file names. Its pictures are looked at before they are
    /// used.
    ///
    /// # Errors
    /// What is wrong with lens and response, in one line.
    pub fn with_camera(
        camera: Box<dyn Camera>,
        config: &Config,
        patches: PatchSet,
        north_deg: f64,
    ) -> anyhow::Result<Self> {
        Self::with_device(Device::live(camera), config, patches, north_deg)
    }

    fn with_device(device: Device, config: &Config, patches: PatchSet, north_deg: f64) -> anyhow::Result<Self> {
        let (limits, lens, unit) = match &device {
            Device::Synthetic(camera) => (camera.limits(), Some(camera.lens().clone()), camera.radiance_scale()),
            Device::Replay(camera, _) => (camera.limits(), None, 1.0),
            Device::Live(camera) => (camera.limits(), None, 1.0),
        };
        let lens = match (&config.camera.lens, lens) {
            (Some(path), None) => Lens::load(path)?,
            (_, Some(lens)) => lens,
            (None, None) => anyhow::bail!("{}: camera.lens is missing: name the lens file", config.file.display()),
        };
        let settings = CaptureSettings {
            radiance_scale: unit * config.camera.radiance_scale,
            ground_albedo: [config.site.map_or(0.2, |site| site.ground_albedo) as f32; 3],
            turbidity: config.weather.turbidity as f32,
            north_deg,
        };
        let mut capture = Capture::new(&lens, (limits.width, limits.height), patches, settings, None)?;
        if let Some(path) = &config.camera.colour {
            capture.set_colour(&CameraColour::load(path)?);
        }
        let mut planner = Planner::new(limits, SERIES);
        planner.set_importance(&capture.pixel_importance(&[]));
        // By a simulated clock every frame has its own light.
        let may_rest = matches!(config.clock, ClockConfig::System { .. }) && !matches!(device, Device::Replay(..));
        Ok(CapturedSky {
            planner,
            merger: Merger::new(MergeSettings { response: response(config, &device)?, ..MergeSettings::default() }),
            capture,
            place: config.site.map(|site| site.place),
            series: Series::default(),
            merged: Merged::default(),
            captured: Captured::default(),
            calm: Calm::new(may_rest),
            slopes: Usual::default(),
            astray: Usual::default(),
            unjudged: None,
            number: 0,
            watched: Frame::default(),
            expected: 0,
            waited: 0,
            device,
        })
    }

    /// Spends exposures where the picture needs them: what each upper patch matters for, as [`crate::importance`] tells.
    #[must_use]
    pub fn with_importance(mut self, per_patch: &[f32]) -> Self {
        self.planner.set_importance(&self.capture.pixel_importance(per_patch));
        self
    }

    /// Takes and merges one series, again while the exposures do not fit the light yet; true if they fitted at once.
    fn take(&mut self, unix_s: f64) -> Result<bool, SkyFault> {
        for attempt in 0..self.attempts() {
            self.device.set_time(unix_s);
            let (camera, planned): (&mut dyn Camera, &[Exposure]) = match &mut self.device {
                Device::Synthetic(camera) => (camera.as_mut(), self.planner.exposures()),
                Device::Replay(camera, recorded) => (camera, recorded),
                Device::Live(camera) => (camera.as_mut(), self.planner.exposures()),
            };
            let taken = self.series.take(camera, planned);
            self.expected = planned.len();
            taken.map_err(fault)?;
            self.merger.merge(self.series.frames(), &mut self.merged).map_err(failed)?;
            if matches!(self.device, Device::Replay(..)) || !self.planner.follow(&self.merged) {
                return Ok(attempt == 0);
            }
        }
        Ok(false)
    }

    /// Looks whether a calm sky still is; true if there is nothing new.
    fn is_still(&mut self, unix_s: f64) -> Result<bool, SkyFault> {
        match self.calm.due(unix_s) {
            Due::Series => return Ok(false),
            Due::Nothing => return Ok(true),
            Due::Look => {}
        }
        let camera = self.device.at(unix_s);
        match camera.frame(&mut self.watched) {
            Ok(()) => {}
            Err(CameraError::Timeout) => return Ok(false),
            Err(error) => return Err(fault(error)),
        }
        if !self.watched.exposure.same_as(&self.planner.watch()) {
            camera.request(self.planner.watch()).map_err(fault)?;
            return Ok(true);
        }
        Ok(!self.calm.look(unix_s, &self.watched))
    }

    /// Takes in what the series gave; a calm sky's camera keeps the exposure to watch by.
    fn rest(&mut self, unix_s: f64, exposures_stay: bool) -> Result<(), SkyFault> {
        let watch = self.planner.watch();
        let watched = self.series.frames().iter().find(|frame| frame.exposure.same_as(&watch));
        self.calm.series(unix_s, &self.captured.weights, watched, exposures_stay);
        if self.calm.is_calm()
            && let Device::Synthetic(_) | Device::Live(_) = &self.device
        {
            self.device.camera().request(watch).map_err(fault)?;
        }
        Ok(())
    }

    /// One reading; see [`SkySource::read`].
    fn look(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        self.judge_last();
        if self.is_still(moment.unix_s)? {
            return Ok(false);
        }
        let exposures_stay = self.take(moment.unix_s)?;
        let sun = self.sun(moment);
        let shows = self.shows(sun);
        if !matches!(shows, Ok(true)) {
            // What comes next may be half of it black still.
            self.waited = self.waited.max(1);
        }
        if !shows? || self.waits(exposures_stay) {
            return Ok(false);
        }
        self.capture.weights_into(&self.merged, sun, &mut self.captured).map_err(failed)?;
        self.judge(sun);
        let times = self.times();
        self.rest(moment.unix_s, exposures_stay)?;
        into.weights.radiance.clone_from(&self.captured.weights.radiance);
        into.weights.sun = self.captured.weights.sun;
        let is_timeless = sun.is_none() && self.place.is_some() && !moment.trusted;
        into.sun = if is_timeless { SunSource::ClockNotTrusted } else { self.captured.sun_source.into() };
        into.sun_share = self.captured.beam_share;
        into.filled_patches = self.captured.filled_patches;
        into.series = Some(super::SeriesReport {
            plan: self.planner.report(),
            missing: self.expected.saturating_sub(self.series.frames().len()),
            is_calm: self.calm.is_calm(),
            response_slope: self.slopes.median(),
            sun_astray_deg: self.astray.median(),
        });
        into.times = times;
        into.exposures.clear();
        Ok(true)
    }

    /// Takes in how the series agrees with itself; now and then its sun is to be held against the ephemeris.
    fn judge(&mut self, sun: Option<SunPosition>) {
        self.slopes.add(self.merger.report().slope);
        if self.number.is_multiple_of(ASTRAY_EVERY) {
            self.unjudged = sun;
        }
        self.number += 1;
    }

    /// What was put off of the last series, whose light was waited for.
    fn judge_last(&mut self) {
        if let Some(sun) = self.unjudged.take() {
            self.astray.add(self.capture.sun_astray_deg(&self.merged, sun));
        }
    }

    /// A real camera's light is shown as it comes, once there was any: better exposures follow with the next series.
    fn attempts(&self) -> usize {
        if matches!(self.device, Device::Live(_)) && !self.merged.radiance.is_empty() {
            return 1;
        }
        ATTEMPTS
    }

    /// When a real camera took the series, whose weights are ready now.
    fn times(&self) -> Option<SeriesTimes> {
        let live = matches!(self.device, Device::Live(_));
        let taken = || self.series.frames().iter().filter(|_| live).filter_map(Frame::taken);
        Some(SeriesTimes { first: taken().min()?, last: taken().max()?, ready: Instant::now() })
    }

    /// Whether the newest series shows the sky. A black one by day does not: exposures still climb, and nothing is new.
    ///
    /// # Errors
    /// When it is black by day and no longer exposure is left.
    fn shows(&self, sun: Option<SunPosition>) -> Result<bool, SkyFault> {
        let Device::Live(camera) = &self.device else { return Ok(true) };
        let is_day = sun.is_some_and(|sun| sun.altitude_deg >= DAY_ALTITUDE_DEG);
        // The longest exposure of a series comes last.
        match camera.fault() {
            _ if !(is_day && camera.is_black()) => Ok(true),
            Some(PictureFault::Black) => Err(fault(CameraError::Implausible(PictureFault::Black))),
            _ => Ok(false),
        }
    }

    /// Whether better exposures are waited for, after the light has leapt, as when a cap is taken off the lens: a series that
    /// was black, or clipped nearly everywhere, and those after it until exposures fit, are no light to show.
    fn waits(&mut self, exposures_stay: bool) -> bool {
        let is_blinded = || self.capture.clipped_share(&self.merged) > BLINDED_SHARE;
        let may_wait = !exposures_stay && self.waited < ATTEMPTS && matches!(self.device, Device::Live(_));
        let waits = may_wait && (self.waited > 0 || is_blinded());
        self.waited = if waits { self.waited + 1 } else { 0 };
        waits
    }

    /// Where the sun stood when the frames were taken; a recording's own time comes first.
    fn sun(&self, moment: Moment) -> Option<SunPosition> {
        let recorded = matches!(self.device, Device::Replay(..)) && self.merged.captured_at_s > 0.0;
        let unix_s = if recorded { self.merged.captured_at_s } else { moment.unix_s };
        (recorded || moment.trusted).then(|| sun_position(unix_s, self.place?).ok()).flatten()
    }
}

fn failed(error: impl std::fmt::Display) -> SkyFault {
    SkyFault::Failed(error.to_string())
}

fn fault(error: CameraError) -> SkyFault {
    if matches!(error, CameraError::Ended) { SkyFault::Ended } else { failed(error) }
}

/// The curve that the post's file names; a simulated camera knows its own; else the camera counts as linear.
fn response(config: &Config, device: &Device) -> anyhow::Result<Response> {
    match (&config.camera.response, device) {
        (Some(path), _) => Ok(Response::load(path)?),
        (None, Device::Synthetic(camera)) => {
            let fractions = camera.response_curve();
            let last = fractions.len().saturating_sub(1).max(1) as f64;
            let rows = fractions.iter().enumerate().map(|(code, &f)| [code as f64 / last, f, f, f]).collect();
            Ok(Response::from_rows(rows, "the simulated camera's response")?)
        }
        (None, _) => Ok(Response::default()),
    }
}

impl From<capture::SunSource> for SunSource {
    fn from(source: capture::SunSource) -> Self {
        match source {
            capture::SunSource::Measured => SunSource::Measured,
            capture::SunSource::ClearSkyModel => SunSource::Model,
            capture::SunSource::Veiled => SunSource::Veiled,
            capture::SunSource::BelowHorizon => SunSource::BelowHorizon,
            capture::SunSource::Covered => SunSource::Covered,
            capture::SunSource::NoPosition => SunSource::None,
        }
    }
}

impl SkySource for CapturedSky {
    fn read(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let outcome = self.look(moment, into);
        if outcome.is_err() {
            self.calm.wake();
        }
        outcome
    }
}

#[cfg(test)]
mod tests;
