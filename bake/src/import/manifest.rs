//! A folder of pictures with `manifest.toml`: a stack as `relume-bake scene --stack` writes it, or anybody's.
//!
//! ```toml
//! encoding = "linear"            # or "srgb"; left out: 8-bit pictures are sRGB, all others linear
//! coverage = "mask.png"          # left out: coverage.exr if it is there, else the pictures' alpha, else everything
//! horizon = [0, 1, 0]            # light comes from before the plane with this normal, or "none": from all around
//! [[patch]]
//! file = "light 01.exr"
//! direction = [0.0, 0.6, 0.8]    # towards the light, world space
//! solid_angle_sr = 0.05          # left out: the part of the sphere that is nearest to this light
//! intensity = 3.14               # irradiance on a plane that faces the light, one number or R, G, B; left out: the
//!                                # light is the patch itself, at radiance 1
//! ```

use super::fault::ImportError;
use super::picture::Encoding;
use super::source::{LightPicture, Side, Source, unit};
use crate::stack::{Horizon, MANIFEST_VERSION};
use relume_firmware::glue::cuts;
use relume_firmware::patches::PatchSet;
use serde::Deserialize;
use std::path::Path;

/// Its name in the folder.
pub(super) const NAME: &str = "manifest.toml";

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    version: Option<u32>,
    encoding: Option<Encoding>,
    coverage: Option<String>,
    horizon: Option<Horizon>,
    #[serde(rename = "patch", alias = "image")]
    patches: Vec<Entry>,
    // What the bake's own stacks say beside.
    #[serde(default)]
    #[serde(rename = "patch_set")]
    _patch_set: Option<String>,
    patch_set_id: Option<u32>,
    n_upper: Option<usize>,
    cuts: Option<String>,
    #[serde(rename = "width")]
    _width: Option<u32>,
    #[serde(rename = "height")]
    _height: Option<u32>,
    #[serde(default)]
    max_hits: u32,
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    north_deg: f64,
    #[serde(rename = "sun")]
    _sun: Option<toml::Value>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    file: String,
    direction: [f64; 3],
    #[serde(alias = "solid_angle")]
    solid_angle_sr: Option<f64>,
    intensity: Option<Intensity>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
enum Intensity {
    Grey(f64),
    Rgb([f64; 3]),
}

pub(super) fn open(file: &Path) -> Result<Source, ImportError> {
    let text = std::fs::read_to_string(file).map_err(|error| ImportError::file(file, error))?;
    let manifest: Manifest = toml::from_str(&text).map_err(|error| ImportError::file(file, error))?;
    if let Some(version) = manifest.version.filter(|&version| version != MANIFEST_VERSION) {
        let fault = format!("version = {version}, this program reads {MANIFEST_VERSION}");
        return Err(ImportError::file(file, fault));
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    let side = side_of(manifest.horizon.as_ref()).map_err(|fault| ImportError::file(file, fault))?;
    let mut source = Source::new(file, "stack", side);
    for (number, entry) in manifest.patches.iter().enumerate() {
        let told = |fault| ImportError::file(file, format!("[[patch]] {} ({}): {fault}", number + 1, entry.file));
        source.pictures.push(picture(folder, entry).map_err(told)?);
    }
    let own_coverage = folder.join("coverage.exr");
    source.mask = match &manifest.coverage {
        Some(name) => Some(folder.join(name)),
        None => Some(own_coverage).filter(|file| file.exists()),
    };
    source.encoding = manifest.encoding;
    source.north_deg = manifest.north_deg;
    source.made_by = (manifest.max_hits, manifest.seed);
    source.known = known_set(&manifest);
    source.check_files()
}

fn side_of(horizon: Option<&Horizon>) -> Result<Side, String> {
    match horizon {
        None => Ok(Side::FirstOf([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])),
        Some(Horizon::Towards(axis)) => Ok(Side::Before(unit(*axis).map_err(|fault| format!("horizon: {fault}"))?)),
        Some(Horizon::Word(word)) if word == "none" => Ok(Side::Around),
        Some(Horizon::Word(word)) => Err(format!("horizon = {word:?}: write [x, y, z] or \"none\"")),
    }
}

fn picture(folder: &Path, entry: &Entry) -> Result<LightPicture, String> {
    let positive = |value: f64| value.is_finite() && value > 0.0;
    if let Some(omega) = entry.solid_angle_sr.filter(|&omega| !(positive(omega) && omega <= 4.0 * std::f64::consts::PI))
    {
        return Err(format!("solid_angle_sr = {omega}: must be above 0 and at most 4 pi"));
    }
    let irradiance = entry.intensity.map(|intensity| match intensity {
        Intensity::Grey(value) => [value; 3],
        Intensity::Rgb(rgb) => rgb,
    });
    if let Some(rgb) = irradiance.filter(|rgb| !rgb.iter().all(|&value| positive(value))) {
        return Err(format!("intensity = {rgb:?}: must be finite and above 0"));
    }
    let file = folder.join(&entry.file);
    Ok(LightPicture { file, dir_world: unit(entry.direction)?, solid_angle_sr: entry.solid_angle_sr, irradiance })
}

/// The set of the bake that the manifest says it has, if all entries are that set's.
fn known_set(manifest: &Manifest) -> Option<PatchSet> {
    let upper = manifest.n_upper?;
    let set = match &manifest.cuts {
        Some(text) => PatchSet::of_subdivided(cuts::of_text(text)?),
        None => PatchSet::of_counts(upper, manifest.patches.len().checked_sub(upper)?).ok()?,
    };
    let same = |(patch, entry): (usize, &Entry)| {
        let dir = set.dir_world(patch);
        let off = entry.direction.iter().zip(dir).map(|(a, b)| (a - f64::from(b)).abs()).fold(0.0, f64::max);
        let omega = f64::from(set.solid_angle_sr(patch));
        let same_size = entry.solid_angle_sr.is_some_and(|own| (own - omega).abs() < 1e-4 * omega);
        off < 1e-4 && same_size && entry.intensity.is_none()
    };
    let all = manifest.patches.len() == set.len() && manifest.patches.iter().enumerate().all(same);
    (all && manifest.patch_set_id == Some(set.id())).then_some(set)
}
