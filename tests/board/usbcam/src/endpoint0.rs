//! The control endpoint: standard requests (USB 3.1, chapter 9) and class requests, answered in a thread of their own so that
//! a late answer does not hold up the frames.

use crate::controls::{Answer, ClassRequest, Refusal};
use crate::descriptors::{
    CONTROL_INTERFACE, STREAMING_INTERFACE, capabilities, configuration, device as device_descriptor, string,
};
use crate::device::{ControlTransfer, Device, State};
use crate::link::Wire;
use crate::offer::PROBE_BYTES;
use crate::usbip::{STALLED, submitted};
use std::time::Duration;

const SET_CUR: u8 = 0x01;

/// A setup packet.
#[derive(Clone, Copy, Debug)]
struct Setup {
    kind: u8,
    code: u8,
    value: u16,
    index: u16,
    length: u16,
}

impl Setup {
    fn read(packet: [u8; 8]) -> Self {
        let [kind, code, v0, v1, i0, i1, l0, l1] = packet;
        let [value, index, length] = [[v0, v1], [i0, i1], [l0, l1]].map(u16::from_le_bytes);
        Setup { kind, code, value, index, length }
    }

    fn is_class(&self) -> bool {
        self.kind & 0x60 == 0x20
    }

    fn is_setting_of_a_control(&self) -> bool {
        self.is_class() && self.code == SET_CUR && self.index as u8 == CONTROL_INTERFACE
    }
}

/// What comes of a request: data (empty for a SET), or a stall.
type Reply = Option<Vec<u8>>;

/// Answers control transfers until the link is down.
pub fn serve(device: &Device, wire: &Wire) {
    while let Some((seqnum, delay)) = next(device) {
        std::thread::sleep(delay);
        // Held from taking the transfer to writing its answer: an unlink must find it waiting or answered.
        let mut out = wire.lock();
        let mut state = device.lock();
        let Some(transfer) = state.control_transfers.pop_front_if(|transfer| transfer.seqnum == seqnum) else {
            // The host gave it up meanwhile: it has no effect.
            continue;
        };
        let reply = answer(device, &mut state, &transfer);
        drop(state);
        let written = match reply {
            None => out.send(&submitted(seqnum, STALLED, 0, 0)),
            Some(_) if !transfer.is_in => out.send(&submitted(seqnum, 0, transfer.data.len() as u32, 0)),
            Some(data) => {
                let mut message = submitted(seqnum, 0, data.len() as u32, 0).to_vec();
                message.extend(data);
                out.send(&message)
            }
        };
        if written.is_err() {
            return;
        }
    }
}

/// The oldest transfer's number and how late it is to be answered; none when the link is down.
fn next(device: &Device) -> Option<(u32, Duration)> {
    let mut state = device.lock();
    loop {
        if !state.plugged {
            return None;
        }
        if let Some(transfer) = state.control_transfers.front() {
            let late = Setup::read(transfer.setup).is_setting_of_a_control();
            return Some((transfer.seqnum, if late { state.faults.answer_delay } else { Duration::ZERO }));
        }
        state = device.wait(state);
    }
}

fn answer(device: &Device, state: &mut State, transfer: &ControlTransfer) -> Reply {
    let setup = Setup::read(transfer.setup);
    let reply = match setup.is_class() {
        false => standard(device, state, setup),
        true if setup.index as u8 == STREAMING_INTERFACE => negotiate(state, setup, &transfer.data),
        true => control(device, state, setup, &transfer.data),
    };
    if reply.is_none() && !setup.is_setting_of_a_control() {
        device.log.line(format_args!("stalls request {setup:x?}"));
    }
    reply.map(|mut data| {
        data.truncate(usize::from(setup.length));
        data
    })
}

fn standard(device: &Device, state: &mut State, setup: Setup) -> Reply {
    let (number, nothing) = (setup.value as u8, Some(Vec::new()));
    match (setup.kind, setup.code) {
        // GET_DESCRIPTOR
        (0x80, 6) => match setup.value >> 8 {
            1 => Some(device_descriptor()),
            2 => Some(configuration(&state.offer)),
            3 => string(number),
            15 => Some(capabilities()),
            _ => None,
        },
        // GET_STATUS of the device, of an interface, of an endpoint
        (0x80, 0) => Some(vec![1, 0]),
        (0x81 | 0x82, 0) => Some(vec![0, 0]),
        // GET_CONFIGURATION, GET_INTERFACE
        (0x80, 8) => Some(vec![1]),
        (0x81, 10) => {
            let streams = state.streaming && setup.index == u16::from(STREAMING_INTERFACE);
            Some(vec![u8::from(streams)])
        }
        // SET_INTERFACE: with an endpoint the stream begins, without one it ends
        (0x01, 11) => {
            if setup.index == u16::from(STREAMING_INTERFACE) {
                device.stream(state, setup.value != 0);
            }
            nothing
        }
        // SET_CONFIGURATION, SET_SEL, SET_ISOCH_DELAY, features
        (0x00, 9 | 0x30 | 0x31) | (0x00..=0x02, 1 | 3) => nothing,
        _ => None,
    }
}

