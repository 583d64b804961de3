//! A hemisphere cut into rings of cells of equal solid angle, by Leopardi's recursive zonal partition.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

const MAX_RINGS: usize = 40;

/// One hemisphere cut into rings of equal cells. Heights are `|y|`, from 1 (pole) down to 0 (horizon).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hemisphere {
    pub(super) cells: usize,
    rings: usize,
    /// Cells before ring `r`; `first[rings]` is `cells`.
    first: [u16; MAX_RINGS + 1],
}

/// A cell as its bounds: height `|y|` in `y_low..y_high`, azimuth in `azimuth..azimuth + span` (radians).
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub(super) y_low: f64,
    pub(super) y_high: f64,
    pub(super) azimuth: f64,
    pub(super) span: f64,
}

impl Hemisphere {
    pub(super) fn new(cells: usize) -> Self {
        let mut first = [0u16; MAX_RINGS + 1];
        let cell_area = TAU / cells as f64;
        let cap = libm::acos(1.0 - 1.0 / cells as f64);
        first[1] = 1;
        let mut rings = 1;
        if cells > 1 {
            let collars = libm::round((FRAC_PI_2 - cap) / libm::sqrt(cell_area)).max(1.0) as usize;
            let collars = collars.min(MAX_RINGS - 1).min(cells - 1);
            let step = (FRAC_PI_2 - cap) / collars as f64;
            // Leopardi, section 3.3: round each collar's ideal count and carry the remainder on.
            let mut carry = 0.0;
            let mut used = 1usize;
            for collar in 0..collars {
                let top = cap + step * collar as f64;
                let ideal = cells as f64 * (libm::cos(top) - libm::cos(top + step)) + carry;
                let left = cells - used;
                let after = collars - collar - 1;
                let count = if after == 0 { left } else { (libm::round(ideal).max(1.0) as usize).min(left - after) };
                carry = ideal - count as f64;
                used += count;
                rings += 1;
                first[rings] = used as u16;
            }
        }
        Hemisphere { cells, rings, first }
    }

    /// Number of the ring that holds a cell, from the pole.
    pub(super) fn ring_of(&self, cell: usize) -> usize {
        let mut ring = 0;
        while ring + 1 < self.rings && usize::from(self.first[ring + 1]) <= cell {
            ring += 1;
        }
        ring
    }

    pub(super) fn cell(&self, cell: usize) -> Cell {
        let ring = self.ring_of(cell);
        let (from, to) = (usize::from(self.first[ring]), usize::from(self.first[ring + 1]));
        let span = TAU / (to - from) as f64;
        Cell {
            y_low: 1.0 - to as f64 / self.cells as f64,
            y_high: 1.0 - from as f64 / self.cells as f64,
            azimuth: span * (cell - from) as f64,
            span,
        }
    }

    pub(super) fn cell_at(&self, height: f64, azimuth: f64) -> usize {
        self.place_of(height, azimuth).0
    }

    /// The cell that holds a direction, and where in it: shares of its height, from below, and of its span, in 0..=1.
    pub(super) fn place_of(&self, height: f64, azimuth: f64) -> (usize, [f64; 2]) {
        let rank = ((1.0 - height) * self.cells as f64).clamp(0.0, self.cells as f64 - 0.5) as usize;
        let ring = self.ring_of(rank);
        let (from, to) = (usize::from(self.first[ring]), usize::from(self.first[ring + 1]));
        let turn = if azimuth < 0.0 { azimuth / TAU + 1.0 } else { azimuth / TAU };
        let across = turn * (to - from) as f64;
        let cell = (across as usize).min(to - from - 1);
        let up = (to as f64 - (1.0 - height) * self.cells as f64) / (to - from) as f64;
        (from + cell, [up.clamp(0.0, 1.0), (across - cell as f64).clamp(0.0, 1.0)])
    }
}

impl Cell {
    /// The direction at `u` of the unit square; `sign` is that of `y`.
    pub(super) fn sample(&self, sign: f64, u: [f32; 2]) -> [f32; 3] {
        let height = self.y_low + (self.y_high - self.y_low) * f64::from(u[0]);
        let azimuth = self.azimuth + self.span * f64::from(u[1]);
        let radius = libm::sqrt((1.0 - height * height).max(0.0));
        let (x, z) = (radius * libm::cos(azimuth), radius * libm::sin(azimuth));
        [x as f32, (sign * height) as f32, z as f32]
    }

    /// Normalised mean of the cell's directions; `sign` is that of `y`.
    pub(super) fn centroid(&self, sign: f64) -> [f32; 3] {
        // Means over the cell, uniform in y and azimuth: integral of sqrt(1 - y^2), and sin(s/2)/(s/2).
        let primitive = |y: f64| 0.5 * (y * libm::sqrt((1.0 - y * y).max(0.0)) + libm::asin(y));
        let radius = (primitive(self.y_high) - primitive(self.y_low)) / (self.y_high - self.y_low);
        let half = 0.5 * self.span;
        let radius = radius * libm::sin(half) / half;
        let radius = if half > PI - 1e-9 { 0.0 } else { radius };
        let y = sign * 0.5 * (self.y_low + self.y_high);
        let length = libm::sqrt(radius * radius + y * y);
        let azimuth = self.azimuth + half;
        let (x, z) = (radius * libm::cos(azimuth), radius * libm::sin(azimuth));
        [(x / length) as f32, (y / length) as f32, (z / length) as f32]
    }
}
