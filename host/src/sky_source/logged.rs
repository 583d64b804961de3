//! Light that a post logged before: its pictures once more.

use super::{SkyFault, SkyReading, SkySource, SunSource};
use crate::clock::Moment;
use crate::lightlog::{LightLogError, LightLogReader};
use std::path::Path;

/// The lights of a log, one for each frame.
pub struct LoggedSky {
    lights: LightLogReader,
    patches: usize,
}

impl LoggedSky {
    /// Opens a log for a field with so many patches.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(path: &Path, patches: usize) -> Result<Self, LightLogError> {
        Ok(LoggedSky { lights: LightLogReader::open(path)?, patches })
    }
}

impl SkySource for LoggedSky {
    fn read(&mut self, _moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let light = self.lights.next().ok_or(SkyFault::Ended)?.map_err(|error| SkyFault::Failed(error.to_string()))?;
        let (found, wanted) = (light.radiance.len(), self.patches);
        if found != wanted {
            let what = format!("frame {}: a light of {found} patches for a field of {wanted}", light.frame);
            return Err(SkyFault::Failed(what));
        }
        let sun = if light.sun.is_some() { SunSource::Measured } else { SunSource::None };
        into.exposures.clear();
        into.exposures.extend_from_slice(&light.exposures);
        (into.weights, into.sun, into.times) = (light.weights(), sun, None);
        Ok(true)
    }
}
