//! Controls in words, for whoever installs a camera.

use super::{ABSOLUTE_UNIT_S, Controls, MANUAL_MODES, Manual, id};

/// Controls that are listed as their driver counts them: number, name, unit.
const COUNTED: [(u32, &str, &str); 6] = [
    (id::EXPOSURE_LINES, "exposure", " lines"),
    (id::ANALOGUE_GAIN, "analogue gain, codes", ""),
    (id::GAIN, "gain, codes", ""),
    (id::WHITE_BALANCE_TEMPERATURE, "white balance", " K"),
    (id::RED_BALANCE, "red balance", ""),
    (id::BLUE_BALANCE, "blue balance", ""),
];

impl Manual {
    /// What exposure and gain can be set to, and what the white balance reads since it was set.
    pub(in crate::camera::v4l2) fn told(&self) -> Vec<String> {
        let (min, max, step) = self.times_s();
        let exposure = match self.times {
            Some(_) => format!("exposure {} to {} s in steps of {} s", short(min), short(max), short(step)),
            None => format!("exposure {} s, which cannot be set", short(min)),
        };
        let gain = match (self.gains, self.is_gain_unknown) {
            (Some(_), _) => format!("gain 1 to {}", short(self.max_gain())),
            (None, true) => {
                "gain stays at its least: give camera.max_gain, what the control's largest value makes of 1".into()
            }
            (None, false) => "no gain control".into(),
        };
        let white = match &self.white[..] {
            [] => "no white balance control".into(),
            all => all.iter().map(|(name, value, unit)| format!("{name} {value}{unit}")).collect::<Vec<_>>().join(", "),
        };
        vec![exposure, gain, white]
    }
}

/// What a device's controls take and what they have now; nothing is changed.
pub(in crate::camera::v4l2) fn listed(controls: &impl Controls) -> Vec<String> {
    let mut lines = Vec::new();
    if let Ok(range) = controls.query(id::EXPOSURE_ABSOLUTE) {
        let seconds = |code: i64| short(code as f64 * ABSOLUTE_UNIT_S);
        let is_automatic = controls.query(id::EXPOSURE_AUTO).is_ok()
            && !MANUAL_MODES.iter().any(|&mode| controls.offers(id::EXPOSURE_AUTO, mode));
        let note = if is_automatic { ", automatic only" } else { "" };
        lines.push(format!("exposure {} to {} s{note}", seconds(range.min), seconds(range.max)));
    }
    for (id, name, unit) in COUNTED {
        let Ok(range) = controls.query(id) else { continue };
        let now = controls.get(id).map_or_else(|_| String::new(), |value| format!(", now {value}"));
        lines.push(format!("{name} {} to {}{unit}{now}", range.min, range.max));
    }
    lines
}

/// A number with three digits that count, without zeros behind.
pub(in crate::camera::v4l2) fn short(value: f64) -> String {
    if value <= 0.0 || !value.is_finite() {
        return "0".into();
    }
    let decimals = (2 - value.log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}
