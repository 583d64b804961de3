//! Ranks of a block that one of its tiles does without.

use super::{Compressed, Residual, Rows, Target};
use crate::prior::Prior;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Drops the last ranks of the pixels of `tile` as long as the target still holds for them, and fits their row scales
/// to what is left.
pub(crate) fn trim(rows: &Rows, block: &mut Compressed, tile: Range<usize>, prior: &Prior, target: &Target) {
    let seen = [0, 1, 2].map(|channel| planes_seen(block, channel, prior));
    let mut rank = block.rank;
    while rank > 2 {
        let fitted = fit(rows, block, tile.clone(), &seen, rank - 2);
        if !fitted.residual.within(target) {
            break;
        }
        rank -= 2;
        block.row_scale[tile.clone()].copy_from_slice(&fitted.row_scale);
    }
    let dark = tile.clone().all(|pixel| block.row_scale[pixel] == [0.0; 3]);
    block.ranks[tile].fill(if dark { 0 } else { rank });
}

/// `V` of a channel in the prior's basis, modes x rank.
fn planes_seen(block: &Compressed, channel: usize, prior: &Prior) -> DMatrix<f32> {
    let patches = prior.patches();
    let (codes, scale) = (&block.v[channel], &block.v_scale[channel]);
    let planes = DMatrix::from_fn(patches, block.rank, |patch, k| f32::from(codes[k * patches + patch]) * scale[k]);
    prior.basis_transposed() * planes
}

struct Fitted {
    row_scale: Vec<[f32; 3]>,
    residual: Residual,
}

fn fit(rows: &Rows, block: &Compressed, tile: Range<usize>, seen: &[DMatrix<f32>; 3], rank: usize) -> Fitted {
    let mut squares = vec![0.0f64; tile.len()];
    let mut row_scale = vec![[0.0f32; 3]; tile.len()];
    for (channel, seen) in seen.iter().enumerate() {
        let planes = seen.columns(0, rank);
        for (at, pixel) in tile.clone().enumerate() {
            let index = pixel * 3 + channel;
            if rows.rms[index] <= 0.0 {
                continue;
            }
            let codes = &block.u[pixel * block.rank..][..rank];
            let codes = DVector::from_iterator(rank, codes.iter().map(|&code| f32::from(code)));
            let (shown, wanted) = (planes * codes, rows.seen.column(index));
            let square = shown.norm_squared();
            let scale = if square > 0.0 { (shown.dot(&wanted) / square).max(0.0) } else { 0.0 };
            row_scale[at][channel] = scale;
            let off = f64::from((wanted - shown * scale).norm());
            squares[at] += (off * rows.importance[index] / rows.rms[index]).powi(2);
        }
    }
    Fitted { row_scale, residual: Residual::of(squares.into_iter()) }
}
