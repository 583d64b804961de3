//! `relume sky merge`: an exposure series into linear radiance.

use super::SunOption;
use super::frames::read_all;
use crate::bracket::{MergeReport, MergeSettings, Merged, Merger, PixelState, SensorNoise};
use crate::capture::{Capture, CaptureSettings, Captured};
use crate::cli::args::{number, numbers, place, required};
use crate::colour::CameraColour;
use crate::failure::{Failure, OrFail};
use crate::lens::Lens;
use crate::map::RadianceMap;
use crate::outfile::check_writable;
use crate::picture::write_exr_measured;
use crate::probe::{Probe, Probed, Rebuilt};
use crate::response::Response;
use crate::skymodel::paint_disc;
use crate::split::SUN_RADIUS_DEG;
use crate::sun::dir_world;
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
    noise: Option<[f64; 2]>,
    lens: Option<PathBuf>,
    probe: Option<PathBuf>,
    sun: Option<SunOption>,
    north_deg: Option<f64>,
    colour: Option<PathBuf>,
    lat_long: bool,
    uncertainty: bool,
    out: Option<PathBuf>,
}

impl Options {
    fn north_deg(&self) -> f64 {
        self.north_deg.unwrap_or(0.0)
    }
}

pub(super) fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let folder = required(options.frames.as_ref(), "FRAMES_DIR")?;
    let out = required(options.out.as_ref(), "-o MAP.hdr or -o MAP.exr")?;
    let ending = out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    check(&options, out, ending.as_deref())?;
    check_writable(out)?;
    let lens = options.lens.as_ref().map(|path| Lens::load(path)).transpose().or_bad()?;
    let probe = options.probe.as_ref().map(|path| Probe::load(path)).transpose().or_bad()?;
    let colour = options.colour.as_ref().map(|path| CameraColour::load(path)).transpose().or_bad()?.unwrap_or_default();
    let (mut merged, mut sigma) = merge(folder, &options)?;
    if let (Some(lens), Some(path)) = (&lens, &options.lens) {
        check_size(lens, path, &merged)?;
    }
    if let (Some(lens), Some(probe), Some(sun)) = (&lens, probe, options.sun) {
        let towards = dir_world(sun.position(merged.captured_at_s)?, options.north_deg());
        let picture = &mut Probed { merged: &mut merged, sigma: sigma.as_deref_mut(), lens, colour: &colour };
        tell_sun(probe.rebuild(picture, towards).or_bad()?);
    }
    let (width, height) = (merged.width, merged.height);
    let clipped = merged.state.iter().map(|&state| state == PixelState::Clipped);
    match &lens {
        Some(lens) if options.lat_long => lat_long(&merged, lens, &colour, &options)?.save(out).or_runtime(),
        _ if ending.as_deref() == Some("exr") => {
            tell_clipped(clipped.clone().filter(|clipped| *clipped).count(), "the channel `clipped` tells where");
            Ok(write_exr_measured(out, (width, height), &merged.radiance, clipped, sigma.as_deref())?)
        }
        _ => {
            let way_out = "an .hdr cannot tell where: write an .exr, or give --probe, or the sun may be lost";
            tell_clipped(clipped.filter(|clipped| *clipped).count(), way_out);
            RadianceMap { width, height, pixels: merged.radiance }.save(out).or_runtime()
        }
    }
}

fn tell_clipped(pixels: usize, what: &str) {
    if pixels > 0 {
        eprintln!("{pixels} pixels are clipped in every frame, and at least as bright as written; {what}");
    }
}

fn check(options: &Options, out: &Path, ending: Option<&str>) -> Result<(), Failure> {
    let bad = |what: &str| Err(Failure::bad(format!("sky merge: {what}")));
    if !matches!(ending, Some("hdr" | "exr")) {
        return Err(Failure::bad(format!("{}: end the name in .hdr or .exr", out.display())));
    }
    if options.sun.is_some() && options.lens.is_none() {
        return bad("--sun and --site need --lens, which tells where in the picture that is");
    }
    if options.lat_long && options.lens.is_none() {
        return bad("--lat-long needs --lens");
    }
    if options.probe.is_some() && (options.lens.is_none() || options.sun.is_none()) {
        return bad("--probe needs --lens, and --sun or --site: they tell where the sun is in the picture");
    }
    if options.north_deg.is_some() && options.sun.is_none() {
        return bad("--north turns the sun's position into the world; it needs --sun or --site");
    }
    if options.colour.is_some() && options.probe.is_none() && !options.lat_long {
        return bad(
            "the picture keeps the camera's colours (`sky weights --colour` changes them); --colour needs --probe or --lat-long",
        );
    }
    if options.uncertainty && (ending != Some("exr") || options.lat_long) {
        return bad("--uncertainty adds channels to an .exr in the camera's frame; leave out --lat-long");
    }
    Ok(())
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("response") => o.response = Some(parser.value()?.into()),
            Long("sensor") => {
                o.noise = Some(numbers(parser, "--sensor", "electrons of a full well and of read noise")?)
            }
            Long("lens") => o.lens = Some(parser.value()?.into()),
            Long("sun") => o.sun = Some(SunOption::Position(numbers(parser, "--sun", "azimuth and altitude")?)),
            Long("site") => o.sun = Some(SunOption::Site(numbers(parser, "--site", "latitude and longitude")?)),
            Long("north") => o.north_deg = Some(number(parser, "--north", -360.0..=360.0)?),
            Long("colour") => o.colour = Some(parser.value()?.into()),
            Long("probe") => o.probe = Some(parser.value()?.into()),
            Long("lat-long") => o.lat_long = true,
            Long("uncertainty") => o.uncertainty = true,
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Value(value) => place(value, &mut [&mut o.frames])?,
            other => return Err(other.unexpected().into()),
        }
    }
    if let Some([full_well, read]) = o.noise
        && !(full_well >= 1.0 && read >= 0.0)
    {
        return Err(Failure::bad("--sensor: electrons of a full well (1 or more) and of read noise (0 or more)"));
    }
    Ok(o)
}

