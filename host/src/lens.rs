//! The sky camera's lens and orientation: pixels to directions and back, the solid angle of a pixel, what of its light
//! passes, and which pixels show sky.
//!
//! `LENS.json`: `{"model":"equidistant|equisolid|kannala_brandt","focal_px":f,"center_px":[cx,cy],"k":[k1,k2,k3,k4],
//! "camera_to_world":[[3x3]],"width":w,"height":h,"vignetting":[a1,a2,a3],"mask":"mask.png"}`; `k` (Kannala-Brandt only) and
//! all that follows `camera_to_world` may be left out. `relume sky lens` writes it.
//! Pixel (col, row) has its centre at (col + 0.5, row + 0.5). Camera axes are +X right, +Y down, +Z forward, as the stored
//! picture shows them; a direction in the world is `camera_to_world` times one in the camera.
//!
//! A level camera that looks at the zenith with north (-Z) at the top of its picture has +Z = world +Y and +Y = world +Z
//! (down in the picture is south), hence +X = +Y x +Z = world -X: looking up, west is on the right. Its matrix is
//! `[[-1,0,0],[0,0,1],[0,1,0]]`.
//!
//! Vignetting: of light from the angle theta off the axis the share 1 + a1 q + a2 q^2 + a3 q^3 passes, q = (theta / 90 deg)^2,
//! relative to the axis; beyond 100 degrees it stays what it is there. The mask is a PNG of the picture's size, white where a
//! pixel shows sky; its path is relative to the lens file.

mod file;
pub mod mask;

pub use file::LensFile;
use mask::SkyMask;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// `camera_to_world` of a level camera that looks at the zenith with north at the top of its picture.
pub const ZENITH_NORTH_UP: [[f64; 3]; 3] = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]];

/// Angle from the axis beyond which the vignetting curve is not followed, radians.
const VIGNETTING_END: f64 = 100.0 / 180.0 * PI;

/// How the angle from the axis becomes a distance from the centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LensModel {
    /// r = f theta
    Equidistant,
    /// r = 2 f sin(theta / 2)
    Equisolid,
    /// r = f (theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9), Kannala & Brandt 2006
    KannalaBrandt,
}

/// A lens and its orientation; build one with [`Lens::load`] or [`LensFile::lens`].
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    model: LensModel,
    focal_px: f64,
    center_px: [f64; 2],
    k: [f64; 4],
    camera_to_world: [[f64; 3]; 3],
    size: Option<(usize, usize)>,
    vignetting: [f64; 3],
    mask: Option<Arc<SkyMask>>,
    /// Largest angle from the axis for which the radius still grows.
    max_theta: f64,
}

impl Lens {
    /// An equidistant lens that looks at the zenith, north up, with `field_deg` across the smaller side of the picture.
    pub fn zenith_equidistant(width: usize, height: usize, field_deg: f64) -> Self {
        Lens {
            model: LensModel::Equidistant,
            focal_px: 0.5 * width.min(height) as f64 / (0.5 * field_deg.max(1.0)).to_radians(),
            center_px: [0.5 * width as f64, 0.5 * height as f64],
            k: [0.0; 4],
            camera_to_world: ZENITH_NORTH_UP,
            size: Some((width, height)),
            vignetting: [0.0; 3],
            mask: None,
            max_theta: PI * (1.0 - 1.0 / 720.0),
        }
    }

    /// The picture's size the file names, if it does.
    pub fn size(&self) -> Option<(usize, usize)> {
        self.size
    }

    /// What describes the lens, its mask left out.
    pub fn file(&self) -> LensFile {
        LensFile {
            model: self.model,
            focal_px: self.focal_px,
            center_px: self.center_px,
            k: self.k,
            camera_to_world: self.camera_to_world,
            width: self.size.map(|size| size.0),
            height: self.size.map(|size| size.1),
            vignetting: self.vignetting,
            mask: None,
        }
    }

    /// Which pixels show sky, where the lens file names a mask.
    pub fn mask(&self) -> Option<&SkyMask> {
        self.mask.as_deref()
    }

    /// Share of a direction's light that passes, relative to the axis, at an angle from the axis.
    fn passed(&self, theta: f64) -> f64 {
        let q = (theta.min(VIGNETTING_END) / FRAC_PI_2).powi(2);
        let [a1, a2, a3] = self.vignetting;
        1.0 + q * (a1 + q * (a2 + q * a3))
    }

