//! A coarse zonal set whose cells are cut on where a scene needs it, and the layer that says how, CUTS.
//!
//! The cells of the zonal set of 16 patches (a sky's 16 + 1, or a sphere's 8 + 8) are rectangles in height and azimuth. A cut
//! halves one in height or in azimuth, so that both halves have half its solid angle exactly. What is left whole is a patch.
//! A rectangle wider than a quarter turn is cut in azimuth only: no patch is a ring around the pole.
//!
//! ```text
//! CUTS   0 u16 upper cells of the zonal set   2 u16 lower ones   4 u16 number of patches   6 reserved, 0
//!   from byte 8: per rectangle two bits, the lowest of a byte first: 0 a patch, 1 cut in height, 2 cut in azimuth. After
//!   a cut come its two halves with all that is in them, the one nearer the horizon, or of the smaller azimuth, first;
//!   cell after cell. Bits that are left over are 0.
//! ```

use super::zonal::{Cell, Hemisphere};
use super::{MAX_PATCHES, fnv};
use crate::header::u16_at;
use core::f64::consts::{FRAC_PI_2, TAU};

/// Most cuts on the way from a cell to a patch, in height and in azimuth each.
pub const MAX_CUTS: u8 = 7;
/// Length of the layer's head, bytes.
const HEAD: usize = 8;
/// Longest layer, bytes: as many patches as can be, and a cut less.
const LAYER: usize = HEAD + (2 * MAX_PATCHES - 1).div_ceil(4);
/// Cells that are cut on: both zonal sets have less than this.
const ROOTS: usize = 17;

/// What becomes of a rectangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// It is a patch.
    Patch,
    /// It is halved in height.
    Height,
    /// It is halved in azimuth.
    Azimuth,
}

/// Why cuts make no set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutError {
    /// More patches than [`MAX_PATCHES`].
    Count,
    /// The cut, counted from 0, of a rectangle that may not be cut in this way.
    Cut(usize),
    /// The cuts end before the last patch, or go on after it.
    Length,
}

/// A rectangle of a zonal cell: which of the `2^cuts` equal parts it is, in height and in azimuth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Part {
    root: u8,
    at: [u8; 2],
    cuts: [u8; 2],
}

/// Zonal cells cut on; see the module's text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subdivided {
    upper_cells: Hemisphere,
    lower_cells: Hemisphere,
    parts: [Part; MAX_PATCHES],
    count: usize,
    /// Patches before each zonal cell, and after the last.
    first: [u16; ROOTS + 1],
    layer: [u8; LAYER],
    layer_len: usize,
}

impl Subdivided {
    /// The zonal set that is cut on: of a sky, or of light from all around.
    const fn cells(is_sphere: bool) -> [usize; 2] {
        if is_sphere { [8, 8] } else { [16, 1] }
    }

    /// Number of zonal cells that are cut on.
    pub const fn roots(is_sphere: bool) -> usize {
        let [upper, lower] = Self::cells(is_sphere);
        upper + lower
    }

    /// A set from its cuts, in the order of the layer.
    ///
    /// # Errors
    /// [`CutError`]: there is no such set.
    pub fn new(is_sphere: bool, cuts: impl IntoIterator<Item = Cut>) -> Result<Self, CutError> {
        let mut set = Self::uncut(is_sphere);
        set.count = 0;
        let (mut cuts, mut number) = (cuts.into_iter(), 0);
        for root in 0..Self::roots(is_sphere) {
            set.first[root] = set.count as u16;
            set.read_root(root as u8, &mut cuts, &mut number)?;
        }
        if cuts.next().is_some() {
            return Err(CutError::Length);
        }
        set.seal(number);
        Ok(set)
    }

    /// The zonal set itself.
    pub fn uncut(is_sphere: bool) -> Self {
        let ([upper, lower], roots) = (Self::cells(is_sphere), Self::roots(is_sphere));
        let mut set = Subdivided {
            upper_cells: Hemisphere::new(upper),
            lower_cells: Hemisphere::new(lower),
            parts: [Part::default(); MAX_PATCHES],
            count: roots,
            first: core::array::from_fn(|root| root as u16),
            layer: [0; LAYER],
            layer_len: HEAD,
        };
        (0..roots).for_each(|root| set.parts[root].root = root as u8);
        set.seal(roots);
        set
    }

    /// Puts the counts where they belong once all of `number` rectangles are known.
    fn seal(&mut self, number: usize) {
        let (upper, lower) = (self.upper_cells.cells, self.lower_cells.cells);
        self.first[upper + lower..].fill(self.count as u16);
        for (at, value) in [upper, lower, self.count].into_iter().enumerate() {
            self.layer[2 * at..2 * at + 2].copy_from_slice(&(value as u16).to_le_bytes());
        }
        self.layer_len = HEAD + number.div_ceil(4);
    }

