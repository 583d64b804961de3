//! Time from a camera's picture to its being seen on the display, which a display may tell some frames later.

use crate::sky_source::SeriesTimes;
use serde::Serialize;
use std::time::Instant;

/// Where the time goes from light to pixel, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencyParts {
    /// From the first picture of the exposure series to the last.
    pub bracket_ms: f64,
    /// From the last picture to the weights: the frame's way to the program, merge, weights.
    pub weights_ms: f64,
    /// From the weights to the picture handed to the display: the wait for the next frame's turn, relight, composite.
    pub relight_ms: f64,
    /// From there to the display's own word that it is shown: the way into its memory, and the wait for its refresh.
    pub display_ms: f64,
}

impl LatencyParts {
    fn each(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        LatencyParts {
            bracket_ms: of(self.bracket_ms, other.bracket_ms),
            weights_ms: of(self.weights_ms, other.weights_ms),
            relight_ms: of(self.relight_ms, other.relight_ms),
            display_ms: of(self.display_ms, other.display_ms),
        }
    }
}

/// A picture on its way to the display.
#[derive(Clone, Copy)]
struct Queued {
    frame: u64,
    taken: Instant,
    series: Option<SeriesTimes>,
    at: Instant,
}

/// The newest, and the worst since the start.
#[derive(Clone, Copy, Default)]
pub(super) struct Latency {
    pub(super) newest_ms: Option<f64>,
    pub(super) worst_ms: Option<f64>,
    pub(super) parts: Option<LatencyParts>,
    pub(super) mean_parts: Option<LatencyParts>,
    pub(super) count: u64,
    queued: Option<Queued>,
}

impl Latency {
    /// A frame with a picture in it that was taken at `taken` was handed to the display at `at`.
    pub(super) fn queue(&mut self, frame: u64, taken: Instant, at: Instant) {
        self.queued = Some(Queued { frame, taken, series: None, at });
    }

    /// The same with the light of a series.
    pub(super) fn queue_series(&mut self, frame: u64, series: SeriesTimes, at: Instant) {
        self.queued = Some(Queued { frame, taken: series.last, series: Some(series), at });
    }

    /// Asks the display when the picture on its way was shown, if one is.
    pub(super) fn ask(&mut self, when_shown: impl FnOnce(u64) -> Option<Instant>) {
        if let Some(queued) = self.queued
            && let Some(shown) = when_shown(queued.frame)
        {
            self.queued = None;
            self.note(&queued, shown);
        }
    }

    fn note(&mut self, queued: &Queued, shown: Instant) {
        let ms = ms_between(queued.taken, shown);
        self.newest_ms = Some(ms);
        self.worst_ms = Some(self.worst_ms.map_or(ms, |worst| worst.max(ms)));
        let Some(series) = queued.series else { return };
        let parts = LatencyParts {
            bracket_ms: ms_between(series.first, series.last),
            weights_ms: ms_between(series.last, series.ready),
            relight_ms: ms_between(series.ready, queued.at),
            display_ms: ms_between(queued.at, shown),
        };
        self.parts = Some(parts);
        self.count += 1;
        let share = 1.0 / self.count as f64;
        let mean = self.mean_parts.unwrap_or_default();
        self.mean_parts = Some(mean.each(parts, |mean, new| mean + (new - mean) * share));
    }
}

fn ms_between(from: Instant, to: Instant) -> f64 {
    to.saturating_duration_since(from).as_secs_f64() * 1e3
}
