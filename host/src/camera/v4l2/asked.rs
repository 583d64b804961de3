//! A node that is asked what it can do, and left as it is.

use super::controls::{DeviceControls, listed, short};
use super::formats;
use super::node::Node;
use crate::camera::CameraError;
use std::path::Path;
use std::sync::Arc;

/// An open node, whether of a camera or of a sensor's sub-device.
pub(crate) struct Asked(Node);

impl Asked {
    /// Opens a node.
    ///
    /// # Errors
    /// Why it does not open.
    pub(crate) fn open(path: &Path) -> Result<Self, CameraError> {
        Node::open(&path.display().to_string()).map(Asked)
    }

    /// What its controls take and have now, a line each.
    pub(crate) fn controls(&self) -> Vec<String> {
        listed(&DeviceControls(Arc::clone(&self.0.file)))
    }

    /// Frames a second that it offers with a format (fourcc) and size: `30`, or `5..30`.
    pub(crate) fn rates(&self, fourcc: [u8; 4], size: [u32; 2]) -> Option<String> {
        formats::rates_hz(&self.0, fourcc, size).map(words)
    }
}

/// Least and most frames a second in words.
pub(crate) fn words([least, most]: [f64; 2]) -> String {
    let (least, most) = (short(least), short(most));
    if least == most { most } else { format!("{least}..{most}") }
}
