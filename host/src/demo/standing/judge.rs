//! What is shown against what would be: colour differences where the temple is, and where its shadow falls.

use std::fmt;

use relume_bake::environment::Reference;
use relume_firmware::field::Field;
use relume_firmware::tile::TILE_PX;
use serde::Serialize;

use crate::colour::difference::delta_e_2000;
use crate::colour::spaces::{D65, Triple, XYZ_OF_REC709, apply, lab};
use crate::picture::srgb_linear;

/// A receiver whose light changes by more than this share is in shadow, or in light that is thrown back.
const SHADOWED: f32 = 0.05;
/// A difference of so many DE2000 is white in a map.
const MAP_WHITE: f64 = 10.0;

/// Colour differences (CIE DE2000) over some pixels.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Judgement {
    pub(super) pixels: usize,
    pub(super) median: f64,
    /// 95th percentile.
    pub(super) high: f64,
    /// Of pixels that the temple covers, and of shadowed receivers: medians.
    pub(super) covered_median: f64,
    pub(super) receiver_median: f64,
    /// The same of means over 4 x 4 pixels, in which the noise of camera and path trace is a quarter.
    pub(super) median_of_blocks: f64,
    pub(super) high_of_blocks: f64,
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Judgement { median, high, covered_median, receiver_median, median_of_blocks, high_of_blocks, .. } = self;
        write!(
            f,
            "DE2000 median {median:.2}, 95 % {high:.2} (temple {covered_median:.2}, ground {receiver_median:.2}; 4x4 pixels \
             {median_of_blocks:.2}, {high_of_blocks:.2})"
        )
    }
}

/// Judges what is shown by what would be, where a field covers pixels ([`covered`]) and where `real` and `whole` tell that light
/// changes.
pub(super) fn judge(
    shown: &[u32],
    truth: &[u32],
    (real, whole): (&Reference, &Reference),
    covered: &[bool],
) -> Judgement {
    let light = |rgb: [f32; 3]| rgb.iter().sum::<f32>();
    let width = real.width as usize;
    // A path trace's single pixels are too noisy to tell shadow from light.
    let is_shadowed = |at: usize| {
        let near = neighbours(at, width, real.rgb.len());
        let sum = |picture: &Reference| near.iter().map(|&at| light(picture.rgb[at])).sum::<f32>();
        let (before, after) = (sum(real), sum(whole));
        real.coverage[at] >= 1.0 && before > 0.0 && (after / before - 1.0).abs() > SHADOWED
    };
    let own: Vec<usize> = (0..shown.len()).filter(|&at| covered[at] || is_shadowed(at)).collect();
    let differences: Vec<f64> = own.iter().map(|&at| difference(rgb(shown[at]), rgb(truth[at]))).collect();
    let of = |wanted: bool| {
        let part =
            own.iter().zip(&differences).filter(|(at, _)| covered[**at] == wanted).map(|(_, difference)| *difference);
        quantile(part.collect(), 0.5)
    };
    let blocks = blocks(&own, width, (shown, truth));
    Judgement {
        pixels: own.len(),
        covered_median: of(true),
        receiver_median: of(false),
        median: quantile(differences.clone(), 0.5),
        high: quantile(differences, 0.95),
        median_of_blocks: quantile(blocks.clone(), 0.5),
        high_of_blocks: quantile(blocks, 0.95),
    }
}

/// Of a field's pixels, which are covered.
pub(super) fn covered(field: &Field<'_>) -> Vec<bool> {
    let mut covered = vec![false; field.width() * field.height()];
    let columns = field.response().grid().0;
    for index in 0..field.response().tiles() {
        let corner = index / columns * TILE_PX * field.width() + index % columns * TILE_PX;
        for place in field.response().tile(index).covered() {
            covered[corner + place / TILE_PX * field.width() + place % TILE_PX] = true;
        }
    }
    covered
}

/// A pixel and those around it.
fn neighbours(at: usize, width: usize, length: usize) -> Vec<usize> {
    let (x, y) = ((at % width) as i64, (at / width) as i64);
    let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
    let inside = near.filter(|&(x, y)| (0..width as i64).contains(&x) && y >= 0);
    inside.map(|(x, y)| y as usize * width + x as usize).filter(|&at| at < length).collect()
}

/// Differences of the means over blocks of 4 x 4 pixels of which at least half count.
fn blocks(own: &[usize], width: usize, (shown, truth): (&[u32], &[u32])) -> Vec<f64> {
    let mut sums = std::collections::BTreeMap::<(usize, usize), (Triple, Triple, f64)>::new();
    for &at in own {
        let (a, b, count) = sums.entry((at / width / 4, at % width / 4)).or_default();
        let (shown, truth) = (rgb(shown[at]), rgb(truth[at]));
        (0..3).for_each(|c| (a[c], b[c]) = (a[c] + shown[c], b[c] + truth[c]));
        *count += 1.0;
    }
    let mean = |sum: Triple, count: f64| sum.map(|v| v / count);
    let whole = sums.into_values().filter(|(.., count)| *count >= 8.0);
    whole.map(|(a, b, count)| difference(mean(a, count), mean(b, count))).collect()
}

