//! What the camera says it is: the descriptors of a super-speed USB video camera (USB 3.1 chapter 9, UVC 1.1) with one
//! uncompressed format and an isochronous endpoint.

use crate::offer::Offer;

/// Number of the video control interface.
pub const CONTROL_INTERFACE: u8 = 0;
/// Number of the video streaming interface.
pub const STREAMING_INTERFACE: u8 = 1;
/// Unit number of the camera terminal.
pub const CAMERA_TERMINAL: u8 = 1;
/// Unit number of the processing unit.
pub const PROCESSING_UNIT: u8 = 2;
/// Unit number of the output terminal.
pub const OUTPUT_TERMINAL: u8 = 3;
/// Number of the streaming endpoint.
pub const STREAM_ENDPOINT: u8 = 1;
/// Bytes of an isochronous packet: 3 bursts of 16 times 1024, the most that super speed has in one service interval.
pub const PACKET_BYTES: u16 = 48 * 1024;
/// Clock of the device, Hz.
pub const CLOCK_HZ: u32 = 48_000_000;
/// The camera's name; V4L2 shows it as the card's.
pub const PRODUCT: &str = "Relume Sky Camera";

const CS_INTERFACE: u8 = 0x24;
/// YUY2, as the format's GUID.
const YUY2: [u8; 16] = [0x59, 0x55, 0x59, 0x32, 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71];
/// Automatic exposure mode, its priority, exposure time absolute.
const TERMINAL_CONTROLS: [u8; 3] = [0b1110, 0, 0];
/// White balance temperature (6), gain (9), white balance temperature automatic (12).
const UNIT_CONTROLS: u16 = 1 << 6 | 1 << 9 | 1 << 12;

/// A descriptor: its length comes first.
fn descriptor(kind: u8, parts: &[&[u8]]) -> Vec<u8> {
    let mut bytes = vec![0, kind];
    parts.iter().for_each(|part| bytes.extend_from_slice(part));
    bytes[0] = bytes.len() as u8;
    bytes
}

/// The device.
pub fn device() -> Vec<u8> {
    let (usb_3_0, vendor, product, release) = (0x0300u16, 0x1d6bu16, 0x0102u16, 0x0100u16);
    let ids = [usb_3_0.to_le_bytes(), vendor.to_le_bytes(), product.to_le_bytes(), release.to_le_bytes()];
    // Class: several interfaces that an association groups. Packets of endpoint 0: 2^9 bytes. Three strings, one setting.
    descriptor(1, &[&ids[0], &[0xef, 2, 1, 9], &ids[1], &ids[2], &ids[3], &[1, 2, 3, 1]])
}

/// What super speed asks of the device beyond its configuration.
pub fn capabilities() -> Vec<u8> {
    let usb_2_extension = descriptor(16, &[&[2, 0, 0, 0, 0]]);
    let super_speed = descriptor(16, &[&[3, 0, 0x0e, 0, 1, 0, 0, 0]]);
    let total = 5 + usb_2_extension.len() + super_speed.len();
    let mut bytes = descriptor(15, &[&(total as u16).to_le_bytes(), &[2]]);
    bytes.extend(usb_2_extension);
    bytes.extend(super_speed);
    bytes
}

/// A string by its number, UTF-16; number 0 lists the languages.
pub fn string(number: u8) -> Option<Vec<u8>> {
    let text = match number {
        0 => return Some(descriptor(3, &[&0x0409u16.to_le_bytes()])),
        1 => "Relume",
        2 => PRODUCT,
        3 => "SKY0001",
        _ => return None,
    };
    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    Some(descriptor(3, &[&units]))
}

/// The configuration with everything in it.
pub fn configuration(offer: &Offer) -> Vec<u8> {
    let mut body = descriptor(11, &[&[CONTROL_INTERFACE, 2, 14, 3, 0, 2]]);
    body.extend(control_interface());
    body.extend(streaming_interface(offer));
    let total = 9 + body.len() as u16;
    let mut bytes = descriptor(2, &[&total.to_le_bytes(), &[2, 1, 0, 0x80, 50]]);
    bytes.extend(body);
    bytes
}

