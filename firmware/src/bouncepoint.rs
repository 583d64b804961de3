//! A bounce point in 12 bytes: its place on a grid over all points, the normal of its surface and its tint.
//!
//! ```text
//! 96 bits, from the lowest: 3 x 19 place in steps from the grid's origin   2 x 10 normal, octahedral
//!                           3 x 6 tint, 63 sqrt(tint / 3)                  1 reserved, 0
//! ```

use crate::header::{f32_at, vec3_at};
use crate::vector::{Vec3, unit};

/// Length of a bounce point, bytes.
pub const BOUNCE_POINT: usize = 12;
/// Length of the grid before the points, bytes.
pub const POINT_GRID: usize = 16;

/// Bits of a place along one axis.
const PLACE_BITS: u32 = 19;
/// Largest place.
const PLACE_TOP: u32 = (1 << PLACE_BITS) - 1;
/// Largest coordinate of a normal's code; the middle one is even, so that the axes are exact.
const NORMAL_TOP: f32 = 1022.0;
const NORMAL_BITS: u32 = 10;
/// Largest code of a tint's channel, which stands for 3.
const TINT_TOP: f32 = 63.0;
const TINT_BITS: u32 = 6;

/// The grid that places are counted on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointGrid {
    /// World, m.
    pub origin: [f32; 3],
    /// m, at least 0.
    pub step: f32,
}

impl PointGrid {
    /// The finest grid over the box between two corners, world m.
    pub fn over(low: [f32; 3], high: [f32; 3]) -> Self {
        let widest = (0..3).fold(0.0f32, |widest, axis| widest.max(high[axis] - low[axis]));
        PointGrid { origin: low, step: widest / PLACE_TOP as f32 }
    }

    /// The grid of a layer of at least [`POINT_GRID`] bytes; `None` if it is none.
    pub(crate) fn decode(layer: &[u8]) -> Option<Self> {
        let grid = PointGrid { origin: vec3_at(layer, 0), step: f32_at(layer, 12) };
        let far = grid.step * PLACE_TOP as f32;
        let sound = grid.step >= 0.0 && grid.origin.iter().all(|c| (c + far).is_finite());
        sound.then_some(grid)
    }

    /// The grid's bytes.
    pub fn encode(&self) -> [u8; POINT_GRID] {
        let mut bytes = [0; POINT_GRID];
        for (slot, value) in bytes.chunks_exact_mut(4).zip(self.origin.iter().chain([&self.step])) {
            slot.copy_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    /// The bytes of a point: place in world m, unit normal, and tint (the reflectance over its mean over the channels).
    pub fn point(&self, place: [f32; 3], normal: [f32; 3], tint: [f32; 3]) -> [u8; BOUNCE_POINT] {
        let mut bits = Bits { value: 0, at: 0 };
        for (place, origin) in place.iter().zip(self.origin) {
            let steps = if self.step > 0.0 { (place - origin) / self.step } else { 0.0 };
            bits.put((libm::rintf(steps).max(0.0) as u32).min(PLACE_TOP), PLACE_BITS);
        }
        octahedral(normal).into_iter().for_each(|code| bits.put(code, NORMAL_BITS));
        tint_codes(tint).into_iter().for_each(|code| bits.put(code, TINT_BITS));
        let mut bytes = [0; BOUNCE_POINT];
        bytes.copy_from_slice(&bits.value.to_le_bytes()[..BOUNCE_POINT]);
        bytes
    }

    /// The point of [`BOUNCE_POINT`] bytes.
    pub(crate) fn decode_point(&self, point: &[u8; BOUNCE_POINT]) -> BouncePoint {
        let mut bytes = [0; 16];
        bytes[..BOUNCE_POINT].copy_from_slice(point);
        let mut bits = Bits { value: u128::from_le_bytes(bytes), at: 0 };
        let mut place = self.origin;
        place.iter_mut().for_each(|c| *c += bits.take(PLACE_BITS) as f32 * self.step);
        let normal = from_octahedral([bits.take(NORMAL_BITS), bits.take(NORMAL_BITS)]);
        let tint = from_tint_codes([bits.take(TINT_BITS), bits.take(TINT_BITS), bits.take(TINT_BITS)]);
        BouncePoint { place, normal, tint }
    }
}

/// A point where the sun is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BouncePoint {
    /// World, m.
    pub(crate) place: Vec3,
    /// Of unit length.
    pub(crate) normal: Vec3,
    /// Mean 1.
    pub(crate) tint: Vec3,
}

struct Bits {
    value: u128,
    at: u32,
}

impl Bits {
    fn put(&mut self, code: u32, width: u32) {
        self.value |= u128::from(code) << self.at;
        self.at += width;
    }

