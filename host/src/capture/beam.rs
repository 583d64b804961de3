//! How much of the sun's beam comes through what is before it, while the disc saturates the camera.
//!
//! The clear sky shines brightest around the sun, and every lens scatters a share of the disc around it, its halo. A cloud before
//! both dims the aureole as it dims the beam, and puts light of its own over it, which changes less over a few degrees; the halo
//! is the disc's own light and dims with nothing but the beam. So the radiance within some degrees of the sun is taken
//! apart, in all channels at once and by least squares that look at the nearest most, into
//!   passed * (clear sky of the model) + share * (halo) + (colour of all light above the clouds) * (constant + slopes + bulge),
//! where passed and share are held together by a weak tie: it decides where a lens has no halo.
//! - The halo is learnt under clear skies (`capture/halo.rs`). Until then a bell of any height stands for it, which says nothing
//!   of the share; the passed light does.
//! - Where the pixels next to the disc look as a clear sun makes them, the sun is clear, whatever the cloud beside it does.

use super::clearsky::Clear;
use super::halo::Halo;
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
/// Shares of the sky around the sun that must look clear for its halo to be learnt, and for one to be guessed.
const CLEAR_AROUND: f64 = 0.8;
const HALF_CLEAR_AROUND: f64 = 0.5;
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

/// Looks at what is around the sun.
#[derive(Clone, Debug, Default)]
pub(super) struct Beam {
    pub halo: Halo,
    /// Scratch: pixels by their place and what a clear sky would show there.
    places: Vec<Place>,
}

/// A pixel with its place from the sun, degrees to the side and up, and the modelled sky there in the measured unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub at_deg: [f32; 2],
    pub omega: f32,
    pub value: [f32; 3],
    pub clear: [f32; 3],
    pub halo: [f32; 3],
}

impl Place {
    pub fn apart_deg(&self) -> f32 {
        self.at_deg[0].hypot(self.at_deg[1])
    }
}

impl Beam {
    /// Share of the clear-sky beam, 0..=1; none where too little is seen around the sun.
    pub(super) fn look(&mut self, near: &[Near], clear: &Clear) -> Option<f64> {
        self.places.clear();
        if near.len() < 8 * TERMS {
            return None;
        }
        self.take_places(near, clear);
        if clear.around_sun >= CLEAR_AROUND {
            self.halo.learn(&self.places, clear.beam);
        } else if !self.halo.is_known() && clear.around_sun >= HALF_CLEAR_AROUND {
            self.halo.guess(&self.places, clear.beam);
        }
        let is_halo_known = self.halo.is_known();
        for place in &mut self.places {
            let apart_deg = place.apart_deg();
            let unknown = [(-apart_deg / UNKNOWN_DEG).exp(); 3];
            let halo = if is_halo_known { self.halo.at(apart_deg) } else { unknown };
            place.halo = std::array::from_fn(|k| halo[k] * clear.beam[k]);
        }
        let share = share(&self.places, white(clear), is_halo_known)?;
        if !is_halo_known {
            self.places.iter_mut().for_each(|place| place.halo = [0.0; 3]);
        }
        let next = if clear.is_known { clear_next_to_disc(&self.places) } else { 0.0 };
        Some(share + next * (1.0 - share))
    }

    /// The least radiance per channel that a clear sky would have shown in the pixels around the sun.
    pub fn least_clear(&self) -> [f32; 3] {
        let darker = |least: [f32; 3], place: &Place| std::array::from_fn(|k| least[k].min(place.clear[k]));
        self.places.iter().fold([f32::INFINITY; 3], darker)
    }

    fn take_places(&mut self, near: &[Near], clear: &Clear) {
        let axis = clear.dome.sun_dir();
        // East and north of the sun.
        let side = [-axis[2], 0.0, axis[0]];
        let level = side[0].hypot(side[2]).max(1e-6);
        let side = side.map(|c| c / level);
        let up = [axis[1] * side[2], axis[2] * side[0] - axis[0] * side[2], -axis[1] * side[0]];
        let along = |d: [f32; 3], e: [f32; 3]| (0..3).map(|k| d[k] * e[k]).sum::<f32>().to_degrees();
        self.places.reserve(MOST_NEAR);
        self.places.extend(near.iter().map(|pixel| Place {
            at_deg: [along(pixel.dir, side), along(pixel.dir, up)],
            omega: pixel.omega,
            value: pixel.value,
            clear: clear.dome.radiance(pixel.dir).map(|v| v * clear.unit as f32),
            halo: [0.0; 3],
        }));
    }
}

/// Colour of all light above the clouds, of luminance 1.
fn white(clear: &Clear) -> [f64; 3] {
    let (dome, height) = (clear.dome.horizontal_irradiance(), clear.dome.sun_dir()[1].max(0.0));
    let unit = clear.unit as f32;
    let white: [f32; 3] = std::array::from_fn(|k| unit * dome[k] + clear.beam[k] * height);
    let light = luminance(white).max(1e-12);
    white.map(|v| f64::from(v / light))
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
