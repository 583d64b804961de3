//! Indirect sunlight: bounce points, at which the sun is looked for, and what each tile receives of their light.
//!
//! Bounce points lie where light paths of the bake came by, each standing for as much of what all pixels receive. Neighbours
//! in place and normal are leaves of one complete binary tree, numbered like a heap: node 1 is the root, node h has the
//! children 2h and 2h + 1, and point i is the leaf M + i of M points. A tile receives the mean over all points times a
//! weight, and for some nodes half the difference of its two halves' means times a weight (Haar's basis on the tree).
//!
//! ```text
//! BPNT  0 f32[3] origin   12 f32 step, world metres; then 12 bytes per point (bouncepoint.rs), a power of two of them,
//!       at most 2^18
//! BTIL  u32 per tile and one more: where the tile's block begins in BNCE, in units of 4 bytes
//! BNCE  per tile with light from the points: n covered pixels, r ranks; every part starts at a multiple of 4
//!    0 u32 r, 1..=32   4 f32[3] unit of the row scales   16 f32[r] unit of V   u32[r] entries of each rank
//!      u32 per entry of V, rank by rank: low 18 bits the node (0: the mean over all points), above them i14 code
//!      i8[r][n] U   u16[3][n] row scales
//!
//! response[x][c] = rows[c][x] unit[c] sum_k U[k][x] unit[k] sum_j code[k][j] D[c](nodes[k][j]), never below 0
//! D(0) = E(1) and D(h) = (E(2h) - E(2h+1)) / 2, with E[c] the mean of cosine times visibility times tint[c] over a
//! node's points
//! ```

use crate::bouncepoint::{BOUNCE_POINT, POINT_GRID, PointGrid};
use crate::casters::Casters;
use crate::direct::SunDisc;
use crate::field::FieldError;
use crate::header::{f32_at, u16_at, u32_at};
use crate::tile::{TILE_PIXELS, TileSet};
use crate::vector::{add, dot, mul, sub};

/// Light per channel.
pub type Rgb = [f32; 3];

/// Most bounce points.
pub const MAX_BOUNCE_POINTS: usize = 1 << 18;
/// Largest rank of a tile's block.
pub const MAX_BOUNCE_RANK: usize = 32;
/// Largest code of an entry of V.
pub const ENTRY_TOP: i32 = 8191;

/// Bits of an entry that name the node.
const NODE_BITS: u32 = MAX_BOUNCE_POINTS.trailing_zeros();

/// An entry of V: a node and the code of its weight, at most [`ENTRY_TOP`] either way.
pub fn entry(node: u32, code: i32) -> u32 {
    node | (code as u32) << NODE_BITS
}

fn node_and_code(entry: u32) -> (usize, i32) {
    ((entry & ((1 << NODE_BITS) - 1)) as usize, entry as i32 >> NODE_BITS)
}

/// Checked layers of the indirect sunlight.
#[derive(Clone, Copy, Debug)]
pub struct Bounce<'a> {
    grid: PointGrid,
    points: &'a [u8],
    blocks: &'a [u8],
    tiles: &'a [u8],
}

/// The parts of one tile's block.
struct Block<'a> {
    rank: usize,
    row_units: &'a [u8],
    v_units: &'a [u8],
    counts: &'a [u8],
    entries: &'a [u8],
    u: &'a [u8],
    rows: &'a [u8],
}

impl<'a> Block<'a> {
    fn of(bytes: &'a [u8], pixels: usize) -> Option<Self> {
        let rank = u32_at(bytes.get(..4)?, 0) as usize;
        if rank == 0 || rank > MAX_BOUNCE_RANK {
            return None;
        }
        let mut at = 4usize;
        let mut part = |length: usize| {
            let part = bytes.get(at..at.checked_add(length)?);
            at += length.next_multiple_of(4);
            part
        };
        let (row_units, v_units, counts) = (part(12)?, part(4 * rank)?, part(4 * rank)?);
        let count = counts.chunks_exact(4).try_fold(0usize, |sum, own| sum.checked_add(u32_at(own, 0) as usize))?;
        let entries = part(count.checked_mul(4)?)?;
        let (u, rows) = (part(rank * pixels)?, part(6 * pixels)?);
        (at == bytes.len()).then_some(Block { rank, row_units, v_units, counts, entries, u, rows })
    }

