//! The patch set: the direction cells of the sky basis.
//!
//! The upper hemisphere is cut into `n_upper` cells of equal solid angle by Leopardi's recursive zonal partition
//! (P. Leopardi, *A partition of the unit sphere into regions of equal area and small diameter*, ETNA 25, 2006,
//! section 3), restricted to a hemisphere: one cap at the zenith, then rings of cells whose counts are rounded so that
//! the error carries from ring to ring and every cell keeps exactly the same solid angle. The lower hemisphere is the
//! mirror image of the same construction with `n_lower` cells.
//!
//! Order: upper patches from the zenith down, each ring by rising `atan2(z, x)`; then the lower patches from the nadir up.
//!
//! Cells may be cut on where a scene needs it (subdivided.rs). Pictures that others made stand for directions of their own:
//! such a set lists them (listed.rs).

mod listed;
mod spread;
mod subdivided;
pub(crate) mod vectors;
mod zonal;

use core::f64::consts::TAU;
pub use listed::{DIRECTION_ENTRY, DIRECTIONS_HEAD, ListError, Listed, ListedPatch};
pub use spread::{Share, add_sun, spread};
pub use subdivided::{Cut, CutError, MAX_CUTS, Subdivided};
use zonal::{Cell, Hemisphere};

/// Most patches of the upper hemisphere that a set may have.
pub const MAX_UPPER: usize = 1024;
/// Most patches of both hemispheres together.
pub const MAX_PATCHES: usize = MAX_UPPER + MAX_UPPER / 16;
/// Fewest patches of the upper hemisphere.
pub const MIN_UPPER: usize = 16;

/// Why a patch set could not be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PatchError {
    /// The number of upper patches asked for lies outside [`MIN_UPPER`]`..=`[`MAX_UPPER`].
    UpperCount(usize),
}

impl core::fmt::Display for PatchError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            PatchError::UpperCount(n) => {
                write!(f, "{n} directions asked for; choose a number from {MIN_UPPER} to {MAX_UPPER}")
            }
        }
    }
}

impl core::error::Error for PatchError {}

/// The direction cells of a sky basis; see the module's text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchSet(Cells);

// There is no heap here to put the larger one on, and sets are copied only when something is opened.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
enum Cells {
    Zonal { upper: Hemisphere, lower: Hemisphere },
    Listed(Listed),
    Subdivided(Subdivided),
}

impl PatchSet {
    /// A set of `n_upper` ([`MIN_UPPER`]`..=`[`MAX_UPPER`]) upper patches and one lower patch for every 16 of them.
    ///
    /// # Errors
    /// [`PatchError::UpperCount`] outside that range.
    pub fn new(n_upper: usize) -> Result<Self, PatchError> {
        if !(MIN_UPPER..=MAX_UPPER).contains(&n_upper) {
            return Err(PatchError::UpperCount(n_upper));
        }
        Ok(PatchSet(Cells::Zonal { upper: Hemisphere::new(n_upper), lower: Hemisphere::new(n_upper / 16) }))
    }

    /// A set of `patches` ([`MIN_UPPER`]`..=`[`MAX_UPPER`]) over the whole sphere, for light that comes from below as well:
    /// both halves are cut alike, the upper one has the odd patch.
    ///
    /// # Errors
    /// [`PatchError::UpperCount`] outside that range.
    pub fn sphere(patches: usize) -> Result<Self, PatchError> {
        if !(MIN_UPPER..=MAX_UPPER).contains(&patches) {
            return Err(PatchError::UpperCount(patches));
        }
        let halves = (Hemisphere::new(patches.div_ceil(2)), Hemisphere::new(patches / 2));
        Ok(PatchSet(Cells::Zonal { upper: halves.0, lower: halves.1 }))
    }

    /// The set that has so many patches above the horizon and below it, as a field or a stack counts them.
    ///
    /// # Errors
    /// [`PatchError::UpperCount`]: no set has these counts.
    pub fn of_counts(upper: usize, lower: usize) -> Result<Self, PatchError> {
        if lower > upper / 16 { PatchSet::sphere(upper + lower) } else { PatchSet::new(upper) }
    }

    /// A set of listed directions.
    pub const fn of_list(list: Listed) -> Self {
        PatchSet(Cells::Listed(list))
    }

    /// The list, if the set is one.
    pub fn listed(&self) -> Option<&Listed> {
        match &self.0 {
            Cells::Listed(list) => Some(list),
            Cells::Zonal { .. } | Cells::Subdivided(_) => None,
        }
    }

