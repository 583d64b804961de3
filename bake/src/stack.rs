//! The stack: one linear picture per patch, with coverage, the sun and a manifest, written whole or not at all.
//!
//! Tiles arrive in any order and are spooled to one file, so that memory is bounded by a tile and one picture.

use std::fs::{self, File};
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use exr::prelude as exrs;
use rayon::prelude::*;
use relume_firmware::glue::cuts;
use relume_firmware::patches::PatchSet;
use serde::{Deserialize, Serialize};

use crate::response::TileResponse;
use crate::sun::SUN_DIAMETER_DEG;

/// Version of `manifest.toml`.
pub const MANIFEST_VERSION: u32 = 1;
const MANIFEST: &str = "manifest.toml";
const COVERAGE: &str = "coverage.exr";
const SUN: &str = "sun.exr";
/// Start of the name of the folder in which a stack grows.
const GROWING: &str = ".growing-stack-";

/// Why a stack could not be written. Every message names the file or folder and what to do.
#[derive(Debug, thiserror::Error)]
pub enum StackError {
    /// The folder holds something else.
    #[error("{dir}: holds files that are not a stack ({found}); name an empty or a new folder", dir = .dir.display())]
    Foreign {
        /// The folder.
        dir: PathBuf,
        /// A file that does not belong to a stack.
        found: String,
    },
    /// The folder cannot be made or used.
    #[error("{dir}: cannot write a stack here: {source}; name a folder that can be written", dir = .dir.display())]
    Folder {
        /// The folder.
        dir: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file could not be written; nothing is left behind.
    #[error("{file}: cannot write: {fault}; make room or name another folder", file = .file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// What went wrong.
        fault: String,
    },
}

/// The sun of a stack.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ManifestSun {
    /// Always `sun.exr`'s sun: degrees clockwise from true north.
    pub azimuth_deg: f64,
    /// Degrees above the horizon.
    pub altitude_deg: f64,
    /// Unit direction towards the sun, world space.
    pub direction: [f32; 3],
    /// Diameter of the disc, degrees.
    pub diameter_deg: f32,
}

impl ManifestSun {
    /// The sun at an azimuth and altitude in degrees, which is the unit direction `dir_world`.
    pub fn new(azimuth_deg: f64, altitude_deg: f64, dir_world: [f32; 3]) -> Self {
        ManifestSun { azimuth_deg, altitude_deg, direction: dir_world, diameter_deg: SUN_DIAMETER_DEG }
    }
}

/// The side of a plane that all light of a set comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Horizon {
    /// Towards this unit vector, world space.
    Towards([f64; 3]),
    /// The word `none`: from all around.
    Word(String),
}

impl Horizon {
    fn of(axis: Option<[f32; 3]>) -> Self {
        axis.map_or_else(|| Horizon::Word("none".to_owned()), |axis| Horizon::Towards(axis.map(f64::from)))
    }
}

/// One patch of a stack.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ManifestPatch {
    /// The picture's name in the folder.
    pub file: String,
    /// Unit direction towards the light, world space.
    pub direction: [f32; 3],
    /// Solid angle, sr.
    pub solid_angle_sr: f32,
}

/// `manifest.toml`: what the pictures of a stack are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`MANIFEST_VERSION`].
    pub version: u32,
    /// Construction and counts of the patch set by name.
    pub patch_set: String,
    /// [`PatchSet::id`].
    pub patch_set_id: u32,
    /// Patches of the upper hemisphere.
    pub n_upper: usize,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Most surface hits of a path; 0 for no limit.
    pub max_hits: u32,
    /// The seed of the bake.
    pub seed: u64,
    /// Where true north lies, degrees from -Z towards +X.
    pub north_deg: f64,
    /// The sun of `sun.exr`, if that was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sun: Option<ManifestSun>,
    /// The side that the light comes from, of listed directions only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub horizon: Option<Horizon>,
    /// How the sky is cut, of patches cut to a scene only ([`cuts::to_text`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cuts: Option<String>,
    /// In the order of the patch set.
    #[serde(rename = "patch")]
    pub patches: Vec<ManifestPatch>,
}

impl Manifest {
    /// A manifest for pictures of `size` (width, height) over `set`.
    pub fn new(set: &PatchSet, size: (u32, u32), max_hits: u32, seed: u64, north_deg: f64) -> Self {
        let patch = |index| ManifestPatch {
            file: format!("patch_{index:03}.exr"),
            direction: set.dir_world(index),
            solid_angle_sr: set.solid_angle_sr(index),
        };
        Manifest {
            version: MANIFEST_VERSION,
            patch_set: match (set.listed(), set.subdivided()) {
                (Some(list), _) => format!("listed-{}", list.len()),
                (_, Some(cells)) => format!("cuts-{}", cells.len()),
                _ => format!("leopardi-{}+{}", set.upper(), set.lower()),
            },
            cuts: set.subdivided().map(cuts::to_text),
            horizon: set.listed().map(|_| Horizon::of(set.horizon())),
            patch_set_id: set.id(),
            n_upper: set.upper(),
            width: size.0,
            height: size.1,
            max_hits,
            seed,
            north_deg,
            sun: None,
            patches: (0..set.len()).map(patch).collect(),
        }
    }
}

