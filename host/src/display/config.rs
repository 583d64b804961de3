//! What a post's file says of its screen.

pub use super::pack::{PixelFormat, Rotation};

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// A mode as people write it: `1920x1080` or `1920x1080@60`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModeWish {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Pictures per second; any if left out.
    pub refresh_hz: Option<u32>,
}

impl FromStr for ModeWish {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let (size, refresh) = text.split_once('@').map_or((text, None), |(size, refresh)| (size, Some(refresh)));
        let (width, height) = size.split_once('x').ok_or(())?;
        let refresh_hz = refresh.map(str::parse).transpose().map_err(|_| ())?;
        Ok(ModeWish { width: width.parse().map_err(|_| ())?, height: height.parse().map_err(|_| ())?, refresh_hz })
    }
}

impl fmt::Display for ModeWish {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)?;
        self.refresh_hz.map_or(Ok(()), |hz| write!(f, "@{hz}"))
    }
}

/// Whose memory the screen shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BufferKind {
    /// GBM's where it opens, else dumb ones.
    #[default]
    Auto,
    /// The kernel's dumb buffers.
    Dumb,
}

/// How the kernel is asked to set modes and to flip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Modesetting {
    /// Atomically where the card can, else the legacy way.
    #[default]
    Auto,
    /// The legacy way, for a driver whose atomic one fails.
    Legacy,
}

/// A screen through DRM/KMS.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KmsConfig {
    /// The card's node; the first with a display if left out.
    pub card: Option<PathBuf>,
    /// The socket, such as `HDMI-A-1`; the first with a display if left out.
    pub connector: Option<String>,
    /// The mode; the display's preferred one if left out.
    pub mode: Option<ModeWish>,
    /// How the picture is turned, besides what the kernel says of the panel.
    pub rotation: Rotation,
    /// The format of the screen's memory.
    pub format: PixelFormat,
    /// Whose memory it is.
    pub buffers: BufferKind,
    /// How modes are set.
    pub modesetting: Modesetting,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_written_as_they_are_read() {
        for text in ["1920x1080", "800x600@75"] {
            assert_eq!(text.parse::<ModeWish>().unwrap().to_string(), text);
        }
        for text in ["1920", "x", "axb", "1x1@", "1x1@fast"] {
            assert!(text.parse::<ModeWish>().is_err(), "{text}");
        }
    }
}
