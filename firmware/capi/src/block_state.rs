//! A block's coefficients under the newest light: projected once, for all its tiles.
//!
//! A block reaches over two bands, and several threads may each relight bands of their own. So the upper band owns the
//! state: it alone writes it. The lower band takes what is there, and what is not there yet it projects for itself; nobody
//! waits for anybody.

#![allow(unsafe_code)]

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, Ordering};
use relume_firmware::relight::Coefficients;

/// What a projection gives.
#[derive(Clone, Copy)]
pub struct Projected {
    /// For all tiles of the block.
    pub coefficients: Coefficients,
    /// Bounds on the error of the factors, `[plain, weighted][channel]`; 0 where the field has none.
    pub bound: [[f32; 3]; 2],
}

impl Projected {
    /// No light.
    pub const DARK: Projected = Projected { coefficients: Coefficients::ZERO, bound: [[0.0; 3]; 2] };
}

/// One block's state.
pub struct BlockState {
    /// Does `projected` hold the newest light? From then on it is only read, until [`BlockState::forget`].
    is_ready: AtomicBool,
    projected: UnsafeCell<Projected>,
    /// How much of the way back is taken.
    level: usize,
}

impl BlockState {
    /// Not projected yet.
    pub const fn new() -> Self {
        BlockState { is_ready: AtomicBool::new(false), projected: UnsafeCell::new(Projected::DARK), level: 0 }
    }

    /// There is a newer light.
    pub fn forget(&mut self) {
        *self.is_ready.get_mut() = false;
    }

    /// How much of the way back is taken.
    pub fn level(&self) -> usize {
        self.level
    }

    /// Takes more or less of the way back.
    pub fn set_level(&mut self, level: usize) {
        self.level = level;
        self.forget();
    }

    fn get(&self) -> Option<&Projected> {
        // SAFETY: written before `is_ready` was set, and not again before `forget`, which takes an exclusive borrow.
        self.is_ready.load(Ordering::Acquire).then(|| unsafe { &*self.projected.get() })
    }
}

/// A row of blocks as one band of it sees them.
pub struct BandBlocks<'a> {
    blocks: &'a [BlockState],
    is_owner: bool,
    /// What a lower band has projected for itself, and the number in the row of the block that it is for.
    own: (Option<usize>, Projected),
}

impl<'a> BandBlocks<'a> {
    /// For the owner (the upper band), or for the lower one.
    ///
    /// # Safety
    /// There is no other owner of these blocks while this lives.
    pub unsafe fn new(blocks: &'a [BlockState], is_owner: bool) -> Self {
        BandBlocks { blocks, is_owner, own: (None, Projected::DARK) }
    }

    /// The level of block number `index` of the row.
    pub fn level(&self, index: usize) -> usize {
        self.blocks[index].level
    }

    /// Block number `index` of the row; `project` is called if nobody has done it for this light.
    pub fn get(&mut self, index: usize, mut project: impl FnMut(&mut Projected)) -> &Projected {
        let block = &self.blocks[index];
        if self.is_owner && !block.is_ready.load(Ordering::Relaxed) {
            // SAFETY: only the owner writes, of which there is one by `new`, and nobody reads before `is_ready`.
            project(unsafe { &mut *block.projected.get() });
            block.is_ready.store(true, Ordering::Release);
        }
        if let Some(projected) = block.get() {
            return projected;
        }
        if self.own.0 != Some(index) {
            project(&mut self.own.1);
            self.own.0 = Some(index);
        }
        &self.own.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Projections of `band` on its blocks 0, 0, 1, as numbers in `bound`, and how many there were.
    fn seen(band: &mut BandBlocks<'_>, light: f32) -> ([f32; 3], usize) {
        let mut count = 0;
        let numbers = [0, 0, 1].map(|index| {
            band.get(index, |out| {
                count += 1;
                out.bound[0][0] = light + index as f32;
            })
            .bound[0][0]
        });
        (numbers, count)
    }

    #[test]
    fn a_block_is_projected_once_for_a_light() {
        let mut blocks = [BlockState::new(), BlockState::new()];
        let both = |blocks: &[BlockState], lower_first: bool, light: f32| {
            // SAFETY: one owner.
            let (mut upper, mut lower) = unsafe { (BandBlocks::new(blocks, true), BandBlocks::new(blocks, false)) };
            let before = if lower_first { seen(&mut lower, light) } else { ([light, light, light + 1.0], 0) };
            (before, seen(&mut upper, light), seen(&mut lower, light))
        };
        let right = |light: f32| [light, light, light + 1.0];
        assert_eq!(both(&blocks, false, 10.0), ((right(10.0), 0), (right(10.0), 2), (right(10.0), 0)));
        assert_eq!(both(&blocks, true, 20.0), ((right(10.0), 0), (right(10.0), 0), (right(10.0), 0)));
        blocks.iter_mut().for_each(BlockState::forget);
        assert_eq!(both(&blocks, true, 30.0), ((right(30.0), 2), (right(30.0), 2), (right(30.0), 0)));
    }
}