    fn read_root(
        &mut self,
        root: u8,
        cuts: &mut impl Iterator<Item = Cut>,
        number: &mut usize,
    ) -> Result<(), CutError> {
        // Each cut leaves one half for later.
        let mut waiting = [Part::default(); 2 * MAX_CUTS as usize + 1];
        waiting[0].root = root;
        let mut left = 1;
        while left > 0 {
            left -= 1;
            let part = waiting[left];
            let cut = cuts.next().ok_or(CutError::Length)?;
            if *number >= 2 * MAX_PATCHES - 1 {
                return Err(CutError::Count);
            }
            self.layer[HEAD + *number / 4] |= (cut as u8) << (2 * (*number % 4));
            if cut == Cut::Patch {
                *self.parts.get_mut(self.count).ok_or(CutError::Count)? = part;
                self.count += 1;
            } else {
                let axis = usize::from(cut == Cut::Azimuth);
                if part.cuts[axis] >= MAX_CUTS || (axis == 0 && !self.may_cut_height(root.into(), part.cuts[1])) {
                    return Err(CutError::Cut(*number));
                }
                let mut half = part;
                half.cuts[axis] += 1;
                half.at[axis] = 2 * part.at[axis] + 1;
                waiting[left] = half;
                half.at[axis] -= 1;
                waiting[left + 1] = half;
                left += 2;
            }
            *number += 1;
        }
        Ok(())
    }

    /// May a rectangle of zonal cell `root` that came of so many cuts in azimuth be cut in height?
    pub fn may_cut_height(&self, root: usize, azimuth_cuts: u8) -> bool {
        let (hemisphere, cell, _) = self.root(root);
        hemisphere.cell(cell).span / f64::from(1u32 << azimuth_cuts) <= FRAC_PI_2 * (1.0 + 1e-9)
    }

    /// Hemisphere of a zonal cell, its number there, and 1 above the horizon or -1 below.
    fn root(&self, root: usize) -> (&Hemisphere, usize, f64) {
        match root.checked_sub(self.upper_cells.cells) {
            None => (&self.upper_cells, root, 1.0),
            Some(cell) => (&self.lower_cells, cell, -1.0),
        }
    }

    /// Which zonal cells are each other turned about the vertical: cells with the same number.
    pub fn ring_of_root(&self, root: usize) -> usize {
        let (hemisphere, cell, sign) = self.root(root);
        2 * hemisphere.ring_of(cell) + usize::from(sign < 0.0)
    }

    /// The patches of a zonal cell.
    pub fn patches_of_root(&self, root: usize) -> core::ops::Range<usize> {
        usize::from(self.first[root])..usize::from(self.first[root + 1])
    }

    /// The set of a CUTS layer.
    pub fn decode(layer: &[u8]) -> Option<Self> {
        let (head, codes) = layer.split_at_checked(HEAD)?;
        let cells = [u16_at(head, 0), u16_at(head, 2)].map(usize::from);
        let is_sphere = *[false, true].iter().find(|&&is_sphere| Self::cells(is_sphere) == cells)?;
        let nodes = (2 * usize::from(u16_at(head, 4))).checked_sub(Self::roots(is_sphere))?;
        if nodes.div_ceil(4) != codes.len() {
            return None;
        }
        // A code that there is not ends the row of cuts, which is then too short.
        let cut = |node: usize| match (codes[node / 4] >> (2 * (node % 4))) & 3 {
            0 => Some(Cut::Patch),
            1 => Some(Cut::Height),
            2 => Some(Cut::Azimuth),
            _ => None,
        };
        let set = Self::new(is_sphere, (0..nodes).map_while(cut)).ok()?;
        (set.layer() == layer).then_some(set)
    }

    /// Its CUTS layer.
    pub fn layer(&self) -> &[u8] {
        &self.layer[..self.layer_len]
    }

