//! From a start to the most probable camera: bounded loss first, then least squares over the points that fit, under each of
//! the [`PRIORS`] of a lens.
//!
//! The prior is chosen by the evidence (Laplace's approximation; MacKay, *Bayesian Interpolation*, 1992): a lens is as bent as
//! the points make probable, so that few noisy points do not bend it. The points' noise is estimated with it.

use super::doubt::{Square, covariance, log_determinant};
use super::model::{FOCAL, KAPPA, MOVES, Model, PRIORS, Prior, STEP, diagonal_px};
use super::points::{FEWEST, Point};
use relume_firmware::glue::least_squares::minimise;

/// The noise that is expected counts as much as so many measured numbers.
const NOISE_WEIGHT: f64 = 8.0;
/// Cameras that starts ended in of which the most probable is taken.
const TRIED: usize = 3;
/// The picture of a place is not known where its variance is larger than so many times the noise's.
const VAGUE: f64 = 400.0;
/// A point that noise puts that far off in one of a hundred sets is said not to fit.
const DOUBTED: f64 = 0.01;

/// A camera that points were fitted to.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The camera.
    pub model: Model,
    /// What was thought of its lens.
    pub prior: Prior,
    /// Standard deviation of the points in each axis, px.
    pub sigma_px: f64,
    /// Of the moves.
    pub covariance: Square,
    /// Per point, whether it fits.
    pub fits: Vec<bool>,
    /// -2 times the logarithm of the evidence, but for what all cameras have in common.
    pub unlikeliness: f64,
}

/// The camera near one of `starts` under which `points` are most probable, if one is; `sigma_px` is their expected noise.
pub fn refine(points: &[Point], starts: &[Model], sigma_px: f64) -> Option<Refined> {
    let mut settled: Vec<_> = starts.iter().filter_map(|start| robust(points, start, sigma_px)).collect();
    settled.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut tried: Vec<Model> = Vec::new();
    for (_, model) in settled {
        if tried.len() < TRIED && !tried.iter().any(|other| is_same(other, &model)) {
            tried.push(model);
        }
    }
    let refined = tried.iter().filter_map(|model| without_strays(points, model, sigma_px));
    refined.min_by(|a, b| a.unlikeliness.total_cmp(&b.unlikeliness))
}

/// Did two starts end in the same camera?
fn is_same(a: &Model, b: &Model) -> bool {
    (a.focal_px / b.focal_px).ln().abs() < 1e-3 && a.stand.eye.distance(b.stand.eye) < 1e-3 * a.scale_m
}

/// The most probable camera near `model`, points dropped and taken back until those fit that are there.
fn without_strays(points: &[Point], model: &Model, sigma_px: f64) -> Option<Refined> {
    let mut fits = first_guess(points, model, sigma_px);
    let mut best = None;
    for _ in 0..2 * points.len() {
        if fits.iter().filter(|fits| **fits).count() < FEWEST {
            return None;
        }
        let refined = most_probable(points, fits.clone(), model, sigma_px)?;
        let changed = reconsider(points, &refined, &mut fits);
        best = Some(refined);
        if !changed {
            break;
        }
    }
    best
}

/// Least squares from `base` over `points` in units of `sigma_px`; with `bound`, in the same units, points far off count
/// hardly more than that. Only `free` moves.
fn settle(
    points: &[Point],
    base: &Model,
    (sigma_px, prior): (f64, &Prior),
    bound: Option<f64>,
    free: &[usize],
) -> Option<(Model, f64)> {
    let moves = |values: &[f64]| {
        let mut all = [0.0; MOVES];
        free.iter().zip(values).for_each(|(&index, value)| all[index] = *value);
        all
    };
    let residuals = |values: &[f64]| {
        let model = base.moved(&moves(values));
        let projector = model.projector();
        let mut all = Vec::with_capacity(2 * points.len() + MOVES - FOCAL);
        for point in points {
            let off = projector.residual(point).map(|off| off.map(|px| px / sigma_px));
            all.extend(match (off, bound) {
                // Geman & McClure's loss.
                (Some(off), Some(bound)) => {
                    let shrink = (1.0 + (off[0] * off[0] + off[1] * off[1]) / (bound * bound)).sqrt();
                    off.map(|value| value / shrink)
                }
                (None, Some(bound)) => [bound, 0.0],
                (off, None) => off?,
            });
        }
        all.extend(model.unlikeliness(prior));
        Some(all)
    };
    let found = minimise(&vec![0.0; free.len()], &vec![STEP; free.len()], residuals)?;
    Some((base.moved(&moves(&found.parameters)), found.cost))
}

/// A start, settled with narrower and narrower bounds; its loss.
fn robust(points: &[Point], start: &Model, sigma_px: f64) -> Option<(f64, Model)> {
    let diagonal = diagonal_px(start.size_px);
    let coarse: Vec<usize> = (0..=FOCAL).chain([KAPPA]).collect();
    let all: Vec<usize> = (0..start.moves()).collect();
    let [.., bent, strongly_bent] = &PRIORS;
    let mut model = *start;
    for share in [0.02, 0.005] {
        model = settle(points, &model, (sigma_px, strongly_bent), Some(share * diagonal / sigma_px), &coarse)?.0;
    }
    let narrow = (0.002 * diagonal / sigma_px).max(4.0);
    let (model, loss) = settle(points, &model, (sigma_px, strongly_bent), Some(narrow), &all)?;
    let (better, of_better) = settle(points, &model, (sigma_px, bent), Some(narrow), &all)?;
    Some(if of_better < loss { (of_better, better) } else { (loss, model) })
}

