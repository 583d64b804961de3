//! `relume sky`: frames of a post's camera, and from a camera's frames to a radiance map to weights.

mod capture;
mod colour;
mod frames;
mod lens;
mod merge;
mod response;
mod weights;

use super::args::Command;
use crate::failure::{Failure, OrFail};
use crate::sun::{Place, SunPosition, sun_position};

pub(super) const COMMAND: Command = Command {
    name: "sky",
    help: "\
relume sky capture POST.toml (--series N [--step-stops STOPS] | --sun [--every SPAN] [--for SPAN]) [--resume] -o FRAMES_DIR
  Takes frames with the sky camera of a post, as it is or not calibrated yet, and writes them with the exposures read back
  and the times to FRAMES_DIR/frames.json. Ctrl-C ends it; what was taken stays.
  --series N            N exposures over the light that is there, for `sky response`, `sky merge` and charts
  --step-stops STOPS    from one to the next; default 1
  --sun                 at intervals, by day, the shortest exposure and one that shows the sky, for `sky lens`
  --every SPAN          the interval: 90s, 5m (default), 1h
  --for SPAN            ends after that; default: when it is told to
  --resume              goes on with a recording that is there

relume sky response FRAMES_DIR [--black SHARE] [--plot P.png] -o CURVE.csv
  Finds the camera's response from the exposure series of FRAMES_DIR/frames.json, best ten or more frames one stop apart.
  --black SHARE         black level, share of the largest code; left out, from pixels that stay dark
  --plot P.png          draws the curves

relume sky merge FRAMES_DIR [--response CURVE.csv] [--sensor ELECTRONS,READ] [--lens LENS.json [--probe PROBE.json]
                 (--sun AZ,ALT | --site LAT,LON) [--north DEG] [--lat-long]] [--colour CAMERA.json] [--uncertainty]
                 -o MAP.hdr|MAP.exr
  Merges the exposure series of FRAMES_DIR/frames.json into linear radiance, full-well fractions per second, in the camera's
  own picture; an .exr also tells where pixels are clipped in every frame (channel `clipped`), which `sky weights` needs to
  find such a sun by a clear-sky model. Exposures that do not fit the others are corrected, samples that do not fit a pixel's others left out.
  --response CURVE.csv  the camera's response; linear if left out
  --sensor ELECTRONS,READ  electrons of a full well and of read noise; left out, found from the frames
  --lens LENS.json      lens and orientation
  --probe PROBE.json    {\"E_horizontal\":[r,g,b]}: a clipped sun's disc is rebuilt so that the horizontal irradiance agrees;
                        \"relative_sigma\" states how uncertain that is (0.01 if left out)
  --sun AZ,ALT          where the sun stands, degrees
  --site LAT,LON        the same from place and the frames' captured_at
  --north DEG           where north lies in the world, degrees from -Z towards +X; default 0
  --colour CAMERA.json  the camera's colours, for a probe of Rec.709 and lat-long maps; Rec.709 if left out
  --lat-long            makes a lat-long map; without a probe a clipped sun is rebuilt from a clear-sky model
  --uncertainty         adds one standard deviation per channel (sigma.R, sigma.G, sigma.B) to the .exr

relume sky weights MAP --field FIELD [--lens LENS.json] [--sun AZ,ALT] [--colour CAMERA.json] [--env-rot DEG]
                [--json] -o W.csv
  Weights for the field's patches.
  --lens LENS.json      MAP is a camera's picture, as `sky merge` without --lat-long gives it; left out, a lat-long map
  --sun AZ,ALT          with --lens: where the sun stands
  --colour CAMERA.json  with --lens: the camera's colours; Rec.709 if left out
  --env-rot DEG         without --lens: turns the map about +Y
  --json                which patches were filled from a smooth sky, how the sun is known, and how far the weights'
                        horizontal irradiance is off the map's

relume sky lens FRAMES_DIR --site LAT,LON [--model M] [--north DEG] [--response CURVE.csv] [--start LENS.json]
                [--flat FRAMES_DIR] [--mask MASK.png] [--plot P.png] [--json] -o LENS.json
  Lens and orientation of the sky camera from the sun's own path: frames over some hours or days with captured_at, of
  which short exposures are used. Prints residuals and what the path could not tell.
  --model M             equidistant, equisolid or kannala_brandt (default)
  --north DEG           where north lies in the scene, degrees from -Z towards +X; default 0
  --response CURVE.csv  the camera's response; linear if left out
  --start LENS.json     values for what the sun's path does not tell; default 180 degrees across the smaller side
  --flat FRAMES_DIR     frames of an evenly lit white surface: measures vignetting
  --mask MASK.png       writes a proposal of what is sky (white), to be looked at and painted over
  --plot P.png          the sun's path over the picture, and the residuals
  A level camera that looks at the zenith with north at the top of the picture has east on the left, and
  \"camera_to_world\": [[-1,0,0],[0,0,1],[0,1,0]].

relume sky colour CHART_FRAME.png (--chart PATCHES.csv | --corners X,Y,X,Y,X,Y,X,Y) [--response CURVE.csv]
                [--light KELVIN] [--json] -o CAMERA.json
  The camera's colours from a photographed chart with grey patches; grey stays grey. Prints delta E 2000.
  --chart PATCHES.csv   a header x,y,L,a,b (CIE L*a*b*, D50) or x,y,R,G,B (linear Rec.709), a row per patch; x,y pixels
  --corners ...         a ColorChecker Classic (before November 2014) instead: centres, in pixels, of its corner patches
                        dark skin, bluish green, black, white
  --light KELVIN        the daylight that the chart stood in, 4000 to 25000; default 6504
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let tasks = "capture, response, merge, weights, lens or colour";
    let task = parser.value().map_err(|_| Failure::bad(format!("sky: name a task: {tasks}")))?;
    match task.to_string_lossy().as_ref() {
        "capture" => capture::act(parser),
        "merge" => merge::act(parser),
        "response" => response::act(parser),
        "weights" => weights::act(parser),
        "lens" => lens::act(parser),
        "colour" => colour::act(parser),
        other => Err(Failure::bad(format!("sky {other}: unknown task; choose {tasks}"))),
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