    /// Share of the light that passes at a picture position (pixels), relative to the axis; none beyond what is imaged.
    pub fn transmission(&self, position_px: [f64; 2]) -> Option<f64> {
        self.angle_off_axis(position_px).map(|theta| self.passed(theta))
    }

    /// Whether less light passes off the axis than on it, as far as the file tells.
    pub fn has_vignetting(&self) -> bool {
        self.vignetting != [0.0; 3]
    }

    /// Angle from the axis at a picture position (pixels), radians; none beyond what the lens images.
    pub fn angle_off_axis(&self, position_px: [f64; 2]) -> Option<f64> {
        self.theta_of((position_px[0] - self.center_px[0]).hypot(position_px[1] - self.center_px[1]))
    }

    /// The same lens turned: `camera_to_world` replaced by `turn * camera_to_world`.
    pub fn turned(&self, turn: [[f64; 3]; 3]) -> Self {
        let m = &self.camera_to_world;
        let product = turn.map(|row| std::array::from_fn(|j| (0..3).map(|k| row[k] * m[k][j]).sum()));
        Lens { camera_to_world: product, ..self.clone() }
    }

    /// Radius and its slope by the angle, pixels and pixels per radian.
    fn radius_and_slope(&self, theta: f64) -> (f64, f64) {
        let f = self.focal_px;
        match self.model {
            LensModel::Equidistant => (f * theta, f),
            LensModel::Equisolid => (2.0 * f * (0.5 * theta).sin(), f * (0.5 * theta).cos()),
            LensModel::KannalaBrandt => {
                let [k1, k2, k3, k4] = self.k;
                let t = theta * theta;
                let radius = theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))));
                let slope = 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)));
                (f * radius, f * slope)
            }
        }
    }

    /// Angle from the axis at a radius, by bisection then Newton steps; none beyond what the lens images.
    fn theta_of(&self, radius: f64) -> Option<f64> {
        if radius > self.radius_and_slope(self.max_theta).0 {
            return None;
        }
        let (mut low, mut high) = (0.0, self.max_theta);
        let mut theta = (radius / self.focal_px).min(high);
        for _ in 0..60 {
            let (found, slope) = self.radius_and_slope(theta);
            let error = found - radius;
            if error.abs() < 1e-10 * self.focal_px {
                break;
            }
            if error > 0.0 {
                high = theta
            } else {
                low = theta
            }
            let newton = theta - error / slope;
            theta = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        }
        Some(theta)
    }

    /// Picture position (pixels) of a direction in the world; none where the lens does not image it.
    pub fn project(&self, dir_world: [f64; 3]) -> Option<[f64; 2]> {
        let m = &self.camera_to_world;
        let [x, y, z]: [f64; 3] = std::array::from_fn(|j| (0..3).map(|i| m[i][j] * dir_world[i]).sum());
        let off_axis = x.hypot(y);
        let theta = off_axis.atan2(z);
        if theta > self.max_theta {
            return None;
        }
        let (radius, _) = self.radius_and_slope(theta);
        let scale = if off_axis > 0.0 { radius / off_axis } else { 0.0 };
        Some([self.center_px[0] + x * scale, self.center_px[1] + y * scale])
    }

    /// Unit direction in the world of a picture position (pixels); none beyond what the lens images.
    pub fn unproject(&self, position_px: [f64; 2]) -> Option<[f64; 3]> {
        let (x, y) = (position_px[0] - self.center_px[0], position_px[1] - self.center_px[1]);
        let radius = x.hypot(y);
        let theta = self.theta_of(radius)?;
        let scale = if radius > 0.0 { theta.sin() / radius } else { 0.0 };
        let dir = [x * scale, y * scale, theta.cos()];
        Some(self.camera_to_world.map(|row| row[0] * dir[0] + row[1] * dir[1] + row[2] * dir[2]))
    }

    /// Solid angle per pixel area at a picture position, sr per pixel: sin(theta) / (r dr/dtheta), exact for the model.
    pub fn solid_angle_sr(&self, position_px: [f64; 2]) -> Option<f64> {
        let radius = (position_px[0] - self.center_px[0]).hypot(position_px[1] - self.center_px[1]);
        let theta = self.theta_of(radius)?;
        let (_, slope) = self.radius_and_slope(theta);
        let near_axis = radius < 1e-6 * self.focal_px;
        Some(if near_axis { 1.0 / (slope * slope) } else { theta.sin().max(0.0) / (radius * slope) })
    }
}

#[cfg(test)]
mod tests;