/// Where a tile lies in the spool.
struct Spooled {
    offset: u64,
    /// Indices of its pixels in the picture.
    pixels: Vec<u32>,
}

struct Spool {
    file: File,
    end: u64,
    tiles: Vec<Spooled>,
    /// `[height][width]`.
    coverage: Vec<f32>,
    /// `[height][width][channel]`.
    sun: Vec<f32>,
}

/// Writes one stack. Dropped before [`StackWriter::finish`], it leaves nothing behind.
pub struct StackWriter {
    dir: PathBuf,
    made_dir: bool,
    growing: Option<tempfile::TempDir>,
    manifest: Manifest,
    spool: Mutex<Spool>,
}

impl StackWriter {
    /// Prepares `dir`, which must be new, empty, or an older stack (replaced at the end). Its parent must exist.
    ///
    /// # Errors
    /// [`StackError`] when the folder cannot be written or holds something else.
    pub fn create(dir: &Path, manifest: Manifest) -> Result<Self, StackError> {
        let folder = |source| StackError::Folder { dir: dir.to_owned(), source };
        let made_dir = match fs::create_dir(dir) {
            Ok(()) => true,
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => false,
            Err(error) => return Err(folder(error)),
        };
        if !made_dir {
            refuse_foreign(dir)?;
        }
        let grow = || {
            let growing = tempfile::Builder::new().prefix(GROWING).tempdir_in(dir)?;
            let file = File::options().read(true).write(true).create_new(true).open(growing.path().join("spool"))?;
            Ok((growing, file))
        };
        let (growing, file) = grow().map_err(|source| {
            if made_dir {
                let _ = fs::remove_dir(dir);
            }
            folder(source)
        })?;
        let pixels = manifest.width as usize * manifest.height as usize;
        let sun = if manifest.sun.is_some() { vec![0.0; 3 * pixels] } else { Vec::new() };
        let spool = Mutex::new(Spool { file, end: 0, tiles: Vec::new(), coverage: vec![0.0; pixels], sun });
        Ok(StackWriter { dir: dir.to_owned(), made_dir, growing: Some(growing), manifest, spool })
    }

    /// Adds a tile, and its response to the sun (`[h][w][channel]`) when the manifest names one. Any thread, any order.
    ///
    /// # Errors
    /// [`StackError::Write`], for instance when the disk is full.
    pub fn write_tile(&self, tile: &TileResponse, sun: Option<&[f32]>) -> Result<(), StackError> {
        let width = self.manifest.width;
        let at = |index: u32| (tile.y0 + index / tile.w) * width + tile.x0 + index % tile.w;
        let bytes = spool_order(tile);
        let mut spool = self.spool.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let offset = spool.end;
        // After a failed write the file's position is unknown: always say where.
        let written = spool.file.seek(SeekFrom::Start(offset)).and_then(|_| spool.file.write_all(&bytes));
        written.map_err(|error| self.fault("spool", error))?;
        spool.end += bytes.len() as u64;
        spool.tiles.push(Spooled { offset, pixels: tile.covered.iter().map(|&i| at(u32::from(i))).collect() });
        for (index, &share) in tile.coverage.iter().enumerate() {
            let pixel = at(index as u32) as usize;
            spool.coverage[pixel] = share;
            if let Some(sun) = sun
                && !spool.sun.is_empty()
            {
                spool.sun[3 * pixel..3 * pixel + 3].copy_from_slice(&sun[3 * index..3 * index + 3]);
            }
        }
        Ok(())
    }

    /// Writes the pictures and the manifest and puts them in place; the manifest comes last.
    ///
    /// # Errors
    /// [`StackError::Write`]; then no file of this stack is left.
    pub fn finish(mut self) -> Result<(), StackError> {
        let Some(growing) = self.growing.take() else { return Ok(()) };
        let folder = growing.path().to_owned();
        let mut names: Vec<String> = self.manifest.patches.iter().map(|patch| patch.file.clone()).collect();
        names.par_iter().enumerate().try_for_each(|(patch, name)| {
            let picture = self.patch_picture(patch)?;
            write_rgb(&folder.join(name), self.size(), &picture).map_err(|fault| self.fault(name, fault))
        })?;
        let spool = self.spool.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        write_grey(&folder.join(COVERAGE), self.size(), &spool.coverage)
            .map_err(|fault| self.fault(COVERAGE, fault))?;
        names.push(COVERAGE.into());
        if !spool.sun.is_empty() {
            write_rgb(&folder.join(SUN), self.size(), &spool.sun).map_err(|fault| self.fault(SUN, fault))?;
            names.push(SUN.into());
        }
        drop(spool);
        let text = toml::to_string(&self.manifest).map_err(|error| self.fault(MANIFEST, error))?;
        fs::write(folder.join(MANIFEST), text).map_err(|error| self.fault(MANIFEST, error))?;
        names.push(MANIFEST.into());
        self.put_in_place(&folder, &names)?;
        self.made_dir = false;
        Ok(())
    }

