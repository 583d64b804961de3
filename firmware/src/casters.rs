//! The triangles that throw the sun's shadow, and their bounding volumes.
//!
//! ```text
//! CAST  64 bytes per caster (a triangle), in the order of the leaves of CBVH
//!    0 f32[9] corners, world metres   36 i16[9] corner normals in 1/32767   54 u8 opacity, 255 = opaque   55 reserved
//! CBVH  32 bytes per node, depth first
//!    0 f32[3] low corner   12 u32 next node when the ray misses the box (or after a leaf)
//!   16 f32[3] high corner  28 u32 0: inner node, else first caster << 4 | number of casters (1..=15)
//! ```

use crate::field::FieldError;
use crate::header::{u16_at, u32_at, vec3_at};
use crate::vector::{Vec3, add, cross, dot, length, mul, sub};

/// Length of a caster, bytes.
pub const CASTER: usize = 64;
/// Length of a node, bytes.
pub const NODE: usize = 32;

/// Checked CAST and CBVH.
#[derive(Clone, Copy, Debug)]
pub struct Casters<'a> {
    casters: &'a [u8],
    nodes: &'a [u8],
}

impl<'a> Casters<'a> {
    pub(crate) fn check(casters: &'a [u8], nodes: &'a [u8]) -> Result<Self, FieldError> {
        if !casters.len().is_multiple_of(CASTER) || !nodes.len().is_multiple_of(NODE) {
            return Err(FieldError::Invalid("length of a sunlight layer"));
        }
        let finite = |bytes: &[u8], floats: &[usize]| floats.iter().all(|&at| f32_finite(bytes, at));
        let corners = [0, 4, 8, 12, 16, 20, 24, 28, 32];
        if !casters.chunks_exact(CASTER).all(|caster| finite(caster, &corners)) {
            return Err(FieldError::Invalid("sunlight caster"));
        }
        let count = nodes.len() / NODE;
        for (index, node) in nodes.chunks_exact(NODE).enumerate() {
            let (next, leaf) = (u32_at(node, 12) as usize, u32_at(node, 28));
            let last = (leaf >> 4) as usize + (leaf & 15) as usize;
            let leaf_good = leaf == 0 || (leaf & 15 != 0 && last <= casters.len() / CASTER && next == index + 1);
            if next <= index || next > count || !leaf_good || !finite(node, &[0, 4, 8, 16, 20, 24]) {
                return Err(FieldError::Invalid("sunlight node"));
            }
        }
        Ok(Casters { casters, nodes })
    }

    /// Number of casters.
    pub fn len(&self) -> usize {
        self.casters.len() / CASTER
    }

    /// Is there nothing that throws a shadow or shows one?
    pub fn is_empty(&self) -> bool {
        self.casters.is_empty()
    }

