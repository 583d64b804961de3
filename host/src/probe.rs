//! A clipped sun from an irradiance probe: what the horizontal plane receives beyond the sky that the camera measured.
//!
//! `PROBE.json`: `{"E_horizontal":[r,g,b]}`, in the unit of the merged picture's radiance x sr.

use crate::bracket::{Merged, PixelState};
use crate::jsonfile::{self, JsonError};
use crate::lens::Lens;
use crate::skymodel::disc_directions;
use serde::Deserialize;
use std::path::Path;

/// Share of the hemisphere (by cosine) that must have been seen for the sky's irradiance to be told.
const LEAST_SEEN: f64 = 0.5;
/// A pixel within this angle of the sun's centre may belong to its glare, degrees.
const NEAR_DEG: f64 = 3.0;
const DISC_POINTS: u32 = 4096;

/// What a probe measured.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Irradiance on the horizontal plane, RGB.
    #[serde(rename = "E_horizontal")]
    pub horizontal: [f64; 3],
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
}

/// What became of the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rebuilt {
    /// The disc was added; its irradiance on a plane normal to it.
    Disc([f64; 3]),
    /// No pixel at the sun's place was clipped; the picture stays as it is.
    NotClipped,
    /// The sun is below the horizon or outside the picture.
    NotSeen,
    /// The probe shows no more than the sky.
    NothingLeft,
}

impl Probe {
    /// Reads `PROBE.json`.
    ///
    /// # Errors
    /// [`ProbeError`], naming the file and what is wrong.
    pub fn load(path: &Path) -> Result<Self, ProbeError> {
        let probe: Probe = jsonfile::load(path)?;
        if probe.horizontal.iter().any(|v| !(v.is_finite() && *v >= 0.0)) {
            let what = format!("{:?} must be finite and not negative", probe.horizontal);
            return Err(JsonError::Value { name: path.display().to_string(), field: "E_horizontal", what }.into());
        }
        Ok(probe)
    }

    /// Adds the sun's disc to the pixels it covers where the sun is clipped: (probe - sky) / sin(altitude), per channel.
    /// The picture's horizontal irradiance then is the probe's. `dir_world` points to the sun's centre.
    ///
    /// # Errors
    /// [`ProbeError::Unseen`] where the picture shows too little sky.
    pub fn rebuild(&self, merged: &mut Merged, lens: &Lens, dir_world: [f32; 3]) -> Result<Rebuilt, ProbeError> {
        let dir = dir_world.map(f64::from);
        let near = NEAR_DEG.to_radians().cos();
        let (mut sky, mut seen, mut clipped) = ([0.0; 3], 0.0, false);
        for (index, value) in merged.radiance.iter().enumerate() {
            let at = [(index % merged.width) as f64 + 0.5, (index / merged.width) as f64 + 0.5];
            let (Some(towards), Some(omega)) = (lens.unproject(at), lens.solid_angle_sr(at)) else { continue };
            if towards[1] <= 0.0 {
                continue;
            }
            let share = omega * towards[1];
            seen += share;
            (0..3).for_each(|k| sky[k] += f64::from(value[k]) * share);
            let cosine: f64 = (0..3).map(|k| towards[k] * dir[k]).sum();
            clipped |= cosine > near && merged.state[index] == PixelState::Clipped;
        }
        let whole = std::f64::consts::PI;
        if seen < LEAST_SEEN * whole {
            return Err(ProbeError::Unseen(100.0 * seen / whole));
        }
        if !clipped {
            return Ok(Rebuilt::NotClipped);
        }
        if dir[1] <= 0.0 {
            return Ok(Rebuilt::NotSeen);
        }
        // What the lens does not show counts as sky like the rest.
        let left: [f64; 3] = std::array::from_fn(|k| self.horizontal[k] - sky[k] * (whole / seen).max(1.0));
        if left.iter().all(|&v| v <= 0.0) {
            return Ok(Rebuilt::NothingLeft);
        }
        let normal = left.map(|v| v.max(0.0) / dir[1]);
        let placed = add_disc(merged, lens, dir_world, normal);
        Ok(if placed { Rebuilt::Disc(normal) } else { Rebuilt::NotSeen })
    }
}

