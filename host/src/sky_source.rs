//! Where a post's weights come from, moment by moment.

pub mod background;
pub mod captured;
#[cfg(feature = "board")]
pub mod live;
pub mod logged;
pub mod simulated;

use crate::clock::Moment;
use crate::weights::PatchWeights;
use serde::Serialize;
use std::time::Instant;

/// How the sun's light is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SunSource {
    /// No sun: below the horizon, covered, or not to be trusted.
    #[default]
    None,
    /// From what the frames of the series can still measure.
    Measured,
    /// From a clear-sky model.
    Model,
}

/// The light of one moment.
#[derive(Clone, Debug, Default)]
pub struct SkyReading {
    /// Radiance per patch and the sun.
    pub weights: PatchWeights,
    /// How the sun in them is known.
    pub sun: SunSource,
    /// Exposures that the light was relit with when it was logged, in order; empty for light that was not.
    pub exposures: Vec<f32>,
    /// When a camera took the last picture that they rest on.
    pub taken: Option<Instant>,
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
    /// The light at a moment, into a reading that is reused; false if there is nothing newer than the last one. While its
    /// clock is not trusted no sun may be placed by it.
    ///
    /// # Errors
    /// [`SkyFault`]; the post holds what it had, and `into` may be anything.
    fn read(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault>;
}
