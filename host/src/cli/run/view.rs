//! The live view that a post's file asks for.

use crate::camera::Camera;
use crate::camera::replay::ReplayCamera;
use crate::config::{ClockConfig, Config, ViewCamera};
use crate::failure::{Failure, OrFail};
use crate::view::curve::ViewCurve;
use crate::view::fit::Fit;
use crate::view::live::{BackgroundView, CameraView, ViewSource};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// How long the first frame waits for the view's first picture.
const FIRST_PICTURE: Duration = Duration::from_secs(3);

/// The view's camera behind a field of `size` = width and height. A real one has a thread of its own, and so have pictures
/// by the system's clock, one a frame at most; by a simulated clock every frame has its picture.
pub(super) fn live_view(
    config: &Config,
    size: (usize, usize),
    stop: &AtomicBool,
) -> Result<Option<Box<dyn ViewSource>>, Failure> {
    let Some(wanted) = &config.view_camera else { return Ok(None) };
    let curve = ViewCurve::load_named(config.view_camera_response.as_deref()).or_bad()?;
    let view = CameraView::new(&wanted.name(), camera(config, wanted, size)?, size).with_curve(curve);
    let pace = match (wanted, config.clock) {
        (ViewCamera::Frames(_), ClockConfig::Simulated { .. }) => return Ok(Some(Box::new(view))),
        (ViewCamera::Frames(_), ClockConfig::System { interval_s }) => Duration::from_secs_f64(interval_s),
        (ViewCamera::Device { .. }, _) => Duration::ZERO,
    };
    let mut view = BackgroundView::start(view, pace).or_runtime()?;
    view.wait(FIRST_PICTURE, stop);
    Ok(Some(Box::new(view)))
}

fn camera(config: &Config, wanted: &ViewCamera, size: (usize, usize)) -> Result<Box<dyn Camera>, Failure> {
    match wanted {
        ViewCamera::Frames(folder) => {
            let camera = ReplayCamera::open(folder, true).or_bad()?;
            let found = (camera.limits().width, camera.limits().height);
            let refused = |what| Failure::bad(format!("{}: {what}", folder.display()));
            Fit::new(size).check(found).map_err(refused)?;
            Ok(Box::new(camera))
        }
        #[cfg(feature = "board")]
        ViewCamera::Device { .. } => {
            let _ = config;
            Ok(crate::view::device::reopening(wanted, size))
        }
        #[cfg(not(feature = "board"))]
        ViewCamera::Device { .. } => Err(super::no_drivers(config, "view_camera.device")),
    }
}
