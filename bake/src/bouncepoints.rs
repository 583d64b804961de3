//! Bounce points: where light paths from the pixels come by, as a tree of neighbours (layout: firmware/src/bounce.rs).

mod scout;

use glam::Vec3A;
use nalgebra::DMatrix;
use rayon::prelude::*;
use relume_firmware::bouncepoint::{BOUNCE_POINT, POINT_GRID, PointGrid, rounded_tint};

use crate::geometry::{Geometry, Surface};

/// A point of a surface that paths met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Vertex {
    /// Lifted off the surface, m.
    pub(crate) position: Vec3A,
    /// Unit shading normal, to the side that was met.
    pub(crate) normal: Vec3A,
    /// Colour of the surface: its reflectance over the mean of the channels.
    pub(crate) tint: Vec3A,
    /// How many paths it stands for.
    pub(crate) paths: f32,
}

impl Vertex {
    pub(crate) fn of(surface: &Surface, paths: f32) -> Self {
        let reflectance = surface.reflectance();
        let mean = reflectance.element_sum() / 3.0;
        let tint = if mean > 0.0 { reflectance / mean } else { Vec3A::ONE };
        Vertex { position: surface.position, normal: surface.normal, tint, paths }
    }

    fn along(&self, axis: u8) -> f32 {
        let axis = usize::from(axis);
        if axis < 3 { self.position[axis] } else { self.normal[axis - 3] }
    }
}

/// Suns under which the transfer from points to pixels is weighed.
pub(crate) const SUNS: usize = 64;

/// The points and their tree.
pub struct BouncePoints {
    /// `[node]`, from 1: axis (0..3 place, 3..6 normal) and where along it the second child begins.
    splits: Vec<(u8, f32)>,
    /// In the order of the leaves; a power of two, or none.
    points: Vec<Vertex>,
    /// Column 0: mean light of all points; column h: half the difference of node h's children. One row per sun.
    pub(crate) light: DMatrix<f32>,
    /// `[point]`: its mean light over the suns.
    pub(crate) leaf_light: Vec<f32>,
    /// `[node]`: mean square of the column.
    pub(crate) power: Vec<f32>,
}

impl BouncePoints {
    /// The layer BPNT of a field without points.
    pub fn no_layer() -> Vec<u8> {
        PointGrid::over([0.0; 3], [0.0; 3]).encode().to_vec()
    }

