//! Bounce points: where light paths from the pixels come by, as a tree of neighbours (layout: firmware/src/bounce.rs).

use glam::Vec3A;
use nalgebra::DMatrix;
use rayon::prelude::*;
use relume_firmware::bounce::{BOUNCE_POINT, MAX_BOUNCE_POINTS};

use crate::geometry::Geometry;
use crate::response::Transport;
use crate::sobol::two_squares;
use crate::strata::{Rng, hash};

/// A point of a surface that paths met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Vertex {
    /// Lifted off the surface, m.
    pub(crate) position: Vec3A,
    /// Unit shading normal, to the side that was met.
    pub(crate) normal: Vec3A,
}

impl Vertex {
    fn along(&self, axis: u8) -> f32 {
        let axis = usize::from(axis);
        if axis < 3 { self.position[axis] } else { self.normal[axis - 3] }
    }
}

/// Suns under which the transfer from points to pixels is weighed.
pub(crate) const SUNS: usize = 128;

/// The points and their tree.
pub struct BouncePoints {
    /// `[node]`, from 1: axis (0..3 place, 3..6 normal) and where the second child begins.
    splits: Vec<(u8, f32)>,
    /// In the order of the leaves; a power of two, or none.
    points: Vec<Vertex>,
    /// Column 0: mean light of all points; column h: half the difference of node h's children. One row per sun.
    pub(crate) light: DMatrix<f32>,
    /// `[node]`: mean square of the column.
    pub(crate) power: Vec<f32>,
}

/// Paths that look for points, in all; about two of their surfaces each become candidates.
const SCOUTS: u32 = 1 << 19;
/// Most pixels that send them.
const SCOUTING_PIXELS: u32 = 1 << 17;
/// Covered pixels per point, about.
const PIXELS_PER_POINT: usize = 3;
/// Fewest points, where there are candidates enough.
const FEWEST_POINTS: usize = 1 << 13;
/// Candidates per point at least.
const CANDIDATES_PER_POINT: usize = 8;

impl Transport<'_> {
    /// Finds the points for this view. Depends on the seed only.
    pub fn bounce_points(&self) -> BouncePoints {
        let stride = (self.width * self.height).div_ceil(SCOUTING_PIXELS);
        let scouts = (SCOUTS * stride / (self.width * self.height)).clamp(4, 256).next_power_of_two();
        let pixels = 0..self.width * self.height / stride;
        let found: Vec<Option<Vec<Vertex>>> = pixels
            .into_par_iter()
            .map(|k| {
                let at = k * stride + hash(k) % stride;
                self.scout(at % self.width, at / self.width, scouts)
            })
            .collect();
        let covered = found.iter().flatten().count() * stride as usize;
        let candidates: Vec<Vertex> = found.into_iter().flatten().flatten().collect();
        let most = (candidates.len() / CANDIDATES_PER_POINT).min(MAX_BOUNCE_POINTS);
        let wanted = (covered / PIXELS_PER_POINT).next_power_of_two().clamp(FEWEST_POINTS, MAX_BOUNCE_POINTS);
        let count = wanted.min((most + 1).next_power_of_two() / 2);
        BouncePoints::new(candidates, count, &self.tracer.geometry)
    }

    /// Surfaces that paths from a pixel meet, each with a chance of the reflectances that its light passes on its way to
    /// the seen surface; `None` for a pixel that sees nothing.
    fn scout(&self, x: u32, y: u32, scouts: u32) -> Option<Vec<Vertex>> {
        let (seen, _) = self.seen(x, y);
        let seen: Vec<_> = seen.iter().flatten().collect();
        let mut rng = Rng::new(self.options.seed, x, y, 2);
        let seed = rng.next_u32();
        let mut found = Vec::new();
        for path in 0..scouts {
            let surface = seen.get(rng.next_u32() as usize % seen.len().max(1))?;
            let own = surface.albedo.max(Vec3A::splat(1e-6));
            self.tracer.walk(surface, two_squares(path, seed), &mut rng, |surface, throughput, _, rng| {
                let relayed = (throughput / own * surface.albedo).element_sum() / 3.0;
                if rng.unit() < relayed {
                    found.push(Vertex { position: surface.position, normal: surface.normal });
                }
            });
        }
        Some(found)
    }
}

