//! A set of listed directions, and its layer in a field, DIRS.
//!
//! ```text
//! DIRS   0 u32 number of patches   4 f32[3] horizon (unit vector; 0 0 0: light comes from all around)   16 reserved, 0
//!   per patch, from byte 32: f32[3] unit direction towards the light   12 f32 solid angle, sr   16 u32 row in its source
//! ```
//!
//! Patches with y >= 0 come first. Where there is a horizon, a direction before it belongs to the nearest patch before it,
//! one behind it to the nearest behind it, if there is one.

use super::{MAX_PATCHES, fnv};
use crate::header::{f32_at, u32_at, vec3_at};
use core::f64::consts::TAU;

/// Length of the layer's head, bytes.
pub const DIRECTIONS_HEAD: usize = 32;
/// Length of an entry, bytes.
pub const DIRECTION_ENTRY: usize = 20;

/// Patches this little behind the horizon (about a degree) still count as before it.
const HORIZON_SLACK: f32 = 0.02;

/// Why a list of directions is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ListError {
    /// No direction, or more than [`MAX_PATCHES`].
    Count(usize),
    /// A direction that is no unit vector, or a solid angle that is not in (0, 4 pi].
    Patch(usize),
    /// One with y < 0 before one with y >= 0.
    Order(usize),
    /// Rows that are not the numbers from 0 on, each once.
    Row(usize),
}

/// One patch of a list.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ListedPatch {
    /// Unit direction towards the light, world space.
    pub dir_world: [f32; 3],
    /// Solid angle, sr.
    pub solid_angle_sr: f32,
    /// Which one it was in the set that it came from, from 0.
    pub row: u16,
}

impl ListedPatch {
    /// A direction in a cap of the patch's solid angle for `u` in the unit square, uniform in solid angle.
    pub(super) fn sample(&self, u: [f32; 2]) -> [f32; 3] {
        let [x, y, z] = self.dir_world.map(f64::from);
        let along = 1.0 - f64::from(u[0]) * f64::from(self.solid_angle_sr) / TAU;
        let (sin, cos) = libm::sincos(TAU * f64::from(u[1]));
        let aside = libm::sqrt((1.0 - along * along).max(0.0));
        // Duff et al., Building an orthonormal basis, revisited, JCGT 6(1), 2017.
        let sign = if z >= 0.0 { 1.0 } else { -1.0 };
        let a = -1.0 / (sign + z);
        let b = x * y * a;
        let (s, t) = ([1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]);
        core::array::from_fn(|k| (aside * (cos * s[k] + sin * t[k]) + along * [x, y, z][k]) as f32)
    }
}

/// A list of directions; see the module's text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Listed {
    patches: [ListedPatch; MAX_PATCHES],
    count: usize,
    upper: usize,
    horizon: [f32; 3],
}

impl Listed {
    /// A list; `horizon` is a unit vector.
    ///
    /// # Errors
    /// [`ListError`], with the patch at fault.
    pub fn new(patches: &[ListedPatch], horizon: Option<[f32; 3]>) -> Result<Self, ListError> {
        let count = patches.len();
        if !(1..=MAX_PATCHES).contains(&count) {
            return Err(ListError::Count(count));
        }
        let mut list = Listed {
            patches: [ListedPatch::default(); MAX_PATCHES],
            count,
            upper: patches.iter().take_while(|patch| patch.dir_world[1] >= 0.0).count(),
            horizon: horizon.unwrap_or([0.0; 3]),
        };
        list.patches[..count].copy_from_slice(patches);
        let mut seen = [false; MAX_PATCHES];
        for (index, patch) in patches.iter().enumerate() {
            let omega = f64::from(patch.solid_angle_sr);
            if !(is_unit(patch.dir_world) && omega > 0.0 && omega <= 2.0 * TAU * 1.0001) {
                return Err(ListError::Patch(index));
            }
            if index >= list.upper && patch.dir_world[1] >= 0.0 {
                return Err(ListError::Order(index));
            }
            match seen.get_mut(usize::from(patch.row)) {
                Some(seen) if !*seen && usize::from(patch.row) < count => *seen = true,
                _ => return Err(ListError::Row(index)),
            }
        }
        if horizon.is_some_and(|axis| !is_unit(axis)) {
            return Err(ListError::Patch(count));
        }
        Ok(list)
    }

