//! The scene's camera: a pinhole with square pixels, or a measured lens; read from a JSON file.

mod file;
mod optics;
#[cfg(test)]
mod thirdparty;

use std::path::Path;

pub use file::CameraError;
use file::fault;
use glam::{DMat3, DVec3, Vec3};
pub use optics::Optics;
use relume_firmware::field::CameraRecord;
use relume_firmware::lens::Lens;
pub use relume_firmware::lens::Projection;

/// A camera in world space (metres, +Y up), square pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The eye, m.
    pub position: [f64; 3],
    /// A point on the axis, which is the middle of a pinhole's picture, m.
    pub target: [f64; 3],
    /// The direction that points up in the picture; any length, not parallel to the view.
    pub up: [f64; 3],
    /// Vertical field of view, degrees, in (0, 180); with a lens, that of a pinhole of its focal length.
    pub fov_y_deg: f64,
    /// Where true north lies, degrees from -Z towards +X.
    pub north_deg: f64,
    /// The lens; none: a pinhole with its axis in the middle of the picture.
    pub optics: Option<Optics>,
}

fn y_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

impl Camera {
    /// What a field of `size` (width, height) says of it.
    pub fn record(&self, size: (u32, u32)) -> CameraRecord {
        let f32s = |v: [f64; 3]| v.map(|c| c as f32);
        CameraRecord {
            position: f32s(self.position),
            target: f32s(self.target),
            up: f32s(self.up),
            fov_y_deg: self.fov_y_deg as f32,
            north_deg: self.north_deg as f32,
            lens: self.optics.map(|optics| optics.lens_over(size)),
        }
    }

    /// Checks the values; `file` is only named in the error.
    ///
    /// # Errors
    /// [`CameraError::Field`] for NaN or infinite numbers, a target at the position, an `up` that is zero or parallel
    /// to the view, a field of view outside (0, 180) degrees, and a lens that is none.
    pub fn check(&self, file: &Path) -> Result<(), CameraError> {
        let fault = |field, value: String, advice| fault(file, field, value, advice);
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
        self.optics.map_or(Ok(()), |optics| optics.check(file))?;
        if !(self.fov_y_deg > 0.0 && self.fov_y_deg < 180.0) {
            return Err(fault("fov_y_deg", self.fov_y_deg.to_string(), "write degrees between 0 and 180"));
        }
        if !self.north_deg.is_finite() {
            return Err(fault("north_deg", self.north_deg.to_string(), "write degrees from -Z towards +X"));
        }
        Ok(())
    }

    /// Has a picture of `size` (width, height) the shape of the still that the lens was measured on? A pinhole does not mind.
    pub fn fits(&self, size: (u32, u32)) -> bool {
        self.optics.is_none_or(|optics| optics.fits(size))
    }

    /// The camera prepared for a picture of `width` x `height` pixels.
    pub fn view(&self, width: u32, height: u32) -> CameraView {
        let position = DVec3::from(self.position);
        let forward = (DVec3::from(self.target) - position).normalize_or_zero();
        let right = forward.cross(DVec3::from(self.up)).normalize_or_zero();
        let up = right.cross(forward);
        let half = (0.5 * self.fov_y_deg.to_radians()).tan();
        let pixel = 2.0 * half / f64::from(height);
        let lens = self.optics.map(|optics| LensView {
            lens: optics.lens_over((width, height)),
            axes_world: DMat3::from_cols(right, -up, forward),
        });
        CameraView {
            position,
            corner: forward - right * (0.5 * pixel * f64::from(width)) + up * half,
            across: right * pixel,
            down: -up * pixel,
            lens,
        }
    }
}

/// A lens and how it stands.
#[derive(Clone, Copy, Debug)]
struct LensView {
    lens: Lens,
    /// Columns: right, down and forward in world space.
    axes_world: DMat3,
}

