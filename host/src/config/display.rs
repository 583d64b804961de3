//! `[display]`: a screen, or pictures in a folder.

use super::reader::Reader;
use super::{ConfigError, KEYS};
use crate::display::config::{BufferKind, KmsConfig, ModeWish, Modesetting, PixelFormat, Rotation};
use std::path::{Path, PathBuf};

/// Where pictures go.
#[derive(Clone, Debug, PartialEq)]
pub enum DisplayConfig {
    /// PNG files.
    Headless {
        /// Their folder.
        folder: PathBuf,
        /// Every how many frames one is written.
        every: u64,
    },
    /// A screen; builds with the feature `board` have one.
    Kms(KmsConfig),
}

impl DisplayConfig {
    /// Where the state goes if the post's file names no place: with the pictures, else beside `file`.
    pub(super) fn health(&self, file: &Path) -> PathBuf {
        match self {
            DisplayConfig::Headless { folder, .. } => folder.join("health.json"),
            DisplayConfig::Kms(_) => file.with_file_name("health.json"),
        }
    }

    /// Seconds between frames if the post's file does not say: a screen shows what moves.
    pub(super) fn interval_s(&self) -> f64 {
        match self {
            DisplayConfig::Headless { .. } => 1.0,
            DisplayConfig::Kms(_) => 1.0 / 30.0,
        }
    }
}

const HEADLESS_KEYS: [&str; 2] = ["display.folder", "display.every"];

/// The word in `display.mode` for a display that is looked through.
const ADDITIVE: &str = "additive";

/// Does the display add its light to what is seen through it? Then black is clear, there is no view, and what it shows must be
/// as bright as the light is.
pub(super) fn is_additive(r: &Reader) -> Result<bool, ConfigError> {
    let mode = r.text("display.mode", 32)?.unwrap_or_default();
    if !mode.split_whitespace().any(|word| word == ADDITIVE) {
        return Ok(false);
    }
    if let Some(key) =
        ["view", "view_light", "mask", "view_camera.device", "view_camera.frames"].iter().find(|key| r.has(key))
    {
        return Err(r.fault(format!(
            "{key} is not used with display.mode = \"additive\": one looks through the display; remove it"
        )));
    }
    if r.choice("exposure.mode", &[("fixed", true), ("auto", false), ("view", false)])? != Some(true) {
        return Err(r.fault(
            "exposure.mode must be \"fixed\" with display.mode = \"additive\": the display has to be as bright as the light is; \
             exposure.ev = -log2 of the radiance of its white"
                .into(),
        ));
    }
    Ok(true)
}

/// Reads the table.
pub(super) fn display(r: &Reader) -> Result<DisplayConfig, ConfigError> {
    let kinds = [("headless", false), ("kms", true)];
    let is_kms = r.choice("display.kind", &kinds)?.ok_or_else(|| {
        r.fault("display.kind is missing: add [display] with kind = \"kms\" for a screen or \"headless\"".into())
    })?;
    let kind = if is_kms { "kms" } else { "headless" };
    // What is not for pictures in a folder is for screens.
    let is_foreign = |key: &str| HEADLESS_KEYS.contains(&key) == is_kms && key != "display.kind";
    let mut foreign = KEYS.iter().filter(|key| key.starts_with("display.") && is_foreign(key));
    let additive = is_additive(r)?;
    if let Some(key) = foreign.find(|key| r.has(key) && !(additive && **key == "display.mode")) {
        return Err(r.fault(format!("{key} is not used with display.kind = \"{kind}\"; remove it")));
    }
    if is_kms { kms(r).map(DisplayConfig::Kms) } else { headless(r) }
}

fn headless(r: &Reader) -> Result<DisplayConfig, ConfigError> {
    let folder = r.path("display.folder")?;
    let folder = folder.ok_or_else(|| r.fault("display.folder is missing: name the folder for the pictures".into()))?;
    Ok(DisplayConfig::Headless { folder, every: r.whole("display.every", 1..=1_000_000)?.unwrap_or(1) })
}

fn kms(r: &Reader) -> Result<KmsConfig, ConfigError> {
    let mode = r.text("display.mode", 32)?;
    // What is left is a mode of the screen.
    let mode = mode.map(|text| text.replace(ADDITIVE, "").trim().to_owned()).filter(|text| !text.is_empty());
    let not_a_mode = |text: String| {
        r.fault(format!(
            "display.mode = \"{text}\": must be such as \"1920x1080\" or \"1920x1080@60\"; `relume devices` lists them"
        ))
    };
    let mode = mode.map(|text| text.parse::<ModeWish>().map_err(|()| not_a_mode(text))).transpose()?;
    let degrees = r.whole("display.rotation_deg", 0..=270)?.unwrap_or(0);
    let rotation = Rotation::from_degrees(degrees)
        .ok_or_else(|| r.fault(format!("display.rotation_deg = {degrees}: must be 0, 90, 180 or 270")))?;
    let formats = [("xrgb8888", PixelFormat::Xrgb8888), ("xrgb2101010", PixelFormat::Xrgb2101010)];
    let buffers = [("auto", BufferKind::Auto), ("dumb", BufferKind::Dumb)];
    let ways = [("auto", Modesetting::Auto), ("legacy", Modesetting::Legacy)];
    Ok(KmsConfig {
        card: r.path("display.card")?,
        connector: r.text("display.connector", 64)?,
        mode,
        rotation,
        format: r.choice("display.format", &formats)?.unwrap_or_default(),
        buffers: r.choice("display.buffers", &buffers)?.unwrap_or_default(),
        modesetting: r.choice("display.modesetting", &ways)?.unwrap_or_default(),
    })
}