    /// A set of cells cut on.
    pub const fn of_subdivided(cells: Subdivided) -> Self {
        PatchSet(Cells::Subdivided(cells))
    }

    /// The cells cut on, if the set is one of these.
    pub fn subdivided(&self) -> Option<&Subdivided> {
        match &self.0 {
            Cells::Subdivided(cells) => Some(cells),
            Cells::Zonal { .. } | Cells::Listed(_) => None,
        }
    }

    /// Number of patches, both hemispheres.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.upper() + self.lower()
    }

    /// Number of patches above the horizon; they come first.
    pub fn upper(&self) -> usize {
        match &self.0 {
            Cells::Zonal { upper, .. } => upper.cells,
            Cells::Listed(list) => list.upper(),
            Cells::Subdivided(cells) => cells.upper(),
        }
    }

    /// Number of patches below the horizon.
    pub fn lower(&self) -> usize {
        match &self.0 {
            Cells::Zonal { lower, .. } => lower.cells,
            Cells::Listed(list) => list.len() - list.upper(),
            Cells::Subdivided(cells) => cells.len() - cells.upper(),
        }
    }

    /// Identifies construction and counts: FNV-1a over `"leopardi-1"` and the two counts as u16, little-endian; over the layer
    /// of a list or of cells cut on.
    pub fn id(&self) -> u32 {
        match &self.0 {
            Cells::Listed(list) => return list.id(),
            Cells::Subdivided(cells) => return cells.id(),
            Cells::Zonal { .. } => {}
        }
        let counts = [(self.upper() as u16).to_le_bytes(), (self.lower() as u16).to_le_bytes()];
        fnv(b"leopardi-1".iter().chain(counts.iter().flatten()).copied())
    }

    /// Normal of the plane that light comes from one side of only, towards that side: +Y of a sky, none of a sphere, or what a
    /// list says.
    pub fn horizon(&self) -> Option<[f32; 3]> {
        match &self.0 {
            Cells::Zonal { upper, lower } => (lower.cells <= upper.cells / 16).then_some([0.0, 1.0, 0.0]),
            Cells::Listed(list) => list.horizon(),
            Cells::Subdivided(cells) => (!cells.is_sphere()).then_some([0.0, 1.0, 0.0]),
        }
    }

    /// Solid angle of a patch, sr.
    pub fn solid_angle_sr(&self, patch: usize) -> f32 {
        match &self.0 {
            Cells::Zonal { upper, lower } => {
                let cells = if patch < upper.cells { upper.cells } else { lower.cells };
                (TAU / cells as f64) as f32
            }
            Cells::Listed(list) => list.patch(patch).solid_angle_sr,
            Cells::Subdivided(cells) => cells.solid_angle_sr(patch),
        }
    }

    /// Unit direction towards the patch's centroid (normalised mean of its directions), or the listed one.
    pub fn dir_world(&self, patch: usize) -> [f32; 3] {
        match self.cell(patch) {
            Ok((cell, sign)) => cell.centroid(sign),
            Err(list) => list.patch(patch).dir_world,
        }
    }

    /// A direction inside the patch for `u` in the unit square, uniform in solid angle; of a listed patch, inside a cap of
    /// its solid angle around its direction.
    pub fn sample(&self, patch: usize, u: [f32; 2]) -> [f32; 3] {
        match self.cell(patch) {
            Ok((cell, sign)) => cell.sample(sign, u),
            Err(list) => list.patch(patch).sample(u),
        }
    }

    /// A patch's cell, and 1 above the horizon or -1 below; the list if there are no cells.
    fn cell(&self, patch: usize) -> Result<(Cell, f64), &Listed> {
        match &self.0 {
            Cells::Zonal { upper, .. } if patch < upper.cells => Ok((upper.cell(patch), 1.0)),
            Cells::Zonal { upper, lower } => Ok((lower.cell((patch - upper.cells).min(lower.cells - 1)), -1.0)),
            Cells::Subdivided(cells) => Ok(cells.cell(patch)),
            Cells::Listed(list) => Err(list),
        }
    }

    /// The patch that a unit direction falls in; the horizon itself belongs to the upper hemisphere. Of a list, the nearest
    /// one ([`Listed::nearest`]), and the nearest of all behind a horizon that has none.
    pub fn patch_of(&self, dir_world: [f32; 3]) -> usize {
        let [x, y, z] = dir_world.map(f64::from);
        match &self.0 {
            Cells::Zonal { upper, .. } if y >= 0.0 => upper.cell_at(y, libm::atan2(z, x)),
            Cells::Zonal { upper, lower } => upper.cells + lower.cell_at(-y, libm::atan2(z, x)),
            Cells::Subdivided(cells) => cells.patch_of(y, libm::atan2(z, x)),
            Cells::Listed(list) => list.nearest(dir_world).unwrap_or_else(|| list.nearest_of_all(dir_world)),
        }
    }
}

