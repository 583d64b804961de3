//! Where a post's weights come from, moment by moment.

pub mod captured;
pub mod simulated;

use crate::clock::Moment;
use crate::weights::PatchWeights;
use serde::Serialize;

/// How the sun's light is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SunSource {
    /// No sun: below the horizon, covered, or not to be trusted.
    None,
    /// From what the frames of the series can still measure.
    Measured,
    /// From a clear-sky model.
    Model,
}

/// The light of one moment.
#[derive(Clone, Debug)]
pub struct SkyReading {
    /// Radiance per patch and the sun.
    pub weights: PatchWeights,
    /// How the sun in them is known.
    pub sun: SunSource,
}

/// Why there are no new weights now.
#[derive(Debug, thiserror::Error)]
pub enum SkyFault {
    /// The source has nothing more to give and never will (the end of a replay).
    #[error("no more frames")]
    Ended,
    /// It failed this time; it is asked again with the next frame.
    #[error("{0}")]
    Failed(String),
}

/// Something that tells the light of a moment: a camera or a model.
pub trait SkySource {
    /// The light at a moment. While its clock is not trusted no sun may be placed by it.
    ///
    /// # Errors
    /// [`SkyFault`]; the post holds what it had.
    fn read(&mut self, moment: Moment) -> Result<SkyReading, SkyFault>;
}
