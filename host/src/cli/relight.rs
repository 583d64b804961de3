//! `relume relight`: one picture of a field under one sky.

use super::args::{Command, number, numbers, place, required};
use crate::damage::Damage;
use crate::exact::Stack;
use crate::exposure::{EV_RANGE, automatic};
use crate::failure::{Failure, OrFail};
use crate::map::RadianceMap;
use crate::outfile::check_writable;
use crate::painter::Painter;
use crate::painter::field::FieldPainter;
use crate::picture::{PictureFormat, composite, write_exr, write_png};
use crate::relight::{FieldFile, Picture, Relighter};
use crate::sun::position_of;
use crate::view::Still;
use crate::view::curve::ViewCurve;
use crate::view::mask::Mask;
use crate::weights::{PatchWeights, SunWeight};
use relume_firmware::field::Field;
use relume_firmware::patches::spread;
use serde::Serialize;
use std::path::{Path, PathBuf};

pub(super) const COMMAND: Command = Command {
    name: "relight",
    help: "\
relume relight FIELD (--sky MAP | --weights W.csv | --light X,Y,Z) -o OUT.exr|OUT.png
       [--env-rot DEG] [--view STILL [--view-light MAP|W.csv] [--view-response CURVE.csv] [--mask MASK]] [--exposure EV] [--exact STACK_DIR] [--json]

  --sky MAP          lat-long radiance map (.hdr, .exr); its sun becomes a light of its own
  --env-rot DEG      turns the map about +Y; positive turns +Z towards +X
  --weights W.csv    radiance per patch in the field's order, the sun's irradiance last
  --light X,Y,Z      nothing but a sun in this direction (towards the light), irradiance 1 in R, G and B. An imported field
                     shows the pictures of up to three lights around it, in shares that keep a matt surface exact
  --view STILL       PNG only: the picture behind, PNG or JPEG of the field's size; black if left out
                     Receivers in it (scenes with `relume = receiver`) take the shadow of what is shown
  --view-light LIGHT the light that the still was taken in, as --sky or --weights take it: the still is relit, too, by what
                     it shows of receivers; everything else of it follows the brightness
  --view-response C  the curve of the still's camera, as `relume sky response` writes it; its codes are sRGB if left out
  --mask MASK        a grey picture of the field's size: the view is in front where it is white
  --exposure EV      PNG only: radiance x 2^EV is display white at 1.
                     Left out: 0.8 / the 99th percentile of the covered channel values of this picture
  --exact STACK_DIR  sums the uncompressed stack in f64 instead of the field
  -o OUT             .exr: linear radiance, 32-bit float, premultiplied by alpha = coverage
                     .png: 8-bit sRGB over the view
  --json             size, sun and exposure as one JSON object on standard output
",
    act,
};

enum Light {
    Map(PathBuf),
    Weights(PathBuf),
    Direction([f64; 3]),
}

#[derive(Default)]
struct Options {
    field: Option<PathBuf>,
    light: Option<Light>,
    env_rot_deg: Option<f64>,
    view: Option<PathBuf>,
    view_light: Option<PathBuf>,
    view_response: Option<PathBuf>,
    mask: Option<PathBuf>,
    exposure_ev: Option<f64>,
    exact: Option<PathBuf>,
    out: Option<PathBuf>,
    json: bool,
}

/// What `--json` tells.
#[derive(Serialize)]
struct Told {
    out: String,
    width: usize,
    height: usize,
    sun: Option<ToldSun>,
    exposure: Option<f64>,
    exposure_ev: Option<f64>,
    note: Option<String>,
}

#[derive(Serialize)]
struct ToldSun {
    dir_world: [f32; 3],
    azimuth_deg: f64,
    altitude_deg: f64,
    irradiance: [f32; 3],
}

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let out = required(options.out.as_ref(), "-o OUT.exr or -o OUT.png")?;
    let format = PictureFormat::of(out)?;
    options.check_use(format)?;
    check_writable(out)?;
    let file = FieldFile::open(required(options.field.as_ref(), "FIELD")?).or_bad()?;
    let field = file.field();
    let mut weights = options.weights(&field)?;
    refuse_foreign_sun(&field, &weights)?;
    if !field.answers_sun() {
        take_sun_in(&field, &mut weights)?;
    }
    let told = match format {
        PictureFormat::Exr => write_radiance(&options, field, &weights)?,
        PictureFormat::Png => write_shown(&options, &file, &weights)?,
    };
    tell(&options, &field, &weights, told)
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("sky") => o.set_light(Light::Map(parser.value()?.into()))?,
            Long("weights") => o.set_light(Light::Weights(parser.value()?.into()))?,
            Long("light") => o.set_light(Light::Direction(numbers(parser, "--light", "the direction x,y,z")?))?,
            Long("env-rot") => o.env_rot_deg = Some(number(parser, "--env-rot", -360.0..=360.0)?),
            Long("view") => o.view = Some(parser.value()?.into()),
            Long("view-light") => o.view_light = Some(parser.value()?.into()),
            Long("view-response") => o.view_response = Some(parser.value()?.into()),
            Long("mask") => o.mask = Some(parser.value()?.into()),
            Long("exposure") => o.exposure_ev = Some(number(parser, "--exposure", EV_RANGE)?),
            Long("exact") => o.exact = Some(parser.value()?.into()),
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Long("json") => o.json = true,
            Value(value) => place(value, &mut [&mut o.field])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(o)
}

