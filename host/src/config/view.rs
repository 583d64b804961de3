//! `view` and `[view_camera]`: the real picture behind.

use super::ConfigError;
use super::reader::Reader;
use super::sky::CameraConfig;
use std::path::PathBuf;

/// A camera for a live view.
#[derive(Clone, Debug, PartialEq)]
pub enum ViewCamera {
    /// A real one.
    Device {
        /// Its node, or how its name begins.
        device: String,
        /// Width and height that it is asked for; the field's, or what comes near, if none.
        size: Option<(usize, usize)>,
        /// Pixel format (fourcc) that it is asked for.
        pixel_format: Option<String>,
    },
    /// Pictures that were taken before, again and again: their folder, with its `frames.json`.
    Frames(PathBuf),
}

impl ViewCamera {
    /// What faults call it.
    pub fn name(&self) -> String {
        match self {
            ViewCamera::Device { device, .. } => device.clone(),
            ViewCamera::Frames(folder) => folder.display().to_string(),
        }
    }
}

const OF_DEVICE: [&str; 2] = ["view_camera.size", "view_camera.pixel_format"];

/// Keys about the view that need others.
pub(super) fn check(r: &Reader) -> Result<(), ConfigError> {
    if r.has("view_light") && !r.has("view") {
        return Err(
            r.fault("view_light is the light that the still was taken in; name the still: view = \"site.png\"".into())
        );
    }
    if r.has("view_response") && !r.has("view") {
        return Err(r.fault(
            "view_response is the curve of the camera that took the still: name the still (view), or write \
             view_camera.response for a live view"
                .into(),
        ));
    }
    if r.has("view_light") && r.has_table("view_camera") {
        return Err(r.fault("view_light is for stills; a camera's pictures are in today's light: remove it".into()));
    }
    let by_view = r.text("exposure.mode", 20)?.is_some_and(|mode| mode == "view");
    if by_view && !r.has("view") && !r.has_table("view_camera") {
        return Err(r.fault("exposure.mode = \"view\" needs a view: name a still or a camera, or use \"auto\"".into()));
    }
    if by_view && r.has("view_light") {
        return Err(r.fault(
            "exposure.mode = \"view\" and view_light exclude each other: a still that is relit is exposed anew".into(),
        ));
    }
    Ok(())
}

/// Reads `[view_camera]`.
pub(super) fn view_camera(r: &Reader, sky: &CameraConfig) -> Result<Option<ViewCamera>, ConfigError> {
    if !r.has_table("view_camera") {
        return Ok(None);
    }
    let (device, frames) = (r.text("view_camera.device", 200)?, r.path("view_camera.frames")?);
    let (size, pixel_format) = (r.size("view_camera.size")?, r.text("view_camera.pixel_format", 4)?);
    match (device, frames) {
        (Some(_), Some(_)) => {
            Err(r.fault("view_camera.device and view_camera.frames exclude each other; remove one of them".into()))
        }
        (None, None) => Err(r.fault(
            "view_camera.device is missing: name the node of the camera for the view (`relume devices` lists them), or remove \
             [view_camera] for a still"
                .into(),
        )),
        (Some(device), None) if sky.device.as_ref() == Some(&device) => Err(r.fault(format!(
            "view_camera.device = \"{device}\": that is the sky camera (camera.device); one camera cannot be both"
        ))),
        (Some(device), None) => Ok(Some(ViewCamera::Device { device, size, pixel_format })),
        (None, Some(frames)) => match OF_DEVICE.iter().find(|key| r.has(key)) {
            Some(key) => Err(r.fault(format!("{key} is only used with view_camera.device; remove it"))),
            None => Ok(Some(ViewCamera::Frames(frames))),
        },
    }
}
