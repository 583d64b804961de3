//! Blocks whose tiles all stay as they are: found for all four at once, before any is looked at by itself.
//!
//! A tile may stay while no code of it moves by half a code from what was drawn. For a block it is remembered how far its
//! tiles had moved at most when they were last looked at, and under which coefficients; what the coefficients moved since is
//! added, for the widest reach and the dimmest pixel of its tiles.

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
    pub(super) dimmest: Dimmest,
    pub(super) dark_shares: [f32; 3],
}

/// One block's.
#[derive(Clone, Debug)]
pub(super) struct Standing {
    /// Of its tiles together, under `coefficients` and `sun_q16`; `None`: they are not alike.
    stand: Option<Stand>,
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
        Standing { stand: None, coefficients, sun_q16: [0; 3], size, reach, stays: None }
    }

    /// Do all tiles stay? Then with these bounds.
    pub(super) fn stays(&self) -> Option<(f32, f32)> {
        self.stays
    }

    /// Nothing is known of the tiles any more.
    pub(super) fn forget(&mut self) {
        (self.stand, self.stays) = (None, None);
    }
}

impl Block {
    /// Finds whether all tiles may stay in the newest light, whose sun has this weight.
    pub(super) fn stand(&mut self, slope: &CodeSlope, sun_q16: [u32; 3]) {
        let standing = &mut self.standing;
        standing.stays = None;
        let Some(stand) = standing.stand.filter(|_| self.level == 0 && standing.sun_q16 == sun_q16) else { return };
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
            self.standing.coefficients.copy_from(&self.coefficients);
            self.standing.sun_q16 = sun_q16;
        }
    }
}

impl Stand {
    /// What holds for both.
    fn and(self, other: Stand) -> Stand {
        let most = |a: Sides, b: Sides| Sides { down: a.down.max(b.down), up: a.up.max(b.up) };
        Stand {
            moved: [0, 1].map(|kind: usize| core::array::from_fn(|c| most(self.moved[kind][c], other.moved[kind][c]))),
            dimmest: self.dimmest.min(other.dimmest),
            dark_shares: core::array::from_fn(|c| self.dark_shares[c].max(other.dark_shares[c])),
        }
    }
}
