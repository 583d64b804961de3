//! Words about where a view disagrees with its receivers, and what to calibrate.

use crate::cli::check::Table;
use crate::colour::difference::delta_e_2000;
use crate::colour::spaces::{XYZ_OF_REC709, apply, lab};
use crate::config::Config;
use crate::exposure::ExposureMode;
use crate::view::disagreement::{Disagreement, Shift, Trend};

/// What was found of a view, and how bright its picture is shown.
pub(super) struct Found {
    pub(super) disagreement: Disagreement,
    /// Display white per radiance that the post would show.
    pub(super) shown: f64,
    /// The still is relit by what it shows of receivers, and so exposed anew.
    pub(super) is_relit: bool,
}

/// What an eye notices beside a mid grey: 2.3 of CIE L*a*b* (Mahy, Van Eycken, Oosterlinck, Color Research & Application 19,
/// 1994).
const NOTICED: f64 = 2.3;
/// Of mid grey.
const GREY: f64 = 0.18;
/// The same in light, natural logarithm: dL* = 116/3 x 0.18^(1/3) x d ln Y.
const NOTICED_LOG: f64 = 0.105;
/// Standard errors that are no chance.
const SURE: f64 = 3.0;
/// Single pixels that differ by more say that the model is not what is seen: a ground's own texture differs by less.
const ROUGH: f64 = 0.3;
/// Displacement that is seen as a shadow's double edge, px; and what must be left of the misfit at most.
const DISPLACED_PX: f64 = 1.0;
const EXPLAINED: f64 = 0.85;

/// Adds what is found to the table.
pub(super) fn rows(config: &Config, found: &Found, table: &mut Table) {
    let Disagreement { gain, pixels, trend, shift } = &found.disagreement;
    let green = gain.gain[1];
    let is_displaced = shift.is_some_and(displaced);
    let words = format!(
        "{pixels} pixels show nothing else; the view's light is {green:.4} of theirs (EV {:.2}), single pixels differ by {:.0} %",
        green.log2(),
        100.0 * gain.scatter
    );
    if gain.scatter > ROUGH && !is_displaced {
        let what = "their base colours in the scene, the sun's place (clock, north_deg) or the pose are not the site's";
        table.advise("receivers", format!("{words}: {what}"));
    } else {
        table.say("receivers", words);
    }
    exposure(config, found, green, table);
    tint(config, found, gain.gain, table);
    evenness(*trend, table);
    pose(*shift, table);
}

fn exposure(config: &Config, found: &Found, green: f64, table: &mut Table) {
    const WHAT: &str = "exposure";
    if found.is_relit {
        return table.say(WHAT, "the still is relit, and exposed anew".into());
    }
    if config.exposure == ExposureMode::View {
        return table.say(WHAT, format!("follows the view: EV {:.2}", green.log2()));
    }
    let off = (green / found.shown).ln();
    let (stops, side) = ((off / std::f64::consts::LN_2).abs(), if off > 0.0 { "darker" } else { "brighter" });
    if off.abs() <= NOTICED_LOG {
        return table.say(WHAT, format!("the picture is within {stops:.2} stops of the view"));
    }
    let what = match config.exposure {
        ExposureMode::Fixed(_) => format!("write exposure.ev = {:.2}, or exposure.mode = \"view\"", green.log2()),
        _ => "write exposure.mode = \"view\"".into(),
    };
    table.advise(WHAT, format!("the picture is {stops:.2} stops {side} than the view: {what}"));
}

/// Difference of a mid grey from what it is shown as, as bright: CIEDE2000.
fn grey_difference(gain: [f64; 3]) -> f64 {
    let white = apply(&XYZ_OF_REC709, [1.0; 3]);
    let tinted = apply(&XYZ_OF_REC709, gain);
    let of = |xyz: [f64; 3], bright: f64| lab(xyz.map(|v| GREY * v / bright), white);
    delta_e_2000(of(white, 1.0), of(tinted, tinted[1]))
}

