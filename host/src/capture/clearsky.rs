//! What the clear sky between clouds tells: haze, the unit of the measured sky, and whether it is clear around the sun.
//!
//! If the model's haze is the sky's own, measured over modelled luminance is one factor, the unit, wherever a patch shows clear
//! sky; clouds lie anywhere. So the haze is that for which a quarter of the patches agrees best: whose shortest interval that
//! holds a quarter of the logarithms (Rousseeuw & Leroy 1988, the shorth, of another share) is shortest. The unit is that
//! interval's median. An overcast sky tells nothing, and what was known stays.
//!
//! Real clear skies are not the model's either, so that the length of the interval is weighed against how far the haze is from
//! what the settings say: the most probable turbidity, if lengths are normal and turbidities log-normal.

use super::CaptureSettings;
use crate::map::luminance;
use crate::skymodel::{ClearDome, clear_beam};
use crate::sun::{SunPosition, angle_deg};
use relume_firmware::patches::PatchSet;

/// Share of the patches that must agree.
const AGREEING: f64 = 0.25;
/// They agree if their logarithms lie within this.
const TIGHT: f64 = 0.2;
/// Turbidities that are tried before any is known: from the first up, each times the factor.
const FIRST: (f64, f64, i32) = (1.7, 1.2, 10);
/// Turbidities beside the known one, as a factor; and how much less unlikely one must be to take its place.
const STEP: f64 = 1.06;
const BETTER: f64 = 0.98;
/// Standard deviations of the interval's length and of a turbidity's logarithm from that of the settings.
const LENGTH_SIGMA: f64 = 0.07;
const TURBIDITY_SIGMA: f64 = 0.5;
/// Most steps at once.
const STEPS: usize = 12;
/// Part of the way that haze and unit go to newly seen ones of patches that agree entirely.
const FOLLOW: f64 = 0.3;
/// Around the sun are the patches at these angles from it, degrees; they are clear within so much of the unit in every channel.
const AROUND_DEG: [f64; 2] = [9.0, 25.0];
const AROUND_LOG: f64 = 0.1;
const LEAST_AROUND: usize = 4;

/// What has been learnt of the clear sky.
#[derive(Clone, Debug, Default)]
pub(super) struct ClearSky {
    /// Turbidity and unit.
    known: Option<(f64, f64)>,
    /// Scratch: logarithms of measured over modelled luminance.
    logs: Vec<f64>,
}

/// A turbidity that was tried: the unit and the width of the interval that it comes with, and twice the negative logarithm of its
/// probability, but for a constant.
struct Haze {
    turbidity: f64,
    unit: f64,
    width: f64,
    unlikely: f64,
}

/// The clear sky of one moment, as far as it is known.
pub(super) struct Clear {
    pub dome: ClearDome,
    /// Measured over modelled radiance.
    pub unit: f64,
    /// Whether haze and unit were ever seen; else they are the settings' and the lower quartile's (clouds are brighter than the
    /// clear sky behind them).
    pub is_known: bool,
    /// Share of the sky around the sun that shows to be clear, 0..=1.
    pub around_sun: f64,
    /// The sun's irradiance on a plane normal to it, in the measured sky's unit.
    pub beam: [f32; 3],
}

/// A measured sky under a sun.
pub(super) struct Measured<'m> {
    pub set: &'m PatchSet,
    pub radiance: &'m [[f32; 3]],
    pub sun: SunPosition,
    pub settings: &'m CaptureSettings,
}

impl Measured<'_> {
    fn dome(&self, turbidity: f64) -> ClearDome {
        ClearDome::new(turbidity as f32, self.settings.ground_albedo, self.sun, self.settings.north_deg)
    }

    /// Logarithm of measured over modelled luminance of an upper patch.
    fn log(&self, dome: &ClearDome, patch: usize) -> f64 {
        let modelled = luminance(dome.radiance(self.set.dir_world(patch))).max(1e-12);
        f64::from(luminance(self.radiance[patch]).max(1e-12) / modelled).ln()
    }
}

impl ClearSky {
    /// Learns from a measured sky and tells what the clear sky is like.
    pub fn look(&mut self, measured: &Measured<'_>) -> Clear {
        let own = f64::from(measured.settings.turbidity);
        let likeliest = self.likeliest(measured, own);
        let is_tight = likeliest.width <= TIGHT;
        if is_tight {
            self.learn(&likeliest);
        }
        let turbidity = self.known.map_or(own, |(turbidity, _)| turbidity);
        let dome = measured.dome(turbidity);
        let unit = self.known.map_or_else(|| self.lower_quartile(measured, &dome), |(_, unit)| unit);
        let beam = clear_beam(measured.sun.altitude_deg as f32, turbidity as f32).map(|v| v * unit as f32);
        let around_sun = if is_tight { clear_around(measured, &dome, unit) } else { 0.0 };
        Clear { dome, unit, is_known: self.known.is_some(), around_sun, beam }
    }