    pub(crate) fn get(&self, index: u32) -> Caster<'a> {
        Caster(&self.casters[index as usize * CASTER..][..CASTER])
    }

    /// Length of the diagonal of the box around all that throws shadows, m.
    pub(crate) fn diagonal(&self) -> f32 {
        self.nodes.get(..NODE).map_or(0.0, |root| length(sub(vec3_at(root, 16), vec3_at(root, 0))))
    }

    /// Calls `visit` with the casters of every leaf whose box passes `meets`, until it returns false.
    #[inline]
    fn walk(&self, meets: impl Fn(&[u8]) -> bool, mut visit: impl FnMut(u32) -> bool) {
        let count = self.nodes.len() / NODE;
        let mut index = 0;
        while index < count {
            let node = &self.nodes[index * NODE..][..NODE];
            if !meets(node) {
                index = u32_at(node, 12) as usize;
                continue;
            }
            index += 1;
            let leaf = u32_at(node, 28);
            for caster in leaf >> 4..(leaf >> 4) + (leaf & 15) {
                if !visit(caster) {
                    return;
                }
            }
        }
    }

    /// Share of light (0..=1) that reaches `origin` from direction `dir`.
    pub fn transmittance(&self, origin: Vec3, dir: Vec3) -> f32 {
        // A zero component would make 0 * infinity; a tiny one moves the ray by less than a rounding.
        let inverse = dir.map(safe_inverse);
        let mut left = 1.0f32;
        self.walk(
            |node| hits_box(vec3_at(node, 0), vec3_at(node, 16), origin, inverse, 0.0),
            |caster| {
                let caster = self.get(caster);
                if caster.stops(origin, dir) {
                    left *= caster.passes();
                }
                left >= DARK
            },
        );
        if left >= DARK { left } else { 0.0 }
    }

    /// What stands in a beam of sunlight. Conservative: whatever stops a ray of the beam is among the suspects.
    pub(crate) fn beam(&self, beam: &Beam<'_>, suspects: &mut Suspects) -> Passage {
        let inverse = beam.dir.map(safe_inverse);
        let outward = beam.dir.map(f32::abs);
        suspects.count = 0;
        let mut blocked = false;
        let mut some = false;
        self.walk(
            |node| {
                let (low, high) = (vec3_at(node, 0), vec3_at(node, 16));
                let middle = mul(add(low, high), 0.5);
                let reach = dot(sub(middle, beam.origin), beam.dir) + dot(sub(high, middle), outward);
                let wide = beam.radius_at(reach);
                let (low, high) = (low.map(|v| v - wide), high.map(|v| v + wide));
                reach >= -beam.radius && hits_box(low, high, beam.origin, inverse, -beam.radius)
            },
            |index| {
                let caster = self.get(index);
                match caster.meets(beam) {
                    Passage::Free => {}
                    Passage::Blocked if caster.passes() < DARK => blocked = true,
                    _ => {
                        some = true;
                        suspects.add(index);
                    }
                }
                !blocked
            },
        );
        match (blocked, some) {
            (true, _) => Passage::Blocked,
            (_, true) => Passage::Parted,
            _ => Passage::Free,
        }
    }

    /// [`Casters::transmittance`] for a ray of the beam whose suspects these are.
    pub(crate) fn transmittance_past(&self, suspects: &Suspects, origin: Vec3, dir: Vec3) -> f32 {
        let Some(suspects) = suspects.list.get(..suspects.count) else { return self.transmittance(origin, dir) };
        let mut left = 1.0f32;
        for &index in suspects {
            let caster = self.get(index);
            if caster.stops(origin, dir) {
                left *= caster.passes();
                if left < DARK {
                    return 0.0;
                }
            }
        }
        left
    }
}

/// Less light than this is none.
const DARK: f32 = 1.0 / 512.0;

fn safe_inverse(d: f32) -> f32 {
    1.0 / if d.abs() < 1e-12 { 1e-12 } else { d }
}

fn f32_finite(bytes: &[u8], at: usize) -> bool {
    f32::from_bits(u32_at(bytes, at)).is_finite()
}

/// Slab test from `near` on; the margin of 4 rounding errors keeps edges closed (Ize, *Robust BVH Ray Traversal*, JCGT
/// 2013).
#[inline]
fn hits_box(low: Vec3, high: Vec3, origin: Vec3, inverse: Vec3, near: f32) -> bool {
    let (mut near, mut far) = (near, f32::INFINITY);
    for axis in 0..3 {
        let a = (low[axis] - origin[axis]) * inverse[axis];
        let b = (high[axis] - origin[axis]) * inverse[axis];
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    near <= far + far.abs() * 5e-7
}

/// All rays from `points` towards the sun's disc: they stay within a cone that opens along `dir`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam<'p> {
    pub(crate) points: &'p [Vec3],
    /// Middle of the points.
    pub(crate) origin: Vec3,
    /// Largest distance of a point to it.
    pub(crate) radius: f32,
    /// To the middle of the disc, unit.
    pub(crate) dir: Vec3,
    /// Tangent of the disc's angular radius.
    pub(crate) slope: f32,
}

impl Beam<'_> {
    fn radius_at(&self, distance: f32) -> f32 {
        // The margin is some rounding errors of the distances that are compared with it.
        let far = distance.max(0.0);
        self.radius + self.slope * far + 1e-6 * (far + self.origin.iter().fold(0.0f32, |m, c| m.max(c.abs())))
    }
}

