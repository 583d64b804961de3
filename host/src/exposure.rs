//! Exposure: the factor from linear radiance to what a display takes as white.

/// Share of white that the 99th percentile is brought to.
const TARGET: f64 = 0.8;
/// Steps of the running exposure, stops.
const STEP_EV: f64 = 1.0 / 3.0;
/// How far the wanted exposure must leave the shown one before it is changed, stops.
const HOLD_EV: f64 = 0.5;
/// The range of exposures that keeps every factor a normal f32, stops.
pub const EV_RANGE: std::ops::RangeInclusive<f64> = -30.0..=30.0;

/// How a picture's exposure is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureMode {
    /// From the picture's own brightness.
    Auto,
    /// Always `2^EV`.
    Fixed(f64),
    /// As the view was exposed: from what it shows of receivers.
    View,
}

/// The automatic exposure of one picture: 0.8 / the 99th percentile of all channel values of covered pixels.
///
/// `rgb` is premultiplied linear radiance; a pixel is covered where `alpha > 0`. `None` when that percentile is not a
/// positive number, that is when the picture is dark or empty.
pub fn automatic(rgb: &[[f32; 3]], alpha: &[f32]) -> Option<f64> {
    let covered = rgb.iter().zip(alpha).filter(|(_, a)| **a > 0.0);
    let mut values: Vec<f32> = covered.flat_map(|(pixel, _)| *pixel).filter(|v| v.is_finite()).collect();
    automatic_of(&mut values)
}

/// The same of channel values that were chosen before; their order changes.
pub fn automatic_of(values: &mut [f32]) -> Option<f64> {
    let bright = percentile(values, 0.99)?;
    (bright > 0.0).then(|| (TARGET / bright).clamp(2f64.powf(*EV_RANGE.start()), 2f64.powf(*EV_RANGE.end())))
}

/// The value at rank `share * (n - 1)` of the sorted values, linear between neighbours; `None` of nothing.
fn percentile(values: &mut [f32], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let rank = share * last as f64;
    let (_, low, above) = values.select_nth_unstable_by(rank as usize, f32::total_cmp);
    let low = f64::from(*low);
    let high = above.iter().copied().min_by(f32::total_cmp).map_or(low, f64::from);
    Some(low + (high - low) * rank.fract())
}

/// Running automatic exposure: follows dawn and dusk in thirds of a stop and stays still for less than half a stop, so
/// that the picture neither drifts nor flickers with every cloud.
#[derive(Clone, Copy, Debug)]
pub struct ExposureControl {
    mode: ExposureMode,
    shown_ev: Option<f64>,
    /// The view's gain that is kept to, per channel.
    gain: Option<[f64; 3]>,
}

impl ExposureControl {
    /// A control that has shown nothing yet.
    pub fn new(mode: ExposureMode) -> Self {
        ExposureControl { mode, shown_ev: None, gain: None }
    }

    /// True when the exposure depends on how bright the picture is: also as long as nothing is known of the view's.
    pub fn is_auto(&self) -> bool {
        self.mode == ExposureMode::Auto || self.is_by_view() && self.gain.is_none()
    }

    /// True when the exposure is to be the view's.
    pub fn is_by_view(&self) -> bool {
        self.mode == ExposureMode::View
    }

    /// The exposure in use, as EV; 0 until a picture was seen.
    pub fn ev(&self) -> f64 {
        match self.mode {
            ExposureMode::Fixed(ev) => ev,
            ExposureMode::View if self.gain.is_some() => self.gain.map_or(0.0, |[_, green, _]| green.log2()),
            ExposureMode::Auto | ExposureMode::View => self.shown_ev.unwrap_or(0.0),
        }
    }

    /// The exposure in use, as a factor.
    pub fn factor(&self) -> f32 {
        2f64.powf(self.ev()) as f32
    }

    /// Takes the exposure that the newest picture asks for ([`automatic`]; `None` changes nothing).
    /// Returns true when the exposure in use changed.
    pub fn see(&mut self, wanted: Option<f64>) -> bool {
        let Some(wanted) = wanted.filter(|_| self.is_auto()) else { return false };
        let wanted_ev = wanted.log2();
        if self.shown_ev.is_some_and(|shown| (wanted_ev - shown).abs() <= HOLD_EV) {
            return false;
        }
        self.shown_ev = Some((wanted_ev / STEP_EV).round() * STEP_EV);
        true
    }
}

