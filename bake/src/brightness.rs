//! How bright a picture is: what counts as white in it, under skies and under each patch alone.
//!
//! A display's exposure follows the picture's bright end (the design's 99th percentile), so that is what an error is large or
//! small beside. A shaded court whose brightest stone is half as bright as paint in the open is shown as bright, and gets as
//! many ranks as it needs for that.

use crate::compress::Whites;
use crate::prior::Prior;
use rayon::prelude::*;

/// Share of values that are darker than what counts as white.
const WHITE_SHARE: f64 = 0.99;

/// The prior, with what counts as white in a picture, and display white under each patch alone. `samples` are responses
/// `[pixel][3][patch]` spread over the picture; where these are all black the prior stays as it is.
pub fn brightness(prior: Prior, samples: &[f32]) -> (Prior, Whites) {
    let patches = prior.patches();
    let basis = prior.basis();
    let rms = |row: &[f32]| {
        let modes = basis.column_iter().map(|mode| mode.iter().zip(row).map(|(m, r)| m * r).sum::<f32>());
        f64::from(modes.map(|v| v * v).sum::<f32>().sqrt())
    };
    let mut bright: Vec<f64> = samples.par_chunks_exact(patches).map(rms).collect();
    bright.sort_unstable_by(f64::total_cmp);
    let at = (WHITE_SHARE * bright.len().saturating_sub(1) as f64) as usize;
    let lit = |white: &f64| *white > 0.0 && white.is_finite();
    let prior = match bright.get(at).copied().filter(lit).or(bright.last().copied().filter(lit)) {
        Some(white) => prior.with_white(white),
        None => prior,
    };
    (prior, Whites::of(samples, patches))
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_firmware::patches::PatchSet;

    #[test]
    fn white_is_as_bright_as_all_but_the_brightest_values() {
        let set = PatchSet::new(64).unwrap();
        let prior = Prior::skies(&set);
        let cosine = |patch: usize| set.dir_world(patch)[1].max(0.0) * set.solid_angle_sr(patch);
        // Level surfaces of albedo pi * (1 .. 100) / 100 * 0.8: white paint, as the prior has it, is 0.8.
        let row = |pixel: usize| (0..3 * set.len()).map(move |at| (pixel + 1) as f32 / 100.0 * cosine(at % set.len()));
        let samples: Vec<f32> = (0..100).flat_map(row).collect();
        let paint = prior.white() / 0.8 * std::f64::consts::PI;
        let (prior, _) = brightness(prior, &samples);
        assert!((prior.white() / paint - 0.99).abs() < 1e-3, "{} of {paint}", prior.white());
    }

    #[test]
    fn a_black_picture_leaves_the_prior_alone() {
        let prior = Prior::skies(&PatchSet::new(64).unwrap());
        let (same, _) = brightness(prior.clone(), &vec![0.0; 3 * 10 * prior.patches()]);
        assert_eq!(same.white(), prior.white());
    }
}
