//! Time from a camera's picture to its presentation.

use std::time::Duration;

/// The newest, and the worst since the start.
#[derive(Clone, Copy, Default)]
pub(super) struct Latency {
    pub(super) newest_ms: Option<f64>,
    pub(super) worst_ms: Option<f64>,
}

impl Latency {
    pub(super) fn note(&mut self, latency: Duration) {
        let ms = latency.as_secs_f64() * 1e3;
        self.newest_ms = Some(ms);
        self.worst_ms = Some(self.worst_ms.map_or(ms, |worst| worst.max(ms)));
    }
}