    /// The list of a DIRS layer.
    pub(crate) fn decode(layer: &[u8]) -> Option<Self> {
        let count = u32_at(layer.get(..DIRECTIONS_HEAD)?, 0) as usize;
        let (head, entries) = layer.split_at(DIRECTIONS_HEAD);
        if count > MAX_PATCHES || entries.len() != count * DIRECTION_ENTRY {
            return None;
        }
        let mut patches = [ListedPatch::default(); MAX_PATCHES];
        for (patch, entry) in patches.iter_mut().zip(entries.chunks_exact(DIRECTION_ENTRY)) {
            let row = u16::try_from(u32_at(entry, 16)).ok()?;
            *patch = ListedPatch { dir_world: vec3_at(entry, 0), solid_angle_sr: f32_at(entry, 12), row };
        }
        let horizon = Some(vec3_at(head, 4)).filter(|axis| *axis != [0.0; 3]);
        Listed::new(&patches[..count], horizon).ok()
    }

    /// The head of its DIRS layer.
    pub fn encode_head(&self) -> [u8; DIRECTIONS_HEAD] {
        let mut out = [0; DIRECTIONS_HEAD];
        out[..4].copy_from_slice(&(self.count as u32).to_le_bytes());
        for (k, value) in self.horizon.iter().enumerate() {
            out[4 + 4 * k..8 + 4 * k].copy_from_slice(&value.to_le_bytes());
        }
        out
    }

    /// A patch's entry in the layer.
    pub fn encode_entry(&self, patch: usize) -> [u8; DIRECTION_ENTRY] {
        let ListedPatch { dir_world: [x, y, z], solid_angle_sr, row } = self.patches[patch];
        let mut out = [0; DIRECTION_ENTRY];
        for (k, value) in [x, y, z, solid_angle_sr].iter().enumerate() {
            out[4 * k..4 * k + 4].copy_from_slice(&value.to_le_bytes());
        }
        out[16..].copy_from_slice(&u32::from(row).to_le_bytes());
        out
    }

    /// Number of patches.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.count
    }

    pub(super) fn upper(&self) -> usize {
        self.upper
    }

    /// A patch.
    pub fn patch(&self, patch: usize) -> &ListedPatch {
        &self.patches[..self.count][patch]
    }

    /// The patch that was number `row` of the set it came from.
    pub fn patch_of_row(&self, row: usize) -> Option<usize> {
        self.patches[..self.count].iter().position(|patch| usize::from(patch.row) == row)
    }

    /// Towards the side of its plane that the light comes from, if it comes from one.
    pub fn horizon(&self) -> Option<[f32; 3]> {
        (self.horizon != [0.0; 3]).then_some(self.horizon)
    }

    /// FNV-1a over `"listed-1"` and the layer's bytes.
    pub(super) fn id(&self) -> u32 {
        let entries = (0..self.count).flat_map(|patch| self.encode_entry(patch));
        fnv(b"listed-1".iter().copied().chain(self.encode_head()).chain(entries))
    }

    /// The patch whose direction is nearest among those on the same side of the horizon; `None` where there are none.
    pub fn nearest(&self, dir_world: [f32; 3]) -> Option<usize> {
        let Some(axis) = self.horizon() else { return Some(self.nearest_of_all(dir_world)) };
        let before = dot(axis, dir_world) >= 0.0;
        let same_side = |patch: &ListedPatch| (dot(axis, patch.dir_world) >= -HORIZON_SLACK) == before;
        self.nearest_where(dir_world, same_side)
    }

    pub(super) fn nearest_of_all(&self, dir_world: [f32; 3]) -> usize {
        self.nearest_where(dir_world, |_| true).unwrap_or(0)
    }

    fn nearest_where(&self, dir_world: [f32; 3], counts: impl Fn(&ListedPatch) -> bool) -> Option<usize> {
        let mut best = (f32::NEG_INFINITY, None);
        for (index, patch) in self.patches[..self.count].iter().enumerate() {
            let near = dot(patch.dir_world, dir_world);
            if near > best.0 && counts(patch) {
                best = (near, Some(index));
            }
        }
        best.1
    }
}

