//! Pictures into files: linear radiance as EXR, what a display shows as PNG. Both appear whole or not at all.

use crate::outfile::{OutError, write_whole};
use exr::prelude::{Encoding, Image, SpecificChannels, WritableImage};
use image::ExtendedColorType;
use std::io::{self, Cursor, Write};
use std::path::Path;

/// The picture formats that a file name can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// 32-bit float, linear radiance premultiplied by alpha = coverage.
    Exr,
    /// 8-bit sRGB, tone-mapped.
    Png,
}

/// Why a picture could not be written.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The file name ends in neither of the known formats.
    #[error("{0}: unknown picture format; end the name in .exr (linear radiance) or .png (as a display shows it)")]
    Format(String),
    /// The buffers do not hold `width` x `height` pixels, or there are none.
    #[error("a picture of {width}x{height} pixels cannot be made from {pixels} pixels")]
    Shape {
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
        /// Pixels given.
        pixels: usize,
    },
    /// The file could not be written.
    #[error(transparent)]
    Out(#[from] OutError),
}

impl From<PictureError> for crate::failure::Failure {
    fn from(error: PictureError) -> Self {
        match error {
            PictureError::Out(out) => out.into(),
            PictureError::Format(_) => Self::BadInput(error.into()),
            PictureError::Shape { .. } => Self::Runtime(error.into()),
        }
    }
}

impl PictureFormat {
    /// The format that the file name's ending asks for.
    ///
    /// # Errors
    /// [`PictureError::Format`] for any other ending.
    pub fn of(path: &Path) -> Result<Self, PictureError> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("exr") => Ok(PictureFormat::Exr),
            Some("png") => Ok(PictureFormat::Png),
            _ => Err(PictureError::Format(path.display().to_string())),
        }
    }
}

fn check_shape(width: usize, height: usize, pixels: usize) -> Result<(), PictureError> {
    if width == 0 || height == 0 || width.checked_mul(height) != Some(pixels) {
        return Err(PictureError::Shape { width, height, pixels });
    }
    Ok(())
}

/// Writes linear radiance as a 32-bit float EXR with channels R, G, B, A, lossless.
///
/// `rgb` and `alpha` hold `width * height` pixels, row 0 at the top; `rgb` is premultiplied by `alpha` = coverage.
///
/// # Errors
/// [`PictureError::Shape`] for buffers of another size, [`PictureError::Out`] for the file.
pub fn write_exr(
    path: &Path,
    width: usize,
    height: usize,
    rgb: &[[f32; 3]],
    alpha: &[f32],
) -> Result<(), PictureError> {
    check_shape(width, height, rgb.len())?;
    check_shape(width, height, alpha.len())?;
    let pixel = |at: exr::math::Vec2<usize>| {
        let index = at.y() * width + at.x();
        let [r, g, b] = rgb[index];
        (r, g, b, alpha[index])
    };
    let image = Image::from_encoded_channels((width, height), Encoding::FAST_LOSSLESS, SpecificChannels::rgba(pixel));
    let mut bytes = Cursor::new(Vec::new());
    let encoded = image.write().to_buffered(&mut bytes);
    write_whole(path, |out| {
        encoded.map_err(io::Error::other)?;
        out.write_all(bytes.get_ref())
    })?;
    Ok(())
}

/// Channel that tells where radiance is the least it can be.
pub const CLIPPED_CHANNEL: &str = "clipped";

/// Writes what an exposure series tells in the camera's frame: linear radiance as 32-bit floats, the channel `clipped` (1 where the
/// radiance is the least it can be, else 0), and one standard deviation per channel (`sigma.R`, `sigma.G`, `sigma.B`) where known.
///
/// # Errors
/// [`PictureError::Shape`] for a buffer of another size, [`PictureError::Out`] for the file.
pub fn write_exr_measured(
    path: &Path,
    (width, height): (usize, usize),
    rgb: &[[f32; 3]],
    clipped: impl ExactSizeIterator<Item = bool>,
    sigma: Option<&[[f32; 3]]>,
) -> Result<(), PictureError> {
    use exr::prelude::{AnyChannel, AnyChannels, FlatSamples};
    check_shape(width, height, rgb.len())?;
    check_shape(width, height, clipped.len())?;
    let channel = |name: &str, values: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(values));
    let of = |pixels: &[[f32; 3]], k: usize| pixels.iter().map(|pixel| pixel[k]).collect();
    let mut channels: Vec<_> = ["R", "G", "B"].iter().enumerate().map(|(k, name)| channel(name, of(rgb, k))).collect();
    channels.push(channel(CLIPPED_CHANNEL, clipped.map(|clipped| f32::from(u8::from(clipped))).collect()));
    if let Some(sigma) = sigma {
        check_shape(width, height, sigma.len())?;
        let names = ["sigma.R", "sigma.G", "sigma.B"].iter().enumerate();
        channels.extend(names.map(|(k, name)| channel(name, of(sigma, k))));
    }
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let image = Image::from_encoded_channels((width, height), Encoding::FAST_LOSSLESS, channels);
    let mut bytes = Cursor::new(Vec::new());
    let encoded = image.write().to_buffered(&mut bytes);
    write_whole(path, |out| {
        encoded.map_err(io::Error::other)?;
        out.write_all(bytes.get_ref())
    })?;
    Ok(())
}

