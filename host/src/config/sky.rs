//! `sky` and `[camera]`: where the light comes from, and what that needs.

use super::reader::Reader;
use super::{ConfigError, Site};
use std::path::PathBuf;

/// Where the light comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkyKind {
    /// Time and place through a clear-sky model; no camera.
    Simulated,
    /// A simulated camera under a simulated sky, exposing real series.
    Synthetic,
    /// A folder of frames that were captured before.
    Replay,
    /// The light that a post logged before.
    Logged,
    /// A real camera.
    Camera,
}

impl SkyKind {
    const NAMES: [(&'static str, SkyKind); 5] = [
        ("simulated", SkyKind::Simulated),
        ("synthetic", SkyKind::Synthetic),
        ("replay", SkyKind::Replay),
        ("logged", SkyKind::Logged),
        ("camera", SkyKind::Camera),
    ];

    /// The name in `POST.toml`.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Does its light depend on the place?
    fn needs_place(self) -> bool {
        matches!(self, SkyKind::Simulated | SkyKind::Synthetic | SkyKind::Camera)
    }
}

/// The sky camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraConfig {
    /// Folder of frames to replay, with its `frames.json`.
    pub frames: Option<PathBuf>,
    /// Lens file; a simulated camera has one of its own.
    pub lens: Option<PathBuf>,
    /// Response curve file; linear if none, a simulated camera knows its own.
    pub response: Option<PathBuf>,
    /// Colour file; the camera's colours count as Rec.709 if none.
    pub colour: Option<PathBuf>,
    /// What one unit of the merged radiance is multiplied by.
    pub radiance_scale: f64,
    /// The log whose light is shown once more.
    pub light_log: Option<PathBuf>,
    /// A real camera's node, or how its name begins.
    pub device: Option<String>,
    /// The node that has a real camera's controls, where it is another: a raw sensor's sub-device.
    pub controls: Option<String>,
    /// Width and height that a real camera is asked for.
    pub size: Option<(usize, usize)>,
    /// Pixel format (fourcc) that a real camera is asked for.
    pub pixel_format: Option<String>,
    /// Colour temperature that counts as white, kelvin.
    pub white_balance_k: u32,
    /// Gain at the largest value of a real camera's gain control; none if the control is to be left alone.
    pub max_gain: Option<f64>,
}

impl CameraConfig {
    /// How the camera's colours are known, in words.
    pub fn colour_state(&self, sky: SkyKind) -> &'static str {
        match (sky, &self.colour) {
            (SkyKind::Simulated | SkyKind::Logged, _) => "none",
            (_, Some(_)) => "calibrated",
            (_, None) => "taken for Rec.709",
        }
    }
}

/// The white of Rec.709 (D65), kelvin.
const WHITE_K: u64 = 6500;
/// Keys that belong to one sky only.
const KEYS_OF: [(&str, SkyKind); 8] = [
    ("camera.frames", SkyKind::Replay),
    ("camera.light_log", SkyKind::Logged),
    ("camera.device", SkyKind::Camera),
    ("camera.controls", SkyKind::Camera),
    ("camera.size", SkyKind::Camera),
    ("camera.pixel_format", SkyKind::Camera),
    ("camera.white_balance_k", SkyKind::Camera),
    ("camera.max_gain", SkyKind::Camera),
];
/// A sky, a key that it cannot do without, and what to write.
pub(super) type Needed = (SkyKind, &'static str, &'static str);
pub(super) const LENS: &str = "camera.lens";
pub(super) const NEEDED: &[Needed] = &[
    (SkyKind::Replay, "camera.frames", "name the folder that holds frames.json"),
    (SkyKind::Replay, LENS, "name the file of the lens that took the frames"),
    (SkyKind::Logged, "camera.light_log", "name the file that run.light_log wrote"),
    (SkyKind::Camera, "camera.device", "name the camera's node; `relume devices` lists them"),
    (SkyKind::Camera, LENS, "name the file of the camera's lens"),
];

/// Reads `sky` and `[camera]`, of which the keys of `needed` must be there.
pub(super) fn sky(r: &Reader, site: Option<Site>, needed: &[Needed]) -> Result<(SkyKind, CameraConfig), ConfigError> {
    let names: Vec<String> = SkyKind::NAMES.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    let missing = || r.fault(format!("sky is missing: write sky = one of {}", names.join(", ")));
    let sky = r.choice("sky", &SkyKind::NAMES)?.ok_or_else(missing)?;
    let camera = CameraConfig {
        frames: r.path("camera.frames")?,
        lens: r.path("camera.lens")?,
        response: r.path("camera.response")?,
        colour: r.path("camera.colour")?,
        radiance_scale: r.number("camera.radiance_scale", 1e-6..=1e6)?.unwrap_or(1.0),
        light_log: r.path("camera.light_log")?,
        device: r.text("camera.device", 200)?,
        controls: r.text("camera.controls", 200)?,
        size: r.size("camera.size")?,
        pixel_format: r.text("camera.pixel_format", 4)?,
        white_balance_k: r.whole("camera.white_balance_k", 1000..=20_000)?.unwrap_or(WHITE_K) as u32,
        max_gain: r.number("camera.max_gain", 1.0..=1000.0)?,
    };
    check(r, sky, site, needed).map(|()| (sky, camera))
}

fn check(r: &Reader, sky: SkyKind, site: Option<Site>, needed: &[Needed]) -> Result<(), ConfigError> {
    let name = sky.name();
    if sky.needs_place() && site.is_none() {
        return Err(
            r.fault(format!("sky = \"{name}\" needs the place: add [site] with latitude and longitude in degrees"))
        );
    }
    if sky == SkyKind::Simulated && r.has("camera") {
        return Err(r.fault("sky = \"simulated\" has no camera; remove the table [camera]".into()));
    }
    if let Some((key, of)) = KEYS_OF.iter().find(|(key, of)| *of != sky && r.has(key)) {
        let of = of.name();
        return Err(
            r.fault(format!("{key} is only used with sky = \"{of}\", not with sky = \"{name}\"; remove one of them"))
        );
    }
    match needed.iter().find(|(of, key, _)| *of == sky && !r.has(key)) {
        Some((_, key, what)) => Err(r.fault(format!("{key} is missing: sky = \"{name}\" needs it; {what}"))),
        None => Ok(()),
    }
}
