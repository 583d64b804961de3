//! Patches that fit a scene (`--adaptive`): small where its response to the sky is sharp, large where it is smooth.
//!
//! A field knows the mean light of each patch. What a pixel loses by that is, per patch, the sum over directions `i` in it of
//! `(R_i - mean R) (L_i - mean L)`: response and light have to vary together. A pilot samples the response of some pixels to
//! the finest cells there may be; with the prior's second moment of light inside a patch that gives the patch's expected square
//! error over those pixels. Patches' errors are taken as independent of each other, so that they add, and the cuts with the
//! least sum for the number of patches that is wanted are found exactly (tree.rs). The pilot samples every response twice and
//! takes products of the two (response/twice.rs): noise would pass for sharpness.

mod boxes;
mod tree;

use crate::bake::{BakeError, BakeOptions};
use crate::camera::Camera;
use crate::prior::within;
use crate::response::{Transport, TransportOptions};
use crate::scene::Scene;
use crate::strata::hash;
use boxes::{Boxes, Moments};
use rayon::prelude::*;
use relume_firmware::patches::{Cut, MAX_PATCHES, PatchSet, Subdivided};
use std::ops::Range;

/// About so many pixels of the picture are sampled.
const PILOT_PX: f64 = 3072.0;
/// The finest cells are at most this of a patch of equal ones, and the finest parts of a zonal cell at least so many.
const FINEST: usize = 4;
const LEAST_PARTS: usize = 64;
/// Pixels whose sums are kept apart: added up in order, so that any number of threads gives the same patches.
const CHUNK: usize = 128;

/// Chooses as many patches as [`BakeOptions::directions`] alone would give, for `scene` as `camera` sees it.
///
/// # Errors
/// [`BakeError`], as the bake itself would fail.
pub fn fit(scene: &Scene, camera: &Camera, options: &BakeOptions) -> Result<Subdivided, BakeError> {
    let equal = BakeOptions { cuts: None, ..options.clone() }.patch_set()?;
    let roots = Subdivided::roots(options.sphere);
    let finest = finest_cuts(options.directions);
    let mut moments: Vec<Moments> = Vec::with_capacity(roots);
    // As many zonal cells at once as a set holds when they are cut as finely as can be.
    let at_once = (MAX_PATCHES - roots) / ((1 << (finest[0] + finest[1])) - 1);
    for first in (0..roots).step_by(at_once) {
        let pilot = Pilot::new(options.sphere, first..(first + at_once).min(roots), finest);
        moments.extend(pilot.moments(scene, camera, options)?);
    }
    let cells = Subdivided::uncut(options.sphere);
    let zonal = PatchSet::of_subdivided(cells);
    let fine_sr = |root: usize| zonal.solid_angle_sr(root) / (1u32 << (finest[0] + finest[1])) as f32;
    share_light(&mut moments, &cells);
    let white = within::white_variance(&equal);
    let boxes = moments.iter().enumerate().map(|(root, moments)| {
        // White light has the prior's variance over a patch of equal ones, and more over a part of it.
        let more = equal.solid_angle_sr(0) / fine_sr(root);
        Boxes::new(moments, white * f64::from(more).max(1.0), finest, |cuts| cells.may_cut_height(root, cuts))
    });
    let cuts = tree::best_cuts(&boxes.collect::<Vec<_>>(), equal.len());
    // Cuts of these boxes are what a set allows, and as many patches as one of equal cells has.
    Ok(Subdivided::new(options.sphere, cuts).unwrap_or(cells))
}

/// Cuts in height and azimuth of a zonal cell down to the finest parts.
fn finest_cuts(directions: usize) -> [u8; 2] {
    let parts = (FINEST * directions / 16).max(LEAST_PARTS).next_power_of_two();
    let cuts = parts.trailing_zeros() as u8;
    [cuts / 2, cuts - cuts / 2]
}

/// Zonal cells of a ring are each other turned, and the prior knows no azimuth: they share what it tells.
fn share_light(moments: &mut [Moments], cells: &Subdivided) {
    let ring_of = |root: usize| cells.ring_of_root(root);
    for root in 0..moments.len() {
        if (0..root).any(|other| ring_of(other) == ring_of(root)) {
            continue;
        }
        let ring: Vec<usize> = (root..moments.len()).filter(|&other| ring_of(other) == ring_of(root)).collect();
        let mut mean = vec![0.0; moments[root].light.len()];
        for &other in &ring {
            mean.iter_mut().zip(&moments[other].light).for_each(|(sum, one)| *sum += one / ring.len() as f64);
        }
        ring.iter().for_each(|&other| moments[other].light.clone_from(&mean));
    }
}

