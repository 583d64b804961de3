//! Least squares over the sun's spots, in turns with looking for the nearest spots again.

use super::parameters::{self, COUNT, NAMES, ORIENTATION, SPREAD, STEPS, of_model, smaller_side};
use super::{Found, PathFit, Sighting};
use crate::least_squares::{Matrix, Solution, minimise};
use crate::lens::{Lens, LensFile};
use crate::quantile::median;
use crate::sunpath::spot::Spot;

/// Turns of fitting and looking again.
const TURNS: usize = 12;
/// First gate, share of the picture's smaller side, and how it shrinks.
const FIRST_GATE: f64 = 0.03;
const SHRINK: f64 = 0.6;
/// Last gate: this many standard deviations of the spots, but not less than so many pixels.
const GATE_DEVIATIONS: f64 = 4.0;
const LEAST_GATE_PX: f64 = 1.0;
/// Centroids of discs a few pixels wide are hardly better than this, pixels.
const LEAST_DEVIATION_PX: f64 = 0.15;
/// A parameter that keeps more than this share of its spread is not told by the path.
const UNTOLD: f64 = 0.5;
/// Cauchy's loss: at this many standard deviations a spot counts half (95 % efficiency for normal errors, Holland & Welsch 1977).
const CAUCHY: f64 = 2.385;
/// Altitude above which the sky's error is told, degrees; and the step of directions.
const SKY_FROM_DEG: f64 = 5.0;
const SKY_STEP_DEG: f64 = 10.0;

/// The sun in one frame: which sighting and which of its spots.
#[derive(Clone, Copy)]
struct Pick<'a> {
    sighting: &'a Sighting,
    spot: &'a Spot,
}

/// The nearest spot of every sighting within a gate (pixels, larger for large spots).
fn picks<'a>(lens: &Lens, sightings: &[&'a Sighting], gate_px: f64) -> Vec<Pick<'a>> {
    let pick = |sighting: &&'a Sighting| {
        let expected = lens.project(sighting.sun_dir_world)?;
        let distance =
            |spot: &Spot| (spot.position_px[0] - expected[0]).hypot(spot.position_px[1] - expected[1]) / spot.spread();
        let spot = sighting.spots.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        (distance(spot) < gate_px).then_some(Pick { sighting, spot })
    };
    sightings.iter().filter_map(pick).collect()
}

/// Offset of every spot from where the lens puts the sun, pixels over its spread; none where the lens does not image one.
fn offsets(lens: &Lens, picks: &[Pick<'_>]) -> Option<Vec<[f64; 2]>> {
    let offset = |pick: &Pick<'_>| {
        let expected = lens.project(pick.sighting.sun_dir_world)?;
        Some(std::array::from_fn(|axis| (expected[axis] - pick.spot.position_px[axis]) / pick.spot.spread()))
    };
    picks.iter().map(offset).collect()
}

/// Standard deviation per axis from the median distance (Rayleigh's median is 1.1774 of it), of spots that `parameters` numbers
/// were fitted to.
fn deviation(offsets: &[[f64; 2]], parameters: usize) -> f64 {
    let mut distances: Vec<f64> = offsets.iter().map(|[x, y]| x.hypot(*y)).collect();
    let Some(median) = median(&mut distances) else { return LEAST_DEVIATION_PX };
    let numbers = 2.0 * offsets.len() as f64;
    let freed = numbers / (numbers - parameters as f64).max(1.0);
    (median / 1.1774 * freed.sqrt()).max(LEAST_DEVIATION_PX)
}

/// What is being fitted: nominal values, the lens so far, and which parameters move.
struct Fit<'a> {
    nominal: &'a LensFile,
    now: LensFile,
    active: Vec<usize>,
}

