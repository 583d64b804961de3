//! What a post tells of itself: its state, in a file and in the journal, and the pictures it shows, when asked.

use super::Post;
use super::behind::Behind;
use crate::clock::Moment;
use crate::health::{Health, ViewState, WELL, WeightsState};
use crate::picture::write_png;
use crate::sky_source::SunSource;
use crate::sky_source::agreement::{disagreement, sun_astray};
use crate::sun::format_utc;
use std::path::PathBuf;
use std::time::Instant;

/// The pictures that are written on demand.
pub(super) const PICTURES: [&str; 2] = ["view", "screenshot"];

/// What someone watching wants to know at once when it changes.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Vital {
    weights: WeightsState,
    sun: SunSource,
    trusted: bool,
    display_in_trouble: bool,
    view: Option<ViewState>,
}

impl Post<'_> {
    pub(super) fn picture_file(&self, name: &str) -> PathBuf {
        self.health_file.with_file_name(name).with_extension("png")
    }

    /// Writes the picture shown as a PNG beside the state, after a live view that is behind it.
    pub(super) fn take_picture(&self) {
        let (width, height) = self.parts.painter.size();
        let view = self.behind.as_ref().map(|_| self.parts.painter.view_bgrx());
        let pictures = PICTURES.into_iter().zip([view, Some(&*self.shown)]);
        for (name, pixels_bgrx) in pictures.filter_map(|(name, pixels)| Some((name, pixels?))) {
            let path = self.picture_file(name);
            match write_png(&path, width, height, pixels_bgrx) {
                Ok(()) => eprintln!("{name}: {}", path.display()),
                Err(error) => eprintln!("{name}: {error}"),
            }
        }
    }

    /// Writes the state when it changed, from time to time, and at the end. A full disk must not stop the picture.
    pub(super) fn tell(&mut self, moment: Moment, last: bool) {
        if !self.is_due && !last {
            return;
        }
        let vital = self.vital(moment);
        let changed = self.told != Some(vital);
        let health = self.health(moment);
        if self.told_state != health.state {
            eprintln!("{} {}", health.time_utc, health.state);
            self.told_state.clone_from(&health.state);
        }
        if let Err(error) = health.write(&self.health_file)
            && changed
        {
            eprintln!("{error}");
        }
        self.told = Some(vital);
        self.told_at = Instant::now();
    }

    pub(super) fn vital(&self, moment: Moment) -> Vital {
        Vital {
            weights: self.weights,
            sun: self.held.sun,
            trusted: moment.trusted,
            display_in_trouble: self.parts.display.trouble().is_some(),
            view: self.behind.as_ref().map(Behind::state),
        }
    }

    pub(super) fn health(&self, moment: Moment) -> Health {
        Health {
            state: self.state(moment),
            frames: self.frames,
            time_utc: format_utc(moment.unix_s),
            clock: self.parts.clock.state(moment),
            sky: self.sky_name,
            colour: self.colour,
            weights: self.weights,
            weights_age_s: self.held_since_unix_s.map_or(0.0, |since| moment.unix_s - since),
            sun: self.held.sun,
            sun_share: self.held.sun_share,
            sky_series: self.held.series,
            filled_patches: self.held.filled_patches,
            sun_azimuth_altitude_deg: self.sun().map(|p| [p.azimuth_deg, p.altitude_deg]),
            exposure_ev: self.exposure.ev(),
            view_gain: self.view_gain,
            sky_faults: self.sky_faults,
            last_fault: self.last_fault.clone(),
            view: self.behind.as_ref().map(Behind::health),
            display: self.parts.display.trouble().map(String::from),
            latency_ms: self.latency.newest_ms,
            latency_worst_ms: self.latency.worst_ms,
            latency_count: self.latency.count,
            latency_parts: self.latency.parts,
            latency_mean_parts: self.latency.mean_parts,
            frame: self.counters,
            totals: self.totals,
            note: self.notes(),
        }
    }

    /// What painter and display want to be known.
    fn notes(&self) -> Option<String> {
        let beyond = match self.counters.tiles_beyond_budget {
            0 => None,
            tiles => Some(format!(
                "{tiles} tiles cannot be held to the error budget; bake with a smaller --error, or allow more"
            )),
        };
        let exposures = self.held.series.and_then(|series| disagreement(series.response_slope, self.has_response));
        let sun = self.held.series.and_then(|series| sun_astray(series.sun_astray_deg));
        let told = [&beyond, &exposures, &sun].map(Option::as_deref);
        let notes = [self.note.as_deref(), self.parts.display.note()].into_iter().chain(told);
        let notes: Vec<&str> = notes.flatten().collect();
        (!notes.is_empty()).then(|| notes.join("; "))
    }

    pub(super) fn state(&self, moment: Moment) -> String {
        let fault = self.last_fault.as_deref().unwrap_or("it gave nothing yet");
        let mut parts = Vec::new();
        match self.weights {
            WeightsState::Fresh => {}
            WeightsState::Held => parts.push(format!("sky fails, last weights held: {fault}")),
            WeightsState::Fading => parts.push(format!("sky fails, the last light fades to a model: {fault}")),
            WeightsState::Modelled => parts.push(format!("sky fails, a model's light stands in: {fault}")),
            WeightsState::StandIn => parts.push(format!("no sky yet, an even one stands in: {fault}")),
        }
        parts.extend(self.behind.as_ref().and_then(Behind::trouble));
        if let Some(trouble) = self.parts.display.trouble() {
            parts.push(format!("display: {trouble}"));
        }
        if !moment.trusted {
            parts.push("clock not trusted, no sun shown".to_string());
        }
        if parts.is_empty() { WELL.into() } else { parts.join("; ") }
    }
}
