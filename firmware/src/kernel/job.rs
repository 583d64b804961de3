//! What the kernels work on, and what they give.

use crate::tone;

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

/// Where linear values go, and whether they are added there.
pub(super) fn planes(linear: Linear<'_>) -> (Option<[*mut f32; 3]>, bool) {
    match linear {
        Linear::Skip => (None, false),
        Linear::Write(planes) => (Some(planes.map(<[f32]>::as_mut_ptr)), false),
        Linear::Add(planes) => (Some(planes.map(<[f32]>::as_mut_ptr)), true),
    }
}

/// Where the codes go, as 0x00RRGGBB: 16 pixels a row.
#[derive(Debug)]
pub struct Shown<'a> {
    /// From the first pixel on.
    pub pixels_xrgb: &'a mut [u32],
    /// Words from row to row, at least 16.
    pub stride: usize,
}

/// How dark a tile's pixels get, per channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Smallest linear value of the covered pixels, as the tone curve tells them apart: by their logarithm
    /// ([`crate::tone`]), from 2^-16 to 1.
    pub(crate) smallest_log: [u16; 3],
    /// Smallest difference of the bits of a float, of a value (0 if negative) and of its row scale: in 2^-23 octave, roughly
    /// the logarithm of what the one is over the other.
    pub(crate) faintest_log: [i32; 3],
}

impl Extent {
    /// Of no pixels.
    pub const EMPTY: Extent = Extent { smallest_log: [u16::MAX; 3], faintest_log: [i32::MAX; 3] };

    /// Light that no pixel falls below, at most 2^-12 of itself too low; 0 where a pixel has 2^-16 or less, negative
    /// light among it; just below 1 where all have 1 or more.
    pub fn smallest(&self) -> [f32; 3] {
        self.smallest_log.map(|log| if log == 0 { 0.0 } else { tone::log16_start(u32::from(log)) })
    }

    /// Light over (row scale / 65535) that no pixel falls below, at most an eighth of itself too low; pixels of scale 0 do
    /// not count.
    pub fn faintest(&self) -> [f32; 3] {
        // The bits of two floats differ by at most this more than their logarithms: log2(1 + m) is up to 0.0861 above m.
        const UNEVEN: i32 = (0.0862 * (1 << 23) as f32) as i32;
        self.faintest_log.map(|log| 65535.0 * exp2_below(log.saturating_sub(UNEVEN)))
    }
}

/// 2 to the power of `log` / 2^23, never too high and less than 0.6 % too low; 0 below 2^-126, at most 2^101.
fn exp2_below(log: i32) -> f32 {
    let octave = (log >> 23).clamp(-127, 100) + 127;
    let place = (log & 0x7f_ffff) as f32 / (1 << 23) as f32;
    f32::from_bits((octave as u32) << 23) * ((1.0 + place * (0.6563 + 0.3437 * place)) * 0.9975)
}
