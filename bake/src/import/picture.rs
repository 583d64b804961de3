//! A picture file as linear RGB: EXR, Radiance RGBE, PNG, JPEG or TIFF, told apart by content.

use super::fault::ImportError;
use exr::prelude::read_first_rgba_layer_from_file;
use image::{DynamicImage, ImageFormat, ImageReader, Limits};
use serde::Deserialize;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// What whole-number pixels mean; floats are linear always.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Encoding {
    /// IEC 61966-2-1.
    Srgb,
    /// In proportion to radiance.
    Linear,
}

/// Most memory that a decoder may take for one picture, bytes.
const DECODER_ROOM: u64 = 4 << 30;

/// A decoded picture.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    /// Width and height, px.
    pub(super) size: (usize, usize),
    /// Linear, `[y][x][3]`.
    pub(super) rgb: Vec<f32>,
    /// `[y][x]`, if the file has any that is not 1.
    pub(super) alpha: Option<Vec<f32>>,
    /// Is `rgb` multiplied by the coverage already?
    pub(super) premultiplied: bool,
}

impl Picture {
    /// Reads a picture. Whole numbers mean what `encoding` says; by default 8 bits are sRGB and 16 linear. Colour profiles
    /// are not looked at.
    ///
    /// # Errors
    /// [`ImportError::File`] when it cannot be read, [`ImportError::Value`] when a pixel is not finite.
    pub(super) fn read(file: &Path, encoding: Option<Encoding>) -> Result<Self, ImportError> {
        let mut head = Vec::new();
        let opened = std::fs::File::open(file).map_err(|error| ImportError::file(file, error))?;
        opened.take(16).read_to_end(&mut head).map_err(|error| ImportError::file(file, error))?;
        let picture = match head.as_slice() {
            [0x76, 0x2f, 0x31, 0x01, ..] => read_exr(file)?,
            [b'#', b'?', ..] => read_rgbe(file)?,
            _ => read_coded(file, encoding)?,
        };
        let width = picture.size.0;
        match picture.rgb.iter().position(|value| !value.is_finite()) {
            Some(at) => {
                let value = picture.rgb[at];
                Err(ImportError::Value { file: file.to_owned(), at: (at / 3 % width, at / 3 / width), value })
            }
            None => Ok(picture),
        }
    }

    /// The mean over squares of `times` x `times` pixels; what is left over at the right and below falls off.
    pub(super) fn shrunk(self, times: usize) -> Self {
        if times == 1 {
            return self;
        }
        let size = (self.size.0 / times, self.size.1 / times);
        let mean = |values: &[f32], channels: usize| {
            let mut out = vec![0.0f32; channels * size.0 * size.1];
            for y in 0..size.1 * times {
                for x in 0..size.0 * times {
                    let (from, to) = (channels * (y * self.size.0 + x), channels * (y / times * size.0 + x / times));
                    (0..channels).for_each(|c| out[to + c] += values[from + c]);
                }
            }
            out.iter_mut().for_each(|value| *value /= (times * times) as f32);
            out
        };
        let alpha = self.alpha.as_ref().map(|alpha| mean(alpha, 1));
        Picture { size, rgb: mean(&self.rgb, 3), alpha, ..self }
    }
}

/// `[y][x]`, unless all are 1.
fn unless_whole(alpha: Vec<f32>) -> Option<Vec<f32>> {
    alpha.iter().any(|&share| share != 1.0).then_some(alpha)
}

fn read_exr(file: &Path) -> Result<Picture, ImportError> {
    let image = read_first_rgba_layer_from_file(
        file,
        |size, _| (size.width(), vec![[0.0f32; 4]; size.area()]),
        |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b, a],
    );
    let layer = image.map_err(|error| ImportError::file(file, format!("cannot read the EXR: {error}")))?.layer_data;
    let pixels = layer.channel_data.pixels.1;
    let rgb = pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    let alpha = unless_whole(pixels.iter().map(|pixel| pixel[3]).collect());
    Ok(Picture { size: (layer.size.width(), layer.size.height()), rgb, alpha, premultiplied: true })
}

fn read_rgbe(file: &Path) -> Result<Picture, ImportError> {
    let bad = |error: &dyn std::fmt::Display| ImportError::file(file, format!("cannot read the RGBE picture: {error}"));
    let open = || std::fs::File::open(file).map(BufReader::new).map_err(|error| bad(&error));
    let exposure = exposure_of(open()?).map_err(|error| bad(&error))?;
    let decoder = image::codecs::hdr::HdrDecoder::new_nonstrict(open()?).map_err(|error| bad(&error))?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(|error| bad(&error))?.into_rgb32f();
    let size = (decoded.width() as usize, decoded.height() as usize);
    let mut rgb = decoded.into_raw();
    for pixel in rgb.as_chunks_mut::<3>().0 {
        // Mantissas are cut off, not rounded, and stand for their middles (Radiance's colr_color); the largest of a pixel is
        // at least 128 of 256.
        let largest = pixel.iter().copied().fold(0.0f32, f32::max);
        let half = if largest > 0.0 { 2f32.powi(largest.log2().floor() as i32 - 8) } else { 0.0 };
        pixel.iter_mut().for_each(|value| *value = (*value + half) / exposure);
    }
    Ok(Picture { size, rgb, alpha: None, premultiplied: false })
}