/// # Errors
/// A lens that was measured at another size than the frames'.
fn check_size(lens: &Lens, path: &Path, merged: &Merged) -> Result<(), Failure> {
    match lens.size().filter(|&size| size != (merged.width, merged.height)) {
        None => Ok(()),
        Some((width, height)) => Err(Failure::bad(format!(
            "{}: the lens is for {width}x{height} pixels, the frames have {}x{}; name the lens of these frames",
            path.display(),
            merged.width,
            merged.height
        ))),
    }
}

/// One standard deviation per pixel and channel.
type Sigma = Vec<[f32; 3]>;

fn merge(folder: &Path, options: &Options) -> Result<(Merged, Option<Sigma>), Failure> {
    let response = options.response.as_ref().map(|path| Response::load(path));
    let response = response.transpose().or_bad()?.unwrap_or_default();
    let noise = options
        .noise
        .map(|[full_well_electrons, read_noise_electrons]| SensorNoise { full_well_electrons, read_noise_electrons });
    let frames = read_all(folder)?;
    let mut merger = Merger::new(MergeSettings { response, noise, ..MergeSettings::default() });
    let mut merged = Merged::default();
    let told = |error| Failure::bad(format!("{}: {error}", folder.display()));
    merger.merge(&frames, &mut merged).map_err(told)?;
    tell(merger.report());
    let sigma = options.uncertainty.then(|| merger.uncertainty(&frames, &merged));
    Ok((merged, sigma))
}

/// Drift of neighbouring exposures that is worth a word, natural log.
const DRIFT: f64 = 0.08;

fn tell(report: &MergeReport) {
    let noise = report.noise;
    eprintln!(
        "sensor: {:.0} electrons of a full well, read noise {:.1}; {} pixels had samples left out",
        noise.full_well_electrons, noise.read_noise_electrons, report.ghost_pixels
    );
    for (frame, factor) in report.exposure_factors.iter().enumerate().filter(|(_, factor)| **factor != 1.0) {
        eprintln!(
            "frame {frame}: its exposure was taken as {factor:.3} times what frames.json says, to fit the others"
        );
    }
    if report.drift.abs() > DRIFT || report.inconsistent {
        let percent = 100.0 * report.drift.exp_m1();
        eprintln!(
            "the frames disagree ({percent:+.0} % from one exposure to the next): response curve or time_s is wrong"
        );
    }
}

fn tell_sun(sun: Rebuilt) {
    match sun {
        Rebuilt::Disc([r, g, b]) => {
            eprintln!("sun: clipped; rebuilt from the probe with irradiance {r:.4e} {g:.4e} {b:.4e}")
        }
        Rebuilt::NotClipped => eprintln!("sun: not clipped; kept as measured"),
        Rebuilt::NotSeen => eprintln!("sun: below the horizon or outside the picture"),
        Rebuilt::NothingLeft => eprintln!("sun: the probe shows no more than the sky; no disc"),
    }
}

/// The camera's picture as a lat-long map in the world. What the lens does not show takes its patch's mean.
fn lat_long(merged: &Merged, lens: &Lens, colour: &CameraColour, options: &Options) -> Result<RadianceMap, Failure> {
    let set = PatchSet::new(FILL_PATCHES).or_bad()?;
    let size = (merged.width, merged.height);
    let settings = CaptureSettings { north_deg: options.north_deg(), ..CaptureSettings::default() };
    let mut capture = Capture::new(lens, size, set, settings, None).or_bad()?;
    capture.set_colour(colour);
    let position = options.sun.map(|sun| sun.position(merged.captured_at_s)).transpose()?;
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
