//! The step from one set of weights to the next.

use super::{BLOCKS, FixedWeights, MAX_PADDED, MAX_SUM, Values};
use crate::tile::{LANE_PAD, padded};

/// What changed between two sets of weights of the same scale: projections are linear, so only this is projected.
#[derive(Clone, Debug)]
pub struct WeightStep {
    value_q: [[i16; MAX_PADDED]; 3],
    lit: [u8; BLOCKS],
    lit_blocks: usize,
    patches: usize,
}

impl WeightStep {
    /// No change.
    pub const NONE: WeightStep =
        WeightStep { value_q: [[0; MAX_PADDED]; 3], lit: [0; BLOCKS], lit_blocks: 0, patches: 0 };

    /// Takes the step from `before` to `after`. `false` where it cannot stand for the change, because a scale changed or
    /// the sum of changes is out of the range that a projection holds.
    pub fn set(&mut self, before: &FixedWeights, after: &FixedWeights) -> bool {
        if before.patches != after.patches || before.exponent != after.exponent {
            return false;
        }
        self.patches = after.patches;
        self.lit_blocks = 0;
        let mut sums = [0i64; 3];
        for block in 0..padded(self.patches) / LANE_PAD {
            let mut changed = false;
            for (c, sum) in sums.iter_mut().enumerate() {
                for at in block * LANE_PAD..(block + 1) * LANE_PAD {
                    // Neither is negative, so the difference fits.
                    let step = after.value_q[c][at] - before.value_q[c][at];
                    self.value_q[c][at] = step;
                    *sum += i64::from(step.unsigned_abs());
                    changed |= step != 0;
                }
            }
            if changed {
                self.lit[self.lit_blocks] = block as u8;
                self.lit_blocks += 1;
            }
        }
        sums.iter().all(|&sum| sum <= MAX_SUM)
    }

    /// Did nothing change?
    pub fn is_none(&self) -> bool {
        self.lit_blocks == 0
    }

    /// Changes of a channel.
    pub fn values(&self, channel: usize) -> Values<'_> {
        Values { value_q: &self.value_q[channel][..padded(self.patches)], lit_blocks: &self.lit[..self.lit_blocks] }
    }

    /// Patches that changed.
    pub fn changed(&self) -> usize {
        (0..self.patches).filter(|&patch| self.value_q.iter().any(|channel| channel[patch] != 0)).count()
    }
}
