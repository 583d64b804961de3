//! The exact pictures: f64 sums over an uncompressed stack, for all skies in one pass over its images.

use crate::relight::Picture;
use crate::sun::angle_deg;
use crate::weights::PatchWeights;
use exr::prelude::{FlatSamples, read_first_flat_layer_from_file, read_first_rgba_layer_from_file};
use rayon::prelude::*;
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Why a stack cannot be used; one line that names file, value and what to do.
#[derive(Debug, thiserror::Error)]
pub enum StackError {
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
    /// The stack's sun is not the sky's.
    #[error(
        "{}: the sky's sun is {angle_deg:.2} degrees from the stack's sun.exr; bake the stack with --sun {azimuth_deg:.2},{altitude_deg:.2}",
        path.display()
    )]
    Sun {
        /// The manifest.
        path: PathBuf,
        /// Angle between the two, degrees; NaN when the stack has no sun.
        angle_deg: f64,
        /// The sky's sun, degrees clockwise from north.
        azimuth_deg: f64,
        /// The sky's sun, degrees above the horizon.
        altitude_deg: f64,
    },
    /// The weights are not for this stack's patches.
    #[error("{}: the stack has {stack} patches, the weights {weights}; make the weights for this field", path.display())]
    Count {
        /// The manifest.
        path: PathBuf,
        /// The stack's.
        stack: usize,
        /// The weights'.
        weights: usize,
    },
}

#[derive(Debug, Deserialize)]
struct ManifestPatch {
    file: String,
}

#[derive(Debug, Deserialize)]
struct ManifestSun {
    direction: [f32; 3],
}

#[derive(Debug, Deserialize)]
struct Manifest {
    version: u32,
    patch_set_id: u32,
    n_upper: usize,
    width: usize,
    height: usize,
    #[serde(default)]
    north_deg: f64,
    sun: Option<ManifestSun>,
    patch: Vec<ManifestPatch>,
}

/// The stack's version that is read here.
const VERSION: u32 = 1;

/// Suns nearer to each other than this are the same sun, degrees.
pub const SAME_SUN_DEG: f64 = 0.1;

/// A stack on disk.
#[derive(Debug)]
pub struct Stack {
    dir: PathBuf,
    manifest: Manifest,
    /// Pixels with coverage, `y * width + x`, ascending.
    covered: Vec<u32>,
    alpha: Vec<f32>,
}

impl Stack {
    /// Reads the manifest and the coverage.
    ///
    /// # Errors
    /// [`StackError`] if either cannot be read.
    pub fn open(dir: &Path) -> Result<Self, StackError> {
        let path = dir.join("manifest.toml");
        let fault = |what: String| StackError::Manifest { path: path.clone(), what };
        let text = std::fs::read_to_string(&path).map_err(|error| fault(error.to_string()))?;
        let manifest: Manifest = toml::from_str(&text).map_err(|error| fault(error.message().replace('\n', " ")))?;
        if manifest.version != VERSION {
            return Err(fault(format!("version = {}, this program reads {VERSION}", manifest.version)));
        }
        let mut stack = Stack { dir: dir.to_owned(), manifest, covered: Vec::new(), alpha: Vec::new() };
        stack.alpha = stack.coverage()?;
        stack.covered = (0u32..).zip(&stack.alpha).filter(|(_, a)| **a > 0.0).map(|(at, _)| at).collect();
        Ok(stack)
    }

    /// Checks that `field` is of the same bake.
    ///
    /// # Errors
    /// [`StackError::Foreign`], naming what differs.
    pub fn check_field(&self, field: &Field<'_>) -> Result<(), StackError> {
        self.check_bake((field.width(), field.height()), field.patch_set())
    }

    fn check_bake(&self, size: (usize, usize), set: &PatchSet) -> Result<(), StackError> {
        let foreign =
            |what, stack: String, field: String| StackError::Foreign { path: self.path(), what, stack, field };
        let own = (self.manifest.width, self.manifest.height);
        if own != size {
            let text = |(w, h)| format!("{w}x{h}");
            return Err(foreign("size", text(own), text(size)));
        }
        if self.manifest.patch_set_id != set.id() || self.patches() != set.len() {
            let own = format!("{} ({} upper)", self.patches(), self.manifest.n_upper);
            return Err(foreign("patch set", own, format!("{} ({} upper)", set.len(), set.upper())));
        }
        Ok(())
    }

    fn path(&self) -> PathBuf {
        self.dir.join("manifest.toml")
    }

    fn patches(&self) -> usize {
        self.manifest.patch.len()
    }

    /// Direction of the sun of `sun.exr`, if there is one.
    pub fn sun_dir_world(&self) -> Option<[f32; 3]> {
        self.manifest.sun.as_ref().map(|sun| sun.direction)
    }

