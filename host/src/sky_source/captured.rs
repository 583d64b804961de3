//! The light as a camera sees it: series -> radiance -> weights. The camera is simulated or replayed.

use super::{SkyFault, SkyReading, SkySource, SunSource};
use crate::bracket::{MergeSettings, Merged, Merger, Planner};
use crate::camera::replay::ReplayCamera;
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Camera, CameraError, Exposure, Frame, take_series};
use crate::capture::{self, Capture, CaptureSettings};
use crate::clock::Moment;
use crate::colour::CameraColour;
use crate::config::{Config, SkyKind};
use crate::lens::Lens;
use crate::response::Response;
use crate::sun::{Place, SunPosition, sun_position};
use relume_firmware::patches::PatchSet;
use std::time::Instant;

/// Exposures of one series.
const SERIES: usize = 4;
/// Stamps further back than this are a clock's that has jumped.
const LONGEST_AGE: std::time::Duration = std::time::Duration::from_secs(60);
/// Series that a camera may take until its exposures fit the light.
const ATTEMPTS: usize = 5;

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
    frames: Vec<Frame>,
    merged: Merged,
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
        let mut capture = Capture::new(&lens, (limits.width, limits.height), patches, settings, None)?;
        if let Some(path) = &config.camera.colour {
            capture.set_colour(&CameraColour::load(path)?);
        }
        Ok(CapturedSky {
            planner: Planner::new(limits, SERIES),
            merger: Merger::new(MergeSettings { response: response(config, &device)?, ..MergeSettings::default() }),
            capture,
            place: config.site.map(|site| site.place),
            frames: Vec::new(),
            merged: Merged::default(),
            device,
        })
    }

    /// Takes and merges one series, again while the exposures do not fit the light yet.
    fn take(&mut self, unix_s: f64) -> Result<(), SkyFault> {
        for _ in 0..self.attempts() {
            let planned = self.planner.exposures();
            let taken = match &mut self.device {
                Device::Synthetic(camera) => {
                    camera.set_time(unix_s);
                    take_series(camera.as_mut(), &planned, &mut self.frames)
                }
                Device::Replay(camera, series) => take_series(camera, series, &mut self.frames),
                Device::Live(camera) => take_series(camera.as_mut(), &planned, &mut self.frames),
            };
            taken.map_err(fault)?;
            self.merger.merge(&self.frames, &mut self.merged).map_err(failed)?;
            if matches!(self.device, Device::Replay(..)) {
                break;
            }
            self.planner.follow(&self.merged);
            if self.planner.exposures() == planned {
                break;
            }
        }
        Ok(())
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
            let newest = self.frames.iter().map(|frame| frame.captured_at_s).fold(0.0, f64::max);
            let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).ok()?;
            let age = std::time::Duration::try_from_secs_f64(now.as_secs_f64() - newest).ok()?;
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

impl SkySource for CapturedSky {
    fn read(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        self.take(moment.unix_s)?;
        let taken = self.taken();
        let captured = self.capture.weights(&self.merged, self.sun(moment)).map_err(failed)?;
        let sun = match captured.sun_source {
            capture::SunSource::Measured => SunSource::Measured,
            capture::SunSource::ClearSkyModel => SunSource::Model,
            capture::SunSource::NoPosition | capture::SunSource::BelowHorizon | capture::SunSource::Covered => {
                SunSource::None
            }
        };
        *into = SkyReading { weights: captured.weights, sun, taken, ..SkyReading::default() };
        Ok(true)
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
