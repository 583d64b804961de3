//! The command line of `relume-bake`.

mod arguments;
mod camera;
mod import;
mod merge;
mod plan;
mod scene;
mod values;

use crate::info;
use lexopt::prelude::*;
use relume_firmware::glue::failure::Failure;
use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;

const HELP: &str = "\
relume-bake: makes the field that a post relights.

  relume-bake scene SCENE.glb --camera CAM.json --size WxH -o FIELD
      SCENE            glTF 2.0, .glb or .gltf; the word demo: the built-in scene, which brings its own camera
      --camera FILE    {\"position\":[x,y,z],\"target\":[x,y,z],\"up\":[0,1,0],\"fov_y_deg\":45} (and \"north_deg\"), or what
                       `relume-bake camera` wrote: then the field shows the scene through that lens
      --size WxH       picture size in pixels, the display's
      -o FIELD         the field file to write
      --directions N   patches of the upper hemisphere, 16 to 1024 (256)
      --sphere         these patches are of all directions alike: for a thing on a table, under the light of a room
      --adaptive       patches of different sizes, as many in all: small where the scene answers the sky sharply
      --materials M    gltf: metallic-roughness and normal maps as glTF 2.0 defines them (the default), or
                       lambert: base colour alone
      --max-hits N     most surface hits of a light path, 0 for no limit (0)
      --site LAT,LON   the post's place: the field is meant for the suns of that latitude, and a post shows others there
      --stack DIR      also write the uncompressed stack (EXR) there
      --sun AZ,ALT     with --stack: also sun.exr for that sun, degrees
      --sun-paths N    light paths from each of a pixel's 16 points that find its indirect sunlight (80)
      --error P%       relative error that the compression aims at for the picture's bright end (0.8%)
      --noise P%       sample as finely as leaves a single pixel at most this noise under the noisiest of eight skies
      --time T         sample as finely as the bake ends in about this time (90s, 10m, 1.5h) on this machine; two such
                       bakes need not be the same bytes
      --test-sky MAP   also tell the field's error under this captured map, .hdr or .exr, without its sun (may be repeated)
      --seed N         the same seed gives the same bytes (1)
      --threads N      threads to use (all cores)
      --preview PNG    a picture of the bake while it runs, sharper with every block that is done
      --report DIR     also write a page about the field: index.html with maps of ranks, bytes, errors and noise
      --json           print the report as JSON
      --resume         go on where an interrupted bake of the same field stopped (it left FIELD.part)
  relume-bake camera STILL --points P.csv -o CAM.json [--overlay PNG --scene SCENE.glb]
      measures pose and lens of a still by points whose places are known; see relume-bake camera --help
  relume-bake plan SCENE.glb --camera CAM.json --size WxH [options as above] -o PLAN.toml
      fixes directions, tiles and samples, so that shares can be baked anywhere; tells how many tiles there are
  relume-bake scene --plan PLAN.toml --tiles A..B -o SHARE [--resume] [--threads N]
      bakes the plan's tiles A to B-1
  relume-bake merge PLAN.toml SHARE... -o FIELD [--threads N] [--json]
      joins shares into the field that one bake would have made, byte by byte
  relume-bake import STACK -o FIELD [options]
      makes a field of pictures that others made: a renderer, a light stage, a light dome (.lp), Radiance's rcontrib; see
      relume-bake import --help
  relume-bake info FIELD [--json]
  relume-bake --version
";

/// Runs the command line `args`, program name first.
///
/// # Errors
/// [`Failure`] with one line for the user and the exit code.
pub fn run(args: impl IntoIterator<Item = OsString>) -> Result<(), Failure> {
    let mut parser = lexopt::Parser::from_iter(args);
    match parser.next()? {
        Some(Value(command)) if command == "scene" => scene::act(&mut parser),
        Some(Value(command)) if command == "plan" => plan::act(&mut parser),
        Some(Value(command)) if command == "merge" => merge::act(&mut parser),
        Some(Value(command)) if command == "info" => show_info(&mut parser),
        Some(Value(command)) if command == "camera" => camera::act(&mut parser),
        Some(Value(command)) if command == "import" => import::act(&mut parser),
        Some(Long("help") | Short('h')) | None => print(HELP),
        Some(Long("version") | Short('V')) => print(concat!("relume-bake ", env!("CARGO_PKG_VERSION"), "\n")),
        Some(Value(other)) => {
            let other = other.to_string_lossy();
            Err(Failure::bad(format!(
                "no command {other:?}; use scene, camera, plan, merge, import or info (see relume-bake --help)"
            )))
        }
        Some(other) => Err(other.unexpected().into()),
    }
}

/// A closed pipe is nobody's fault.
fn print(text: &str) -> Result<(), Failure> {
    let _ = std::io::stdout().write_all(text.as_bytes());
    Ok(())
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