/// The product of the header's exposures, by which all pixels have been multiplied.
fn exposure_of(mut from: impl BufRead) -> std::io::Result<f32> {
    let (mut product, mut line) = (1.0f32, Vec::new());
    loop {
        line.clear();
        if from.read_until(b'\n', &mut line)? == 0 || line.trim_ascii().is_empty() {
            return Ok(product);
        }
        let text = String::from_utf8_lossy(&line);
        if let Some(value) = text.strip_prefix("EXPOSURE=").and_then(|value| value.trim().parse::<f32>().ok()) {
            product *= value;
        }
    }
}

fn read_coded(file: &Path, encoding: Option<Encoding>) -> Result<Picture, ImportError> {
    let bad = |error: &dyn std::fmt::Display| ImportError::file(file, format!("cannot read the picture: {error}"));
    let reader = ImageReader::open(file).and_then(ImageReader::with_guessed_format).map_err(|error| bad(&error))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Tiff)) {
        return Err(bad(&"not EXR, Radiance RGBE, PNG, JPEG or TIFF"));
    }
    let mut reader = reader;
    let mut limits = Limits::default();
    limits.max_alloc = Some(DECODER_ROOM);
    reader.limits(limits);
    let decoded = reader.decode().map_err(|error| bad(&error))?;
    let size = (decoded.width() as usize, decoded.height() as usize);
    let colour = decoded.color();
    let bits = colour.bytes_per_pixel() / colour.channel_count();
    let table = match (bits, encoding) {
        (1, None | Some(Encoding::Srgb)) => Some(255),
        (2, Some(Encoding::Srgb)) => Some(65535),
        _ => None,
    };
    let values = decoded.into_rgba32f().into_raw();
    let pixels = values.as_chunks::<4>().0;
    let alpha = if colour.has_alpha() { unless_whole(pixels.iter().map(|pixel| pixel[3]).collect()) } else { None };
    let rgb = match table.map(srgb_table) {
        Some(table) => {
            let top = (table.len() - 1) as f32;
            pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b].map(|v| table[(v * top).round() as usize])).collect()
        }
        None => pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(),
    };
    Ok(Picture { size, rgb, alpha, premultiplied: false })
}

/// Linear value of every code (IEC 61966-2-1).
fn srgb_table(top: usize) -> Vec<f32> {
    let linear = |code: usize| {
        let value = code as f64 / top as f64;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    (0..=top).map(|code| linear(code) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageBuffer, Rgb};

    #[test]
    fn whole_numbers_are_srgb_or_linear() {
        let folder = tempfile::tempdir().unwrap();
        let eight = ImageBuffer::from_fn(2, 1, |x, _| Rgb([if x == 0 { 188u8 } else { 10 }, 0, 255]));
        let sixteen = ImageBuffer::from_fn(2, 1, |_, _| Rgb([32768u16, 0, 65535]));
        for ext in ["png", "tif"] {
            let (a, b) = (folder.path().join("a").with_extension(ext), folder.path().join("b").with_extension(ext));
            eight.save(&a).unwrap();
            sixteen.save(&b).unwrap();
            let read = |file: &Path, encoding| Picture::read(file, encoding).unwrap().rgb;
            // By the standard's formula: code 188 is 0.50289, code 10 is 10 / 255 / 12.92.
            assert!((read(&a, None)[0] - 0.50289).abs() < 1e-4 && (read(&a, None)[3] - 0.0030353).abs() < 1e-6);
            assert!((read(&a, Some(Encoding::Linear))[0] - 188.0 / 255.0).abs() < 1e-6);
            assert!((read(&b, None)[0] - 0.5).abs() < 1e-4);
            assert!((read(&b, Some(Encoding::Srgb))[0] - 0.21404).abs() < 1e-4, "{ext}");
            assert_eq!(read(&b, None)[2], 1.0);
        }
    }

    /// A header as `pfilt` leaves it; one pixel of mantissas 128, 64, 0 and exponent 129.
    #[test]
    fn rgbe_is_radiances() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let mut bytes =
            b"#?RADIANCE\nrcontrib\nEXPOSURE=2.0\nEXPOSURE=4\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n".to_vec();
        bytes.extend([128, 64, 0, 129]);
        std::fs::write(file.path(), bytes).unwrap();
        let picture = Picture::read(file.path(), None).unwrap();
        // (mantissa + 0.5) / 256 * 2^(129 - 128) / 8.
        assert_eq!(picture.rgb, [128.5 / 128.0 / 8.0, 64.5 / 128.0 / 8.0, 0.5 / 128.0 / 8.0]);
    }

    #[test]
    fn shrinking_takes_means() {
        let rgb = (0..5 * 3 * 3).map(|k| k as f32).collect();
        let picture = Picture { size: (5, 3), rgb, alpha: Some(vec![1.0; 15]), premultiplied: false }.shrunk(2);
        assert_eq!((picture.size, &picture.rgb[..3]), ((2, 1), &[9.0, 10.0, 11.0][..]));
        assert_eq!(picture.alpha, Some(vec![1.0; 2]));
    }
}