    /// Number of images: the patches, then the sun if there is one.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.patches() + usize::from(self.manifest.sun.is_some())
    }

    /// Pixels with coverage, `y * width + x`, ascending.
    pub fn covered(&self) -> &[u32] {
        &self.covered
    }

    fn image_fault(&self, name: &str, what: String) -> StackError {
        StackError::Image { path: self.dir.join(name), what }
    }

    fn check_image(&self, name: &str, width: usize, height: usize) -> Result<(), StackError> {
        let (w, h) = (self.manifest.width, self.manifest.height);
        if (width, height) == (w, h) {
            return Ok(());
        }
        Err(self.image_fault(name, format!("is {width}x{height}, not {w}x{h}")))
    }

    fn coverage(&self) -> Result<Vec<f32>, StackError> {
        let name = "coverage.exr";
        let image = read_first_flat_layer_from_file(self.dir.join(name));
        let layer = image.map_err(|error| self.image_fault(name, format!("cannot read: {error}")))?.layer_data;
        self.check_image(name, layer.size.width(), layer.size.height())?;
        match layer.channel_data.list.into_iter().next().map(|channel| channel.sample_data) {
            Some(FlatSamples::F32(alpha)) => Ok(alpha),
            _ => Err(self.image_fault(name, "has no 32-bit float channel".to_owned())),
        }
    }

    /// Linear premultiplied RGB of the pixels at `places` (`y * width + x`) in image `index`.
    ///
    /// # Errors
    /// [`StackError::Image`] if the file cannot be read, is of another size or holds a value that is not finite.
    pub fn pixels(&self, index: usize, places: &[u32]) -> Result<Vec<[f32; 3]>, StackError> {
        let name = self.manifest.patch.get(index).map_or("sun.exr", |patch| patch.file.as_str());
        let image = read_first_rgba_layer_from_file(
            self.dir.join(name),
            |size, _| (size.width(), vec![[0.0f32; 3]; size.area()]),
            |(width, pixels), at, (r, g, b, _): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b],
        );
        let layer = image.map_err(|error| self.image_fault(name, format!("cannot read: {error}")))?.layer_data;
        self.check_image(name, layer.size.width(), layer.size.height())?;
        let (_, pixels) = layer.channel_data.pixels;
        let picked: Vec<[f32; 3]> = places.iter().filter_map(|&at| pixels.get(at as usize).copied()).collect();
        if picked.len() != places.len() || picked.iter().flatten().any(|v| !v.is_finite()) {
            return Err(self.image_fault(name, "holds values that are not finite".to_owned()));
        }
        Ok(picked)
    }

    /// The exact picture under one sky.
    ///
    /// # Errors
    /// As [`Stack::sums`].
    pub fn sum(&self, weights: &PatchWeights) -> Result<Picture, StackError> {
        let sums = self.sums(std::slice::from_ref(weights), &self.covered)?;
        let (width, height) = (self.manifest.width, self.manifest.height);
        let mut picture = Picture { width, height, rgb: vec![[0.0; 3]; width * height], alpha: self.alpha.clone() };
        for (&at, rgb) in self.covered.iter().zip(sums.iter().flatten()) {
            picture.rgb[at as usize] = rgb.map(|v| v as f32);
        }
        Ok(picture)
    }

    /// Exact radiance of the pixels at `places` under each sky, every image read once.
    ///
    /// # Errors
    /// [`StackError`] if an image cannot be read, the weights are for other patches, or a sky has a sun that is not
    /// the stack's.
    pub fn sums(&self, skies: &[PatchWeights], places: &[u32]) -> Result<Vec<Vec<[f64; 3]>>, StackError> {
        skies.iter().try_for_each(|sky| self.check_weights(sky))?;
        let lit = |index: usize| skies.iter().any(|sky| weight(sky, index) != [0.0; 3]);
        let used: Vec<usize> = (0..self.len()).filter(|&index| lit(index)).collect();
        let mut sums = vec![vec![[0.0; 3]; places.len()]; skies.len()];
        // A few images at a time: decoding runs on all threads, the order of adding stays that of the patches.
        for batch in used.chunks(16) {
            let images: Result<Vec<_>, StackError> =
                batch.par_iter().map(|&index| Ok((index, self.pixels(index, places)?))).collect();
            let images = images?;
            sums.par_iter_mut().zip(skies).for_each(|(sum, sky)| {
                for (index, image) in &images {
                    let weight = weight(sky, *index);
                    for (sum, value) in sum.iter_mut().zip(image) {
                        for c in 0..3 {
                            sum[c] += f64::from(value[c]) * weight[c];
                        }
                    }
                }
            });
        }
        Ok(sums)
    }

    fn check_weights(&self, sky: &PatchWeights) -> Result<(), StackError> {
        if sky.radiance.len() != self.patches() {
            let (stack, weights) = (self.patches(), sky.radiance.len());
            return Err(StackError::Count { path: self.path(), stack, weights });
        }
        let Some(sun) = sky.sun.filter(|sun| sun.irradiance != [0.0; 3]) else { return Ok(()) };
        let angle = self.sun_dir_world().map_or(f64::NAN, |own| angle_deg(own, sun.dir_world));
        if angle <= SAME_SUN_DEG {
            return Ok(());
        }
        let at = crate::sun::position_of(sun.dir_world, self.manifest.north_deg);
        let (azimuth_deg, altitude_deg) = (at.azimuth_deg, at.altitude_deg);
        Err(StackError::Sun { path: self.path(), angle_deg: angle, azimuth_deg, altitude_deg })
    }
}

