//! Pose and lens of a still from points that were measured in the world: where the camera stood, how it looked and how its
//! lens bends, with what is doubtful about it.
//!
//! Poses from three points at a time, under a ladder of focal lengths, are the starts (search.rs); each is refined with a
//! bounded loss, then by least squares over the points that fit, pose, focal length, principal point and distortion at once
//! (refine.rs). Points that do not fit are named, and have no part in it.

pub mod doubt;
pub mod edges;
pub mod model;
pub mod overlay;
pub mod points;
mod refine;
mod report;
mod search;
#[cfg(test)]
mod tests;
mod threepoint;

use crate::camera::{Camera, Projection};
use doubt::{Doubt, Square};
use glam::DVec3;
use model::{Model, Prior, diagonal_px};
use points::Point;
use refine::{Refined, refine};
pub use threepoint::Stand;

/// Standard deviation that is expected of points which a careful person clicks, px in each axis.
pub const USUAL_NOISE_PX: f64 = 0.5;
/// A residual beyond this share of the diagonal is no noise.
const NOT_NOISE: f64 = 0.004;
/// Share of the points that must fit.
const MOST: f64 = 0.6;
/// A fisheye's model is taken where the evidence for it against a radial one is very strong: twice the logarithm of the Bayes
/// factor (Kass & Raftery, *Bayes Factors*, JASA 1995).
const CLEARLY: f64 = 10.0;

/// What is known of the still beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The lens's model; none: radial, unless the points speak for the other.
    pub projection: Option<Projection>,
    /// Expected noise of the points in each axis, px.
    pub noise_px: f64,
    /// The largest angle from the axis that is imaged, degrees; 180 if the picture fills the still.
    pub max_angle_deg: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options { projection: None, noise_px: USUAL_NOISE_PX, max_angle_deg: 180.0 }
    }
}

/// Why points give no camera; one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// No camera shows enough of them where they are.
    #[error(
        "no camera shows these points where the still does: at best {fitting} of {count} fit; check columns and rows, units \
         and axes (metres, +Y up)"
    )]
    NoFit {
        /// Points that fit.
        fitting: usize,
        /// All.
        count: usize,
    },
    /// They fit in a mirror.
    #[error(
        "the points fit a mirrored world only: count rows from the top, and take right-handed axes (x east, y up, z south)"
    )]
    Mirrored,
}

/// How a point fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// The point.
    pub point: Point,
    /// From where the still shows it to where the camera would, px; none where it would not show it at all.
    pub residual_px: Option<[f64; 2]>,
    /// Whether it had a part in the fit.
    pub fits: bool,
}

impl Seen {
    /// Length of the residual, px; infinite where the camera does not show the point.
    pub fn off_px(&self) -> f64 {
        self.residual_px.map_or(f64::INFINITY, |[x, y]| x.hypot(y))
    }
}

/// A fitted camera.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The camera as the fit has it.
    pub model: Model,
    /// What was thought of its lens beforehand.
    pub prior: Prior,
    /// Noise of the points that fit, standard deviation in each axis, px.
    pub noise_px: f64,
    /// Covariance of the model's moves.
    pub covariance: Square,
    /// Every point.
    pub seen: Vec<Seen>,
    /// Standard errors.
    pub doubt: Doubt,
}

/// Fits a camera to `points` of a still of `size_px` (width, height).
///
/// # Errors
/// [`PoseError`]: they fit no camera.
pub fn fit(points: &[Point], size_px: [u32; 2], options: &Options) -> Result<Fit, PoseError> {
    let enough = |refined: &Refined| {
        let fitting = refined.fits.iter().filter(|fits| **fits).count();
        let is_noise = refined.sigma_px <= (NOT_NOISE * diagonal_px(size_px)).max(3.0 * options.noise_px);
        is_noise && fitting as f64 >= MOST * points.len() as f64
    };
    let found = best(points, size_px, options);
    let Some(refined) = found.as_ref().filter(|refined| enough(refined)) else {
        let mirror = |point: &Point| Point { world: point.world * DVec3::new(-1.0, 1.0, 1.0), ..*point };
        let mirrored: Vec<Point> = points.iter().map(mirror).collect();
        if best(&mirrored, size_px, options).as_ref().is_some_and(enough) {
            return Err(PoseError::Mirrored);
        }
        let is_noise = |refined: &&Refined| refined.sigma_px <= NOT_NOISE * diagonal_px(size_px);
        let fitting = found.as_ref().filter(is_noise).map_or(0, |refined| refined.fits.iter().filter(|f| **f).count());
        return Err(PoseError::NoFit { fitting, count: points.len() });
    };
    Ok(Fit::new(points, refined))
}

/// The most probable camera of the models that are allowed.
fn best(points: &[Point], size_px: [u32; 2], options: &Options) -> Option<Refined> {
    let under = |projection: Projection| {
        refine(points, &search::starts(points, size_px, projection, options.max_angle_deg), options.noise_px)
    };
    match options.projection {
        Some(projection) => under(projection),
        None => match (under(Projection::Radial), under(Projection::KannalaBrandt)) {
            (Some(radial), Some(fisheye)) => {
                Some(if fisheye.unlikeliness + CLEARLY < radial.unlikeliness { fisheye } else { radial })
            }
            (radial, fisheye) => radial.or(fisheye),
        },
    }
}

impl Fit {
    fn new(points: &[Point], refined: &Refined) -> Self {
        let Refined { model, prior, sigma_px, covariance, fits, .. } = refined.clone();
        let projector = model.projector();
        let seen = |(point, fits): (&Point, bool)| Seen { point: *point, residual_px: projector.residual(point), fits };
        let seen: Vec<Seen> = points.iter().zip(fits).map(seen).collect();
        let used: Vec<Point> = seen.iter().filter(|seen| seen.fits).map(|seen| seen.point).collect();
        let doubt = Doubt::new(&model, &covariance, &used);
        Fit { model, prior, noise_px: sigma_px, covariance, seen, doubt }
    }

    /// The camera for a camera file; north is `north_deg` from -Z towards +X.
    pub fn camera(&self, north_deg: f64) -> Camera {
        let Stand { rotation, eye } = self.model.stand;
        let axes_world = rotation.transpose();
        let target = eye + axes_world.z_axis * self.model.scale_m;
        let optics = self.model.optics();
        Camera {
            position: eye.to_array(),
            target: target.to_array(),
            up: (-axes_world.y_axis).to_array(),
            fov_y_deg: optics.pinhole_fov_y_deg(),
            north_deg,
            optics: Some(optics),
        }
    }

    /// Points that do not fit.
    pub fn strays(&self) -> impl Iterator<Item = &Seen> {
        self.seen.iter().filter(|seen| !seen.fits)
    }

    /// Residuals of the points that fit, px, rms of their lengths and the largest.
    pub fn residuals_px(&self) -> [f64; 2] {
        let own = || self.seen.iter().filter(|seen| seen.fits).map(Seen::off_px);
        let rms = (own().map(|off| off * off).sum::<f64>() / own().count().max(1) as f64).sqrt();
        [rms, own().fold(0.0, f64::max)]
    }
}