/// A [`Camera`] prepared for one picture size.
#[derive(Clone, Copy, Debug)]
pub struct CameraView {
    /// The eye, m, world space.
    pub position: DVec3,
    corner: DVec3,
    across: DVec3,
    down: DVec3,
    lens: Option<LensView>,
}

impl CameraView {
    /// Unit direction (world) through the point (`px`, `py`), in pixels from the top left corner: the first pixel's centre
    /// is (0.5, 0.5). None beyond what the lens images.
    pub fn direction(&self, px: f32, py: f32) -> Option<Vec3> {
        let along = match &self.lens {
            None => (self.corner + self.across * f64::from(px) + self.down * f64::from(py)).normalize(),
            Some(view) => view.axes_world * DVec3::from(view.lens.direction([px, py].map(f64::from))?),
        };
        Some(along.as_vec3())
    }

    /// Picture position, px, of a point in the world, m; none where the picture does not show it even if it were larger.
    pub fn project(&self, point: DVec3) -> Option<[f64; 2]> {
        let from_eye = point - self.position;
        let Some(view) = &self.lens else {
            // `corner` and the steps across and down are three axes.
            let steps = DMat3::from_cols(self.across, self.down, self.corner).inverse() * from_eye;
            return (steps.z > 0.0).then(|| [steps.x / steps.z, steps.y / steps.z]);
        };
        view.lens.project((view.axes_world.transpose() * from_eye).to_array())
    }

    /// Width of a pixel as seen from the eye, radians: in the middle of a pinhole's picture, at (`px`, `py`) through a lens.
    pub fn pixel_angle(&self, px: f32, py: f32) -> f32 {
        match &self.lens {
            None => self.across.length() as f32,
            Some(view) => view.lens.pixel_solid_angle([px, py].map(f64::from)).sqrt() as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let position = [0.0, 0.0, 5.0];
        Camera { position, target: [0.0; 3], up: y_up(), fov_y_deg: 90.0, north_deg: 0.0, optics: None }
    }

    #[test]
    fn rays_follow_the_pixel_convention() {
        let view = camera().view(200, 100);
        assert_eq!(view.position, DVec3::new(0.0, 0.0, 5.0));
        let points_along = |px: f32, py: f32, expected: Vec3| {
            let found = view.direction(px, py).unwrap();
            assert!((found - expected.normalize()).length() < 1e-6, "{found}");
        };
        points_along(100.0, 50.0, Vec3::NEG_Z);
        // 90 degrees vertically: the top edge's middle is 45 degrees up; pixels are square, so the left edge is atan 2.
        points_along(100.0, 0.0, Vec3::new(0.0, 1.0, -1.0));
        points_along(0.0, 50.0, Vec3::new(-2.0, 0.0, -1.0));
        let seen = view.project(DVec3::new(-2.0, 1.0, 4.0)).unwrap();
        assert!((seen[0] - 0.0).abs() < 1e-9 && seen[1].abs() < 1e-9, "{seen:?}");
        assert_eq!(view.project(DVec3::new(0.0, 0.0, 6.0)), None);
    }

    #[test]
    fn a_lens_without_distortion_is_the_pinhole() {
        let optics = Optics::ideal(Projection::Radial, [2000, 1000], 500.0);
        let (pinhole, lens) = (camera().view(200, 100), Camera { optics: Some(optics), ..camera() }.view(200, 100));
        for (px, py) in [(100.0, 50.0), (3.5, 97.25), (199.5, 0.5)] {
            let [a, b] = [&pinhole, &lens].map(|view| view.direction(px, py).unwrap());
            assert!((a - b).length() < 1e-6);
            let point = pinhole.position + 7.0 * a.as_dvec3();
            let seen = lens.project(point).unwrap();
            assert!((seen[0] - f64::from(px)).abs() < 1e-4 && (seen[1] - f64::from(py)).abs() < 1e-4, "{seen:?}");
        }
        assert!((pinhole.pixel_angle(100.0, 50.0) / lens.pixel_angle(100.0, 50.0) - 1.0).abs() < 1e-6);
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
}
