//! `relume sky weights`: a radiance map into weights for a field's patches.

use super::SunOption;
use crate::bracket::{Merged, PixelState};
use crate::capture::{Capture, CaptureSettings};
use crate::cli::args::{number, numbers, place, required};
use crate::colour::CameraColour;
use crate::failure::{Failure, OrFail};
use crate::lens::Lens;
use crate::map::{RadianceMap, luminance};
use crate::outfile::check_writable;
use crate::picture::CLIPPED_CHANNEL;
use crate::relight::FieldFile;
use crate::sky_source::SunSource;
use crate::weights::PatchWeights;
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Weights and map may differ by this much in horizontal irradiance: each patch counts at one height.
const IRRADIANCE_OFF: f64 = 0.02;

#[derive(Default)]
struct Options {
    map: Option<PathBuf>,
    field: Option<PathBuf>,
    lens: Option<PathBuf>,
    sun: Option<[f64; 2]>,
    colour: Option<PathBuf>,
    env_rot_deg: Option<f64>,
    out: Option<PathBuf>,
    json: bool,
}

pub(super) fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let map = required(options.map.as_ref(), "MAP")?;
    let out = required(options.out.as_ref(), "-o W.csv")?;
    if options.lens.is_some() && options.env_rot_deg.is_some() {
        return Err(Failure::bad("sky weights: the lens file already holds the orientation; leave out --env-rot"));
    }
    if options.lens.is_none() && options.colour.is_some() {
        return Err(Failure::bad("sky weights: a lat-long map is Rec.709 already; --colour needs --lens"));
    }
    if options.lens.is_none() && options.sun.is_some() {
        return Err(Failure::bad("sky weights: the sun of a lat-long map is found in it; --sun needs --lens"));
    }
    check_writable(out)?;
    let file = FieldFile::open(required(options.field.as_ref(), "--field FIELD")?).or_bad()?;
    let field = file.field();
    let (weights, report) = match &options.lens {
        Some(lens) => from_picture(map, &Lens::load(lens).or_bad()?, &options, &field)?,
        None => from_map(&RadianceMap::load(map).or_bad()?, options.env_rot_deg.unwrap_or(0.0), field.patch_set())?,
    };
    weights.save(field.patch_set(), out).or_runtime()?;
    if report.irradiance_off.abs() > IRRADIANCE_OFF {
        eprintln!(
            "{}: the weights' horizontal irradiance is {:+.1} % off the map's own; more directions follow it closer",
            map.display(),
            100.0 * report.irradiance_off
        );
    }
    if !report.filled.is_empty() {
        eprintln!("{} patches, or parts of them, were not seen and are filled from a smooth sky", report.filled.len());
    }
    if options.json { crate::cli::say_json(&report) } else { Ok(()) }
}

/// What the weights rest on.
#[derive(Serialize)]
struct Report {
    patches: usize,
    /// Patches of which more than a hundredth was not seen, and how much of them.
    filled: Vec<Filled>,
    /// How the sun is known.
    sun: SunSource,
    /// Share of the clear-sky beam that comes through, where it is looked for.
    sun_share: Option<f64>,
    /// Horizontal irradiance, R, G, B: that of the weights over that of the map, minus 1 (luminance).
    irradiance_off: f64,
}

#[derive(Serialize)]
struct Filled {
    patch: usize,
    share: f32,
}

fn from_map(map: &RadianceMap, env_rot_deg: f64, set: &PatchSet) -> Result<(PatchWeights, Report), Failure> {
    let weights = crate::split::weights(map, set, env_rot_deg).or_bad()?;
    let light = |rgb: [f64; 3]| f64::from(luminance(rgb.map(|v| v as f32)));
    let (truth, found) = (light(map.horizontal_irradiance()), light(weights.horizontal_irradiance(set)));
    let report = Report {
        patches: set.len(),
        filled: Vec::new(),
        sun: if weights.sun.is_some() { SunSource::Measured } else { SunSource::None },
        sun_share: None,
        irradiance_off: if truth > 0.0 { found / truth - 1.0 } else { 0.0 },
    };
    Ok((weights, report))
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("field") => o.field = Some(parser.value()?.into()),
            Long("lens") => o.lens = Some(parser.value()?.into()),
            Long("sun") => o.sun = Some(numbers(parser, "--sun", "azimuth and altitude")?),
            Long("colour") => o.colour = Some(parser.value()?.into()),
            Long("env-rot") => o.env_rot_deg = Some(number(parser, "--env-rot", -360.0..=360.0)?),
            Long("json") => o.json = true,
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Value(value) => place(value, &mut [&mut o.map])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(o)
}