fn tint(config: &Config, found: &Found, gain: [f64; 3], table: &mut Table) {
    const WHAT: &str = "tint";
    let difference = grey_difference(gain);
    let per_cent = |channel: usize| 100.0 * (gain[channel] / gain[1] - 1.0);
    let words = format!("red {:+.0} %, blue {:+.0} % of green (CIEDE2000 {difference:.1})", per_cent(0), per_cent(2));
    if found.is_relit || config.exposure == ExposureMode::View {
        return table.say(WHAT, format!("the picture takes the view's white: {words}"));
    }
    if difference <= NOTICED {
        return table.say(WHAT, format!("the view's grey is the sky's: {words}"));
    }
    let what = match (&config.camera.colour, config.camera.colour_state(config.sky)) {
        (Some(path), _) => format!(
            "set the view camera's white balance to daylight, measure {} again (`relume sky colour`), or write exposure.mode = \
             \"view\"",
            path.display()
        ),
        (None, "none") => "set the view camera's white balance to daylight, or write exposure.mode = \"view\"".into(),
        (None, _) => {
            "measure the sky camera's colours (camera.colour, `relume sky colour`), set the view camera's white \
                      balance to daylight, or write exposure.mode = \"view\""
                .into()
        }
    };
    table.advise(WHAT, format!("the view is tinted against the sky's light, {words}: {what}"));
}

fn evenness(trend: Option<Trend>, table: &mut Table) {
    const WHAT: &str = "evenness";
    let Some(trend) = trend else {
        return table.say(WHAT, "cannot tell: receivers cover too little of the picture".into());
    };
    if let Some(words) = unevenness(&trend) {
        return table.advise(WHAT, words);
    }
    let parts = [trend.right, trend.down, trend.corners];
    let unsure = parts.iter().map(|(_, error)| SURE * error).fold(0.0, f64::max);
    if unsure > NOTICED_LOG {
        let words = "nothing found, but receivers cover so little of the picture that it may be";
        return table.say(WHAT, format!("{words} {:.0} %", 100.0 * unsure));
    }
    let [right, down, corners] = parts.map(per_cent);
    let words = format!("right {right:+.0} %, lower edge {down:+.0} %, corners {corners:+.0} % against the middle");
    table.say(WHAT, words);
}

/// Growth of light, a natural logarithm, in per cent.
fn per_cent((value, _error): (f64, f64)) -> f64 {
    100.0 * value.exp_m1()
}

/// What is noticed of a trend, and no chance.
fn unevenness(&Trend { right, down, corners }: &Trend) -> Option<String> {
    let is_sure = |(value, error): (f64, f64)| value.abs() > NOTICED_LOG && value.abs() > SURE * error;
    if is_sure(corners) {
        return Some(format!(
            "the view's light is {:+.0} % in the corners, its lens's vignetting: close its aperture, or turn on (or off) its \
             shading correction",
            per_cent(corners)
        ));
    }
    let (steeper, side) = if right.0.abs() >= down.0.abs() { (right, "right") } else { (down, "lower") };
    is_sure(steeper).then(|| {
        format!(
            "the view's light is {:+.0} % at its {side} edge against the middle: stray light on its lens, or the sky camera's \
             orientation (`relume sky lens`)",
            per_cent(steeper)
        )
    })
}

fn displaced(shift: Shift) -> bool {
    shift.px[0].hypot(shift.px[1]) >= DISPLACED_PX && shift.left <= EXPLAINED
}

fn pose(shift: Option<Shift>, table: &mut Table) {
    const WHAT: &str = "pose";
    let Some(shift) = shift else {
        return table
            .say(WHAT, "cannot tell: the light of receivers changes nowhere sharply; look again in sunshine".into());
    };
    let [right, down] = shift.px;
    if !displaced(shift) {
        let words = "sharp changes of the receivers' light stand where they should: no other place fits them better";
        return table.say(WHAT, words.into());
    }
    let reach = shift.reach_px as f64;
    let at_least = if right.abs() >= reach || down.abs() >= reach { "at least " } else { "" };
    let across = if right < 0.0 { "left" } else { "right" };
    let along = if down < 0.0 { "up" } else { "down" };
    table.advise(
        WHAT,
        format!(
            "the view shows edges {at_least}{:.1} px to the {across} and {:.1} px further {along} than the field: measure its pose \
             and lens again (`relume-bake camera`) and bake, or set the camera back; if only shadows are off: clock, north_deg",
            right.abs(),
            down.abs()
        ),
    );
}
