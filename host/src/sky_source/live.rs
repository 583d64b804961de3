//! A real sky camera as a source of light: opened on the sky's own thread, and again whenever it is lost.

use super::captured::CapturedSky;
use super::{SkyFault, SkyReading, SkySource};
use crate::camera::Camera;
use crate::camera::reopen::{Patience, Reopening};
use crate::camera::v4l2::{GainModel, V4l2Camera, V4l2Settings};
use crate::clock::Moment;
use crate::config::Config;
use relume_firmware::patches::PatchSet;
use std::time::Duration;

/// Pause between attempts to open a camera that has not been there yet.
const RETRY: Duration = Duration::from_millis(500);

/// A camera that may not be there when the post opens.
pub struct LiveSky {
    config: Config,
    patches: PatchSet,
    north_deg: f64,
    importance: Vec<f32>,
    camera: Option<CapturedSky>,
}

impl LiveSky {
    /// A source that opens the camera of the post's file with its first reading. `importance`: what each upper patch
    /// matters for, as [`crate::importance`] tells.
    ///
    /// # Errors
    /// What is wrong with the files of lens and response or the pixel format, in one line.
    pub fn new(config: &Config, patches: PatchSet, north_deg: f64, importance: Vec<f32>) -> anyhow::Result<Self> {
        CapturedSky::check_files(config)?;
        v4l2_settings(config)?;
        Ok(LiveSky { config: config.clone(), patches, north_deg, importance, camera: None })
    }
}

/// A real camera that is opened again when it is lost.
fn open(config: &Config, patches: PatchSet, north_deg: f64) -> anyhow::Result<CapturedSky> {
    CapturedSky::with_camera(open_camera(config)?, config, patches, north_deg)
}

/// The camera that the post's file names, opened again when it is lost; its delay is measured.
///
/// # Errors
/// Why it does not open, in one line.
pub fn open_camera(config: &Config) -> anyhow::Result<Box<dyn Camera>> {
    Ok(Box::new(Reopening::open(V4l2Camera::opener(v4l2_settings(config)?), Patience::default())?))
}

/// What the post's file asks of a real camera.
///
/// # Errors
/// When its pixel format cannot be one.
pub fn v4l2_settings(config: &Config) -> anyhow::Result<V4l2Settings> {
    let fourcc = config.camera.pixel_format.as_ref().map(|name| {
        let name = format!("{name:<4}");
        <[u8; 4]>::try_from(name.as_bytes()).map_err(|_| {
            anyhow::anyhow!("{}: camera.pixel_format = \"{name}\": must be such as YUYV", config.file.display())
        })
    });
    Ok(V4l2Settings {
        device: config.camera.device.clone().unwrap_or_default(),
        controls: config.camera.controls.clone(),
        size: config.camera.size.map(|(width, height)| [width as u32, height as u32]),
        fourcc: fourcc.transpose()?,
        white_balance_k: config.camera.white_balance_k,
        gain: config.camera.max_gain.map(GainModel::UpTo),
        ..V4l2Settings::default()
    })
}

impl SkySource for LiveSky {
    fn read(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let camera = match &mut self.camera {
            Some(camera) => camera,
            none => match open(&self.config, self.patches, self.north_deg) {
                Ok(camera) => none.insert(camera.with_importance(&self.importance)),
                Err(error) => {
                    std::thread::sleep(RETRY);
                    return Err(SkyFault::Failed(format!("{error:#}")));
                }
            },
        };
        camera.read(moment, into)
    }
}
