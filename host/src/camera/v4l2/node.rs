//! A camera's device node: found by path or by name, opened, and asked what it is.

use super::ioctl::{self, Plain};
use crate::camera::CameraError;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use v4l::v4l_sys as sys;

/// Where the kernel lists nodes with their names.
pub(crate) const CLASS: &str = "/sys/class/video4linux";

/// The number of a node in [`CLASS`]; `None` for sub-devices and radios.
pub(crate) fn number(node: &Path) -> Option<u32> {
    node.file_name()?.to_str()?.strip_prefix("video")?.parse().ok()
}

/// Nodes of `class` in their order. A USB camera makes two, pictures and metadata; the pictures' one has index 0.
pub(crate) fn picture_nodes(class: &Path) -> Vec<PathBuf> {
    let is_first = |node: &Path| fs::read_to_string(node.join("index")).is_ok_and(|text| text.trim() == "0");
    let entries = fs::read_dir(class).into_iter().flatten().flatten();
    let mut nodes: Vec<PathBuf> =
        entries.map(|entry| entry.path()).filter(|node| number(node).is_some() && is_first(node)).collect();
    nodes.sort_by_key(|node| number(node));
    nodes
}

/// Sub-devices of `class`, such as a sensor's `v4l-subdev0`, in their order.
pub(crate) fn sub_devices(class: &Path) -> Vec<PathBuf> {
    let number = |node: &Path| node.file_name()?.to_str()?.strip_prefix("v4l-subdev")?.parse::<u32>().ok();
    let entries = fs::read_dir(class).into_iter().flatten().flatten();
    let mut nodes: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|node| number(node).is_some()).collect();
    nodes.sort_by_key(|node| number(node));
    nodes
}

/// The node's name as the kernel lists it.
pub(crate) fn name(node: &Path) -> String {
    fs::read_to_string(node.join("name")).unwrap_or_default().trim().to_string()
}

/// The node that `device` means: a path, or the beginning of a camera's name.
fn find(device: &str, class: &Path) -> Option<PathBuf> {
    if device.starts_with('/') {
        return Some(PathBuf::from(device));
    }
    let found = picture_nodes(class).into_iter().find(|node| name(node).starts_with(device))?;
    Some(Path::new("/dev").join(found.file_name()?))
}

/// An open device node.
#[derive(Clone)]
pub(super) struct Node {
    pub path: String,
    pub file: Arc<File>,
}

impl Node {
    /// Opens what `device` means.
    ///
    /// # Errors
    /// [`CameraError::Lost`] when it is not there, [`CameraError::Device`] when it may not be opened.
    pub(super) fn open(device: &str) -> Result<Self, CameraError> {
        let path = find(device, Path::new(CLASS)).ok_or(CameraError::Lost)?;
        let nonblocking = rustix::fs::OFlags::NONBLOCK.bits() as i32;
        let opened = OpenOptions::new().read(true).write(true).custom_flags(nonblocking).open(&path);
        let path = path.display().to_string();
        match opened {
            Ok(file) => Ok(Node { path, file: Arc::new(file) }),
            Err(error) => Err(opening(path, &error)),
        }
    }

    /// Opens the node that has a camera's controls, where it is another (`camera.controls`).
    ///
    /// # Errors
    /// [`CameraError::Device`] when it is not there or may not be opened.
    pub(super) fn open_controls(device: &str) -> Result<Self, CameraError> {
        Self::open(device).map_err(|error| match error {
            CameraError::Lost => CameraError::Device {
                path: device.into(),
                what: "is not there, and camera.controls names it; `relume devices` lists sub-devices".into(),
            },
            other => other,
        })
    }

    /// Makes sure that the node gives pictures, in buffers that can be mapped.
    ///
    /// # Errors
    /// [`CameraError::Device`] when it does not.
    pub(super) fn check_captures(&self) -> Result<(), CameraError> {
        let mut caps = sys::v4l2_capability::zeroed();
        ioctl::ioctl(&self.file, &ioctl::QUERYCAP, &mut caps).map_err(|error| self.fault("is no V4L2 node", &error))?;
        let of_node = caps.capabilities & sys::V4L2_CAP_DEVICE_CAPS != 0;
        let flags = if of_node { caps.device_caps } else { caps.capabilities };
        let has = |flag: u32| flags & flag != 0;
        if has(sys::V4L2_CAP_VIDEO_CAPTURE) && has(sys::V4L2_CAP_STREAMING) {
            Ok(())
        } else if has(sys::V4L2_CAP_VIDEO_CAPTURE_MPLANE) {
            Err(self.refused("gives its pictures in several planes, which is not supported"))
        } else {
            Err(self.refused("captures no pictures; `relume devices` lists the nodes that do"))
        }
    }

