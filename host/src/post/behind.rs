//! What is behind the picture, when that is live: the newest picture of the view, and how its camera is.

use super::Post;
use super::latency::Latency;
use crate::health::{ViewHealth, ViewState};
use crate::view::live::{ViewPicture, ViewSource};
use std::time::Instant;

/// A live view.
pub(super) struct Behind<'p> {
    source: Box<dyn ViewSource + 'p>,
    /// Goes to and fro between source and painter; its time is that of the picture shown.
    picture: ViewPicture,
    state: ViewState,
    /// Is there a picture that was not presented yet?
    is_new: bool,
    pictures: u64,
    frames_composited: u64,
    faults: u64,
    last_fault: Option<String>,
    pub(super) latency: Latency,
}

impl<'p> Behind<'p> {
    pub(super) fn new(source: Box<dyn ViewSource + 'p>) -> Self {
        Behind {
            source,
            picture: ViewPicture::default(),
            state: ViewState::StandIn,
            is_new: false,
            pictures: 0,
            frames_composited: 0,
            faults: 0,
            last_fault: None,
            latency: Latency::default(),
        }
    }

    /// The post ends.
    pub(super) fn stop(&mut self) {
        self.source.stop();
    }

    /// Is there a picture that was not presented yet?
    pub(super) fn is_new(&self) -> bool {
        self.is_new
    }

    pub(super) fn state(&self) -> ViewState {
        self.state
    }

    /// A frame that drew so many tiles was handed to the display at this time.
    pub(super) fn queue(&mut self, frame: u64, tiles_drawn: usize, at: Instant) {
        if !std::mem::take(&mut self.is_new) {
            return;
        }
        self.frames_composited += u64::from(tiles_drawn == 0);
        if let Some(taken) = self.picture.taken {
            self.latency.queue(frame, taken, at);
        }
    }

    /// What is wrong, in a few words.
    pub(super) fn trouble(&self) -> Option<String> {
        let fault = self.last_fault.as_deref().unwrap_or("it gave nothing yet");
        match self.state {
            ViewState::Fresh => None,
            ViewState::Held => Some(format!("view fails, last picture held: {fault}")),
            ViewState::StandIn => Some(format!("no view yet: {fault}")),
        }
    }

    pub(super) fn health(&self) -> ViewHealth {
        ViewHealth {
            state: self.state,
            pictures: self.pictures,
            frames_composited: self.frames_composited,
            faults: self.faults,
            last_fault: self.last_fault.clone(),
            latency_ms: self.latency.newest_ms,
            latency_worst_ms: self.latency.worst_ms,
        }
    }
}

impl Post<'_> {
    /// Puts the view's newest picture behind; without one the last stays.
    pub(super) fn look_behind(&mut self) {
        let Some(behind) = &mut self.behind else { return };
        match behind.source.read(&mut behind.picture) {
            Ok(false) => {}
            Ok(true) => {
                self.parts.painter.show_view(&mut behind.picture.pixels_bgrx);
                behind.state = ViewState::Fresh;
                behind.is_new = true;
                behind.pictures += 1;
            }
            Err(fault) => {
                behind.faults += 1;
                behind.last_fault = Some(fault.to_string());
                if behind.state == ViewState::Fresh {
                    behind.state = ViewState::Held;
                }
            }
        }
    }
}
