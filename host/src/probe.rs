//! A clipped sun from an irradiance probe: what the horizontal plane receives beyond the sky that the camera measured.
//!
//! `PROBE.json`: `{"E_horizontal":[r,g,b],"relative_sigma":0.01}`, in the unit of the merged picture's radiance x sr; one
//! standard deviation of a reading is 1 % of it where the file does not say. The picture is what reached the sensor: what the
//! lens's vignetting took is given back before it is summed, and taken from the disc that is added. Its colours are the
//! camera's, the probe's Rec.709.

mod disc;

use crate::bracket::{CURVE_ERROR, Merged, PixelState};
use crate::colour::CameraColour;
use crate::jsonfile::{self, JsonError};
use crate::lens::Lens;
use disc::Disc;
use serde::Deserialize;
use std::path::Path;

/// Share of the hemisphere (by cosine) that must have been seen for the sky's irradiance to be told.
const LEAST_SEEN: f64 = 0.5;
/// A pixel within this angle of the sun's centre may belong to its glare, degrees.
const NEAR_DEG: f64 = 3.0;
/// One standard deviation of what the unseen part of the sky gives, over what it would give were it as bright as the rest.
const UNSEEN_SIGMA: f64 = 0.5;

/// What a probe measured.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Irradiance on the horizontal plane, RGB.
    #[serde(rename = "E_horizontal")]
    pub horizontal: [f64; 3],
    /// One standard deviation of a reading over the reading.
    #[serde(default = "one_per_cent")]
    pub relative_sigma: f64,
}

fn one_per_cent() -> f64 {
    0.01
}

/// Why a probe could not be used; one line.
#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// The file is no probe's reading: `{"E_horizontal":[r,g,b]}`, finite and not negative.
    #[error(transparent)]
    File(#[from] JsonError),
    /// Too little of the sky is in the picture.
    #[error("the lens shows only {0:.0} % of the sky above the horizon; a probe needs at least half of it")]
    Unseen(f64),
    /// Rec.709 cannot be told in the camera's colours.
    #[error("the matrix of the camera's colours has no inverse; fit it again (relume sky colour)")]
    Colour,
}

/// What became of the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rebuilt {
    /// The disc was added; its irradiance on a plane normal to it, Rec.709.
    Disc([f64; 3]),
    /// No pixel at the sun's place was clipped; the picture stays as it is.
    NotClipped,
    /// The sun is below the horizon or outside the picture.
    NotSeen,
    /// The probe shows no more than the sky.
    NothingLeft,
}

/// A merged picture beside the probe, and the camera that took it.
pub struct Probed<'a> {
    /// What reached the sensor, in the camera's colours.
    pub merged: &'a mut Merged,
    /// One standard deviation per pixel of it, where that is wanted.
    pub sigma: Option<&'a mut [[f32; 3]]>,
    /// Lens and orientation.
    pub lens: &'a Lens,
    /// From the camera's colours to Rec.709.
    pub colour: &'a CameraColour,
}

/// What the picture shows of the sky.
struct Sky {
    /// Horizontal irradiance of what was seen, in the camera's colours.
    irradiance: [f64; 3],
    /// Solid angle x cosine of what was seen, of pi.
    seen: f64,
    /// Whether a pixel near the sun is clipped.
    clipped: bool,
}

impl Probe {
    /// Reads `PROBE.json`.
    ///
    /// # Errors
    /// [`ProbeError`], naming the file and what is wrong.
    pub fn load(path: &Path) -> Result<Self, ProbeError> {
        let probe: Probe = jsonfile::load(path)?;
        let bad = |field, what| Err(JsonError::Value { name: path.display().to_string(), field, what }.into());
        if probe.horizontal.iter().any(|v| !(v.is_finite() && *v >= 0.0)) {
            return bad("E_horizontal", format!("{:?} must be finite and not negative", probe.horizontal));
        }
        if !(0.0..=1.0).contains(&probe.relative_sigma) {
            return bad("relative_sigma", format!("{} must be a share from 0 to 1", probe.relative_sigma));
        }
        Ok(probe)
    }

    /// Adds the sun's disc to the pixels it covers where the sun is clipped: (probe - sky) / sin(altitude), per channel.
    /// The picture's horizontal irradiance then is the probe's. `dir_world` points to the sun's centre. The pixels' standard
    /// deviation then is that of the disc, too: by the probe's, the response curve's error in all that was summed, and what
    /// the lens does not show.
    ///
    /// # Errors
    /// [`ProbeError::Unseen`] where the picture shows too little sky, [`ProbeError::Colour`] for colours without a way back.
    pub fn rebuild(&self, picture: &mut Probed<'_>, dir_world: [f32; 3]) -> Result<Rebuilt, ProbeError> {
        let whole = std::f64::consts::PI;
        let sky = picture.sky(dir_world.map(f64::from));
        if sky.seen < LEAST_SEEN * whole {
            return Err(ProbeError::Unseen(100.0 * sky.seen / whole));
        }
        if !sky.clipped {
            return Ok(Rebuilt::NotClipped);
        }
        let up = f64::from(dir_world[1]);
        if up <= 0.0 {
            return Ok(Rebuilt::NotSeen);
        }
        let seen =
            picture.colour.to_rec709().map(|row| (0..3).map(|k| f64::from(row[k]) * sky.irradiance[k]).sum::<f64>());
        // What the lens does not show counts as sky like the rest.
        let more = (whole / sky.seen).max(1.0);
        let left: [f64; 3] = std::array::from_fn(|k| self.horizontal[k] - seen[k] * more);
        if left.iter().all(|&v| v <= 0.0) {
            return Ok(Rebuilt::NothingLeft);
        }
        let normal = left.map(|v| v.max(0.0) / up);
        let sigma = std::array::from_fn(|k| {
            let unseen = UNSEEN_SIGMA * (more - 1.0) * seen[k];
            (self.relative_sigma * self.horizontal[k]).hypot(CURVE_ERROR * seen[k]).hypot(unseen) / up
        });
        let placed = picture.add(&Disc { irradiance: normal, sigma, dir_world })?;
        Ok(if placed { Rebuilt::Disc(normal) } else { Rebuilt::NotSeen })
    }
}

impl Probed<'_> {
    /// Sums what stands above the horizon; `sun` points to the sun's centre.
    fn sky(&self, sun: [f64; 3]) -> Sky {
        let near = NEAR_DEG.to_radians().cos();
        let mut sky = Sky { irradiance: [0.0; 3], seen: 0.0, clipped: false };
        for (index, value) in self.merged.radiance.iter().enumerate() {
            let at = [(index % self.merged.width) as f64 + 0.5, (index / self.merged.width) as f64 + 0.5];
            let (Some(towards), Some(omega)) = (self.lens.unproject(at), self.lens.solid_angle_sr(at)) else {
                continue;
            };
            if towards[1] <= 0.0 {
                continue;
            }
            let share = omega * towards[1];
            let passed = self.lens.transmission(at).filter(|&passed| passed > 0.0).unwrap_or(1.0);
            sky.seen += share;
            (0..3).for_each(|k| sky.irradiance[k] += f64::from(value[k]) * share / passed);
            let cosine: f64 = (0..3).map(|k| towards[k] * sun[k]).sum();
            sky.clipped |= cosine > near && self.merged.state[index] == PixelState::Clipped;
        }
        sky
    }
}

#[cfg(test)]
mod tests;