impl Options {
    fn set_light(&mut self, light: Light) -> Result<(), Failure> {
        match self.light.replace(light) {
            None => Ok(()),
            Some(_) => Err(Failure::bad("give one of --sky, --weights and --light, and only once")),
        }
    }

    /// Options that would silently do nothing are refused.
    fn check_use(&self, format: PictureFormat) -> Result<(), Failure> {
        let light = required(self.light.as_ref(), "the light: --sky MAP, --weights W.csv or --light X,Y,Z")?;
        if self.env_rot_deg.is_some() && !matches!(light, Light::Map(_)) {
            return Err(Failure::bad("--env-rot turns a map; it needs --sky"));
        }
        let about_view = [&self.view_light, &self.view_response, &self.mask];
        if self.view.is_none() && about_view.iter().any(|option| option.is_some()) {
            return Err(Failure::bad(
                "--view-light, --view-response and --mask are about the view; they need --view STILL",
            ));
        }
        if self.exact.is_some() && (self.view_light.is_some() || self.mask.is_some()) {
            return Err(Failure::bad("--exact knows neither receivers nor masks; leave --view-light and --mask out"));
        }
        if format == PictureFormat::Exr && (self.view.is_some() || self.exposure_ev.is_some()) {
            return Err(Failure::bad("an EXR holds linear radiance; --view and --exposure need -o OUT.png"));
        }
        Ok(())
    }

    fn weights(&self, field: &Field<'_>) -> Result<PatchWeights, Failure> {
        let patches = field.patch_set();
        match required(self.light.as_ref(), "the light")? {
            Light::Map(path) => {
                let map = RadianceMap::load(path).or_bad()?;
                crate::split::weights(&map, patches, self.env_rot_deg.unwrap_or(0.0)).or_bad()
            }
            Light::Weights(path) => PatchWeights::load(path, patches).or_bad(),
            Light::Direction(dir) => directional(*dir, field),
        }
    }

    fn still(&self, width: usize, height: usize) -> Result<Still, Failure> {
        match &self.view {
            Some(path) => {
                let curve = ViewCurve::load_named(self.view_response.as_deref()).or_bad()?;
                Still::load_sized(path, (width, height), curve.as_ref()).or_bad()
            }
            None => Ok(Still::black(width, height)),
        }
    }

    fn exact(&self, field: &Field<'_>, weights: &PatchWeights) -> Result<Option<Picture>, Failure> {
        let Some(dir) = &self.exact else { return Ok(None) };
        let stack = Stack::open(dir).or_bad()?;
        stack.check_field(field).or_bad()?;
        stack.sum(weights).or_bad().map(Some)
    }
}

/// A sun of irradiance 1 and no sky.
fn directional(dir: [f64; 3], field: &Field<'_>) -> Result<PatchWeights, Failure> {
    let (length, patches) = (dir.iter().map(|c| c * c).sum::<f64>().sqrt(), field.patch_set().len());
    let [x, y, z] = dir;
    if !(length.is_finite() && length > 1e-12) {
        return Err(Failure::bad(format!("--light {x},{y},{z}: must point towards a light")));
    }
    if field.answers_sun() && y <= 0.0 && field.patch_set().horizon().is_some() {
        return Err(Failure::bad(format!("--light {x},{y},{z}: must point towards a light above the horizon (y > 0)")));
    }
    let sun = SunWeight { dir_world: dir.map(|c| (c / length) as f32), irradiance: [1.0; 3] };
    Ok(PatchWeights { radiance: vec![[0.0; 3]; patches], sun: Some(sun) })
}

/// Lets the patches around the sun stand for it, and tells which.
fn take_sun_in(field: &Field<'_>, weights: &mut PatchWeights) -> Result<(), Failure> {
    let (set, Some(sun)) = (field.patch_set(), weights.sun) else { return Ok(()) };
    let Some(shares) = spread(set, sun.dir_world) else {
        let [x, y, z] = sun.dir_world;
        return Err(Failure::bad(format!(
            "a light at {x},{y},{z} is behind all lights of this field; they stand before {:?}",
            set.horizon().unwrap_or_default()
        )));
    };
    let told = shares.iter().filter(|share| share.share > 0.0);
    let told: Vec<String> = told.map(|share| format!("{:.3} x patch {}", share.share, share.patch)).collect();
    let told = if told.is_empty() { "no patch".to_owned() } else { told.join(" + ") };
    eprintln!("sun: {told} (the field does not answer suns between its patches)");
    weights.take_sun_in(set);
    Ok(())
}