/// The finest cells of some zonal cells; the others are whole.
struct Pilot {
    set: PatchSet,
    /// Patches of each zonal cell that is cut, in the order of azimuth, then height.
    parts: Vec<Range<usize>>,
}

impl Pilot {
    fn new(is_sphere: bool, roots: Range<usize>, finest: [u8; 2]) -> Self {
        let mut cuts = Vec::new();
        for root in 0..Subdivided::roots(is_sphere) {
            cut_all(if roots.contains(&root) { finest } else { [0, 0] }, &mut cuts);
        }
        let cells = Subdivided::new(is_sphere, cuts).unwrap_or_else(|_| Subdivided::uncut(is_sphere));
        let parts = roots.map(|root| cells.patches_of_root(root)).collect();
        Pilot { set: PatchSet::of_subdivided(cells), parts }
    }

    /// Second moments of response and light inside each zonal cell that is cut.
    fn moments(&self, scene: &Scene, camera: &Camera, options: &BakeOptions) -> Result<Vec<Moments>, BakeError> {
        let own = options.transport;
        let sampling = TransportOptions { direct_classes: 1, paths: 2, patch_group: 32, ..own };
        let transport = Transport::new(scene, camera, self.set, options.size, sampling)?;
        let pixels = pilot_pixels(options.size);
        let chunks: Vec<Vec<Vec<f64>>> =
            pixels.par_chunks(CHUNK).map(|pixels| self.response_moments(&transport, pixels)).collect();
        let light = within::moments(&self.set, &self.parts);
        let of_part = |(part, light): (usize, nalgebra::DMatrix<f64>)| {
            let mut response = vec![0.0; light.len()];
            for chunk in &chunks {
                response.iter_mut().zip(&chunk[part]).for_each(|(sum, one)| *sum += one);
            }
            Moments { response, light: light.as_slice().to_vec() }
        };
        Ok(light.into_iter().enumerate().map(of_part).collect())
    }

    /// Per zonal cell that is cut the sums over pixels and channels of `response_i * response_j`, noise left out.
    fn response_moments(&self, transport: &Transport<'_>, pixels: &[(u32, u32)]) -> Vec<Vec<f64>> {
        let mut sums: Vec<Vec<f64>> = self.parts.iter().map(|part| vec![0.0; part.len().pow(2)]).collect();
        for &(x, y) in pixels {
            let Some([first, second]) = transport.twice(x, y) else { continue };
            let channels = first.chunks_exact(self.set.len()).zip(second.chunks_exact(self.set.len()));
            for (first, second) in channels {
                for (sum, part) in sums.iter_mut().zip(&self.parts) {
                    let (first, second) = (&first[part.clone()], &second[part.clone()]);
                    for (row, &a) in sum.chunks_exact_mut(part.len()).zip(first) {
                        row.iter_mut().zip(second).for_each(|(sum, &b)| *sum += f64::from(a * b));
                    }
                }
            }
        }
        sums
    }
}

/// Cuts in azimuth first, then in height, down to the finest parts.
fn cut_all([height, azimuth]: [u8; 2], cuts: &mut Vec<Cut>) {
    let (cut, left) = match (height, azimuth) {
        (0, 0) => return cuts.push(Cut::Patch),
        (_, 1..) => (Cut::Azimuth, [height, azimuth - 1]),
        _ => (Cut::Height, [height - 1, 0]),
    };
    cuts.push(cut);
    cut_all(left, cuts);
    cut_all(left, cuts);
}

/// Pixels by chance, one in each square of a grid.
fn pilot_pixels((width, height): (u32, u32)) -> Vec<(u32, u32)> {
    let step = (f64::from(width) * f64::from(height) / PILOT_PX).sqrt().floor().max(1.0) as u32;
    let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
    let place = |square: u32| {
        let word = hash(square ^ 0x0d1_4ec7);
        let at = [square % columns * step + (word >> 16) % step, square / columns * step + (word & 0xffff) % step];
        (at[0] < width && at[1] < height).then_some((at[0], at[1]))
    };
    (0..columns * rows).filter_map(place).collect()
}

#[cfg(test)]
mod tests;