    fn is_sound(&self, points: usize) -> bool {
        let finite = |bytes: &[u8]| (0..bytes.len() / 4).all(|k| f32_at(bytes, 4 * k).is_finite());
        let nodes = self.entries.chunks_exact(4).all(|entry| node_and_code(u32_at(entry, 0)).0 < points);
        nodes && points > 0 && finite(self.row_units) && finite(self.v_units)
    }

    /// The light of every rank, `[rank][channel]`.
    fn coefficients(&self, means: &[Rgb]) -> [Rgb; MAX_BOUNCE_RANK] {
        let mut out = [[0.0; 3]; MAX_BOUNCE_RANK];
        let mut entries = self.entries.chunks_exact(4);
        for (k, out) in out.iter_mut().enumerate().take(self.rank) {
            for entry in entries.by_ref().take(u32_at(self.counts, 4 * k) as usize) {
                let (node, code) = node_and_code(u32_at(entry, 0));
                let light = node_light(means, node);
                (0..3).for_each(|c| out[c] += code as f32 * light[c]);
            }
            *out = mul(*out, f32_at(self.v_units, 4 * k));
        }
        out
    }
}

/// What a node's weight is multiplied by: the mean of all points for node 0, half the difference of the halves for others.
fn node_light(means: &[Rgb], node: usize) -> Rgb {
    if node == 0 { means[1] } else { mul(sub(means[2 * node], means[2 * node + 1]), 0.5) }
}