/// Linear light of a pixel.
fn rgb(xrgb: u32) -> Triple {
    let [_, r, g, b] = xrgb.to_be_bytes();
    [r, g, b].map(srgb_linear)
}

fn difference(a: Triple, b: Triple) -> f64 {
    let of = |rgb: Triple| lab(apply(&XYZ_OF_REC709, rgb), D65);
    delta_e_2000(of(a), of(b))
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((share * values.len().saturating_sub(1) as f64).round() as usize).copied().unwrap_or(0.0)
}

/// Differences as greys.
pub(super) fn difference_map(shown: &[u32], truth: &[u32]) -> Vec<u32> {
    let grey = |(&a, &b): (&u32, &u32)| {
        let code = (255.0 * difference(rgb(a), rgb(b)) / MAP_WHITE).min(255.0) as u32;
        code * 0x0001_0101
    };
    shown.iter().zip(truth).map(grey).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 16;

    fn grey(code: u32) -> u32 {
        code * 0x0001_0101
    }

    fn picture(light: impl Fn(usize) -> f32) -> Reference {
        let rgb: Vec<[f32; 3]> = (0..WIDTH * WIDTH).map(|at| [light(at); 3]).collect();
        Reference { width: WIDTH as u32, height: WIDTH as u32, coverage: vec![1.0; rgb.len()], rgb }
    }

    /// The left quarter is covered; the light of the right half changes by `change`.
    fn judged(shown: impl Fn(usize) -> u32, truth: u32, change: f32) -> Judgement {
        let covered: Vec<bool> = (0..WIDTH * WIDTH).map(|at| at % WIDTH < 4).collect();
        let (real, whole) = (picture(|_| 1.0), picture(|at| if at % WIDTH >= 8 { 1.0 + change } else { 1.0 }));
        let shown: Vec<u32> = (0..WIDTH * WIDTH).map(shown).collect();
        judge(&shown, &vec![grey(truth); WIDTH * WIDTH], (&real, &whole), &covered)
    }

    /// CIEDE2000 of two greys is the difference of their L* over its weight at their mean.
    fn of_greys(a: u8, b: u8) -> f64 {
        let [a, b] = [a, b].map(|code| 116.0 * srgb_linear(code).cbrt() - 16.0);
        let away = (0.5 * (a + b) - 50.0).powi(2);
        (a - b).abs() / (1.0 + 0.015 * away / (20.0 + away).sqrt())
    }

    #[test]
    fn temple_and_shadow_are_judged_and_nothing_else() {
        // The temple is 8 codes off, the shadow 3, what is neither is far off.
        let shown = |at: usize| {
            grey(if at % WIDTH < 4 {
                128
            } else if at % WIDTH >= 7 {
                123
            } else {
                250
            })
        };
        let found = judged(shown, 120, -0.5);
        // A shadow is looked for over neighbours, so that it begins a pixel earlier.
        assert_eq!(found.pixels, 13 * WIDTH);
        let near = |found: f64, a: u8, b: u8| (found - of_greys(a, b)).abs() < 1e-3;
        assert!(near(found.covered_median, 128, 120) && near(found.receiver_median, 123, 120), "{found:?}");
        assert!(near(found.median, 123, 120) && near(found.high, 128, 120), "{found:?}");
        // Light that is thrown back counts, light that hardly changes does not.
        assert_eq!(judged(shown, 120, 0.2).pixels, 13 * WIDTH);
        assert_eq!(judged(shown, 120, -0.02).pixels, 4 * WIDTH);
    }

    #[test]
    fn blocks_forgive_noise_and_no_bias() {
        let noisy = judged(|at| grey(if (at + at / WIDTH).is_multiple_of(2) { 132 } else { 107 }), 120, -0.5);
        assert!(noisy.median > 4.0 && noisy.high_of_blocks < 0.4, "{noisy:?}");
        let biased = judged(|_| grey(126), 120, -0.5);
        assert!((biased.median_of_blocks - of_greys(126, 120)).abs() < 1e-3, "{biased:?}");
        assert_eq!(judged(|_| grey(120), 120, -0.5).high, 0.0);
    }

    #[test]
    fn a_map_is_black_where_nothing_differs_and_white_from_ten_on() {
        assert_eq!(difference_map(&[grey(90), 0x00ff_0000], &[grey(90), 0x0000_00ff]), [0, 0x00ff_ffff]);
    }
}
