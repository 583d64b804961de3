//! Priors: the second moment of the patch weights that a field should be best for.
//!
//! A prior is `C = E[w w^T]` over skies, each scaled to mean radiance 1, kept as `C ~ B B^T` with `B` of few columns.
//! The skies are analytic and drawn by a fixed random source: CIE general skies with the sun anywhere above the horizon
//! (with aureole, without disc) and a tint, the same behind broken clouds, and either behind a skyline. The lower
//! hemisphere is ground albedo x irradiance / pi with variation. Constant, linear and quadratic lightings are added by
//! themselves so that they come out near exact, and a little white noise per patch so that skies rougher than any of
//! these stay accurate.
//!
//! Light on a small thing comes from all around and from lamps: sets without a horizon, or with another than the ground's,
//! have a prior of their own (around.rs).

mod around;
mod cie;
mod clouds;
pub(crate) mod within;

use crate::random::Random;
use cie::SmoothSky;
use clouds::{Clouds, Skyline};
use nalgebra::{DMatrix, SymmetricEigen};
use relume_firmware::patches::PatchSet;
use std::f64::consts::{FRAC_PI_2, TAU};

/// How a sky prior is mixed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Skies drawn.
    pub skies: usize,
    /// Weight of constant, linear and quadratic lightings, relative to a sky's mean radiance.
    pub low_order: f64,
    /// Standard deviation of the white part per patch, relative to a sky's mean radiance.
    pub white: f64,
    /// Share of the second moment that may be left out of the basis.
    pub tail: f64,
    /// Most columns of the basis.
    pub max_modes: usize,
    /// Seed of the draw.
    pub seed: u64,
}

impl Default for Mixture {
    fn default() -> Self {
        Mixture { skies: 2000, low_order: 0.2, white: 0.2, tail: 1e-2, max_modes: usize::MAX, seed: 1 }
    }
}

/// A second moment of patch weights, `C ~ B B^T`; see the module's text.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// `B`, patches x modes.
    basis: DMatrix<f32>,
    basis_transposed: DMatrix<f32>,
    white: f64,
    /// Cholesky factor of the inverse of `C` plus a ridge, patches x patches, lower, unit diagonal: column `i` tells
    /// how rounding entry `i` is best made up for by the later entries.
    feedback: DMatrix<f32>,
}

impl Prior {
    /// The prior of skies for a patch set, the sun's disc left out.
    pub fn skies(set: &PatchSet) -> Prior {
        Prior::of_mixture(set, &Mixture::default())
    }

    /// The prior for a set that others may have made: of skies where its horizon is the ground's, else of light around.
    pub fn for_set(set: &PatchSet) -> Prior {
        match set.horizon() {
            Some([_, up, _]) if up > 0.999 => Prior::skies(set),
            _ => around::prior(set),
        }
    }

    /// The same, where a surface of this rms radiance under it counts as white.
    pub fn with_white(self, white: f64) -> Prior {
        Prior { white, ..self }
    }

    /// The prior of skies with its mixture spelled out.
    pub fn of_mixture(set: &PatchSet, mixture: &Mixture) -> Prior {
        let skies = draw_skies(set, mixture);
        let mut moment = moment_of(set.len(), &skies);
        // A zonal partition maps onto itself when mirrored at azimuth 0; one that is cut to a scene does not.
        if set.subdivided().is_none() {
            let mirrored = mirror(set);
            let both = |i, j| 0.5 * (moment[(i, j)] + moment[(mirrored[i], mirrored[j])]);
            moment = DMatrix::from_fn(set.len(), set.len(), both);
        }
        let mut total = 0.0;
        let lows = low_orders(set);
        for low in &lows {
            moment.ger(mixture.low_order * mixture.low_order, low, low, 1.0);
        }
        for i in 0..set.len() {
            moment[(i, i)] += mixture.white * mixture.white;
            total += moment[(i, i)];
        }
        Prior::from_moment(set, moment, mixture.tail * total, mixture.max_modes)
    }

    /// Patches the prior is for.
    pub fn patches(&self) -> usize {
        self.basis.nrows()
    }

    /// Columns of the basis.
    pub fn modes(&self) -> usize {
        self.basis.ncols()
    }

    /// The basis `B`, patches x modes.
    pub fn basis(&self) -> &DMatrix<f32> {
        &self.basis
    }

