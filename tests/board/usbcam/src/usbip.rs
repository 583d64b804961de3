//! USB/IP messages between the kernel's virtual host controller and the camera.
//!
//! Layout as the kernel's `usbip_protocol` document gives it: headers of 48 bytes, every number big-endian; data of an
//! OUT transfer follows the request, data of an IN transfer the answer; an isochronous transfer ends with 16 bytes per
//! packet. The kernel has no handshake of its own: it speaks as soon as it is given the socket.

/// Bytes of a message's header.
pub const HEADER_BYTES: usize = 48;
/// Bytes that describe one isochronous packet.
pub const PACKET_BYTES: usize = 16;
/// Status of an answer: the endpoint stalled (-EPIPE).
pub const STALLED: i32 = -32;
/// Status of an answer: the transfer was taken back (-ECONNRESET).
pub const UNLINKED: i32 = -104;

const CMD_SUBMIT: u32 = 1;
const CMD_UNLINK: u32 = 2;
const RET_SUBMIT: u32 = 3;
const RET_UNLINK: u32 = 4;

/// What the kernel asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// A transfer.
    Submit(Submit),
    /// Takes a transfer back.
    Unlink {
        /// Number of this message.
        seqnum: u32,
        /// Number of the transfer.
        victim: u32,
    },
}

/// A transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Submit {
    /// Number of this message; the answer carries it.
    pub seqnum: u32,
    /// True for data from the camera.
    pub is_in: bool,
    /// Endpoint number.
    pub endpoint: u32,
    /// Bytes of data, or of room for it.
    pub length: u32,
    /// Isochronous packets; meaningless for other transfers.
    pub packets: u32,
    /// The setup packet of a control transfer.
    pub setup: [u8; 8],
}

/// A header that is no request.
#[derive(Debug, thiserror::Error)]
#[error("USB/IP command {0} is unknown; the link is out of step")]
pub struct UnknownCommand(u32);

fn number(header: &[u8; HEADER_BYTES], at: usize) -> u32 {
    u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]])
}

impl Request {
    /// Reads a header.
    ///
    /// # Errors
    /// [`UnknownCommand`] for what is neither a transfer nor an unlink.
    pub fn read(header: &[u8; HEADER_BYTES]) -> Result<Self, UnknownCommand> {
        let seqnum = number(header, 4);
        match number(header, 0) {
            CMD_SUBMIT => {
                let mut setup = [0; 8];
                setup.copy_from_slice(&header[40..48]);
                Ok(Request::Submit(Submit {
                    seqnum,
                    is_in: number(header, 12) == 1,
                    endpoint: number(header, 16),
                    length: number(header, 24),
                    packets: number(header, 32),
                    setup,
                }))
            }
            CMD_UNLINK => Ok(Request::Unlink { seqnum, victim: number(header, 20) }),
            other => Err(UnknownCommand(other)),
        }
    }
}

fn answer(command: u32, seqnum: u32, status: i32) -> [u8; HEADER_BYTES] {
    let mut header = [0; HEADER_BYTES];
    header[0..4].copy_from_slice(&command.to_be_bytes());
    header[4..8].copy_from_slice(&seqnum.to_be_bytes());
    header[20..24].copy_from_slice(&status.to_be_bytes());
    header
}

/// The header that answers a transfer: status (0 or a negative errno), bytes moved, isochronous packets (else 0).
pub fn submitted(seqnum: u32, status: i32, length: u32, packets: u32) -> [u8; HEADER_BYTES] {
    let mut header = answer(RET_SUBMIT, seqnum, status);
    header[24..28].copy_from_slice(&length.to_be_bytes());
    header[32..36].copy_from_slice(&packets.to_be_bytes());
    header
}

/// The header that answers an unlink: [`UNLINKED`] when the transfer was still waiting, 0 when it had been answered.
pub fn unlinked(seqnum: u32, status: i32) -> [u8; HEADER_BYTES] {
    answer(RET_UNLINK, seqnum, status)
}

/// Describes one packet: its place and room in the transfer as asked for, and the bytes it carries.
pub fn packet(offset: u32, room: u32, length: u32) -> [u8; PACKET_BYTES] {
    let mut bytes = [0; PACKET_BYTES];
    bytes[0..4].copy_from_slice(&offset.to_be_bytes());
    bytes[4..8].copy_from_slice(&room.to_be_bytes());
    bytes[8..12].copy_from_slice(&length.to_be_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the kernel's document: an interrupt transfer of 64 bytes from endpoint 1 (its header's 48 bytes).
    const SUBMIT_IN: &str = "00000001 00000d05 0001000f 00000001 00000001 00000200 00000040 ffffffff 00000000 00000004 \
                             0000000000000000";
    /// Its answer: 64 bytes came, status 0.
    const ANSWER_IN: &str = "00000003 00000d05 00000000 00000000 00000000 00000000 00000040 00000000 00000000 00000000 \
                             0000000000000000";

    fn bytes(hex: &str) -> [u8; HEADER_BYTES] {
        let digits: String = hex.chars().filter(|c| !c.is_whitespace()).collect();
        let all: Vec<u8> =
            (0..digits.len() / 2).map(|i| u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).unwrap()).collect();
        all.try_into().unwrap()
    }

    #[test]
    fn the_documents_transfer_is_read_and_answered() {
        let Request::Submit(submit) = Request::read(&bytes(SUBMIT_IN)).unwrap() else { panic!("no transfer") };
        assert_eq!((submit.seqnum, submit.endpoint, submit.is_in), (0xd05, 1, true));
        assert_eq!((submit.length, submit.packets, submit.setup), (64, 0, [0; 8]));
        assert_eq!(submitted(0xd05, 0, 64, 0), bytes(ANSWER_IN));
    }

    #[test]
    fn a_control_transfer_carries_its_setup_packet() {
        let hex = "00000001 00000007 00010002 00000000 00000000 00000000 00000004 00000000 ffffffff 00000000 \
                   2101000400010400";
        let Request::Submit(submit) = Request::read(&bytes(hex)).unwrap() else { panic!("no transfer") };
        assert!(!submit.is_in && submit.endpoint == 0 && submit.length == 4);
        assert_eq!(submit.setup, [0x21, 1, 0, 4, 0, 1, 4, 0]);
    }

    #[test]
    fn unlinks_are_read_and_answered() {
        let hex = "00000002 00000010 00010002 00000000 00000000 0000000f 00000000 00000000 00000000 00000000 \
                   0000000000000000";
        assert_eq!(Request::read(&bytes(hex)).unwrap(), Request::Unlink { seqnum: 16, victim: 15 });
        // -104 = 0xffffff98
        let hex = "00000004 00000010 00000000 00000000 00000000 ffffff98 00000000 00000000 00000000 00000000 \
                   0000000000000000";
        assert_eq!(unlinked(16, UNLINKED), bytes(hex));
        assert!(Request::read(&[0xff; HEADER_BYTES]).is_err());
    }

    #[test]
    fn isochronous_answers_count_their_packets() {
        let header = submitted(1, STALLED, 0x0003_0000, 5);
        assert_eq!(header[20..24], [0xff, 0xff, 0xff, 0xe0]);
        assert_eq!((&header[24..28], &header[32..36]), (&[0, 3, 0, 0][..], &[0, 0, 0, 5][..]));
        assert_eq!(packet(0xc000, 0xc000, 0x1234), [0, 0, 0xc0, 0, 0, 0, 0xc0, 0, 0, 0, 0x12, 0x34, 0, 0, 0, 0]);
    }
}
