//! The real picture behind: still and live view, and the curves of their cameras.

use super::Table;
#[cfg(feature = "board")]
use super::machine;
use crate::camera::replay::ReplayCamera;
use crate::camera::{Camera, CameraLimits};
use crate::config::{Config, ViewCamera};
use crate::view::Still;
use crate::view::curve::{Grain, ViewCurve};
use crate::view::fit::Fit;
use crate::view::live::CameraView;
use crate::view::mask::Mask;
use std::path::{Path, PathBuf};

/// What there is of a view.
pub(super) struct Behind {
    pub(super) still: Option<Still>,
    /// What stands in front of the picture.
    pub(super) mask: Option<Mask>,
    /// Goes on streaming while the sky's camera is looked at, as it will later: one USB bus may have no room for both.
    pub(super) live: Option<CameraView>,
}

/// Opens still and live view behind a field of `size`.
pub(super) fn behind(config: &Config, size: Option<(usize, usize)>, table: &mut Table) -> Behind {
    let still_curve = curve("still by", &config.view_response, table);
    let still = config.view.as_ref().and_then(|path| {
        let still = match size {
            Some(size) => Still::load_sized(path, size, still_curve.as_ref()),
            None => Still::load(path, still_curve.as_ref()),
        };
        let words = |still: Still| {
            let words = format!("{}: {}x{}", path.display(), still.width, still.height);
            (still, words)
        };
        table.add("view", still.map(words))
    });
    let camera = config.view_camera.as_ref().and_then(|camera| live_view(config, camera, size, table));
    let live_curve = curve("live by", &config.view_camera_response, table);
    let live = camera.map(|camera| {
        let name = config.view_camera.as_ref().map(ViewCamera::name).unwrap_or_default();
        CameraView::new(&name, camera, size.unwrap_or((1, 1))).with_curve(live_curve)
    });
    let mask = config.mask.as_ref().zip(size).and_then(|(path, (width, height))| mask(path, (width, height), table));
    Behind { still, mask, live }
}

/// The painted mask, of the field's size.
fn mask(path: &Path, (width, height): (usize, usize), table: &mut Table) -> Option<Mask> {
    let words = |mask: Mask| {
        let in_front =
            mask.shares().iter().map(|&share| f64::from(share) / 255.0).sum::<f64>() / mask.shares().len() as f64;
        let words = format!("{}: the view stands in front in {:.1} % of the picture", path.display(), 100.0 * in_front);
        (mask, words)
    };
    table.add("mask", Mask::load_sized(path, width, height).map(words))
}

/// A view's own curve, where one is named.
fn curve(what: &'static str, path: &Option<PathBuf>, table: &mut Table) -> Option<ViewCurve> {
    let path = path.as_ref()?;
    let loaded = ViewCurve::load(path).map(|curve| {
        let Grain { distinct, widest_step } = curve.grain();
        let words =
            format!("{}: 256 codes become at least {distinct} of sRGB, {widest_step} apart at most", path.display());
        (curve, words)
    });
    table.add(what, loaded)
}

/// The camera of a live view; `size` is the field's.
fn live_view(
    config: &Config,
    camera: &ViewCamera,
    size: Option<(usize, usize)>,
    table: &mut Table,
) -> Option<Box<dyn Camera>> {
    match camera {
        ViewCamera::Frames(folder) => {
            let frames = ReplayCamera::open(folder, true).map_err(|error| error.to_string());
            let found = frames.and_then(|frames| {
                let CameraLimits { width, height, .. } = frames.limits();
                let words = format!("frames from {}: {}", folder.display(), fitted((width, height), size)?);
                Ok((Box::new(frames) as Box<dyn Camera>, words))
            });
            table.add("live", found)
        }
        #[cfg(feature = "board")]
        ViewCamera::Device { .. } => {
            let _ = config;
            machine::view_camera(camera, size, table)
        }
        #[cfg(not(feature = "board"))]
        ViewCamera::Device { .. } => {
            let refused = crate::cli::run::no_drivers(config, "view_camera.device");
            table.add("live", Err::<(Box<dyn Camera>, String), _>(refused))
        }
    }
}

/// How a picture of `found` pixels stands behind a field of `size`.
pub(super) fn fitted(found: (usize, usize), size: Option<(usize, usize)>) -> Result<String, String> {
    let words = format!("{}x{}", found.0, found.1);
    match size {
        Some(size) if size != found => {
            Fit::new(size).check(found).map_err(|error| error.to_string())?;
            Ok(format!("{words}, scaled to {}x{}", size.0, size.1))
        }
        _ => Ok(words),
    }
}
