//! A frame as answers to isochronous transfers: payloads of 12 bytes of header and as much of the picture as a packet holds.

use crate::descriptors::PACKET_BYTES;
use crate::device::StreamTransfer;
use crate::usbip::{HEADER_BYTES, packet, submitted};

/// Bytes of a payload's header; time stamps are left out, their room stays.
const PAYLOAD_HEADER: usize = 12;
/// Picture bytes of a packet.
const ROOM: usize = PACKET_BYTES as usize - PAYLOAD_HEADER;

const FRAME_ID: u8 = 0x01;
const END_OF_FRAME: u8 = 0x02;
const ERROR: u8 = 0x40;
const END_OF_HEADER: u8 = 0x80;

/// What the payload headers of a frame say.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameMarks {
    /// The frame id: one bit that differs from frame to frame, else the driver takes two for one.
    pub id: bool,
    /// The error bit.
    pub error: bool,
}

impl FrameMarks {
    fn bits(self, last: bool) -> u8 {
        let bit = |set: bool, bit: u8| if set { bit } else { 0 };
        END_OF_HEADER | bit(self.id, FRAME_ID) | bit(self.error, ERROR) | bit(last, END_OF_FRAME)
    }
}

/// Writes the answer to a transfer into `message` with the next part of a picture; returns what is left of it.
///
/// The packets' data follow each other without gaps, then comes the list of packets: places as asked for, lengths as filled.
pub fn answer<'a>(
    transfer: StreamTransfer,
    marks: FrameMarks,
    mut picture: &'a [u8],
    message: &mut Vec<u8>,
) -> &'a [u8] {
    message.clear();
    message.resize(HEADER_BYTES, 0);
    let before = picture.len();
    for _ in 0..transfer.packets {
        if picture.is_empty() {
            break;
        }
        let (part, rest) = picture.split_at(ROOM.min(picture.len()));
        let mut header = [0; PAYLOAD_HEADER];
        (header[0], header[1]) = (PAYLOAD_HEADER as u8, marks.bits(rest.is_empty()));
        message.extend_from_slice(&header);
        message.extend_from_slice(part);
        picture = rest;
    }
    let length = message.len() - HEADER_BYTES;
    let mut left = before - picture.len();
    for number in 0..transfer.packets {
        let part = left.min(ROOM);
        left -= part;
        let filled = if part > 0 { part + PAYLOAD_HEADER } else { 0 };
        message.extend_from_slice(&packet(number * u32::from(PACKET_BYTES), u32::from(PACKET_BYTES), filled as u32));
    }
    message[..HEADER_BYTES].copy_from_slice(&submitted(transfer.seqnum, 0, length as u32, transfer.packets));
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    fn be(bytes: &[u8], at: usize) -> usize {
        u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
    }

    #[test]
    fn a_frame_fills_its_packets_and_ends_in_the_last() {
        let picture: Vec<u8> = (0..100_000u32).map(|i| (i % 251) as u8).collect();
        let mut message = Vec::new();
        let marks = FrameMarks { id: true, error: false };
        let left = answer(StreamTransfer { seqnum: 9, packets: 4 }, marks, &picture, &mut message);
        assert!(left.is_empty());
        // 49 140 + 49 140 + 1 720 bytes of picture, 12 of header each, and 4 packets' descriptions.
        let length = 100_000 + 3 * 12;
        assert_eq!((be(&message, 24), be(&message, 32)), (length, 4));
        assert_eq!(message.len(), 48 + length + 4 * 16);
        let data = &message[48..48 + length];
        assert_eq!((data[0], data[1]), (12, 0x81));
        assert_eq!(data[49_152 + 1], 0x81);
        assert_eq!(data[2 * 49_152 + 1], 0x83, "end of frame");
        assert_eq!(data[12..49_152], picture[..49_140]);
        assert_eq!(data[2 * 49_152 + 12..], picture[98_280..]);
        let packets = &message[48 + length..];
        let lengths: Vec<usize> = (0..4).map(|i| be(packets, 16 * i + 8)).collect();
        assert_eq!(lengths, [49_152, 49_152, 1_732, 0]);
        assert_eq!((be(packets, 16), be(packets, 20)), (49_152, 49_152));
        assert_eq!(lengths.iter().sum::<usize>(), length);
    }

    #[test]
    fn a_frame_too_large_for_a_transfer_goes_on_in_the_next() {
        let picture = vec![7; 60_000];
        let mut message = Vec::new();
        let marks = FrameMarks { id: false, error: true };
        let transfer = StreamTransfer { seqnum: 1, packets: 1 };
        let left = answer(transfer, marks, &picture, &mut message);
        assert_eq!((left.len(), message[49]), (60_000 - 49_140, 0xc0));
        assert!(answer(transfer, marks, left, &mut message).is_empty());
        assert_eq!(message[49], 0xc2);
    }
}
