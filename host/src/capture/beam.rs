//! How much of the sun's beam comes through what is before it, while the disc saturates the camera.
//!
//! The clear sky shines brightest around the sun, and every lens scatters a share of the disc around it, its halo. A cloud before
//! both dims the aureole as it dims the beam, and puts light of its own over it, which changes less over a few degrees; the halo
//! is the disc's own light and dims with nothing but the beam. So the radiance within some degrees of the sun is taken
//! apart, in all channels at once and by least squares that look at the nearest most, into
//!   passed * (clear sky of the model) + share * (halo) + (colour of all light above the clouds) * (constant + slopes + bulge),
//! where passed and share are held together by a weak tie: it decides where a lens has no halo.
//! - The halo is learnt whenever the sky is clear around the sun, ring by ring: what is beyond the model there, over the beam. An
//!   aureole that is not the model's is learnt with it. Until then a bell of any height stands for it, which says nothing of
//!   the share; the passed light does.
//! - Where the pixels next to the disc look as a clear sun makes them, the sun is clear, whatever the cloud beside it does.

use super::clearsky::Clear;
use super::sunspot::MOST_NEAR;
use crate::linear_system::solve;
use crate::map::luminance;

/// Radius within which the aureole is looked at, degrees.
pub(super) const AUREOLE_DEG: f64 = 7.0;
/// Width of the Gaussian by which nearer pixels count more, degrees.
const WIDTH_DEG: f32 = 3.0;
const TERMS: usize = 6;
/// What the tie of passed light and share weighs, over what is known of the passed light.
const TIE: f64 = 0.05;
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
/// Shares of the sky around the sun that must look clear for its halo to be learnt, and for one to be guessed.
const CLEAR_AROUND: f64 = 0.8;
const HALF_CLEAR_AROUND: f64 = 0.5;
/// A guessed halo falls over so many degrees by this factor at least, from this radiance over the beam at least.
const GUESS_DEG: f32 = 2.5;
const GUESS_FALL: f32 = 3.0;
const GUESS_LEAST: f32 = 0.05;
/// Length of the exponential that stands for an unknown halo, degrees.
const UNKNOWN_DEG: f32 = 1.5;
/// Pixels next to the disc count by a Gaussian of this width in their distance from the nearest, degrees; they look clear if no
/// channel's logarithm is off by more.
const NEXT_DEG: f32 = 1.0;
const LOOKS_CLEAR: f32 = 0.06;

/// One pixel near the sun.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    pub dir: [f32; 3],
    pub omega: f32,
    pub value: [f32; 3],
}

/// What was learnt of the lens from clear skies.
#[derive(Clone, Debug, Default)]
pub(super) struct Beam {
    /// Radiance around a clear sun beyond the model's, over the sun's irradiance, per ring.
    halo: [[f32; 3]; RINGS],
    /// Whether it was learnt or guessed, and how often learnt.
    is_known: bool,
    seen: u32,
    /// Scratch: pixels by their place and what a clear sky would show there, and a ring's values.
    places: Vec<Place>,
    ring: Vec<f32>,
}

/// A pixel with its place from the sun, degrees to the side and up, and the modelled sky there in the measured unit.
#[derive(Clone, Copy, Debug)]
struct Place {
    at_deg: [f32; 2],
    omega: f32,
    value: [f32; 3],
    clear: [f32; 3],
    halo: [f32; 3],
}

impl Place {
    fn apart_deg(&self) -> f32 {
        self.at_deg[0].hypot(self.at_deg[1])
    }
}

impl Beam {
    /// Share of the clear-sky beam, 0..=1; none where too little is seen around the sun.
    pub(super) fn look(&mut self, near: &[Near], clear: &Clear) -> Option<f64> {
        if near.len() < 8 * TERMS {
            return None;
        }
        self.take_places(near, clear);
        if clear.around_sun >= CLEAR_AROUND {
            self.learn(clear.beam);
        } else if !self.is_known && clear.around_sun >= HALF_CLEAR_AROUND {
            self.guess(clear.beam);
        }
        let is_halo_known = self.is_known;
        for place in &mut self.places {
            let apart_deg = place.apart_deg();
            let unknown = [(-apart_deg / UNKNOWN_DEG).exp(); 3];
            let halo = if is_halo_known { halo_at(&self.halo, apart_deg) } else { unknown };
            place.halo = std::array::from_fn(|k| halo[k] * clear.beam[k]);
        }
        let share = share(&self.places, white(clear), is_halo_known)?;
        if !is_halo_known {
            self.places.iter_mut().for_each(|place| place.halo = [0.0; 3]);
        }
        let next = if clear.is_known { clear_next_to_disc(&self.places) } else { 0.0 };
        Some(share + next * (1.0 - share))
    }

    fn take_places(&mut self, near: &[Near], clear: &Clear) {
        let axis = clear.model.sun_dir();
        // East and north of the sun.
        let side = [-axis[2], 0.0, axis[0]];
        let level = side[0].hypot(side[2]).max(1e-6);
        let side = side.map(|c| c / level);
        let up = [axis[1] * side[2], axis[2] * side[0] - axis[0] * side[2], -axis[1] * side[0]];
        let along = |d: [f32; 3], e: [f32; 3]| (0..3).map(|k| d[k] * e[k]).sum::<f32>().to_degrees();
        self.places.clear();
        self.places.reserve(MOST_NEAR);
        self.places.extend(near.iter().map(|pixel| Place {
            at_deg: [along(pixel.dir, side), along(pixel.dir, up)],
            omega: pixel.omega,
            value: pixel.value,
            clear: clear.model.radiance(pixel.dir).map(|v| v * clear.unit as f32),
            halo: [0.0; 3],
        }));
    }

