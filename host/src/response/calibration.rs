//! The camera's response from an exposure series, after Debevec & Malik 1997, equation 3.
//!
//! For a block b in frame i: g(code_bi) = ln E_b + ln t_i, with g = ln of the inverse response. Here g is a cubic spline over
//! ln(code + 2), codes in 255ths above black, smooth there (a P-spline, Eilers & Marx 1996): power laws are straight and
//! films bend gently. Instead of single pixels, means of flat 8x8 blocks without clipped pixels are fitted, each by its inverse
//! variance, and the mean of a block's codes is corrected to the mean of its light by the curve found so far. How smooth is
//! decided by cross-validation over blocks. The curve is 1 at full well, not at the middle code.

mod doubt;

use super::blocks::{Block, Sample, black_level, flat_blocks};
use super::spline::{Basis, Normal};
use super::{Response, ResponseError};
use crate::camera::{Codes, Frame};
use crate::quantile::{median, quantile};
pub use doubt::DoubtfulFrame;
use doubt::{doubtful, without};

/// Intervals of the spline.
const INTERVALS: usize = 64;
/// Order of the differences that are kept small.
const BENDS: usize = 2;
/// Parts of the cross-validation.
const FOLDS: usize = 5;
/// Rounds of refitting, with weights and corrections by the curve of the round before.
const ROUNDS: usize = 5;
/// Error of a sample's log that no noise explains.
const FLOOR: f64 = 2e-3;
/// Exponent of the flattest inverse response that weights are taken from: a fit that went astray must find back.
const LEAST_POWER: f64 = 0.5;
/// Samples this many times further off than usual are left out: something moved there.
const OUTLIER: f64 = 5.0;
/// Exposures that differ by less count as the same.
const SAME: f64 = 0.01;
/// Why no response could be found; one line that says what to do.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// Fewer than two frames.
    #[error("{0} frame(s): a response needs at least two different exposures, better ten, one stop apart")]
    TooFew(usize),
    /// All frames have one exposure.
    #[error("all {0} frames have the same exposure; take them at different times, better ten, one stop apart")]
    Identical(usize),
    /// A frame's exposure is no time.
    #[error("frame {0}: exposure time x gain is {1}; it must be positive")]
    Exposure(usize, f64),
    /// A frame differs in size from the first.
    #[error("frame {0} has another size than the first frame")]
    Size(usize),
    /// Nothing but black.
    #[error("every frame is black; take longer exposures")]
    Black,
    /// Nothing but clipped pixels.
    #[error("every frame is clipped; take shorter exposures")]
    Clipped,
    /// Too little is seen in two exposures.
    #[error(
        "{channel}: only {blocks} flat blocks are unclipped in two exposures; take a scene with smooth parts of every \
             brightness, exposures at most 3 stops apart"
    )]
    NoOverlap {
        /// Name of the channel.
        channel: &'static str,
        /// Blocks found.
        blocks: usize,
    },
    /// The equations have no solution.
    #[error("{0}: the frames do not determine a curve; check the exposure times in frames.json")]
    Singular(&'static str),
    /// The curve found is none.
    #[error(transparent)]
    Curve(#[from] ResponseError),
}

/// How well one channel's curve fits.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelFit {
    /// Blocks used.
    pub blocks: usize,
    /// RMS of the samples' log residuals, natural logarithm.
    pub rms_log: f64,
    /// Lowest and highest code / max that blocks showed; beyond, the curve is continued.
    pub seen: [f64; 2],
}

/// A response and how it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The inverse response, full well = 1.
    pub response: Response,
    /// Code / max of black.
    pub black: f64,
    /// Fit of red, green and blue.
    pub channels: [ChannelFit; 3],
    /// A frame that was left out because its exposure does not fit.
    pub left_out: Option<DoubtfulFrame>,
}

const CHANNELS: [&str; 3] = ["red", "green", "blue"];

