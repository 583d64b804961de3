//! The images of a stack, one at a time: the bench sums them for all skies in one pass and never holds more than one.

use std::path::{Path, PathBuf};

use exr::prelude::read_first_rgba_layer_from_file;
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;
use serde::Deserialize;

/// Why a stack cannot be used; one line that names file, value and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ImagesError {
    /// The manifest cannot be read.
    #[error("{}: cannot read the stack's manifest: {what}; name the folder that relume-bake --stack wrote", path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// Field and stack are of different bakes.
    #[error("{}: {what} is {stack} in the stack but {field} in the field; name the stack that the field was baked with", path.display())]
    Foreign {
        /// The manifest.
        path: PathBuf,
        /// What differs.
        what: &'static str,
        /// The stack's.
        stack: String,
        /// The field's.
        field: String,
    },
    /// An image cannot be read, or is not what the manifest says.
    #[error("{}: {what}; write the stack again", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
}

#[derive(Deserialize)]
struct ManifestPatch {
    file: String,
}

#[derive(Deserialize)]
struct ManifestSun {
    direction: [f32; 3],
}

#[derive(Deserialize)]
struct Manifest {
    version: u32,
    patch_set_id: u32,
    n_upper: usize,
    width: usize,
    height: usize,
    sun: Option<ManifestSun>,
    patch: Vec<ManifestPatch>,
}

/// The stack's version that is read here.
const VERSION: u32 = 1;

/// A stack that fits a field.
pub struct Images {
    dir: PathBuf,
    manifest: Manifest,
}

impl Images {
    /// Reads the manifest and checks it against the field.
    ///
    /// # Errors
    /// [`ImagesError`] if it cannot be read or is another bake's.
    pub fn open(dir: &Path, field: &Field<'_>) -> Result<Self, ImagesError> {
        Self::open_for(dir, (field.width(), field.height()), field.patch_set())
    }

    fn open_for(dir: &Path, size: (usize, usize), set: &PatchSet) -> Result<Self, ImagesError> {
        let path = dir.join("manifest.toml");
        let fault = |what: String| ImagesError::Manifest { path: path.clone(), what };
        let text = std::fs::read_to_string(&path).map_err(|error| fault(error.to_string()))?;
        let parsed = toml::from_str::<Manifest>(&text);
        let manifest = parsed.map_err(|error| fault(error.message().replace('\n', " ")))?;
        let foreign =
            |what, stack: String, field: String| ImagesError::Foreign { path: path.clone(), what, stack, field };
        if manifest.version != VERSION {
            return Err(fault(format!("version = {}, this program reads {VERSION}", manifest.version)));
        }
        let of_stack = (manifest.width, manifest.height);
        if of_stack != size {
            let text = |(w, h)| format!("{w}x{h}");
            return Err(foreign("size", text(of_stack), text(size)));
        }
        if manifest.patch_set_id != set.id() || manifest.patch.len() != set.len() {
            let of_stack = format!("{} ({} upper)", manifest.patch.len(), manifest.n_upper);
            return Err(foreign("patch set", of_stack, format!("{} ({} upper)", set.len(), set.upper())));
        }
        Ok(Images { dir: dir.to_owned(), manifest })
    }

    /// Direction of the sun of `sun.exr`, if there is one.
    pub fn sun_dir_world(&self) -> Option<[f32; 3]> {
        self.manifest.sun.as_ref().map(|sun| sun.direction)
    }

    /// Number of images: the patches, then the sun if there is one.
    pub fn len(&self) -> usize {
        self.manifest.patch.len() + usize::from(self.manifest.sun.is_some())
    }

