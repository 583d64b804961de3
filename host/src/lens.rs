//! The sky camera's lens and orientation: pixels to directions and back, and the solid angle of a pixel.
//!
//! `LENS.json`: `{"model":"equidistant|equisolid|kannala_brandt","focal_px":f,"center_px":[cx,cy],"k":[k1,k2,k3,k4],
//! "camera_to_world":[[3x3]],"width":w,"height":h}`; `k` (Kannala-Brandt only), `width` and `height` may be left out.
//! Pixel (col, row) has its centre at (col + 0.5, row + 0.5). Camera axes are +X right, +Y down, +Z forward, as the stored
//! picture shows them; a direction in the world is `camera_to_world` times one in the camera.
//!
//! A level camera that looks at the zenith with north (-Z) at the top of its picture has +Z = world +Y and +Y = world +Z
//! (down in the picture is south), hence +X = +Y x +Z = world -X: looking up, west is on the right. Its matrix is
//! `[[-1,0,0],[0,0,1],[0,1,0]]`.

use serde::Deserialize;
use std::f64::consts::PI;
use std::path::Path;

/// `camera_to_world` of a level camera that looks at the zenith with north at the top of its picture.
pub const ZENITH_NORTH_UP: [[f64; 3]; 3] = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]];

/// How the angle from the axis becomes a distance from the centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LensModel {
    /// r = f theta
    Equidistant,
    /// r = 2 f sin(theta / 2)
    Equisolid,
    /// r = f (theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9), Kannala & Brandt 2006
    KannalaBrandt,
}

/// Why a lens file could not be used; one line that names file and field.
#[derive(Debug, thiserror::Error)]
pub enum LensError {
    /// The file could not be read.
    #[error("{name}: {source}")]
    Io {
        /// File name.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no lens description.
    #[error("{name}: {reason}")]
    Json {
        /// File name.
        name: String,
        /// What the parser said.
        reason: String,
    },
    /// A field's value makes no lens.
    #[error("{name}: {field}: {what}")]
    Value {
        /// File name.
        name: String,
        /// The field at fault.
        field: &'static str,
        /// What is wrong and what to do.
        what: String,
    },
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
    /// Largest angle from the axis for which the radius still grows.
    max_theta: f64,
}

/// The fields of `LENS.json`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensFile {
    /// Projection.
    pub model: LensModel,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Where the axis meets the picture, pixels.
    pub center_px: [f64; 2],
    /// Kannala-Brandt's coefficients.
    #[serde(default)]
    pub k: [f64; 4],
    /// Rotation from camera to world, rows.
    pub camera_to_world: [[f64; 3]; 3],
    /// Width of the picture, pixels.
    pub width: Option<usize>,
    /// Height of the picture, pixels.
    pub height: Option<usize>,
}

