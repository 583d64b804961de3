//! Errors of a picture against the exact sum, as the design defines them.
//!
//! Relative RMSE = rms(difference) / mean(exact), all channels of the covered pixels, linear radiance. Bias = (mean -
//! mean of exact) / mean of exact, per channel. Code errors: plain sRGB curve, clamp, round, no dither, at
//! [`exposure_for`] the exact picture, the same for both.

use super::clock::median;

/// Errors of one picture under one sky. All are fractions, not per cent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Relative RMSE of the radiance.
    pub rmse: f64,
    /// Relative bias per channel; 0 where the exact channel is black.
    pub bias: [f64; 3],
    /// Largest difference of an 8-bit value.
    pub worst_code: u8,
    /// Share of 8-bit values that differ by more than one.
    pub share_off_by_more_than_one: f64,
    /// Largest distance of an 8-bit value shown from the exact picture's code before rounding: what a bound in codes bounds.
    pub code_error: f64,
    /// The bound in codes that the method gave for this picture; `None`: it gave none.
    pub bound_codes: Option<f64>,
}

/// Errors over several skies: the median and the worst RMSE, the worst of the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Median over the skies.
    pub rmse_median: f64,
    /// Worst sky.
    pub rmse_worst: f64,
    /// Largest absolute bias of any channel under any sky.
    pub bias_worst: f64,
    /// Worst value of any sky.
    pub worst_code: u8,
    /// Worst sky.
    pub share_off_by_more_than_one: f64,
}

/// The 8-bit value of a linear channel value under the plain sRGB curve (IEC 61966-2-1): clamp, round, no dither.
pub fn srgb_code(linear: f64) -> u8 {
    unrounded_code(linear).round() as u8
}

/// The same before rounding.
pub fn unrounded_code(linear: f64) -> f64 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    255.0 * encoded
}

/// Exposure of a sky: 0.8 / 99th percentile of the exact covered channel values (linear between order statistics).
///
/// `None` where that percentile is not positive: nothing is lit.
pub fn exposure_for(exact: &[[f64; 3]]) -> Option<f64> {
    let mut values: Vec<f64> = exact.iter().flatten().copied().collect();
    if values.is_empty() {
        return None;
    }
    let place = 0.99 * (values.len() - 1) as f64;
    let below = place as usize;
    let (_, &mut low, above) = values.select_nth_unstable_by(below, f64::total_cmp);
    let high = above.iter().copied().fold(f64::INFINITY, f64::min);
    let percentile = if above.is_empty() { low } else { low + (high - low) * (place - below as f64) };
    (percentile > 0.0 && percentile.is_finite()).then(|| 0.8 / percentile)
}

/// Compares a picture with the exact one; all three lists hold the same covered pixels in the same order.
///
/// `codes` are the 8-bit values as the method shows them at `exposure`; the exact picture's are made here.
pub fn compare(radiance: &[[f32; 3]], codes: &[[u8; 3]], exact: &[[f64; 3]], exposure: f64) -> Errors {
    let values = (3 * exact.len()).max(1) as f64;
    let (mut square, mut sum, mut exact_sum) = (0.0, [0.0; 3], [0.0; 3]);
    let (mut worst, mut off, mut code_error) = (0u8, 0usize, 0.0f64);
    for ((shown, code), truth) in radiance.iter().zip(codes).zip(exact) {
        for c in 0..3 {
            let value = f64::from(shown[c]);
            square += (value - truth[c]).powi(2);
            sum[c] += value;
            exact_sum[c] += truth[c];
            let exact_code = unrounded_code(truth[c] * exposure);
            code_error = code_error.max((f64::from(code[c]) - exact_code).abs());
            let difference = code[c].abs_diff(exact_code.round() as u8);
            worst = worst.max(difference);
            off += usize::from(difference > 1);
        }
    }
    let mean = exact_sum.iter().sum::<f64>() / values;
    Errors {
        rmse: (square / values).sqrt() / mean,
        bias: std::array::from_fn(|c| if exact_sum[c] > 0.0 { (sum[c] - exact_sum[c]) / exact_sum[c] } else { 0.0 }),
        worst_code: worst,
        share_off_by_more_than_one: off as f64 / values,
        code_error,
        bound_codes: None,
    }
}

