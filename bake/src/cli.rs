//! The command line of `relume-bake`.

use crate::bake::{BakeError, BakeOptions, bake};
use crate::camera::Camera;
use crate::demo_scene;
use crate::scene::{self, Scene};
use crate::stack::StackError;
use crate::{info, write};
use lexopt::prelude::*;
use relume_firmware::glue::failure::{Failure, OrFail};
use relume_firmware::glue::outfile::check_writable;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

const HELP: &str = "\
relume-bake: makes the field that a post relights.

  relume-bake scene SCENE.glb --camera CAM.json --size WxH -o FIELD
      SCENE            glTF 2.0, .glb or .gltf; the word demo: the built-in scene, which brings its own camera
      --camera FILE    {\"position\":[x,y,z],\"target\":[x,y,z],\"up\":[0,1,0],\"fov_y_deg\":45} (and \"north_deg\")
      --size WxH       picture size in pixels, the display's
      -o FIELD         the field file to write
      --directions N   patches of the upper hemisphere, 16 to 1024 (256)
      --materials M    lambert: base colour, both sides (the only model of this version)
      --max-hits N     most surface hits of a light path, 0 for no limit (0)
      --site LAT,LON   the post's place, noted in the field
      --stack DIR      also write the uncompressed stack (EXR) there
      --sun AZ,ALT     with --stack: also sun.exr for that sun, degrees
      --sun-paths N    light paths from each of a pixel's 16 points that find its indirect sunlight (80)
      --error P%       relative error that the compression aims at
      --test-sky MAP   also tell the field's error under this captured map, .hdr or .exr, without its sun (may be repeated)
      --seed N         the same seed gives the same bytes (1)
      --threads N      threads to use (all cores)
      --json           print the report as JSON
  relume-bake info FIELD [--json]
  relume-bake --version
";

/// Stands for the scene that the program brings.
const BUILT_IN: &str = "demo";

/// Runs the command line `args`, program name first.
///
/// # Errors
/// [`Failure`] with one line for the user and the exit code.
pub fn run(args: impl IntoIterator<Item = OsString>) -> Result<(), Failure> {
    let mut parser = lexopt::Parser::from_iter(args);
    match parser.next()? {
        Some(Value(command)) if command == "scene" => bake_scene(&mut parser),
        Some(Value(command)) if command == "info" => show_info(&mut parser),
        Some(Value(command)) if command == "import" => {
            Err(Failure::bad("import: not in this version; bake a scene with `relume-bake scene`"))
        }
        Some(Long("help") | Short('h')) | None => print(HELP),
        Some(Long("version") | Short('V')) => print(concat!("relume-bake ", env!("CARGO_PKG_VERSION"), "\n")),
        Some(Value(other)) => {
            let other = other.to_string_lossy();
            Err(Failure::bad(format!("no command {other:?}; use scene or info (see relume-bake --help)")))
        }
        Some(other) => Err(other.unexpected().into()),
    }
}

/// A closed pipe is nobody's fault.
fn print(text: &str) -> Result<(), Failure> {
    let _ = std::io::stdout().write_all(text.as_bytes());
    Ok(())
}

#[derive(Default)]
struct SceneArguments {
    scene: Option<PathBuf>,
    camera: Option<PathBuf>,
    size: Option<(u32, u32)>,
    out: Option<PathBuf>,
    threads: usize,
    json: bool,
    options: BakeOptions,
}

fn bake_scene(parser: &mut lexopt::Parser) -> Result<(), Failure> {
    let Some(arguments) = scene_arguments(parser)? else { return print(HELP) };
    let need = |what: &str| Failure::bad(format!("scene: {what} is missing (see relume-bake --help)"));
    let scene_path = arguments.scene.ok_or_else(|| need("the scene file"))?;
    let out = arguments.out.ok_or_else(|| need("-o FIELD"))?;
    let mut options = arguments.options;
    options.size = arguments.size.ok_or_else(|| need("--size WxH"))?;
    if options.stack_sun.is_some() && options.stack.is_none() {
        return Err(Failure::bad("--sun goes with --stack DIR: it asks for the stack's sun.exr"));
    }
    check_writable(&out)?;
    let (scene, camera, names) = scene_and_camera(&scene_path, arguments.camera)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build().or_runtime()?;
    let baked = pool.install(|| bake(&scene, &camera, &options)).map_err(|error| match error {
        BakeError::Stack(StackError::Write { .. }) => Failure::Runtime(error.into()),
        BakeError::Transport(_) => Failure::bad(format!("{names}: {error}")),
        _ => Failure::BadInput(error.into()),
    })?;
    write::save(&out, &baked.bytes)?;
    if arguments.json { print(&format!("{}\n", baked.report.to_json())) } else { Ok(()) }?;
    let report = &baked.report;
    eprintln!(
        "{}: {} bytes, rank {:.1} on average and {} at most, {:.1} bytes per covered pixel, {:.0} s",
        out.display(),
        baked.bytes.len(),
        report.rank_mean,
        report.rank_max,
        report.bytes_per_covered_pixel,
        report.seconds
    );
    Ok(())
}

/// The scene, where it is seen from, and the names of both for messages.
fn scene_and_camera(scene: &Path, camera: Option<PathBuf>) -> Result<(Scene, Camera, String), Failure> {
    match (scene.as_os_str() == BUILT_IN, camera) {
        (true, None) => {
            let (scene, camera) = demo_scene::temple();
            Ok((scene, camera, BUILT_IN.to_owned()))
        }
        (true, Some(_)) => Err(Failure::bad("scene demo: leave --camera out; the built-in scene brings its own")),
        (false, None) => Err(Failure::bad("scene: --camera is missing (see relume-bake --help)")),
        (false, Some(camera)) => {
            let names = format!("{} with {}", scene.display(), camera.display());
            Ok((scene::load(scene).or_bad()?, Camera::load(&camera).or_bad()?, names))
        }
    }
}

fn scene_arguments(parser: &mut lexopt::Parser) -> Result<Option<SceneArguments>, Failure> {
    let mut a = SceneArguments::default();
    while let Some(argument) = parser.next()? {
        match argument {
            Value(path) if a.scene.is_none() => a.scene = Some(path.into()),
            Long("camera") => a.camera = Some(parser.value()?.into()),
            Long("size") => a.size = Some(size(&text(parser)?)?),
            Short('o') | Long("out") => a.out = Some(parser.value()?.into()),
            Long("directions") => a.options.directions = number(parser, "--directions")?,
            Long("sun-paths") => a.options.transport.sun_paths = number(parser, "--sun-paths")?,
            Long("max-hits") => a.options.transport.max_hits = number(parser, "--max-hits")?,
            Long("seed") => a.options.transport.seed = number(parser, "--seed")?,
            Long("threads") => a.threads = number(parser, "--threads")?,
            Long("stack") => a.options.stack = Some(parser.value()?.into()),
            Long("sun") => a.options.stack_sun = Some(sun(&text(parser)?)?),
            Long("site") => a.options.site = Some(site(&text(parser)?)?),
            Long("error") => a.options.error = percent(&text(parser)?)?,
            Long("test-sky") => a.options.test_maps.push(parser.value()?.into()),
            Long("materials") => match text(parser)?.as_str() {
                "lambert" => {}
                other => return Err(Failure::bad(format!("--materials {other}: this version knows lambert"))),
            },
            Long("json") => a.json = true,
            Long("help") | Short('h') => return Ok(None),
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(Some(a))
}

fn text(parser: &mut lexopt::Parser) -> Result<String, Failure> {
    Ok(parser.value()?.string()?)
}

fn number<T: std::str::FromStr>(parser: &mut lexopt::Parser, name: &str) -> Result<T, Failure> {
    let text = text(parser)?;
    text.parse().map_err(|_| Failure::bad(format!("{name} {text}: not a whole number in range")))
}

fn size(text: &str) -> Result<(u32, u32), Failure> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    sides.ok_or_else(|| Failure::bad(format!("--size {text}: write WIDTHxHEIGHT in pixels, such as 1920x1080")))
}

/// Two finite numbers with a comma between them.
fn pair(text: &str) -> Option<[f64; 2]> {
    let (a, b) = text.split_once(',')?;
    let pair = [a.trim().parse().ok()?, b.trim().parse().ok()?];
    pair.iter().all(|value: &f64| value.is_finite()).then_some(pair)
}

fn sun(text: &str) -> Result<[f64; 2], Failure> {
    let advice = "write AZIMUTH,ALTITUDE in degrees, clockwise from north and above the horizon (altitude 0 to 90)";
    pair(text)
        .filter(|[_, altitude]| (0.0..=90.0).contains(altitude))
        .ok_or_else(|| Failure::bad(format!("--sun {text}: {advice}")))
}

fn site(text: &str) -> Result<[f64; 2], Failure> {
    pair(text)
        .filter(|[latitude, longitude]| latitude.abs() <= 90.0 && longitude.abs() <= 180.0)
        .ok_or_else(|| Failure::bad(format!("--site {text}: write LATITUDE,LONGITUDE in degrees, such as 37.97,23.73")))
}

fn percent(text: &str) -> Result<f64, Failure> {
    let value = text.strip_suffix('%').and_then(|number| number.parse::<f64>().ok()).map(|number| number / 100.0);
    value
        .filter(|value| (1e-4..=0.2).contains(value))
        .ok_or_else(|| Failure::bad(format!("--error {text}: write a percentage from 0.01% to 20%")))
}

fn show_info(parser: &mut lexopt::Parser) -> Result<(), Failure> {
    let (mut field, mut json) = (None, false);
    while let Some(argument) = parser.next()? {
        match argument {
            Value(path) if field.is_none() => field = Some(PathBuf::from(path)),
            Long("json") => json = true,
            Long("help") | Short('h') => return print(HELP),
            other => return Err(other.unexpected().into()),
        }
    }
    let path = field.ok_or_else(|| Failure::bad("info: the field file is missing (relume-bake info FIELD)"))?;
    let info = info::Info::read(&path)?;
    print(&if json { info.to_json() + "\n" } else { info.to_string() })
}