    /// Takes in what a clear sun has around it: per ring the median over its pixels.
    fn learn(&mut self, beam: [f32; 3]) {
        let follow = if self.seen < SEEN_OFTEN { 1.0 / (self.seen + 1) as f32 } else { FOLLOW };
        let mut outer = None;
        for number in (0..RINGS).rev() {
            for k in 0..3 {
                let (places, ring) = (&self.places, &mut self.ring);
                let in_ring = places.iter().filter(|place| (place.apart_deg() / RING_DEG).round() as usize == number);
                ring.clear();
                ring.reserve(MOST_NEAR);
                ring.extend(in_ring.map(|place| (place.value[k] - place.clear[k]) / beam[k].max(1e-12)));
                let halo = &mut self.halo[number][k];
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
            outer = Some(self.halo[number]);
        }
        self.seen = self.seen.saturating_add(1);
        self.is_known = true;
    }

    /// Takes a halo for the lens's, until one is learnt, from a sun in a sky that is only partly clear around it, if it falls
    /// outwards from well above the sky: before a cloud none does.
    fn guess(&mut self, beam: [f32; 3]) {
        self.learn(beam);
        let nearest = self.places.iter().map(Place::apart_deg).fold(f32::INFINITY, f32::min);
        let [inner, outer] = [nearest, nearest + GUESS_DEG].map(|deg| luminance(halo_at(&self.halo, deg)));
        self.is_known = outer > 0.0 && inner > GUESS_FALL * outer && inner > GUESS_LEAST;
        self.seen = 0;
    }
}

/// Colour of all light above the clouds, of luminance 1.
fn white(clear: &Clear) -> [f64; 3] {
    let white = clear.model.horizontal_irradiance();
    let light = luminance(white).max(1e-12);
    white.map(|v| f64::from(v / light))
}

fn halo_at(halo: &[[f32; 3]; RINGS], apart_deg: f32) -> [f32; 3] {
    let at = (apart_deg / RING_DEG).clamp(0.0, (RINGS - 1) as f32);
    let (low, part) = (at as usize, at.fract());
    let high = (low + 1).min(RINGS - 1);
    std::array::from_fn(|k| halo[low][k] + part * (halo[high][k] - halo[low][k]))
}

/// Share of the beam in the radiance around the sun: the halo's, or the passed light's where the halo is not known.
fn share(places: &[Place], white: [f64; 3], is_halo_known: bool) -> Option<f64> {
    let (mut a, mut b) = ([[0.0; TERMS]; TERMS], [[0.0; 1]; TERMS]);
    for place in places {
        let [u, v] = place.at_deg.map(|deg| deg / WIDTH_DEG);
        let bell = (-0.5 * (u * u + v * v)).exp();
        let mean = |rgb: [f32; 3]| f64::from(rgb.iter().sum::<f32>()) / 3.0;
        let scale = mean(place.clear).hypot(mean(place.value));
        let weight = f64::from(bell * place.omega) / (scale * scale).max(1e-24);
        let shape = [1.0, u, v, u * u + v * v].map(f64::from);
        for (k, white) in white.iter().enumerate() {
            let [clear, halo] = [place.clear[k], place.halo[k]].map(f64::from);
            let cloud = shape.map(|s| white * s);
            let row = [clear, halo, cloud[0], cloud[1], cloud[2], cloud[3]];
            for i in 0..TERMS {
                a[i] = std::array::from_fn(|j| a[i][j] + weight * row[i] * row[j]);
                b[i][0] += weight * row[i] * f64::from(place.value[k]);
            }
        }
    }
    let tie = if is_halo_known { TIE * a[0][0] } else { 0.0 };
    for (i, j, sign) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)] {
        a[i][j] += sign * tie;
    }
    for (i, row) in a.iter_mut().enumerate() {
        row[i] *= 1.0 + 1e-9;
        row[i] += 1e-30;
    }
    let found = solve(a, b)[usize::from(is_halo_known)][0];
    found.is_finite().then(|| found.clamp(0.0, 1.0))
}

/// Share of the pixels next to the disc that look as a clear sun makes them.
fn clear_next_to_disc(places: &[Place]) -> f64 {
    let nearest = places.iter().map(Place::apart_deg).fold(f32::INFINITY, f32::min);
    let (mut clear, mut all) = (0.0, 0.0);
    for place in places {
        let beyond = (place.apart_deg() - nearest) / NEXT_DEG;
        let weight = f64::from(place.omega * (-0.5 * beyond * beyond).exp());
        let is_off = |k: usize| {
            let expected = (place.clear[k] + place.halo[k]).max(1e-12);
            (place.value[k].max(1e-12) / expected).ln().abs() > LOOKS_CLEAR
        };
        all += weight;
        clear += if (0..3).any(is_off) { 0.0 } else { weight };
    }
    clear / f64::max(all, 1e-30)
}