/// Points that lie within a few times the typical residual.
fn first_guess(points: &[Point], model: &Model, sigma_px: f64) -> Vec<bool> {
    let projector = model.projector();
    let off = |point: &Point| projector.residual(point).map_or(f64::INFINITY, |[x, y]| x.hypot(y));
    let all: Vec<f64> = points.iter().map(off).collect();
    let mut sorted = all.clone();
    sorted.sort_by(f64::total_cmp);
    // The median length of two normal errors is 1.18 of their standard deviation.
    let typical = sorted[sorted.len() / 2] / 1.18;
    all.into_iter().map(|off| off <= 4.5 * typical.max(sigma_px)).collect()
}

/// The camera over the points that fit, under the most probable prior.
fn most_probable(points: &[Point], fits: Vec<bool>, start: &Model, expected_px: f64) -> Option<Refined> {
    let own: Vec<Point> = points.iter().zip(&fits).filter(|(_, fits)| **fits).map(|(point, _)| *point).collect();
    let all: Vec<usize> = (0..start.moves()).collect();
    let mut sigma_px = expected_px;
    let mut best: Option<Refined> = None;
    for _ in 0..3 {
        let under = |prior: &Prior| {
            let (model, cost) = settle(&own, start, (sigma_px, prior), None, &all)?;
            // What turns back within the still is no lens, however well it fits.
            if model.optics().fold_px().is_some() {
                return None;
            }
            let covariance = covariance(&model, &own, sigma_px, prior)?;
            let beforehand: f64 = prior.sigma[..model.moves() - FOCAL].iter().map(|sigma| 2.0 * sigma.ln()).sum();
            let noise = 4.0 * own.len() as f64 * sigma_px.ln();
            let unlikeliness = cost + noise - log_determinant(&covariance)? + beforehand;
            Some(Refined { model, prior: *prior, sigma_px, covariance, fits: fits.clone(), unlikeliness })
        };
        let chosen = PRIORS.iter().filter_map(under).min_by(|a, b| a.unlikeliness.total_cmp(&b.unlikeliness))?;
        sigma_px = noise(&own, &chosen, expected_px).sqrt();
        best = Some(chosen);
    }
    let mut best = best?;
    best.sigma_px = sigma_px;
    best.covariance = covariance(&best.model, &own, sigma_px, &best.prior)?;
    // A point that does not fit may lie anywhere in the still.
    let strays = (points.len() - own.len()) as f64;
    let [width, height] = best.model.size_px.map(f64::from);
    best.unlikeliness += strays * 2.0 * (width * height / std::f64::consts::TAU).ln();
    Some(best)
}

/// Numbers that are measured beyond those that the fit used up, the expected noise counted.
fn freedom(points: usize, refined: &Refined) -> f64 {
    let told_beforehand: f64 = (FOCAL..refined.model.moves())
        .map(|index| refined.covariance[(index, index)] / refined.prior.sigma[index - FOCAL].powi(2))
        .sum();
    let used = refined.model.moves() as f64 - told_beforehand;
    NOISE_WEIGHT + (2 * points) as f64 - used
}

/// Variance of the points, px^2: what they are off, with what was expected.
fn noise(points: &[Point], refined: &Refined, expected_px: f64) -> f64 {
    let projector = refined.model.projector();
    let off = |point: &Point| projector.residual(point).map_or(0.0, |[x, y]| x * x + y * y);
    let sum: f64 = points.iter().map(off).sum();
    (NOISE_WEIGHT * expected_px * expected_px + sum) / freedom(points.len(), refined)
}

/// Drops the point that fits least, or takes back one that fits after all; false if there is none.
fn reconsider(points: &[Point], refined: &Refined, fits: &mut [bool]) -> bool {
    // Half of an externally studentised square is distributed as F(2, others).
    let others = freedom(fits.iter().filter(|fits| **fits).count(), refined) - 2.0;
    let cut = others * ((DOUBTED / points.len() as f64).powf(-2.0 / others) - 1.0);
    let doubts: Vec<(usize, f64)> = doubts(points, refined).into_iter().enumerate().collect();
    let (own, others): (Vec<_>, Vec<_>) = doubts.into_iter().partition(|(index, _)| fits[*index]);
    let worst = own.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, doubt)| *doubt > cut);
    let back = others.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, doubt)| *doubt < 0.7 * cut);
    let changed = worst.or(back);
    if let Some((index, _)) = changed {
        fits[index] = !fits[index];
    }
    changed.is_some()
}

/// How far off each point is, squared, in standard deviations of its residual.
fn doubts(points: &[Point], refined: &Refined) -> Vec<f64> {
    let freedom = freedom(refined.fits.iter().filter(|fits| **fits).count(), refined);
    let projector = refined.model.projector();
    let noise = refined.sigma_px.powi(2);
    let doubt = |(point, &fits): (&Point, &bool)| {
        let (Some([u, v]), Some(slopes)) = (projector.residual(point), refined.model.slopes(point.world)) else {
            return f64::INFINITY;
        };
        // A residual varies less than the noise where the fit has followed it, and more where it has not.
        let sign = if fits { -1.0 } else { 1.0 };
        let [xx, xy, yy] = refined.covariance.of_picture(&slopes).map(|value| sign * value);
        // Where the camera is not known at all, as right behind a fisheye, everything would seem to fit.
        if xx + yy > VAGUE * noise {
            return f64::INFINITY;
        }
        let floor = 0.05 * noise;
        let (xx, yy) = ((noise + xx).max(floor), (noise + yy).max(floor));
        let squared = (u * u * yy - 2.0 * u * v * xy + v * v * xx) / (xx * yy - xy * xy).max(floor * floor);
        // Against the noise that would be found without this point (externally studentised).
        let without = if fits { (freedom - squared).max(1e-3 * freedom) / (freedom - 2.0).max(1.0) } else { 1.0 };
        squared / without
    };
    points.iter().zip(&refined.fits).map(doubt).collect()
}
