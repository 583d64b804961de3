//! Blocks of 2 x 2 tiles: their coefficients from frame to frame, and the bound on their error.

use super::levels::Levels;
use super::standing::Standing;
use super::tiles::TileState;
use relume_firmware::coefficients::project_channel;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::relight::Coefficients;
use relume_firmware::tile::{MAX_RANK, Tile};
use relume_firmware::weights::Values;

/// One block's state.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// Any tile of it with geometry; `None`: nothing to show.
    pub(super) tile: Option<usize>,
    pub(super) coefficients: Coefficients,
    /// Sums of the projection, `[3][v_rank]`.
    sums: Vec<i32>,
    /// Do the sums belong to the newest weights of `level`?
    current: bool,
    /// Do all of its tiles stay, so that the coefficients were left to be those of older weights?
    lags: bool,
    /// How much of the way back is taken.
    pub(super) level: usize,
    /// Bounds on the error of the factors, `[plain, weighted][channel]`; 0 where the field has none.
    pub(super) bound: [[f32; 3]; 2],
    pub(super) standing: Standing,
}

/// How a block's coefficients came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Projected {
    /// They were right already.
    Kept,
    /// They lag behind, because all tiles stay.
    Spared,
    /// The changed patches were added.
    Stepped,
    /// All lit patches were read.
    Whole,
}

impl Block {
    pub(super) fn new(field: &Field<'_>, index: usize, (tiles, states): (&[Tile<'_>], &[TileState])) -> Self {
        let tile = field.response().tiles_of(index).find(|&tile| !states[tile].empty);
        let sums = tile.map_or(0, |tile| 3 * tiles[tile].v_rank());
        Block {
            tile,
            coefficients: Coefficients::ZERO,
            sums: vec![0; sums],
            current: false,
            lags: false,
            level: 0,
            bound: [[0.0; 3]; 2],
            standing: Standing::new(field, index, (tiles, states)),
        }
    }

    /// Goes to another level; the coefficients wait for the next [`Block::project`].
    pub(super) fn set_level(&mut self, level: usize) {
        self.current &= self.level == level;
        self.level = level;
    }

    /// Forgets what was projected.
    pub(super) fn forget(&mut self) {
        self.current = false;
    }

    /// Leaves the coefficients behind the newest weights, which change no tile ([`Block::stays_unprojected`]).
    pub(super) fn lag(&mut self) -> Projected {
        (self.current, self.lags) = (false, true);
        Projected::Spared
    }

    /// Are its coefficients those of older weights?
    pub(super) fn lags(&self) -> bool {
        self.lags
    }

    /// Brings the coefficients to the newest weights. `new_weights`: they changed since the last call.
    pub(super) fn project(
        &mut self,
        (field, tiles): (&Field<'_>, &[Tile<'_>]),
        index: usize,
        levels: &Levels,
        kernel: Kernel,
        new_weights: bool,
    ) -> Projected {
        let Some(tile) = self.tile.map(|tile| &tiles[tile]) else { return Projected::Kept };
        self.lags = false;
        let step = levels.step().filter(|_| self.current && self.level == 0 && new_weights);
        let level = levels.get(self.level);
        if self.current && (!new_weights || step.is_some_and(|step| step.is_none())) {
            return Projected::Kept;
        }
        let response = field.response();
        // A step reads little of V.
        let next = response.tiles_of(index + 1).next().filter(|_| step.is_none() && index + 1 < response.blocks());
        if let Some(next) = next {
            Coefficients::prefetch_projection(&tiles[next], kernel);
        }
        let how = match step {
            Some(step) => {
                self.add(tile, |c| step.values(c), kernel);
                Projected::Stepped
            }
            None => {
                self.sums.fill(0);
                self.add(tile, |c| level.weights.values(c), kernel);
                Projected::Whole
            }
        };
        let rank = tile.v_rank();
        let sums: [&[i32]; 3] = core::array::from_fn(|c| &self.sums[c * rank..(c + 1) * rank]);
        self.coefficients.set_sums(tile, sums, level.weights.exponent());
        if let Some(bounds) = levels.bounds(field) {
            self.bound = bounds.block(index, &level.bound, kernel);
        }
        self.current = true;
        how
    }

    fn add<'w>(&mut self, tile: &Tile<'_>, values: impl Fn(usize) -> Values<'w>, kernel: Kernel) {
        let rank = tile.v_rank();
        let mut fresh = [0i32; MAX_RANK];
        for (c, sums) in self.sums.chunks_exact_mut(rank.max(1)).enumerate() {
            project_channel(tile, c, values(c), kernel, &mut fresh[..rank]);
            sums.iter_mut().zip(fresh).for_each(|(sum, fresh)| *sum = sum.wrapping_add(fresh));
        }
    }
}
