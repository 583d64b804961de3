//! How light varies inside parts of the sky, under the prior: what choosing patches must know, finer than any set of them.

use super::{Mixture, around, draw_skies, low_orders};
use nalgebra::DMatrix;
use relume_firmware::patches::PatchSet;
use std::ops::Range;

/// Skies drawn: parts of one ring share what they tell, so fewer do than for a whole prior.
const SKIES: usize = 500;

/// Second moments of the radiance of the patches in each of `parts`, for skies of mean radiance 1, but for the white part.
pub(crate) fn moments(set: &PatchSet, parts: &[Range<usize>]) -> Vec<DMatrix<f64>> {
    if set.horizon().is_none() {
        let of = |part: &Range<usize>| {
            let dir = |at: usize| set.dir_world(part.start + at);
            DMatrix::from_fn(part.len(), part.len(), |i, j| around::smooth_moment(dir(i), dir(j)))
        };
        return parts.iter().map(of).collect();
    }
    let mixture = Mixture { skies: SKIES, ..Mixture::default() };
    let skies = draw_skies(set, &mixture);
    let lows = low_orders(set);
    let of = |part: &Range<usize>| {
        let mut moment = DMatrix::zeros(part.len(), part.len());
        let mut add = |light: &[f64], weight: f64| {
            for j in 0..part.len() {
                for i in 0..part.len() {
                    moment[(i, j)] += weight * light[i] * light[j];
                }
            }
        };
        skies.iter().for_each(|sky| add(&sky[part.clone()], 1.0 / SKIES as f64));
        lows.iter().for_each(|low| add(&low.as_slice()[part.clone()], mixture.low_order.powi(2)));
        moment
    };
    parts.iter().map(of).collect()
}

/// Variance of the white part of the radiance of one of a set's patches, for light of mean 1: what no smooth sky tells.
pub(crate) fn white_variance(set: &PatchSet) -> f64 {
    if set.horizon().is_none() { around::WHITE.powi(2) } else { Mixture::default().white.powi(2) }
}