impl Fit<'_> {
    /// One least-squares run over picked spots with the weights of the lens so far.
    fn run(&mut self, picks: &[Pick<'_>]) -> Option<Solution> {
        let base = self.now.clone();
        let before = offsets(&parameters::lens(&base)?, picks)?;
        let sigma = deviation(&before, self.active.len());
        let root_weights: Vec<f64> = before
            .iter()
            .map(|[x, y]| 1.0 / (sigma * (1.0 + (x.hypot(*y) / (CAUCHY * sigma)).powi(2)).sqrt()))
            .collect();
        let active = self.active.clone();
        let drift = self.drift();
        let residuals = |p: &[f64]| {
            let lens = parameters::lens(&parameters::offset(&base, &spread_out(p, &active))?)?;
            let spots = offsets(&lens, picks)?;
            let mut all: Vec<f64> =
                spots.iter().zip(&root_weights).flat_map(|([x, y], weight)| [x * weight, y * weight]).collect();
            // What is known of lenses: each parameter's distance from its nominal value.
            all.extend(p.iter().zip(&active).map(|(p, &index)| (p + drift[index]) / SPREAD[index]));
            Some(all)
        };
        let steps: Vec<f64> = active.iter().map(|&index| STEPS[index]).collect();
        let solution = minimise(&vec![0.0; active.len()], &steps, residuals)?;
        self.now = parameters::offset(&base, &spread_out(&solution.parameters, &active))?;
        Some(solution)
    }

    /// How far the lens so far is off its nominal values, in the parameters' units.
    fn drift(&self) -> [f64; COUNT] {
        let (now, nominal, side) = (&self.now, self.nominal, smaller_side(self.nominal));
        let mut drift = [0.0; COUNT];
        drift[3] = (now.focal_px / nominal.focal_px).ln();
        for axis in 0..2 {
            drift[4 + axis] = (now.center_px[axis] - nominal.center_px[axis]) / side;
        }
        for i in 0..4 {
            drift[6 + i] = now.k[i] - nominal.k[i];
        }
        drift
    }

    /// Puts a parameter back to its nominal value, for good.
    fn hold(&mut self, index: usize) {
        self.active.retain(|&other| other != index);
        match index {
            3 => self.now.focal_px = self.nominal.focal_px,
            4 | 5 => self.now.center_px[index - 4] = self.nominal.center_px[index - 4],
            6.. => self.now.k[index - 6] = self.nominal.k[index - 6],
            _ => {}
        }
    }

    /// Fits and looks for spots again until both have settled; the last solution with its picks.
    fn settle<'a>(&mut self, sightings: &[&'a Sighting], first_gate_px: f64) -> Option<(Solution, Vec<Pick<'a>>)> {
        let mut gate = first_gate_px;
        let mut last = None;
        for _ in 0..TURNS {
            let picked = picks(&parameters::lens(&self.now)?, sightings, gate);
            if picked.len() < super::MIN_SIGHTINGS {
                return None;
            }
            let solution = self.run(&picked)?;
            let sigma = deviation(&offsets(&parameters::lens(&self.now)?, &picked)?, self.active.len());
            gate = (gate * SHRINK).max(GATE_DEVIATIONS * sigma).max(LEAST_GATE_PX);
            last = Some((solution, picked));
        }
        last
    }
}

fn spread_out(values: &[f64], active: &[usize]) -> [f64; COUNT] {
    let mut all = [0.0; COUNT];
    active.iter().zip(values).for_each(|(&index, &value)| all[index] = value);
    all
}

/// Refines a lens whose orientation and focal length are about right (`start`'s other values are the nominal ones).
pub(super) fn refine(sightings: &[&Sighting], start: &LensFile, nominal: &LensFile) -> Option<PathFit> {
    let mut fit = Fit { nominal, now: start.clone(), active: of_model(start.model).collect() };
    let (mut solution, mut picked) = fit.settle(sightings, FIRST_GATE * smaller_side(start))?;
    // The covariance with all parameters free, each within its spread, is the honest one for what is held afterwards, too.
    let (all, covariance) = (fit.active.clone(), solution.covariance.clone());
    let mut held = Vec::new();
    while let Some(index) = least_told(&fit.active, &solution.covariance) {
        held.push(index);
        fit.hold(index);
        (solution, picked) = fit.settle(sightings, 2.0 * LEAST_GATE_PX + FIRST_GATE * smaller_side(start) * 0.3)?;
    }
    held.sort_unstable();
    let lens = parameters::lens(&fit.now)?;
    let (sky_error_deg, worst_sky_error_deg) = sky_error(&fit.now, &all, &covariance);
    let turn: f64 =
        all.iter().enumerate().filter(|(_, i)| ORIENTATION.contains(i)).map(|(at, _)| covariance[at][at]).sum();
    Some(PathFit {
        found: found(&lens, &picked),
        set_aside: sightings.len() - picked.len(),
        without_spot: 0,
        held: held.into_iter().map(|index| NAMES[index]).collect(),
        orientation_error_deg: turn.sqrt().to_degrees(),
        sky_error_deg,
        worst_sky_error_deg,
        lens,
    })
}

