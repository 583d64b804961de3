//! What cameras and displays this machine has. Only builds with the feature `board` can look.

#[cfg(feature = "board")]
mod cameras;
#[cfg(feature = "board")]
mod cards;

use serde::Serialize;
use std::fmt;

/// A V4L2 node that captures pictures.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct CaptureNode {
    /// Device node.
    pub path: String,
    /// What the device calls itself.
    pub name: String,
    /// Kernel driver.
    pub driver: String,
    /// Formats (fourcc), each with its frame sizes.
    pub formats: Vec<String>,
    /// What its controls take and have now.
    pub controls: Vec<String>,
    /// What kept us from asking the device; the node is there all the same.
    pub problem: Option<String>,
}

/// A V4L2 sub-device: part of a camera with raw pictures, such as its sensor, which then has the controls.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SubDevice {
    /// Device node.
    pub path: String,
    /// What the device calls itself.
    pub name: String,
    /// What its controls take and have now.
    pub controls: Vec<String>,
    /// What kept us from asking the device; the node is there all the same.
    pub problem: Option<String>,
}

/// A DRM card and what hangs on it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Card {
    /// Device node.
    pub path: String,
    /// Kernel driver.
    pub driver: String,
    /// GBM's back end, if it opens.
    pub gbm: Option<String>,
    /// Where displays plug in.
    pub connectors: Vec<Connector>,
    /// What kept us from asking the card; the node is there all the same.
    pub problem: Option<String>,
}

/// One socket for a display.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Connector {
    /// Such as `HDMI-A-1`.
    pub name: String,
    /// A display is plugged in.
    pub connected: bool,
    /// Modes such as `1920x1080@60`, the preferred one first.
    pub modes: Vec<String>,
}

/// All devices found.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Devices {
    /// Cameras.
    pub cameras: Vec<CaptureNode>,
    /// Their sub-devices.
    pub sub_devices: Vec<SubDevice>,
    /// Cards with displays.
    pub cards: Vec<Card>,
}

/// Looks for cameras and displays; machines without any give an empty list.
#[cfg(feature = "board")]
pub fn list() -> Devices {
    Devices { cameras: cameras::list(), sub_devices: cameras::sub_devices(), cards: cards::list() }
}

impl fmt::Display for Devices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.cameras.is_empty() {
            writeln!(f, "no cameras: no V4L2 capture node in /dev")?;
        }
        for camera in &self.cameras {
            writeln!(f, "camera {}: {} ({})", camera.path, camera.name, camera.driver)?;
            camera.formats.iter().try_for_each(|format| writeln!(f, "  {format}"))?;
            camera.controls.iter().try_for_each(|control| writeln!(f, "  {control}"))?;
            camera.problem.iter().try_for_each(|problem| writeln!(f, "  {problem}"))?;
        }
        for part in &self.sub_devices {
            writeln!(f, "sub-device {}: {}; camera.controls may name it", part.path, part.name)?;
            part.controls.iter().chain(&part.problem).try_for_each(|line| writeln!(f, "  {line}"))?;
        }
        if self.cards.is_empty() {
            writeln!(f, "no displays: no DRM card in /dev/dri")?;
        }
        for card in &self.cards {
            let gbm = card.gbm.as_deref().unwrap_or("none, dumb buffers only");
            writeln!(f, "display card {}: {}, gbm back end: {gbm}", card.path, card.driver)?;
            for connector in &card.connectors {
                let state = if connector.connected { connector.modes.join(" ") } else { "nothing plugged in".into() };
                writeln!(f, "  {}: {state}", connector.name)?;
            }
            card.problem.iter().try_for_each(|problem| writeln!(f, "  {problem}"))?;
        }
        Ok(())
    }
}

#[cfg(feature = "board")]
fn advice(path: &std::path::Path, error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::PermissionDenied => {
            format!("{} may not be opened; add this user to the groups video and render", path.display())
        }
        std::io::ErrorKind::ResourceBusy => format!("{} is in use by another program", path.display()),
        _ => format!("{} cannot be opened: {error}", path.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_without_devices_says_so() {
        let text = Devices::default().to_string();
        assert!(text.contains("no cameras") && text.contains("no displays"), "{text}");
    }

    #[test]
    fn cameras_and_sub_devices_are_told_with_their_controls() {
        let text = |line: &str| line.to_string();
        let camera = CaptureNode {
            path: text("/dev/video0"),
            name: text("Sky Camera"),
            driver: text("uvcvideo"),
            formats: vec![text("YUYV 640x480@5..30")],
            controls: vec![text("exposure 0.0001 to 0.5 s")],
            problem: None,
        };
        let sensor = SubDevice {
            path: text("/dev/v4l-subdev0"),
            name: text("imx219 10-0010"),
            controls: vec![text("exposure 4 to 1759 lines")],
            problem: None,
        };
        let devices = Devices { cameras: vec![camera], sub_devices: vec![sensor], cards: Vec::new() };
        let told = "camera /dev/video0: Sky Camera (uvcvideo)\n  YUYV 640x480@5..30\n  exposure 0.0001 to 0.5 s\n\
                    sub-device /dev/v4l-subdev0: imx219 10-0010; camera.controls may name it\n  exposure 4 to 1759 lines\n";
        assert!(devices.to_string().starts_with(told), "{devices}");
    }

    #[test]
    #[cfg(feature = "board")]
    fn listing_never_fails() {
        let devices = list();
        assert!(devices.cameras.iter().all(|camera| camera.path.starts_with("/dev/video")));
    }
}
