//! What shines around a clear sun besides the model's sky: light that the lens scatters, and haze that the model lacks.
//!
//! Both come from the beam and are dimmed with it. So their radiance is kept per irradiance of the beam, over the distance
//! from the sun, and learnt whenever the sky is even and the sun seems to be in the clear: quickly where more is seen than was
//! known, slowly where less, for a veil hides and the lens does not.

use super::beam::Near;
use crate::linear_system::solve;
use crate::map::luminance;

/// Width of a step of distance, degrees, and their number: as far out as the aureole is looked at.
const STEP_DEG: f32 = 0.25;
const STEPS: usize = 28;
/// Part of the way to what is seen, where that is more and where it is less.
const RISE: f64 = 0.3;
const FALL: f64 = 0.05;

/// A pixel's light around the sun, its distance in degrees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ring {
    pub apart_deg: f32,
    pub value: [f64; 3],
}

/// Means over the steps of distance; none where no pixel is.
type Means = [Option<[f64; 3]>; STEPS];

/// What was learnt; see the module's text.
#[derive(Clone, Debug)]
pub(super) struct Aureole {
    /// Radiance per irradiance of the clear beam, 1/sr.
    profile: Means,
}

impl Default for Aureole {
    fn default() -> Self {
        Aureole { profile: [None; STEPS] }
    }
}

impl Aureole {
    /// Was anything learnt?
    pub fn is_known(&self) -> bool {
        self.profile.iter().any(Option::is_some)
    }

    /// Radiance per irradiance of the beam at a distance from the sun, 1/sr; 0 before anything was learnt.
    pub fn at(&self, apart_deg: f32) -> [f64; 3] {
        between(&self.profile, apart_deg).unwrap_or_default()
    }

    /// Takes in what is seen beyond the model, per irradiance of the beam.
    pub fn learn(&mut self, seen: impl Iterator<Item = Ring>) {
        let light = |rgb: [f64; 3]| f64::from(luminance(rgb.map(|v| v as f32)));
        for (known, found) in self.profile.iter_mut().zip(means(seen)) {
            let Some(found) = found else { continue };
            let before = known.unwrap_or(found);
            let part = if light(found) > light(before) { RISE } else { FALL };
            *known = Some(std::array::from_fn(|k| before[k] + part * (found[k] - before[k])));
        }
    }
}

fn means(values: impl Iterator<Item = Ring>) -> Means {
    let mut sums = [([0.0; 3], 0.0); STEPS];
    for ring in values {
        if let Some((sum, count)) = sums.get_mut((ring.apart_deg / STEP_DEG) as usize) {
            *sum = std::array::from_fn(|k| sum[k] + ring.value[k]);
            *count += 1.0;
        }
    }
    sums.map(|(sum, count)| (count > 0.0).then(|| sum.map(|v: f64| v / count)))
}

/// The value at a distance, between the steps that have one; the outermost one's beyond them.
fn between(steps: &Means, apart_deg: f32) -> Option<[f64; 3]> {
    let place = apart_deg / STEP_DEG - 0.5;
    let of = |at: usize| steps[at].map(|value| (at as f32, value));
    let first_after = ((place.max(0.0)) as usize + 1).min(STEPS);
    let below = (0..first_after).rev().find_map(of);
    let above = (first_after..STEPS).find_map(of);
    match (below, above) {
        (Some((a, low)), Some((b, high))) => {
            let t = f64::from(((place - a) / (b - a)).clamp(0.0, 1.0));
            Some(std::array::from_fn(|k| low[k] + t * (high[k] - low[k])))
        }
        (one, other) => one.or(other).map(|(_, value)| value),
    }
}

/// How uneven the light around the sun is apart from its fall with the distance and a slope: the rms, relative. Clouds make it
/// so, a clear sky and a lens do not.
pub(super) fn unevenness(near: &[Near], within_deg: f32) -> f64 {
    let inside = || near.iter().filter(|pixel| pixel.apart_deg() < within_deg);
    let light = |pixel: &Near| f64::from(luminance(pixel.value));
    let levels = means(inside().map(|p| Ring { apart_deg: p.apart_deg(), value: [light(p); 3] }));
    let off = |pixel: &Near| {
        let [level, ..] = between(&levels, pixel.apart_deg()).unwrap_or([1.0; 3]);
        let row = [1.0, pixel.at_deg[0].into(), pixel.at_deg[1].into()];
        (row, light(pixel) / level.max(1e-30) - 1.0)
    };
    let (mut a, mut b) = ([[0.0; 3]; 3], [[0.0; 1]; 3]);
    for (row, off) in inside().map(off) {
        for i in 0..3 {
            a[i] = std::array::from_fn(|j| a[i][j] + row[i] * row[j]);
            b[i][0] += row[i] * off;
        }
    }
    (0..3).for_each(|i| a[i][i] += 1e-9);
    let slope = solve(a, b);
    let (mut square, mut count) = (0.0, 0.0);
    for (row, off) in inside().map(off) {
        square += (off - (0..3).map(|k| row[k] * slope[k][0]).sum::<f64>()).powi(2);
        count += 1.0;
    }
    (square / f64::max(count, 1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_is_learnt_quickly_and_less_slowly() {
        let rings = |level: f64| (0..28).map(move |i| Ring { apart_deg: 0.6 + 0.2 * i as f32, value: [level; 3] });
        let mut aureole = Aureole::default();
        assert!(!aureole.is_known() && aureole.at(1.0) == [0.0; 3]);
        aureole.learn(rings(1.0));
        assert!(aureole.is_known());
        // Nearer and farther than anything that was seen, too.
        assert!([0.1, 0.6, 3.3, 9.0].iter().all(|&deg| (aureole.at(deg)[1] - 1.0).abs() < 1e-6));
        aureole.learn(rings(2.0));
        assert!((aureole.at(2.0)[0] - 1.3).abs() < 1e-6);
        aureole.learn(rings(0.3));
        assert!((aureole.at(2.0)[0] - 1.25).abs() < 1e-6);
    }

    #[test]
    fn a_fall_and_a_slope_are_even_and_an_edge_is_not() {
        let sky = |edge: f32| -> Vec<Near> {
            let pixel = |i: usize| {
                let at_deg = [(i % 21) as f32 * 0.3 - 3.0, (i / 21) as f32 * 0.3 - 3.0];
                let apart = at_deg[0].hypot(at_deg[1]);
                let level =
                    (-apart / 2.0).exp() * (1.0 + 0.05 * at_deg[1]) * if at_deg[0] > 0.5 { 1.0 + edge } else { 1.0 };
                Near { dir: [0.0, 1.0, 0.0], omega: 1.0, at_deg, value: [level; 3] }
            };
            (0..441).map(pixel).filter(|pixel| pixel.apart_deg() > 0.6).collect()
        };
        let (even, edge) = (unevenness(&sky(0.0), 3.0), unevenness(&sky(0.3), 3.0));
        assert!(even < 0.02 && edge > 0.04, "{even} {edge}");
    }
}
