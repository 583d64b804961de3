//! f32 numbers of covered pixels, `[block][channel][column][pixel of the block]`: what OpenBLAS multiplies.
//!
//! A block's results stay in the nearest cache while its columns pass by once, in the order in which they lie. Of whole
//! rows, whole columns and blocks of columns this is what was fastest; the size of the blocks is tried out on the spot.

use std::ops::Range;
use std::sync::Arc;

use super::arena::{Arena, Window};
use super::clock::cpu_s;
use super::openblas::{Blas, Order};

/// `pixels` covered pixels cut in blocks, `cols` numbers for each in each of three channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Covered pixels.
    pub pixels: usize,
    /// Numbers per pixel and channel.
    pub cols: usize,
    /// Pixels per block; the last block may be shorter.
    pub block_px: usize,
}

/// Sizes of blocks that are tried.
const BLOCK_PX: [usize; 4] = [1024, 2048, 4096, 16384];

impl Blocks {
    /// Number of blocks.
    pub fn count(&self) -> usize {
        self.pixels.div_ceil(self.block_px)
    }

    /// The pixels of a block.
    pub fn range(&self, block: usize) -> Range<usize> {
        block * self.block_px..((block + 1) * self.block_px).min(self.pixels)
    }

    /// Where the numbers of one channel of a block lie among all numbers.
    pub fn place(&self, block: usize, channel: usize) -> Range<usize> {
        let pixels = self.range(block);
        let from = (3 * pixels.start + channel * pixels.len()) * self.cols;
        from..from + pixels.len() * self.cols
    }

    /// Numbers in all.
    pub fn len(&self) -> usize {
        self.pixels.saturating_mul(3).saturating_mul(self.cols)
    }
}

/// The numbers themselves.
#[derive(Clone)]
pub struct Columns {
    blocks: Blocks,
    window: Window,
}

impl Columns {
    /// Zeros.
    ///
    /// # Errors
    /// When the memory cannot be had.
    pub fn zeros(blocks: Blocks) -> std::io::Result<Self> {
        Ok(Columns { blocks, window: Window::own(blocks.len() * size_of::<f32>())? })
    }

    /// Their geometry.
    pub fn blocks(&self) -> Blocks {
        self.blocks
    }

    /// One channel of a block, `[column][pixel]`.
    pub fn block(&self, block: usize, channel: usize) -> &[f32] {
        &self.window.values()[self.blocks.place(block, channel)]
    }

    /// The same, to be written; empty once the numbers are shared.
    pub fn block_mut(&mut self, block: usize, channel: usize) -> &mut [f32] {
        let place = self.blocks.place(block, channel);
        self.window.arena_mut().map_or(&mut [], |arena| &mut arena.values_mut()[place])
    }

    /// Writes one column from the covered pixels in order.
    pub fn set_column(&mut self, col: usize, response: &[[f32; 3]]) {
        for block in 0..self.blocks.count() {
            let pixels = &response[self.blocks.range(block)];
            for channel in 0..3 {
                let column = self.block_mut(block, channel).chunks_exact_mut(pixels.len()).nth(col);
                let column = column.into_iter().flatten();
                column.zip(pixels).for_each(|(to, rgb)| *to = rgb[channel]);
            }
        }
    }

    /// Fills in values that are good enough for timing.
    pub fn fill_made_up(&mut self) {
        if let Some(arena) = self.window.arena_mut() {
            arena.fill_made_up();
        }
    }

    /// Reads other numbers with every frame from now on, out of an arena larger than the caches.
    ///
    /// # Errors
    /// When the arena is smaller than these numbers.
    pub fn wander(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()> {
        self.window.wander(arena)
    }

    /// To the next numbers.
    pub fn move_on(&mut self) {
        self.window.move_on();
    }

    /// One channel of a block times `weights`, one value per pixel.
    pub fn multiply(&self, blas: &Blas, block: usize, channel: usize, weights: &[f32], out: &mut [f32]) {
        blas.sgemv(Order::ColMajor, self.block(block, channel), weights, out);
    }

    /// Chooses the fastest size of blocks over this memory. The values are then made up: fill the columns afterwards.
    pub fn choose_block_px(&mut self, blas: &Blas) {
        self.fill_made_up();
        let weights = vec![1.0; self.blocks.cols];
        let mut out = vec![0.0; BLOCK_PX.into_iter().max().unwrap_or(1)];
        let mut best = (f64::INFINITY, self.blocks.block_px);
        for _ in 0..3 {
            for block_px in BLOCK_PX {
                self.blocks.block_px = block_px;
                let start = cpu_s();
                for block in 0..self.blocks.count() {
                    let pixels = self.blocks.range(block).len();
                    (0..3).for_each(|c| self.multiply(blas, block, c, &weights, &mut out[..pixels]));
                }
                let took = cpu_s() - start;
                if took < best.0 {
                    best = (took, block_px);
                }
            }
        }
        self.blocks.block_px = best.1;
    }
}

/// The usual size of blocks, where none was tried out.
pub const USUAL_BLOCK_PX: usize = 2048;

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(pixel: usize, col: usize, channel: usize) -> f32 {
        ((pixel * 31 + col * 17 + channel * 5) % 23) as f32 / 7.0 - 1.0
    }

    #[test]
    fn every_size_of_blocks_gives_the_f64_sum() {
        let Ok(blas) = Blas::load() else { return eprintln!("skipped: no OpenBLAS here") };
        let (pixels, cols) = (37, 19);
        let weights: Vec<f32> = (0..cols).map(|col| 0.3 * col as f32 - 1.0).collect();
        for block_px in [1, 8, 37, 100] {
            let mut columns = Columns::zeros(Blocks { pixels, cols, block_px }).unwrap();
            for col in 0..cols {
                let column: Vec<_> = (0..pixels).map(|p| [0, 1, 2].map(|c| entry(p, col, c))).collect();
                columns.set_column(col, &column);
            }
            for (block, channel) in (0..columns.blocks().count()).flat_map(|b| (0..3).map(move |c| (b, c))) {
                let range = columns.blocks().range(block);
                let mut out = vec![f32::NAN; range.len()];
                columns.multiply(&blas, block, channel, &weights, &mut out);
                for (pixel, &value) in range.zip(&out) {
                    let exact: f64 =
                        (0..cols).map(|col| f64::from(entry(pixel, col, channel)) * f64::from(weights[col])).sum();
                    assert!((f64::from(value) - exact).abs() < 2e-5, "{block_px} pixel {pixel}: {value} {exact}");
                }
            }
        }
    }

    #[test]
    fn blocks_cover_every_number_once() {
        let blocks = Blocks { pixels: 10, cols: 3, block_px: 4 };
        let places = (0..blocks.count()).flat_map(|b| (0..3).map(move |c| (b, c)));
        let all: Vec<usize> = places.flat_map(|(b, c)| blocks.place(b, c)).collect();
        assert_eq!(all, (0..blocks.len()).collect::<Vec<_>>());
    }

    #[test]
    fn the_chosen_size_is_one_of_those_tried() {
        let Ok(blas) = Blas::load() else { return eprintln!("skipped: no OpenBLAS here") };
        let mut columns = Columns::zeros(Blocks { pixels: 3000, cols: 16, block_px: 1 }).unwrap();
        columns.choose_block_px(&blas);
        assert!(BLOCK_PX.contains(&columns.blocks().block_px));
    }
}
