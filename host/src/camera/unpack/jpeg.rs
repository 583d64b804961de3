//! JPEG pictures, one per frame.

use super::{Frame, UnpackError};
use image::codecs::jpeg::JpegDecoder;
use image::{ColorType, ImageDecoder, ImageError};
use std::io::Cursor;

fn bad(error: ImageError) -> UnpackError {
    UnpackError::Jpeg(error.to_string())
}

/// The end marker of a JPEG picture; never part of its data, though padding may follow it.
fn has_end(bytes: &[u8]) -> bool {
    bytes.windows(2).rev().any(|pair| pair == [0xff, 0xd9])
}

pub(super) fn unpack(bytes: &[u8], agreed: (usize, usize), into: &mut Frame) -> Result<(), UnpackError> {
    // The decoder fills what is missing with grey.
    if !has_end(bytes) {
        return Err(UnpackError::Jpeg("its end is missing".into()));
    }
    let decoder = JpegDecoder::new(Cursor::new(bytes)).map_err(bad)?;
    let (width, height) = decoder.dimensions();
    let got = (width as usize, height as usize);
    if got != agreed {
        return Err(UnpackError::Size { got, agreed });
    }
    let codes = into.codes_u8(agreed.0, agreed.1);
    match decoder.color_type() {
        ColorType::Rgb8 => decoder.read_image(codes).map_err(bad),
        ColorType::L8 => {
            let pixels = agreed.0 * agreed.1;
            decoder.read_image(&mut codes[..pixels]).map_err(bad)?;
            for pixel in (0..pixels).rev() {
                let code = codes[pixel];
                codes[3 * pixel..3 * pixel + 3].fill(code);
            }
            Ok(())
        }
        other => Err(UnpackError::Jpeg(format!("{other:?} is no colour of a camera"))),
    }
}
