//! `relume-bake import`: pictures that others made -> field.

use super::arguments::missing;
use super::print;
use super::scene::save;
use super::values::{ERRORS, number, percent, text, triple};
use crate::camera::Camera;
use crate::import::{Encoding, ImportError, ImportOptions, Side, Source, import};
use lexopt::prelude::*;
use relume_firmware::glue::failure::{Failure, OrFail};
use relume_firmware::glue::outfile::check_writable;
use std::path::{Path, PathBuf};

const HELP: &str = "\
relume-bake import STACK -o FIELD: makes a field of pictures that others made, one per light.

  STACK is one of
    a folder with manifest.toml   EXR, HDR, PNG, TIFF or JPEG pictures, as a renderer or a light stage gives them, or a
                      stack that `relume-bake scene --stack` wrote. Keys: [[patch]] file, direction (towards the light,
                      world space), solid_angle_sr (left out: the part of the sphere that is nearest to the light),
                      intensity (irradiance on a plane that faces the light, a number or [r, g, b]; left out: the light
                      is the patch itself at radiance 1); above all: encoding, coverage (a picture), horizon
    SET.lp            a light dome: first line the number of pictures, then `name x y z` per picture, the direction
                      towards the light with x right, y up and z towards the camera, which become the world's axes.
                      Every light has irradiance 1. Or a folder with one such file
    a folder of Radiance patch pictures   as rcontrib writes them with reinhart.cal, NAME0000.hdr (ground) to
                      NAME0145.hdr (MF:1, Tregenza) or NAME0577.hdr (MF:2); lit by each patch at radiance 1

  -o FIELD            the field file to write
  --encoding E        what 8-bit and 16-bit pixels mean: srgb or linear. Left out: what the manifest says, else 8 bits
                      are srgb, 16 bits linear. Floats are linear. Colour profiles are not read
  --mask FILE         picture of the coverage, its alpha or else its brightness, white where the object is. Left out:
                      what the manifest says, else the first picture's alpha, else everything
  --horizon X,Y,Z|none   light comes from before the plane with this normal, or from all around. Left out: a .lp set
                      has its lights before 0,0,1, others before 0,1,0, if all of them are; else from all around.
                      Environments count before it only, and a light's cell ends there
  --shrink N          pixels are means over N x N pixels of the pictures (1)
  --camera FILE       where the camera stood, as for `relume-bake scene`; noted in the field
  --error P%          relative error that the compression aims at for the picture's bright end (0.8%)
  --test-sky MAP      also tell the field's error under this captured map, .hdr or .exr (may be repeated)
  --stack DIR         also write the responses, uncompressed (EXR), as `relume bench` and `relight --exact` read them
  --threads N         threads to use (all cores)
  --report DIR        also write a page about the field: index.html with maps of ranks, bytes and errors
  --json              print the report as JSON

  Limits: 1088 pictures. Pictures are read once and spooled beside FIELD, 12 bytes per covered pixel and picture. Memory:
  about 20 bytes per pixel and thread while they are read, then twice the field and 72 bytes per covered pixel
";

#[derive(Default)]
struct Arguments {
    stack: Option<PathBuf>,
    out: Option<PathBuf>,
    threads: usize,
    json: bool,
    report: Option<PathBuf>,
    options: ImportOptions,
}

impl Arguments {
    /// `None`: help was asked for.
    fn parse(parser: &mut lexopt::Parser) -> Result<Option<Self>, Failure> {
        let mut a = Arguments::default();
        let o = &mut a.options;
        while let Some(argument) = parser.next()? {
            match argument {
                Value(path) if a.stack.is_none() => a.stack = Some(path.into()),
                Short('o') | Long("out") => a.out = Some(parser.value()?.into()),
                Long("encoding") => o.encoding = Some(encoding(&text(parser)?)?),
                Long("mask") => o.mask = Some(parser.value()?.into()),
                Long("horizon") => o.side = Some(side(&text(parser)?)?),
                Long("shrink") => o.shrink = shrink(number(parser, "--shrink")?)?,
                Long("camera") => o.camera = Some(Camera::load(Path::new(&parser.value()?)).or_bad()?),
                Long("error") => o.error = percent("--error", &text(parser)?, ERRORS)?,
                Long("test-sky") => o.test_maps.push(parser.value()?.into()),
                Long("stack") => o.stack = Some(parser.value()?.into()),
                Long("threads") => a.threads = number(parser, "--threads")?,
                Long("report") => a.report = Some(parser.value()?.into()),
                Long("json") => a.json = true,
                Long("help") | Short('h') => return Ok(None),
                other => return Err(other.unexpected().into()),
            }
        }
        Ok(Some(a))
    }
}

pub(super) fn act(parser: &mut lexopt::Parser) -> Result<(), Failure> {
    let Some(mut arguments) = Arguments::parse(parser)? else { return print(HELP) };
    let stack = arguments.stack.as_deref().ok_or_else(|| missing("import", "the stack, a folder or a .lp file"))?;
    let out = arguments.out.as_deref().ok_or_else(|| missing("import", "-o"))?;
    check_writable(out)?;
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    arguments.options.spool_folder = folder.to_owned();
    let source = Source::open(stack).or_bad()?;
    let told_of = format!("{}: {}, {} pictures", source.place.display(), source.kind, source.pictures.len());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build().or_runtime()?;
    let baked = pool.install(|| import(source, &arguments.options)).map_err(told)?;
    eprintln!("{told_of}");
    let negative = baked.report.imported.as_ref().map_or(0, |imported| imported.negative_values);
    if negative > 0 {
        eprintln!("{negative} values are below 0, which no light is; they count as 0");
    }
    save(out, &baked, arguments.json, arguments.report.as_deref())
}

fn told(error: ImportError) -> Failure {
    if error.is_of_the_disk() { Failure::Runtime(error.into()) } else { Failure::BadInput(error.into()) }
}

fn encoding(text: &str) -> Result<Encoding, Failure> {
    match text {
        "srgb" => Ok(Encoding::Srgb),
        "linear" => Ok(Encoding::Linear),
        other => Err(Failure::bad(format!("--encoding {other}: write srgb or linear"))),
    }
}

fn side(text: &str) -> Result<Side, Failure> {
    if text == "none" {
        return Ok(Side::Around);
    }
    let unit = triple(text).and_then(|dir| {
        let length = dir.iter().map(|c| c * c).sum::<f64>().sqrt();
        (length > 1e-6).then(|| dir.map(|c| c / length))
    });
    unit.map(Side::Before).ok_or_else(|| Failure::bad(format!("--horizon {text}: write X,Y,Z or none")))
}

fn shrink(times: usize) -> Result<usize, Failure> {
    if (1..=64).contains(&times) { Ok(times) } else { Err(Failure::bad(format!("--shrink {times}: 1 to 64"))) }
}
