//! The bytes of a camera's picture to RGB codes.
//!
//! YUV, JPEG and 8-bit samples give 8-bit codes. Deeper samples give 16-bit ones: their high bits are repeated below, so
//! that the largest sample is 65535. Mosaics are binned ([`super::demosaic`]), which halves width and height.

pub mod formats;
mod jpeg;
mod samples;
mod yuv;

use super::Frame;
use super::demosaic::{BayerOrder, bin_rows};
pub use samples::Sample;
pub use yuv::{Matrix, Range, YuvCoding};

/// Share of the largest code from which on a sample counts as clipped.
const CLIP: f64 = 0.98;

/// How a picture's bytes are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelFormat {
    /// 4:2:2, Y0 U Y1 V.
    Yuyv,
    /// 4:2:2, U Y0 V Y1.
    Uyvy,
    /// 4:2:0, a plane of Y and one of U V pairs.
    Nv12,
    /// A JPEG picture per frame.
    Jpeg,
    /// Luminance alone; all three codes of a pixel are the same.
    Grey(Sample),
    /// A sensor's mosaic.
    Bayer(BayerOrder, Sample),
}

/// A picture in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Layout of the bytes.
    pub format: PixelFormat,
    /// Samples per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bytes from row to row; without meaning for JPEG.
    pub stride: usize,
    /// What YUV values stand for.
    pub coding: YuvCoding,
}

/// Why bytes are no picture; one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnpackError {
    /// The picture's end is missing.
    #[error("the picture has {got} bytes of {needed}")]
    TooShort {
        /// Bytes there.
        got: usize,
        /// Bytes of a whole picture.
        needed: usize,
    },
    /// The picture is not of the size agreed on.
    #[error("the picture has {}x{} pixels instead of {}x{}", got.0, got.1, agreed.0, agreed.1)]
    Size {
        /// Width and height of the picture.
        got: (usize, usize),
        /// Width and height agreed on.
        agreed: (usize, usize),
    },
    /// The bytes are no JPEG picture.
    #[error("not a JPEG picture: {0}")]
    Jpeg(String),
    /// Rows that overlap, or no pixels.
    #[error("rows of {width} samples do not fit into {stride} bytes")]
    Stride {
        /// Samples per row.
        width: usize,
        /// Bytes from row to row.
        stride: usize,
    },
}

impl Layout {
    /// Width and height of the RGB picture.
    pub fn output_size(&self) -> (usize, usize) {
        match self.format {
            PixelFormat::Bayer(..) => (self.width / 2, self.height / 2),
            _ => (self.width, self.height),
        }
    }

    /// Bytes that hold a whole picture; 0 for JPEG, whose pictures differ.
    pub fn needed_bytes(&self) -> usize {
        let before_last = |rows: usize| rows.saturating_sub(1) * self.stride;
        match self.format {
            PixelFormat::Jpeg => 0,
            PixelFormat::Nv12 => before_last(self.height + self.height.div_ceil(2)) + self.row_bytes(),
            _ => before_last(self.height) + self.row_bytes(),
        }
    }

    fn row_bytes(&self) -> usize {
        match self.format {
            PixelFormat::Yuyv | PixelFormat::Uyvy => self.width.div_ceil(2) * 4,
            PixelFormat::Nv12 => self.width.div_ceil(2) * 2,
            PixelFormat::Jpeg => 0,
            PixelFormat::Grey(sample) | PixelFormat::Bayer(_, sample) => sample.row_bytes(self.width),
        }
    }
}

/// Unpacks pictures of one layout; keeps its buffers.
#[derive(Clone, Debug)]
pub struct Unpacker {
    layout: Layout,
    yuv: yuv::ToRgb,
    rows: [Vec<u16>; 2],
}

impl Unpacker {
    /// An unpacker for pictures of this layout.
    ///
    /// # Errors
    /// [`UnpackError::Stride`] where rows overlap or the picture has no pixels.
    pub fn new(layout: Layout) -> Result<Self, UnpackError> {
        let (width, height) = layout.output_size();
        if width == 0 || height == 0 || layout.row_bytes() > layout.stride {
            return Err(UnpackError::Stride { width: layout.width, stride: layout.stride });
        }
        let scratch = || match layout.format {
            PixelFormat::Grey(_) | PixelFormat::Bayer(..) => vec![0; layout.width],
            _ => Vec::new(),
        };
        Ok(Unpacker { layout, yuv: yuv::ToRgb::new(layout.coding), rows: [scratch(), scratch()] })
    }

