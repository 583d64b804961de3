//! What the kernels work on, and what they give.

/// What [`super::Kernel::project`] multiplies: one channel of a tile's V by the weights.
#[derive(Clone, Copy, Debug)]
pub struct Projection<'a> {
    /// V of one channel, `[rank][weights.len()]`, i8 as bytes.
    pub v: &'a [u8],
    /// Weights, a multiple of 16; `sum |w| <= 2^24`.
    pub weights: &'a [i16],
    /// Blocks of 16 weights that are not all zero.
    pub lit_blocks: &'a [u8],
}

/// What [`super::Kernel::relight`] sums: U by the coefficients, scaled per row.
///
/// `value[c][x] = (sum_k U[x][k] q[c][k] * row[c][x]) * unit[c] + response[c][x] * weight[c]`: an exact integer sum,
/// then single precision in this order, each operation rounded by itself.
#[derive(Clone, Copy, Debug)]
pub struct Reconstruction<'a> {
    /// `rank/2` planes of `pixels` pairs, i8 as bytes.
    pub u: &'a [u8],
    /// Padded pixels, a multiple of 16.
    pub pixels: usize,
    /// Covered pixels, the first of them: the others do not count in the [`Extent`].
    pub covered: usize,
    /// Coefficient pairs per channel, `rank/2` used: low half even rank, high half odd rank; |q| <= 32767.
    pub pairs: [&'a [i32]; 3],
    /// Row scales `[3][pixels]`, u16 little-endian.
    pub rows: &'a [u8],
    /// Unit of `sum * row`, per channel, 0..=[`UNIT_LIMIT`].
    pub unit: [f32; 3],
    /// The sun's response `[3][pixels]`, and the unit of its counts, 0..=[`UNIT_LIMIT`]; `None`: no sun.
    pub sun: Option<(&'a [u16], [f32; 3])>,
}

/// Largest unit: sums stay below 2^29 and rows below 2^16, so that a value stays finite.
pub const UNIT_LIMIT: f32 = (1u64 << 60) as f32;

/// What becomes of the linear values.
#[derive(Debug)]
pub enum Linear<'a> {
    /// They are not kept.
    Skip,
    /// They are written, `[channel][padded pixel]`.
    Write([&'a mut [f32]; 3]),
    /// They are added to what is there; the sum is what is shown.
    Add([&'a mut [f32]; 3]),
}

/// Where the codes go, as 0x00RRGGBB: 16 pixels a row.
#[derive(Debug)]
pub struct Shown<'a> {
    /// From the first pixel on.
    pub pixels_xrgb: &'a mut [u32],
    /// Words from row to row, at least 16.
    pub stride: usize,
}

/// Smallest and largest linear value of a tile's covered pixels, per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Smallest, +infinity without pixels.
    pub smallest: [f32; 3],
    /// Largest, -infinity without pixels.
    pub largest: [f32; 3],
}

impl Extent {
    /// Of no pixels.
    pub const EMPTY: Extent = Extent { smallest: [f32::INFINITY; 3], largest: [f32::NEG_INFINITY; 3] };

    /// Takes in a pixel.
    pub(crate) fn include(&mut self, rgb: [f32; 3]) {
        for (c, value) in rgb.into_iter().enumerate() {
            self.smallest[c] = self.smallest[c].min(value);
            self.largest[c] = self.largest[c].max(value);
        }
    }

    /// Zeros without a sign: processors differ in which of two zeros is the smaller.
    pub(crate) fn positive_zero(self) -> Self {
        Extent { smallest: self.smallest.map(|v| v + 0.0), largest: self.largest.map(|v| v + 0.0) }
    }
}
