//! The paper's sum: every patch's image in f32, by OpenBLAS.

use std::sync::Arc;

use super::arena::Arena;
use super::columns::{Blocks, Columns};
use super::openblas::Blas;
use super::report::DENSE_NAME;
use super::rival::Summation;
use crate::weights::PatchWeights;

/// The dense f32 sum; a last column is the sun's, if there is one.
pub struct Dense {
    blas: Arc<Blas>,
    columns: Columns,
    patches: usize,
    weights: [Vec<f32>; 3],
}

impl Dense {
    /// Sums `columns`, of which `patches` are patches.
    pub fn new(blas: Arc<Blas>, columns: Columns, patches: usize) -> Self {
        let weights = [0, 1, 2].map(|_| vec![0.0; columns.blocks().cols]);
        Dense { blas, columns, patches, weights }
    }
}

/// Radiance per patch and, behind it, the sun's irradiance, one channel, times `scale`.
pub fn gather_weights(weights: &PatchWeights, channel: usize, scale: f32, out: &mut [f32]) {
    let sun = weights.sun.map_or(0.0, |sun| sun.irradiance[channel]);
    let all = weights.radiance.iter().map(|rgb| rgb[channel]).chain([sun]);
    out.iter_mut().zip(all).for_each(|(to, value)| *to = value * scale);
}

impl Summation for Dense {
    fn name(&self) -> &'static str {
        DENSE_NAME
    }

    fn budget(&self) -> Option<String> {
        None
    }

    fn blocks(&self) -> Blocks {
        self.columns.blocks()
    }

    fn project(&mut self, weights: &PatchWeights, scale: f32) {
        for (channel, out) in self.weights.iter_mut().enumerate() {
            // Without a sun its column is not read.
            out.resize(if weights.sun.is_some() { self.columns.blocks().cols } else { self.patches }, 0.0);
            gather_weights(weights, channel, scale, out);
        }
    }

    fn sum(&self, block: usize, out: [&mut [f32]; 3]) {
        for (channel, out) in out.into_iter().enumerate() {
            let weights = &self.weights[channel];
            let read = weights.len() * out.len();
            let block = &self.columns.block(block, channel)[..read];
            self.blas.sgemv(super::openblas::Order::ColMajor, block, weights, out);
        }
    }

    fn bytes_read(&self, sun: bool) -> usize {
        let blocks = self.columns.blocks();
        let cols = if sun { blocks.cols } else { self.patches };
        3 * blocks.pixels * cols * size_of::<f32>()
    }

    fn move_on(&mut self) {
        self.columns.move_on();
    }

    fn wander(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()> {
        self.columns.wander(arena)
    }
}
