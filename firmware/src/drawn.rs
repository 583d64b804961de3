//! What a tile showed when it was last drawn, how far that may be from the light of now, and how right it is.

use crate::apart::{UnpackedRows, row_facts};
use crate::bound::{CodeSlope, dark_share};
use crate::coefficients::{Sides, TileReach, TileSize};
use crate::field::Field;
use crate::kernel::Extent;
use crate::relight::{Coefficients, SUN_UNIT};
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
    /// Those of them whose rows are unpacked already, best in the order of the weights.
    pub unpacked: &'a [UnpackedRows<'a>],
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

    /// Is the sun's response what it was when the tile was drawn?
    pub fn is_still(&self) -> bool {
        self.drift == 0
    }

    /// The tile was drawn.
    pub fn reset(&mut self) {
        self.drift = 0;
    }

    /// What becomes of the sun's light, per channel.
    fn change(&self, old_q16: [u32; 3], new_q16: [u32; 3]) -> SunChange {
        let per_channel =
            |of: &dyn Fn(f32, f32) -> f32| core::array::from_fn(|c| of(old_q16[c] as f32, new_q16[c] as f32));
        let (drift, peak) = (self.drift as f32 * SUN_UNIT * SLACK, self.peak as f32 * SUN_UNIT * SLACK);
        SunChange {
            drift: per_channel(&|old, new| drift * old.max(new)),
            scaled: per_channel(&|old, new| peak * (old - new).abs()),
            ratio: per_channel(&|old, new| new / old),
            steps: per_channel(&|old, new| {
                if old > 0.0 && new > 0.0 { libm::logf(new / old).abs() * SLACK } else { 0.0 }
            }),
            peak: per_channel(&|old, new| peak * old.max(new)),
        }
    }
}

/// What becomes of the sun's light on a tile, per channel: it moves, and then all of it gets brighter or dimmer by one factor.
#[derive(Clone, Copy, Debug, Default)]
struct SunChange {
    /// A bound on what its moving changes.
    drift: [f32; 3],
    /// A bound on what the factor changes.
    scaled: [f32; 3],
    /// The factor; not a number or infinite if there was no sun.
    ratio: [f32; 3],
    /// The size of the factor's logarithm, where there is one.
    steps: [f32; 3],
    /// The most light of it, before or after.
    peak: [f32; 3],
}

/// Parts of the sun's most light, between which pixels are told apart.
const SUN_PARTS: [f32; 5] = [0.0, 0.125, 0.3, 0.6, 1.0];

impl SunChange {
    /// The largest change of a code of channel `c` by both the sky, whose light moves by at most `sky` and codes by at most
    /// `sky_codes` for that alone, and the sun after it. No pixel was dimmer than `dimmest`, and no light but the sun's is
    /// below `-below`.
    fn codes(&self, c: usize, slope: &CodeSlope, (sky, sky_codes): (Sides, Sides), dimmest: f32, below: f32) -> f32 {
        if self.drift[c] == 0.0 && self.scaled[c] == 0.0 {
            return sky_codes.most();
        }
        let left = dimmest - sky.down;
        // What brightens and what dims do not add up.
        let drift = self.drift[c];
        let by_drift = if drift > 0.0 { slope.above(left - drift) * drift } else { 0.0 };
        let (along, against) = if self.ratio[c] < 1.0 {
            ((sky.down, sky_codes.down), sky_codes.up)
        } else {
            ((sky.up, sky_codes.up), sky_codes.down)
        };
        (against + by_drift).max(by_drift + self.along(c, slope, along, left, (below, sky.down)))
    }

