//! The sun's place in a picture: what stands there above the sky around it.

use super::SkyPicture;
use super::beam::{AUREOLE_DEG, Near};
use crate::bracket::{Merged, PixelState};
use crate::lens::Lens;
use crate::map::luminance;
use crate::split::SUN_RADIUS_DEG;

/// The ring from which the sky behind the sun is in-painted reaches out to this many radii.
const RING: f32 = 1.6;
/// A ring of which this share is clipped still belongs to the sun's blob.
const BLOB_SHARE: f32 = 0.3;
/// Widest blob, degrees.
const MAX_BLOB_DEG: f32 = 5.0;
/// Pixels of the aureole that are looked at, about.
const AUREOLE_PIXELS: usize = 600;
/// Most of them.
pub(super) const MOST_NEAR: usize = 2 * AUREOLE_PIXELS;

/// A pixel near the sun, with the square of its chord from it.
#[derive(Clone, Copy, Debug)]
struct Place {
    pixel: u32,
    apart: f32,
}

/// What was found where the sun stands; its memory is reused.
#[derive(Debug, Default)]
pub(super) struct SunSpot {
    places: Vec<Place>,
    /// Pixels of the spot: what was found and the sky that is in-painted.
    pub spot: Vec<(u32, [f32; 3], [f32; 3])>,
    /// Pixels around it, none clipped.
    pub near: Vec<Near>,
    /// What stands above the in-painted sky, as irradiance on a plane normal to the sun.
    pub irradiance: [f64; 3],
    /// Mean luminance around the spot, and the largest in it.
    pub ring: f64,
    pub brightest: f64,
    pub clipped: bool,
    /// As far from the sun as the spot reaches, degrees.
    radius_deg: f32,
}

fn chord(degrees: f32) -> f32 {
    2.0 * (0.5 * degrees.to_radians()).sin()
}

impl SunSpot {
    /// Looks at the sun's place; false where too little of it is seen.
    pub fn look(&mut self, lens: &Lens, picture: &SkyPicture<'_>, sun_dir: [f32; 3]) -> bool {
        self.spot.clear();
        self.near.clear();
        (self.irradiance, self.ring, self.brightest, self.clipped) = ([0.0; 3], 0.0, 0.0, false);
        if !self.gather(lens, picture, sun_dir) {
            return false;
        }
        let Some(nearest) = self.places.iter().min_by(|a, b| a.apart.total_cmp(&b.apart)) else { return false };
        let pixel_deg = picture.omegas[nearest.pixel as usize].sqrt().to_degrees();
        let radius_deg = self.blob_deg(picture.merged, pixel_deg);
        self.radius_deg = radius_deg;
        let (inner, outer) = (chord(radius_deg).powi(2), chord(RING * radius_deg).powi(2));
        if !self.inpaint(picture, inner, outer) {
            return false;
        }
        self.around(picture, chord(radius_deg + pixel_deg).powi(2));
        true
    }

    /// Pixels within the aureole's radius, and how far from the sun lies what they show, degrees: of the in-painted ones that is
    /// the ring around the spot.
    pub fn shown(&self) -> impl Iterator<Item = (usize, f32)> {
        let ring_deg = 0.5 * (1.0 + RING) * self.radius_deg;
        self.places.iter().map(move |place| {
            let apart_deg = (2.0 * (0.5 * place.apart.sqrt()).asin()).to_degrees();
            (place.pixel as usize, if apart_deg <= self.radius_deg { ring_deg } else { apart_deg })
        })
    }