impl LensFile {
    /// Checks the fields and makes the lens; `name` is what errors call it.
    ///
    /// # Errors
    /// [`LensError::Value`], naming the field.
    pub fn lens(&self, name: &str) -> Result<Lens, LensError> {
        let bad = |field, what: &str| Err(LensError::Value { name: name.into(), field, what: what.into() });
        if !(self.focal_px.is_finite() && self.focal_px > 0.0) {
            return bad("focal_px", "must be a positive number of pixels");
        }
        if !self.center_px.iter().all(|c| c.is_finite()) {
            return bad("center_px", "must be two finite numbers");
        }
        if !self.k.iter().all(|k| k.is_finite()) {
            return bad("k", "must be four finite numbers");
        }
        if self.model != LensModel::KannalaBrandt && self.k != [0.0; 4] {
            return bad("k", "only kannala_brandt has coefficients; leave k out");
        }
        if self.width.is_some() != self.height.is_some() || self.width == Some(0) || self.height == Some(0) {
            return bad("width", "give width and height together, both above 0");
        }
        if !is_rotation(&self.camera_to_world) {
            return bad("camera_to_world", "must be a rotation: rows orthonormal within 1e-3, determinant +1");
        }
        let mut lens = Lens {
            model: self.model,
            focal_px: self.focal_px,
            center_px: self.center_px,
            k: self.k,
            camera_to_world: self.camera_to_world,
            size: self.width.zip(self.height),
            max_theta: PI,
        };
        let steps = 720;
        let turns =
            (1..=steps).map(|i| PI * f64::from(i) / f64::from(steps)).find(|&t| lens.radius_and_slope(t).1 <= 0.0);
        lens.max_theta = turns.unwrap_or(PI) - PI / f64::from(steps);
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
            max_theta: PI * (1.0 - 1.0 / 720.0),
        }
    }

    /// Reads `LENS.json`.
    ///
    /// # Errors
    /// [`LensError`], naming the file and the field at fault.
    pub fn load(path: &Path) -> Result<Self, LensError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| LensError::Io { name: name.clone(), source })?;
        let file: LensFile = serde_json::from_str(&text)
            .map_err(|reason| LensError::Json { name: name.clone(), reason: reason.to_string() })?;
        file.lens(&name)
    }

    /// The picture's size the file names, if it does.
    pub fn size(&self) -> Option<(usize, usize)> {
        self.size
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
mod tests {
    use super::*;

    fn lens(model: LensModel, k: [f64; 4]) -> Lens {
        let file = LensFile {
            model,
            focal_px: 150.0,
            center_px: [240.3, 239.1],
            k,
            camera_to_world: ZENITH_NORTH_UP,
            width: Some(480),
            height: Some(480),
        };
        file.lens("l.json").unwrap()
    }

    fn all() -> [Lens; 3] {
        [
            lens(LensModel::Equidistant, [0.0; 4]),
            lens(LensModel::Equisolid, [0.0; 4]),
            lens(LensModel::KannalaBrandt, [-0.02, 0.004, -0.001, 0.0]),
        ]
    }

    #[test]
    fn projection_and_back_agree() {
        for lens in all() {
            for (x, y) in [(240.3, 239.1), (10.0, 200.0), (400.5, 300.5), (240.0, 470.0)] {
                let dir = lens.unproject([x, y]).unwrap();
                let back = lens.project(dir).unwrap();
                assert!((back[0] - x).hypot(back[1] - y) < 1e-6, "{lens:?} {back:?}");
            }
        }
    }

    #[test]
    fn the_whole_sphere_cap_has_its_solid_angle() {
        for lens in all() {
            let (theta, mut sum) = (1.3f64, 0.0);
            for i in 0..480 * 480 * 4 {
                let at = [(i % 960) as f64 * 0.5 + 0.25, (i / 960) as f64 * 0.5 + 0.25];
                if lens.unproject(at).is_some_and(|d| d[1] > theta.cos()) {
                    sum += 0.25 * lens.solid_angle_sr(at).unwrap();
                }
            }
            let expected = 2.0 * PI * (1.0 - theta.cos());
            assert!((sum / expected - 1.0).abs() < 2e-3, "{lens:?}: {sum} {expected}");
        }
    }

    #[test]
    fn looking_up_north_is_at_the_top_and_west_on_the_right() {
        let lens = Lens::zenith_equidistant(480, 480, 180.0);
        let north = lens.project([0.0, 0.5, -0.866]).unwrap();
        let west = lens.project([-0.866, 0.5, 0.0]).unwrap();
        assert!((north[0] - 240.0).abs() < 1e-6 && north[1] < 100.0, "{north:?}");
        assert!((west[1] - 240.0).abs() < 1e-6 && west[0] > 380.0, "{west:?}");
        assert!((lens.project([1.0, 1e-9, 0.0]).unwrap()[0] - 0.0).abs() < 1e-3);
    }

    #[test]
    fn bad_files_name_the_field() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("l.json");
        let good =
            r#"{"model":"equisolid","focal_px":100,"center_px":[10,20],"camera_to_world":[[1,0,0],[0,1,0],[0,0,1]]}"#;
        let cases = [
            (good.replace("100", "-1"), "focal_px"),
            (good.replace("[0,0,1]", "[0,0,-1]"), "camera_to_world"),
            (good.replace("\"focal_px\"", "\"fokal\""), "fokal"),
            (good.replace("equisolid", "pinhole"), "pinhole"),
            (good.replace("\"focal_px\"", "\"k\":[1,0,0,0],\"focal_px\""), "k"),
        ];
        std::fs::write(&path, good).unwrap();
        Lens::load(&path).unwrap();
        for (text, field) in cases {
            std::fs::write(&path, text).unwrap();
            let error = Lens::load(&path).unwrap_err().to_string();
            assert!(error.contains(field) && error.contains("l.json") && !error.contains('\n'), "{error}");
        }
    }
}
