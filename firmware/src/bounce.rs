//! Indirect sunlight: bounce points, at which the sun is looked for, and what each tile receives of their light.
//!
//! Bounce points lie where light paths of the bake came by, each standing for as much of what all pixels receive. Neighbours
//! in place and normal are leaves of one complete binary tree, numbered like a heap: node 1 is the root, node h has the
//! children 2h and 2h + 1, and point i is the leaf M + i of M points. A tile receives the mean over all points times a
//! weight, and for some nodes half the difference of its two halves' means times a weight (Haar's basis on the tree).
//!
//! ```text
//! BPNT  16 bytes per point, a power of two of them, at most 65536
//!    0 f32[3] place, lifted off its surface, world metres   12 i8[3] shading normal in 1/127, to the lit side   15 reserved
//! BTIL  u32 per tile and one more: where the tile's block begins in BNCE, in units of 4 bytes
//! BNCE  per tile with light from the points: n covered pixels, r ranks, m nodes; every part starts at a multiple of 4
//!    0 u16 r, 1..=32   2 u16 m, 0..=1024
//!    4 f32[3] unit of the row scales   16 f32[3][r] weight of the mean over all points   f32[3][r] unit of V
//!      u16[m] nodes   i8[3][r][m] V   i8[r][n] U   u16[3][n] row scales
//!
//! response[x][c] = rows[c][x] unit[c] sum_k U[k][x] (mean[c][k] E(1) + unit[c][k] sum_j V[c][k][j] (E(2h) - E(2h+1)) / 2)
//! with h = nodes[j] and E the mean of cosine times visibility over a node's points; never below 0
//! ```

use crate::casters::Casters;
use crate::direct::SunDisc;
use crate::field::FieldError;
use crate::header::{f32_at, u16_at, u32_at, vec3_at};
use crate::tile::{TILE_PIXELS, TileSet};
use crate::vector::{dot, unit};

/// Length of a bounce point, bytes.
pub const BOUNCE_POINT: usize = 16;
/// Most bounce points.
pub const MAX_BOUNCE_POINTS: usize = 1 << 16;
/// Largest rank of a tile's block.
pub const MAX_BOUNCE_RANK: usize = 32;
/// Most nodes of a tile's block.
pub const MAX_BOUNCE_NODES: usize = 1024;

/// Checked layers of the indirect sunlight.
#[derive(Clone, Copy, Debug)]
pub struct Bounce<'a> {
    points: &'a [u8],
    blocks: &'a [u8],
    tiles: &'a [u8],
}

/// The parts of one tile's block.
struct Block<'a> {
    rank: usize,
    nodes: &'a [u8],
    row_units: &'a [u8],
    means: &'a [u8],
    v_units: &'a [u8],
    v: &'a [u8],
    u: &'a [u8],
    rows: &'a [u8],
}

impl<'a> Block<'a> {
    fn of(bytes: &'a [u8], pixels: usize) -> Option<Self> {
        if bytes.len() < 16 {
            return None;
        }
        let (rank, nodes) = (usize::from(u16_at(bytes, 0)), usize::from(u16_at(bytes, 2)));
        if rank == 0 || rank > MAX_BOUNCE_RANK || nodes > MAX_BOUNCE_NODES {
            return None;
        }
        let mut at = 4;
        let mut part = |length: usize| {
            let part = bytes.get(at..at + length);
            at += length.next_multiple_of(4);
            part
        };
        let row_units = part(12)?;
        let (means, v_units) = (part(12 * rank)?, part(12 * rank)?);
        let (nodes, v) = (part(2 * nodes)?, part(3 * rank * nodes)?);
        let (u, rows) = (part(rank * pixels)?, part(6 * pixels)?);
        (at == bytes.len()).then_some(Block { rank, nodes, row_units, means, v_units, v, u, rows })
    }

    fn is_sound(&self, points: usize) -> bool {
        let finite = |bytes: &[u8]| (0..bytes.len() / 4).all(|k| f32_at(bytes, 4 * k).is_finite());
        let known = |node: usize| (1..points).contains(&node);
        let nodes = (0..self.nodes.len() / 2).all(|j| known(usize::from(u16_at(self.nodes, 2 * j))));
        nodes && points > 0 && finite(self.row_units) && finite(self.means) && finite(self.v_units)
    }
}