    /// Pixels that count within the aureole's radius; false when the sun is not in the picture.
    fn gather(&mut self, lens: &Lens, picture: &SkyPicture<'_>, sun_dir: [f32; 3]) -> bool {
        self.places.clear();
        let dir = sun_dir.map(f64::from);
        let Some((at, density)) = lens.project(dir).and_then(|at| Some((at, lens.solid_angle_sr(at)?))) else {
            return false;
        };
        // Twice the radius: a pixel's solid angle says nothing of its shape.
        let reach = 2.0 * AUREOLE_DEG.to_radians() / density.sqrt();
        let range = |centre: f64, size: usize| {
            (centre - reach).max(0.0) as usize..((centre + reach).max(0.0) as usize + 1).min(size)
        };
        let most = chord(AUREOLE_DEG as f32).powi(2);
        let (columns, rows) = (range(at[0], picture.merged.width), range(at[1], picture.merged.height));
        // Room for other places of the sun, too, where a lens shows the sky larger.
        let room = 2 * columns.len() * rows.len();
        self.places.reserve(room);
        self.spot.reserve(room);
        for y in rows {
            for x in columns.clone() {
                let pixel = y * picture.merged.width + x;
                let other = picture.dirs[pixel];
                let apart = (0..3).map(|k| (other[k] - sun_dir[k]).powi(2)).sum();
                if picture.omegas[pixel] > 0.0 && apart <= most {
                    self.places.push(Place { pixel: pixel as u32, apart });
                }
            }
        }
        !self.places.is_empty()
    }

    /// 1 degree, one and a half pixels, or as far as the clipped blob around the sun reaches.
    fn blob_deg(&self, merged: &Merged, pixel_deg: f32) -> f32 {
        let mut radius = (SUN_RADIUS_DEG as f32).max(1.5 * pixel_deg);
        while radius < MAX_BLOB_DEG {
            let (from, to) = (chord(radius).powi(2), chord(radius + pixel_deg).powi(2));
            let (mut ring, mut clipped) = (0.0, 0.0);
            for place in self.places.iter().filter(|place| (from..to).contains(&place.apart)) {
                ring += 1.0;
                clipped += f32::from(u8::from(merged.state[place.pixel as usize] == PixelState::Clipped));
            }
            if clipped <= BLOB_SHARE * ring {
                break;
            }
            radius += pixel_deg;
        }
        radius
    }

    /// In-paints the spot from the ring around it by inverse square distance; false without pixels in both.
    fn inpaint(&mut self, picture: &SkyPicture<'_>, inner: f32, outer: f32) -> bool {
        let is_ring = |place: &&Place| place.apart > inner && place.apart <= outer;
        let value = |place: &Place| picture.sky[place.pixel as usize];
        let omega = |place: &Place| picture.omegas[place.pixel as usize];
        let (mut ring_light, mut ring_omega) = (0.0, 0.0);
        for place in self.places.iter().filter(is_ring) {
            ring_light += omega(place) * luminance(value(place));
            ring_omega += omega(place);
        }
        for place in self.places.iter().filter(|place| place.apart <= inner) {
            let (mut sky, mut total) = ([0.0; 3], 0.0);
            for other in self.places.iter().filter(is_ring) {
                let (a, b) = (picture.dirs[place.pixel as usize], picture.dirs[other.pixel as usize]);
                let apart: f32 = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum();
                let weight = omega(other) / apart.max(1e-9);
                total += weight;
                sky = std::array::from_fn(|k| sky[k] + weight * value(other)[k]);
            }
            let found = value(place);
            let left: [f32; 3] = std::array::from_fn(|k| found[k].min(sky[k] / total.max(1e-30)));
            self.clipped |= picture.merged.state[place.pixel as usize] == PixelState::Clipped;
            self.brightest = self.brightest.max(luminance(found).into());
            for k in 0..3 {
                self.irradiance[k] += f64::from((found[k] - left[k]) * omega(place));
            }
            self.spot.push((place.pixel, found, left));
        }
        self.ring = f64::from(ring_light / f32::max(ring_omega, 1e-30));
        !self.spot.is_empty() && ring_omega > 0.0
    }

    /// Unclipped pixels of the aureole.
    fn around(&mut self, picture: &SkyPicture<'_>, inner: f32) {
        let outside = |place: &&Place| place.apart > inner;
        let step = (self.places.len() / AUREOLE_PIXELS).max(1);
        self.near.reserve(MOST_NEAR);
        for place in self.places.iter().filter(outside).step_by(step) {
            let pixel = place.pixel as usize;
            if picture.merged.state[pixel] == PixelState::Valid {
                let (dir, omega, value) = (picture.dirs[pixel], picture.omegas[pixel], picture.sky[pixel]);
                self.near.push(Near { dir, omega, value });
            }
        }
    }
}