fn from_picture(
    path: &Path,
    lens: &Lens,
    options: &Options,
    field: &Field<'_>,
) -> Result<(PatchWeights, Report), Failure> {
    let merged = read_picture(path)?;
    let north_deg = f64::from(field.camera().north_deg);
    let settings = CaptureSettings { north_deg, ..CaptureSettings::default() };
    let size = (merged.width, merged.height);
    let mut capture = Capture::new(lens, size, *field.patch_set(), settings, None).or_bad()?;
    if let Some(path) = &options.colour {
        capture.set_colour(&CameraColour::load(path).or_bad()?);
    }
    let position = options.sun.map(|sun| SunOption::Position(sun).position(0.0)).transpose()?;
    let captured = capture.weights(&merged, position).or_bad()?;
    let shares = captured.filled_share.iter().enumerate().filter(|(_, share)| **share > 0.0);
    let report = Report {
        patches: field.patch_set().len(),
        filled: shares.map(|(patch, &share)| Filled { patch, share }).collect(),
        sun: captured.sun_source.into(),
        sun_share: captured.beam_share,
        irradiance_off: captured.irradiance_off(field.patch_set()),
    };
    Ok((captured.weights, report))
}

/// A camera's linear picture, .hdr or .exr, of any shape.
fn read_picture(path: &Path) -> Result<Merged, Failure> {
    let told = |what: &str| Failure::bad(format!("{}: {what}", path.display()));
    let is_exr = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("exr"));
    let Measured { width, height, radiance, state } =
        if is_exr { read_exr(path) } else { read_hdr(path) }.map_err(|e| told(&e))?;
    if radiance.iter().flatten().any(|v| !v.is_finite() || *v < 0.0) {
        return Err(told("a pixel is negative or not finite; radiance must be neither"));
    }
    Ok(Merged { width, height, radiance, state, captured_at_s: 0.0 })
}

/// Pixels of a picture and what they are worth.
struct Measured {
    width: usize,
    height: usize,
    radiance: Vec<[f32; 3]>,
    state: Vec<PixelState>,
}

/// With the channel `clipped` of `relume sky merge`; without it every pixel counts as measured.
fn read_exr(path: &Path) -> Result<Measured, String> {
    use exr::prelude::*;
    let blank = |size: Vec2<usize>, _: &_| Measured {
        width: size.width(),
        height: size.height(),
        radiance: vec![[0.0; 3]; size.area()],
        state: vec![PixelState::Valid; size.area()],
    };
    let set = |picture: &mut Measured, at: Vec2<usize>, (r, g, b, clipped): (f32, f32, f32, f32)| {
        let index = at.y() * picture.width + at.x();
        picture.radiance[index] = [r, g, b];
        picture.state[index] = if clipped > 0.5 { PixelState::Clipped } else { PixelState::Valid };
    };
    let channels = read().no_deep_data().largest_resolution_level().specific_channels();
    let channels = channels.required("R").required("G").required("B").optional(CLIPPED_CHANNEL, 0.0f32);
    let image = channels.collect_pixels(blank, set).first_valid_layer().all_attributes().from_file(path);
    Ok(image.map_err(|e| e.to_string())?.layer_data.channel_data.pixels)
}

fn read_hdr(path: &Path) -> Result<Measured, String> {
    let picture = image::ImageReader::open(path).map_err(|e| e.to_string())?;
    let picture = picture.with_guessed_format().map_err(|e| e.to_string())?.decode().map_err(|e| e.to_string())?;
    if !matches!(picture.color(), image::ColorType::Rgb32F) {
        return Err("is no Radiance picture (.hdr); give what `relume sky merge` wrote".into());
    }
    let picture = picture.into_rgb32f();
    let radiance: Vec<[f32; 3]> = picture.pixels().map(|p| p.0).collect();
    let state = vec![PixelState::Valid; radiance.len()];
    Ok(Measured { width: picture.width() as usize, height: picture.height() as usize, radiance, state })
}
