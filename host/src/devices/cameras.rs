//! V4L2 capture nodes.

use super::{CaptureNode, SubDevice, advice};
use crate::camera::v4l2::asked::Asked;
use crate::camera::v4l2::node::{self, CLASS};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture;

pub(super) fn list() -> Vec<CaptureNode> {
    node::picture_nodes(Path::new(CLASS)).iter().filter_map(|node| describe(node)).collect()
}

/// Sub-devices, whether they have controls or not.
pub(super) fn sub_devices() -> Vec<SubDevice> {
    let describe = |node: &PathBuf| {
        let path = Path::new("/dev").join(node.file_name()?);
        let asked = Asked::open(&path);
        let problem = asked.as_ref().err().map(ToString::to_string);
        let controls = asked.map(|asked| asked.controls()).unwrap_or_default();
        Some(SubDevice { path: path.display().to_string(), name: node::name(node), controls, problem })
    };
    node::sub_devices(Path::new(CLASS)).iter().filter_map(describe).collect()
}

/// `None` for nodes that capture nothing (outputs, decoders).
fn describe(node: &Path) -> Option<CaptureNode> {
    let path = Path::new("/dev").join(node.file_name()?);
    let name = node::name(node);
    let driver = fs::canonicalize(node.join("device/driver")).ok();
    let driver = driver.and_then(|d| Some(d.file_name()?.to_string_lossy().into_owned()));
    let driver = driver.unwrap_or_else(|| "unknown driver".into());
    let asked = Asked::open(&path).ok();
    let controls = asked.as_ref().map(Asked::controls).unwrap_or_default();
    let found = |formats, problem| {
        Some(CaptureNode { path: path.display().to_string(), name, driver, formats, controls, problem })
    };
    let device = match v4l::Device::with_path(&path) {
        Ok(device) => device,
        Err(error) => return found(Vec::new(), Some(advice(&path, &error))),
    };
    // The v4l crate panics on driver strings that are not UTF-8; a listing must survive them.
    match catch_unwind(AssertUnwindSafe(|| formats(&device, asked.as_ref()))) {
        Ok(Some(formats)) => found(formats, None),
        Ok(None) => None,
        Err(_) => found(Vec::new(), Some(format!("{} gives names that are not text", path.display()))),
    }
}

fn formats(device: &v4l::Device, asked: Option<&Asked>) -> Option<Vec<String>> {
    use v4l::capability::Flags;
    let flags = device.query_caps().ok()?.capabilities;
    if !flags.intersects(Flags::VIDEO_CAPTURE | Flags::VIDEO_CAPTURE_MPLANE) {
        return None;
    }
    let formats = device.enum_formats().unwrap_or_default();
    Some(formats.iter().map(|format| format!("{} {}", format.fourcc, sizes(device, asked, format.fourcc))).collect())
}

/// Sizes of a format, each with its frames a second where the driver tells them: `640x480@5..30`.
fn sizes(device: &v4l::Device, asked: Option<&Asked>, fourcc: v4l::FourCC) -> String {
    let sizes = device.enum_framesizes(fourcc).unwrap_or_default();
    let text: Vec<String> = sizes
        .iter()
        .map(|size| match &size.size {
            FrameSizeEnum::Discrete(d) => {
                let rates = asked.and_then(|asked| asked.rates(fourcc.repr, [d.width, d.height]));
                format!("{}x{}{}", d.width, d.height, rates.map_or_else(String::new, |rates| format!("@{rates}")))
            }
            FrameSizeEnum::Stepwise(s) => {
                format!("{}x{}..{}x{}", s.min_width, s.min_height, s.max_width, s.max_height)
            }
        })
        .collect();
    text.join(" ")
}
