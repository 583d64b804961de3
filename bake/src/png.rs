//! Pictures as PNG files.

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use relume_firmware::glue::outfile::{OutError, write_whole};
use std::io::{Error, Write};
use std::path::Path;

/// Writes `[y][x]`, RGBA, alpha not multiplied in, of `size` (width, height); whole or not at all.
///
/// # Errors
/// [`OutError`]: the place cannot be written, or the disk is full.
pub fn write_png(file: &Path, (width, height): (u32, u32), pixels: &[[u8; 4]]) -> Result<(), OutError> {
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    let encoded = encoder.write_image(pixels.as_flattened(), width, height, ExtendedColorType::Rgba8);
    write_whole(file, |out| encoded.map_err(Error::other).and_then(|()| out.write_all(&png)))
}