/// The parameter that the path tells least, if it keeps most of its spread.
fn least_told(active: &[usize], covariance: &Matrix) -> Option<usize> {
    let kept = |at: usize| covariance[at][at].sqrt() / SPREAD[active[at]];
    let worst = (0..active.len()).max_by(|&a, &b| kept(a).total_cmp(&kept(b)))?;
    (kept(worst) > UNTOLD).then(|| active[worst])
}

fn found(lens: &Lens, picks: &[Pick<'_>]) -> Vec<Found> {
    let found = |pick: &Pick<'_>| {
        let (seen, sun) = (pick.spot.position_px, pick.sighting.sun_dir_world);
        let expected = lens.project(sun)?;
        let off = lens.unproject(seen)?;
        let chord = (0..3).map(|k| (off[k] - sun[k]).powi(2)).sum::<f64>().sqrt();
        Some(Found {
            captured_at_s: pick.sighting.captured_at_s,
            seen_px: seen,
            expected_px: expected,
            off_px: (seen[0] - expected[0]).hypot(seen[1] - expected[1]),
            off_deg: (2.0 * (0.5 * chord).min(1.0).asin()).to_degrees(),
        })
    };
    picks.iter().filter_map(found).collect()
}

/// Standard error of the directions that the lens gives to pixels which see the sky, rms and worst, degrees.
fn sky_error(file: &LensFile, active: &[usize], covariance: &Matrix) -> (f64, f64) {
    let variances: Vec<f64> = sky_directions()
        .into_iter()
        .filter_map(|dir| {
            let at = parameters::lens(file)?.project(dir)?;
            let inside =
                |axis: usize, end: Option<usize>| at[axis] >= 0.0 && end.is_none_or(|end| at[axis] < end as f64);
            (inside(0, file.width) && inside(1, file.height)).then(|| variance(file, active, covariance, at)).flatten()
        })
        .collect();
    let mean = variances.iter().sum::<f64>() / variances.len().max(1) as f64;
    let worst = variances.iter().copied().fold(0.0, f64::max);
    (mean.sqrt().to_degrees(), worst.sqrt().to_degrees())
}

/// Directions above the horizon, about equally far apart.
fn sky_directions() -> Vec<[f64; 3]> {
    let mut dirs = vec![[0.0, 1.0, 0.0]];
    let rings = ((90.0 - SKY_FROM_DEG) / SKY_STEP_DEG) as usize;
    for ring in 0..=rings {
        let (up, level) = (SKY_FROM_DEG + SKY_STEP_DEG * ring as f64).to_radians().sin_cos();
        let count = (level * 360.0 / SKY_STEP_DEG).ceil() as usize;
        dirs.extend((0..count).map(|i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / count as f64).sin_cos();
            [level * sin, up, -level * cos]
        }));
    }
    dirs
}

/// Variance of the direction at a picture position, radians squared: trace of J C J^T.
fn variance(file: &LensFile, active: &[usize], covariance: &Matrix, at: [f64; 2]) -> Option<f64> {
    let dir = |index: usize, by: f64| {
        let mut offsets = [0.0; COUNT];
        offsets[index] = by;
        parameters::lens(&parameters::offset(file, &offsets)?)?.unproject(at)
    };
    let slope = |&index: &usize| {
        let step = STEPS[index];
        let (low, high) = (dir(index, -step)?, dir(index, step)?);
        Some(std::array::from_fn(|k| (high[k] - low[k]) / (2.0 * step)))
    };
    let jacobian: Vec<[f64; 3]> = active.iter().map(slope).collect::<Option<_>>()?;
    let term = |i: usize, j: usize| (0..3).map(|k| jacobian[i][k] * jacobian[j][k]).sum::<f64>() * covariance[i][j];
    Some((0..active.len()).map(|i| (0..active.len()).map(|j| term(i, j)).sum::<f64>()).sum())
}