    /// A refusal by this node.
    pub(super) fn refused(&self, what: impl Into<String>) -> CameraError {
        CameraError::Device { path: self.path.clone(), what: what.into() }
    }

    /// What an error of the driver means.
    pub(super) fn fault(&self, what: &str, error: &io::Error) -> CameraError {
        match errno(error) {
            Some(Errno::NODEV | Errno::NXIO) => CameraError::Lost,
            Some(Errno::TIMEDOUT) => CameraError::Timeout,
            _ => self.refused(format!("{what}: {error}")),
        }
    }

    /// What an error means while the node is being set up, where a busy device is another program's.
    pub(super) fn setup_fault(&self, what: &str, error: &io::Error) -> CameraError {
        match errno(error) {
            Some(Errno::BUSY) => CameraError::Busy { path: self.path.clone() },
            Some(Errno::NOSPC) => {
                self.refused("finds no room on its USB bus: ask for a smaller size, or use another port")
            }
            _ => self.fault(what, error),
        }
    }
}

pub(super) use rustix::io::Errno;

/// The system's number of an error.
pub(super) fn errno(error: &io::Error) -> Option<Errno> {
    error.raw_os_error().map(Errno::from_raw_os_error)
}

fn opening(path: String, error: &io::Error) -> CameraError {
    match errno(error) {
        Some(Errno::NOENT | Errno::NODEV | Errno::NXIO) => CameraError::Lost,
        Some(Errno::BUSY) => CameraError::Busy { path },
        Some(Errno::ACCESS | Errno::PERM) => {
            CameraError::Device { path, what: "may not be opened; add this user to the group video".into() }
        }
        _ => CameraError::Device { path, what: format!("cannot be opened: {error}") },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_found_by_the_beginning_of_its_name() {
        let class = tempfile::tempdir().unwrap();
        let nodes = [("video0", "vivid-000-vid-cap", "0"), ("video10", "Sky Camera: Sky", "0"), ("radio0", "Sky", "0")];
        let metadata = ("video2", "Sky Camera: Sky", "1");
        for (node, name, index) in nodes.into_iter().chain([metadata]) {
            let folder = class.path().join(node);
            fs::create_dir(&folder).unwrap();
            fs::write(folder.join("name"), format!("{name}\n")).unwrap();
            fs::write(folder.join("index"), format!("{index}\n")).unwrap();
        }
        for node in ["v4l-subdev10", "v4l-subdev2"] {
            fs::create_dir(class.path().join(node)).unwrap();
        }
        assert_eq!(sub_devices(class.path()), ["v4l-subdev2", "v4l-subdev10"].map(|node| class.path().join(node)));
        assert_eq!(find("Sky", class.path()), Some(PathBuf::from("/dev/video10")));
        assert_eq!(find("vivid", class.path()), Some(PathBuf::from("/dev/video0")));
        assert_eq!(find("/dev/video7", class.path()), Some(PathBuf::from("/dev/video7")));
        assert_eq!(find("Moon", class.path()), None);
    }

    #[test]
    fn what_is_not_there_is_lost_and_what_is_no_camera_says_so() {
        assert!(matches!(Node::open("/dev/video-none"), Err(CameraError::Lost)));
        assert!(matches!(Node::open("No Such Camera"), Err(CameraError::Lost)));
        let error = Node::open_controls("/dev/v4l-subdev-none").err().unwrap().to_string();
        assert!(error.starts_with("/dev/v4l-subdev-none: is not there, and camera.controls"), "{error}");
        let error = Node::open("/dev/null").unwrap().check_captures().unwrap_err();
        assert!(error.to_string().starts_with("/dev/null: is no V4L2 node"), "{error}");
    }

    #[test]
    fn errors_of_the_driver_say_what_to_do() {
        let node = Node::open("/dev/null").unwrap();
        let fault = |errno: Errno| node.fault("x", &io::Error::from(errno));
        assert!(matches!(fault(Errno::NODEV), CameraError::Lost));
        assert!(matches!(fault(Errno::TIMEDOUT), CameraError::Timeout));
        assert!(matches!(fault(Errno::BUSY), CameraError::Device { .. }));
        let busy = node.setup_fault("x", &io::Error::from(Errno::BUSY));
        assert_eq!(busy.to_string(), "/dev/null is in use by another program: stop that one, or name another camera");
        let crowded = node.setup_fault("x", &io::Error::from(Errno::NOSPC));
        assert!(crowded.to_string().contains("another port"), "{crowded}");
        let denied = opening("/dev/video0".into(), &io::Error::from(Errno::ACCESS));
        assert!(denied.to_string().contains("group video"), "{denied}");
    }
}
