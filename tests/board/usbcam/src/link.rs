//! The cable: a socket pair, one end the kernel's, and the threads that answer at the other.

use crate::descriptors::STREAM_ENDPOINT;
use crate::device::{ControlTransfer, Device, StreamTransfer};
use crate::log::Log;
use crate::settings::Automatic;
use crate::usbip::{HEADER_BYTES, PACKET_BYTES, Request, Submit, UNLINKED, UnknownCommand, unlinked};
use crate::vhci::{self, Port, VhciError};
use crate::{endpoint0, stream};
use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// Largest transfer that is taken, bytes.
const MAX_TRANSFER: u32 = 16 << 20;

/// Why the cable could not be plugged or unplugged, or broke; one line.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The host controller.
    #[error(transparent)]
    Vhci(#[from] VhciError),
    /// The socket.
    #[error("the link to the kernel: {0}")]
    Socket(#[from] std::io::Error),
    /// A message that is none.
    #[error(transparent)]
    Command(#[from] UnknownCommand),
    /// A transfer that the camera has no place for.
    #[error("a transfer of {length} bytes for endpoint {endpoint}: the camera has none like it")]
    Transfer {
        /// Endpoint asked for.
        endpoint: u32,
        /// Its bytes.
        length: u32,
    },
}

/// The sending side of the link.
pub struct Wire(Mutex<Sender>);

/// Holds the wire: messages of several threads go out whole and in the order of their decisions.
pub struct Sender(UnixStream);

impl Wire {
    /// The wire, for as long as the guard lives; take it before the device's state, never after.
    pub fn lock(&self) -> MutexGuard<'_, Sender> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Sender {
    /// Sends a message.
    ///
    /// # Errors
    /// What the socket says; the link is down then.
    pub fn send(&mut self, message: &[u8]) -> std::io::Result<()> {
        self.0.write_all(message)
    }
}

/// A camera that is plugged in.
pub struct Plugged {
    port: Port,
    socket: UnixStream,
    threads: Vec<JoinHandle<()>>,
}

impl Plugged {
    /// Plugs the camera in, its controls at their defaults.
    ///
    /// # Errors
    /// [`LinkError`] where the kernel does not take it.
    pub fn plug(device: &Arc<Device>, mut sensor: stream::Sensor) -> Result<Self, LinkError> {
        let (ours, kernels) = UnixStream::pair()?;
        reset(device);
        let wire = Arc::new(Wire(Mutex::new(Sender(ours.try_clone()?))));
        let reader = ours.try_clone()?;
        let (d, w) = (Arc::clone(device), Arc::clone(&wire));
        let receiving = std::thread::spawn(move || receive(&d, &w, reader));
        let (d, w) = (Arc::clone(device), Arc::clone(&wire));
        let answering = std::thread::spawn(move || endpoint0::serve(&d, &w));
        let (d, w) = (Arc::clone(device), wire);
        let exposing = std::thread::spawn(move || sensor.run(&d, &w));
        let mut plugged = Plugged { port: Port(0), socket: ours, threads: vec![receiving, answering, exposing] };
        match vhci::attach(&kernels) {
            Ok(port) => plugged.port = port,
            Err(error) => {
                plugged.hang_up()?;
                return Err(error.into());
            }
        }
        device.log.line(format_args!("plugged at port {}", plugged.port.0));
        // Our copy of the kernel's end is dropped here: it would hide the kernel's hanging up.
        Ok(plugged)
    }

    /// Ends the link as a pulled cable does; returns when the kernel has let go of the port.
    ///
    /// # Errors
    /// [`LinkError`] where it does not.
    pub fn cut(self, log: &Log) -> Result<(), LinkError> {
        log.line("cut");
        let port = self.port;
        self.hang_up()?;
        vhci::wait_until_free(port)?;
        log.line(format_args!("port {} is free", port.0));
        Ok(())
    }

    /// Has the kernel unplug the camera.
    ///
    /// # Errors
    /// [`LinkError`] where it does not.
    pub fn detach(self, log: &Log) -> Result<(), LinkError> {
        log.line("detach");
        vhci::detach(self.port)?;
        self.cut(log)
    }

    fn hang_up(self) -> std::io::Result<()> {
        // The kernel may have hung up already.
        let _ = self.socket.shutdown(Shutdown::Both);
        self.threads.into_iter().for_each(|thread| drop(thread.join()));
        Ok(())
    }
}

/// What a real camera forgets without power.
fn reset(device: &Device) {
    let mut state = device.lock();
    let refuse = state.controls.refuse;
    state.controls = Default::default();
    state.controls.refuse = refuse;
    state.automatic = Automatic::default();
    if let Some(offer) = state.offer_at_plug.take() {
        state.offer = offer;
    }
    state.probed = state.offer.default_choice();
    state.chosen = state.probed;
    state.faults.frozen_until = None;
    state.control_transfers.clear();
    state.stream_transfers.clear();
    state.plugged = true;
}

fn receive(device: &Device, wire: &Wire, socket: UnixStream) {
    let ended = read_requests(device, wire, socket);
    let mut state = device.lock();
    device.stream(&mut state, false);
    state.plugged = false;
    match ended {
        Err(LinkError::Socket(_)) | Ok(()) => device.log.line("link down"),
        Err(error) => device.log.line(format_args!("link down: {error}")),
    }
    device.tell();
}

fn read_requests(device: &Device, wire: &Wire, mut socket: UnixStream) -> Result<(), LinkError> {
    let mut header = [0; HEADER_BYTES];
    let mut packets = Vec::new();
    loop {
        socket.read_exact(&mut header)?;
        match Request::read(&header)? {
            Request::Submit(submit) => take(device, submit, &mut socket, &mut packets)?,
            Request::Unlink { seqnum, victim } => {
                let mut out = wire.lock();
                let waited = take_back(device, victim);
                out.send(&unlinked(seqnum, if waited { UNLINKED } else { 0 }))?;
            }
        }
    }
}

fn take(device: &Device, submit: Submit, socket: &mut UnixStream, packets: &mut Vec<u8>) -> Result<(), LinkError> {
    let Submit { seqnum, is_in, endpoint, length, .. } = submit;
    let is_stream = endpoint == u32::from(STREAM_ENDPOINT) && is_in;
    if length > MAX_TRANSFER || !(endpoint == 0 || is_stream) || (is_stream && submit.packets > 1024) {
        return Err(LinkError::Transfer { endpoint, length });
    }
    if is_stream {
        // Each packet's place; they are all alike and lie side by side.
        packets.resize(submit.packets as usize * PACKET_BYTES, 0);
        socket.read_exact(packets)?;
        device.lock().stream_transfers.push_back(StreamTransfer { seqnum, packets: submit.packets });
    } else {
        let mut data = vec![0; if is_in { 0 } else { length as usize }];
        socket.read_exact(&mut data)?;
        let transfer = ControlTransfer { seqnum, setup: submit.setup, is_in, data };
        device.lock().control_transfers.push_back(transfer);
    }
    device.tell();
    Ok(())
}

/// Takes a transfer back if it still waits.
fn take_back(device: &Device, victim: u32) -> bool {
    let mut state = device.lock();
    let waiting = state.stream_transfers.len() + state.control_transfers.len();
    state.stream_transfers.retain(|transfer| transfer.seqnum != victim);
    state.control_transfers.retain(|transfer| transfer.seqnum != victim);
    state.stream_transfers.len() + state.control_transfers.len() < waiting
}
