//! Exposures that are not what they are said to be: each frame's brightness against its neighbours'.
//!
//! Of neighbouring exposures the median ratio of radiances over pixels that both measure well is 1, whatever moves in the
//! scene. A curve that is off makes all ratios drift alike; a frame whose exposure was misreported is off alone, in one
//! direction from its shorter neighbour and back to its longer one.

use super::tables::Fact;
use crate::quantile::median;

/// Fractions that count as well measured, and the width of a code that does, as a share of the fraction.
const LOWEST: f32 = 0.01;
const HIGHEST: f32 = 0.9;
const WIDEST: f32 = 0.1;
/// Ratios a link between two frames needs.
const FEWEST: usize = 48;
/// Ratio of exposures from which on their log ratio is too small to be divided by.
const NARROWEST: f32 = 0.75;
/// Log ratio up to which a frame agrees with most others, and from which it is corrected.
const AGREES: f32 = 0.05;
const DISAGREES: f32 = 0.1;

/// A fact's fraction where a ratio may be made of it, NaN elsewhere.
pub(super) fn well_measured(fact: &Fact) -> f32 {
    let is_fine = fact.width < (WIDEST * fact.fraction).powi(2);
    if (LOWEST..HIGHEST).contains(&fact.fraction) && is_fine { fact.fraction } else { f32::NAN }
}

/// Gathers ratios; its buffers are kept.
#[derive(Clone, Debug, Default)]
pub(super) struct ScaleGauge {
    ratios: Vec<f32>,
    /// Log radiance of each frame over that of the next shorter one; NaN where too little is seen in both.
    links: Vec<f32>,
    /// The same over the natural log of the two exposures' ratio, where they are far enough apart.
    slopes: Vec<f32>,
    offsets: Vec<f32>,
    scratch: Vec<f32>,
}

impl ScaleGauge {
    pub fn clear(&mut self) {
        self.ratios.clear();
        self.links.clear();
        self.slopes.clear();
    }

    /// Takes a pixel's channel in a shorter and a longer exposure of ratio `r` (short over long): their fractions, NaN where
    /// not [`well_measured`].
    #[inline]
    pub fn take(&mut self, short: f32, long: f32, r: f32) {
        let ratio = long * r / short;
        if !ratio.is_nan() {
            self.ratios.push(ratio);
        }
    }

    /// Ends a pair of neighbouring exposures of ratio `r` (short over long).
    pub fn end_pair(&mut self, r: f32) {
        let enough = self.ratios.len() >= FEWEST;
        let link = if enough { median(&mut self.ratios).map_or(f32::NAN, f32::ln) } else { f32::NAN };
        self.links.push(link);
        // In the first series, whatever it shows: none allocates after it.
        self.slopes.reserve(1);
        if !link.is_nan() && r < NARROWEST {
            self.slopes.push(link / -r.ln());
        }
        self.ratios.clear();
    }

    /// The usual log ratio of neighbours per natural log of exposure: 0.05 where a power law's exponent is 5 % off. None where
    /// no two exposures tell.
    pub fn slope(&mut self) -> Option<f32> {
        median(&mut self.slopes)
    }

    /// The usual log ratio of neighbours: what a wrong response curve or time unit shows as.
    pub fn drift(&mut self) -> f32 {
        self.scratch.clear();
        self.scratch.extend(self.links.iter().filter(|link| !link.is_nan()));
        median(&mut self.scratch).unwrap_or(0.0)
    }

    /// True exposure over the stated one per frame, in rising exposure, one more than pairs: 1 unless a frame stands out.
    pub fn factors(&mut self, into: &mut Vec<f64>) {
        // Two links cannot tell a drift from a frame that stands out.
        let drift = if self.links.len() > 2 { self.drift() } else { 0.0 };
        into.clear();
        into.resize(self.links.len() + 1, 1.0);
        let mut first = 0;
        while first < into.len() {
            // A run of frames that are linked to each other.
            let links = self.links[first..].iter().take_while(|link| !link.is_nan()).count();
            self.judge(first, links, drift, into);
            first += links + 1;
        }
    }

    fn judge(&mut self, first: usize, links: usize, drift: f32, into: &mut [f64]) {
        if links < 2 {
            return;
        }
        self.offsets.clear();
        self.offsets.push(0.0);
        for link in &self.links[first..first + links] {
            let before = self.offsets.last().copied().unwrap_or(0.0);
            self.offsets.push(before + link - drift);
        }
        self.scratch.clone_from(&self.offsets);
        let middle = median(&mut self.scratch).unwrap_or(0.0);
        let agreeing = self.offsets.iter().filter(|&&offset| (offset - middle).abs() < AGREES).count();
        if 2 * agreeing <= links + 1 {
            return;
        }
        for (at, offset) in self.offsets.iter().enumerate() {
            if (offset - middle).abs() > DISAGREES {
                into[first + at] = f64::from((offset - middle).exp());
            }
        }
    }
}
