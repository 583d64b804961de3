//! What a tile showed when it was last drawn, how far that may be from the light of now, and how right it is.

use crate::bound::{CodeSlope, dark_share};
use crate::coefficients::TileReach;
use crate::field::Field;
use crate::kernel::Extent;
use crate::relight::{Coefficients, LinearTile, SUN_UNIT};
use crate::tile::Tile;
use crate::weights::{Apart, FixedWeights, MAX_STANDOUTS};

/// A tile may stay as it is while no code of it changes by this before rounding.
pub const HALF_CODE: f32 = 0.5;
/// Rounding of an 8-bit code, and what the tone kernel's curve is off by.
const CODE_ROUNDING: f32 = 0.55;
/// More than single precision loses in a product of three.
const SLACK: f32 = 1.0001;

/// The light that a tile is shown in.
#[derive(Clone, Copy, Debug)]
pub struct ShownLight<'a> {
    /// The block's, with as many ranks as are used.
    pub coefficients: &'a Coefficients,
    /// The weights they came from: patches that these set apart are shown by their own rows.
    pub weights: &'a FixedWeights,
    /// The sun's weight; 0: no sun.
    pub sun_q16: [u32; 3],
}

/// How the sun's response plane of a tile has changed since the tile was last drawn, in 1/32768.
#[derive(Clone, Copy, Debug, Default)]
pub struct SunDrift {
    drift: u32,
    peak: u32,
}

impl SunDrift {
    /// Takes in a retracing: the largest change of any value, and the largest value before and after.
    pub fn retraced(&mut self, largest_change: u32, peak: u32) {
        self.drift = self.drift.saturating_add(largest_change);
        self.peak = peak;
    }

    /// The tile was drawn.
    pub fn reset(&mut self) {
        self.drift = 0;
    }

    /// A bound on the change of the sun's light, per channel.
    fn change(&self, old_q16: [u32; 3], new_q16: [u32; 3]) -> [f32; 3] {
        core::array::from_fn(|c| {
            let (old, new) = (old_q16[c], new_q16[c]);
            let moved = self.drift as f32 * old.max(new) as f32;
            (moved + old.abs_diff(new) as f32 * self.peak as f32) * SUN_UNIT
        })
    }
}

/// How dim a tile's pixels are, per channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dimmest {
    /// Light that no pixel falls below.
    pub smallest: [f32; 3],
    /// Light over (row scale / 65535) that no pixel falls below.
    pub brightness: [f32; 3],
}

impl Dimmest {
    /// From what the kernel tells: no row scale is above 65535.
    pub fn of_extent(extent: Extent) -> Self {
        Dimmest { smallest: extent.smallest(), brightness: extent.smallest() }
    }

    /// The same with the brightness from the tile's linear values; black rows do not count.
    pub fn with_pixels(self, tile: &Tile<'_>, linear: &LinearTile) -> Self {
        let brightness = core::array::from_fn(|c| {
            let lit = tile.row_codes(c).zip(&linear.0[c]).filter(|(row, _)| *row > 0);
            lit.map(|(row, light)| light * 65535.0 / f32::from(row)).fold(f32::INFINITY, f32::min)
        });
        Dimmest { brightness, ..self }
    }
}

/// [`dark_share`] of a tile's smallest row scale that is not black, per channel.
pub fn dark_shares(tile: &Tile<'_>) -> [f32; 3] {
    core::array::from_fn(|c| {
        let darkest = tile.row_codes(c).filter(|&row| row > 0).min();
        dark_share(f32::from(darkest.unwrap_or(u16::MAX)) / 65535.0)
    })
}

/// Bounds on how far light may be from what is meant.
#[derive(Clone, Copy, Debug, Default)]
pub struct Off {
    /// Of the sky's light through the factors, `[plain, weighted][channel]` as in [`crate::bound`].
    pub sky: [[f32; 3]; 2],
    /// Of the sun's.
    pub sun: [f32; 3],
    /// Of patches shown by their own rows ([`crate::wayback`]); the same plain and weighted.
    pub rows: [f32; 3],
    /// The same of the square root of their light.
    pub rows_root: [f32; 3],
}

