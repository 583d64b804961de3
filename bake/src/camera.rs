//! The scene's camera: a pinhole with square pixels, read from a JSON file.

use std::path::{Path, PathBuf};

use glam::DVec3;
use relume_firmware::field::CameraRecord;
use serde::Deserialize;

/// Why a camera file cannot be used. Every message names the file and the field.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The file cannot be read.
    #[error("{file}: cannot read the camera file: {source}", file = .file.display())]
    Read {
        /// The camera file.
        file: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not the JSON object that a camera is.
    #[error(
        "{file}: not a camera: {source}; write {{\"position\":[x,y,z],\"target\":[x,y,z],\"up\":[0,1,0],\"fov_y_deg\":45}}",
        file = .file.display()
    )]
    Parse {
        /// The camera file.
        file: PathBuf,
        /// What the parser said, with line and column.
        source: serde_json::Error,
    },
    /// A field has a value that no camera can have.
    #[error("{file}: {field} is {value}; {advice}", file = .file.display())]
    Field {
        /// The camera file.
        file: PathBuf,
        /// The field at fault.
        field: &'static str,
        /// Its value as text.
        value: String,
        /// What to write instead.
        advice: &'static str,
    },
}

/// A pinhole camera in world space (metres, +Y up), vertical field of view in degrees, square pixels.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// The eye, m.
    pub position: [f64; 3],
    /// The point in the middle of the picture, m.
    pub target: [f64; 3],
    /// The direction that points up in the picture; any length, not parallel to the view.
    #[serde(default = "y_up")]
    pub up: [f64; 3],
    /// Vertical field of view, degrees, in (0, 180).
    pub fov_y_deg: f64,
    /// Where true north lies, degrees from -Z towards +X.
    #[serde(default)]
    pub north_deg: f64,
}

fn y_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

impl Camera {
    /// Reads and checks a camera file.
    ///
    /// # Errors
    /// [`CameraError`] when the file is missing, is not JSON, has an unknown field, or holds a value no camera can have.
    pub fn load(path: &Path) -> Result<Self, CameraError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| CameraError::Read { file: path.to_owned(), source })?;
        let camera: Camera =
            serde_json::from_str(&text).map_err(|source| CameraError::Parse { file: path.to_owned(), source })?;
        camera.check(path)?;
        Ok(camera)
    }

    /// What a field's header says of it.
    pub fn record(&self) -> CameraRecord {
        let f32s = |v: [f64; 3]| v.map(|c| c as f32);
        CameraRecord {
            position: f32s(self.position),
            target: f32s(self.target),
            up: f32s(self.up),
            fov_y_deg: self.fov_y_deg as f32,
            north_deg: self.north_deg as f32,
        }
    }

    /// Checks the values; `file` is only named in the error.
    ///
    /// # Errors
    /// [`CameraError::Field`] for NaN or infinite numbers, a target at the position, an `up` that is zero or parallel
    /// to the view, and a field of view outside (0, 180) degrees.
    pub fn check(&self, file: &Path) -> Result<(), CameraError> {
        let fault = |field, value: String, advice| CameraError::Field { file: file.to_owned(), field, value, advice };
        for (field, value) in [("position", self.position), ("target", self.target), ("up", self.up)] {
            if !value.iter().all(|v| v.is_finite() && v.abs() < 1e12) {
                return Err(fault(field, format!("{value:?}"), "write three finite numbers"));
            }
        }
        let view = DVec3::from(self.target) - DVec3::from(self.position);
        if view.length() <= 1e-9 * DVec3::from(self.position).length().max(1e-6) {
            let advice = "it equals position; point it at the scene";
            return Err(fault("target", format!("{:?}", self.target), advice));
        }
        let up = DVec3::from(self.up);
        if up.length() == 0.0 || view.normalize().cross(up.normalize_or_zero()).length() < 1e-6 {
            let advice = "it is zero or parallel to the view; choose another direction";
            return Err(fault("up", format!("{:?}", self.up), advice));
        }
        if !(self.fov_y_deg > 0.0 && self.fov_y_deg < 180.0) {
            return Err(fault("fov_y_deg", self.fov_y_deg.to_string(), "write degrees between 0 and 180"));
        }
        if !self.north_deg.is_finite() {
            return Err(fault("north_deg", self.north_deg.to_string(), "write degrees from -Z towards +X"));
        }
        Ok(())
    }

    /// The camera prepared for a picture of `width` x `height` pixels.
    pub fn view(&self, width: u32, height: u32) -> CameraView {
        let position = DVec3::from(self.position);
        let forward = (DVec3::from(self.target) - position).normalize_or_zero();
        let right = forward.cross(DVec3::from(self.up)).normalize_or_zero();
        let up = right.cross(forward);
        let half = (0.5 * self.fov_y_deg.to_radians()).tan();
        let pixel = 2.0 * half / f64::from(height);
        CameraView {
            position,
            corner: forward - right * (0.5 * pixel * f64::from(width)) + up * half,
            across: right * pixel,
            down: -up * pixel,
        }
    }

    /// The ray through the point (`px`, `py`) of a `width` x `height` picture, in pixels from its top left corner:
    /// the first pixel's centre is (0.5, 0.5). Returns the origin in metres and a unit direction, both in world space.
    pub fn ray(&self, width: u32, height: u32, px: f32, py: f32) -> (glam::Vec3, glam::Vec3) {
        let view = self.view(width, height);
        (view.position.as_vec3(), view.direction(px, py))
    }
}

