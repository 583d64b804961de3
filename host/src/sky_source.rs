//! Where a post's weights come from, moment by moment.

pub mod agreement;
pub mod background;
pub mod calm;
pub mod captured;
pub mod device;
#[cfg(feature = "board")]
pub mod live;
pub mod logged;
pub mod simulated;

use crate::bell::Bell;
use crate::clock::Moment;
use crate::planner::PlanReport;
use crate::weights::PatchWeights;
use serde::Serialize;
use std::time::Instant;

/// How the sun's light is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SunSource {
    /// No sun, and nothing known of one: no place, or not looked yet.
    #[default]
    None,
    /// None: the clock is not trusted, and the sun's place comes from it.
    ClockNotTrusted,
    /// None: below the horizon.
    BelowHorizon,
    /// None: nothing stands out where it is.
    Covered,
    /// From a clear-sky model, less what is before it.
    Veiled,
    /// From what the frames of the series can still measure.
    Measured,
    /// From a clear-sky model.
    Model,
}

/// The series that a reading rests on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SeriesReport {
    /// The exposures of the next one.
    pub plan: PlanReport,
    /// Frames that did not come.
    pub missing: usize,
    /// The sky stands still: one frame now and then, a series every five seconds.
    pub is_calm: bool,
    /// By how much the response curve's exponent seems to be off: how the exposures of many series disagree, per natural log of
    /// their ratio. `None` while too few series tell.
    pub response_slope: Option<f64>,
    /// How far the sun usually stands from where lens, time and place put it, degrees. `None` while too few series show it.
    pub sun_astray_deg: Option<f64>,
}

/// The moments of a series, on the way from light to weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeriesTimes {
    /// When its first picture was taken.
    pub first: Instant,
    /// When its last picture was taken.
    pub last: Instant,
    /// When the weights were made of it.
    pub ready: Instant,
}

/// The light of one moment.
#[derive(Clone, Debug, Default)]
pub struct SkyReading {
    /// Radiance per patch and the sun.
    pub weights: PatchWeights,
    /// How the sun in them is known.
    pub sun: SunSource,
    /// Share of the clear-sky beam that comes through, where it is looked for.
    pub sun_share: Option<f64>,
    /// Upper patches filled from a smooth sky because the camera sees too little of them.
    pub filled_patches: usize,
    /// The series that a camera took.
    pub series: Option<SeriesReport>,
    /// Exposures that the light was relit with when it was logged, in order; empty for light that was not.
    pub exposures: Vec<f32>,
    /// When a real camera took the pictures that they rest on.
    pub times: Option<SeriesTimes>,
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

    /// Has `bell` ring whenever there is something newer, so that it need not wait for the next frame's turn. A source that
    /// is only looked at when it is asked has nothing to ring for.
    fn ring(&mut self, _bell: &Bell) {}

    /// The post ends: a thread of its own may, too.
    fn stop(&mut self) {}
}