impl Off {
    /// How far tile number `index` shown in `light` may be from the uncompressed response. `all` are the block's
    /// coefficients with all ranks, and `block_bound` is what [`crate::bound::Bounds::block`] says of the block.
    pub fn of(
        (field, index): (&Field<'_>, usize),
        light: &ShownLight<'_>,
        (all, block_bound): (&Coefficients, &[[f32; 3]; 2]),
    ) -> Off {
        let tile = field.response().tile(index);
        let mut off = Off { sky: *block_bound, ..Off::default() };
        off.add_sky(&[light.coefficients.rounding_bound(all, &tile); 2]);
        let mut squares = [0.0f32; 3];
        for apart in light.weights.apart() {
            let Some(rows) = field.way_back().get(index, &tile, usize::from(apart.patch)) else { continue };
            let (error, rest, unit) = (rows.error() * SLACK, rows.rest() * SLACK, rows.unit() * SLACK);
            for c in 0..3 {
                let light = apart.light[c] * tile.row_top(c);
                off.rows[c] += error * light;
                off.sky.iter_mut().for_each(|sky| sky[c] += rest * light);
                squares[c] += unit * light;
            }
        }
        off.rows_root = squares.map(|square| 0.5 * libm::sqrtf(square) * SLACK);
        off
    }

    /// Both, one after the other.
    pub fn and(mut self, other: &Off) -> Off {
        self.add_sky(&other.sky);
        let pairs =
            [(&mut self.sun, &other.sun), (&mut self.rows, &other.rows), (&mut self.rows_root, &other.rows_root)];
        pairs.into_iter().for_each(|(own, other)| own.iter_mut().zip(other).for_each(|(own, other)| *own += other));
        self
    }

    fn add_sky(&mut self, other: &[[f32; 3]; 2]) {
        self.sky.iter_mut().flatten().zip(other.iter().flatten()).for_each(|(own, other)| *own += other);
    }

    /// The largest of any channel.
    pub fn linear(&self) -> f32 {
        (0..3).fold(0.0f32, |all, c| all.max(self.sky[0][c] + self.sun[c] + self.rows[c]))
    }
}

/// What a tile was last drawn with.
#[derive(Clone, Copy, Debug)]
pub struct DrawnTile {
    coefficients: Coefficients,
    sun_q16: [u32; 3],
    apart: [Apart; MAX_STANDOUTS],
    apart_count: usize,
    dimmest: Dimmest,
}

impl DrawnTile {
    /// Nothing yet.
    pub const NOTHING: DrawnTile = DrawnTile {
        coefficients: Coefficients::ZERO,
        sun_q16: [0; 3],
        apart: [Apart { patch: 0, light: [0.0; 3] }; MAX_STANDOUTS],
        apart_count: 0,
        dimmest: Dimmest { smallest: [0.0; 3], brightness: [0.0; 3] },
    };

    /// Remembers what the tile shows from now on. Of patches apart the first [`MAX_STANDOUTS`] are remembered: with more,
    /// only light that is the same can be compared.
    pub fn set(&mut self, light: &ShownLight<'_>, dimmest: Dimmest) {
        self.coefficients.copy_from(light.coefficients);
        self.sun_q16 = light.sun_q16;
        self.apart_count = 0;
        for (own, apart) in self.apart.iter_mut().zip(light.weights.apart()) {
            *own = apart;
            self.apart_count += 1;
        }
        self.dimmest = dimmest;
    }

    /// How far tile number `index`, drawn in `light`, would be from what was drawn.
    pub fn moved(
        &self,
        (field, index): (&Field<'_>, usize),
        light: &ShownLight<'_>,
        reach: &TileReach<'_>,
        sun: &SunDrift,
    ) -> Off {
        let tile = field.response().tile(index);
        let sky = light.coefficients.change_bound(&self.coefficients, &tile, reach);
        let mut off = Off { sky, sun: sun.change(self.sun_q16, light.sun_q16), ..Off::default() };
        off.add_sky(&[self.rows_change(field, index, &tile, light.weights); 2]);
        off
    }

    /// The largest change of an 8-bit code, before rounding, that `off` makes in a tile of these [`dark_shares`].
    ///
    /// One after the other: from what is shown by the factors' part, from there by the sun's, and last by the rows', whose
    /// light is then one of several that are not negative: the root of their sum moves no further than the root of it.
    pub fn codes(&self, slope: &CodeSlope, dark_shares: &[f32; 3], off: &Off) -> f32 {
        let Dimmest { smallest, brightness } = self.dimmest;
        (0..3).fold(0.0f32, |all, c| {
            let (sun, root) = (off.sun[c], off.rows_root[c]);
            let left = smallest[c] - off.sky[0][c] - sun;
            let by_sun = if sun > 0.0 { slope.above(left) * sun } else { 0.0 };
            let by_rows = if root > 0.0 {
                let darkest = (libm::sqrtf(left.max(0.0)) - root).max(0.0);
                slope.root_above(darkest * darkest) * root
            } else {
                0.0
            };
            all.max(slope.codes(off.sky[0][c], off.sky[1][c], brightness[c], dark_shares[c]) + by_sun + by_rows)
        })
    }

    /// The same with the rounding of codes.
    pub fn codes_rounded(&self, slope: &CodeSlope, dark_shares: &[f32; 3], off: &Off) -> f32 {
        self.codes(slope, dark_shares, off) + CODE_ROUNDING
    }

    /// A bound on what the rows of patches apart change, per channel.
    fn rows_change(&self, field: &Field<'_>, index: usize, tile: &Tile<'_>, new: &FixedWeights) -> [f32; 3] {
        let old = &self.apart[..self.apart_count];
        let mut sum = [0.0f32; 3];
        let mut add = |patch: u16, before: [f32; 3], after: [f32; 3]| {
            let Some(rows) = field.way_back().get(index, tile, usize::from(patch)) else { return };
            let largest = rows.largest() * SLACK;
            (0..3).for_each(|c| sum[c] += (after[c] - before[c]).abs() * largest * tile.row_top(c));
        };
        for apart in new.apart() {
            let before = old.iter().find(|o| o.patch == apart.patch).map_or([0.0; 3], |o| o.light);
            add(apart.patch, before, apart.light);
        }
        for gone in old.iter().filter(|o| new.apart().all(|a| a.patch != o.patch)) {
            add(gone.patch, gone.light, [0.0; 3]);
        }
        sum
    }
}
