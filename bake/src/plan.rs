//! A plan: everything that a bake's blocks depend on, written down so that shares of it can be baked anywhere.

use crate::bake::{BakeError, BakeOptions};
use crate::camera::Camera;
use crate::job::block_count;
use crate::jobs::all_blocks;
use crate::response::TransportOptions;
use crate::scene::{Scene, Shading};
use relume_firmware::glue::cuts;
use relume_firmware::patches::Subdivided;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Why a plan cannot be used; one line.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// It cannot be read.
    #[error("{}: {source}", file.display())]
    Read {
        /// The plan.
        file: PathBuf,
        /// What happened.
        source: std::io::Error,
    },
    /// It is no plan.
    #[error("{}: no plan of relume-bake: {fault}", file.display())]
    Parse {
        /// The plan.
        file: PathBuf,
        /// What is wrong where.
        fault: String,
    },
    /// Another version made it.
    #[error("{}: made by relume-bake {made_by}, this is {}; plan again", file.display(), env!("CARGO_PKG_VERSION"))]
    Version {
        /// The plan.
        file: PathBuf,
        /// The version that made it.
        made_by: String,
    },
    /// Scene, camera or skies are not those it was made for.
    #[error("{}: scene, camera or test skies have changed since the plan was made; plan again", .0.display())]
    Changed(PathBuf),
}

/// A bake in shares; TOML.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Version of the program that made it.
    pub relume_bake: String,
    /// The scene's file; relative to the plan's folder.
    pub scene: PathBuf,
    /// The camera's file, likewise; none for the built-in scene.
    pub camera: Option<PathBuf>,
    /// Width and height, px.
    pub size: [u32; 2],
    /// Patches of the upper hemisphere.
    pub directions: usize,
    /// Of all directions alike.
    pub sphere: bool,
    /// Patches cut to the scene, if they are ([`cuts::to_text`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cuts: Option<String>,
    /// Relative error that the compression aims at.
    pub error: f64,
    /// Latitude and longitude of the site, degrees.
    pub site: Option<[f64; 2]>,
    /// Captured maps that the field's error is told for, relative to the plan's folder.
    pub test_skies: Vec<PathBuf>,
    /// Number of its tiles: blocks of 32x32 px, row by row, as `--tiles` counts them; where receivers are marked, all of them
    /// three times.
    pub tiles: u32,
    /// Of the bake with these very scene and camera.
    pub identity: u32,
    /// Which part of the scene's materials is used.
    pub materials: Shading,
    /// Sampling of the light transport.
    pub transport: TransportOptions,
}

impl Plan {
    /// Plans a bake of `scene` and `camera`, which came from `files`, for a plan that will lie in `folder`.
    ///
    /// # Errors
    /// [`BakeError::TestSky`]: a test sky cannot be read.
    pub fn new(
        (scene, camera): (&Scene, &Camera),
        files: (&Path, Option<&Path>),
        options: &BakeOptions,
        folder: &Path,
    ) -> Result<Self, BakeError> {
        Ok(Plan {
            relume_bake: env!("CARGO_PKG_VERSION").to_owned(),
            scene: seen_from(folder, files.0),
            camera: files.1.map(|camera| seen_from(folder, camera)),
            size: options.size.into(),
            directions: options.directions,
            sphere: options.sphere,
            cuts: options.cuts.as_deref().map(cuts::to_text),
            error: options.error,
            site: options.site,
            test_skies: options.test_maps.iter().map(|map| seen_from(folder, map)).collect(),
            tiles: all_blocks(scene, options.size),
            identity: identity(scene, camera, options)?,
            materials: scene.shading,
            transport: options.transport,
        })
    }

