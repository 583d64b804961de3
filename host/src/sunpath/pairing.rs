//! Which spots are the sun: the lens of two spots that explains most frames.

use super::Sighting;
use super::parameters::{lens, product, smaller_side};
use crate::lens::{Lens, LensFile};

/// Pairs that are tried.
const TRIES: usize = 600;
/// Frames that a lens is held against.
const JURY: usize = 240;
/// A spot is explained within this share of the picture's smaller side: distortion and an axis off the centre come later.
const GATE: f64 = 0.03;
/// The sun's places must be this far apart to tell a focal length, radians.
const MIN_APART: f64 = 0.12;
/// Fields of view across the picture's smaller side, degrees, equidistant.
const FIELDS_DEG: [f64; 2] = [30.0, 300.0];
const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The lens that explains most of the sightings, none if no pair gives one, and how many frames it explains.
pub(super) fn best(sightings: &[&Sighting], nominal: &LensFile) -> (Option<LensFile>, usize) {
    let gate = GATE * smaller_side(nominal);
    let stride = sightings.len().div_ceil(JURY).max(1);
    let jury: Vec<&Sighting> = sightings.iter().step_by(stride).copied().collect();
    let mut state = 1;
    let mut leader: (Option<LensFile>, f64) = (None, 0.0);
    for _ in 0..TRIES {
        let pair = [pick(sightings, &mut state), pick(sightings, &mut state)];
        for candidate in lenses(pair, nominal).into_iter().flatten() {
            let points = lens(&candidate).map_or(0.0, |lens| score(&lens, &jury, gate));
            if points > leader.1 {
                leader = (Some(candidate), points);
            }
        }
    }
    let explained = leader
        .0
        .as_ref()
        .and_then(lens)
        .map_or(0, |lens| sightings.iter().filter(|sighting| score(&lens, &[sighting], gate) > 0.0).count());
    (leader.0, explained)
}

type Place = ([f64; 3], [f64; 2]);

/// A spot of a random frame, mostly the brightest, with where the sun was.
fn pick(sightings: &[&Sighting], state: &mut u64) -> Place {
    let mut random = |below: usize| {
        // Knuth's MMIX generator; the high bits are the good ones.
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as usize % below.max(1)
    };
    let sighting = sightings[random(sightings.len())];
    let rank = if random(3) == 0 { random(sighting.spots.len()) } else { 0 };
    (sighting.sun_dir_world, sighting.spots[rank].position_px)
}

/// The lens of the focal length that the pair tells, and that of the nominal one.
fn lenses(pair: [Place; 2], nominal: &LensFile) -> [Option<LensFile>; 2] {
    let apart = angle(pair[0].0, pair[1].0);
    let oriented = |focal_px: f64| {
        let file = LensFile { focal_px, camera_to_world: IDENTITY, ..nominal.clone() };
        let rays = rays(&file, &pair)?;
        // A wrong pair sees the two places at another angle.
        let fits = (angle(rays[0], rays[1]) - apart).abs() < 0.05 && apart > 0.02;
        fits.then(|| align(rays, [pair[0].0, pair[1].0]))
            .flatten()
            .map(|turn| LensFile { camera_to_world: turn, ..file })
    };
    let told = if apart > MIN_APART { focal(&pair, apart, nominal) } else { None };
    [told.and_then(oriented), oriented(nominal.focal_px)]
}

/// Camera rays of the two spots.
fn rays(file: &LensFile, pair: &[Place; 2]) -> Option<[[f64; 3]; 2]> {
    let lens = lens(file)?;
    Some([lens.unproject(pair[0].1)?, lens.unproject(pair[1].1)?])
}

/// The longest focal length under which the two spots are `apart` radians apart: the shorter it is, the wider the angle
/// (until rays pass behind the camera).
fn focal(pair: &[Place; 2], apart: f64, nominal: &LensFile) -> Option<f64> {
    const STEPS: u32 = 24;
    let side = smaller_side(nominal);
    let [long, short] = FIELDS_DEG.map(|degrees| side / degrees.to_radians());
    let too_wide = |focal_px: f64| {
        let file = LensFile { focal_px, camera_to_world: IDENTITY, ..nominal.clone() };
        rays(&file, pair).is_none_or(|[a, b]| angle(a, b) > apart)
    };
    let at = |step: u32| long * (short / long).powf(f64::from(step) / f64::from(STEPS));
    let first = (1..=STEPS).find(|&step| too_wide(at(step))).filter(|_| !too_wide(long))?;
    let (mut low, mut high) = (at(first), at(first - 1));
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if too_wide(middle) { low = middle } else { high = middle }
    }
    Some(high)
}

/// Frames explained, brighter and nearer spots counting more.
fn score(lens: &Lens, sightings: &[&Sighting], gate: f64) -> f64 {
    let points = |sighting: &&Sighting| {
        let Some([x, y]) = lens.project(sighting.sun_dir_world) else { return 0.0 };
        let ranked = sighting.spots.iter().enumerate().map(|(rank, spot)| {
            let off = (spot.position_px[0] - x).hypot(spot.position_px[1] - y) / gate;
            (1.0 - off * off).max(0.0) / (1.0 + rank as f64)
        });
        ranked.fold(0.0, f64::max)
    };
    sightings.iter().map(points).sum()
}

fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cross = cross(a, b);
    let sin = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
    sin.atan2((0..3).map(|k| a[k] * b[k]).sum())
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    (length > 1e-9).then(|| v.map(|c| c / length))
}

/// An orthonormal frame from two directions, symmetric in them: columns along their sum, their difference, and both's normal.
fn frame([a, b]: [[f64; 3]; 2]) -> Option<[[f64; 3]; 3]> {
    let sum = unit(std::array::from_fn(|k| a[k] + b[k]))?;
    let difference = unit(std::array::from_fn(|k| a[k] - b[k]))?;
    let normal = cross(sum, difference);
    Some(std::array::from_fn(|i| [sum[i], difference[i], normal[i]]))
}

/// The rotation that takes two camera rays to two directions in the world (Black 1964, made symmetric).
fn align(rays: [[f64; 3]; 2], dirs_world: [[f64; 3]; 2]) -> Option<[[f64; 3]; 3]> {
    let (camera, world) = (frame(rays)?, frame(dirs_world)?);
    let transposed = std::array::from_fn(|i| std::array::from_fn(|j| camera[j][i]));
    Some(product(&world, &transposed))
}
