//! The light as a camera sees it: series -> radiance -> weights. The camera is real, simulated or replayed.
//!
//! Memory is that of the first series. A series of which frames are missing is merged from those that came.

use super::calm::{Calm, Due};
use super::{SkyFault, SkyReading, SkySource, SunSource};
use crate::bracket::{MergeSettings, Merged, Merger};
use crate::camera::replay::ReplayCamera;
use crate::camera::series::Series;
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Camera, CameraError, Exposure, Frame};
use crate::capture::{self, Capture, CaptureSettings, Captured};
use crate::clock::Moment;
use crate::config::{ClockConfig, Config, SkyKind};
use crate::lens::Lens;
use crate::planner::Planner;
use crate::response::Response;
use crate::sun::{Place, SunPosition, sun_position};
use relume_firmware::patches::PatchSet;
use std::time::{Duration, Instant};

/// Most exposures of one series.
pub const SERIES: usize = 4;
/// Stamps further back than this are a clock's that has jumped.
const LONGEST_AGE: Duration = Duration::from_secs(60);
/// Series that a camera may take until its exposures fit the light.
const ATTEMPTS: usize = 6;

enum Device {
    Synthetic(Box<SyntheticCamera>),
    Replay(ReplayCamera, Vec<Exposure>),
    Live(Box<dyn Camera>),
}

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
    watched: Frame,
    expected: usize,
}

impl CapturedSky {
    /// Reads the files of lens and response, without a camera.
    ///
    /// # Errors
    /// What is wrong with them, in one line.
    pub fn check_files(config: &Config) -> anyhow::Result<()> {
        config.camera.lens.as_ref().map(|path| Lens::load(path)).transpose()?;
        config.camera.response.as_ref().map(|path| Response::load(path)).transpose()?;
        Ok(())
    }

    /// Opens the camera, lens and response curve that the post's file names.
    ///
    /// # Errors
    /// What is wrong with those files, in one line.
    pub fn open(config: &Config, patches: PatchSet, north_deg: f64) -> anyhow::Result<Self> {
        Self::with_device(open_device(config, north_deg)?, config, patches, north_deg)
    }

    /// The same with a real camera that is open, whose lens the post's file names.
    ///
    /// # Errors
    /// What is wrong with lens and response, in one line.
    pub fn with_camera(
        camera: Box<dyn Camera>,
        config: &Config,
        patches: PatchSet,
        north_deg: f64,
    ) -> anyhow::Result<Self> {
        Self::with_device(Device::Live(camera), config, patches, north_deg)
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
        let capture = Capture::new(&lens, (limits.width, limits.height), patches, settings, None)?;
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
            watched: Frame::default(),
            expected: 0,
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
            let (camera, planned): (&mut dyn Camera, &[Exposure]) = match &mut self.device {
                Device::Synthetic(camera) => {
                    camera.set_time(unix_s);
                    (camera.as_mut(), self.planner.exposures())
                }
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
        let camera: &mut dyn Camera = match &mut self.device {
            Device::Synthetic(camera) => {
                camera.set_time(unix_s);
                camera.as_mut()
            }
            Device::Replay(camera, _) => camera,
            Device::Live(camera) => camera.as_mut(),
        };
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
            self.camera().request(watch).map_err(fault)?;
        }
        Ok(())
    }

    fn camera(&mut self) -> &mut dyn Camera {
        match &mut self.device {
            Device::Synthetic(camera) => camera.as_mut(),
            Device::Replay(camera, _) => camera,
            Device::Live(camera) => camera.as_mut(),
        }
    }

    /// One reading; see [`SkySource::read`].
    fn look(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        if self.is_still(moment.unix_s)? {
            return Ok(false);
        }
        let exposures_stay = self.take(moment.unix_s)?;
        let (taken, sun) = (self.taken(), self.sun(moment));
        self.capture.weights_into(&self.merged, sun, &mut self.captured).map_err(failed)?;
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
        });
        into.taken = taken;
        into.exposures.clear();
        Ok(true)
    }

    /// A real camera's light is shown as it comes, once there was any: better exposures follow with the next series.
    fn attempts(&self) -> usize {
        if matches!(self.device, Device::Live(_)) && !self.merged.radiance.is_empty() {
            return 1;
        }
        ATTEMPTS
    }

    /// When the last frame was taken, by a camera whose frames are stamped with the system's clock.
    fn taken(&self) -> Option<Instant> {
        if matches!(self.device, Device::Live(_)) {
            let newest = self.series.frames().iter().map(|frame| frame.captured_at_s).fold(0.0, f64::max);
            let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).ok()?;
            let age = Duration::try_from_secs_f64(now.as_secs_f64() - newest).ok()?;
            return Instant::now().checked_sub(age).filter(|_| age < LONGEST_AGE);
        }
        None
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

fn open_device(config: &Config, north_deg: f64) -> anyhow::Result<Device> {
    if let (SkyKind::Replay, Some(folder)) = (config.sky, &config.camera.frames) {
        let camera = ReplayCamera::open(folder, false)?;
        let series = camera.series();
        return Ok(Device::Replay(camera, series));
    }
    let Some(site) = config.site else { anyhow::bail!("{}: [site] is missing", config.file.display()) };
    let lens = config.camera.lens.as_ref().map(|path| Lens::load(path)).transpose()?;
    let mut settings = SyntheticSettings {
        place: site.place,
        north_deg,
        atmosphere: super::simulated::atmosphere(site, config.weather),
        ..SyntheticSettings::default()
    };
    if let Some((width, height)) = lens.as_ref().and_then(Lens::size) {
        (settings.width, settings.height) = (width, height);
    }
    settings.lens = lens;
    Ok(Device::Synthetic(Box::new(SyntheticCamera::new(settings))))
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
mod tests {
    use super::*;
    use crate::sky_source::simulated::SimulatedSky;

    #[test]
    fn a_synthetic_camera_measures_the_sky_it_stands_under() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("POST.toml");
        let text = "field = 'a'\nsky = 'synthetic'\n[site]\nlatitude = 48.0\nlongitude = 11.0\n\
                    [display]\nkind = 'headless'\nfolder = 'o'\n";
        std::fs::write(&file, text).unwrap();
        let config = Config::load(&file).unwrap();
        let set = PatchSet::new(64).unwrap();
        let mut camera = CapturedSky::open(&config, set, 0.0).unwrap();
        let mut model = SimulatedSky::new(config.site.unwrap(), config.weather, set, 0.0);
        // Afternoon in June, then dusk: the exposures must follow over many stops.
        for unix_s in [1_782_052_000.0, 1_782_072_500.0] {
            let moment = Moment { unix_s, trusted: true };
            let (mut seen, mut truth) = (SkyReading::default(), SkyReading::default());
            camera.read(moment, &mut seen).unwrap();
            model.read(moment, &mut truth).unwrap();
            let mean = |r: &SkyReading| r.weights.radiance[..64].iter().map(|v| f64::from(v[1])).sum::<f64>();
            let ratio = mean(&seen) / mean(&truth);
            assert!((ratio - 1.0).abs() < 0.05, "{unix_s}: {ratio}");
            assert_eq!(seen.weights.sun.is_some(), truth.weights.sun.is_some(), "{unix_s}");
        }
        // Without the time there is no place for the sun.
        let mut reading = SkyReading::default();
        camera.read(Moment { unix_s: 1_782_052_000.0, trusted: false }, &mut reading).unwrap();
        assert!(reading.weights.sun.is_none());
    }
}