    /// `B^T`, modes x patches.
    pub(crate) fn basis_transposed(&self) -> &DMatrix<f32> {
        &self.basis_transposed
    }

    /// Rms radiance, under the prior, of what counts as white: of a level white surface (albedo 0.8) in the open, unless
    /// [`Prior::with_white`] has told another.
    pub(crate) fn white(&self) -> f64 {
        self.white
    }

    pub(crate) fn feedback(&self) -> &DMatrix<f32> {
        &self.feedback
    }

    /// Keeps the leading modes of a second moment until at most `tail` of its trace is left out.
    fn from_moment(set: &PatchSet, moment: DMatrix<f64>, tail: f64, max_modes: usize) -> Prior {
        let feedback = feedback_of(&moment);
        let eigen = SymmetricEigen::new(moment);
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let mut left: f64 = eigen.eigenvalues.iter().map(|v| v.max(0.0)).sum();
        let mut modes = 0;
        while modes < order.len().min(max_modes.max(1)) && (modes == 0 || left > tail) {
            left -= eigen.eigenvalues[order[modes]].max(0.0);
            modes += 1;
        }
        let basis = DMatrix::from_fn(order.len(), modes, |row, column| {
            let mode = order[column];
            (eigen.eigenvectors[(row, mode)] * eigen.eigenvalues[mode].max(0.0).sqrt()) as f32
        });
        let facing = set.horizon().unwrap_or([0.0, 1.0, 0.0]);
        let paint = DMatrix::from_fn(1, set.len(), |_, patch| {
            let cosine = set.dir_world(patch).iter().zip(facing).map(|(d, a)| d * a).sum::<f32>();
            0.8 / std::f32::consts::PI * cosine.max(0.0) * set.solid_angle_sr(patch)
        });
        let white = f64::from((paint * &basis).norm());
        let basis_transposed = basis.transpose();
        Prior { basis, basis_transposed, white, feedback }
    }
}

/// `C^-1 = L L^T` by Cholesky, columns of `L` scaled to a unit diagonal.
fn feedback_of(moment: &DMatrix<f64>) -> DMatrix<f32> {
    let n = moment.nrows();
    let ridge = 1e-3 * moment.trace() / n as f64;
    let ridged = moment + DMatrix::identity(n, n) * ridge;
    let inverse = ridged.cholesky().map(|c| c.inverse());
    match inverse.and_then(|inverse| inverse.cholesky()) {
        Some(factor) => {
            let lower = factor.l();
            DMatrix::from_fn(n, n, |row, column| (lower[(row, column)] / lower[(column, column)]) as f32)
        }
        None => DMatrix::identity(n, n),
    }
}

fn moment_of(patches: usize, samples: &[Vec<f64>]) -> DMatrix<f64> {
    let scale = 1.0 / (samples.len().max(1) as f64).sqrt();
    let rows = DMatrix::from_fn(patches, samples.len(), |patch, sample| samples[sample][patch] * scale);
    &rows * rows.transpose()
}

/// Constant, linear (3) and quadratic (5) lightings at the patch centroids, each of rms 1 over the sphere.
fn low_orders(set: &PatchSet) -> Vec<nalgebra::DVector<f64>> {
    let at = |f: fn([f64; 3]) -> f64| {
        nalgebra::DVector::from_iterator(set.len(), (0..set.len()).map(|p| f(set.dir_world(p).map(f64::from))))
    };
    let mut all = vec![
        at(|_| 1.0),
        at(|[x, _, _]| 3f64.sqrt() * x),
        at(|[_, y, _]| 3f64.sqrt() * y),
        at(|[_, _, z]| 3f64.sqrt() * z),
        at(|[x, y, _]| 15f64.sqrt() * x * y),
        at(|[_, y, z]| 15f64.sqrt() * y * z),
        at(|[x, _, z]| 15f64.sqrt() * x * z),
        at(|[x, _, z]| 15f64.sqrt() * 0.5 * (x * x - z * z)),
        at(|[_, y, _]| 5f64.sqrt() * 0.5 * (3.0 * y * y - 1.0)),
    ];
    // The horizon's step is part of every outdoor lighting.
    all.push(at(|[_, y, _]| if y >= 0.0 { 1.0 } else { 0.0 }));
    all
}