/// A field that was baked for a site answers only the suns that can stand there.
fn refuse_foreign_sun(field: &Field<'_>, weights: &PatchWeights) -> Result<(), Failure> {
    let (Some([latitude, longitude]), Some(sun)) = (field.header().site, weights.sun) else { return Ok(()) };
    let at = position_of(sun.dir_world, f64::from(field.camera().north_deg));
    match crate::sunband::nearest(at, latitude.into()) {
        None => Ok(()),
        Some(_) => Err(Failure::bad(format!(
            "the sun at azimuth {:.1}, altitude {:.1} degrees never stands at the field's site {latitude:.4}, \
             {longitude:.4}; turn the map with --env-rot, or bake the field without --site",
            at.azimuth_deg, at.altitude_deg
        ))),
    }
}

/// What came of it: the exposure factor, if one was used, and what should be known.
type Used = (Option<f64>, Option<String>);

fn write_radiance(options: &Options, field: Field<'_>, weights: &PatchWeights) -> Result<Used, Failure> {
    let picture = match options.exact(&field, weights)? {
        Some(picture) => picture,
        None => {
            let mut relighter = Relighter::new(field, 0);
            relighter.set_weights(weights, 1.0).or_bad()?;
            relighter.radiance()
        }
    };
    let out = required(options.out.as_ref(), "-o")?;
    write_exr(out, picture.width, picture.height, &picture.rgb, &picture.alpha)?;
    Ok((None, None))
}

fn write_shown(options: &Options, file: &FieldFile, weights: &PatchWeights) -> Result<Used, Failure> {
    let field = file.field();
    let (width, height) = (field.width(), field.height());
    let still = options.still(width, height)?;
    let out = required(options.out.as_ref(), "-o")?;
    let fixed = options.exposure_ev.map(|ev| 2f64.powf(ev));
    if let Some(exact) = options.exact(&field, weights)? {
        let exposure = fixed.or_else(|| automatic(&exact.rgb, &exact.alpha)).unwrap_or(1.0);
        let pixels = composite(&exact.rgb, &exact.alpha, exposure, &still.pixels_bgrx);
        write_png(out, width, height, &pixels)?;
        return Ok((Some(exposure), None));
    }
    let mut painter = FieldPainter::new(field, still, 0);
    painter.show_receivers(file.receivers());
    if let Some(path) = &options.mask {
        painter.put_behind(Some(Mask::load_sized(path, width, height).or_bad()?));
    }
    if let Some(path) = &options.view_light {
        relight_still(&mut painter, path, &field)?;
    }
    let mut exposure = fixed.unwrap_or(1.0);
    let mut note = painter.relight(weights, exposure as f32).or_bad()?;
    if fixed.is_none() {
        exposure = painter.exact_exposure().unwrap_or(1.0);
        note = painter.relight(weights, exposure as f32).or_bad()?;
    }
    painter.draw(&mut Damage::none(0, 0)).or_runtime()?;
    write_png(out, width, height, painter.pixels_bgrx())?;
    Ok((Some(exposure), note))
}

/// Light of a file: weights per patch (.csv), or a map.
pub(super) fn light_of(path: &Path, field: &Field<'_>) -> Result<PatchWeights, Failure> {
    let patches = field.patch_set();
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        return PatchWeights::load(path, patches).or_bad();
    }
    crate::split::weights(&RadianceMap::load(path).or_bad()?, patches, 0.0).or_bad()
}

/// Has the still be relit that was taken in the light of a file: weights per patch (.csv), or a map.
pub(super) fn relight_still(painter: &mut FieldPainter<'_>, path: &Path, field: &Field<'_>) -> Result<(), Failure> {
    let then = light_of(path, field)?;
    if painter.relight_still(&then).or_bad()? {
        return Ok(());
    }
    let file = path.display();
    Err(Failure::bad(format!(
        "{file}: the still shows too little of the field's receivers to tell how it was exposed; mark the ground as relume = \
         receiver, or leave the still's light out"
    )))
}

fn tell(options: &Options, field: &Field<'_>, weights: &PatchWeights, used: Used) -> Result<(), Failure> {
    let (exposure, note) = used;
    let sun = weights.sun.map(|sun| {
        let at = position_of(sun.dir_world, f64::from(field.camera().north_deg));
        let (azimuth_deg, altitude_deg) = (at.azimuth_deg, at.altitude_deg);
        ToldSun { dir_world: sun.dir_world, azimuth_deg, altitude_deg, irradiance: sun.irradiance }
    });
    match &sun {
        Some(sun) => eprintln!(
            "sun: azimuth {:.2}, altitude {:.2} degrees, irradiance {:?}",
            sun.azimuth_deg, sun.altitude_deg, sun.irradiance
        ),
        None if field.answers_sun() => eprintln!("sun: none"),
        None => {}
    }
    if let Some(exposure) = exposure {
        eprintln!("exposure: {exposure:.6} (EV {:.3})", exposure.log2());
    }
    note.iter().for_each(|note| eprintln!("{note}"));
    let out = options.out.as_ref().map(|out| out.display().to_string()).unwrap_or_default();
    let (width, height) = (field.width(), field.height());
    let exposure_ev = exposure.map(f64::log2);
    if options.json { super::say_json(&Told { out, width, height, sun, exposure, exposure_ev, note }) } else { Ok(()) }
}