/// What becomes of a beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Passage {
    /// Every ray passes.
    Free,
    /// No ray passes.
    Blocked,
    /// Its rays must be looked at one by one.
    Parted,
}

/// Most casters that are kept apart for one beam.
const MOST_SUSPECTS: usize = 32;

/// Casters that may stop rays of a beam.
pub(crate) struct Suspects {
    list: [u32; MOST_SUSPECTS],
    /// Above the list's length: there are more than it holds.
    count: usize,
}

impl Suspects {
    pub(crate) const NONE: Suspects = Suspects { list: [0; MOST_SUSPECTS], count: 0 };

    fn add(&mut self, index: u32) {
        if let Some(slot) = self.list.get_mut(self.count) {
            *slot = index;
        }
        self.count = (self.count + 1).min(MOST_SUSPECTS + 1);
    }
}

/// One triangle's bytes.
#[derive(Clone, Copy)]
pub(crate) struct Caster<'a>(&'a [u8]);

impl Caster<'_> {
    pub(crate) fn corners(&self) -> [Vec3; 3] {
        [vec3_at(self.0, 0), vec3_at(self.0, 12), vec3_at(self.0, 24)]
    }

    /// Shading normals at the corners, not quite of unit length.
    pub(crate) fn corner_normals(&self) -> [Vec3; 3] {
        let corner = |k: usize| [0, 2, 4].map(|c| f32::from(u16_at(self.0, 36 + 6 * k + c) as i16) * (1.0 / 32767.0));
        [corner(0), corner(1), corner(2)]
    }

    /// Is the shading normal the same all over?
    pub(crate) fn is_flat(&self) -> bool {
        self.0[36..42] == self.0[42..48] && self.0[36..42] == self.0[48..54]
    }

    /// Share of light that it lets through.
    fn passes(&self) -> f32 {
        1.0 - f32::from(self.0[54]) / 255.0
    }

    /// Moller and Trumbore, *Fast, minimum storage ray-triangle intersection*, 1997; any distance > 0.
    #[inline]
    fn stops(&self, origin: Vec3, dir: Vec3) -> bool {
        let [v0, v1, v2] = self.corners();
        let (e1, e2) = (sub(v1, v0), sub(v2, v0));
        let p = cross(dir, e2);
        let det = dot(e1, p);
        if det == 0.0 {
            return false;
        }
        let inverse = 1.0 / det;
        let s = sub(origin, v0);
        let u = dot(s, p) * inverse;
        let q = cross(s, e1);
        let v = dot(dir, q) * inverse;
        u >= 0.0 && v >= 0.0 && u + v <= 1.0 && dot(e2, q) * inverse > 0.0
    }

    /// How the triangle meets a beam, seen along its axis.
    fn meets(&self, beam: &Beam<'_>) -> Passage {
        let corners = self.corners();
        let [a, b, c] = corners.map(|corner| sub(corner, beam.origin));
        let reach = dot(a, beam.dir).max(dot(b, beam.dir)).max(dot(c, beam.dir));
        if reach < -beam.radius {
            return Passage::Free;
        }
        let radius = beam.radius_at(reach);
        let normal = cross(sub(b, a), sub(c, a));
        let facing = dot(normal, beam.dir);
        let side = 1.0f32.copysign(facing);
        let mut inside = true;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let edge = cross(sub(to, from), beam.dir);
            // Signed area of axis and edge in the plane across the beam; over the edge's length it is the distance.
            let area = side * dot(cross(from, to), beam.dir);
            let room2 = radius * radius * dot(edge, edge);
            if area < 0.0 && area * area > room2 {
                return Passage::Free;
            }
            inside &= area > 0.0 && area * area > room2;
        }
        // With every ray going through the plane one way, points beyond it never meet it.
        if side * facing > 1.1 * beam.slope * length(normal) {
            let before = |point: &Vec3| side * dot(normal, sub(corners[0], *point)) > 0.0;
            if !beam.points.iter().any(before) {
                return Passage::Free;
            }
            if inside && beam.points.iter().all(before) {
                return Passage::Blocked;
            }
        }
        Passage::Parted
    }
}