/// Finds the response of the camera that took `frames`, in any order; `black` (share of the largest code) is found from pixels
/// that stay dark if it is not given.
///
/// # Errors
/// [`CalibrationError`]: too few or equal exposures, nothing to see, nothing seen twice.
pub fn calibrate(frames: &[Frame], black: Option<f64>) -> Result<Calibration, CalibrationError> {
    check(frames)?;
    let black = black.or_else(|| black_level(frames)).unwrap_or(0.0);
    let log_times: Vec<f64> = frames.iter().map(|frame| frame.exposure.product_s().ln()).collect();
    let mut blocks: [Vec<Block>; 3] = [0, 1, 2].map(|channel| flat_blocks(frames, channel, black));
    for (channel, found) in blocks.iter().enumerate() {
        if found.len() < 8 {
            return Err(CalibrationError::NoOverlap { channel: CHANNELS[channel], blocks: found.len() });
        }
    }
    let mut fits = fit_all(&blocks, &log_times, black)?;
    let left_out = doubtful(&blocks, &log_times, black, &fits);
    if let Some(doubt) = left_out {
        blocks = blocks.map(|found| without(&found, doubt.frame));
        fits = fit_all(&blocks, &log_times, black)?;
    }
    let deep = frames.iter().any(|frame| matches!(frame.codes, Codes::U16(_)));
    let response = Response::from_rows(rows(&fits, &blocks, black, if deep { 4096 } else { 255 }), "response")?;
    let channels = [0, 1, 2].map(|k| fits[k].summary(&blocks[k], black));
    Ok(Calibration { response, black, channels, left_out })
}

fn check(frames: &[Frame]) -> Result<(), CalibrationError> {
    let Some(first) = frames.first().filter(|_| frames.len() > 1) else {
        return Err(CalibrationError::TooFew(frames.len()));
    };
    for (index, frame) in frames.iter().enumerate() {
        let product = frame.exposure.product_s();
        if !(product.is_finite() && product > 0.0) {
            return Err(CalibrationError::Exposure(index, product));
        }
        if (frame.width, frame.height) != (first.width, first.height) {
            return Err(CalibrationError::Size(index));
        }
    }
    let ratio = |frame: &Frame| (frame.exposure.product_s() / first.exposure.product_s()).ln().abs();
    if frames.iter().all(|frame| ratio(frame) < SAME) {
        return Err(CalibrationError::Identical(frames.len()));
    }
    let codes = || {
        frames.iter().flat_map(|frame| {
            let max = f64::from(frame.codes.max());
            (0..frame.codes.len()).step_by(7).map(move |i| f64::from(frame.codes.get(i)) / max)
        })
    };
    if codes().all(|code| code < 1.5 / 255.0) {
        return Err(CalibrationError::Black);
    }
    if codes().all(|code| code >= 250.0 / 255.0) {
        return Err(CalibrationError::Clipped);
    }
    Ok(())
}

/// The curve of one channel.
struct Fit {
    basis: Basis,
    coefficients: Vec<f64>,
    /// Residual of every sample of every block, natural logarithm.
    residuals: Vec<Vec<f64>>,
    /// Sum of squared residuals over their variances, per sample.
    misfit: f64,
}

fn u_of(code: f64) -> f64 {
    (code.max(0.0) + 2.0).ln()
}

/// The factor of the power law; codes are never quite 0.
fn power_of(code: f64) -> f64 {
    code.max(0.02).ln()
}

/// The equation's row for a code: the spline's functions, and the power law's.
fn row_of(basis: &Basis, code: f64) -> [(usize, f64); 5] {
    let (first, values) = basis.at(u_of(code));
    std::array::from_fn(|k| values.get(k).map_or((basis.len(), power_of(code)), |&value| (first + k, value)))
}

impl Fit {
    fn g(&self, code: f64) -> f64 {
        row_of(&self.basis, code).iter().map(|&(i, value)| self.coefficients[i] * value).sum()
    }

    fn slope(&self, code: f64) -> f64 {
        let (low, high) = ((code - 0.5).max(0.0), (code + 0.5).min(255.0));
        ((self.g(high) - self.g(low)) / (high - low)).max(LEAST_POWER / (code + 2.0))
    }

    /// ln of the mean light of a sample: the curve at its mean code, corrected for the spread of its codes.
    fn light(&self, sample: &Sample) -> f64 {
        let at = self.g(sample.code);
        let half = (sample.spread - 1.0 / 12.0).max(0.0).sqrt().min(sample.code);
        let mean = 0.5 * ((self.g(sample.code + half) - at).exp() + (self.g(sample.code - half) - at).exp());
        at + mean.ln()
    }

    /// Variance of ln of the mean light.
    fn variance(&self, sample: &Sample) -> f64 {
        self.slope(sample.code).powi(2) * sample.variance + FLOOR * FLOOR
    }