    /// Takes in what a moment told: the closer its patches agree, the more.
    fn learn(&mut self, found: &Haze) {
        let part = FOLLOW * (1.0 - found.width / TIGHT);
        self.known = Some(self.known.map_or((found.turbidity, found.unit), |(old_turbidity, old_unit)| {
            (old_turbidity + part * (found.turbidity - old_turbidity), old_unit + part * (found.unit - old_unit))
        }));
    }

    /// The likeliest turbidity: from the known one, or the best of all over the range, to its neighbours for as long as they are
    /// likelier.
    fn likeliest(&mut self, measured: &Measured<'_>, own: f64) -> Haze {
        let mut best = self.haze(measured, self.known.map_or(own, |(turbidity, _)| turbidity));
        if self.known.is_none() {
            for step in 0..FIRST.2 {
                self.improve(measured, FIRST.0 * FIRST.1.powi(step), &mut best);
            }
        }
        for factor in [STEP, 1.0 / STEP] {
            let from = best.turbidity;
            for _ in 0..STEPS {
                if !self.improve(measured, (best.turbidity * factor).clamp(1.7, 10.0), &mut best) {
                    break;
                }
            }
            if best.turbidity > from {
                // What lies behind is known to be less likely.
                break;
            }
        }
        best
    }

    /// Whether another turbidity is plainly likelier; takes it then.
    fn improve(&mut self, measured: &Measured<'_>, turbidity: f64, best: &mut Haze) -> bool {
        let other = self.haze(measured, turbidity);
        let is_better = other.unlikely < BETTER * best.unlikely;
        if is_better {
            *best = other;
        }
        is_better
    }

    /// How well a turbidity fits.
    fn haze(&mut self, measured: &Measured<'_>, turbidity: f64) -> Haze {
        let (width, unit) = self.agreement(measured, &measured.dome(turbidity));
        let from_settings = (turbidity / f64::from(measured.settings.turbidity)).ln();
        let unlikely = (width / LENGTH_SIGMA).powi(2) + (from_settings / TURBIDITY_SIGMA).powi(2);
        Haze { turbidity, unit, width, unlikely }
    }

    /// Width of the shortest interval that holds the agreeing patches' logarithms, and the unit in its middle.
    fn agreement(&mut self, measured: &Measured<'_>, dome: &ClearDome) -> (f64, f64) {
        self.take_logs(measured, dome);
        let count = ((AGREEING * self.logs.len() as f64) as usize).max(1);
        let widths = self.logs.iter().zip(self.logs.iter().skip(count)).map(|(low, high)| high - low);
        let best = widths.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((at, width)) = best else { return (f64::INFINITY, 1.0) };
        (width, self.logs[at + count / 2].exp())
    }

    fn lower_quartile(&mut self, measured: &Measured<'_>, dome: &ClearDome) -> f64 {
        self.take_logs(measured, dome);
        self.logs.get(self.logs.len() / 4).map_or(1.0, |log| log.exp())
    }

    fn take_logs(&mut self, measured: &Measured<'_>, dome: &ClearDome) {
        self.logs.clear();
        self.logs.extend((0..measured.set.upper()).map(|patch| measured.log(dome, patch)));
        self.logs.sort_unstable_by(f64::total_cmp);
    }
}

/// Share of the patches around the sun that are clear.
fn clear_around(measured: &Measured<'_>, dome: &ClearDome, unit: f64) -> f64 {
    let (mut clear, mut all) = (0, 0);
    for patch in 0..measured.set.upper() {
        let dir = measured.set.dir_world(patch);
        let apart = angle_deg(dir, dome.sun_dir());
        if (AROUND_DEG[0]..AROUND_DEG[1]).contains(&apart) {
            all += 1;
            clear += usize::from(looks_clear(measured.radiance[patch], dome.radiance(dir), unit));
        }
    }
    if all < LEAST_AROUND { 0.0 } else { clear as f64 / all as f64 }
}

fn looks_clear(found: [f32; 3], modelled: [f32; 3], unit: f64) -> bool {
    let log = |k: usize| (f64::from(found[k].max(1e-12) / modelled[k].max(1e-12)) / unit).ln();
    (0..3).all(|k| log(k).abs() < AROUND_LOG)
}
