//! Frames of a series whose exposure is not what it is said to be.

use super::super::blocks::Block;
use super::{Fit, fit_all};
use crate::quantile::median;

/// A frame whose residual is larger is looked at (a twentieth of a stop is .035).
const DOUBTFUL: f64 = 0.05;

/// A frame whose exposure does not fit what the others show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DoubtfulFrame {
    /// Its place in the series.
    pub frame: usize,
    /// True exposure over the stated one.
    pub factor: f64,
}

/// The blocks without one frame's samples.
pub(super) fn without(blocks: &[Block], frame: usize) -> Vec<Block> {
    let kept = blocks
        .iter()
        .map(|block| Block { samples: block.samples.iter().filter(|sample| sample.frame != frame).copied().collect() });
    kept.filter(|block| block.samples.len() > 1).collect()
}

/// Median residual of one frame's samples over all channels.
fn frame_residual(blocks: &[Vec<Block>; 3], fits: &[Fit], frame: usize) -> f64 {
    let mut all: Vec<f64> = (0..3)
        .flat_map(|k| blocks[k].iter().zip(&fits[k].residuals))
        .flat_map(|(block, found)| block.samples.iter().zip(found))
        .filter(|(sample, _)| sample.frame == frame)
        .map(|(_, residual)| *residual)
        .collect();
    let is_enough = all.len() >= 16;
    median(&mut all).filter(|_| is_enough).unwrap_or(0.0)
}

/// A frame without which all the others fit at least four times better, and by how much its exposure is off.
pub(super) fn doubtful(blocks: &[Vec<Block>; 3], log_times: &[f64], black: f64, fits: &[Fit]) -> Option<DoubtfulFrame> {
    let worst = (0..log_times.len())
        .map(|frame| (frame, frame_residual(blocks, fits, frame).abs()))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    if log_times.len() < 4 || worst.1 < DOUBTFUL {
        return None;
    }
    let misfit = |fits: &[Fit]| fits.iter().map(|fit| fit.misfit).sum::<f64>();
    let tried = (0..log_times.len()).filter_map(|frame| {
        let rest = [0, 1, 2].map(|k| without(&blocks[k], frame));
        let found = fit_all(&rest, log_times, black).ok()?;
        Some((frame, misfit(&found), rest, found))
    });
    let (frame, left, _, found) = tried.min_by(|a, b| a.1.total_cmp(&b.1))?;
    if left > 0.25 * misfit(fits) {
        return None;
    }
    // The left-out frame against the curve of the others.
    let again: Vec<Fit> = found
        .into_iter()
        .zip(blocks)
        .map(|(mut fit, blocks)| {
            fit.residuals = against_others(&fit, blocks, log_times, frame);
            fit
        })
        .collect();
    Some(DoubtfulFrame { frame, factor: frame_residual(blocks, &again, frame).exp() })
}

/// Residuals against each block's light in all frames but one.
fn against_others(fit: &Fit, blocks: &[Block], log_times: &[f64], frame: usize) -> Vec<Vec<f64>> {
    let of_block = |block: &Block| {
        let rest = || block.samples.iter().map(|s| (s, fit.light(s) - log_times[s.frame], 1.0 / fit.variance(s)));
        let others = || rest().filter(|(sample, ..)| sample.frame != frame);
        let total: f64 = others().map(|(_, _, weight)| weight).sum();
        let log_e = others().map(|(_, value, weight)| value * weight).sum::<f64>() / total;
        rest().map(|(_, value, _)| if total > 0.0 { value - log_e } else { 0.0 }).collect()
    };
    blocks.iter().map(of_block).collect()
}
