//! `LENS.json`: reading, checking and writing it.

use super::mask::SkyMask;
use super::{Lens, LensModel, VIGNETTING_END};
use crate::jsonfile::{self, JsonError};
use crate::outfile::OutError;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The fields of `LENS.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensFile {
    /// Projection.
    pub model: LensModel,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Where the axis meets the picture, pixels.
    pub center_px: [f64; 2],
    /// Kannala-Brandt's coefficients.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub k: [f64; 4],
    /// Rotation from camera to world, rows.
    pub camera_to_world: [[f64; 3]; 3],
    /// Width of the picture, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width: Option<usize>,
    /// Height of the picture, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<usize>,
    /// Coefficients of the vignetting curve; zeros if all light passes.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub vignetting: [f64; 3],
    /// The mask's PNG, relative to the lens file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<PathBuf>,
}

fn is_zero<const N: usize>(values: &[f64; N]) -> bool {
    *values == [0.0; N]
}

impl LensFile {
    /// Checks the fields and makes the lens, without its mask; `name` is what errors call it.
    ///
    /// # Errors
    /// [`JsonError::Value`], naming the field.
    pub fn lens(&self, name: &str) -> Result<Lens, JsonError> {
        let bad = |field, what: &str| Err(JsonError::Value { name: name.into(), field, what: what.into() });
        if let Some((field, what)) = self.fault() {
            return bad(field, what);
        }
        let mut lens = Lens {
            model: self.model,
            focal_px: self.focal_px,
            center_px: self.center_px,
            k: self.k,
            camera_to_world: self.camera_to_world,
            size: self.width.zip(self.height),
            vignetting: self.vignetting,
            mask: None,
            max_theta: PI,
        };
        let steps = 720;
        let turns =
            (1..=steps).map(|i| PI * f64::from(i) / f64::from(steps)).find(|&t| lens.radius_and_slope(t).1 <= 0.0);
        lens.max_theta = turns.unwrap_or(PI) - PI / f64::from(steps);
        if let Some((degrees, share)) = unfit_vignetting(&lens) {
            return bad(
                "vignetting",
                &format!(
                    "lets the share {share:.3} pass {degrees} degrees off the axis; \
                       it must stay between {} and {} within the picture",
                    PASSES.start(),
                    PASSES.end()
                ),
            );
        }
        Ok(lens)
    }

    /// The first field whose value makes no lens, and what to do.
    fn fault(&self) -> Option<(&'static str, &'static str)> {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        if !(self.focal_px.is_finite() && self.focal_px > 0.0) {
            return Some(("focal_px", "must be a positive number of pixels"));
        }
        if !finite(&self.center_px) {
            return Some(("center_px", "must be two finite numbers"));
        }
        if !finite(&self.k) {
            return Some(("k", "must be four finite numbers"));
        }
        if self.model != LensModel::KannalaBrandt && self.k != [0.0; 4] {
            return Some(("k", "only kannala_brandt has coefficients; leave k out"));
        }
        if self.width.is_some() != self.height.is_some() || self.width == Some(0) || self.height == Some(0) {
            return Some(("width", "give width and height together, both above 0"));
        }
        (!is_rotation(&self.camera_to_world))
            .then_some(("camera_to_world", "must be a rotation: rows orthonormal within 1e-3, determinant +1"))
    }

    /// Writes the file, whole.
    ///
    /// # Errors
    /// [`OutError`], naming the file.
    pub fn save(&self, path: &Path) -> Result<(), OutError> {
        jsonfile::save(path, self)
    }
}

/// Shares of the light that a lens may let pass, relative to its axis.
const PASSES: std::ops::RangeInclusive<f64> = 0.02..=2.0;

/// The first whole degree within the picture at which the vignetting curve makes no sense, and the share there.
fn unfit_vignetting(lens: &Lens) -> Option<(u32, f64)> {
    let [cx, cy] = lens.center_px;
    let corner = lens.size.map(|(w, h)| cx.max(w as f64 - cx).hypot(cy.max(h as f64 - cy)));
    let end = corner.and_then(|radius| lens.theta_of(radius)).unwrap_or(PI).min(VIGNETTING_END);
    let shares = (0..=end.to_degrees() as u32).map(|degrees| (degrees, lens.passed(f64::from(degrees).to_radians())));
    shares.into_iter().find(|(_, share)| !PASSES.contains(share))
}

impl Lens {
    /// Reads `LENS.json` and the mask that it names.
    ///
    /// # Errors
    /// [`JsonError`], naming the file and the field at fault.
    pub fn load(path: &Path) -> Result<Self, JsonError> {
        let name = path.display().to_string();
        let file: LensFile = jsonfile::load(path)?;
        let mut lens = file.lens(&name)?;
        if let Some(mask) = &file.mask {
            let bad = |what: String| JsonError::Value { name: name.clone(), field: "mask", what };
            let place = path.parent().unwrap_or(Path::new("")).join(mask);
            let mask = SkyMask::load(&place).map_err(|error| bad(error.to_string()))?;
            let (width, height) = *lens.size.get_or_insert(mask.size());
            if mask.size() != (width, height) {
                let (w, h) = mask.size();
                return Err(bad(format!("{} has {w}x{h} pixels, the lens is for {width}x{height}", place.display())));
            }
            lens.mask = Some(Arc::new(mask));
        }
        Ok(lens)
    }
}

fn is_rotation(m: &[[f64; 3]; 3]) -> bool {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let unit = (0..3).all(|i| (0..3).all(|j| (dot(m[i], m[j]) - f64::from(u8::from(i == j))).abs() < 1e-3));
    let cross = [
        m[0][1] * m[1][2] - m[0][2] * m[1][1],
        m[0][2] * m[1][0] - m[0][0] * m[1][2],
        m[0][0] * m[1][1] - m[0][1] * m[1][0],
    ];
    unit && dot(cross, m[2]) > 0.0
}
