//! The camera file: JSON.
//!
//! `{"position":[x,y,z],"target":[x,y,z],"up":[0,1,0],"fov_y_deg":45,"north_deg":0}`: a pinhole, its axis in the middle. Or,
//! instead of `fov_y_deg`, what `relume-bake camera` measures on a still: `"size_px":[w,h],"focal_px":f,"principal_px":[cx,cy],
//! "lens":{"model":"radial","k":[k1,k2,k3]}` or `{"model":"kannala_brandt","k":[k1,k2,k3,k4],"max_angle_deg":95}`. Then
//! `target` lies on the lens's axis. `up`, `north_deg`, `principal_px` (the middle), `lens` and `max_angle_deg` may be left out.

use super::{Camera, Optics};
use relume_firmware::lens::Projection;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

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

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Model {
    Radial,
    KannalaBrandt,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LensEntry {
    model: Model,
    k: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max_angle_deg: Option<f64>,
}

/// The file as it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    position: [f64; 3],
    target: [f64; 3],
    #[serde(default = "super::y_up")]
    up: [f64; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fov_y_deg: Option<f64>,
    #[serde(default)]
    north_deg: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    size_px: Option<[u32; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    focal_px: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    principal_px: Option<[f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lens: Option<LensEntry>,
}

impl Camera {
    /// Reads and checks a camera file.
    ///
    /// # Errors
    /// [`CameraError`] when the file is missing, is not JSON, has an unknown field, or holds a value no camera can have.
    pub fn load(path: &Path) -> Result<Self, CameraError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| CameraError::Read { file: path.to_owned(), source })?;
        Camera::parse(&text, path)
    }

    /// Reads and checks the text of a camera file; `path` is only named in the error.
    ///
    /// # Errors
    /// As for [`Camera::load`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, CameraError> {
        let file: CameraFile =
            serde_json::from_str(text).map_err(|source| CameraError::Parse { file: path.to_owned(), source })?;
        let optics = optics(&file, path)?;
        let fov_y_deg = match (file.fov_y_deg, &optics) {
            (Some(degrees), None) => degrees,
            (None, Some(optics)) => optics.pinhole_fov_y_deg(),
            (None, None) => return Err(fault(path, "fov_y_deg", "missing", "write degrees, or focal_px and size_px")),
            (Some(_), Some(_)) => {
                return Err(fault(path, "fov_y_deg", "there beside focal_px", "leave one of them out"));
            }
        };
        let CameraFile { position, target, up, north_deg, .. } = file;
        let camera = Camera { position, target, up, fov_y_deg, north_deg, optics };
        camera.check(path)?;
        Ok(camera)
    }

    /// The camera as a camera file, which [`Camera::parse`] reads back to the same numbers.
    pub fn to_json(&self) -> String {
        let Camera { position, target, up, fov_y_deg, north_deg, optics } = *self;
        let entry = |optics: Optics| {
            let (model, count) = match optics.projection {
                Projection::Radial => (Model::Radial, 3),
                Projection::KannalaBrandt => (Model::KannalaBrandt, 4),
            };
            let max_angle_deg = (optics.max_angle_deg < 180.0).then_some(optics.max_angle_deg);
            LensEntry { model, k: optics.k[..count].to_vec(), max_angle_deg }
        };
        let file = CameraFile {
            position,
            target,
            up,
            fov_y_deg: optics.is_none().then_some(fov_y_deg),
            north_deg,
            size_px: optics.map(|optics| optics.size_px),
            focal_px: optics.map(|optics| optics.focal_px),
            principal_px: optics.map(|optics| optics.principal_px),
            lens: optics.map(entry),
        };
        // A struct of numbers and texts always serialises.
        serde_json::to_string(&file).unwrap_or_default() + "\n"
    }
}

pub(super) fn fault(file: &Path, field: &'static str, value: impl ToString, advice: &'static str) -> CameraError {
    CameraError::Field { file: file.to_owned(), field, value: value.to_string(), advice }
}

fn optics(file: &CameraFile, path: &Path) -> Result<Option<Optics>, CameraError> {
    let Some(focal_px) = file.focal_px else {
        let lonely = [("size_px", file.size_px.is_some()), ("principal_px", file.principal_px.is_some())];
        return match lonely.into_iter().chain([("lens", file.lens.is_some())]).find(|(_, there)| *there) {
            Some((field, _)) => Err(fault(path, field, "there without focal_px", "write focal_px, in pixels, too")),
            None => Ok(None),
        };
    };
    let size_px = file.size_px.ok_or_else(|| fault(path, "size_px", "missing", "write the still's [width, height]"))?;
    let ideal = Optics::ideal(Projection::Radial, size_px, focal_px);
    let mut optics = Optics { principal_px: file.principal_px.unwrap_or(ideal.principal_px), ..ideal };
    if let Some(lens) = &file.lens {
        let (projection, most) = match lens.model {
            Model::Radial => (Projection::Radial, 3),
            Model::KannalaBrandt => (Projection::KannalaBrandt, 4),
        };
        if lens.k.len() > most {
            let advice = "a radial lens has at most 3 numbers, a kannala_brandt lens 4";
            return Err(fault(path, "lens.k", format!("{:?}", lens.k), advice));
        }
        optics.projection = projection;
        optics.k[..lens.k.len()].copy_from_slice(&lens.k);
        optics.max_angle_deg = lens.max_angle_deg.unwrap_or(180.0);
    }
    Ok(Some(optics))
}