    fn new(mut candidates: Vec<Vertex>, count: usize, geometry: &Geometry<'_>) -> Self {
        let mut splits = vec![(0, 0.0); count];
        let mut points = Vec::with_capacity(count);
        if count > 0 {
            for (node, split) in cut(&mut candidates, 1, count, &mut points) {
                splits[node] = split;
            }
        }
        points.iter_mut().for_each(|point| point.tint = Vec3A::from(rounded_tint(point.tint.to_array())));
        let (light, leaf_light) = light_under_suns(&points, geometry);
        let power = light.column_iter().map(|column| column.norm_squared() / SUNS as f32).collect();
        BouncePoints { splits, points, light, leaf_light, power }
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

    /// What a point's light is multiplied by, as the field will have it.
    #[inline]
    pub(crate) fn tint(&self, point: u32) -> Vec3A {
        self.points[point as usize].tint
    }

    /// The layer BPNT.
    pub fn layer(&self) -> Vec<u8> {
        let corner = |pick: fn(Vec3A, Vec3A) -> Vec3A| self.points.iter().map(|point| point.position).reduce(pick);
        let [low, high] = [corner(Vec3A::min), corner(Vec3A::max)].map(|c| c.unwrap_or_default().to_array());
        let grid = PointGrid::over(low, high);
        let mut layer = Vec::with_capacity(POINT_GRID + self.points.len() * BOUNCE_POINT);
        layer.extend(grid.encode());
        let bytes = |p: &Vertex| grid.point(p.position.to_array(), p.normal.to_array(), p.tint.to_array());
        layer.extend(self.points.iter().flat_map(bytes));
        layer
    }
}

/// A node, its axis and where its second child begins.
type Split = (usize, (u8, f32));

/// Splits a node's candidates down to `leaves` leaves, each of which keeps the candidate nearest to its middle.
fn cut(own: &mut [Vertex], node: usize, leaves: usize, points: &mut Vec<Vertex>) -> Vec<Split> {
    if leaves == 1 {
        points.push(middle_one(own));
        return Vec::new();
    }
    let found = axes(own).into_iter().find_map(|axis| halve(own, axis).map(|(at, from)| (at, axis, from)));
    let Some((at, axis, from)) = found else {
        // All alike: one of them stands for the whole subtree, whichever leaf a place falls into.
        points.extend(std::iter::repeat_n(own[0], leaves));
        return Vec::new();
    };
    let (first, second) = own.split_at_mut(at);
    let mut others = Vec::new();
    let (mut splits, more) =
        rayon::join(|| cut(first, 2 * node, leaves / 2, points), || cut(second, 2 * node + 1, leaves / 2, &mut others));
    points.append(&mut others);
    splits.extend(more);
    splits.push((node, (axis, from)));
    splits
}

/// Puts the candidates below a value along `axis` first, as near to half of them as can be without parting equals (walls
/// of one direction are equal along three axes). Returns their number and the value; `None` when all are equal.
fn halve(own: &mut [Vertex], axis: u8) -> Option<(usize, f32)> {
    let half = own.len() / 2;
    let (_, middle, _) = own.select_nth_unstable_by(half, |a, b| a.along(axis).total_cmp(&b.along(axis)));
    let middle = middle.along(axis);
    let below = own.iter().filter(|v| v.along(axis) < middle).count();
    let next = own.iter().map(|v| v.along(axis)).filter(|&v| v > middle).fold(f32::INFINITY, f32::min);
    let to_next = own.iter().filter(|v| v.along(axis) < next).count();
    let lower_is_nearer = half - below <= to_next - half;
    let (at, from) = match (below > 0, to_next < own.len()) {
        (true, false) => (below, middle),
        (true, true) if lower_is_nearer => (below, middle),
        (_, true) => (to_next, next),
        (false, false) => return None,
    };
    own.select_nth_unstable_by(at, |a, b| a.along(axis).total_cmp(&b.along(axis)));
    Some((at, from))
}

/// The axes, the one along which candidates differ most first; normals count by the size of the place they are spread
/// over.
fn axes(own: &[Vertex]) -> [u8; 6] {
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
    let spread = [place.x, place.y, place.z, normal.x, normal.y, normal.z];
    let mut axes = [0, 1, 2, 3, 4, 5];
    axes.sort_by(|&a, &b| spread[usize::from(b)].total_cmp(&spread[usize::from(a)]));
    axes
}

/// How much more the variance of normals counts than that of places, taken over the node's size.
const NORMAL_SPREAD: f32 = 4.0;

fn middle_one(own: &[Vertex]) -> Vertex {
    let count = own.iter().map(|v| v.paths).sum::<f32>();
    let middle = own.iter().map(|v| v.position * v.paths).sum::<Vec3A>() / count;
    let normal = own.iter().map(|v| v.normal * v.paths).sum::<Vec3A>() / count;
    let size2 = own.iter().map(|v| v.paths * v.position.distance_squared(middle)).sum::<f32>() / count;
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

fn light_under_suns(points: &[Vertex], geometry: &Geometry<'_>) -> (DMatrix<f32>, Vec<f32>) {
    let suns = suns();
    let under = |point: &Vertex| {
        let light = |sun: &Vec3A| {
            let cosine = point.normal.dot(*sun);
            if cosine > 0.0 { cosine * geometry.transmittance(point.position, *sun) } else { 0.0 }
        };
        suns.iter().map(light).collect::<Vec<f32>>()
    };
    let leaves: Vec<f32> = points.par_iter().flat_map_iter(under).collect();
    let leaf_light = leaves.chunks_exact(SUNS).map(|own| own.iter().sum::<f32>() / SUNS as f32).collect();
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
    (light, leaf_light)
}
