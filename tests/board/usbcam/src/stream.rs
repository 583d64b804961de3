//! The sensor's own time: it exposes frame after frame while the host streams, and sends each when its time is over.
//!
//! A frame takes its interval or its exposure time, whichever is longer. A sensor that is late (its processor is shared with
//! the program under test) takes the next frame later: it never skips one, so counts of frames do not depend on load.

use crate::controls::Control;
use crate::device::{Device, State, StreamTransfer};
use crate::faults::FrameFaults;
use crate::link::Wire;
use crate::log::monotonic_s;
use crate::payload::{FrameMarks, answer};
use crate::picture::{Renderer, render_black};
use crate::settings::{Delay, Settings};
use crate::sky::SkyPicture;
use std::sync::MutexGuard;
use std::time::{Duration, Instant};

/// Bytes of the truth that is written over a frame's first pixels on demand.
pub const STAMP_BYTES: usize = 32;
/// What a stamp begins with.
pub const STAMP_MARK: &[u8; 4] = b"RSKY";
/// Oldest sky that a stream begins with, real seconds, and the wait for a newer one.
const OLDEST_SKY_S: f64 = 1.0;
const SKY_PATIENCE: Duration = Duration::from_secs(3);

/// The sensor of a plugged camera.
pub struct Sensor {
    renderer: Renderer,
    stamped: bool,
    delay: Delay,
    /// The last settings and sky that were logged.
    logged: Option<(Settings, f64)>,
    id: bool,
    picture: Vec<u8>,
    message: Vec<u8>,
}

/// A frame that is exposed.
struct Exposed {
    number: u64,
    settings: Settings,
    begun_s: f64,
}

impl Sensor {
    /// A sensor; `stamped` frames carry their truth in their first 32 bytes, in a corner that the lens leaves black.
    pub fn new(renderer: Renderer, stamped: bool) -> Self {
        Sensor {
            renderer,
            stamped,
            delay: Delay::default(),
            logged: None,
            id: false,
            picture: Vec::new(),
            message: Vec::new(),
        }
    }

    /// Streams whenever the host wants to, until the link is down.
    pub fn run(&mut self, device: &Device, wire: &Wire) {
        loop {
            let epoch = {
                let mut state = device.lock();
                while state.plugged && !state.streaming {
                    state = device.wait(state);
                }
                if !state.plugged {
                    return;
                }
                state.epoch
            };
            self.stream(device, wire, epoch);
        }
    }

    /// Frames until the stream's epoch is over.
    fn stream(&mut self, device: &Device, wire: &Wire, epoch: u64) {
        let size = device.lock().size();
        let oldest_s = OLDEST_SKY_S * device.sky.clock().speed().abs().max(1.0);
        let mut sky = device.sky.fresh(size, oldest_s, SKY_PATIENCE);
        self.delay = Delay::default();
        let mut start = Instant::now();
        loop {
            let frame = self.start_frame(device, &sky);
            let rendering = Instant::now();
            self.render(device, &sky, &frame);
            let rendered = rendering.elapsed();
            let Some(mut state) = self.finish_exposure(device, epoch, &frame, &mut start) else { return };
            state.render_time = rendered;
            let faults = state.faults.next_frame();
            drop(state);
            if !faults.lost && !self.send(device, wire, epoch, faults) {
                return;
            }
            sky = device.sky.picture();
            if sky.size != size {
                sky = device.sky.fresh(size, f64::INFINITY, SKY_PATIENCE);
            }
        }
    }

    fn start_frame(&mut self, device: &Device, sky: &SkyPicture) -> Exposed {
        let mut state = device.lock();
        state.frame += 1;
        let latency = state.faults.latency;
        let settings = self.delay.start_frame(state.settings(), latency);
        let (number, known) = (state.frame, self.logged);
        drop(state);
        if known.is_none_or(|(logged, _)| logged != settings) {
            device.log.line(format_args!("frame {number} first with {settings}"));
        }
        if known.is_none_or(|(_, unix_s)| unix_s != sky.unix_s) {
            let utc = relume::sun::format_utc(sky.unix_s);
            device.log.line(format_args!("frame {number} first with sky {:.1} {utc}", sky.unix_s));
        }
        self.logged = Some((settings, sky.unix_s));
        Exposed { number, settings, begun_s: monotonic_s() }
    }

