//! A tile's weights of nodes as a block of BNCE: factors of low rank, each with the nodes that matter to it.

use nalgebra::{DMatrix, DVector};
use relume_firmware::bounce::{ENTRY_TOP, entry};

use super::Received;
use crate::bouncepoints::{BouncePoints, SUNS};
use crate::leading::leading_vectors;

/// Largest rank of a tile.
const RANK: usize = 32;
/// Relative error (rms over suns and pixels) that the rank may cost, and the nodes that are left out.
const ERROR: f32 = 0.004;
/// Most weights of a tile's factors: 64 bytes per pixel.
const ENTRIES: usize = 4096;
/// The darker a pixel, the less its relative error counts: by this power of its brightness.
const DARK_POWER: f32 = 0.5;
/// Of this many of the largest nodes, the weights make up for those of the nodes that are left out.
const COARSE: u32 = 32;

/// The block of a tile whose pixels receive this; empty if no light comes from the points.
pub(super) fn encode(received: &[Received], points: &BouncePoints) -> Vec<u8> {
    Factors::of(received, points).map_or_else(Vec::new, |factors| factors.block(received))
}

struct Factors {
    /// Pixels x rank, whole numbers of 8 bits.
    codes: DMatrix<f32>,
    /// `[rank]`: weights of nodes, by node.
    weights: Vec<Vec<(u32, f32)>>,
    /// `[pixel]`: scale of a pixel's weights.
    scale: Vec<f32>,
}

impl Factors {
    fn of(received: &[Received], points: &BouncePoints) -> Option<Self> {
        let most = received.iter().map(|own| own.total).fold(0.0f32, f32::max);
        if most <= 0.0 {
            return None;
        }
        let soft = |total: f32| if total > 0.0 { total / (total / most).powf(DARK_POWER).max(0.05) } else { 0.0 };
        let scale: Vec<f32> = received.iter().map(|own| soft(own.total)).collect();
        let codes = codes(received, &scale, points);
        let all = NodeWeights::fit(&codes, received, &scale, points);
        let weights = all.worth_it(&codes, points);
        Some(Factors { codes, weights, scale })
    }

    fn block(&self, received: &[Received]) -> Vec<u8> {
        let rank = self.codes.ncols();
        let row = |c: usize| received.iter().zip(&self.scale).map(move |(own, scale)| own.tint[c] * scale);
        let row_units = [0, 1, 2].map(|c| row(c).fold(0.0f32, f32::max) / 65535.0);
        let largest = |own: &Vec<(u32, f32)>| own.iter().fold(0.0f32, |most, (_, weight)| most.max(weight.abs()));
        let v_units: Vec<f32> = self.weights.iter().map(|own| largest(own) / ENTRY_TOP as f32).collect();
        let mut block = Vec::new();
        block.extend_from_slice(&(rank as u32).to_le_bytes());
        block.extend(row_units.iter().chain(&v_units).flat_map(|unit| unit.to_le_bytes()));
        block.extend(self.weights.iter().flat_map(|own| (own.len() as u32).to_le_bytes()));
        for (own, unit) in self.weights.iter().zip(&v_units) {
            let code = |weight: f32| if *unit > 0.0 { (weight / unit).round() as i32 } else { 0 };
            block.extend(own.iter().flat_map(|(node, weight)| entry(*node, code(*weight)).to_le_bytes()));
        }
        block.extend(self.codes.iter().map(|&code| code as i8 as u8));
        pad(&mut block);
        for (c, unit) in row_units.iter().enumerate() {
            let code = |row: f32| if *unit > 0.0 { (row / unit).round().clamp(0.0, 65535.0) as u16 } else { 0 };
            block.extend(row(c).flat_map(|row| code(row).to_le_bytes()));
        }
        pad(&mut block);
        block
    }
}

/// Left factors of the pixels under the suns, rounded to int8: pixels x rank.
fn codes(received: &[Received], scale: &[f32], points: &BouncePoints) -> DMatrix<f32> {
    let mut shown = DMatrix::zeros(SUNS, received.len());
    for (pixel, (own, scale)) in received.iter().zip(scale).enumerate().filter(|(_, (_, scale))| **scale > 0.0) {
        let mut shown = shown.column_mut(pixel);
        for &(node, weight) in &own.nodes {
            shown.axpy(weight / scale, &points.light.column(node as usize), 1.0);
        }
    }
    let mut codes = leading_vectors(&shown.transpose(), RANK, ERROR);
    for mut column in codes.column_iter_mut() {
        let largest = column.amax();
        column.apply(|value| *value = if largest > 0.0 { (*value / largest * 127.0).round() } else { 0.0 });
    }
    codes
}

/// Weights of all nodes that any pixel receives light from, for every rank.
struct NodeWeights {
    nodes: Vec<u32>,
    /// Rank x nodes.
    weights: DMatrix<f32>,
}

