//! How far two pictures are apart, as the design defines it: linear, all channels, covered pixels.

use serde::Serialize;

/// Linear premultiplied radiance with coverage, borrowed; row 0 at the top.
#[derive(Clone, Copy)]
pub(super) struct Linear<'p> {
    pub width: usize,
    pub rgb: &'p [[f32; 3]],
    pub coverage: &'p [f32],
}

/// rms(difference) / mean(exact) over all channels of the pixels given; 0 when `exact` is dark.
pub(super) fn relative_rmse(found: &[[f32; 3]], exact: &[[f64; 3]]) -> f64 {
    let (mut square, mut sum) = (0.0, 0.0);
    for (&found, &truth) in found.as_flattened().iter().zip(exact.as_flattened()) {
        square += (f64::from(found) - truth).powi(2);
        sum += truth;
    }
    let count = exact.as_flattened().len().max(1) as f64;
    if sum > 0.0 { (square / count).sqrt() / (sum / count) } else { 0.0 }
}

/// A picture against a path trace of half its size.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Blocks {
    /// (mean - mean of reference) / mean of reference, red, green, blue.
    pub bias: [f64; 3],
    /// Relative RMSE over means of 8x8 blocks of the reference's pixels.
    pub block_rmse: f64,
}

/// Compares over the pixels that both cover by more than 0.999, in blocks that have at least 16 of them.
pub(super) fn against_reference(found: Linear<'_>, reference: Linear<'_>) -> Blocks {
    const SIDE: usize = 8;
    let columns = reference.width.div_ceil(SIDE);
    let rows = (reference.rgb.len() / reference.width.max(1)).div_ceil(SIDE);
    let mut blocks = vec![([0.0f64; 3], [0.0f64; 3], 0u32); columns * rows];
    for (at, (truth, &share)) in reference.rgb.iter().zip(reference.coverage).enumerate() {
        let (x, y) = (at % reference.width, at / reference.width);
        let (mean, covered) = half(found, x, y);
        if share > 0.999 && covered > 0.999 {
            let block = &mut blocks[y / SIDE * columns + x / SIDE];
            for channel in 0..3 {
                block.0[channel] += mean[channel];
                block.1[channel] += f64::from(truth[channel]);
            }
            block.2 += 1;
        }
    }
    let bias = std::array::from_fn(|channel| {
        let sum: f64 = blocks.iter().map(|block| block.0[channel]).sum();
        let truth: f64 = blocks.iter().map(|block| block.1[channel]).sum();
        if truth > 0.0 { sum / truth - 1.0 } else { 0.0 }
    });
    let full: Vec<_> = blocks.iter().filter(|block| block.2 >= 16).collect();
    let found: Vec<[f32; 3]> = full.iter().map(|b| b.0.map(|sum| (sum / f64::from(b.2)) as f32)).collect();
    let truth: Vec<[f64; 3]> = full.iter().map(|b| b.1.map(|sum| sum / f64::from(b.2))).collect();
    Blocks { bias, block_rmse: relative_rmse(&found, &truth) }
}

/// The mean of the 2x2 pixels that pixel (x, y) of a picture of half the size stands for, and the least coverage.
fn half(picture: Linear<'_>, x: usize, y: usize) -> ([f64; 3], f32) {
    let (mut mean, mut covered) = ([0.0; 3], f32::INFINITY);
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let at = (2 * y + dy) * picture.width + 2 * x + dx;
        let (Some(rgb), Some(&share)) = (picture.rgb.get(at), picture.coverage.get(at)) else { return (mean, 0.0) };
        (0..3).for_each(|channel| mean[channel] += 0.25 * f64::from(rgb[channel]));
        covered = covered.min(share);
    }
    (mean, covered)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rmse_is_relative_to_the_mean() {
        // Differences 0 and 1: rms sqrt(1/2), mean 2.
        let found = relative_rmse(&[[2.0; 3], [3.0; 3]], &[[2.0; 3]; 2]);
        assert!((found - 0.5f64.sqrt() / 2.0).abs() < 1e-9, "{found}");
        assert_eq!(relative_rmse(&[[1.0; 3]; 3], &[[0.0; 3]; 3]), 0.0);
    }

    #[test]
    fn blocks_find_bias_and_local_error_and_forgive_noise() {
        // 32x32 against 16x16: four blocks; the left ones 10 % too bright, checker noise everywhere.
        let (full, small) = (vec![1.0; 32 * 32], vec![1.0; 16 * 16]);
        let truth = vec![[1.0, 2.0, 4.0]; 16 * 16];
        let noisy = |at: usize| {
            let gain = if at % 32 < 16 { 1.1 } else { 1.0 } + if (at + at / 32).is_multiple_of(2) { 0.3 } else { -0.3 };
            [gain, 2.0 * gain, 4.0 * gain]
        };
        let picture: Vec<[f32; 3]> = (0..32 * 32).map(noisy).collect();
        let found = Linear { width: 32, rgb: &picture, coverage: &full };
        let blocks = against_reference(found, Linear { width: 16, rgb: &truth, coverage: &small });
        assert!(blocks.bias.iter().all(|bias| (bias - 0.05).abs() < 1e-4), "{blocks:?}");
        // Half of the blocks off by 10 % of (1, 2, 4): rms 0.1 sqrt(21 / 3 / 2), mean 7 / 3.
        assert!((blocks.block_rmse - 0.1 * 3.5f64.sqrt() / (7.0 / 3.0)).abs() < 1e-4, "{blocks:?}");
    }
}