    /// Number of patches.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.count
    }

    pub(super) fn upper(&self) -> usize {
        usize::from(self.first[self.upper_cells.cells])
    }

    /// Does its light come from all around?
    pub fn is_sphere(&self) -> bool {
        self.lower_cells.cells > 1
    }

    /// FNV-1a over `"cuts-1"` and the layer.
    pub(super) fn id(&self) -> u32 {
        fnv(b"cuts-1".iter().chain(self.layer()).copied())
    }

    pub(super) fn solid_angle_sr(&self, patch: usize) -> f32 {
        let part = &self.parts[..self.count][patch];
        let cells = self.root(part.root.into()).0.cells;
        let parts = 1u32 << (part.cuts[0] + part.cuts[1]);
        (TAU / cells as f64 / f64::from(parts)) as f32
    }

    /// A patch as a rectangle, and 1 above the horizon or -1 below.
    pub(super) fn cell(&self, patch: usize) -> (Cell, f64) {
        let part = &self.parts[..self.count][patch];
        let (hemisphere, cell, sign) = self.root(part.root.into());
        let whole = hemisphere.cell(cell);
        let edge = |axis: usize, step: u8| f64::from(part.at[axis] + step) / f64::from(1u32 << part.cuts[axis]);
        let height = |share: f64| whole.y_low + (whole.y_high - whole.y_low) * share;
        let cell = Cell {
            y_low: height(edge(0, 0)),
            y_high: height(edge(0, 1)),
            azimuth: whole.azimuth + whole.span * edge(1, 0),
            span: whole.span * (edge(1, 1) - edge(1, 0)),
        };
        (cell, sign)
    }

    /// The patch that a height `y` and an azimuth (radians, -pi..=pi) fall in.
    pub(super) fn patch_of(&self, y: f64, azimuth: f64) -> usize {
        let (hemisphere, before) =
            if y >= 0.0 { (&self.upper_cells, 0) } else { (&self.lower_cells, self.upper_cells.cells) };
        let (cell, place) = hemisphere.place_of(y.abs(), azimuth);
        // In whole numbers every place is in exactly one part.
        let finest = 1u8 << MAX_CUTS;
        let place = place.map(|share| ((share * f64::from(finest)) as u8).min(finest - 1));
        let holds = |part: &Part| (0..2).all(|axis| place[axis] >> (MAX_CUTS - part.cuts[axis]) == part.at[axis]);
        let patches = self.patches_of_root(before + cell);
        let last = patches.end - 1;
        self.parts[patches.clone()].iter().position(holds).map_or(last, |at| patches.start + at)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::patches::PatchSet;
    use std::vec;
    use std::vec::Vec;

    /// Cuts by chance, `most` patches or a few more.
    fn random_cuts(is_sphere: bool, most: usize, seed: u32) -> Vec<Cut> {
        let mut state = seed;
        let mut next = move || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 16) % 1000
        };
        let set = Subdivided::uncut(is_sphere);
        let (mut cuts, mut patches) = (vec![], Subdivided::roots(is_sphere));
        for root in 0..Subdivided::roots(is_sphere) {
            let mut waiting = vec![[0u8; 2]];
            while let Some(done) = waiting.pop() {
                let axis = (next() % 2) as usize;
                let may = done[axis] < MAX_CUTS && (axis == 1 || set.may_cut_height(root, done[1]));
                if !may || patches >= most || next() < 200 {
                    cuts.push(Cut::Patch);
                    continue;
                }
                cuts.push(if axis == 0 { Cut::Height } else { Cut::Azimuth });
                let mut half = done;
                half[axis] += 1;
                waiting.extend([half; 2]);
                patches += 1;
            }
        }
        cuts
    }

    fn random(is_sphere: bool, most: usize, seed: u32) -> PatchSet {
        PatchSet::of_subdivided(Subdivided::new(is_sphere, random_cuts(is_sphere, most, seed)).unwrap())
    }

    /// By bounds in floating point, without the tree: a direction is in the only patch whose rectangle holds it.
    #[test]
    fn every_direction_is_in_exactly_one_patch() {
        for (is_sphere, seed) in [(false, 1), (true, 2), (false, 3)] {
            let set = random(is_sphere, 700, seed);
            let total: f64 = (0..set.len()).map(|patch| f64::from(set.solid_angle_sr(patch))).sum();
            assert!((total - 2.0 * TAU).abs() < 1e-5, "{total}");
            let upper: f64 = (0..set.upper()).map(|patch| f64::from(set.solid_angle_sr(patch))).sum();
            assert!((upper - TAU).abs() < 1e-5, "{upper}");
            let cells = set.subdivided().unwrap();
            let mut hits = vec![0u32; set.len()];
            for k in 0..10_000 {
                let y = 1.0 - (2.0 * f64::from(k) + 1.0) / 10_000.0;
                let azimuth = (f64::from(k) * 2.399_963_229_728_653) % TAU;
                let radius = libm::sqrt(1.0 - y * y);
                let dir = [radius * libm::cos(azimuth), y, radius * libm::sin(azimuth)].map(|c| c as f32);
                let holding: Vec<usize> = (0..set.len())
                    .filter(|&patch| {
                        let (cell, sign) = cells.cell(patch);
                        let height = sign * y;
                        let across = (azimuth - cell.azimuth).rem_euclid(TAU);
                        (height >= 0.0) && (cell.y_low..cell.y_high).contains(&height) && across < cell.span
                    })
                    .collect();
                let found = set.patch_of(dir);
                hits[found] += 1;
                // Single precision may put a direction over the border next to it.
                let again = set.patch_of(set.sample(found, [0.5, 0.5]));
                assert!(holding.len() == 1 && again == found, "{k} {holding:?}");
                let (cell, _) = cells.cell(found);
                let near = (y.abs() - cell.y_low) > -1e-6 && (y.abs() - cell.y_high) < 1e-6;
                assert!(holding[0] == found || near, "{k} {holding:?} {found}");
            }
            for (patch, &count) in hits.iter().enumerate() {
                let expected = f64::from(set.solid_angle_sr(patch)) / (2.0 * TAU) * 10_000.0;
                let slack = 4.0 + 3.0 * libm::sqrt(expected);
                assert!((f64::from(count) - expected).abs() < slack, "{patch}: {count} of {expected}");
            }
        }
    }

    #[test]
    fn samples_fall_into_their_patch_and_centroids_are_their_mean() {
        for (is_sphere, most, seed) in [(false, 60, 4), (true, 300, 5), (false, 1000, 6)] {
            let set = random(is_sphere, most, seed);
            assert_eq!(set.horizon().is_none(), is_sphere);
            for patch in 0..set.len() {
                for u in [[0.02, 0.02], [0.5, 0.5], [0.98, 0.98], [0.2, 0.8]] {
                    assert_eq!(set.patch_of(set.sample(patch, u)), patch, "{patch} {u:?}");
                }
                let mut mean = [0.0f32; 3];
                for k in 0..256 {
                    let dir = set.sample(patch, [(k / 16) as f32 + 0.5, (k % 16) as f32 + 0.5].map(|u| u / 16.0));
                    mean = core::array::from_fn(|c| mean[c] + dir[c]);
                }
                let length = mean.iter().map(|c| c * c).sum::<f32>().sqrt();
                let off = mean.iter().zip(set.dir_world(patch)).map(|(m, d)| (m / length - d).abs());
                assert!(off.fold(0.0, f32::max) < 2e-3, "{patch} {mean:?} {:?}", set.dir_world(patch));
            }
        }
    }

    /// Without any cut the patches are those of the zonal set.
    #[test]
    fn no_cuts_leave_the_zonal_set() {
        for (is_sphere, zonal) in [(false, PatchSet::new(16)), (true, PatchSet::sphere(16))] {
            let zonal = zonal.unwrap();
            let cuts = vec![Cut::Patch; Subdivided::roots(is_sphere)];
            assert_eq!(Subdivided::new(is_sphere, cuts), Ok(Subdivided::uncut(is_sphere)));
            let set = PatchSet::of_subdivided(Subdivided::uncut(is_sphere));
            assert_eq!((set.len(), set.upper(), set.horizon()), (zonal.len(), zonal.upper(), zonal.horizon()));
            for patch in 0..set.len() {
                assert_eq!(set.sample(patch, [0.3, 0.7]), zonal.sample(patch, [0.3, 0.7]));
                assert_eq!(set.dir_world(patch), zonal.dir_world(patch));
            }
            assert_ne!(set.id(), zonal.id());
        }
    }

    #[test]
    fn the_layer_brings_back_the_set() {
        for (is_sphere, most) in [(false, 17), (false, 1088), (true, 333)] {
            let set = Subdivided::new(is_sphere, random_cuts(is_sphere, most, 7)).unwrap();
            assert_eq!(Subdivided::decode(set.layer()), Some(set));
            for at in 0..set.layer().len() {
                let mut bent = set.layer().to_vec();
                bent[at] ^= 0x41;
                assert_ne!(Subdivided::decode(&bent), Some(set), "{at}");
            }
            assert_eq!(Subdivided::decode(&set.layer()[..set.layer().len() - 1]), None);
            assert_eq!(Subdivided::decode(&set.layer()[..5]), None);
        }
    }

    #[test]
    fn what_is_no_set_is_refused() {
        let whole = [Cut::Patch; 17];
        assert_eq!(Subdivided::new(false, whole[1..].iter().copied()), Err(CutError::Length));
        assert_eq!(Subdivided::new(true, whole), Err(CutError::Length));
        // The cap at the zenith is cut in azimuth first.
        assert_eq!(Subdivided::new(false, [Cut::Height]), Err(CutError::Cut(0)));
        let deep = [Cut::Azimuth; MAX_CUTS as usize + 1];
        assert_eq!(Subdivided::new(false, deep), Err(CutError::Cut(7)));
        // Every cell into 2^7: too many.
        let each = |levels: u32| {
            let mut cuts = vec![];
            fn all(levels: u32, cuts: &mut Vec<Cut>) {
                if levels == 0 {
                    cuts.push(Cut::Patch);
                } else {
                    cuts.push(Cut::Azimuth);
                    all(levels - 1, cuts);
                    all(levels - 1, cuts);
                }
            }
            (0..17).for_each(|_| all(levels, &mut cuts));
            Subdivided::new(false, cuts)
        };
        assert_eq!(each(6).map(|set| set.len()), Ok(17 * 64));
        assert_eq!(each(7), Err(CutError::Count));
    }
}