/// A [`Camera`] prepared for one picture size.
#[derive(Clone, Copy, Debug)]
pub struct CameraView {
    /// The eye, m, world space.
    pub position: DVec3,
    corner: DVec3,
    across: DVec3,
    down: DVec3,
}

impl CameraView {
    /// Unit direction through the point (`px`, `py`), in pixels from the top left corner.
    pub fn direction(&self, px: f32, py: f32) -> glam::Vec3 {
        (self.corner + self.across * f64::from(px) + self.down * f64::from(py)).normalize().as_vec3()
    }

    /// Width of a pixel in the middle of the picture, as seen from the eye, radians.
    pub fn pixel_angle(&self) -> f32 {
        self.across.length() as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { position: [0.0, 0.0, 5.0], target: [0.0; 3], up: y_up(), fov_y_deg: 90.0, north_deg: 0.0 }
    }

    #[test]
    fn rays_follow_the_pixel_convention() {
        let (origin, centre) = camera().ray(200, 100, 100.0, 50.0);
        assert_eq!(origin, glam::Vec3::new(0.0, 0.0, 5.0));
        assert!((centre - glam::Vec3::NEG_Z).length() < 1e-6);
        // 90 degrees vertically: the top edge's middle is 45 degrees up; pixels are square, so the left edge is atan 2.
        let (_, top) = camera().ray(200, 100, 100.0, 0.0);
        assert!((top - glam::Vec3::new(0.0, 1.0, -1.0).normalize()).length() < 1e-6);
        let (_, left) = camera().ray(200, 100, 0.0, 50.0);
        assert!((left - glam::Vec3::new(-2.0, 0.0, -1.0).normalize()).length() < 1e-6);
    }

    #[test]
    fn faults_name_file_and_field() {
        let bad = [
            (Camera { position: [f64::NAN, 0.0, 0.0], ..camera() }, "position"),
            (Camera { target: [0.0, 0.0, 5.0], ..camera() }, "target"),
            (Camera { up: [0.0, 0.0, -3.0], ..camera() }, "up"),
            (Camera { up: [0.0; 3], ..camera() }, "up"),
            (Camera { fov_y_deg: 180.0, ..camera() }, "fov_y_deg"),
            (Camera { fov_y_deg: f64::NAN, ..camera() }, "fov_y_deg"),
            (Camera { north_deg: f64::INFINITY, ..camera() }, "north_deg"),
        ];
        for (camera, field) in bad {
            let text = camera.check(Path::new("c.json")).unwrap_err().to_string();
            assert!(text.starts_with(&format!("c.json: {field} ")) && !text.contains('\n'), "{text}");
        }
        assert!(camera().check(Path::new("c.json")).is_ok());
    }

    #[test]
    fn unknown_fields_are_refused() {
        let text = r#"{"position":[0,0,1],"target":[0,0,0],"fov_y_deg":45,"fov":3}"#;
        assert!(serde_json::from_str::<Camera>(text).unwrap_err().to_string().contains("fov"));
    }
}