    fn summary(&self, blocks: &[Block], black: f64) -> ChannelFit {
        let residuals = || self.residuals.iter().flatten();
        let square: f64 = residuals().map(|r| r * r).sum();
        let codes = || blocks.iter().flat_map(|block| &block.samples).map(|sample| sample.code / 255.0 + black);
        ChannelFit {
            blocks: blocks.len(),
            rms_log: (square / residuals().count().max(1) as f64).sqrt(),
            seen: [codes().fold(1.0, f64::min), codes().fold(0.0, f64::max)],
        }
    }
}

fn fit_all(blocks: &[Vec<Block>; 3], log_times: &[f64], black: f64) -> Result<Vec<Fit>, CalibrationError> {
    let one = |(channel, found): (usize, &Vec<Block>)| {
        fit(found, log_times, 255.0 * (1.0 - black)).ok_or(CalibrationError::Singular(CHANNELS[channel]))
    };
    blocks.iter().enumerate().map(one).collect()
}

/// Fits one channel; `full` is the largest code above black, in 255ths.
fn fit(blocks: &[Block], log_times: &[f64], full: f64) -> Option<Fit> {
    let basis = Basis::new(u_of(0.0), u_of(full), INTERVALS);
    // A square law to begin with.
    let mut coefficients = vec![0.0; basis.len() + 1];
    coefficients[basis.len()] = 2.0;
    let mut fit = Fit { basis, coefficients, residuals: Vec::new(), misfit: f64::INFINITY };
    let least = least_smoothness(log_times);
    for round in 0..ROUNDS {
        let forms = forms(&fit, blocks, log_times);
        // The first rounds find a power law: weights from it lead the others the right way.
        let range = if round < 2 { SMOOTHEST..=SMOOTHEST } else { least..=SMOOTHEST };
        fit.coefficients = smoothest(&forms, &basis, full, range)?;
        (fit.residuals, fit.misfit) = residuals(&fit, blocks, log_times);
    }
    Some(fit)
}

/// The equations of the blocks, ln E of each eliminated, one form per part of the cross-validation.
fn forms(fit: &Fit, blocks: &[Block], log_times: &[f64]) -> Vec<Normal> {
    let mut forms = vec![Normal::new(fit.basis.len() + 1); FOLDS];
    let usual = usual(fit, blocks);
    for (number, block) in blocks.iter().enumerate() {
        let form = &mut forms[number % FOLDS];
        let (mut mean_row, mut mean_target, mut total) = (vec![0.0; fit.basis.len() + 1], 0.0, 0.0);
        for (at, sample) in block.samples.iter().enumerate() {
            let variance = fit.variance(sample);
            let off = fit.residuals.get(number).map_or(0.0, |found| found[at] / variance.sqrt());
            if off.abs() > OUTLIER * usual {
                continue;
            }
            let row = row_of(&fit.basis, sample.code);
            let target = log_times[sample.frame] - (fit.light(sample) - fit.g(sample.code));
            let weight = 1.0 / variance;
            form.add(&row, target, weight);
            row.iter().for_each(|&(i, v)| mean_row[i] += weight * v);
            mean_target += weight * target;
            total += weight;
        }
        if total > 0.0 {
            let row: Vec<(usize, f64)> =
                mean_row.iter().enumerate().filter(|(_, v)| **v != 0.0).map(|(i, v)| (i, v / total)).collect();
            form.add(&row, mean_target / total, -total);
        }
    }
    forms
}

/// The usual residual in standard deviations (from the median), at least 1.
fn usual(fit: &Fit, blocks: &[Block]) -> f64 {
    let pairs = blocks.iter().zip(&fit.residuals);
    let mut all: Vec<f64> = pairs
        .flat_map(|(block, found)| block.samples.iter().zip(found))
        .map(|(sample, residual)| residual.abs() / fit.variance(sample).sqrt())
        .collect();
    median(&mut all).map_or(f64::INFINITY, |usual| (1.4826 * usual).max(1.0))
}

