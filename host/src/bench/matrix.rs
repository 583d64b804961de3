//! A dense f32 response of one channel, and the layouts in which OpenBLAS may multiply it.

use memmap2::MmapMut;

use super::clock::cpu_s;
use super::openblas::{Blas, Order};

/// How the matrix lies in memory: blocks of `block_rows` pixels, one after the other, each in `order`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Order inside a block: `RowMajor` keeps a pixel's patches together, `ColMajor` a patch's pixels.
    pub order: Order,
    /// Pixels per block; the last block may be shorter.
    pub block_rows: usize,
}

/// Pixels of a block whose results stay in the first-level cache while the patches pass by.
const CACHE_BLOCK: usize = 2048;

impl Layout {
    /// The layouts that are tried: one call over whole rows, over whole columns, over blocks of columns.
    pub fn candidates(rows: usize) -> [Layout; 3] {
        let rows = rows.max(1);
        [
            Layout { order: Order::RowMajor, block_rows: rows },
            Layout { order: Order::ColMajor, block_rows: rows },
            Layout { order: Order::ColMajor, block_rows: CACHE_BLOCK.min(rows) },
        ]
    }

    /// Words for a report.
    pub fn name(&self, rows: usize) -> &'static str {
        match (self.order, self.block_rows >= rows) {
            (Order::RowMajor, true) => "rows",
            (Order::ColMajor, true) => "columns",
            (Order::RowMajor, false) => "blocks of rows",
            (Order::ColMajor, false) => "blocks of columns",
        }
    }
}

/// `rows` (covered pixels) x `cols` (patches, then the sun if there is one) of f32, in one of the [`Layout`]s.
pub struct Matrix {
    memory: MmapMut,
    rows: usize,
    cols: usize,
    layout: Layout,
}

impl Matrix {
    /// A matrix of zeros.
    ///
    /// # Errors
    /// When the memory cannot be had.
    pub fn zeros(rows: usize, cols: usize, layout: Layout) -> std::io::Result<Self> {
        let memory = MmapMut::map_anon((rows * cols * size_of::<f32>()).max(1))?;
        // Large pages spare the rival page walks; a system without them is slower, not wrong.
        #[cfg(target_os = "linux")]
        let _ = memory.advise(memmap2::Advice::HugePage);
        Ok(Matrix { memory, rows, cols, layout })
    }

    /// Bytes of a matrix of this size.
    pub fn bytes(rows: usize, cols: usize) -> usize {
        rows.saturating_mul(cols).saturating_mul(size_of::<f32>())
    }

    fn values(&self) -> &[f32] {
        bytemuck::cast_slice(&self.memory[..self.rows * self.cols * size_of::<f32>()])
    }

    fn values_mut(&mut self) -> &mut [f32] {
        let bytes = self.rows * self.cols * size_of::<f32>();
        bytemuck::cast_slice_mut(&mut self.memory[..bytes])
    }

    /// Writes one column (a patch) from the covered pixels in order.
    pub fn set_column(&mut self, col: usize, column: impl IntoIterator<Item = f32>) {
        let (rows, cols, Layout { order, block_rows }) = (self.rows, self.cols, self.layout);
        let values = self.values_mut();
        for (row, value) in column.into_iter().enumerate().take(rows) {
            let block = row - row % block_rows;
            let in_block = block_rows.min(rows - block);
            let at = match order {
                Order::RowMajor => (row - block) * cols + col,
                Order::ColMajor => col * in_block + (row - block),
            };
            values[block * cols + at] = value;
        }
    }

    /// Fills every value with something that no arithmetic unit finds easier than a response.
    pub fn fill_made_up(&mut self) {
        for (k, value) in self.values_mut().iter_mut().enumerate() {
            *value = (k % 97) as f32 * 0.01;
        }
    }

    /// `out = matrix x weights`.
    pub fn multiply(&self, blas: &Blas, weights: &[f32], out: &mut [f32]) {
        let values = self.values();
        for (block, y) in out[..self.rows].chunks_mut(self.layout.block_rows).enumerate() {
            let from = block * self.layout.block_rows * self.cols;
            blas.sgemv(self.layout.order, &values[from..from + y.len() * self.cols], &weights[..self.cols], y);
        }
    }

    /// Times all candidate layouts over this matrix's memory, keeps the fastest and returns it. The values are then
    /// made up: fill the columns afterwards.
    pub fn choose_layout(&mut self, blas: &Blas) -> Layout {
        self.fill_made_up();
        let (weights, mut out) = (vec![1.0; self.cols], vec![0.0; self.rows]);
        let mut best = (f64::INFINITY, self.layout);
        for _ in 0..3 {
            for layout in Layout::candidates(self.rows) {
                self.layout = layout;
                let start = cpu_s();
                self.multiply(blas, &weights, &mut out);
                let took = cpu_s() - start;
                if took < best.0 {
                    best = (took, layout);
                }
            }
        }
        self.layout = best.1;
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_layout_gives_the_f64_sum() {
        let Ok(blas) = Blas::load() else { return eprintln!("skipped: no OpenBLAS here") };
        let (rows, cols) = (37, 19);
        let entry = |row: usize, col: usize| ((row * 31 + col * 17) % 23) as f32 / 7.0 - 1.0;
        let weights: Vec<f32> = (0..cols).map(|col| 0.3 * col as f32 - 1.0).collect();
        let blocked = [Order::RowMajor, Order::ColMajor].map(|order| Layout { order, block_rows: 8 });
        for layout in Layout::candidates(rows).into_iter().chain(blocked) {
            let mut matrix = Matrix::zeros(rows, cols, layout).unwrap();
            for col in 0..cols {
                matrix.set_column(col, (0..rows).map(|row| entry(row, col)));
            }
            let mut out = vec![f32::NAN; rows];
            matrix.multiply(&blas, &weights, &mut out);
            for (row, &value) in out.iter().enumerate() {
                let exact: f64 = (0..cols).map(|col| f64::from(entry(row, col)) * f64::from(weights[col])).sum();
                assert!((f64::from(value) - exact).abs() < 2e-5, "{layout:?} row {row}: {value} {exact}");
            }
        }
    }

    #[test]
    fn the_chosen_layout_is_a_candidate() {
        let Ok(blas) = Blas::load() else { return eprintln!("skipped: no OpenBLAS here") };
        let mut matrix = Matrix::zeros(3000, 16, Layout::candidates(3000)[0]).unwrap();
        let layout = matrix.choose_layout(&blas);
        assert!(Layout::candidates(3000).contains(&layout));
    }
}