impl<'a> Bounce<'a> {
    pub(crate) fn check([points, blocks, tiles]: [&'a [u8]; 3], response: &TileSet<'_>) -> Result<Self, FieldError> {
        let bounce = Bounce { points, blocks, tiles };
        let count = points.len() / BOUNCE_POINT;
        let whole = points.len().is_multiple_of(BOUNCE_POINT) && (count == 0 || count.is_power_of_two());
        if !whole || count > MAX_BOUNCE_POINTS || blocks.len() != (response.tiles() + 1) * 4 {
            return Err(FieldError::Invalid("length of a bounce layer"));
        }
        if !points.chunks_exact(BOUNCE_POINT).all(|point| vec3_at(point, 0).iter().all(|c| c.is_finite())) {
            return Err(FieldError::Invalid("bounce point"));
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

    /// Cosine times visibility of the sun for points `first..first + out.len()`.
    pub(crate) fn light(&self, casters: &Casters<'_>, disc: &SunDisc, first: usize, out: &mut [f32]) {
        for (k, value) in out.iter_mut().enumerate() {
            let Some(point) = self.points.get((first + k) * BOUNCE_POINT..(first + k + 1) * BOUNCE_POINT) else {
                return;
            };
            let normal = unit([12, 13, 14].map(|at| f32::from(point[at] as i8)));
            let light = disc.direction(first + k);
            let cosine = dot(normal, light);
            *value = if cosine > 0.0 { cosine * casters.transmittance(vec3_at(point, 0), light) } else { 0.0 };
        }
    }

    /// Writes the indirect response of a tile's covered pixels, `[channel][pixel]`, for the points' light `means`.
    pub(crate) fn tile(&self, tile: usize, pixels: usize, means: &[f32], out: &mut [[f32; TILE_PIXELS]; 3]) {
        let (from, to) = self.range(tile);
        let Some(block) = Block::of(&self.tiles[from..to], pixels) else { return };
        if means.len() != 2 * self.points() {
            return;
        }
        let nodes = block.nodes.len() / 2;
        let mut light = [0.0f32; MAX_BOUNCE_NODES];
        for (j, light) in light.iter_mut().take(nodes).enumerate() {
            let node = usize::from(u16_at(block.nodes, 2 * j));
            *light = 0.5 * (means[2 * node] - means[2 * node + 1]);
        }
        for (c, out) in out.iter_mut().enumerate() {
            for k in 0..block.rank {
                let at = c * block.rank + k;
                let v = &block.v[at * nodes..][..nodes];
                let sum = v.iter().zip(&light).map(|(&v, light)| f32::from(v as i8) * light).sum::<f32>();
                let coefficient = f32_at(block.means, 4 * at) * means[1] + f32_at(block.v_units, 4 * at) * sum;
                for (value, &u) in out.iter_mut().zip(&block.u[k * pixels..][..pixels]) {
                    *value += coefficient * f32::from(u as i8);
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
pub fn mean_up(means: &mut [f32]) {
    for node in (1..means.len() / 2).rev() {
        means[node] = 0.5 * (means[2 * node] + means[2 * node + 1]);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    /// One pixel, rank 1, node 2 of four points: every part fills whole words.
    fn block() -> Vec<u8> {
        let mut bytes = Vec::from([1, 0, 1, 0]);
        for float in [1e-3f32, 2e-3, 4e-3, 0.5, 0.25, 0.125, 0.01, 0.01, 0.01] {
            bytes.extend(float.to_le_bytes());
        }
        bytes.extend([2, 0, 0, 0]); // node 2
        bytes.extend([100, 50, 0x9c, 0]); // V: 100, 50, -100
        bytes.extend([4, 0, 0, 0]); // U
        bytes.extend([0xe8, 3, 0xe8, 3, 0xe8, 3, 0, 0]); // rows: 1000
        bytes
    }

    #[test]
    fn a_pixel_receives_the_mean_and_the_difference_of_a_nodes_halves() {
        let points = [0u8; 4 * BOUNCE_POINT];
        let bytes = block();
        let mut blocks = [0u8; 8];
        blocks[4] = (bytes.len() / 4) as u8;
        let bounce = Bounce { points: &points, blocks: &blocks, tiles: &bytes };
        assert!(Block::of(&bytes, 1).is_some_and(|block| block.is_sound(4) && !block.is_sound(2)));
        assert!(Block::of(&bytes, 2).is_none() && Block::of(&bytes[..40], 1).is_none());
        let mut means = [0.0, 0.0, 0.0, 0.0, 0.8, 0.2, 0.4, 0.6];
        mean_up(&mut means);
        assert!(means[1..4].iter().zip([0.5, 0.5, 0.5]).all(|(a, b)| (a - b).abs() < 1e-6));
        let mut out = [[0.0; TILE_PIXELS]; 3];
        bounce.tile(0, 1, &means, &mut out);
        // rows * unit * U * (mean * E(1) + V * unit * (0.8 - 0.2) / 2), by hand.
        let want = [1.0 * 4.0 * (0.25 + 0.3), 2.0 * 4.0 * (0.125 + 0.15), 0.0];
        for c in 0..3 {
            assert!((out[c][0] - want[c]).abs() < 1e-5, "{c}: {} instead of {}", out[c][0], want[c]);
        }
    }
}