    /// Linear premultiplied RGB of the pixels at `places` (`y * width + x`) in image `index`.
    ///
    /// # Errors
    /// [`ImagesError::Image`] if the file cannot be read, is of another size or holds a value that is not finite.
    pub fn pixels(&self, index: usize, places: &[u32]) -> Result<Vec<[f32; 3]>, ImagesError> {
        let name = self.manifest.patch.get(index).map_or("sun.exr", |patch| patch.file.as_str());
        let path = self.dir.join(name);
        let fault = |what: String| ImagesError::Image { path: path.clone(), what };
        let image = read_first_rgba_layer_from_file(
            &path,
            |size, _| (size.width(), vec![[0.0f32; 3]; size.area()]),
            |(width, pixels), at, (r, g, b, _): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b],
        );
        let layer = image.map_err(|error| fault(format!("cannot read: {error}")))?.layer_data;
        if (layer.size.width(), layer.size.height()) != (self.manifest.width, self.manifest.height) {
            let (width, height) = (self.manifest.width, self.manifest.height);
            return Err(fault(format!("is {}x{}, not {width}x{height}", layer.size.width(), layer.size.height())));
        }
        let (_, pixels) = layer.channel_data.pixels;
        let picked: Vec<[f32; 3]> = places.iter().filter_map(|&at| pixels.get(at as usize).copied()).collect();
        if picked.len() != places.len() || picked.iter().flatten().any(|v| !v.is_finite()) {
            return Err(fault("holds values that are not finite".to_owned()));
        }
        Ok(picked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(dir: &Path, set: &PatchSet, sun: bool) {
        let mut text = format!(
            "version = 1\npatch_set = \"x\"\npatch_set_id = {}\nn_upper = {}\nwidth = 3\nheight = 2\n",
            set.id(),
            set.upper()
        );
        if sun {
            text +=
                "[sun]\nazimuth_deg = 0.0\naltitude_deg = 90.0\ndirection = [0.0, 1.0, 0.0]\ndiameter_deg = 0.533\n";
        }
        for patch in 0..set.len() {
            text += &format!("[[patch]]\nfile = \"patch_{patch:03}.exr\"\n");
        }
        std::fs::write(dir.join("manifest.toml"), text).unwrap();
    }

    #[test]
    fn pixels_come_in_the_order_of_their_places() {
        let (dir, set) = (tempfile::tempdir().unwrap(), PatchSet::new(16).unwrap());
        write(dir.path(), &set, true);
        let value = |x: usize, y: usize| (x as f32, y as f32 + 0.5, -1.0);
        exr::prelude::write_rgb_file(dir.path().join("patch_004.exr"), 3, 2, value).unwrap();
        exr::prelude::write_rgb_file(dir.path().join("sun.exr"), 3, 2, |_, _| (7.0f32, 8.0f32, 9.0f32)).unwrap();
        let images = Images::open_for(dir.path(), (3, 2), &set).unwrap();
        assert_eq!((images.len(), images.sun_dir_world()), (18, Some([0.0, 1.0, 0.0])));
        assert_eq!(images.pixels(4, &[1, 5]).unwrap(), [[1.0, 0.5, -1.0], [2.0, 1.5, -1.0]]);
        assert_eq!(images.pixels(17, &[0]).unwrap(), [[7.0, 8.0, 9.0]]);
        let text = images.pixels(5, &[0]).unwrap_err().to_string();
        assert!(text.contains("patch_005.exr") && !text.contains('\n'), "{text}");
    }

    #[test]
    fn another_bakes_stack_is_refused_by_name() {
        let (dir, set) = (tempfile::tempdir().unwrap(), PatchSet::new(16).unwrap());
        let open = |size, set: &PatchSet| Images::open_for(dir.path(), size, set).err().unwrap().to_string();
        assert!(open((3, 2), &set).contains("manifest.toml"));
        write(dir.path(), &set, false);
        let text = open((4, 2), &set);
        assert!(text.contains("3x2") && text.contains("4x2"), "{text}");
        assert!(open((3, 2), &PatchSet::new(32).unwrap()).contains("patch set"));
        std::fs::write(dir.path().join("manifest.toml"), "version = 1\nwidth = \"three\"").unwrap();
        assert!(!open((3, 2), &set).contains('\n'));
    }
}