/// Each patch's mirror image at the plane z = 0.
fn mirror(set: &PatchSet) -> Vec<usize> {
    let at = |patch| {
        let [x, y, z] = set.sample(patch, [0.5, 0.5]);
        set.patch_of([x, y, -z])
    };
    (0..set.len()).map(at).collect()
}

/// Patches larger than this are looked at in 4x4 directions, others in 2x2, sr.
const LARGE_SR: f32 = 0.1;

/// Directions inside each patch above the horizon, stratified.
fn patch_samples(set: &PatchSet) -> Vec<Vec<[f64; 3]>> {
    let of_patch = |patch: usize| {
        let side = if set.solid_angle_sr(patch) > LARGE_SR { 4 } else { 2 };
        let at = |k: usize| (k as f32 + 0.5) / side as f32;
        let dirs = (0..side * side).map(|k| set.sample(patch, [at(k / side), at(k % side)]).map(f64::from));
        // A listed patch's cap may reach below the horizon.
        dirs.map(|[x, y, z]| [x, y.max(0.0), z]).collect()
    };
    (0..set.upper()).map(of_patch).collect()
}

/// Mean radiance of the patches above the horizon.
fn mean_above(set: &PatchSet, upper: &[f64]) -> f64 {
    let (mut sum, mut all) = (0.0, 0.0);
    for (patch, radiance) in upper.iter().enumerate() {
        let omega = f64::from(set.solid_angle_sr(patch));
        (sum, all) = (sum + omega * radiance, all + omega);
    }
    sum / f64::max(all, 1e-12)
}

/// Patch weights of random skies, each scaled to mean radiance 1 over the upper hemisphere.
pub(crate) fn draw_skies(set: &PatchSet, mixture: &Mixture) -> Vec<Vec<f64>> {
    let mut random = Random::new(mixture.seed);
    let samples = patch_samples(set);
    (0..mixture.skies)
        .map(|sky| {
            // Suns spread evenly (Roberts's R2 sequence): chance would prefer some azimuths.
            let azimuth = TAU * (sky as f64 * 0.754_877_666_246_693).fract();
            let altitude = FRAC_PI_2 * (sky as f64 * 0.569_840_290_998_053).fract();
            draw_sky(set, &samples, [azimuth, altitude], &mut random)
        })
        .collect()
}

fn draw_sky(set: &PatchSet, samples: &[Vec<[f64; 3]>], sun: [f64; 2], random: &mut Random) -> Vec<f64> {
    let sky = SmoothSky::draw(random, sun[0], sun[1]);
    let clouds = Clouds::draw(random);
    let skyline = Skyline::draw(random);
    let (clouded, skylined) = (random.unit() < 0.5, random.unit() < 0.5);
    let over =
        |patch: &[[f64; 3]], f: &dyn Fn([f64; 3]) -> f64| patch.iter().map(|&d| f(d)).sum::<f64>() / patch.len() as f64;
    let mut upper: Vec<f64> = samples.iter().map(|patch| over(patch, &|d| sky.radiance(d))).collect();
    let mean = mean_above(set, &upper);
    if clouded {
        upper = samples.iter().map(|patch| over(patch, &|d| clouds.radiance(&sky, d, mean))).collect();
    }
    let irradiance = |upper: &[f64]| {
        let cosines = (0..set.upper()).map(|p| f64::from(set.dir_world(p)[1]) * f64::from(set.solid_angle_sr(p)));
        upper.iter().zip(cosines).map(|(l, c)| l * c).sum::<f64>()
    };
    // The ground is lit by the sun as well, which is not in the patches.
    let sunlit = if random.unit() < 0.5 { 1.0 } else { random.between(1.0, 6.0) };
    let ground = irradiance(&upper) * sunlit / std::f64::consts::PI;
    if skylined {
        for (value, patch) in upper.iter_mut().zip(samples) {
            *value = over(patch, &|d| skyline.reflectance(d).map_or(*value, |share| share * ground));
        }
    }
    let mean = mean_above(set, &upper);
    let albedo = random.between(0.03, 0.6);
    let spread = random.between(0.0, 0.6);
    let lower = (0..set.lower()).map(|_| albedo * ground * (spread * random.normal()).exp());
    upper.iter().copied().chain(lower).map(|l| l / mean.max(1e-12)).collect()
}

#[cfg(test)]
mod tests;