/// Writes pixels `0x00RRGGBB` (sRGB, row 0 at the top) as an 8-bit RGB PNG.
///
/// # Errors
/// [`PictureError::Shape`] for a buffer of another size, [`PictureError::Out`] for the file.
pub fn write_png(path: &Path, width: usize, height: usize, pixels_bgrx: &[u32]) -> Result<(), PictureError> {
    check_shape(width, height, pixels_bgrx.len())?;
    let bytes: Vec<u8> = pixels_bgrx.iter().flat_map(|&p| [(p >> 16) as u8, (p >> 8) as u8, p as u8]).collect();
    write_whole(path, |out| encode_png(out, &bytes, (width, height), ExtendedColorType::Rgb8))?;
    Ok(())
}

/// Codes, rows of `colour` without gaps, as a PNG.
pub(crate) fn encode_png(
    out: impl Write,
    bytes: &[u8],
    (width, height): (usize, usize),
    colour: ExtendedColorType,
) -> io::Result<()> {
    use image::ImageEncoder;
    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, width as u32, height as u32, colour)
        .map_err(|error| match error {
            image::ImageError::IoError(io) => io,
            other => io::Error::other(other),
        })
}

/// What a display shows, in f64: `round(255 * srgb(clamp(exposure * rgb + (1 - alpha) * view)))` per channel.
///
/// `rgb` is linear radiance premultiplied by `alpha` = coverage; the view's pixels are `0x00RRGGBB`, as the result's.
pub fn composite(rgb: &[[f32; 3]], alpha: &[f32], exposure: f64, view_bgrx: &[u32]) -> Vec<u32> {
    let pixels = rgb.iter().zip(alpha).zip(view_bgrx);
    pixels
        .map(|((rgb, &alpha), &view)| {
            let [_, red, green, blue] = view.to_be_bytes();
            let codes = [(rgb[0], red), (rgb[1], green), (rgb[2], blue)].map(|(radiance, behind)| {
                let shown = exposure * f64::from(radiance);
                // An uncovered pixel keeps the view's code exactly.
                if alpha <= 0.0 { behind } else { srgb_code(shown + (1.0 - f64::from(alpha)) * srgb_linear(behind)) }
            });
            u32::from_be_bytes([0, codes[0], codes[1], codes[2]])
        })
        .collect()
}

/// The 8-bit sRGB code (IEC 61966-2-1) of a linear value, clamped to 0..1, rounded to nearest.
pub fn srgb_code(linear: f64) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

/// The linear value of an 8-bit sRGB code.
pub fn srgb_linear(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exr_comes_back_as_it_went() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let rgb: Vec<[f32; 3]> = (0..6).map(|i| [i as f32, 0.1 * i as f32, 1e-7]).collect();
        let alpha = [0.0, 0.25, 0.5, 0.75, 1.0, 1.0];
        write_exr(&path, 3, 2, &rgb, &alpha).unwrap();
        let back = exr::prelude::read_first_rgba_layer_from_file(
            &path,
            |size, _| vec![(0.0, 0.0, 0.0, 0.0); size.area()],
            |pixels, at, p: (f32, f32, f32, f32)| pixels[at.y() * 3 + at.x()] = p,
        )
        .unwrap();
        assert_eq!(back.layer_data.size, exr::math::Vec2(3, 2));
        for (i, p) in back.layer_data.channel_data.pixels.iter().enumerate() {
            assert_eq!(*p, (rgb[i][0], rgb[i][1], rgb[i][2], alpha[i]));
        }
    }

    #[test]
    fn png_comes_back_as_it_went() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_png(&path, 2, 1, &[0x0012_34ff, 0x00ab_cd00]).unwrap();
        let back = image::open(&path).unwrap().into_rgb8();
        assert_eq!(back.into_raw(), [0x12, 0x34, 0xff, 0xab, 0xcd, 0x00]);
    }

    #[test]
    fn the_srgb_curve_is_the_standard_one() {
        // Values of IEC 61966-2-1 and of the usual tables: mid grey 0.18 is code 118, 0.5 is 188.
        for (linear, code) in [(0.0, 0), (0.003_130_8, 10), (0.18, 118), (0.5, 188), (1.0, 255), (7.0, 255), (-1.0, 0)]
        {
            assert_eq!(srgb_code(linear), code, "{linear}");
        }
        assert_eq!(srgb_code(f64::NAN), 0);
        assert!((0..=255).all(|code| srgb_code(srgb_linear(code)) == code));
    }

    #[test]
    fn the_view_shows_where_nothing_covers_it() {
        let rgb = [[0.5, 0.09, 0.0], [0.0; 3], [0.25, 0.25, 0.25]];
        let shown = composite(&rgb, &[1.0, 0.0, 0.5], 2.0, &[0x00ff_ffff, 0x0001_0203, 0x0000_0000]);
        assert_eq!(shown[..2], [0x00ff_7600, 0x0001_0203]);
        // Half covered, radiance 0.25 x 2 over black: linear 0.5.
        assert_eq!(shown[2], 0x00bc_bcbc);
    }

    #[test]
    fn other_endings_and_wrong_shapes_are_refused() {
        assert!(PictureFormat::of(Path::new("a.jpg")).is_err());
        assert_eq!(PictureFormat::of(Path::new("a.EXR")).unwrap(), PictureFormat::Exr);
        assert!(matches!(write_png(Path::new("a.png"), 2, 2, &[0]), Err(PictureError::Shape { .. })));
        assert!(matches!(write_png(Path::new("a.png"), 0, 0, &[]), Err(PictureError::Shape { .. })));
    }
}
