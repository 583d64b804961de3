//! What there is to say of a fitted camera, for people and as JSON.

use super::{Fit, Seen};
use crate::camera::Projection;
use serde_json::{Value, json};
use std::fmt;

/// The focal length is not told where its standard error is larger than this share.
const VAGUE: f64 = 0.05;

impl Fit {
    /// One JSON object.
    pub fn to_json(&self) -> Value {
        let doubt = &self.doubt;
        let [rms, largest] = self.residuals_px();
        let point = |seen: &Seen| {
            json!({
                "line": seen.point.line,
                "residual_px": seen.residual_px,
                "fits": seen.fits,
            })
        };
        json!({
            "points": self.seen.iter().map(point).collect::<Vec<_>>(),
            "points_fitting": self.seen.iter().filter(|seen| seen.fits).count(),
            "residual_rms_px": rms,
            "residual_largest_px": largest,
            "noise_px": self.noise_px,
            "lens_prior": self.prior.name,
            "standard_error": {
                "position_m": doubt.position_m,
                "orientation_deg": doubt.orientation_deg,
                "focal_px": doubt.focal_px,
                "principal_px": doubt.principal_px,
                "distortion_at_corner_px": doubt.bend_px,
                "picture_rms_px": doubt.picture_px,
                "picture_worst_px": doubt.picture_worst_px,
            },
        })
    }

    /// What the points do not tell, one line each.
    pub fn warnings(&self) -> Vec<String> {
        let mut all: Vec<String> = self
            .strays()
            .map(|seen| {
                let Seen { point, residual_px, .. } = seen;
                let off = match residual_px {
                    Some(_) => format!("is {:.1} px off", seen.off_px()),
                    None => "lies behind the camera or beyond its lens".to_owned(),
                };
                format!("line {}: the point {off} and was left out; measure it again", point.line)
            })
            .collect();
        if self.doubt.focal_px > VAGUE * self.model.focal_px {
            all.push(
                "these points hardly tell the focal length from the distance: add some that are much nearer or farther"
                    .to_owned(),
            );
        }
        if self.doubt.picture_worst_px > 4.0 * self.doubt.picture_px.max(0.5) {
            all.push("parts of the picture are far from any point: add some there, towards the corners".to_owned());
        }
        all
    }
}

impl fmt::Display for Fit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (optics, doubt) = (self.model.optics(), &self.doubt);
        let [rms, largest] = self.residuals_px();
        let fitting = self.seen.iter().filter(|seen| seen.fits).count();
        let [x, y, z] = self.model.stand.eye.to_array();
        let [cx, cy] = optics.principal_px;
        let (model, terms) = match optics.projection {
            Projection::Radial => ("radial", 3),
            Projection::KannalaBrandt => ("Kannala-Brandt", 4),
        };
        writeln!(
            f,
            "points       {fitting} of {} fit, {rms:.2} px off (rms), {largest:.2} px at most",
            self.seen.len()
        )?;
        writeln!(f, "position     ({x:.3}, {y:.3}, {z:.3}) m, standard error {:.3} m", doubt.position_m)?;
        writeln!(f, "orientation  standard error {:.3} degrees", doubt.orientation_deg)?;
        writeln!(f, "focal length {:.1} px, standard error {:.1} px", optics.focal_px, doubt.focal_px)?;
        writeln!(f, "axis at      ({cx:.1}, {cy:.1}) px, standard error {:.1} px", doubt.principal_px)?;
        let (k, name, bend) = (&optics.k[..terms], self.prior.name, doubt.bend_px);
        writeln!(f, "lens         {model}, k {k:.5?} ({name}), standard error {bend:.1} px in the corners")?;
        writeln!(
            f,
            "picture      expected to be {:.2} px off (rms), {:.2} px at worst, where places are as far as the points",
            doubt.picture_px, doubt.picture_worst_px
        )
    }
}