/// Probe and commit.
fn negotiate(state: &mut State, setup: Setup, data: &[u8]) -> Reply {
    const PROBE: u16 = 1;
    const COMMIT: u16 = 2;
    let block = |state: &State, choice| Some(state.offer.block(choice).to_vec());
    let at = |state: &State, interval_100ns| crate::offer::Choice { interval_100ns, ..state.probed };
    match (setup.code, setup.value >> 8) {
        (SET_CUR, which @ (PROBE | COMMIT)) => {
            state.probed = state.offer.read(data)?;
            if which == COMMIT {
                state.chosen = state.probed;
            }
            Some(Vec::new())
        }
        (0x81, PROBE) => block(state, state.probed),
        (0x81, COMMIT) => block(state, state.chosen),
        (0x82, PROBE) => block(state, at(state, state.offer.fastest_100ns())),
        (0x83, PROBE) => block(state, at(state, state.offer.slowest_100ns())),
        (0x87, PROBE) => block(state, state.offer.default_choice()),
        (0x85, PROBE | COMMIT) => Some(vec![PROBE_BYTES as u8, 0]),
        (0x86, PROBE | COMMIT) => Some(vec![3]),
        _ => None,
    }
}

fn control(device: &Device, state: &mut State, setup: Setup, data: &[u8]) -> Reply {
    let request =
        ClassRequest { code: setup.code, unit: (setup.index >> 8) as u8, selector: (setup.value >> 8) as u8, data };
    match state.controls.answer(request) {
        Answer::Data(data) => Some(data),
        Answer::Set { control, old, new } => {
            device.log.line(format_args!("set {control:?} {old} -> {new} during frame {}", state.frame));
            Some(Vec::new())
        }
        Answer::Stall(code) => {
            let of_error_code = request.unit == 0 && code == Refusal::InvalidControl as u8;
            if !of_error_code {
                device.log.line(format_args!("refuses request {setup:x?} with code {code}"));
            }
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controls::Control;
    use crate::faults::Faults;
    use crate::log::Log;
    use crate::offer::Offer;
    use crate::sky::Sky;
    use relume::camera::synthetic::SyntheticSettings;

    fn camera() -> Device {
        let settings = SyntheticSettings { width: 16, height: 16, sky_rows: 8, ..SyntheticSettings::default() };
        let sky = Sky::start(settings, 0.0, Duration::from_secs(1));
        let folder = tempfile::tempdir().unwrap();
        let log = Log::open(Some(&folder.path().join("log"))).unwrap();
        Device::new(Offer::new("32x32".parse().unwrap(), 30), Faults::none(2, 1), sky, log)
    }

    fn ask(device: &Device, setup: [u8; 8], data: &[u8]) -> Reply {
        let transfer = ControlTransfer { seqnum: 1, setup, is_in: setup[0] & 0x80 != 0, data: data.to_vec() };
        answer(device, &mut device.lock(), &transfer)
    }

    #[test]
    fn descriptors_are_cut_to_what_is_asked_for() {
        let device = camera();
        assert_eq!(ask(&device, [0x80, 6, 0, 1, 0, 0, 8, 0], &[]).unwrap(), device_descriptor()[..8]);
        assert_eq!(ask(&device, [0x80, 6, 0, 2, 0, 0, 9, 0], &[]).unwrap().len(), 9);
        assert!(ask(&device, [0x80, 6, 0, 6, 0, 0, 10, 0], &[]).is_none(), "no qualifier at super speed");
    }

    #[test]
    fn the_stream_runs_between_the_interfaces_settings() {
        let device = camera();
        let mut block = ask(&device, [0xa1, 0x81, 0, 1, 1, 0, 34, 0], &[]).unwrap();
        block[3] = 2;
        ask(&device, [0x21, 1, 0, 2, 1, 0, 34, 0], &block).unwrap();
        assert!(!device.lock().streaming);
        ask(&device, [0x01, 11, 1, 0, 1, 0, 0, 0], &[]).unwrap();
        assert!(device.lock().streaming);
        assert_eq!(device.lock().size(), "16x16".parse().unwrap());
        ask(&device, [0x01, 11, 0, 0, 1, 0, 0, 0], &[]).unwrap();
        assert!(!device.lock().streaming);
    }

    #[test]
    fn class_requests_reach_the_controls() {
        let device = camera();
        ask(&device, [0x21, 1, 0, 2, 0, 1, 1, 0], &[1]).unwrap();
        ask(&device, [0x21, 1, 0, 4, 0, 1, 4, 0], &[44, 1, 0, 0]).unwrap();
        assert_eq!(device.lock().controls.get(Control::ExposureTime), 300);
        assert_eq!(ask(&device, [0xa1, 0x81, 0, 4, 0, 1, 4, 0], &[]).unwrap(), [44, 1, 0, 0]);
        assert!(ask(&device, [0x21, 1, 0, 4, 0, 1, 4, 0], &[0; 4]).is_none());
    }
}