impl<'a> Bounce<'a> {
    pub(crate) fn check([points, blocks, tiles]: [&'a [u8]; 3], response: &TileSet<'_>) -> Result<Self, FieldError> {
        let bad = FieldError::Invalid("bounce points");
        let (grid, points) = points.split_at_checked(POINT_GRID).ok_or(bad)?;
        let bounce = Bounce { grid: PointGrid::decode(grid).ok_or(bad)?, points, blocks, tiles };
        let count = points.len() / BOUNCE_POINT;
        let whole = points.len().is_multiple_of(BOUNCE_POINT) && (count == 0 || count.is_power_of_two());
        if !whole || count > MAX_BOUNCE_POINTS || blocks.len() != (response.tiles() + 1) * 4 {
            return Err(FieldError::Invalid("length of a bounce layer"));
        }
        for tile in 0..response.tiles() {
            let (from, to) = bounce.range(tile);
            let block = tiles.get(from..to).ok_or(FieldError::Invalid("place of a bounce block"))?;
            let sound = || Block::of(block, response.tile(tile).pixels()).is_some_and(|block| block.is_sound(count));
            if !block.is_empty() && !sound() {
                return Err(FieldError::Invalid("bounce block"));
            }
        }
        Ok(bounce)
    }

    fn range(&self, tile: usize) -> (usize, usize) {
        (u32_at(self.blocks, tile * 4) as usize * 4, u32_at(self.blocks, tile * 4 + 4) as usize * 4)
    }

    /// Number of points, 0 or a power of two.
    pub fn points(&self) -> usize {
        self.points.len() / BOUNCE_POINT
    }

    /// Cosine times visibility of the sun times tint for points `first..first + out.len()`.
    pub(crate) fn light(&self, casters: &Casters<'_>, disc: &SunDisc, first: usize, out: &mut [Rgb]) {
        let points = self.points.as_chunks::<BOUNCE_POINT>().0.iter().skip(first);
        for (k, (value, point)) in out.iter_mut().zip(points).enumerate() {
            let point = self.grid.decode_point(point);
            let light = disc.direction(first + k);
            let cosine = dot(point.normal, light);
            let lit = if cosine > 0.0 { cosine * casters.transmittance(point.place, light) } else { 0.0 };
            *value = mul(point.tint, lit);
        }
    }

    /// Writes the indirect response of a tile's covered pixels, `[channel][pixel]`, for the points' light `means`.
    pub(crate) fn tile(&self, tile: usize, pixels: usize, means: &[Rgb], out: &mut [[f32; TILE_PIXELS]; 3]) {
        let (from, to) = self.range(tile);
        let Some(block) = Block::of(&self.tiles[from..to], pixels) else { return };
        if means.len() != 2 * self.points() {
            return;
        }
        let coefficients = block.coefficients(means);
        for (c, out) in out.iter_mut().enumerate() {
            for (k, coefficient) in coefficients.iter().enumerate().take(block.rank) {
                for (value, &u) in out.iter_mut().zip(&block.u[k * pixels..][..pixels]) {
                    *value += coefficient[c] * f32::from(u as i8);
                }
            }
            let unit = f32_at(block.row_units, 4 * c);
            for (x, value) in out.iter_mut().take(pixels).enumerate() {
                *value = (*value * unit * f32::from(u16_at(block.rows, 2 * (c * pixels + x)))).max(0.0);
            }
        }
    }
}

/// Sums the light of bounce points up their tree: `means` holds 2 M values for M points, the points' own light in the
/// upper half; the lower half becomes the nodes' means.
pub fn mean_up(means: &mut [Rgb]) {
    for node in (1..means.len() / 2).rev() {
        means[node] = mul(add(means[2 * node], means[2 * node + 1]), 0.5);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    /// One pixel, rank 2: every part fills whole words.
    fn block() -> Vec<u8> {
        let mut bytes = Vec::from([2, 0, 0, 0]);
        for float in [1e-3f32, 2e-3, 4e-3, 0.25, 0.5] {
            bytes.extend(float.to_le_bytes());
        }
        // The mean and node 2 for one rank, node 3 for the other.
        for word in [2, 1, entry(0, 4), entry(2, -8191), entry(3, 100)] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend([4, 0xfe, 0, 0]); // U: 4, -2
        bytes.extend([0xe8, 3, 0xe8, 3, 0, 0, 0, 0]); // rows: 1000, 1000, 0
        bytes
    }

    #[test]
    fn a_pixel_receives_the_mean_and_the_differences_of_nodes_halves() {
        let points = [0u8; 4 * BOUNCE_POINT];
        let bytes = block();
        let mut blocks = [0u8; 8];
        blocks[4] = (bytes.len() / 4) as u8;
        let grid = PointGrid { origin: [0.0; 3], step: 0.0 };
        let bounce = Bounce { grid, points: &points, blocks: &blocks, tiles: &bytes };
        assert!(Block::of(&bytes, 1).is_some_and(|block| block.is_sound(4) && !block.is_sound(2)));
        assert!(Block::of(&bytes, 2).is_none() && Block::of(&bytes[..40], 1).is_none());
        let mut means = [[0.0; 3]; 8];
        means[4..].copy_from_slice(&[[0.2; 3], [0.8, 0.2, 0.0], [0.4; 3], [0.6, 0.3, 0.4]]);
        mean_up(&mut means);
        let near = |a: Rgb, b: Rgb| (0..3).all(|c| (a[c] - b[c]).abs() < 1e-6);
        assert!(near(means[1], [0.5, 0.275, 0.25]) && near(means[2], [0.5, 0.2, 0.1]));
        let mut out = [[0.0; TILE_PIXELS]; 3];
        bounce.tile(0, 1, &means, &mut out);
        // Rows and units are 1 and 2; U times (mean, half difference) of the two ranks, by hand.
        let red = 4.0 * 0.25 * (4.0 * 0.5 + 8191.0 * 0.3) - 2.0 * 0.5 * 100.0 * -0.1;
        let green = 2.0 * (4.0 * 0.25 * (4.0 * 0.275) - 2.0 * 0.5 * 100.0 * 0.05);
        for (c, want) in [red, f32::max(green, 0.0), 0.0].into_iter().enumerate() {
            assert!((out[c][0] - want).abs() < 1e-3 * (1.0 + want), "{c}: {} instead of {want}", out[c][0]);
        }
    }

    #[test]
    fn an_entry_keeps_node_and_code() {
        for (node, code) in [(0, 0), (1, -1), (MAX_BOUNCE_POINTS as u32 - 1, ENTRY_TOP), (77, -ENTRY_TOP)] {
            assert_eq!(node_and_code(entry(node, code)), (node as usize, code));
        }
    }
}
