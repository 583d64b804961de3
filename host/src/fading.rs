//! What becomes of the light when the sky tells nothing for long: the last good weights are held for two minutes, then
//! they go over, within ten, into a model of the last sky, which follows the time of day.
//!
//! The model is a mixture of the clear sky (`skymodel.rs`) and an overcast one (CIE standard overcast sky, ISO
//! 15469:2004: L ~ 1 + 2 sin altitude, lit by the clear sky's horizontal irradiance), fitted to the last good weights by
//! least squares, with its level and colour. The sun keeps the share of its clear-sky beam that it had.

use crate::clock::Moment;
use crate::config::{Site, Weather};
use crate::map::luminance;
use crate::skymodel::{Atmosphere, SkyModel, clear_beam};
use crate::sun::sun_position;
use crate::weights::{PatchWeights, SunWeight};
use relume_firmware::patches::PatchSet;
use std::f32::consts::PI;

/// For so long the last good weights are held, seconds.
pub const HOLD_S: f64 = 120.0;
/// Within so long they fade to the model, seconds.
pub const FADE_S: f64 = 600.0;
/// The model's light is worked out anew so often, seconds.
const STEP_S: f64 = 10.0;

/// Fades light to a model of it.
#[derive(Debug)]
pub struct Fading {
    site: Site,
    turbidity: f32,
    patches: PatchSet,
    north_deg: f64,
    last: Option<Last>,
}

/// The last good light and its model.
#[derive(Debug)]
struct Last {
    weights: PatchWeights,
    /// Parts of the clear and the overcast sky.
    parts: [f32; 2],
    tint: [f32; 3],
    /// Share of the clear-sky beam.
    sun: f32,
    stepped_s: f64,
}

/// Clear and overcast sky of one moment, and the clear beam with the sun's direction.
struct Model {
    clear: SkyModel,
    zenith: [f32; 3],
}

impl Model {
    fn clear(&self, dir: [f32; 3]) -> [f32; 3] {
        self.clear.radiance(dir)
    }

    /// E = 7 pi / 9 L at the zenith.
    fn overcast(&self, dir: [f32; 3]) -> [f32; 3] {
        self.zenith.map(|v| v * (1.0 + 2.0 * dir[1].max(0.0)) / 3.0)
    }
}

impl Fading {
    /// For a site; `north_deg` as in the field's camera.
    pub fn new(site: Site, weather: Weather, patches: PatchSet, north_deg: f64) -> Self {
        Fading { site, turbidity: weather.turbidity as f32, patches, north_deg, last: None }
    }

    /// There is fresh light.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// The light at a moment, where another than is shown is due, into `into`; the model's share of it, 0..=1. `held` were
    /// the last good weights, of `held_unix_s`. Without a trusted clock they are held for ever.
    pub fn step(
        &mut self,
        held: &PatchWeights,
        held_unix_s: f64,
        moment: Moment,
        into: &mut PatchWeights,
    ) -> Option<f64> {
        let age_s = moment.unix_s - held_unix_s;
        if age_s <= HOLD_S || !moment.trusted {
            return None;
        }
        if self.last.is_none() {
            let model = self.model(held_unix_s)?;
            self.last = Some(self.fit(held, &model));
        }
        let model = self.model(moment.unix_s)?;
        let last = self.last.as_mut().filter(|last| (moment.unix_s - last.stepped_s).abs() >= STEP_S)?;
        last.stepped_s = moment.unix_s;
        let t = ((age_s - HOLD_S) / FADE_S).clamp(0.0, 1.0);
        let share = t * t * (3.0 - 2.0 * t);
        self.mix(share as f32, &model, into)?;
        Some(share)
    }

    fn model(&self, unix_s: f64) -> Option<Model> {
        let position = sun_position(unix_s, self.site.place).ok()?;
        let ground_albedo = [self.site.ground_albedo as f32; 3];
        let atmosphere = Atmosphere { turbidity: self.turbidity, ground_albedo, ..Atmosphere::default() };
        let clear = SkyModel::new(atmosphere, position, self.north_deg, 0.0);
        let zenith = clear.horizontal_irradiance().map(|v| v * 9.0 / (7.0 * PI));
        Some(Model { clear, zenith })
    }