/// A sky's weight for an image of the stack; the sun's image comes after the patches'.
fn weight(sky: &PatchWeights, index: usize) -> [f64; 3] {
    let rgb = sky.radiance.get(index).copied();
    rgb.unwrap_or_else(|| sky.sun.map_or([0.0; 3], |sun| sun.irradiance)).map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::SunWeight;
    use exr::prelude::*;

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
        let channels = SpecificChannels::build().with_channel("A").with_pixel_fn(|at: Vec2<usize>| (at.x() as f32,));
        Image::from_channels((3, 2), channels).write().to_file(dir.join("coverage.exr")).unwrap();
    }

    fn sky(set: &PatchSet, lit: &[(usize, f32)], sun: Option<SunWeight>) -> PatchWeights {
        let mut radiance = vec![[0.0; 3]; set.len()];
        lit.iter().for_each(|&(patch, value)| radiance[patch] = [value, 2.0 * value, 0.0]);
        PatchWeights { radiance, sun }
    }

    #[test]
    fn two_patches_and_the_sun_by_hand() {
        let (dir, set) = (tempfile::tempdir().unwrap(), PatchSet::new(16).unwrap());
        write(dir.path(), &set, true);
        let value = |x: usize, y: usize| (x as f32, y as f32 + 0.5, -1.0f32);
        write_rgb_file(dir.path().join("patch_004.exr"), 3, 2, value).unwrap();
        write_rgb_file(dir.path().join("patch_007.exr"), 3, 2, |_, _| (10.0f32, 20.0f32, 30.0f32)).unwrap();
        write_rgb_file(dir.path().join("sun.exr"), 3, 2, |_, _| (7.0f32, 8.0f32, 9.0f32)).unwrap();
        let stack = Stack::open(dir.path()).unwrap();
        assert_eq!(stack.covered(), [1, 2, 4, 5]);
        let sun = SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: [0.0, 0.0, 1.0] };
        let picture = stack.sum(&sky(&set, &[(4, 1.0), (7, 0.5)], Some(sun))).unwrap();
        assert_eq!(picture.rgb[5], [2.0 + 5.0, 3.0 + 20.0, 9.0]);
        assert_eq!((picture.rgb[3], picture.alpha[3]), ([0.0; 3], 0.0));
        // An unlit image is not read: patch_005.exr does not exist.
        let text = stack.sum(&sky(&set, &[(5, 1.0)], None)).unwrap_err().to_string();
        assert!(text.contains("patch_005.exr") && !text.contains('\n'), "{text}");
    }

    #[test]
    fn another_sun_or_another_bake_is_refused_by_name() {
        let (dir, set) = (tempfile::tempdir().unwrap(), PatchSet::new(16).unwrap());
        assert!(Stack::open(dir.path()).unwrap_err().to_string().contains("manifest.toml"));
        write(dir.path(), &set, true);
        let stack = Stack::open(dir.path()).unwrap();
        let sun = SunWeight { dir_world: [1.0, 0.0, 0.0], irradiance: [1.0; 3] };
        let text = stack.sum(&sky(&set, &[], Some(sun))).unwrap_err().to_string();
        assert!(text.contains("--sun 90.00,0.00"), "{text}");
        let check = |size, set: &PatchSet| stack.check_bake(size, set).unwrap_err().to_string();
        assert!(check((4, 2), &set).contains("3x2"));
        assert!(check((3, 2), &PatchSet::new(32).unwrap()).contains("patch set"));
        std::fs::write(dir.path().join("manifest.toml"), "version = 1\nwidth = \"three\"").unwrap();
        assert!(!Stack::open(dir.path()).unwrap_err().to_string().contains('\n'));
    }
}