    /// The change of the sky's part and the factor's, which goes the same way. `left`: what no pixel is dimmer than after the
    /// sky's change, which takes off at most `taken`.
    fn along(
        &self,
        c: usize,
        slope: &CodeSlope,
        (sky, sky_codes): (f32, f32),
        left: f32,
        (below, taken): (f32, f32),
    ) -> f32 {
        let steep = |light: f32, change: f32| if change > 0.0 { slope.above(light) * change } else { 0.0 };
        let (drift, ratio) = (self.drift[c], self.ratio[c]);
        let plain = sky_codes + steep(left - drift - self.scaled[c], self.scaled[c]);
        let lowest = ratio.min(1.0) * (left - drift) - below;
        // Nothing but that is known where no sun was or none is left, or where the dimmest pixels may be all error.
        if !(ratio > 0.0 && ratio.is_finite() && below <= 0.7 * lowest) {
            return plain;
        }
        // Where the light is l and the sun's part of it at most s <= l + below, its factor moves the code by no more than
        // slope(l) s |ln ratio|, and that is the larger the more sun there is: the slope falls slower than light rises. The
        // sky's change shows most where there is least. White and above it is white.
        let peak = self.peak[c].min(1.0 + below);
        let before = ratio.recip().min(1.0);
        let part = |[from, to]: [f32; 2]| {
            let (least, most) = (from * peak * before, to * peak);
            let by_sky = sky_codes.min(steep(left.max(least - below - taken), sky));
            by_sky + slope.above(lowest.max(most - below)) * most * self.steps[c]
        };
        let parts = SUN_PARTS.windows(2).map(|ends| part([ends[0], ends[1]]));
        plain.min(parts.fold(0.0, f32::max))
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
    /// From what the kernel tells.
    pub fn of_extent(extent: Extent) -> Self {
        let (smallest, faintest) = (extent.smallest(), extent.faintest());
        // Row scales are at most 65535.
        Dimmest { smallest, brightness: core::array::from_fn(|c| smallest[c].max(faintest[c])) }
    }

    /// The dimmer of both.
    pub fn min(self, other: Dimmest) -> Dimmest {
        let least = |a: [f32; 3], b: [f32; 3]| core::array::from_fn(|c| a[c].min(b[c]));
        Dimmest { smallest: least(self.smallest, other.smallest), brightness: least(self.brightness, other.brightness) }
    }

    /// The largest change of an 8-bit code, before rounding, that `off` makes in a tile of these [`dark_shares`].
    ///
    /// One after the other: from what is shown by the factors' part, from there by the sun's, and last by the rows', whose
    /// light is then one of several that are not negative: the root of their sum moves no further than the root of it.
    pub fn codes(&self, slope: &CodeSlope, dark_shares: &[f32; 3], off: &Off) -> f32 {
        let Dimmest { smallest, brightness } = *self;
        (0..3).fold(0.0f32, |all, c| {
            let root = off.rows_root[c];
            let sky = off.sky[0][c];
            let codes = |plain, weighted| slope.codes(plain, weighted, brightness[c], dark_shares[c]);
            let weighted = off.sky[1][c];
            let down = codes(sky.down, weighted.down);
            let alike = sky.up == sky.down && weighted.up == weighted.down;
            let sky_codes = Sides { down, up: if alike { down } else { codes(sky.up, weighted.up) } };
            let by_sky_and_sun = off.sun.codes(c, slope, (sky, sky_codes), smallest[c], off.below[c]);
            let left = smallest[c] - sky.down - off.sun.drift[c] - off.sun.scaled[c];
            let by_rows = if root > 0.0 {
                let darkest = (libm::sqrtf(left.max(0.0)) - root).max(0.0);
                slope.root_above(darkest * darkest) * root
            } else {
                0.0
            };
            all.max(by_sky_and_sun + by_rows)
        })
    }

    /// The same with the rounding of codes.
    pub fn codes_rounded(&self, slope: &CodeSlope, dark_shares: &[f32; 3], off: &Off) -> f32 {
        self.codes(slope, dark_shares, off) + CODE_ROUNDING
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
    pub sky: [[Sides; 3]; 2],
    /// Of the sun's.
    sun: SunChange,
    /// How far below 0 the sky's light by the factors may be.
    below: [f32; 3],
    /// Of patches shown by their own rows ([`crate::wayback`]); the same plain and weighted.
    pub rows: [f32; 3],
    /// The same of the square root of their light.
    pub rows_root: [f32; 3],
}

impl Off {
    /// How far a tile shown in `light` may be from the uncompressed response. `all` are the block's
    /// coefficients with all ranks, and `block_bound` is what [`crate::bound::Bounds::block`] says of the block.
    pub fn of(
        (field, tile): (&Field<'_>, &Tile<'_>),
        light: &ShownLight<'_>,
        (all, block_bound): (&Coefficients, &[[f32; 3]; 2]),
    ) -> Off {
        let mut off = Off::of_factors(light.coefficients, (all, block_bound), &TileSize::of(tile));
        let mut squares = [0.0f32; 3];
        for (place, apart) in light.weights.apart().enumerate() {
            let facts = row_facts((field, tile), light.unpacked, place, apart.patch);
            let (error, rest, unit) = (facts.error() * SLACK, facts.rest * SLACK, facts.unit * SLACK);
            for c in 0..3 {
                let light = apart.light[c] * tile.row_top(c);
                off.rows[c] += error * light;
                off.sky.iter_mut().for_each(|sky| sky[c] += Sides::both(rest * light));
                squares[c] += unit * light;
            }
        }
        off.rows_root = squares.map(|square| 0.5 * libm::sqrtf(square) * SLACK);
        off
    }

    /// The same of what the factors show alone, for a tile of this size.
    pub fn of_factors(
        shown: &Coefficients,
        (all, block_bound): (&Coefficients, &[[f32; 3]; 2]),
        size: &TileSize,
    ) -> Off {
        let rounding = shown.rounding_bound(all, size);
        Off::of_sky(block_bound.map(|kind| core::array::from_fn(|c| Sides::both(kind[c] + rounding[c]))))
    }

    /// Of the sky's light alone.
    pub fn of_sky(sky: [[Sides; 3]; 2]) -> Off {
        Off { sky, ..Off::default() }
    }

    /// How far what is shown may be from what is meant (`self`, see [`Off::of`]), if it also moved since ([`DrawnTile::moved`]).
    pub fn and_moved(mut self, other: &Off) -> Off {
        self.add_sky(&other.sky);
        // The light of a moment has no error of the sun's; only one of the two has moved.
        (self.sun, self.below) = (other.sun, other.below);
        let pairs = [(&mut self.rows, &other.rows), (&mut self.rows_root, &other.rows_root)];
        pairs.into_iter().for_each(|(own, other)| own.iter_mut().zip(other).for_each(|(own, other)| *own += other));
        self
    }

    /// What holds for both, where the sun's light of neither has moved.
    pub fn widest(self, other: &Off) -> Off {
        let most = |a: [f32; 3], b: [f32; 3]| core::array::from_fn(|c| a[c].max(b[c]));
        Off {
            sky: [0, 1].map(|kind| core::array::from_fn(|c| self.sky[kind][c].widest(other.sky[kind][c]))),
            rows: most(self.rows, other.rows),
            rows_root: most(self.rows_root, other.rows_root),
            ..Off::default()
        }
    }

    fn add_sky(&mut self, other: &[[Sides; 3]; 2]) {
        self.sky.iter_mut().flatten().zip(other.iter().flatten()).for_each(|(own, other)| *own += *other);
    }

    /// The largest of any channel.
    pub fn linear(&self) -> f32 {
        (0..3).fold(0.0f32, |all, c| {
            all.max(self.sky[0][c].most() + self.sun.drift[c] + self.sun.scaled[c] + self.rows[c])
        })
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

    /// How far a tile, drawn in `light`, would be from what was drawn; `error` is [`Off::of`] of that light.
    pub fn moved(
        &self,
        (field, tile): (&Field<'_>, &Tile<'_>),
        light: &ShownLight<'_>,
        (reach, sun): (&TileReach<'_>, &SunDrift),
        error: &Off,
    ) -> Off {
        let sky = light.coefficients.change_bound(&self.coefficients, &TileSize::of(tile), reach);
        let mut off = Off { sky, ..Off::default() };
        if self.sun_q16 != light.sun_q16 || sun.drift > 0 {
            off.sun = sun.change(self.sun_q16, light.sun_q16);
            // The response is not negative, nor are rows: below 0 is only what the factors are off by.
            off.below = field.bounds().map_or([f32::INFINITY; 3], |_| error.sky[0].map(|sky| sky.down));
        }
        off.add_sky(&[self.rows_change(field, tile, light).map(Sides::both); 2]);
        off
    }

    /// How dim it is.
    pub fn dimmest(&self) -> Dimmest {
        self.dimmest
    }

    /// Was it drawn in the light of this sun?
    pub fn is_under(&self, sun_q16: [u32; 3]) -> bool {
        self.sun_q16 == sun_q16
    }

    /// Were no patches shown by rows of their own?
    pub fn is_by_factors(&self) -> bool {
        self.apart_count == 0
    }

    /// A bound on what the rows of patches apart change, per channel.
    fn rows_change(&self, field: &Field<'_>, tile: &Tile<'_>, light: &ShownLight<'_>) -> [f32; 3] {
        let (old, new) = (&self.apart[..self.apart_count], light.weights);
        let mut sum = [0.0f32; 3];
        let mut add = |place: usize, patch: u16, before: [f32; 3], after: [f32; 3]| {
            let largest = row_facts((field, tile), light.unpacked, place, patch).largest() * SLACK;
            (0..3).for_each(|c| sum[c] += (after[c] - before[c]).abs() * largest * tile.row_top(c));
        };
        for (place, apart) in new.apart().enumerate() {
            let before = old.iter().find(|o| o.patch == apart.patch).map_or([0.0; 3], |o| o.light);
            add(place, apart.patch, before, apart.light);
        }
        for gone in old.iter().filter(|o| new.apart().all(|a| a.patch != o.patch)) {
            add(usize::MAX, gone.patch, gone.light, [0.0; 3]);
        }
        sum
    }
}
