//! V4L2's four-character codes, those first that measure light best.

use super::{PixelFormat, Sample};
use crate::camera::demosaic::BayerOrder::{Bggr, Gbrg, Grbg, Rggb};

type Named = ([u8; 4], PixelFormat);

/// Deep and linear before what an image processor has been at, whole colour before shared colour, colour before grey.
const FORMATS: &[Named] = &[
    (*b"BYR2", PixelFormat::Bayer(Bggr, Sample::Low(16))),
    (*b"GB16", PixelFormat::Bayer(Gbrg, Sample::Low(16))),
    (*b"GR16", PixelFormat::Bayer(Grbg, Sample::Low(16))),
    (*b"RG16", PixelFormat::Bayer(Rggb, Sample::Low(16))),
    (*b"pBCC", PixelFormat::Bayer(Bggr, Sample::Packed12)),
    (*b"pGCC", PixelFormat::Bayer(Gbrg, Sample::Packed12)),
    (*b"pgCC", PixelFormat::Bayer(Grbg, Sample::Packed12)),
    (*b"pRCC", PixelFormat::Bayer(Rggb, Sample::Packed12)),
    (*b"BG12", PixelFormat::Bayer(Bggr, Sample::Low(12))),
    (*b"GB12", PixelFormat::Bayer(Gbrg, Sample::Low(12))),
    (*b"BA12", PixelFormat::Bayer(Grbg, Sample::Low(12))),
    (*b"RG12", PixelFormat::Bayer(Rggb, Sample::Low(12))),
    (*b"pBAA", PixelFormat::Bayer(Bggr, Sample::Packed10)),
    (*b"pGAA", PixelFormat::Bayer(Gbrg, Sample::Packed10)),
    (*b"pgAA", PixelFormat::Bayer(Grbg, Sample::Packed10)),
    (*b"pRAA", PixelFormat::Bayer(Rggb, Sample::Packed10)),
    (*b"BG10", PixelFormat::Bayer(Bggr, Sample::Low(10))),
    (*b"GB10", PixelFormat::Bayer(Gbrg, Sample::Low(10))),
    (*b"BA10", PixelFormat::Bayer(Grbg, Sample::Low(10))),
    (*b"RG10", PixelFormat::Bayer(Rggb, Sample::Low(10))),
    (*b"BA81", PixelFormat::Bayer(Bggr, Sample::Bits8)),
    (*b"GBRG", PixelFormat::Bayer(Gbrg, Sample::Bits8)),
    (*b"GRBG", PixelFormat::Bayer(Grbg, Sample::Bits8)),
    (*b"RGGB", PixelFormat::Bayer(Rggb, Sample::Bits8)),
    (*b"YUYV", PixelFormat::Yuyv),
    (*b"UYVY", PixelFormat::Uyvy),
    (*b"NV12", PixelFormat::Nv12),
    (*b"MJPG", PixelFormat::Jpeg),
    (*b"JPEG", PixelFormat::Jpeg),
    (*b"Y16 ", PixelFormat::Grey(Sample::Low(16))),
    (*b"Y12 ", PixelFormat::Grey(Sample::Low(12))),
    (*b"Y10P", PixelFormat::Grey(Sample::Packed10)),
    (*b"Y10 ", PixelFormat::Grey(Sample::Low(10))),
    (*b"GREY", PixelFormat::Grey(Sample::Bits8)),
];

/// What a code stands for, if it can be unpacked.
pub fn from_fourcc(fourcc: [u8; 4]) -> Option<PixelFormat> {
    FORMATS.iter().find(|(code, _)| *code == fourcc).map(|&(_, format)| format)
}

/// The best of the codes that a camera offers.
pub fn best(offered: &[[u8; 4]]) -> Option<([u8; 4], PixelFormat)> {
    FORMATS.iter().find(|(code, _)| offered.contains(code)).copied()
}

/// Is a picture in this format one to look at: in colour, with codes that a camera has made for a display?
pub fn is_shown(format: PixelFormat) -> bool {
    matches!(format, PixelFormat::Yuyv | PixelFormat::Uyvy | PixelFormat::Nv12 | PixelFormat::Jpeg)
}

/// The code that a text of four letters names, `Y16` as well as `Y16 `; what no camera has for other texts.
pub fn from_name(text: &str) -> [u8; 4] {
    let mut letters = text.bytes().chain(std::iter::repeat(b' '));
    std::array::from_fn(|_| letters.next().unwrap_or(b' '))
}

/// A code as text, such as `YUYV`.
pub fn name(fourcc: [u8; 4]) -> String {
    fourcc.iter().map(|&byte| if byte.is_ascii_graphic() { char::from(byte) } else { ' ' }).collect()
}
