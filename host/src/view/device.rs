//! A real camera for the view: it sets its exposure and colours itself, and is opened again whenever it is lost.

use crate::camera::reopen::{Patience, Reopening};
use crate::camera::unpack::formats::from_name;
use crate::camera::v4l2::{V4l2Camera, V4l2Settings};
use crate::camera::{Camera, CameraLimits};
use crate::config::ViewCamera;

/// What the post's file asks of it, for a field of `size` = width and height.
pub fn v4l2_settings(wanted: &ViewCamera, size: (usize, usize)) -> V4l2Settings {
    let of = |(width, height): (usize, usize)| [width as u32, height as u32];
    let (device, asked, fourcc) = match wanted {
        ViewCamera::Device { device, size, pixel_format } => (device.clone(), *size, pixel_format.as_deref()),
        ViewCamera::Frames(_) => (String::new(), None, None),
    };
    V4l2Settings {
        device,
        size: asked.map(of),
        near_size: Some(of(size)),
        fourcc: fourcc.map(from_name),
        manual: false,
        ..V4l2Settings::default()
    }
}

/// The camera, which need not be there yet.
pub fn reopening(wanted: &ViewCamera, size: (usize, usize)) -> Box<dyn Camera> {
    let settings = v4l2_settings(wanted, size);
    let open = move || V4l2Camera::open(&settings);
    Box::new(Reopening::waiting(open, CameraLimits::nothing_to_set(size), Patience::default()))
}
