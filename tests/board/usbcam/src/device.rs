//! The camera's state, shared by the threads of its link.

use crate::controls::Controls;
use crate::faults::Faults;
use crate::log::Log;
use crate::offer::{Choice, FrameSize, Offer};
use crate::settings::{Automatic, Settings};
use crate::sky::Sky;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A control transfer that waits for its answer.
#[derive(Clone, Debug)]
pub struct ControlTransfer {
    /// Number of the message.
    pub seqnum: u32,
    /// Setup packet.
    pub setup: [u8; 8],
    /// True for data from the camera.
    pub is_in: bool,
    /// Data from the host.
    pub data: Vec<u8>,
}

/// Room for a frame's data: a transfer that waits on the streaming endpoint.
#[derive(Clone, Copy, Debug)]
pub struct StreamTransfer {
    /// Number of the message.
    pub seqnum: u32,
    /// Packets of [`crate::descriptors::PACKET_BYTES`].
    pub packets: u32,
}

/// What changes while the camera runs.
#[derive(Debug)]
pub struct State {
    /// Controls.
    pub controls: Controls,
    /// Automatic exposure and white balance.
    pub automatic: Automatic,
    /// Faults.
    pub faults: Faults,
    /// What is offered since the last plug.
    pub offer: Offer,
    /// What is offered from the next plug on.
    pub offer_at_plug: Option<Offer>,
    /// What the host asks about.
    pub probed: Choice,
    /// What it has decided on.
    pub chosen: Choice,
    /// Whether the link is up.
    pub plugged: bool,
    /// Whether the host wants frames.
    pub streaming: bool,
    /// Changes with every start and stop of the stream.
    pub epoch: u64,
    /// Control transfers, oldest first.
    pub control_transfers: VecDeque<ControlTransfer>,
    /// Stream transfers, oldest first.
    pub stream_transfers: VecDeque<StreamTransfer>,
    /// Number of the frame that is exposed now; counts on over streams and plugs.
    pub frame: u64,
    /// Frames sent.
    pub sent: u64,
    /// Time that the last frame took to render.
    pub render_time: Duration,
}

impl State {
    /// What stands now.
    pub fn settings(&self) -> Settings {
        self.automatic.settings(&self.controls)
    }

    /// Size of the stream's pictures.
    pub fn size(&self) -> FrameSize {
        self.offer.size(self.chosen)
    }
}

/// The camera.
pub struct Device {
    state: Mutex<State>,
    changed: Condvar,
    /// Where changes are written.
    pub log: Log,
    /// What is above the sensor.
    pub sky: Sky,
}

impl Device {
    /// An unplugged camera.
    pub fn new(offer: Offer, faults: Faults, sky: Sky, log: Log) -> Self {
        let choice = offer.default_choice();
        let state = State {
            controls: Controls::default(),
            automatic: Automatic::default(),
            faults,
            offer,
            offer_at_plug: None,
            probed: choice,
            chosen: choice,
            plugged: false,
            streaming: false,
            epoch: 0,
            control_transfers: VecDeque::new(),
            stream_transfers: VecDeque::new(),
            frame: 0,
            sent: 0,
            render_time: Duration::ZERO,
        };
        Device { state: Mutex::new(state), changed: Condvar::new(), log, sky }
    }

    /// The state.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells all threads that the state has changed.
    pub fn tell(&self) {
        self.changed.notify_all();
    }

    /// Waits for a change.
    pub fn wait<'a>(&'a self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed.wait(state).unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a change, or this long.
    pub fn wait_for<'a>(&'a self, state: MutexGuard<'a, State>, longest: Duration) -> MutexGuard<'a, State> {
        self.changed.wait_timeout(state, longest).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Begins or ends the stream.
    pub fn stream(&self, state: &mut State, on: bool) {
        if state.streaming == on {
            return;
        }
        state.streaming = on;
        state.epoch += 1;
        let size = state.size();
        self.sky.want(on.then_some(size));
        let interval_ms = f64::from(state.chosen.interval_100ns) * 1e-4;
        match on {
            true => self.log.line(format_args!("stream on: {size}, {interval_ms:.1} ms per frame")),
            false => self.log.line(format_args!("stream off: frame {}, {} sent", state.frame, state.sent)),
        }
        self.tell();
    }
}