    /// Reads a plan; its paths then count from the current folder.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn load(file: &Path) -> Result<Self, PlanError> {
        let text = std::fs::read_to_string(file).map_err(|source| PlanError::Read { file: file.to_owned(), source })?;
        let parsed: Result<Plan, toml::de::Error> = toml::from_str(&text);
        let mut plan = parsed.map_err(|error| {
            let fault = error.to_string().lines().collect::<Vec<_>>().join(" ");
            PlanError::Parse { file: file.to_owned(), fault }
        })?;
        if plan.relume_bake != env!("CARGO_PKG_VERSION") {
            return Err(PlanError::Version { file: file.to_owned(), made_by: plan.relume_bake });
        }
        let each = block_count(plan.size.into());
        if ![each, 3 * each].contains(&plan.tiles) {
            let fault = format!("tiles = {} is not what its size has", plan.tiles);
            return Err(PlanError::Parse { file: file.to_owned(), fault });
        }
        if plan.cuts.is_some() && plan.parsed_cuts().is_none() {
            let fault = "cuts = is not what plan --adaptive writes".to_owned();
            return Err(PlanError::Parse { file: file.to_owned(), fault });
        }
        let folder = file.parent().unwrap_or(Path::new(""));
        let from_folder = |path: &mut PathBuf| *path = folder.join(&*path);
        plan.camera.iter_mut().chain(&mut plan.test_skies).for_each(from_folder);
        // The built-in scene has no file.
        if plan.camera.is_some() {
            from_folder(&mut plan.scene);
        }
        Ok(plan)
    }

    fn parsed_cuts(&self) -> Option<Box<Subdivided>> {
        self.cuts.as_deref().and_then(cuts::of_text).map(Box::new)
    }

    /// The options of its bake.
    pub fn options(&self) -> BakeOptions {
        BakeOptions {
            size: self.size.into(),
            directions: self.directions,
            sphere: self.sphere,
            cuts: self.parsed_cuts(),
            transport: self.transport,
            error: self.error,
            site: self.site,
            test_maps: self.test_skies.clone(),
            ..BakeOptions::default()
        }
    }

    /// Checks that scene, camera and skies are still what the plan at `file` was made for.
    ///
    /// # Errors
    /// [`PlanError::Changed`], and [`BakeError::TestSky`].
    pub fn check(&self, file: &Path, scene: &Scene, camera: &Camera) -> Result<(), BakeError> {
        if identity(scene, camera, &self.options())? == self.identity {
            return Ok(());
        }
        Err(PlanError::Changed(file.to_owned()).into())
    }

    /// The plan as TOML.
    pub fn to_toml(&self) -> String {
        // A struct of numbers, texts and lists always serialises.
        toml::to_string(self).unwrap_or_default()
    }
}

/// `path` relative to `folder` where it lies in it, else absolute.
fn seen_from(folder: &Path, path: &Path) -> PathBuf {
    let (Ok(whole), Ok(folder)) = (path.canonicalize(), folder.canonicalize()) else { return path.to_owned() };
    whole.strip_prefix(folder).map(Path::to_owned).unwrap_or(whole)
}

/// Tells bakes apart: a checksum (CRC-32) of all that the bytes of their blocks depend on, the program's version among it.
///
/// # Errors
/// [`BakeError::TestSky`]: a test sky cannot be read.
pub fn identity(scene: &Scene, camera: &Camera, options: &BakeOptions) -> Result<u32, BakeError> {
    let mut sum = Checksum(crc32fast::Hasher::new());
    // Writing into a checksum cannot fail. Every field that a type gets later is in its debug form, too.
    let _ = write!(sum, "{} {camera:?}", env!("CARGO_PKG_VERSION"));
    let _ = write!(sum, "{:?} {} {} {:?}", options.size, options.directions, options.sphere, options.transport);
    let _ = write!(sum, "{} {:?}", options.error, options.site);
    options.cuts.iter().for_each(|cuts| sum.0.update(cuts.layer()));
    let _ = write!(sum, "{:?} {:?}", scene.triangles, scene.materials);
    let _ = write!(sum, "{:?} {:?} {:?}", scene.shading, scene.details, scene.roles);
    scene.normal_maps.iter().for_each(|map| map.checksum(&mut sum.0));
    scene.textures.iter().for_each(|texture| texture.checksum(&mut sum.0));
    for map in &options.test_maps {
        let bytes = std::fs::read(map).map_err(|source| BakeError::TestSky { file: map.clone(), source })?;
        sum.0.update(&bytes);
    }
    Ok(sum.0.finalize())
}

/// Takes in text.
struct Checksum(crc32fast::Hasher);

impl Write for Checksum {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}