pub(super) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Is a patch before the horizon, or as good as on it?
pub(super) fn is_before(axis: [f32; 3], dir_world: [f32; 3]) -> bool {
    dot(axis, dir_world) >= -HORIZON_SLACK
}

fn is_unit(dir: [f32; 3]) -> bool {
    (dot(dir, dir) - 1.0).abs() < 1e-4
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::patches::PatchSet;
    use std::vec::Vec;

    fn patch(dir_world: [f32; 3], row: u16) -> ListedPatch {
        ListedPatch { dir_world, solid_angle_sr: 0.5, row }
    }

    fn list(horizon: Option<[f32; 3]>) -> Listed {
        let dirs = [patch([0.0, 1.0, 0.0], 2), patch([1.0, 0.0, 0.0], 0), patch([0.0, -0.6, 0.8], 1)];
        Listed::new(&dirs, horizon).unwrap()
    }

    #[test]
    fn the_layer_brings_back_the_list() {
        for horizon in [None, Some([0.0, 0.0, 1.0])] {
            let list = list(horizon);
            let mut layer: Vec<u8> = list.encode_head().to_vec();
            (0..list.len()).for_each(|patch| layer.extend(list.encode_entry(patch)));
            assert_eq!(Listed::decode(&layer), Some(list));
            assert_eq!(Listed::decode(&layer[1..]), None);
            layer[DIRECTIONS_HEAD + 3] ^= 0x40;
            assert_eq!(Listed::decode(&layer), None);
        }
        assert_ne!(list(None).id(), list(Some([0.0, 0.0, 1.0])).id());
    }

    #[test]
    fn what_is_no_list_is_refused() {
        let (up, side) = (patch([0.0, 1.0, 0.0], 0), patch([1.0, 0.0, 0.0], 1));
        let down = patch([0.0, -1.0, 0.0], 1);
        assert_eq!(Listed::new(&[], None), Err(ListError::Count(0)));
        assert_eq!(Listed::new(&[up; MAX_PATCHES + 1], None), Err(ListError::Count(MAX_PATCHES + 1)));
        assert_eq!(Listed::new(&[up, patch([1.0, 1.0, 0.0], 1)], None), Err(ListError::Patch(1)));
        assert_eq!(
            Listed::new(&[up, ListedPatch { solid_angle_sr: f32::NAN, ..side }], None),
            Err(ListError::Patch(1))
        );
        assert_eq!(Listed::new(&[down, patch([0.0, 1.0, 0.0], 0)], None), Err(ListError::Order(1)));
        assert_eq!(Listed::new(&[up, patch([1.0, 0.0, 0.0], 0)], None), Err(ListError::Row(1)));
        assert_eq!(Listed::new(&[up, patch([1.0, 0.0, 0.0], 2)], None), Err(ListError::Row(1)));
    }

    #[test]
    fn each_side_of_a_horizon_has_its_own_patches() {
        let around = list(None);
        assert_eq!(around.nearest([0.0, -1.0, 0.0]), Some(2));
        let dome = list(Some([0.0, 0.0, 1.0]));
        assert_eq!((dome.nearest([0.0, -0.6, -0.8]), dome.nearest([0.9, 0.0, 0.436])), (None, Some(1)));
        let ground = list(Some([0.0, 1.0, 0.0]));
        assert_eq!((ground.nearest([0.0, 0.1, 0.995]), ground.nearest([0.995, -0.1, 0.0])), (Some(0), Some(2)));
        assert_eq!(PatchSet::of_list(dome).patch_of([0.0, -0.6, -0.8]), 1);
        assert_eq!(ground.patch_of_row(1), Some(2));
    }

    #[test]
    fn samples_fill_a_cap_of_the_solid_angle() {
        for dir in [[0.0f32, 1.0, 0.0], [0.6, 0.0, -0.8], [0.0, 0.0, -1.0]] {
            let patch = patch(dir, 0);
            let edge = 1.0 - patch.solid_angle_sr / core::f32::consts::TAU;
            for k in 0..16 {
                let near = dot(patch.sample([1.0, k as f32 / 16.0]), dir);
                assert!((near - edge).abs() < 1e-5, "{near} {edge}");
            }
            assert!((dot(patch.sample([0.0, 0.3]), dir) - 1.0).abs() < 1e-6);
        }
    }
}
