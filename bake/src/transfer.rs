//! What the pixels of a tile receive from the bounce points, as a block of BNCE (layout: firmware/src/bounce.rs).

use glam::Vec3A;
use nalgebra::DMatrix;

use crate::bouncepoints::{BouncePoints, SUNS, Vertex};
use crate::leading::leading_vectors;
use crate::response::{Seen, TileResponse, Transport};
use crate::sobol::two_squares;
use crate::strata::Rng;

/// What one pixel receives: weights of nodes, node 0 the mean over all points.
type Received = Vec<(u32, [f32; 3])>;

/// Nodes that the rank is chosen with.
const NODES_WEIGHED: usize = 640;
/// Most nodes that a tile keeps.
const NODES_KEPT: usize = 256;
/// Largest rank of a tile.
const RANK: usize = 16;
/// Relative error (rms over suns and pixels) that rank and nodes may cost, each.
const ERROR: f32 = 0.005;

impl Transport<'_> {
    /// The block of BNCE of the tile with the response `tile`; empty if no light comes from the points.
    pub fn bounce_block(&self, points: &BouncePoints, tile: &TileResponse) -> Vec<u8> {
        if points.is_empty() {
            return Vec::new();
        }
        let received = tile.covered.iter().map(|&index| {
            let (x, y) = (tile.x0 + u32::from(index) % tile.w, tile.y0 + u32::from(index) / tile.w);
            self.received(points, &self.seen(x, y).0, Rng::new(self.options.seed, x, y, 3))
        });
        Weights::of(received.collect(), points).map_or_else(Vec::new, |weights| weights.block(points))
    }

    /// Follows the paths of one pixel and gathers where they come by.
    fn received(&self, points: &BouncePoints, seen: &Seen, mut rng: Rng) -> Received {
        let paths = self.options.bounce_paths;
        let share = std::f32::consts::FRAC_1_PI / (paths * seen.len() as u32) as f32;
        let seed = rng.next_u32();
        let mut leaves: Vec<(u32, Vec3A)> = Vec::with_capacity(2048);
        for (s, surface) in seen.iter().enumerate() {
            let Some(surface) = surface else { continue };
            for path in 0..paths {
                let at = two_squares(s as u32 * paths + path, seed);
                self.tracer.walk(surface, at, &mut rng, |surface, throughput, _, _| {
                    let vertex = Vertex { position: surface.position, normal: surface.normal };
                    leaves.push((points.nearest(&vertex), throughput * surface.albedo * share));
                });
            }
        }
        leaves.sort_by_key(|(leaf, _)| *leaf);
        up_the_tree(leaves, points.len())
    }
}

/// Weights of points -> weights of nodes.
fn up_the_tree(mut level: Vec<(u32, Vec3A)>, points: usize) -> Received {
    let mut received = Vec::with_capacity(3 * level.len());
    level.iter_mut().for_each(|(node, _)| *node += points as u32);
    level.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 += next.1;
        }
        same
    });
    for _ in 0..points.trailing_zeros() {
        let mut parents: Vec<(u32, Vec3A)> = Vec::with_capacity(level.len());
        let mut children = level.iter().peekable();
        while let Some((node, weight)) = children.next() {
            let other = children.next_if(|(next, _)| next >> 1 == node >> 1).map(|(_, weight)| *weight);
            let (first, second) = match other {
                Some(second) => (*weight, second),
                None if node & 1 == 0 => (*weight, Vec3A::ZERO),
                None => (Vec3A::ZERO, *weight),
            };
            received.push((node >> 1, (first - second).to_array()));
            parents.push((node >> 1, first + second));
        }
        level = parents;
    }
    received.extend(level.first().map(|(_, total)| (0, total.to_array())));
    received
}

/// The weights of a tile's pixels over the nodes that matter, scaled.
struct Weights {
    pixels: usize,
    /// The nodes; the first is node 0.
    nodes: Vec<u32>,
    /// Per channel, pixels x nodes: weight over row scale.
    weights: [DMatrix<f32>; 3],
    /// `[channel][pixel]`.
    rows: [Vec<f32>; 3],
}

/// The darker a pixel, the less its relative error counts: by this power of its brightness.
const DARK_POWER: f32 = 0.5;

impl Weights {
    fn of(received: Vec<Received>, points: &BouncePoints) -> Option<Self> {
        let pixels = received.len();
        let total = |own: &Received| own.last().map_or([0.0; 3], |(_, total)| *total);
        let most = received.iter().flat_map(total).fold(0.0f32, f32::max);
        if most <= 0.0 {
            return None;
        }
        let row = |total: f32| if total > 0.0 { total / (total / most).powf(DARK_POWER).max(0.05) } else { 0.0 };
        let rows = [0, 1, 2].map(|c| received.iter().map(|own| row(total(own)[c])).collect::<Vec<f32>>());
        let scaled = |pixel: usize, weight: &[f32; 3]| {
            [0, 1, 2].map(|c: usize| if rows[c][pixel] > 0.0 { weight[c] / rows[c][pixel] } else { 0.0 })
        };
        let mut score = vec![0.0f32; points.len()];
        for (pixel, own) in received.iter().enumerate() {
            for (node, weight) in own {
                score[*node as usize] += scaled(pixel, weight).iter().map(|w| w * w).sum::<f32>();
            }
        }
        score.iter_mut().zip(&points.power).for_each(|(score, power)| *score *= power);
        let mut nodes = best(&score[1..], NODES_WEIGHED);
        nodes.iter_mut().for_each(|node| *node += 1);
        nodes.insert(0, 0);
        let mut place = vec![u32::MAX; points.len()];
        nodes.iter().enumerate().for_each(|(at, &node)| place[node as usize] = at as u32);
        let mut weights = [0; 3].map(|_| DMatrix::zeros(pixels, nodes.len()));
        for (pixel, own) in received.iter().enumerate() {
            for (node, weight) in own {
                let at = place[*node as usize];
                if at != u32::MAX {
                    let weight = scaled(pixel, weight);
                    weights.iter_mut().zip(weight).for_each(|(m, w)| m[(pixel, at as usize)] = w);
                }
            }
        }
        Some(Weights { pixels, nodes, weights, rows })
    }

