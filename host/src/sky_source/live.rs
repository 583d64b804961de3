//! A real sky camera as a source of light: opened on the sky's own thread, and again whenever it is lost.

use super::captured::CapturedSky;
use super::{SkyFault, SkyReading, SkySource};
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
    camera: Option<CapturedSky>,
}

impl LiveSky {
    /// A source that opens the camera of the post's file with its first reading.
    ///
    /// # Errors
    /// What is wrong with the files of lens and response, in one line.
    pub fn new(config: &Config, patches: PatchSet, north_deg: f64) -> anyhow::Result<Self> {
        CapturedSky::check_files(config)?;
        Ok(LiveSky { config: config.clone(), patches, north_deg, camera: None })
    }
}

impl SkySource for LiveSky {
    fn read(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let camera = match &mut self.camera {
            Some(camera) => camera,
            none => match CapturedSky::open(&self.config, self.patches, self.north_deg) {
                Ok(camera) => none.insert(camera),
                Err(error) => {
                    std::thread::sleep(RETRY);
                    return Err(SkyFault::Failed(format!("{error:#}")));
                }
            },
        };
        camera.read(moment, into)
    }
}