    fn put_in_place(&self, folder: &Path, names: &[String]) -> Result<(), StackError> {
        // An older stack loses its manifest first: without one it is no stack, whatever happens on the way.
        for name in std::iter::once(MANIFEST.to_owned()).chain(old_files(&self.dir)) {
            match fs::remove_file(self.dir.join(&name)) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(self.fault(&name, error)),
                _ => {}
            }
        }
        names.iter().try_for_each(|name| {
            fs::rename(folder.join(name), self.dir.join(name)).map_err(|error| self.fault(name, error))
        })
    }

    fn patch_picture(&self, patch: usize) -> Result<Vec<f32>, StackError> {
        let mut picture = vec![0.0f32; 3 * self.manifest.width as usize * self.manifest.height as usize];
        let mut spool = self.spool.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let Spool { file, tiles, .. } = &mut *spool;
        let mut bytes = Vec::new();
        for tile in tiles {
            bytes.resize(12 * tile.pixels.len(), 0);
            let from = tile.offset + (patch * bytes.len()) as u64;
            let read = file.seek(SeekFrom::Start(from)).and_then(|_| file.read_exact(&mut bytes));
            read.map_err(|error| self.fault("spool", error))?;
            for (&pixel, rgb) in tile.pixels.iter().zip(bytes.as_chunks::<12>().0) {
                for (value, bytes) in picture[3 * pixel as usize..].iter_mut().zip(rgb.as_chunks::<4>().0) {
                    *value = f32::from_le_bytes(*bytes);
                }
            }
        }
        Ok(picture)
    }

    fn size(&self) -> (usize, usize) {
        (self.manifest.width as usize, self.manifest.height as usize)
    }

    fn fault(&self, name: &str, fault: impl std::fmt::Display) -> StackError {
        let fault = fault.to_string().lines().collect::<Vec<_>>().join(" ");
        StackError::Write { file: self.dir.join(name), fault }
    }
}

impl Drop for StackWriter {
    fn drop(&mut self) {
        drop(self.growing.take());
        if self.made_dir {
            let _ = fs::remove_dir(&self.dir);
        }
    }
}

/// A tile's response as bytes, `[patch][covered][channel]`: one patch is one run.
fn spool_order(tile: &TileResponse) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(4 * tile.response.len());
    for patch in 0..tile.patches {
        for value in tile.response[patch.min(tile.response.len())..].iter().step_by(tile.patches) {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
    }
    bytes
}

fn is_picture(name: &str) -> bool {
    name == COVERAGE || name == SUN || (name.starts_with("patch_") && name.ends_with(".exr"))
}

fn file_names(dir: &Path) -> std::io::Result<Vec<String>> {
    fs::read_dir(dir)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
}

fn old_files(dir: &Path) -> Vec<String> {
    file_names(dir).unwrap_or_default().into_iter().filter(|name| is_picture(name)).collect()
}

/// # Errors
/// [`StackError::Foreign`] when `dir` holds what no stack holds, or pictures without the manifest of a stack.
fn refuse_foreign(dir: &Path) -> Result<(), StackError> {
    let names = file_names(dir).map_err(|source| StackError::Folder { dir: dir.to_owned(), source })?;
    let manifest = fs::read_to_string(dir.join(MANIFEST)).ok();
    let ours = manifest.is_some_and(|text| toml::from_str::<Manifest>(&text).is_ok());
    let belongs = |name: &str| name.starts_with(GROWING) || (ours && (name == MANIFEST || is_picture(name)));
    match names.into_iter().find(|name| !belongs(name)) {
        Some(found) => Err(StackError::Foreign { dir: dir.to_owned(), found }),
        None => Ok(()),
    }
}

const ENCODING: exrs::Encoding = exrs::Encoding {
    compression: exrs::Compression::ZIP16,
    blocks: exrs::Blocks::ScanLines,
    line_order: exrs::LineOrder::Increasing,
};

/// Writes `[height][width][3]` as 32-bit float R, G, B.
fn write_rgb(path: &Path, (width, height): (usize, usize), rgb: &[f32]) -> Result<(), exr::error::Error> {
    use exr::prelude::*;
    let pixel = |at: Vec2<usize>| {
        let from = 3 * (at.y() * width + at.x());
        (rgb[from], rgb[from + 1], rgb[from + 2])
    };
    let layer = Layer::new((width, height), LayerAttributes::default(), ENCODING, SpecificChannels::rgb(pixel));
    let mut file = BufWriter::new(File::create(path)?);
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut file)?;
    Ok(file.flush()?)
}

/// Writes `[height][width]` as one 32-bit float channel "A".
fn write_grey(path: &Path, size: (usize, usize), values: &[f32]) -> Result<(), exr::error::Error> {
    use exr::prelude::*;
    let channel = AnyChannel::new("A", FlatSamples::F32(values.to_vec()));
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![channel]));
    let layer = Layer::new(size, LayerAttributes::default(), ENCODING, channels);
    let mut file = BufWriter::new(File::create(path)?);
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut file)?;
    Ok(file.flush()?)
}

#[cfg(test)]
mod tests;