    fn fit(&self, held: &PatchWeights, model: &Model) -> Last {
        let (mut cc, mut co, mut oo, mut lc, mut lo) = (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for patch in 0..self.patches.upper() {
            let dir = self.patches.dir_world(patch);
            let [l, c, o] =
                [held.radiance[patch], model.clear(dir), model.overcast(dir)].map(|v| f64::from(luminance(v)));
            let w = f64::from(self.patches.solid_angle_sr(patch));
            (cc, co, oo, lc, lo) = (cc + w * c * c, co + w * c * o, oo + w * o * o, lc + w * l * c, lo + w * l * o);
        }
        let determinant = (cc * oo - co * co).max(1e-30);
        let parts = [(lc * oo - lo * co) / determinant, (lo * cc - lc * co) / determinant];
        let parts = match parts {
            [clear, _] if clear < 0.0 => [0.0, lo / oo.max(1e-30)],
            [_, overcast] if overcast < 0.0 => [lc / cc.max(1e-30), 0.0],
            both => both,
        };
        let parts = parts.map(|part| part.max(0.0) as f32);
        let (mut found, mut modelled) = ([0.0f32; 3], [0.0f32; 3]);
        for patch in 0..self.patches.upper() {
            let sky = sky(model, parts, self.patches.dir_world(patch));
            let omega = self.patches.solid_angle_sr(patch);
            found = std::array::from_fn(|k| found[k] + omega * held.radiance[patch][k]);
            modelled = std::array::from_fn(|k| modelled[k] + omega * sky[k]);
        }
        let tint = std::array::from_fn(|k| if modelled[k] > 0.0 { found[k] / modelled[k] } else { 1.0 });
        Last {
            sun: self.sun_share(held, model, parts),
            weights: held.clone(),
            parts,
            tint,
            stepped_s: f64::NEG_INFINITY,
        }
    }

    /// What the sun had of its clear-sky beam; if it was below the horizon, as much as the sky was clear.
    fn sun_share(&self, held: &PatchWeights, model: &Model, [clear, overcast]: [f32; 2]) -> f32 {
        let beam = self.beam(model).map_or(0.0, |(_, beam)| luminance(beam));
        match held.sun {
            Some(sun) if beam > 0.0 => luminance(sun.irradiance) / beam,
            None if beam > 0.0 => 0.0,
            _ if clear + overcast > 0.0 => clear * clear / (clear + overcast),
            _ => 0.0,
        }
    }

    /// The sun's direction and clear-sky beam while it is up.
    fn beam(&self, model: &Model) -> Option<([f32; 3], [f32; 3])> {
        let dir = model.clear.sun_dir();
        let altitude_deg = dir[1].asin().to_degrees();
        let beam = clear_beam(altitude_deg, self.turbidity);
        let level = dir[0].hypot(dir[2]).max(1e-6);
        let dir = if dir[1] < 0.0 { [dir[0] / level, 0.0, dir[2] / level] } else { dir };
        (luminance(beam) > 0.0).then_some((dir, beam))
    }

    /// The last weights with so much of the model in them.
    fn mix(&self, share: f32, model: &Model, into: &mut PatchWeights) -> Option<()> {
        let last = self.last.as_ref()?;
        into.radiance.clone_from(&last.weights.radiance);
        let between = |old: f32, new: f32| old + share * (new - old);
        for patch in 0..self.patches.upper() {
            let sky = sky(model, last.parts, self.patches.dir_world(patch));
            let value = &mut into.radiance[patch];
            *value = std::array::from_fn(|k| between(value[k], last.tint[k] * sky[k]));
        }
        let shines = |irradiance: &[f32; 3]| luminance(*irradiance) > 0.0;
        let old = last.weights.sun.map_or([0.0; 3], |sun| sun.irradiance);
        into.sun = self.beam(model).and_then(|(dir_world, beam)| {
            let irradiance = std::array::from_fn(|k| between(old[k], last.sun * beam[k]));
            Some(irradiance).filter(shines).map(|irradiance| SunWeight { dir_world, irradiance })
        });
        let irradiance = into.horizontal_irradiance(&self.patches);
        let ground = irradiance.map(|e| (self.site.ground_albedo * e) as f32 / PI);
        into.radiance[self.patches.upper()..].fill(ground);
        Some(())
    }
}

/// A mixture in one direction.
fn sky(model: &Model, [clear, overcast]: [f32; 2], dir: [f32; 3]) -> [f32; 3] {
    let (a, b) = (model.clear(dir), model.overcast(dir));
    std::array::from_fn(|k| clear * a[k] + overcast * b[k])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sun::Place;

    const NOON: f64 = 1_782_043_200.0;

    fn fading() -> Fading {
        let place = Place { latitude_deg: 48.0, longitude_deg: 11.0 };
        let site = Site { place, elevation_m: 0.0, ground_albedo: 0.2 };
        Fading::new(site, Weather { turbidity: 3.0, cloud_cover: 0.0, seed: 1 }, PatchSet::new(256).unwrap(), 0.0)
    }

    /// A clear sky three times as bright as the model's, as a camera of another unit sees it.
    fn clear(fading: &Fading, unix_s: f64) -> PatchWeights {
        let mut weights = fading.model(unix_s).unwrap().clear.weights(&fading.patches);
        weights.radiance.iter_mut().flatten().for_each(|v| *v *= 3.0);
        weights.sun.iter_mut().for_each(|sun| sun.irradiance = sun.irradiance.map(|v| 3.0 * v));
        weights
    }

    fn light(weights: &PatchWeights) -> f64 {
        f64::from(luminance(weights.horizontal_irradiance(&PatchSet::new(256).unwrap()).map(|v| v as f32)))
    }

    #[test]
    fn light_is_held_then_fades_to_the_time_of_day() {
        let mut fading = fading();
        let (held, mut into) = (clear(&fading, NOON), PatchWeights::default());
        let mut at = |after_s: f64, trusted: bool| {
            let moment = Moment { unix_s: NOON + after_s, trusted };
            fading.step(&held, NOON, moment, &mut into).map(|share| (share, light(&into)))
        };
        assert_eq!(at(HOLD_S - 1.0, true), None);
        assert_eq!(at(HOLD_S + 100.0, false), None, "without time nothing is known");
        let (share, begun) = at(HOLD_S + 30.0, true).unwrap();
        assert!(share < 0.02 && (begun / light(&held) - 1.0).abs() < 0.01, "{share} {begun}");
        assert_eq!(at(HOLD_S + 31.0, true), None, "the next step is not due");
        // Five hours later it is afternoon, as bright as a clear sky is then.
        let (share, later) = at(5.0 * 3600.0, true).unwrap();
        let truth = light(&clear(&super::tests::fading(), NOON + 5.0 * 3600.0));
        assert!(share == 1.0 && (later / truth - 1.0).abs() < 0.03, "{later} {truth}");
        let (_, night) = at(12.0 * 3600.0, true).unwrap();
        assert!(night < 1e-3 * truth, "{night}");
    }

    #[test]
    fn a_grey_sky_stays_grey() {
        let mut fading = fading();
        let grey = |d: [f32; 3]| [1.0, 1.1, 1.2].map(|v| v * (1.0 + 2.0 * d[1]) / 3.0);
        let set = fading.patches;
        let radiance =
            (0..set.len()).map(|p| if p < set.upper() { grey(set.dir_world(p)) } else { [0.1; 3] }).collect();
        let (held, mut into) = (PatchWeights { radiance, sun: None }, PatchWeights::default());
        let moment = Moment { unix_s: NOON + HOLD_S + FADE_S, trusted: true };
        assert_eq!(fading.step(&held, NOON, moment, &mut into), Some(1.0));
        assert!(into.sun.is_none());
        for (found, held) in into.radiance.iter().zip(&held.radiance).take(set.upper()) {
            (0..3).for_each(|k| assert!((found[k] / held[k] - 1.0).abs() < 0.1, "{found:?} {held:?}"));
        }
    }
}