    /// The layout.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Writes size and codes of `into`; the rest of it stays.
    ///
    /// # Errors
    /// [`UnpackError`] when the bytes are no picture of this layout.
    pub fn unpack(&mut self, bytes: &[u8], into: &mut Frame) -> Result<(), UnpackError> {
        let needed = self.layout.needed_bytes();
        if bytes.len() < needed {
            return Err(UnpackError::TooShort { got: bytes.len(), needed });
        }
        match self.layout.format {
            PixelFormat::Jpeg => return jpeg::unpack(bytes, (self.layout.width, self.layout.height), into),
            PixelFormat::Yuyv => self.packed_yuv(bytes, into, |[y0, u, y1, v]| [y0, y1, u, v]),
            PixelFormat::Uyvy => self.packed_yuv(bytes, into, |[u, y0, v, y1]| [y0, y1, u, v]),
            PixelFormat::Nv12 => self.nv12(bytes, into),
            PixelFormat::Grey(sample) => self.grey(bytes, sample, into),
            PixelFormat::Bayer(order, sample) => self.bayer(bytes, order, sample, into),
        }
        Ok(())
    }

    fn packed_yuv(&self, bytes: &[u8], into: &mut Frame, sorted: impl Fn([u8; 4]) -> [u8; 4]) {
        let Layout { width, height, stride, .. } = self.layout;
        let codes = into.codes_u8(width, height);
        for (row, out) in bytes.chunks(stride).zip(codes.chunks_exact_mut(width * 3)) {
            for (pair, quad) in out.chunks_mut(6).zip(row.chunks_exact(4)) {
                let [y0, y1, u, v] = sorted([quad[0], quad[1], quad[2], quad[3]]);
                self.yuv.pair([y0, y1], [u, v], pair);
            }
        }
    }

    fn nv12(&self, bytes: &[u8], into: &mut Frame) {
        let Layout { width, height, stride, .. } = self.layout;
        let (luma, chroma) = bytes.split_at(stride * height);
        let codes = into.codes_u8(width, height);
        for (y, out) in codes.chunks_exact_mut(width * 3).enumerate() {
            let (luma, chroma) = (&luma[y * stride..], &chroma[y / 2 * stride..]);
            for (x, pair) in out.chunks_mut(6).enumerate() {
                let second = luma[(2 * x + 1).min(width - 1)];
                self.yuv.pair([luma[2 * x], second], [chroma[2 * x], chroma[2 * x + 1]], pair);
            }
        }
    }

    fn grey(&mut self, bytes: &[u8], sample: Sample, into: &mut Frame) {
        let Layout { width, height, stride, .. } = self.layout;
        let row = &mut self.rows[0];
        if sample.bits() == 8 {
            let codes = into.codes_u8(width, height);
            for (bytes, out) in bytes.chunks(stride).zip(codes.chunks_exact_mut(width * 3)) {
                out.chunks_exact_mut(3).zip(bytes).for_each(|(pixel, &code)| pixel.fill(code));
            }
        } else {
            let codes = into.codes_u16(width, height);
            for (bytes, out) in bytes.chunks(stride).zip(codes.chunks_exact_mut(width * 3)) {
                sample.read_row(bytes, row);
                out.chunks_exact_mut(3).zip(row.iter()).for_each(|(pixel, &code)| pixel.fill(code));
            }
        }
    }

    fn bayer(&mut self, bytes: &[u8], order: BayerOrder, sample: Sample, into: &mut Frame) {
        let stride = self.layout.stride;
        let (width, height) = self.layout.output_size();
        let [upper, lower] = &mut self.rows;
        let read = |y: usize, [upper, lower]: [&mut [u16]; 2]| {
            sample.read_row(&bytes[2 * y * stride..], upper);
            sample.read_row(&bytes[(2 * y + 1) * stride..], lower);
        };
        let clip = |max: f64| (CLIP * max) as u16;
        if sample.bits() == 8 {
            let rows = into.codes_u8(width, height).chunks_exact_mut(width * 3);
            for (y, out) in rows.enumerate() {
                read(y, [upper, lower]);
                bin_rows(order, [upper, lower], clip(255.0), out, |code| code as u8);
            }
        } else {
            let rows = into.codes_u16(width, height).chunks_exact_mut(width * 3);
            for (y, out) in rows.enumerate() {
                read(y, [upper, lower]);
                bin_rows(order, [upper, lower], clip(65535.0), out, |code| code);
            }
        }
    }
}

#[cfg(test)]
mod tests;