fn interface(number: u8, setting: u8, endpoints: u8, subclass: u8) -> Vec<u8> {
    let string = if subclass == 1 { 2 } else { 0 };
    descriptor(4, &[&[number, setting, endpoints, 14, subclass, 0, string]])
}

fn control_interface() -> Vec<u8> {
    let camera: [u8; 2] = 0x0201u16.to_le_bytes();
    let streaming: [u8; 2] = 0x0101u16.to_le_bytes();
    let terminal =
        descriptor(CS_INTERFACE, &[&[2, CAMERA_TERMINAL], &camera, &[0, 0], &[0; 6], &[3], &TERMINAL_CONTROLS]);
    let unit = descriptor(
        CS_INTERFACE,
        &[&[5, PROCESSING_UNIT, CAMERA_TERMINAL, 0, 0, 2], &UNIT_CONTROLS.to_le_bytes(), &[0, 0]],
    );
    let output = descriptor(CS_INTERFACE, &[&[3, OUTPUT_TERMINAL], &streaming, &[0, PROCESSING_UNIT, 0]]);
    let total = 13 + terminal.len() + unit.len() + output.len();
    let header = descriptor(
        CS_INTERFACE,
        &[
            &[1],
            &0x0110u16.to_le_bytes(),
            &(total as u16).to_le_bytes(),
            &CLOCK_HZ.to_le_bytes(),
            &[1, STREAMING_INTERFACE],
        ],
    );
    [interface(CONTROL_INTERFACE, 0, 0, 1), header, terminal, unit, output].concat()
}

fn streaming_interface(offer: &Offer) -> Vec<u8> {
    let mut format = descriptor(CS_INTERFACE, &[&[4, 1, offer.sizes.len() as u8], &YUY2, &[16, 1, 0, 0, 0, 0]]);
    for index in 0..offer.sizes.len() {
        format.extend(frame(offer, index));
    }
    // Colour: BT.709 primaries, BT.709 transfer, SMPTE 170M (BT.601) matrix.
    format.extend(descriptor(CS_INTERFACE, &[&[13, 1, 1, 4]]));
    let total = (14 + format.len()) as u16;
    let header = descriptor(
        CS_INTERFACE,
        &[&[1, 1], &total.to_le_bytes(), &[0x80 | STREAM_ENDPOINT, 0, OUTPUT_TERMINAL, 0, 0, 0, 1, 0]],
    );
    // Isochronous, asynchronous, 1024 bytes; the companion makes 3 bursts of 16 of them.
    let endpoint = descriptor(5, &[&[0x80 | STREAM_ENDPOINT, 5], &1024u16.to_le_bytes(), &[1]]);
    let companion = descriptor(48, &[&[15, 2], &PACKET_BYTES.to_le_bytes()]);
    let idle = interface(STREAMING_INTERFACE, 0, 0, 2);
    let streaming = interface(STREAMING_INTERFACE, 1, 1, 2);
    [idle, header, format, streaming, endpoint, companion].concat()
}

