//! Which pixels of the sky camera's picture show sky: a PNG, white where they do.

use crate::picture::{PictureError, write_png};
use std::path::Path;

/// Grey values from this on count as white.
const WHITE: u8 = 128;

/// Why a mask could not be used; one line.
#[derive(Debug, thiserror::Error)]
pub enum MaskError {
    /// The file is no picture that could be read.
    #[error("{name}: {reason}")]
    Picture {
        /// File name.
        name: String,
        /// What the reader said.
        reason: String,
    },
    /// Nothing of it is white.
    #[error("{0}: no pixel is white; paint the sky white")]
    NoSky(String),
}

/// Per pixel, row 0 at the top: does it show sky?
#[derive(Clone, Debug, PartialEq)]
pub struct SkyMask {
    width: usize,
    height: usize,
    sky: Vec<bool>,
}

impl SkyMask {
    /// A mask of `width x height` pixels from a question per pixel index.
    pub fn from_fn(width: usize, height: usize, is_sky: impl FnMut(usize) -> bool) -> Self {
        SkyMask { width, height, sky: (0..width * height).map(is_sky).collect() }
    }

    /// Reads a PNG; grey values from 128 on are sky.
    ///
    /// # Errors
    /// [`MaskError`], naming the file.
    pub fn load(path: &Path) -> Result<Self, MaskError> {
        let name = path.display().to_string();
        let told = |reason: String| MaskError::Picture { name: name.clone(), reason };
        let picture = image::ImageReader::open(path).map_err(|error| told(error.to_string()))?;
        let grey = picture.decode().map_err(|error| told(error.to_string()))?.into_luma8();
        let sky: Vec<bool> = grey.as_raw().iter().map(|&code| code >= WHITE).collect();
        if !sky.contains(&true) {
            return Err(MaskError::NoSky(name));
        }
        Ok(SkyMask { width: grey.width() as usize, height: grey.height() as usize, sky })
    }

    /// Writes the mask as a PNG, white where there is sky.
    ///
    /// # Errors
    /// [`PictureError`], naming the file.
    pub fn save(&self, path: &Path) -> Result<(), PictureError> {
        let pixels: Vec<u32> = self.sky.iter().map(|&sky| if sky { 0x00ff_ffff } else { 0 }).collect();
        write_png(path, self.width, self.height, &pixels)
    }

    /// Width and height, pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Whether the pixel of an index shows sky.
    pub fn is_sky(&self, pixel: usize) -> bool {
        self.sky.get(pixel).copied().unwrap_or(false)
    }

    /// Share of the pixels that show sky.
    pub fn share(&self) -> f64 {
        self.sky.iter().filter(|&&sky| sky).count() as f64 / self.sky.len().max(1) as f64
    }
}