/// FNV-1a, 32 bits.
fn fnv(bytes: impl Iterator<Item = u8>) -> u32 {
    bytes.fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec;

    #[test]
    fn samples_fall_back_into_their_patch() {
        for n in [16, 64, 145, 256, 1000, 1024] {
            let set = PatchSet::new(n).unwrap();
            for patch in 0..set.len() {
                for (u, v) in [(0.01, 0.01), (0.5, 0.5), (0.99, 0.99), (0.2, 0.8)] {
                    assert_eq!(set.patch_of(set.sample(patch, [u, v])), patch, "{n} {patch}");
                }
            }
        }
    }

    #[test]
    fn a_sphere_is_cut_alike_above_and_below() {
        for n in [16, 17, 255, 1024] {
            let set = PatchSet::sphere(n).unwrap();
            assert_eq!((set.len(), set.upper(), set.horizon()), (n, n.div_ceil(2), None));
            assert_eq!(PatchSet::of_counts(set.upper(), set.lower()), Ok(set));
            let total: f32 = (0..n).map(|patch| set.solid_angle_sr(patch)).sum();
            assert!((f64::from(total) - 2.0 * TAU).abs() < 1e-4);
            for patch in 0..n {
                assert_eq!(set.patch_of(set.sample(patch, [0.3, 0.6])), patch, "{n} {patch}");
            }
        }
        for n in [16, 31, 256, 1024] {
            let sky = PatchSet::new(n).unwrap();
            assert_eq!(PatchSet::of_counts(sky.upper(), sky.lower()), Ok(sky));
        }
        assert_eq!(PatchSet::sphere(15), Err(PatchError::UpperCount(15)));
    }

    #[test]
    fn equal_area_by_counting_uniform_directions() {
        let set = PatchSet::new(256).unwrap();
        let mut hits = vec![0u32; set.len()];
        let n = 1_000_000u32;
        // Spiral points: independent of the partition, uniform on the sphere.
        for k in 0..n {
            let y = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(n);
            let azimuth = f64::from(k) * 2.399_963_229_728_653;
            let r = libm::sqrt(1.0 - y * y);
            let (sin, cos) = libm::sincos(azimuth);
            hits[set.patch_of([(r * cos) as f32, y as f32, (r * sin) as f32])] += 1;
        }
        for (patch, &count) in hits.iter().enumerate() {
            let expected = f64::from(set.solid_angle_sr(patch)) / (2.0 * TAU) * f64::from(n);
            assert!((f64::from(count) / expected - 1.0).abs() < 0.05, "{patch}: {count} of {expected}");
        }
        let total: f32 = (0..set.len()).map(|p| set.solid_angle_sr(p)).sum();
        assert!((f64::from(total) - 2.0 * TAU).abs() < 1e-4);
    }

    #[test]
    fn centroids_are_unit_and_inside() {
        let set = PatchSet::new(256).unwrap();
        for patch in 0..set.len() {
            let d = set.dir_world(patch);
            assert!((d.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-5);
            assert_eq!(set.patch_of(d), patch);
        }
    }

    #[test]
    fn cells_are_compact() {
        let set = PatchSet::new(256).unwrap();
        for patch in 0..set.upper() {
            let c = set.dir_world(patch);
            let far = [[0.0, 0.0], [0.0, 0.999], [0.999, 0.0], [0.999, 0.999]].map(|u| {
                let s = set.sample(patch, u);
                (c[0] * s[0] + c[1] * s[1] + c[2] * s[2]).min(1.0).acos().to_degrees()
            });
            assert!(far.iter().all(|&a| a < 9.0), "{patch} {far:?}");
        }
    }

    #[test]
    fn ids_differ_and_counts_are_checked() {
        assert_ne!(PatchSet::new(256).unwrap().id(), PatchSet::new(255).unwrap().id());
        assert_eq!(PatchSet::new(15), Err(PatchError::UpperCount(15)));
        assert_eq!(PatchSet::new(1025), Err(PatchError::UpperCount(1025)));
    }
}