/// Sums up the errors of several skies; `None` for none.
pub fn summarise(errors: &[Errors]) -> Option<Summary> {
    let rmse: Vec<f64> = errors.iter().map(|e| e.rmse).collect();
    Some(Summary {
        rmse_median: median(&rmse),
        rmse_worst: rmse.iter().copied().reduce(f64::max)?,
        bias_worst: errors.iter().flat_map(|e| e.bias).map(f64::abs).fold(0.0, f64::max),
        worst_code: errors.iter().map(|e| e.worst_code).max()?,
        share_off_by_more_than_one: errors.iter().map(|e| e.share_off_by_more_than_one).fold(0.0, f64::max),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(exact: &[[f64; 3]], exposure: f64) -> Vec<[u8; 3]> {
        exact.iter().map(|p| p.map(|v| srgb_code(v * exposure))).collect()
    }

    #[test]
    fn an_equal_picture_has_no_error() {
        let exact = [[1.0, 2.0, 4.0], [0.5, 0.25, 0.125]];
        let same = exact.map(|p| p.map(|v| v as f32));
        let errors = compare(&same, &codes(&exact, 0.2), &exact, 0.2);
        assert_eq!((errors.rmse, errors.bias, errors.worst_code), (0.0, [0.0; 3], 0));
        assert_eq!(errors.share_off_by_more_than_one, 0.0);
        // Rounding is left.
        assert!(errors.code_error > 0.01 && errors.code_error <= 0.5, "{errors:?}");
    }

    #[test]
    fn a_constant_offset_by_hand() {
        // Exact 2 everywhere, shown 2.5 in red: rms = 0.5 / sqrt(3), mean = 2.
        let exact = [[2.0; 3]; 10];
        let errors = compare(&[[2.5, 2.0, 2.0]; 10], &codes(&exact, 0.1), &exact, 0.1);
        assert!((errors.rmse - 0.5 / 3f64.sqrt() / 2.0).abs() < 1e-12);
        assert_eq!(errors.bias, [0.25, 0.0, 0.0]);
    }

    #[test]
    fn code_errors_are_counted_beyond_one() {
        let exact = [[0.5; 3], [0.5; 3]];
        let code = srgb_code(0.5);
        let shown = [[code, code + 1, code - 2], [code + 9, code, code]];
        let errors = compare(&[[0.5; 3]; 2], &shown, &exact, 1.0);
        assert_eq!(errors.worst_code, 9);
        // Half is code 187.516.
        assert!((errors.code_error - (9.0 + 188.0 - 187.516)).abs() < 1e-3, "{errors:?}");
        assert!((errors.share_off_by_more_than_one - 2.0 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn srgb_curve_at_known_places() {
        // IEC 61966-2-1: 18 % grey is code 118, half is 188; out of range is clamped.
        assert_eq!([0.0, 0.18, 0.5, 1.0, 7.0, -1.0].map(srgb_code), [0, 118, 188, 255, 255, 0]);
        assert_eq!(srgb_code(0.003), 10);
    }

    #[test]
    fn exposure_is_four_fifths_of_the_percentile() {
        // 0, 1, ..., 299: place 0.99 x 299 = 296.01.
        let exact: Vec<[f64; 3]> = (0..100).rev().map(|k| [0, 1, 2].map(|c| f64::from(3 * k + c))).collect();
        assert!((exposure_for(&exact).unwrap() - 0.8 / 296.01).abs() < 1e-12);
        assert_eq!(exposure_for(&[[0.0; 3]; 9]), None);
        assert_eq!(exposure_for(&[]), None);
        assert_eq!(exposure_for(&[[0.4; 3]]), Some(2.0));
    }

    #[test]
    fn summary_takes_median_and_worst() {
        let one = |rmse, code| Errors {
            rmse,
            bias: [0.0, -rmse, 0.0],
            worst_code: code,
            share_off_by_more_than_one: rmse / 10.0,
            code_error: 0.0,
            bound_codes: None,
        };
        let summary = summarise(&[one(0.1, 3), one(0.5, 1), one(0.2, 9)]).unwrap();
        assert_eq!((summary.rmse_median, summary.rmse_worst, summary.worst_code), (0.2, 0.5, 9));
        assert_eq!((summary.bias_worst, summary.share_off_by_more_than_one), (0.5, 0.05));
        assert!(summarise(&[]).is_none());
    }
}
