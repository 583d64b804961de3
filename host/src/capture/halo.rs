//! What a lens scatters of the sun's disc around it, ring by ring: radiance over the sun's irradiance.
//!
//! - It is learnt whenever the sky is clear around the sun: what is beyond the model there, over the beam. An aureole that is
//!   not the model's is learnt with it. Until then a sky that is half clear may let it be guessed.
//! - The sun's irradiance counts all light of the disc, this too: it is taken out of the sky.

use super::beam::Place;
use super::sunspot::MOST_NEAR;
use crate::map::luminance;
use std::f32::consts::TAU;

/// Rings of the halo, and their distance.
const RINGS: usize = 15;
const RING_DEG: f32 = 0.5;
/// Pixels that a ring needs to be learnt from.
const LEAST_IN_RING: usize = 4;
/// Part of the way that the halo goes to a newly seen one, once it has been seen so often; and the most that it goes at once,
/// over itself and over the beam: a small cloud that is taken for clear sky must not count for much.
const FOLLOW: f32 = 0.1;
const SEEN_OFTEN: u32 = 10;
const MOST: [f32; 2] = [0.03, 0.002];
/// A guessed halo falls over so many degrees by this factor at least, from this radiance over the beam at least.
const GUESS_DEG: f32 = 2.5;
const GUESS_FALL: f32 = 3.0;
const GUESS_LEAST: f32 = 0.05;
/// Most of the beam that a lens is believed to scatter into the rings; more is the sky's own.
const MOST_SCATTERED: f32 = 0.03;

/// What was learnt of a lens from clear skies.
#[derive(Clone, Debug, Default)]
pub(super) struct Halo {
    rings: [[f32; 3]; RINGS],
    /// Whether it was learnt or guessed, and how often learnt.
    is_known: bool,
    seen: u32,
    /// Scratch: a ring's values.
    ring: Vec<f32>,
}

impl Halo {
    /// Whether it was learnt or guessed.
    pub fn is_known(&self) -> bool {
        self.is_known
    }

    /// Radiance over the sun's irradiance so far from the sun, sr^-1; negative where the sky is darker than the model's.
    pub fn at(&self, apart_deg: f32) -> [f32; 3] {
        let at = (apart_deg / RING_DEG).clamp(0.0, (RINGS - 1) as f32);
        let (low, part) = (at as usize, at.fract());
        let high = (low + 1).min(RINGS - 1);
        std::array::from_fn(|k| self.rings[low][k] + part * (self.rings[high][k] - self.rings[low][k]))
    }

    /// Takes in what a clear sun has around it: per ring the median over its pixels.
    pub fn learn(&mut self, places: &[Place], beam: [f32; 3]) {
        let follow = if self.seen < SEEN_OFTEN { 1.0 / (self.seen + 1) as f32 } else { FOLLOW };
        let mut outer = None;
        for number in (0..RINGS).rev() {
            for k in 0..3 {
                let ring = &mut self.ring;
                let in_ring = places.iter().filter(|place| (place.apart_deg() / RING_DEG).round() as usize == number);
                ring.clear();
                ring.reserve(MOST_NEAR);
                ring.extend(in_ring.map(|place| (place.value[k] - place.clear[k]) / beam[k].max(1e-12)));
                let halo = &mut self.rings[number][k];
                if ring.len() >= LEAST_IN_RING {
                    ring.sort_unstable_by(f32::total_cmp);
                    let step = follow * (ring[ring.len() / 2] - *halo);
                    let most = if self.seen < SEEN_OFTEN { f32::INFINITY } else { MOST[0] * halo.abs() + MOST[1] };
                    *halo += step.clamp(-most, most);
                } else if self.seen == 0 {
                    // Within the disc's own blob nothing is seen, and nothing asked.
                    *halo = outer.map_or(0.0, |rgb: [f32; 3]| rgb[k]);
                }
            }
            outer = Some(self.rings[number]);
        }
        self.seen = self.seen.saturating_add(1);
        self.is_known = true;
    }

    /// Takes a halo for the lens's, until one is learnt, from a sun in a sky that is only partly clear around it, if it falls
    /// outwards from well above the sky: before a cloud none does.
    pub fn guess(&mut self, places: &[Place], beam: [f32; 3]) {
        self.learn(places, beam);
        let nearest = places.iter().map(Place::apart_deg).fold(f32::INFINITY, f32::min);
        let [inner, outer] = [nearest, nearest + GUESS_DEG].map(|deg| luminance(self.at(deg)));
        self.is_known = outer > 0.0 && inner > GUESS_FALL * outer && inner > GUESS_LEAST;
        self.seen = 0;
    }

    /// The part of it that is believed to be scattered light, 0..=1, if any is known.
    pub fn believed(&self) -> Option<f32> {
        let ring_sr = |number: usize| {
            let edge = |at: f32| ((at * RING_DEG).to_radians()).cos();
            TAU * (edge((number as f32 - 0.5).max(0.0)) - edge(number as f32 + 0.5))
        };
        let all: f32 = (0..RINGS).map(|number| luminance(self.rings[number]).max(0.0) * ring_sr(number)).sum();
        (self.is_known && all > 0.0).then(|| (MOST_SCATTERED / all).min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEAM: [f32; 3] = [100.0, 90.0, 80.0];

    /// A halo learnt from an even sky of 5 and light around the sun, over its beam.
    fn learnt(around: impl Fn(f32) -> f32) -> Halo {
        let place = |i: i32| {
            let at_deg = [(i % 60 - 30) as f32 * 0.25, (i / 60 - 30) as f32 * 0.25];
            let value = BEAM.map(|beam| 5.0 + beam * around(at_deg[0].hypot(at_deg[1])));
            Place { at_deg, omega: 2e-5, value, clear: [5.0; 3], halo: [0.0; 3] }
        };
        let places: Vec<Place> = (0..3600).map(place).collect();
        let mut halo = Halo::default();
        halo.learn(&places, BEAM);
        halo
    }

    #[test]
    fn a_halo_is_learnt_ring_by_ring() {
        let halo = learnt(|deg| (-deg / 2.0).exp());
        for deg in [1.0f32, 2.5, 4.0, 6.5] {
            let (found, truth) = (halo.at(deg)[2], (-deg / 2.0).exp());
            assert!((found / truth - 1.0).abs() < 0.05, "{deg}: {found} {truth}");
        }
    }

    #[test]
    fn no_lens_is_believed_to_scatter_more_than_some_hundredths() {
        assert_eq!(Halo::default().believed(), None);
        assert_eq!(learnt(|_| 0.0).believed(), None, "a clean lens");
        // Even light within 7.25 degrees: 2 pi (1 - cos) of it.
        let cap_sr = std::f32::consts::TAU * (1.0 - 7.25f32.to_radians().cos());
        for scattered in [0.01, 0.02, 0.06, 0.2] {
            let found = learnt(|_| scattered / cap_sr).believed().unwrap() * scattered;
            assert!((found - scattered.min(MOST_SCATTERED)).abs() < 2e-4, "{scattered}: {found}");
        }
    }
}
