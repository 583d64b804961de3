//! Where the picture goes: a screen, or files in a folder.

pub mod config;
pub mod headless;
#[cfg(feature = "board")]
pub mod kms;
pub mod pack;

use crate::damage::Damage;
use std::path::PathBuf;
use std::time::Instant;

/// One picture for a display: pixels `0x00RRGGBB` (sRGB), row 0 at the top.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels_bgrx: &'a [u32],
    /// Frame number, counted from 0 since the post started.
    pub number: u64,
    /// What differs from the frame before; a display may skip the rest.
    pub damage: &'a Damage,
}

/// Why a picture did not reach the display.
#[derive(Debug, thiserror::Error)]
pub enum DisplayError {
    /// The frame has another size than the display.
    #[error("display: a frame of {}x{} pixels for a display of {}x{}", frame.0, frame.1, display.0, display.1)]
    Size {
        /// Width and height of the frame.
        frame: (usize, usize),
        /// Width and height of the display.
        display: (usize, usize),
    },
    /// The folder for the pictures cannot be used.
    #[error("{}: cannot hold the display's pictures: {reason}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// There is no screen that takes the picture.
    #[error("display: {0}")]
    Screen(String),
    /// A picture could not be written.
    #[error(transparent)]
    Picture(#[from] crate::picture::PictureError),
}

impl From<DisplayError> for crate::failure::Failure {
    fn from(error: DisplayError) -> Self {
        match error {
            DisplayError::Picture(picture) => picture.into(),
            DisplayError::Screen(_) => Self::Runtime(error.into()),
            DisplayError::Size { .. } | DisplayError::Folder { .. } => Self::BadInput(error.into()),
        }
    }
}

/// A place that shows pictures.
pub trait Display {
    /// Width and height in pixels.
    fn size(&self) -> (usize, usize);

    /// Shows one picture.
    ///
    /// # Errors
    /// [`DisplayError`]; the post may go on and try again with the next frame.
    fn present(&mut self, frame: &Frame<'_>) -> Result<(), DisplayError>;

    /// When a frame that was presented, or a later one, was first seen; `None` while that is not known. Asked while a
    /// frame is on its way, and never waits. A display that shows what it is given at once needs no more than this.
    fn when_shown(&mut self, _number: u64) -> Option<Instant> {
        Some(Instant::now())
    }

    /// What keeps pictures from being seen now (nothing plugged in, card gone), in a few words; `None` if nothing does.
    fn trouble(&self) -> Option<&str> {
        None
    }

    /// What is no trouble and should yet be known, in a few words.
    fn note(&self) -> Option<&str> {
        None
    }
}