impl Optics {
    /// Checks the values; `file` is only named in the error.
    ///
    /// # Errors
    /// [`CameraError::Field`]: numbers that no lens has, and a model that turns back within the picture.
    pub(super) fn check(&self, file: &Path) -> Result<(), CameraError> {
        if self.size_px.iter().any(|side| !(1..=1 << 20).contains(side)) {
            return Err(fault(file, "size_px", format!("{:?}", self.size_px), "write the still's width and height"));
        }
        if !(self.focal_px > 1e-3 && self.focal_px < 1e9) {
            return Err(fault(file, "focal_px", self.focal_px, "write the focal length in pixels of the still"));
        }
        if !self.principal_px.iter().all(|v| v.abs() < 1e7) {
            return Err(fault(file, "principal_px", format!("{:?}", self.principal_px), "write two finite numbers"));
        }
        if !self.k.iter().all(|v| v.abs() < 1e6) {
            return Err(fault(file, "lens.k", format!("{:?}", self.k), "write finite numbers"));
        }
        if !(self.max_angle_deg > 0.0 && self.max_angle_deg <= 180.0) {
            return Err(fault(file, "lens.max_angle_deg", self.max_angle_deg, "write degrees above 0, 180 at most"));
        }
        if let Some(fold_px) = self.fold_px() {
            let advice = "the model is no lens: measure it again, with points near the corners, or, of a fisheye whose \
                          round picture ends before, write max_angle_deg";
            return Err(fault(
                file,
                "lens.k",
                format!("such that distances turn back {fold_px:.0} px off the axis"),
                advice,
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHERE: &str = r#""position":[1,2,3],"target":[0,2,-9.25]"#;

    fn parsed(rest: &str) -> Result<Camera, CameraError> {
        Camera::parse(&format!("{{{WHERE},{rest}}}"), Path::new("c.json"))
    }

    #[test]
    fn files_without_a_lens_are_pinholes() {
        let camera = parsed(r#""fov_y_deg":45"#).unwrap();
        assert_eq!((camera.fov_y_deg, camera.optics, camera.up), (45.0, None, [0.0, 1.0, 0.0]));
        assert_eq!(Camera::parse(&camera.to_json(), Path::new("c")).unwrap(), camera);
    }

    #[test]
    fn files_with_a_lens_come_back() {
        let lens = r#""lens":{"model":"kannala_brandt","k":[0.01,-0.002],"max_angle_deg":95}"#;
        let camera = parsed(&format!(r#""size_px":[400,300],"focal_px":150,"principal_px":[201,149],{lens}"#)).unwrap();
        let optics = camera.optics.unwrap();
        assert_eq!((optics.k, optics.max_angle_deg), ([0.01, -0.002, 0.0, 0.0], 95.0));
        assert!((camera.fov_y_deg - 90.0).abs() < 1e-9);
        assert_eq!(Camera::parse(&camera.to_json(), Path::new("c")).unwrap(), camera);
        let plain = parsed(r#""size_px":[400,300],"focal_px":150"#).unwrap();
        assert_eq!(plain.optics.unwrap(), Optics::ideal(Projection::Radial, [400, 300], 150.0));
    }

    #[test]
    fn faults_name_the_field() {
        let folded = r#""size_px":[400,300],"focal_px":200,"lens":{"model":"radial","k":[-0.3333]}"#;
        let many = r#""size_px":[400,300],"focal_px":200,"lens":{"model":"radial","k":[0,0,0,0]}"#;
        let bad = [
            ("\"north_deg\":1", "fov_y_deg"),
            (r#""fov_y_deg":45,"focal_px":150,"size_px":[4,3]"#, "fov_y_deg"),
            (r#""focal_px":150"#, "size_px"),
            (r#""fov_y_deg":45,"size_px":[4,3]"#, "size_px"),
            (r#""fov_y_deg":45,"lens":{"model":"radial","k":[]}"#, "lens"),
            (r#""size_px":[0,3],"focal_px":150"#, "size_px"),
            (r#""size_px":[4,3],"focal_px":-1"#, "focal_px"),
            (r#""size_px":[4,3],"focal_px":1e10"#, "focal_px"),
            (r#""size_px":[4,3],"focal_px":10,"principal_px":[1e9,0]"#, "principal_px"),
            (folded, "lens.k"),
            (many, "lens.k"),
        ];
        for (text, field) in bad {
            let told = parsed(text).unwrap_err().to_string();
            assert!(told.starts_with(&format!("c.json: {field} is ")) && !told.contains('\n'), "{told}");
        }
        assert!(parsed(r#""fov_y_deg":45,"fov":3"#).unwrap_err().to_string().contains("fov"));
    }
}
