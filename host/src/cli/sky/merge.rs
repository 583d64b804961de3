//! `relume sky merge`: an exposure series into linear radiance.

use super::SunOption;
use crate::bracket::{MergeSettings, Merged, Merger};
use crate::camera::Frame;
use crate::camera::replay::{read_frame, read_list};
use crate::capture::{Capture, CaptureSettings, Captured};
use crate::cli::args::{numbers, place, required};
use crate::failure::{Failure, OrFail};
use crate::lens::Lens;
use crate::map::RadianceMap;
use crate::outfile::check_writable;
use crate::response::Response;
use crate::skymodel::paint_disc;
use crate::split::SUN_RADIUS_DEG;
use relume_firmware::patches::PatchSet;
use std::path::{Path, PathBuf};

/// Rows of the lat-long map: 0.35 degrees each.
const MAP_HEIGHT: usize = 512;
/// Patches for what the lens does not show.
const FILL_PATCHES: usize = 256;

#[derive(Default)]
struct Options {
    frames: Option<PathBuf>,
    response: Option<PathBuf>,
    lens: Option<PathBuf>,
    sun: Option<SunOption>,
    out: Option<PathBuf>,
}

pub(super) fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let folder = required(options.frames.as_ref(), "FRAMES_DIR")?;
    let out = required(options.out.as_ref(), "-o MAP.hdr or -o MAP.exr")?;
    let ending = out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if !matches!(ending.as_deref(), Some("hdr" | "exr")) {
        return Err(Failure::bad(format!("{}: end the name in .hdr or .exr", out.display())));
    }
    if options.sun.is_some() && options.lens.is_none() {
        return Err(Failure::bad("sky merge: --sun and --site need --lens, which tells where in the picture that is"));
    }
    check_writable(out)?;
    let merged = merge(folder, options.response.as_deref())?;
    let map = match &options.lens {
        Some(path) => lat_long(&merged, &Lens::load(path).or_bad()?, options.sun)?,
        None => RadianceMap { width: merged.width, height: merged.height, pixels: merged.radiance },
    };
    map.save(out).or_runtime()
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("response") => o.response = Some(parser.value()?.into()),
            Long("lens") => o.lens = Some(parser.value()?.into()),
            Long("sun") => o.sun = Some(SunOption::Position(numbers(parser, "--sun", "azimuth and altitude")?)),
            Long("site") => o.sun = Some(SunOption::Site(numbers(parser, "--site", "latitude and longitude")?)),
            Long("probe") => return Err(Failure::bad("sky merge: --probe comes with a later version")),
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Value(value) => place(value, &mut [&mut o.frames])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(o)
}

fn merge(folder: &Path, response: Option<&Path>) -> Result<Merged, Failure> {
    let response = response.map(Response::load).transpose().or_bad()?.unwrap_or_default();
    let mut frames = Vec::new();
    for (index, recorded) in read_list(folder).or_bad()?.iter().enumerate() {
        let mut frame = Frame::default();
        read_frame(recorded, index as u64, &mut frame).or_bad()?;
        frames.push(frame);
    }
    let mut merged = Merged::default();
    let told = |error| Failure::bad(format!("{}: {error}", folder.display()));
    Merger::new(MergeSettings { response, ..MergeSettings::default() }).merge(&frames, &mut merged).map_err(told)?;
    Ok(merged)
}

/// The camera's picture as a lat-long map in the world. What the lens does not show takes its patch's mean.
fn lat_long(merged: &Merged, lens: &Lens, sun: Option<SunOption>) -> Result<RadianceMap, Failure> {
    let set = PatchSet::new(FILL_PATCHES).or_bad()?;
    let size = (merged.width, merged.height);
    let mut capture = Capture::new(lens, size, set, CaptureSettings::default(), None).or_bad()?;
    let position = sun.map(|sun| sun.position(merged.captured_at_s)).transpose()?;
    let Captured { weights, .. } = capture.weights(merged, position).or_bad()?;
    let near_sun = SUN_RADIUS_DEG.to_radians().cos() as f32;
    let mut map = RadianceMap::from_fn(MAP_HEIGHT, |dir| {
        let patch = weights.radiance[set.patch_of(dir)];
        let is_sun = weights.sun.is_some_and(|sun| (0..3).map(|k| sun.dir_world[k] * dir[k]).sum::<f32>() > near_sun);
        if dir[1] < 0.0 || is_sun { patch } else { capture.radiance_towards(lens, dir).unwrap_or(patch) }
    });
    if let Some(sun) = &weights.sun {
        paint_disc(&mut map, sun);
    }
    Ok(map)
}
