//! `relume-bake camera`: pose and lens of a still from measured points.

use super::arguments::missing;
use super::print;
use super::values::text;
use crate::camera::Projection;
use crate::geometry::Geometry;
use crate::material::Shading;
use crate::png::write_png;
use crate::pose::edges::lines;
use crate::pose::overlay::{draw, load_still};
use crate::pose::{Fit, Options, fit, points};
use crate::scene;
use image::RgbImage;
use lexopt::prelude::*;
use relume_firmware::glue::failure::{Failure, OrFail};
use relume_firmware::glue::outfile::check_writable;
use std::path::{Path, PathBuf};

const HELP: &str = "\
relume-bake camera STILL --points P.csv -o CAM.json: where a still was taken from, and through what lens.

  STILL               PNG, JPEG or TIFF as the camera gave it, not cropped; turned as its EXIF orientation says
  --points P.csv      u,v,x,y,z per line: column and row in the still, px from its top left corner (the first pixel's
                      centre is 0.5,0.5), and the place in the world, metres, +Y up. At least 6; 12 or more, all over
                      the still and at different distances, are better. Lines that begin with # are passed over
  -o CAM.json         the camera file to write, for `relume-bake scene --camera`
  --lens M            radial (k1 to k3), kannala_brandt (a wide lens or fisheye, k1 to k4), or auto: radial unless the
                      points clearly speak for the other (auto)
  --max-angle DEG     the largest angle from the axis that the lens images, where its round picture ends within the still
  --noise PX          how well points are clicked and measured, standard deviation in each axis (0.5)
  --north DEG         where true north lies, degrees from -Z towards +X; noted in CAM.json (0)
  --overlay PNG       the still with the scene's edges, the points, and ten times their residuals; needs --scene
  --scene SCENE.glb   the scene whose edges the overlay shows
  --json              print residuals and standard errors as JSON

  A point that does not fit is named by its line, left out, and drawn in red. CAM.json bakes at any size of the still's
  shape.
";

#[derive(Default)]
struct Arguments {
    still: Option<PathBuf>,
    points: Option<PathBuf>,
    out: Option<PathBuf>,
    overlay: Option<PathBuf>,
    scene: Option<PathBuf>,
    north_deg: f64,
    json: bool,
    options: Options,
}

impl Arguments {
    /// `None`: help was asked for.
    fn parse(parser: &mut lexopt::Parser) -> Result<Option<Self>, Failure> {
        let mut a = Arguments::default();
        while let Some(argument) = parser.next()? {
            match argument {
                Value(path) if a.still.is_none() => a.still = Some(path.into()),
                Long("points") => a.points = Some(parser.value()?.into()),
                Short('o') | Long("out") => a.out = Some(parser.value()?.into()),
                Long("overlay") => a.overlay = Some(parser.value()?.into()),
                Long("scene") => a.scene = Some(parser.value()?.into()),
                Long("lens") => a.options.projection = projection(&text(parser)?)?,
                Long("max-angle") => a.options.max_angle_deg = within(parser, "--max-angle", 1.0..=180.0)?,
                Long("noise") => a.options.noise_px = within(parser, "--noise", 0.01..=100.0)?,
                Long("north") => a.north_deg = within(parser, "--north", -360.0..=360.0)?,
                Long("json") => a.json = true,
                Long("help") | Short('h') => return Ok(None),
                other => return Err(other.unexpected().into()),
            }
        }
        if a.overlay.is_some() != a.scene.is_some() {
            return Err(Failure::bad("camera: --overlay PNG and --scene SCENE.glb go together"));
        }
        Ok(Some(a))
    }
}

pub(super) fn act(parser: &mut lexopt::Parser) -> Result<(), Failure> {
    let Some(arguments) = Arguments::parse(parser)? else { return print(HELP) };
    let still_file = arguments.still.as_deref().ok_or_else(|| missing("camera", "the still"))?;
    let points_file = arguments.points.as_deref().ok_or_else(|| missing("camera", "--points P.csv"))?;
    let out = arguments.out.as_deref().ok_or_else(|| missing("camera", "-o CAM.json"))?;
    check_writable(out)?;
    arguments.overlay.as_deref().map(check_writable).transpose()?;
    let still = load_still(still_file).or_bad()?;
    let size_px = [still.width(), still.height()];
    let points = points::load(points_file, size_px).or_bad()?;
    let named = |error: &dyn std::fmt::Display| Failure::bad(format!("{}: {error}", points_file.display()));
    let fitted = fit(&points, size_px, &arguments.options).map_err(|error| named(&error))?;
    let camera = fitted.camera(arguments.north_deg);
    camera.check(out).map_err(|error| named(&error))?;
    for warning in fitted.warnings() {
        eprintln!("notice: {}: {warning}", points_file.display());
    }
    if let (Some(overlay), Some(scene)) = (&arguments.overlay, &arguments.scene) {
        write_overlay(overlay, scene, &still, &fitted)?;
    }
    relume_firmware::glue::outfile::write_whole(out, |file| {
        std::io::Write::write_all(file, camera.to_json().as_bytes())
    })?;
    eprint!("{fitted}");
    if arguments.json { print(&format!("{}\n", fitted.to_json())) } else { Ok(()) }
}

fn write_overlay(file: &Path, scene: &Path, still: &RgbImage, fitted: &Fit) -> Result<(), Failure> {
    let scene = scene::load(scene, Shading::Lambert).or_bad()?.scene;
    let size = (still.width(), still.height());
    let view = fitted.camera(0.0).view(size.0, size.1);
    let edges = lines(&scene, &Geometry::new(&scene), &view, size.into());
    write_png(file, size, &draw(still, &edges, &fitted.seen))?;
    Ok(())
}

fn projection(text: &str) -> Result<Option<Projection>, Failure> {
    match text {
        "auto" => Ok(None),
        "radial" => Ok(Some(Projection::Radial)),
        "kannala_brandt" => Ok(Some(Projection::KannalaBrandt)),
        other => Err(Failure::bad(format!("--lens {other}: say auto, radial or kannala_brandt"))),
    }
}

fn within(parser: &mut lexopt::Parser, name: &str, range: std::ops::RangeInclusive<f64>) -> Result<f64, Failure> {
    let text = text(parser)?;
    text.parse()
        .ok()
        .filter(|value| range.contains(value))
        .ok_or_else(|| Failure::bad(format!("{name} {text}: write a number from {} to {}", range.start(), range.end())))
}