    /// Left factors of the pixels under the suns, rounded to int8: pixels x rank.
    fn codes(&self, points: &BouncePoints) -> DMatrix<f32> {
        let columns: Vec<usize> = self.nodes.iter().map(|&node| node as usize).collect();
        let light = points.light.select_columns(&columns).transpose();
        let mut shown = DMatrix::zeros(self.pixels, 3 * SUNS);
        for (c, weights) in self.weights.iter().enumerate() {
            shown.columns_mut(c * SUNS, SUNS).copy_from(&(weights * &light));
        }
        let mut codes = leading_vectors(&shown, RANK, ERROR);
        for mut column in codes.column_iter_mut() {
            let largest = column.amax();
            column.apply(|value| *value = if largest > 0.0 { (*value / largest * 127.0).round() } else { 0.0 });
        }
        codes
    }

    fn block(&self, points: &BouncePoints) -> Vec<u8> {
        let codes = self.codes(points);
        let rank = codes.ncols();
        let square = codes.transpose() * &codes;
        // Columns that round to the same codes cannot be told apart: the pseudo-inverse shares their part.
        let inverse = square.clone().pseudo_inverse(1e-3 * square.amax()).unwrap_or_else(|_| square.clone());
        let right = self.weights.each_ref().map(|weights| &inverse * (codes.transpose() * weights));
        let kept = self.kept(&codes, &right, points);
        let mut block = Vec::new();
        block.extend_from_slice(&(rank as u16).to_le_bytes());
        block.extend_from_slice(&(kept.len() as u16).to_le_bytes());
        let units = self.rows.each_ref().map(|row| row.iter().fold(0.0f32, |m, &v| m.max(v)) / 65535.0);
        let floats = |block: &mut Vec<u8>, value: f32| block.extend_from_slice(&value.to_le_bytes());
        units.iter().for_each(|&unit| floats(&mut block, unit));
        right
            .iter()
            .flat_map(|right| right.column(0).iter().copied().collect::<Vec<_>>())
            .for_each(|v| floats(&mut block, v));
        let v_unit = |row: nalgebra::RowDVector<f32>| kept.iter().fold(0.0f32, |m, &j| m.max(row[j].abs())) / 127.0;
        let v_units = right.each_ref().map(|r| r.row_iter().map(|row| v_unit(row.into_owned())).collect::<Vec<f32>>());
        v_units.iter().flatten().for_each(|&unit| floats(&mut block, unit));
        kept.iter().for_each(|&j| block.extend_from_slice(&(self.nodes[j] as u16).to_le_bytes()));
        pad(&mut block);
        for (right, units) in right.iter().zip(&v_units) {
            for (k, unit) in units.iter().enumerate() {
                let code = |j: &usize| if *unit > 0.0 { (right[(k, *j)] / unit).round() as i8 as u8 } else { 0 };
                block.extend(kept.iter().map(code));
            }
        }
        pad(&mut block);
        block.extend(codes.iter().map(|&code| code as i8 as u8));
        pad(&mut block);
        for (row, unit) in self.rows.iter().zip(units) {
            let code = |v: &f32| if unit > 0.0 { (v / unit).round().clamp(0.0, 65535.0) as u16 } else { 0 };
            block.extend(row.iter().flat_map(|v| code(v).to_le_bytes()));
        }
        pad(&mut block);
        block
    }

    /// Places in `nodes`, of all but the first, that are worth their bytes.
    fn kept(&self, codes: &DMatrix<f32>, right: &[DMatrix<f32>; 3], points: &BouncePoints) -> Vec<usize> {
        let shown = right.each_ref().map(|right| codes * right);
        let energy = |j: usize| {
            let weights: f32 = shown.iter().map(|shown| shown.column(j).norm_squared()).sum();
            weights * points.power[self.nodes[j] as usize]
        };
        let energies: Vec<f32> = (0..self.nodes.len()).map(energy).collect();
        let mut order = best(&energies[1..], NODES_KEPT);
        let mut rest = energies.iter().sum::<f32>();
        let enough = ERROR * ERROR * rest;
        rest -= energies[0];
        let needed = order.iter().take_while(|&&j| {
            let more = rest > enough;
            rest -= energies[j as usize + 1];
            more
        });
        let needed = needed.count();
        order.truncate(needed);
        let mut kept: Vec<usize> = order.into_iter().map(|j| j as usize + 1).collect();
        kept.sort_by_key(|&j| self.nodes[j]);
        kept
    }
}

/// Indices of the `most` largest positive values, largest first.
fn best(score: &[f32], most: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..score.len() as u32).filter(|&k| score[k as usize] > 0.0).collect();
    let larger = |a: &u32, b: &u32| score[*b as usize].total_cmp(&score[*a as usize]).then(a.cmp(b));
    if order.len() > most {
        order.select_nth_unstable_by(most, larger);
        order.truncate(most);
    }
    order.sort_by(larger);
    order
}

fn pad(block: &mut Vec<u8>) {
    block.resize(block.len().next_multiple_of(4), 0);
}
