//! What `relume sky lens` says: residuals day by day, where the camera looks, and what the sun's path could not tell.

use super::Outcome;
use crate::lens::Lens;
use crate::sun::{format_utc, position_of};
use crate::sunpath::{Found, rms};
use serde::Serialize;
use std::fmt::Write as _;

/// Residuals of one day.
#[derive(Debug, Serialize)]
pub(super) struct Day {
    date_utc: String,
    frames: usize,
    rms_px: f64,
    rms_deg: f64,
}

/// All of it, as JSON.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    frames_with_sun: usize,
    frames_without_spot: usize,
    frames_set_aside: usize,
    rms_px: f64,
    rms_deg: f64,
    days: Vec<Day>,
    held: Vec<&'static str>,
    orientation_error_deg: f64,
    sky_error_deg: f64,
    worst_sky_error_deg: f64,
    axis_azimuth_altitude_deg: [f64; 2],
    top_azimuth_deg: f64,
    vignetting_rms: Option<f64>,
    mask_frames: Option<u32>,
    mask_sky_share: Option<f64>,
}

pub(super) fn summary(outcome: &Outcome) -> Summary {
    let fit = &outcome.fit;
    let (rms_px, rms_deg) = fit.rms();
    let (axis_azimuth_altitude_deg, top_azimuth_deg) = pose(&fit.lens);
    Summary {
        frames_with_sun: fit.found.len(),
        frames_without_spot: fit.without_spot,
        frames_set_aside: fit.set_aside,
        rms_px,
        rms_deg,
        days: days(&fit.found),
        held: fit.held.clone(),
        orientation_error_deg: fit.orientation_error_deg,
        sky_error_deg: fit.sky_error_deg,
        worst_sky_error_deg: fit.worst_sky_error_deg,
        axis_azimuth_altitude_deg,
        top_azimuth_deg,
        vignetting_rms: outcome.vignetting.map(|v| v.rms),
        mask_frames: outcome.mask.as_ref().map(|mask| mask.1),
        mask_sky_share: outcome.mask.as_ref().map(|mask| mask.0.share()),
    }
}

fn days(found: &[Found]) -> Vec<Day> {
    let date = |f: &Found| format_utc(f.captured_at_s).chars().take(10).collect::<String>();
    let day = |part: &[Found]| {
        let (rms_px, rms_deg) = rms(part);
        Day { date_utc: part.first().map(date).unwrap_or_default(), frames: part.len(), rms_px, rms_deg }
    };
    found.chunk_by(|a, b| date(a) == date(b)).map(day).collect()
}

/// Where the axis looks, by the world's north (-Z), and the azimuth that the picture's top lies towards.
fn pose(lens: &Lens) -> ([f64; 2], f64) {
    let m = lens.file().camera_to_world;
    let column = |j: usize| [m[0][j] as f32, m[1][j] as f32, m[2][j] as f32];
    let axis = position_of(column(2), 0.0);
    let top = position_of(column(1).map(|c| -c), 0.0);
    ([axis.azimuth_deg, axis.altitude_deg], top.azimuth_deg)
}

pub(super) fn text(outcome: &Outcome) -> String {
    let (said, file) = (summary(outcome), outcome.fit.lens.file());
    let mut text = format!(
        "sun found in {} frames; {} show no spot, in {} it is none that the sun could be\n",
        said.frames_with_sun, said.frames_without_spot, said.frames_set_aside
    );
    for day in &said.days {
        let Day { date_utc, frames, rms_px, rms_deg } = day;
        let _ = writeln!(text, "{date_utc}  {frames} frames, residual {rms_px:.2} px rms, {rms_deg:.3} degrees");
    }
    let _ = writeln!(text, "all         residual {:.2} px rms, {:.3} degrees", said.rms_px, said.rms_deg);
    let _ = writeln!(
        text,
        "lens        focal length {:.2} px, centre {:.2},{:.2}, k {:.5?}",
        file.focal_px, file.center_px[0], file.center_px[1], file.k
    );
    let _ = writeln!(
        text,
        "looks       to azimuth {:.2}, altitude {:.2} degrees; the picture's top lies towards azimuth {:.2} (of -Z)",
        said.axis_azimuth_altitude_deg[0], said.axis_azimuth_altitude_deg[1], said.top_azimuth_deg
    );
    let _ = writeln!(
        text,
        "error       standard error of the orientation {:.3} degrees; of directions over the whole sky {:.3}, at worst {:.3}",
        said.orientation_error_deg, said.sky_error_deg, said.worst_sky_error_deg
    );
    text + &untold(&said) + &extras(outcome)
}

fn untold(said: &Summary) -> String {
    if said.held.is_empty() {
        return String::new();
    }
    let more = if said.held.iter().any(|name| !name.starts_with('k')) {
        "; take frames over more hours or seasons, or give better ones with --start LENS.json"
    } else {
        ""
    };
    format!("left        the sun's path does not tell {}: left at the nominal values{more}\n", said.held.join(", "))
}

fn extras(outcome: &Outcome) -> String {
    let mut text = match &outcome.vignetting {
        Some(v) => format!(
            "vignetting  {:.4?}, rms {:.2} % of the centre, from 0 to {} degrees off the axis\n",
            v.coefficients,
            100.0 * v.rms,
            v.reach_deg
        ),
        None if outcome.fit.lens.has_vignetting() => "vignetting  as in the lens file of --start\n".into(),
        None => "vignetting  not measured, none assumed: give --flat FRAMES_DIR\n".into(),
    };
    if let Some((mask, frames)) = &outcome.mask {
        let from = match frames {
            0 => "the horizon only, no frames show both sky and walls".into(),
            _ => format!("the horizon and {frames} frames"),
        };
        let _ = writeln!(
            text,
            "mask        a proposal from {from}: {:.1} % of the picture is sky; look at it and paint over what is wrong",
            100.0 * mask.share()
        );
    }
    text
}
