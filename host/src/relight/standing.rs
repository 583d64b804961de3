//! Blocks whose tiles all stay as they are: found for all four at once, before any is looked at by itself.
//!
//! A tile may stay while no code of it moves by half a code from what was drawn. For a block it is remembered how far its
//! tiles had moved at most when they were last looked at, and in which light; what has moved since is added, for the dimmest
//! pixel of its tiles. First what the light of each patch can move at all ([`super::influence`]), before anything is
//! projected; where that is too much, what the coefficients moved, for the widest reach.

use super::blocks::Block;
use super::tiles::TileState;
use relume_firmware::bound::CodeSlope;
use relume_firmware::coefficients::{Coefficients, Sides, TileReach, TileSize};
use relume_firmware::drawn::{Dimmest, HALF_CODE, Off};
use relume_firmware::field::Field;
use relume_firmware::tile::Tile;

/// How far one tile has moved since it was drawn, and what shows that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stand {
    pub(super) moved: [[Sides; 3]; 2],
    /// How far what it shows may be from what is meant.
    pub(super) off: Off,
    /// Is it shown by the factors alone, beside the sun?
    pub(super) by_factors: bool,
    pub(super) dimmest: Dimmest,
    pub(super) dark_shares: [f32; 3],
}

/// One block's.
#[derive(Clone, Debug)]
pub(super) struct Standing {
    /// Of its tiles together, in the light of `moment`; `None`: they are not alike.
    stand: Option<Stand>,
    moment: u64,
    coefficients: Coefficients,
    sun_q16: [u32; 3],
    size: TileSize,
    /// See [`TileReach`], in units of a row unit of 1.
    reach: Vec<f32>,
    /// Bounds of what the tiles show if all of them stay in the newest light: linear, and codes with rounding.
    stays: Option<(f32, f32)>,
}

impl Standing {
    /// Of block number `block`; `states` are all tiles'.
    pub(super) fn new(field: &Field<'_>, block: usize, (all, states): (&[Tile<'_>], &[TileState])) -> Self {
        let tiles = || field.response().tiles_of(block).filter(|&index| !states[index].empty);
        let size_of = |index: usize| TileSize::of(&all[index]);
        let size = tiles().map(size_of).fold(TileSize::default(), TileSize::max);
        let mut reach = vec![0.0; tiles().map(|index| states[index].reach().0.len()).max().unwrap_or(0)];
        tiles().for_each(|index| states[index].reach().join(&size_of(index), &mut reach));
        let coefficients = Coefficients::ZERO;
        Standing { stand: None, moment: 0, coefficients, sun_q16: [0; 3], size, reach, stays: None }
    }

    /// Do all tiles stay? Then with these bounds.
    pub(super) fn stays(&self) -> Option<(f32, f32)> {
        self.stays
    }

    /// The moment whose light the tiles were last looked at in, if more is known of it.
    pub(super) fn moment(&self) -> Option<u64> {
        self.stand.map(|_| self.moment)
    }

    /// The newest light is another.
    pub(super) fn look_again(&mut self) {
        self.stays = None;
    }

    /// Nothing is known of the tiles any more.
    pub(super) fn forget(&mut self) {
        (self.stand, self.stays) = (None, None);
    }
}

impl Block {
    /// Finds whether all tiles may stay in the newest light, whose sun has this weight, before it is projected: since they
    /// were looked at, no pixel has moved by more than `change`.
    pub(super) fn stays_unprojected(&mut self, slope: &CodeSlope, sun_q16: [u32; 3], change: [Sides; 3]) -> bool {
        let standing = &mut self.standing;
        standing.stays = None;
        let Some(stand) = standing.stand.filter(|_| self.level == 0 && standing.sun_q16 == sun_q16) else {
            return false;
        };
        let change = Off::of_sky([change; 2]);
        let codes = stand.dimmest.codes(slope, &stand.dark_shares, &Off::of_sky(stand.moved).and_moved(&change));
        let stays = codes < HALF_CODE;
        if stays {
            let off = stand.off.and_moved(&change);
            standing.stays = Some((off.linear(), stand.dimmest.codes_rounded(slope, &stand.dark_shares, &off)));
        }
        stays
    }

    /// Finds whether all tiles may stay in the newest light, of which nothing is shown by rows of patches, and whose sun has
    /// this weight.
    pub(super) fn stand(&mut self, slope: &CodeSlope, sun_q16: [u32; 3]) {
        let standing = &mut self.standing;
        standing.stays = None;
        let comparable = |stand: &Stand| stand.by_factors && self.level == 0 && standing.sun_q16 == sun_q16;
        let Some(stand) = standing.stand.filter(comparable) else { return };
        // The row units are in the reach.
        let unit = TileSize { row_unit: [1.0; 3], ..standing.size };
        let change = self.coefficients.change_bound(&standing.coefficients, &unit, &TileReach(&standing.reach));
        let moved = Off::of_sky(stand.moved).and_moved(&Off::of_sky(change));
        if stand.dimmest.codes(slope, &stand.dark_shares, &moved) >= HALF_CODE {
            return;
        }
        let exact = (&self.coefficients, &self.bound);
        let off = Off::of_factors(&self.coefficients, exact, &standing.size).and_moved(&moved);
        standing.stays = Some((off.linear(), stand.dimmest.codes_rounded(slope, &stand.dark_shares, &off)));
    }

    /// Remembers how its tiles stand after a frame in which they were looked at by themselves, or forgets it where that is not
    /// known of all.
    pub(super) fn remember<'s>(
        &mut self,
        tiles: impl Iterator<Item = &'s TileState>,
        (moment, sun_q16): (u64, [u32; 3]),
    ) {
        let stands = tiles.filter(|state| !state.empty).map(|state| state.stand(moment, sun_q16));
        let joined = stands.reduce(|a, b| a.zip(b).map(|(a, b)| a.and(b))).flatten();
        self.standing.stand = joined.filter(|_| self.level == 0);
        if self.standing.stand.is_some() {
            self.standing.moment = moment;
            self.standing.coefficients.copy_from(&self.coefficients);
            self.standing.sun_q16 = sun_q16;
        }
    }
}

impl Stand {
    /// What holds for both.
    fn and(self, other: Stand) -> Stand {
        let widest = |kind: usize| core::array::from_fn(|c| self.moved[kind][c].widest(other.moved[kind][c]));
        Stand {
            moved: [0, 1].map(widest),
            off: self.off.widest(&other.off),
            by_factors: self.by_factors && other.by_factors,
            dimmest: self.dimmest.min(other.dimmest),
            dark_shares: core::array::from_fn(|c| self.dark_shares[c].max(other.dark_shares[c])),
        }
    }
}