fn frame(offer: &Offer, index: usize) -> Vec<u8> {
    let size = offer.sizes[index];
    let bits_per_s = |interval: u32| {
        let rate = u64::from(size.bytes()) * 8 * 10_000_000 / u64::from(interval.max(1));
        (rate.min(u64::from(u32::MAX)) as u32).to_le_bytes()
    };
    let intervals: Vec<u8> = offer.intervals_100ns.iter().flat_map(|interval| interval.to_le_bytes()).collect();
    let (fastest, slowest) = (offer.fastest_100ns(), offer.slowest_100ns());
    descriptor(
        CS_INTERFACE,
        &[
            &[5, index as u8 + 1, 0],
            &size.width.to_le_bytes(),
            &size.height.to_le_bytes(),
            &bits_per_s(slowest),
            &bits_per_s(fastest),
            &size.bytes().to_le_bytes(),
            &fastest.to_le_bytes(),
            &[offer.intervals_100ns.len() as u8],
            &intervals,
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offer::FrameSize;

    fn offer() -> Offer {
        Offer::new(FrameSize { width: 320, height: 240 }, 30)
    }

    /// Splits a run of descriptors by their length bytes.
    fn split(mut bytes: &[u8]) -> Vec<&[u8]> {
        let mut parts = Vec::new();
        while let Some(&length) = bytes.first() {
            assert!(length >= 2 && usize::from(length) <= bytes.len(), "{bytes:?}");
            let (part, rest) = bytes.split_at(usize::from(length));
            parts.push(part);
            bytes = rest;
        }
        parts
    }

    fn u16_at(bytes: &[u8], at: usize) -> usize {
        usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]))
    }

    #[test]
    fn lengths_are_those_of_the_specifications() {
        assert_eq!(device().len(), 18);
        assert_eq!((split(&capabilities()).len(), u16_at(&capabilities(), 2)), (3, 22));
        assert_eq!(capabilities().len(), 22);
        let configuration = configuration(&offer());
        let lengths: Vec<(usize, u8, u8)> = split(&configuration)
            .iter()
            .map(|d| (d.len(), d[1], if d[1] == CS_INTERFACE { d[2] } else { 0 }))
            .collect();
        // UVC 1.1: header 12 + n, camera terminal 15 + n, processing unit 10 + n, output terminal 9; input header 13 + n,
        // uncompressed format 27, frame 26 + 4 n, colour matching 6. USB: association 8, interface 9, endpoint 7, companion 6.
        let expected = [
            (9, 2, 0),
            (8, 11, 0),
            (9, 4, 0),
            (13, CS_INTERFACE, 1),
            (18, CS_INTERFACE, 2),
            (12, CS_INTERFACE, 5),
            (9, CS_INTERFACE, 3),
            (9, 4, 0),
            (14, CS_INTERFACE, 1),
            (27, CS_INTERFACE, 4),
            (26 + 12, CS_INTERFACE, 5),
            (26 + 12, CS_INTERFACE, 5),
            (6, CS_INTERFACE, 13),
            (9, 4, 0),
            (7, 5, 0),
            (6, 48, 0),
        ];
        assert_eq!(lengths, expected);
    }

    #[test]
    fn totals_count_what_follows() {
        let configuration = configuration(&offer());
        let parts = split(&configuration);
        assert_eq!(u16_at(parts[0], 2), configuration.len());
        let of = |range: std::ops::RangeInclusive<usize>| parts[range].iter().map(|d| d.len()).sum::<usize>();
        assert_eq!(u16_at(parts[3], 5), of(3..=6), "video control");
        assert_eq!(u16_at(parts[8], 4), of(8..=12), "video streaming");
        assert_eq!(parts[9][4], 2, "frame sizes of the format");
        assert_eq!(u16_at(parts[15], 4), usize::from(PACKET_BYTES));
    }

    #[test]
    fn frames_name_size_rate_and_bytes() {
        let configuration = configuration(&offer());
        let frame = split(&configuration)[10].to_vec();
        assert_eq!((frame[3], u16_at(&frame, 5), u16_at(&frame, 7)), (1, 320, 240));
        let u32_at = |at: usize| u32::from_le_bytes(frame[at..at + 4].try_into().unwrap());
        assert_eq!(u32_at(17), 320 * 240 * 2);
        assert_eq!((u32_at(21), frame[25], u32_at(26)), (333_333, 3, 333_333));
        // 153 600 bytes 30 times a second.
        assert_eq!(u32_at(13) / 1000, 36_864);
    }

    #[test]
    fn strings_are_utf_16() {
        assert_eq!(string(3).unwrap(), b"\x10\x03S\0K\0Y\x000\x000\x000\x001\0");
        assert_eq!(string(0).unwrap(), [4, 3, 9, 4]);
        assert!(string(9).is_none());
    }
}