impl BouncePoints {
    fn new(mut candidates: Vec<Vertex>, count: usize, geometry: &Geometry<'_>) -> Self {
        let mut splits = vec![(0, 0.0); count];
        let mut points = Vec::with_capacity(count);
        if count > 0 {
            for (node, split) in cut(&mut candidates, 1, count, &mut points) {
                splits[node] = split;
            }
        }
        let light = light_under_suns(&points, geometry);
        let power = light.column_iter().map(|column| column.norm_squared() / SUNS as f32).collect();
        BouncePoints { splits, points, light, power }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Is there no indirect light?
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The point that stands for the surroundings of a place.
    #[inline]
    pub(crate) fn nearest(&self, vertex: &Vertex) -> u32 {
        let mut node = 1;
        while node < self.splits.len() {
            let (axis, from) = self.splits[node];
            node = 2 * node + usize::from(vertex.along(axis) >= from);
        }
        (node - self.splits.len()) as u32
    }

    /// The layer BPNT.
    pub fn layer(&self) -> Vec<u8> {
        let mut layer = Vec::with_capacity(self.points.len() * BOUNCE_POINT);
        for point in &self.points {
            point.position.to_array().iter().for_each(|c| layer.extend_from_slice(&c.to_le_bytes()));
            layer.extend(point.normal.to_array().map(|c| (c * 127.0).round() as i8 as u8));
            layer.push(0);
        }
        layer
    }
}

/// Splits a node's candidates in halves down to `leaves` leaves, of which each keeps the candidate nearest to its middle.
fn cut(own: &mut [Vertex], node: usize, leaves: usize, points: &mut Vec<Vertex>) -> Vec<(usize, (u8, f32))> {
    if leaves == 1 {
        points.push(middle_one(own));
        return Vec::new();
    }
    let axis = widest(own);
    let half = own.len() / 2;
    own.select_nth_unstable_by(half, |a, b| a.along(axis).total_cmp(&b.along(axis)));
    let from = own[half].along(axis);
    let (first, second) = own.split_at_mut(half);
    let mut others = Vec::new();
    let (mut splits, more) = rayon::join(
        || cut(first, 2 * node, leaves / 2, points),
        || cut(second, 2 * node + 1, leaves / 2, &mut others),
    );
    points.append(&mut others);
    splits.extend(more);
    splits.push((node, (axis, from)));
    splits
}

/// The axis along which candidates differ most; normals count by the size of the place they are spread over.
fn widest(own: &[Vertex]) -> u8 {
    let (mut sums, mut squares) = ([Vec3A::ZERO; 2], [Vec3A::ZERO; 2]);
    // Sums about one of them keep their precision far from the origin.
    let about = own[0].position;
    for vertex in own {
        for (k, value) in [vertex.position - about, vertex.normal].into_iter().enumerate() {
            sums[k] += value;
            squares[k] += value * value;
        }
    }
    let count = own.len() as f32;
    let [place, normal] = [0, 1].map(|k| squares[k] / count - (sums[k] / count) * (sums[k] / count));
    let normal = normal * (NORMAL_SPREAD * place.element_sum());
    let all = place.to_array().into_iter().chain(normal.to_array());
    let widest = all.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    widest.map_or(0, |(axis, _)| axis as u8)
}

/// How much more the variance of normals counts than that of places, taken over the node's size.
const NORMAL_SPREAD: f32 = 4.0;

fn middle_one(own: &[Vertex]) -> Vertex {
    let count = own.len() as f32;
    let middle = own.iter().map(|v| v.position).sum::<Vec3A>() / count;
    let normal = own.iter().map(|v| v.normal).sum::<Vec3A>() / count;
    let size2 = own.iter().map(|v| v.position.distance_squared(middle)).sum::<f32>() / count;
    let off = |v: &Vertex| v.position.distance_squared(middle) + size2 * v.normal.distance_squared(normal);
    own.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(own[0])
}

/// Suns at all azimuths and, evenly, at all altitudes.
fn suns() -> Vec<Vec3A> {
    let sun = |k: usize| {
        let altitude = (k as f32 + 0.5) / SUNS as f32 * std::f32::consts::FRAC_PI_2;
        let azimuth = k as f32 * 2.399_963_2;
        Vec3A::new(altitude.cos() * azimuth.cos(), altitude.sin(), altitude.cos() * azimuth.sin())
    };
    (0..SUNS).map(sun).collect()
}

fn light_under_suns(points: &[Vertex], geometry: &Geometry<'_>) -> DMatrix<f32> {
    let suns = suns();
    let under = |point: &Vertex| {
        let light = |sun: &Vec3A| {
            let cosine = point.normal.dot(*sun);
            if cosine > 0.0 { cosine * geometry.transmittance(point.position, *sun) } else { 0.0 }
        };
        suns.iter().map(light).collect::<Vec<f32>>()
    };
    let leaves: Vec<f32> = points.par_iter().flat_map_iter(under).collect();
    let mut means = DMatrix::from_vec(SUNS, points.len(), leaves);
    let mut light = DMatrix::zeros(SUNS, points.len());
    // Level by level from the leaves: halved differences stay, means go on.
    let mut width = points.len() / 2;
    while width > 0 {
        for k in 0..width {
            let (a, b) = (means.column(2 * k).into_owned(), means.column(2 * k + 1).into_owned());
            light.set_column(width + k, &((&a - &b) * 0.5));
            means.set_column(k, &((a + b) * 0.5));
        }
        width /= 2;
    }
    if !points.is_empty() {
        light.set_column(0, &means.column(0));
    }
    light
}