/// The smoothest curve that predicts blocks it has not seen about as well as the best one does.
fn smoothest(forms: &[Normal], basis: &Basis, full: f64, halves: std::ops::RangeInclusive<i32>) -> Option<Vec<f64>> {
    let mut total = Normal::new(basis.len() + 1);
    forms.iter().for_each(|form| total.add_form(form, 1.0));
    let solve = |without: Option<&Normal>, smoothness: f64| {
        let mut form = total.clone();
        if let Some(fold) = without {
            form.add_form(fold, -1.0);
        }
        form.add(&row_of(basis, full), 0.0, 1e3);
        form.add_bends(basis.len(), BENDS, smoothness);
        // What the penalty leaves free and the power law can do, the power law does.
        form.add_bends(basis.len(), 1, 1e-3);
        form.minimum()
    };
    let tried: Vec<f64> = halves.map(|i| 10f64.powf(0.5 * f64::from(i))).collect();
    let error = |smoothness: f64| -> Option<f64> {
        forms.iter().map(|fold| solve(Some(fold), smoothness).map(|c| fold.value(&c))).sum()
    };
    let errors: Vec<f64> = tried.iter().map(|&s| error(s).unwrap_or(f64::INFINITY)).collect();
    let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let chosen = (0..tried.len()).rev().find(|&i| errors[i] <= best * (1.0 + TOLERANCE))?;
    solve(None, tried[chosen])
}

/// The largest smoothness tried, in half decades.
const SMOOTHEST: i32 = 17;

/// The least smoothness tried, in half decades. Waves of the curve that return after exactly one step of exposure do not show
/// in the frames, and the wider the steps the longer such waves are; only smoothness forbids them.
fn least_smoothness(log_times: &[f64]) -> i32 {
    let mut sorted = log_times.to_vec();
    sorted.sort_by(f64::total_cmp);
    let steps = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|&step| step > SAME);
    let stops = steps.fold(f64::INFINITY, f64::min) / std::f64::consts::LN_2;
    (4.0 + 2.0 * stops.clamp(1.0, 3.0)).round() as i32
}

/// How much worse a smoother curve may predict.
const TOLERANCE: f64 = 0.1;

/// Residuals of all samples, and the mean of their squares over the variances.
fn residuals(fit: &Fit, blocks: &[Block], log_times: &[f64]) -> (Vec<Vec<f64>>, f64) {
    let (mut sum, mut count) = (0.0, 0usize);
    let of_block = |block: &Block| {
        let rest: Vec<f64> = block.samples.iter().map(|s| fit.light(s) - log_times[s.frame]).collect();
        let weights: Vec<f64> = block.samples.iter().map(|s| 1.0 / fit.variance(s)).collect();
        let log_e = rest.iter().zip(&weights).map(|(r, w)| r * w).sum::<f64>() / weights.iter().sum::<f64>();
        let found: Vec<f64> = rest.iter().map(|r| r - log_e).collect();
        sum += found.iter().zip(&weights).map(|(r, w)| r * r * w).sum::<f64>();
        count += found.len();
        found
    };
    let all = blocks.iter().map(of_block).collect();
    (all, sum / count.max(1) as f64)
}

/// Share of the samples that lie below the code from which the curve goes on as a power law.
const TOE: f64 = 0.02;

/// Rows of the curve file. Below the lowest codes seen the curve goes on as a power law to 0 at black.
fn rows(fits: &[Fit], blocks: &[Vec<Block>; 3], black: f64, steps: usize) -> Vec<[f64; 4]> {
    let mut rows: Vec<[f64; 4]> = (0..=steps).map(|step| [step as f64 / steps as f64, 0.0, 0.0, 0.0]).collect();
    for (channel, (fit, blocks)) in fits.iter().zip(blocks).enumerate() {
        let toe = toe_of(blocks);
        let power = (fit.slope(toe) * toe).clamp(LEAST_POWER, 4.0);
        let top = fit.g(255.0 * (1.0 - black));
        let mut before = 0.0;
        for row in &mut rows {
            let code = 255.0 * (row[0] - black);
            let log = if code < toe { fit.g(toe) + power * (code.max(1e-9) / toe).ln() } else { fit.g(code) };
            if code > 0.0 {
                before = (log - top).exp().clamp(before, 1.0);
            }
            row[channel + 1] = before;
        }
    }
    rows
}

/// The code above black that all but a few samples exceed.
fn toe_of(blocks: &[Block]) -> f64 {
    let mut codes: Vec<f64> = blocks.iter().flat_map(|block| &block.samples).map(|sample| sample.code).collect();
    quantile(&mut codes, TOE).unwrap_or(1.0)
}

#[cfg(test)]
mod tests;