    fn render(&mut self, device: &Device, sky: &SkyPicture, frame: &Exposed) {
        let (stuck, black, noise) = {
            let faults = &device.lock().faults;
            (faults.stuck, faults.black, faults.noise)
        };
        let size = sky.size.bytes() as usize;
        if stuck && self.picture.len() == size {
            return;
        }
        self.picture.resize(size, 0);
        if black {
            render_black(&mut self.picture);
        } else if noise {
            self.renderer.render_noise(frame.number, &mut self.picture);
        } else {
            self.renderer.render(sky, frame.settings, frame.number, &mut self.picture);
            if self.stamped {
                stamp(frame, sky.unix_s, &mut self.picture);
            }
        }
    }

    /// Waits for the end of the frame and lets automatic exposure see it; none when the stream is over.
    fn finish_exposure<'a>(
        &mut self,
        device: &'a Device,
        epoch: u64,
        frame: &Exposed,
        start: &mut Instant,
    ) -> Option<MutexGuard<'a, State>> {
        let mut state = device.lock();
        let interval_100us = f64::from(state.chosen.interval_100ns) * 1e-3;
        let exposed = Duration::from_micros(100 * u64::from(frame.settings.exposure_100us));
        let end = *start + exposed.max(Duration::from_nanos(100 * u64::from(state.chosen.interval_100ns)));
        loop {
            if !state.plugged || state.epoch != epoch {
                return None;
            }
            let until = state.faults.frozen_until.map_or(end, |until| until.max(end));
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            state = device.wait_for(state, left);
        }
        state.faults.frozen_until = None;
        // Small delays of the sleep do not add up; a frame's worth of them is time lost.
        *start = if end.elapsed() > Duration::from_millis(10) { Instant::now() } else { end };
        // The camera sees what it chose only when the latency is over.
        if frame.number.is_multiple_of(state.faults.latency as u64 + 2) {
            // Without priority, frames keep their interval; with it they may take up to a second.
            let may_slow_down = state.controls.get(Control::ExposurePriority) == 1;
            let longest_100us = if may_slow_down { 10_000.0 } else { interval_100us };
            let State { automatic, controls, .. } = &mut *state;
            automatic.see(&self.picture, controls, longest_100us);
        }
        Some(state)
    }

    /// Sends the picture; false when the stream is over.
    fn send(&mut self, device: &Device, wire: &Wire, epoch: u64, faults: FrameFaults) -> bool {
        self.id = !self.id;
        let marks = FrameMarks { id: self.id, error: faults.error };
        let share = if faults.short { self.picture.len() / 2 } else { self.picture.len() };
        let mut left = &self.picture[..share];
        while !left.is_empty() {
            if !wait_for_room(device, epoch) {
                return false;
            }
            let mut out = wire.lock();
            let Some(transfer) = take_transfer(device) else { continue };
            left = answer(transfer, marks, left, &mut self.message);
            if out.send(&self.message).is_err() {
                return false;
            }
        }
        device.lock().sent += 1;
        true
    }
}

fn wait_for_room(device: &Device, epoch: u64) -> bool {
    let mut state = device.lock();
    loop {
        if !state.plugged || state.epoch != epoch {
            return false;
        }
        if !state.stream_transfers.is_empty() {
            return true;
        }
        state = device.wait(state);
    }
}

fn take_transfer(device: &Device) -> Option<StreamTransfer> {
    device.lock().stream_transfers.pop_front()
}

/// Writes over a picture's first 32 bytes, little endian: mark, frame number (u32), exposure (100 us, u32), gain (u16),
/// temperature (K, u16), time of the sky (unix s, f64), start of the exposure (CLOCK_MONOTONIC s, f64).
fn stamp(frame: &Exposed, sky_unix_s: f64, picture: &mut [u8]) {
    let Some(place) = picture.first_chunk_mut::<STAMP_BYTES>() else { return };
    place[0..4].copy_from_slice(STAMP_MARK);
    place[4..8].copy_from_slice(&(frame.number as u32).to_le_bytes());
    place[8..12].copy_from_slice(&frame.settings.exposure_100us.to_le_bytes());
    place[12..14].copy_from_slice(&(frame.settings.gain as u16).to_le_bytes());
    place[14..16].copy_from_slice(&(frame.settings.temperature_k as u16).to_le_bytes());
    place[16..24].copy_from_slice(&sky_unix_s.to_le_bytes());
    place[24..32].copy_from_slice(&frame.begun_s.to_le_bytes());
}