impl NodeWeights {
    /// Least squares for these codes.
    fn fit(codes: &DMatrix<f32>, received: &[Received], scale: &[f32], points: &BouncePoints) -> Self {
        let square = codes.transpose() * codes;
        // Columns that round to the same codes cannot be told apart: the pseudo-inverse shares their part.
        let inverse = square.clone().pseudo_inverse(1e-4 * square.amax()).unwrap_or_else(|_| square.clone());
        let shares = inverse * codes.transpose();
        let mut place = vec![u32::MAX; points.len()];
        let mut nodes: Vec<u32> = (0..COARSE.min(points.len() as u32)).collect();
        nodes.iter().for_each(|&node| place[node as usize] = node);
        for &(node, _) in received.iter().flat_map(|own| &own.nodes) {
            let place = &mut place[node as usize];
            if *place == u32::MAX {
                *place = nodes.len() as u32;
                nodes.push(node);
            }
        }
        let mut weights = DMatrix::zeros(codes.ncols(), nodes.len());
        for (pixel, (own, scale)) in received.iter().zip(scale).enumerate().filter(|(_, (_, scale))| **scale > 0.0) {
            let share = shares.column(pixel);
            for &(node, weight) in &own.nodes {
                weights.column_mut(place[node as usize] as usize).axpy(weight / scale, &share, 1.0);
            }
        }
        NodeWeights { nodes, weights }
    }

    /// The fewest weights that leave no more than the error, those of the largest nodes changed for what is left out.
    fn worth_it(mut self, codes: &DMatrix<f32>, points: &BouncePoints) -> Vec<Vec<(u32, f32)>> {
        let rank = codes.ncols();
        let size: Vec<f32> = codes.column_iter().map(|column| column.norm_squared()).collect();
        let power = |at: usize| points.power[self.nodes[at] as usize];
        let energy: Vec<f32> = (0..self.nodes.len())
            .flat_map(|at| {
                self.weights.column(at).iter().zip(&size).map(|(w, size)| w * w * size * power(at)).collect::<Vec<_>>()
            })
            .collect();
        let mut order: Vec<u32> = (0..energy.len() as u32).filter(|&k| energy[k as usize] > 0.0).collect();
        let larger = |a: &u32, b: &u32| energy[*b as usize].total_cmp(&energy[*a as usize]).then(a.cmp(b));
        if order.len() > ENTRIES {
            order.select_nth_unstable_by(ENTRIES, larger);
        }
        let most = ENTRIES.min(order.len());
        order[..most].sort_by(larger);
        let mut rest: f64 = energy.iter().map(|&e| f64::from(e)).sum();
        let enough = f64::from(ERROR * ERROR) * rest;
        let needed = order[..most].iter().take_while(|&&k| {
            let more = rest > enough;
            rest -= f64::from(energy[k as usize]);
            more
        });
        let needed = needed.count();
        let left_out = &order[needed..];
        self.make_up_for(left_out, points);
        let mut kept = vec![Vec::new(); rank];
        let coarse = (0..COARSE.min(self.nodes.len() as u32) * rank as u32).filter(|k| !order[..needed].contains(k));
        for k in order[..needed].iter().copied().chain(coarse).map(|k| k as usize) {
            let weight = self.weights[(k % rank, k / rank)];
            kept[k % rank].push((self.nodes[k / rank], weight));
        }
        kept.iter_mut().for_each(|own| own.sort_by_key(|(node, _)| *node));
        kept
    }

    /// Changes the weights of the largest nodes so that, under the suns, they show what those `left_out` would: few are
    /// large, but many lean the same way.
    fn make_up_for(&mut self, left_out: &[u32], points: &BouncePoints) {
        let rank = self.weights.nrows();
        let mut missing = DMatrix::zeros(SUNS, rank);
        for &k in left_out {
            let (k, at) = (k as usize % rank, k as usize / rank);
            let light = points.light.column(self.nodes[at] as usize);
            missing.column_mut(k).axpy(self.weights[(k, at)], &light, 1.0);
        }
        let coarse = points.light.columns(0, COARSE.min(points.len() as u32) as usize);
        let mut square = coarse.transpose() * coarse;
        let ridge = RIDGE * square.trace();
        (0..square.nrows()).for_each(|k| square[(k, k)] += ridge);
        let Some(solver) = square.cholesky() else { return };
        for k in 0..rank {
            let change: DVector<f32> = solver.solve(&(coarse.transpose() * missing.column(k)));
            change.iter().enumerate().for_each(|(at, change)| self.weights[(k, at)] += change);
        }
    }
}

/// Keeps the weights of the largest nodes from following 64 suns too closely.
const RIDGE: f32 = 1e-3;

fn pad(block: &mut Vec<u8>) {
    block.resize(block.len().next_multiple_of(4), 0);
}