/// Adds a disc of an irradiance to the pixels that it covers; they count as measured then. False where it is outside.
fn add_disc(merged: &mut Merged, lens: &Lens, dir_world: [f32; 3], irradiance: [f64; 3]) -> bool {
    let inside = |at: [f64; 2]| {
        let inside = (0.0..merged.width as f64).contains(&at[0]) && (0.0..merged.height as f64).contains(&at[1]);
        let centre = at.map(|c| c.floor() + 0.5);
        inside.then(|| (at[1] as usize * merged.width + at[0] as usize, lens.solid_angle_sr(centre)))
    };
    let points = disc_directions(dir_world, DISC_POINTS).filter_map(|dir| lens.project(dir).and_then(inside));
    let points: Vec<(usize, f64)> = points.filter_map(|(index, omega)| Some((index, omega?))).collect();
    for &(index, omega) in &points {
        let pixel = &mut merged.radiance[index];
        *pixel = std::array::from_fn(|k| pixel[k] + (irradiance[k] / (omega * points.len() as f64)) as f32);
        merged.state[index] = PixelState::Valid;
    }
    !points.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sun::{SunPosition, dir_world};

    #[test]
    fn the_disc_makes_up_what_the_probe_shows_beyond_the_sky() {
        let lens = Lens::zenith_equidistant(240, 240, 184.0);
        let dir = dir_world(SunPosition { azimuth_deg: 200.0, altitude_deg: 30.0 }, 0.0);
        let count = 240 * 240;
        let mut merged = Merged {
            width: 240,
            height: 240,
            radiance: vec![[1.0, 2.0, 3.0]; count],
            state: vec![PixelState::Valid; count],
            captured_at_s: 0.0,
        };
        // A uniform sky's irradiance is pi x radiance; the sun adds 10 on a plane normal to it, a half of that below 30 degrees.
        let probe = Probe { horizontal: [1.0, 2.0, 3.0].map(|v| v * std::f64::consts::PI + 5.0) };
        assert_eq!(probe.rebuild(&mut merged, &lens, dir).unwrap(), Rebuilt::NotClipped);
        let at = lens.project(dir.map(f64::from)).unwrap();
        merged.state[at[1] as usize * 240 + at[0] as usize] = PixelState::Clipped;
        let Rebuilt::Disc(normal) = probe.rebuild(&mut merged, &lens, dir).unwrap() else { panic!("no disc") };
        assert!(normal.iter().all(|v| (v / 10.0 - 1.0).abs() < 0.02), "{normal:?}");
        let (mut sum, mut horizontal) = (0.0, 0.0);
        for (index, value) in merged.radiance.iter().enumerate() {
            let at = [(index % 240) as f64 + 0.5, (index / 240) as f64 + 0.5];
            let (Some(towards), Some(omega)) = (lens.unproject(at), lens.solid_angle_sr(at)) else { continue };
            if towards[1] > 0.0 {
                sum += (f64::from(value[1]) - 2.0) * omega;
                horizontal += f64::from(value[1]) * omega * towards[1];
            }
        }
        assert!((sum / normal[1] - 1.0).abs() < 1e-3, "{sum}");
        assert!((horizontal / probe.horizontal[1] - 1.0).abs() < 5e-3, "{horizontal}");
        assert!(merged.radiance.iter().flatten().all(|v| v.is_finite()));
        merged.state.fill(PixelState::Clipped);
        let dark = Probe { horizontal: [0.1; 3] };
        assert_eq!(dark.rebuild(&mut merged, &lens, dir).unwrap(), Rebuilt::NothingLeft);
        let narrow = Lens::zenith_equidistant(240, 240, 40.0);
        let narrow = Lens::turned(&narrow, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]);
        assert!(matches!(dark.rebuild(&mut merged, &narrow, dir), Err(ProbeError::Unseen(_))));
    }

    #[test]
    fn bad_readings_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.json");
        for (text, told) in [("{}", "E_horizontal"), (r#"{"E_horizontal":[1,2,-3]}"#, "-3"), ("nonsense", "p.json")] {
            std::fs::write(&path, text).unwrap();
            let error = Probe::load(&path).unwrap_err().to_string();
            assert!(error.contains(told) && error.contains("p.json") && !error.contains('\n'), "{error}");
        }
    }
}
