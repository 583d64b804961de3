//! What there is to import: pictures and their lights, whoever says so.

use super::fault::ImportError;
use super::picture::Encoding;
use super::{lightdome, manifest, radiance};
use relume_firmware::patches::PatchSet;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// One picture and its light.
#[derive(Clone, Debug)]
pub struct LightPicture {
    /// The picture.
    pub file: PathBuf,
    /// Unit direction towards the light, world space.
    pub dir_world: [f64; 3],
    /// Solid angle that the light stands for, sr; `None`: its cell.
    pub solid_angle_sr: Option<f64>,
    /// RGB irradiance of the light on a plane that faces it; `None`: the picture is lit by the patch at radiance 1.
    pub irradiance: Option<[f64; 3]>,
}

/// Which side light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Side {
    /// From all around.
    Around,
    /// From before the plane with this normal.
    Before([f64; 3]),
    /// From before the first of these that all lights are before; else from all around.
    FirstOf([[f64; 3]; 2]),
}

/// A set of pictures.
#[derive(Clone, Debug)]
pub struct Source {
    /// What says so: a file or a folder.
    pub place: PathBuf,
    /// Which kind it is.
    pub kind: &'static str,
    /// Pictures, in their own order.
    pub pictures: Vec<LightPicture>,
    /// Which side light comes from.
    pub side: Side,
    /// The set, where it is one that the bake knows.
    pub known: Option<PatchSet>,
    /// How pixels are encoded, if the set says so.
    pub encoding: Option<Encoding>,
    /// A picture of the coverage.
    pub mask: Option<PathBuf>,
    /// Where true north lies, degrees from -Z towards +X.
    pub north_deg: f64,
    /// Most surface hits and seed of the bake that the pictures came from; 0 for others.
    pub made_by: (u32, u64),
}

impl Source {
    /// A set at `place` of this kind.
    pub(super) fn new(place: &Path, kind: &'static str, side: Side) -> Self {
        Source {
            place: place.to_owned(),
            kind,
            pictures: Vec::new(),
            side,
            known: None,
            encoding: None,
            mask: None,
            north_deg: 0.0,
            made_by: (0, 0),
        }
    }

    /// Opens a `.lp` file, a folder with `manifest.toml`, one with a single `.lp` file, or one of Radiance patch pictures.
    ///
    /// # Errors
    /// [`ImportError`] that tells what is wrong where.
    pub fn open(place: &Path) -> Result<Self, ImportError> {
        if place.is_file() {
            let is_dome = place.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("lp"));
            return match (is_dome, place.file_name().is_some_and(|name| name == manifest::NAME)) {
                (true, _) => lightdome::open(place),
                (_, true) => manifest::open(place),
                _ => Err(ImportError::file(place, "not a set of pictures; name a folder or a .lp file")),
            };
        }
        let listing = std::fs::read_dir(place).map_err(|error| ImportError::file(place, error))?;
        let mut files: Vec<PathBuf> = listing.filter_map(|entry| Some(entry.ok()?.path())).collect();
        files.sort();
        let written = place.join(manifest::NAME);
        if files.contains(&written) {
            return manifest::open(&written);
        }
        let is_dome = |file: &&PathBuf| file.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("lp"));
        match files.iter().filter(is_dome).collect::<Vec<_>>().as_slice() {
            [] => radiance::open(place, &files),
            [dome] => lightdome::open(dome),
            [a, b, ..] => {
                let [a, b] = [a, b].map(|file| file.file_name().unwrap_or_default().to_string_lossy());
                Err(ImportError::file(place, format!("has {a} and {b}; name one of them")))
            }
        }
    }

    /// Checks that no picture is named twice and none is missing.
    pub(super) fn check_files(self) -> Result<Self, ImportError> {
        let mut seen: HashMap<&Path, usize> = HashMap::new();
        for (index, picture) in self.pictures.iter().enumerate() {
            if seen.insert(&picture.file, index).is_some() {
                return Err(ImportError::file(&self.place, format!("{} is named twice", picture.file.display())));
            }
            if let Err(error) = std::fs::metadata(&picture.file) {
                return Err(ImportError::file(&picture.file, format!("{error}; {} names it", self.place.display())));
            }
        }
        Ok(self)
    }
}

/// The unit vector, or what is wrong with it.
pub(super) fn unit(dir: [f64; 3]) -> Result<[f64; 3], String> {
    let length = dir.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [x, y, z] = dir;
    if !length.is_finite() {
        return Err(format!("direction {x} {y} {z} is not finite"));
    }
    if length < 1e-6 {
        return Err(format!("direction {x} {y} {z} points nowhere"));
    }
    Ok(dir.map(|c| c / length))
}
