//! Gain of a view: its linear light (1 = white) per radiance, from what it shows of receivers whose radiance is known.
//!
//! Visitors, shadows of birds and whatever else the model does not know of are outliers of the logarithms of these ratios. The
//! middle of the others is found by Tukey's biweight (Beaton and Tukey, Technometrics 16, 1974; constant 4.685 of the
//! median's absolute deviation over 0.6745), which gives values beyond it no weight at all, started at the shortest half of
//! the values (Rousseeuw 1984): the median would lean towards outliers that are all on one side.

use serde::Serialize;

/// How a view shows receivers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ViewGain {
    /// Linear light of the view (1 = white) per radiance, red, green and blue.
    pub gain: [f64; 3],
    /// By how much single pixels differ from that, as a share: what the scene does not know of its ground, and more where pose or
    /// lens are off. The largest of the channels.
    pub scatter: f64,
}

/// Fewest values that tell anything.
pub const FEWEST: usize = 64;
/// Where Tukey's weight ends, in standard deviations.
pub(super) const REACH: f64 = 4.685;
/// A normal distribution's median absolute deviation, in standard deviations.
pub(super) const MAD: f64 = 0.6745;
/// No view is so true to its model that values nearer than this differ, in natural logarithms.
pub(super) const FINEST: f64 = 1e-3;
const STEPS: usize = 20;

/// The middle of natural logarithms most of which belong together, and their standard deviation; their order changes. `None` of
/// too few.
pub fn middle(logs: &mut [f64]) -> Option<(f64, f64)> {
    if logs.len() < FEWEST {
        return None;
    }
    logs.sort_unstable_by(f64::total_cmp);
    let mut centre = middle_of_shortest_half(logs);
    for _ in 0..STEPS {
        let scale = (deviation(logs, centre) / MAD).max(FINEST);
        let (mut sum, mut weights) = (0.0, 0.0);
        for &value in &*logs {
            let weight = tukey((value - centre) / (REACH * scale));
            sum += weight * value;
            weights += weight;
        }
        let next = sum / weights;
        if !next.is_finite() {
            return None;
        }
        let moved = (next - centre).abs();
        centre = next;
        if moved < 1e-5 {
            break;
        }
    }
    let scatter = deviation(logs, centre) / MAD;
    Some((centre, scatter))
}

/// Tukey's weight of a value so many reaches from the middle.
pub(super) fn tukey(place: f64) -> f64 {
    if place.abs() < 1.0 { (1.0 - place * place).powi(2) } else { 0.0 }
}

/// Of ascending values.
fn middle_of_shortest_half(values: &[f64]) -> f64 {
    let half = values.len() / 2 + 1;
    let widths = values.windows(half).map(|own| own[half - 1] - own[0]);
    let shortest = widths.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(at, _)| at);
    let own = &values[shortest..shortest + half];
    own.iter().sum::<f64>() / half as f64
}

/// Median distance of ascending values from `centre`: both neighbourhoods are merged outwards from it.
fn deviation(values: &[f64], centre: f64) -> f64 {
    let mut above = values.partition_point(|&value| value < centre);
    let mut below = above;
    let mut distance = 0.0;
    for _ in 0..=values.len() / 2 {
        let down = below.checked_sub(1).map(|at| centre - values[at]);
        let up = values.get(above).map(|value| value - centre);
        match (down, up) {
            (Some(down), Some(up)) if down <= up => (distance, below) = (down, below - 1),
            (_, Some(up)) => (distance, above) = (up, above + 1),
            (Some(down), None) => (distance, below) = (down, below - 1),
            (None, None) => break,
        }
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal values by the sum of twelve uniform ones.
    fn normal(state: &mut u64) -> f64 {
        let mut unit = || {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*state >> 40) as f64 / (1u64 << 24) as f64
        };
        (0..12).map(|_| unit()).sum::<f64>() - 6.0
    }

    #[test]
    fn a_fifth_of_visitors_dark_or_bright_moves_nothing() {
        let mut state = 41;
        for (share, dark, bright) in [(0.0, 0.0, 0.0), (0.2, -1.2, -1.2), (0.2, 1.0, 1.0), (0.3, -0.8, 0.9)] {
            let mut logs: Vec<f64> = (0..3000)
                .map(|k| {
                    let own = 0.7 + 0.12 * normal(&mut state);
                    let is_visitor = (k % 100) as f64 >= 100.0 * (1.0 - share);
                    if is_visitor { own + if k % 2 == 0 { dark } else { bright } } else { own }
                })
                .collect();
            let (found, scatter) = middle(&mut logs).unwrap();
            assert!((0.11..0.2).contains(&scatter), "{scatter}");
            assert!((found - 0.7).abs() < 0.02, "{share} {dark} {bright}: {found}");
        }
    }

    #[test]
    fn values_that_are_all_alike_have_a_middle_and_few_have_none() {
        let (centre, scatter) = middle(&mut [0.25; 100]).unwrap();
        assert!((centre - 0.25).abs() < 1e-12 && scatter < 1e-12);
        assert_eq!(middle(&mut [0.25; 63]), None);
    }
}
