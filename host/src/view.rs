//! The view: the real picture behind. A still, or a second camera's pictures, which are shown like stills.

pub mod curve;
#[cfg(feature = "board")]
pub mod device;
pub mod disagreement;
pub mod fit;
pub mod gain;
pub mod live;
pub mod mask;

use curve::{LightTables, ViewCurve};
use std::path::{Path, PathBuf};

/// A still as the real picture behind: 8-bit sRGB, row 0 at the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Still {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `0x00RRGGBB`, row-major.
    pub pixels_bgrx: Vec<u32>,
}

/// Why a still cannot stand behind the picture.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The file is missing or not a picture that can be read.
    #[error("{}: cannot be read as a PNG or JPEG picture: {reason}", path.display())]
    Read {
        /// The still.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// The still has another size than the field.
    #[error(
        "{}: it is {}x{} but the field is {}x{}; scale or crop it to {3}x{4}, or bake the field for it",
        path.display(), found.0, found.1, field.0, field.1
    )]
    Size {
        /// The still.
        path: PathBuf,
        /// Its width and height.
        found: (usize, usize),
        /// The field's width and height.
        field: (usize, usize),
    },
}

impl Still {
    /// Reads a PNG or JPEG of any depth as 8-bit sRGB, upright as its EXIF orientation says; transparency is dropped. Without
    /// the `curve` of its camera its codes are sRGB.
    ///
    /// # Errors
    /// [`ViewError::Read`] when the file is missing or broken.
    pub fn load(path: &Path, curve: Option<&ViewCurve>) -> Result<Self, ViewError> {
        let unreadable = |reason: String| ViewError::Read { path: path.to_path_buf(), reason };
        let picture = decode(path).map_err(|e| unreadable(e.to_string()))?;
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        if width == 0 || height == 0 {
            return Err(unreadable("it has no pixels".into()));
        }
        let pixels_bgrx = match curve {
            Some(curve) => by_curve(&picture.into_rgb16(), curve),
            None => picture.into_rgb8().pixels().map(|p| u32::from_be_bytes([0, p[0], p[1], p[2]])).collect(),
        };
        Ok(Still { width, height, pixels_bgrx })
    }

    /// Reads a still that must have the size of the field, width and height; see [`Still::load`].
    ///
    /// # Errors
    /// [`ViewError::Read`]; [`ViewError::Size`] naming both sizes.
    pub fn load_sized(path: &Path, field: (usize, usize), curve: Option<&ViewCurve>) -> Result<Self, ViewError> {
        let still = Still::load(path, curve)?;
        let found = (still.width, still.height);
        if found != field {
            return Err(ViewError::Size { path: path.to_path_buf(), found, field });
        }
        Ok(still)
    }

    /// A black view, for a picture on its own.
    pub fn black(width: usize, height: usize) -> Self {
        Still { width, height, pixels_bgrx: vec![0; width * height] }
    }
}

/// A picture whose codes are a camera's own.
fn by_curve(picture: &image::ImageBuffer<image::Rgb<u16>, Vec<u16>>, curve: &ViewCurve) -> Vec<u32> {
    let tables = LightTables::new(Some(curve), 65536);
    let shown = tables.shown();
    let pixel = |rgb: &image::Rgb<u16>| {
        let [r, g, b] = [0, 1, 2].map(|channel| shown[channel][usize::from(rgb[channel])]);
        u32::from_be_bytes([0, r, g, b])
    };
    picture.pixels().map(pixel).collect()
}

fn decode(path: &Path) -> Result<image::DynamicImage, image::ImageError> {
    use image::ImageDecoder;
    let reader = image::ImageReader::open(path)?.with_guessed_format()?;
    let mut decoder = reader.into_decoder()?;
    let orientation = decoder.orientation()?;
    let mut picture = image::DynamicImage::from_decoder(decoder)?;
    picture.apply_orientation(orientation);
    Ok(picture)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_bit_png_is_taken_down_to_eight() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("still.png");
        let deep = image::ImageBuffer::from_fn(2, 1, |x, _| image::Rgb([65535u16, 257 * 18, 257 * (x as u16)]));
        image::DynamicImage::ImageRgb16(deep).save(&path).unwrap();
        let still = Still::load_sized(&path, (2, 1), None).unwrap();
        assert_eq!(still.pixels_bgrx, [0x00ff_1200, 0x00ff_1201]);
    }

    #[test]
    fn a_still_of_another_curve_becomes_srgb_at_either_depth() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("still.png");
        let linear = ViewCurve::new(crate::response::Response::default(), "linear").unwrap();
        // Half of white's light is sRGB code 188.
        image::RgbImage::from_pixel(1, 1, image::Rgb([128, 255, 0])).save(&path).unwrap();
        assert_eq!(Still::load(&path, Some(&linear)).unwrap().pixels_bgrx, [0x00bc_ff00]);
        let deep = image::ImageBuffer::from_pixel(1, 1, image::Rgb([32768u16, 33, 65535]));
        image::DynamicImage::ImageRgb16(deep).save(&path).unwrap();
        // 33 / 65535 of white is sRGB code 1.66: 8 bits would have rounded it to nothing.
        assert_eq!(Still::load(&path, Some(&linear)).unwrap().pixels_bgrx, [0x00bc_02ff]);
    }

    #[test]
    fn another_size_names_both() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("still.png");
        image::RgbImage::new(4, 3).save(&path).unwrap();
        let text = Still::load_sized(&path, (512, 384), None).unwrap_err().to_string();
        assert!(text.contains("4x3") && text.contains("crop it to 512x384") && text.contains("still.png"), "{text}");
    }

    #[test]
    fn a_text_file_is_no_view() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("still.png");
        std::fs::write(&path, "not a picture").unwrap();
        assert!(matches!(Still::load(&path, None), Err(ViewError::Read { .. })));
        assert!(matches!(Still::load(&folder.path().join("none.jpg"), None), Err(ViewError::Read { .. })));
    }
}
