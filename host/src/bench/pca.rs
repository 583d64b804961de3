//! Global principal components: one basis of K sums over patches per channel for the whole picture, from the Gram matrix
//! of the response in f64; per frame the weights become K coefficients and OpenBLAS sums K numbers per pixel.
//!
//! The best K for skies about which nothing is known. The sun keeps a column of its own.

use std::sync::Arc;

use super::arena::Arena;
use super::columns::{Blocks, Columns};
use super::dense::gather_weights;
use super::openblas::{Blas, Order};
use super::rival::Summation;
use crate::weights::PatchWeights;

/// Name in reports.
pub const PCA_NAME: &str = "global_pca_openblas";
/// Numbers of components that are tried.
pub const COMPONENTS: [usize; 3] = [16, 32, 64];

/// The sum over K components.
pub struct Pca {
    blas: Arc<Blas>,
    /// K columns, then the sun's if there is one.
    columns: Columns,
    components: usize,
    /// Per channel `[component][patch]`.
    basis: [Vec<f32>; 3],
    /// Per channel, as gathered from a sky.
    weights: [Vec<f32>; 3],
    coefficients: [Vec<f32>; 3],
}

/// The principal directions of a response, per channel `[patch][patch]` with the most important first.
pub struct Directions([Vec<f32>; 3]);

impl Directions {
    /// Of the first `patches` columns of `dense`.
    ///
    /// # Errors
    /// When this OpenBLAS has no eigen-solver or it fails.
    pub fn new(blas: &Blas, dense: &Columns, patches: usize) -> anyhow::Result<Self> {
        let mut all = [const { Vec::new() }; 3];
        for (channel, directions) in all.iter_mut().enumerate() {
            let mut gram = vec![0.0f64; patches * patches];
            let mut wide = Vec::new();
            for block in 0..dense.blocks().count() {
                let pixels = dense.blocks().range(block).len();
                wide.clear();
                wide.extend(dense.block(block, channel)[..pixels * patches].iter().copied().map(f64::from));
                blas.add_gram(&wide, pixels, patches, &mut gram);
            }
            blas.eigenvectors(&mut gram, patches)?;
            // Eigenvalues ascend, so the last vectors count most.
            *directions = gram.rchunks_exact(patches).flatten().map(|&v| v as f32).collect();
        }
        Ok(Directions(all))
    }

    /// Any directions, good enough for timing.
    pub fn made_up(patches: usize) -> Self {
        let values: Vec<f32> = (0..patches * patches).map(|k| (k % 89) as f32 * 0.001).collect();
        Directions([values.clone(), values.clone(), values])
    }
}

impl Pca {
    /// The first `components` of `directions` over `dense`, of whose columns `patches` are patches.
    ///
    /// # Errors
    /// When the memory cannot be had.
    pub fn new(
        blas: Arc<Blas>,
        dense: &Columns,
        patches: usize,
        directions: &Directions,
        components: usize,
    ) -> std::io::Result<Self> {
        let from = dense.blocks();
        let components = components.min(patches);
        let sun = from.cols - patches;
        let mut columns = Columns::zeros(Blocks { cols: components + sun, ..from })?;
        let basis = [0, 1, 2].map(|c: usize| directions.0[c][..components * patches].to_vec());
        for (block, channel) in (0..from.count()).flat_map(|block| (0..3).map(move |c| (block, c))) {
            let (pixels, whole) = (from.range(block).len(), dense.block(block, channel));
            let (own, own_sun) = columns.block_mut(block, channel).split_at_mut(components * pixels);
            blas.sgemm(&whole[..patches * pixels], &basis[channel], own, [pixels, components, patches]);
            own_sun.copy_from_slice(&whole[patches * pixels..]);
        }
        let weights = [0, 1, 2].map(|_| vec![0.0; patches]);
        let coefficients = [0, 1, 2].map(|_| vec![0.0; components + sun]);
        Ok(Pca { blas, columns, components, basis, weights, coefficients })
    }
}

impl Summation for Pca {
    fn name(&self) -> &'static str {
        PCA_NAME
    }

    fn budget(&self) -> Option<String> {
        Some(format!("{} components", self.components))
    }

    fn blocks(&self) -> Blocks {
        self.columns.blocks()
    }

    fn project(&mut self, weights: &PatchWeights, scale: f32) {
        for c in 0..3 {
            gather_weights(weights, c, scale, &mut self.weights[c]);
            let coefficients = &mut self.coefficients[c];
            // Without a sun its column is not read.
            coefficients.truncate(self.components);
            self.blas.sgemv(Order::RowMajor, &self.basis[c], &self.weights[c], coefficients);
            if self.columns.blocks().cols > self.components {
                coefficients.extend(weights.sun.map(|sun| sun.irradiance[c] * scale));
            }
        }
    }

    fn sum(&self, block: usize, out: [&mut [f32]; 3]) {
        for (channel, out) in out.into_iter().enumerate() {
            let coefficients = &self.coefficients[channel];
            let read = &self.columns.block(block, channel)[..coefficients.len() * out.len()];
            self.blas.sgemv(Order::ColMajor, read, coefficients, out);
        }
    }

    fn bytes_read(&self, sun: bool) -> usize {
        let cols = if sun { self.columns.blocks().cols } else { self.components };
        3 * self.columns.blocks().pixels * cols * size_of::<f32>()
    }

    fn move_on(&mut self) {
        self.columns.move_on();
    }

    fn wander(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()> {
        self.columns.wander(arena)
    }
}