    fn take(&mut self, width: u32) -> u32 {
        let code = (self.value >> self.at) as u32 & ((1 << width) - 1);
        self.at += width;
        code
    }
}

/// A tint as a point's bytes keep it.
pub fn rounded_tint(tint: [f32; 3]) -> [f32; 3] {
    from_tint_codes(tint_codes(tint))
}

fn tint_codes(tint: Vec3) -> [u32; 3] {
    tint.map(|c| libm::rintf(TINT_TOP * libm::sqrtf((c / 3.0).clamp(0.0, 1.0))) as u32)
}

fn from_tint_codes(codes: [u32; 3]) -> Vec3 {
    let squares = codes.map(|code| (code * code) as f32);
    let mean = (squares[0] + squares[1] + squares[2]) / 3.0;
    if mean > 0.0 { squares.map(|square| square / mean) } else { [1.0; 3] }
}

/// A direction on the unfolded octahedron (Cigolle et al., *A Survey of Efficient Representations for Independent Unit
/// Vectors*, JCGT 2014), two coordinates of 10 bits.
fn octahedral([x, y, z]: Vec3) -> [u32; 2] {
    let sum = x.abs() + y.abs() + z.abs();
    if sum.is_nan() || sum <= 0.0 {
        return octahedral([0.0, 1.0, 0.0]);
    }
    let (u, v) = if z >= 0.0 { (x / sum, y / sum) } else { folded(x / sum, y / sum) };
    let code = |c: f32| libm::rintf((0.5 + 0.5 * c) * NORMAL_TOP) as u32;
    [code(u), code(v)]
}

fn from_octahedral(codes: [u32; 2]) -> Vec3 {
    let [u, v] = codes.map(|code| 2.0 * code as f32 / NORMAL_TOP - 1.0);
    let z = 1.0 - u.abs() - v.abs();
    let (x, y) = if z >= 0.0 { (u, v) } else { folded(u, v) };
    unit([x, y, z])
}

/// The lower half's four faces, folded out.
fn folded(u: f32, v: f32) -> (f32, f32) {
    let sign = |c: f32| if c < 0.0 { -1.0 } else { 1.0 };
    ((1.0 - v.abs()) * sign(u), (1.0 - u.abs()) * sign(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::{dot, length, sub};

    #[test]
    fn points_keep_their_place_and_normal() {
        let grid = PointGrid::over([-30.0, -1.0, 5.0], [70.0, 20.0, 55.0]);
        assert_eq!(PointGrid::decode(&grid.encode()), Some(grid));
        for k in 0..2000u32 {
            let share = |m: u32| (k.wrapping_mul(m) % 1013) as f32 / 1012.0;
            let place = [-30.0 + 100.0 * share(7), -1.0 + 21.0 * share(11), 5.0 + 50.0 * share(13)];
            let normal = unit([share(17) - 0.5, share(19) - 0.5, share(23) - 0.5]);
            let tint = [share(29), share(31), 1.0].map(|c| 3.0 * c / (share(29) + share(31) + 1.0));
            let found = grid.decode_point(&grid.point(place, normal, tint));
            assert!(length(sub(found.place, place)) < 2.0 * grid.step, "{place:?} {found:?}");
            assert!(dot(found.normal, normal) > 0.999_99, "{normal:?} {found:?}");
            assert!((0..3).all(|c| (found.tint[c] - tint[c]).abs() < 0.06), "{tint:?} {found:?}");
            assert_eq!(found.tint, rounded_tint(tint));
        }
    }

    #[test]
    fn axes_are_exact_and_a_normal_without_length_is_up() {
        let grid = PointGrid { origin: [0.0; 3], step: 0.0 };
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                let point = BouncePoint { place: [0.0; 3], normal, tint: [1.0; 3] };
                assert_eq!(grid.decode_point(&grid.point([1.0; 3], normal, [0.7; 3])), point);
            }
        }
        let point = grid.decode_point(&grid.point([0.0; 3], [0.0; 3], [0.0; 3]));
        assert_eq!((point.normal, point.tint), ([0.0, 1.0, 0.0], [1.0; 3]));
    }

    #[test]
    fn grids_that_are_not_finite_are_refused() {
        for bad in [f32::NAN, f32::INFINITY, -1.0, 1e34] {
            assert_eq!(PointGrid::decode(&PointGrid { origin: [0.0; 3], step: bad }.encode()), None);
        }
        assert_eq!(PointGrid::decode(&PointGrid { origin: [f32::NAN, 0.0, 0.0], step: 1.0 }.encode()), None);
    }
}
