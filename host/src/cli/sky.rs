//! `relume sky`: from a camera's frames to a radiance map to weights.

mod merge;
mod weights;

use super::args::Command;
use crate::failure::{Failure, OrFail};
use crate::sun::{Place, SunPosition, sun_position};

pub(super) const COMMAND: Command = Command {
    name: "sky",
    help: "\
relume sky merge FRAMES_DIR [--response CURVE.csv] [--lens LENS.json] [--sun AZ,ALT | --site LAT,LON] -o MAP.hdr|MAP.exr
  Merges the exposure series of FRAMES_DIR/frames.json into linear radiance.
  --response CURVE.csv  the camera's response; linear if left out
  --lens LENS.json      makes a lat-long map of it; left out, the result keeps the camera's own picture
  --sun AZ,ALT          where the sun stands, degrees; what was clipped there is rebuilt (needs --lens)
  --site LAT,LON        the same from place and the frames' captured_at

relume sky weights MAP --field FIELD [--lens LENS.json] [--sun AZ,ALT] [--env-rot DEG] [--json] -o W.csv
  Weights for the field's patches.
  --lens LENS.json      MAP is a camera's picture, as `sky merge` without --lens gives it; left out, a lat-long map
  --sun AZ,ALT          with --lens: where the sun stands
  --env-rot DEG         without --lens: turns the map about +Y
  --json                which patches were filled from a smooth sky, how the sun is known, and how far the weights'
                        horizontal irradiance is off the map's

relume sky response, relume sky lens and --probe come with a later version.
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let task = parser.value().map_err(|_| Failure::bad("sky: name a task: merge or weights"))?;
    match task.to_string_lossy().as_ref() {
        "merge" => merge::act(parser),
        "weights" => weights::act(parser),
        task @ ("response" | "lens") => Err(Failure::bad(format!("sky {task}: comes with a later version"))),
        other => Err(Failure::bad(format!("sky {other}: unknown task; choose merge or weights"))),
    }
}

/// How a command says where the sun stands.
#[derive(Clone, Copy)]
enum SunOption {
    Position([f64; 2]),
    Site([f64; 2]),
}

impl SunOption {
    /// The sun's position for frames that were taken at `captured_at_s` (Unix seconds; 0 = not known).
    fn position(self, captured_at_s: f64) -> Result<SunPosition, Failure> {
        match self {
            SunOption::Position([azimuth_deg, altitude_deg]) => {
                if !(-90.0..=90.0).contains(&altitude_deg) {
                    return Err(Failure::bad(format!("--sun: altitude {altitude_deg} must be from -90 to 90")));
                }
                Ok(SunPosition { azimuth_deg, altitude_deg })
            }
            SunOption::Site(_) if captured_at_s <= 0.0 => {
                Err(Failure::bad("--site needs captured_at in frames.json; or give --sun AZ,ALT"))
            }
            SunOption::Site([latitude_deg, longitude_deg]) => {
                sun_position(captured_at_s, Place { latitude_deg, longitude_deg }).or_bad()
            }
        }
    }
}