/// How far the view's gain must leave the one in use before it is changed, in natural logarithms: the measurement trembles by less,
/// and an eye does not see it.
const HOLD_GAIN: f64 = 0.02;

impl ExposureControl {
    /// Takes the newest gain of the view (linear light per radiance, red, green and blue; `None` changes nothing). Returns
    /// true when exposure or colour in use changed.
    pub fn see_gain(&mut self, gain: Option<[f64; 3]>) -> bool {
        let Some(gain) = gain.filter(|gain| self.is_by_view() && gain.iter().all(|g| g.is_finite() && *g > 0.0)) else {
            return false;
        };
        let is_near = |used: [f64; 3]| gain.iter().zip(used).all(|(new, old)| (new / old).ln().abs() <= HOLD_GAIN);
        if self.gain.is_some_and(is_near) {
            return false;
        }
        let range = 2f64.powf(*EV_RANGE.start())..=2f64.powf(*EV_RANGE.end());
        self.gain = Some(gain.map(|g| g.clamp(*range.start(), *range.end())));
        true
    }

    /// What the colours of the light are multiplied by, so that white is the view's: green by 1.
    pub fn colour(&self) -> [f32; 3] {
        self.gain.map_or([1.0; 3], |gain| gain.map(|g| (g / gain[1]) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn automatic_is_the_definition() {
        // 300 channel values 1..=300 on covered pixels: rank 0.99 * 299 = 296.01, value 297.01.
        let mut rgb: Vec<[f32; 3]> = (0..100).map(|i| [0, 1, 2].map(|c| (3 * i + c + 1) as f32)).collect();
        let mut alpha = vec![0.5; 100];
        rgb.push([1e6; 3]);
        alpha.push(0.0);
        let exposure = automatic(&rgb, &alpha).unwrap();
        assert!((exposure - 0.8 / 297.01).abs() < 1e-6, "{exposure}");
        assert_eq!(automatic(&[[0.0; 3]], &[1.0]), None);
        assert_eq!(automatic(&[], &[]), None);
    }

    #[test]
    fn small_changes_hold_and_large_ones_step() {
        let mut control = ExposureControl::new(ExposureMode::Auto);
        assert!(control.see(Some(2f64.powf(3.1))));
        assert!((control.ev() - 3.0).abs() < 1e-9);
        assert!(!control.see(Some(2f64.powf(3.45))));
        assert!(!control.see(None));
        assert!(control.see(Some(2f64.powf(3.55))));
        assert!((control.ev() - 11.0 / 3.0).abs() < 1e-9);
        assert!(!control.see(Some(2f64.powf(3.45))), "no flapping back");
    }

    #[test]
    fn a_dawn_of_fifteen_stops_is_followed_within_half_a_stop() {
        let mut control = ExposureControl::new(ExposureMode::Auto);
        let mut changes = 0;
        for i in 0..=1500 {
            let wanted_ev = 10.0 - 0.01 * f64::from(i);
            changes += u32::from(control.see(Some(2f64.powf(wanted_ev))));
            assert!((control.ev() - wanted_ev).abs() <= HOLD_EV + 1e-9);
        }
        assert!(changes < 50, "{changes}");
    }

    #[test]
    fn the_views_gain_is_followed_at_once_but_not_its_trembling() {
        let mut control = ExposureControl::new(ExposureMode::View);
        // Until the view tells something the picture itself does.
        assert!(control.is_auto() && control.see(Some(4.0)) && !control.see_gain(None));
        assert_eq!((control.factor(), control.colour()), (4.0, [1.0; 3]));
        assert!(control.see_gain(Some([1.5, 1.0, 0.8])) && !control.is_auto());
        assert_eq!((control.factor(), control.colour()), (1.0, [1.5, 1.0, 0.8]));
        assert!(!control.see_gain(Some([1.51, 1.015, 0.79])) && !control.see(Some(4.0)));
        assert!(control.see_gain(Some([3.0, 2.0, 1.6])));
        assert_eq!((control.factor(), control.colour()), (2.0, [1.5, 1.0, 0.8]));
        assert!(!control.see_gain(Some([f64::NAN, 2.0, 1.6])) && !control.see_gain(Some([0.0, 2.0, 1.6])));
        assert!(!ExposureControl::new(ExposureMode::Auto).see_gain(Some([1.0; 3])));
    }

    #[test]
    fn fixed_stays() {
        let mut control = ExposureControl::new(ExposureMode::Fixed(-2.0));
        assert!(!control.see(Some(64.0)));
        assert_eq!(control.factor(), 0.25);
    }
}
