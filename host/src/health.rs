//! The post's state, for people far away: one small JSON file that is always whole.

use crate::outfile::{OutError, write_whole};
use crate::post::LatencyParts;
use crate::relight::{CounterTotals, FrameCounters};
use crate::sky_source::{SeriesReport, SunSource};
use crate::view::gain::ViewGain;
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// The state when there is nothing to do.
pub const WELL: &str = "ok";

/// Where the weights in use come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WeightsState {
    /// Fresh from the sky.
    Fresh,
    /// The sky source fails; the last good weights are held.
    Held,
    /// It has failed for long: the last good weights fade to a model of the last sky by the time of day.
    Fading,
    /// They have faded.
    Modelled,
    /// No good weights yet: an even sky stands in.
    StandIn,
}

impl WeightsState {
    /// Are these not what the sky shows now, though it was seen?
    pub fn is_stale(self) -> bool {
        matches!(self, WeightsState::Held | WeightsState::Fading | WeightsState::Modelled)
    }
}

/// Where the view shown comes from, when it is a live one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewState {
    /// Fresh from its camera.
    Fresh,
    /// The camera fails; its last picture is held.
    Held,
    /// No picture yet: the still, or black, stands in.
    StandIn,
}

/// A live view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewHealth {
    /// Where the view shown comes from.
    pub state: ViewState,
    /// Pictures put behind since the start.
    pub pictures: u64,
    /// Frames in which nothing but a new picture was put behind: the relit layer stayed as it was.
    pub frames_composited: u64,
    /// Times the camera failed since the start.
    pub faults: u64,
    /// The newest fault, in one line.
    pub last_fault: Option<String>,
    /// From the camera's taking of the newest picture to its being shown, ms; `None` where that is not known.
    pub latency_ms: Option<f64>,
    /// The worst of these since the start, ms.
    pub latency_worst_ms: Option<f64>,
}

/// The state of a post.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Health {
    /// `ok`, or what is not, in a few words.
    pub state: String,
    /// Frames shown since the start.
    pub frames: u64,
    /// The post's time, RFC 3339, UTC.
    pub time_utc: String,
    /// Which clock: `system`, `simulated`, or `not trusted`.
    pub clock: &'static str,
    /// Where the light comes from, as in the post's file.
    pub sky: &'static str,
    /// How the sky camera's colours are known: `calibrated`, or `taken for Rec.709`; `none` without a camera.
    pub colour: &'static str,
    /// Where the weights in use come from.
    pub weights: WeightsState,
    /// Seconds since the weights in use were measured, by the post's clock.
    pub weights_age_s: f64,
    /// How the sun is known.
    pub sun: SunSource,
    /// Share of the clear-sky beam that comes through to a camera which the sun saturates.
    pub sun_share: Option<f64>,
    /// Where the sun stands, azimuth and altitude in degrees, when there is one.
    pub sun_azimuth_altitude_deg: Option<[f64; 2]>,
    /// The sky camera's series: its plan, what is missing of it, whether the sky is calm.
    pub sky_series: Option<SeriesReport>,
    /// Patches of the sky of which the camera sees too little; they are filled from a smooth sky.
    pub filled_patches: usize,
    /// Exposure, as EV: radiance x 2^ev.
    pub exposure_ev: f64,
    /// How the view shows the field's receivers, with `exposure.mode = "view"`: where red or blue is far from green, white balance
    /// or `camera.colour` is off; where the scatter is large, pose, lens or scene are.
    pub view_gain: Option<ViewGain>,
    /// Times the sky source failed since the start.
    pub sky_faults: u64,
    /// The newest fault, in one line.
    pub last_fault: Option<String>,
    /// The view, when it is a live one.
    pub view: Option<ViewHealth>,
    /// What keeps pictures from being seen, if anything does.
    pub display: Option<String>,
    /// From the last picture of the sky that the newest light rests on to its being shown, ms; `None` without a camera.
    pub latency_ms: Option<f64>,
    /// The worst of these since the start, ms.
    pub latency_worst_ms: Option<f64>,
    /// How many there were.
    pub latency_count: u64,
    /// Where that time went, and the series' own before it.
    pub latency_parts: Option<LatencyParts>,
    /// The same, mean since the start.
    pub latency_mean_parts: Option<LatencyParts>,
    /// What the newest frame did, what it was spared, and the bound on its error.
    pub frame: FrameCounters,
    /// The same, summed up since the start.
    pub totals: CounterTotals,
    /// Something that is not a fault but should be known, such as a sun outside the field's band.
    pub note: Option<String>,
}

impl Health {
    /// Writes the state; a reader sees the old or the new one, never a part.
    ///
    /// # Errors
    /// [`OutError`] when the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), OutError> {
        write_whole(path, |out| {
            serde_json::to_writer_pretty(&mut *out, self)?;
            out.write_all(b"\n")
        })
    }
}
