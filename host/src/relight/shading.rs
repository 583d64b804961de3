//! What is behind a picture: the view, and what the virtual geometry's shadows and reflected light make of it, tile by tile.

use super::View;
use relume_firmware::composite::TileShade;
use relume_firmware::shade::{FACTOR_ONE, log_factor};
use relume_firmware::tile::TILE_PIXELS;

/// Factors of the view's linear light, with a version per tile, so that only tiles whose factors have changed are composited
/// again.
#[derive(Clone, Debug)]
pub struct Shading {
    /// Logarithms of factors ([`relume_firmware::shade`]), of the tiles that have their own, `[channel][place]`.
    log_factors: Vec<[[u16; TILE_PIXELS]; 3]>,
    /// `[tile]`: where in `log_factors` its own are.
    slots: Vec<Option<u32>>,
    /// `[tile]`: when they changed last.
    versions: Vec<u64>,
    /// What everything else is multiplied by.
    rest: [f32; 3],
    log_rest: Box<[[u16; TILE_PIXELS]; 3]>,
    /// Counts changes of any factor.
    version: u64,
}

impl Shading {
    /// Of a picture whose tiles `has_own` are shaded on their own; all factors are 1.
    pub(super) fn new(has_own: impl Iterator<Item = bool>) -> Self {
        let mut count = 0;
        let mut slot = |own: bool| {
            count += u32::from(own);
            own.then(|| count - 1)
        };
        let slots: Vec<Option<u32>> = has_own.map(&mut slot).collect();
        let ones = [[FACTOR_ONE; TILE_PIXELS]; 3];
        let (log_factors, versions) = (vec![ones; count as usize], vec![1; slots.len()]);
        Shading { log_factors, slots, versions, rest: [1.0; 3], log_rest: Box::new(ones), version: 1 }
    }

    /// The logarithms of a tile's own factors, to be changed.
    pub(super) fn change(&mut self, tile: usize) -> Option<&mut [[u16; TILE_PIXELS]; 3]> {
        let slot = self.slots[tile]? as usize;
        self.version += 1;
        self.versions[tile] = self.version;
        Some(&mut self.log_factors[slot])
    }

    /// What everything is multiplied by that is no receiver; the factors of receivers are to be changed, too.
    pub(super) fn set_rest(&mut self, rest: [f32; 3]) {
        self.rest = rest;
        *self.log_rest = rest.map(|factor| [log_factor(factor); TILE_PIXELS]);
        self.version += 1;
        self.versions.fill(self.version);
    }

    /// What everything is multiplied by that is no receiver, per channel.
    pub fn rest(&self) -> [f32; 3] {
        self.rest
    }

    /// Tells the factors of all tiles at one time from those at another.
    pub fn version(&self) -> u64 {
        self.version
    }

    fn version_of(&self, tile: usize) -> u64 {
        self.versions[tile]
    }

    /// A tile's factors; `None` where they are 1.
    fn of(&self, tile: usize) -> Option<TileShade<'_>> {
        match self.slots[tile] {
            Some(slot) => Some(self.log_factors[slot as usize].each_ref()),
            None => (self.rest != [1.0; 3]).then(|| self.log_rest.each_ref()),
        }
    }
}

/// What is behind a picture.
#[derive(Clone, Copy)]
pub struct Backdrop<'a> {
    /// The view, of the field's size.
    pub view: &'a View,
    /// What it is multiplied by.
    pub shading: Option<&'a Shading>,
}

impl<'a> Backdrop<'a> {
    /// Tells all of it at one time from another.
    pub(super) fn version(&self) -> BackdropVersion {
        BackdropVersion { view: self.view.identity, shade: self.shading.map_or(0, Shading::version) }
    }

    /// The same of the part that is behind a tile.
    pub(super) fn version_of(&self, tile: usize) -> BackdropVersion {
        BackdropVersion { view: self.view.identity, shade: self.shading.map_or(0, |shading| shading.version_of(tile)) }
    }

    /// What the view behind a tile is multiplied by.
    pub(super) fn shade_of(&self, tile: usize) -> Option<TileShade<'a>> {
        self.shading.and_then(|shading| shading.of(tile))
    }
}

/// Which view, under which factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BackdropVersion {
    view: u64,
    shade: u64,
}

impl BackdropVersion {
    /// Of nothing.
    pub(super) const NONE: BackdropVersion = BackdropVersion { view: 0, shade: 0 };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_one_tile_is_none_of_the_others() {
        let mut shading = Shading::new([true, false, true].into_iter());
        let before = shading.clone();
        shading.change(2).unwrap()[1][7] = 9;
        assert!(shading.change(1).is_none());
        assert_eq!([0, 1].map(|tile| shading.version_of(tile)), [0, 1].map(|tile| before.version_of(tile)));
        assert!(shading.version() != before.version() && shading.version_of(2) != before.version_of(2));
        assert_eq!((shading.of(2).unwrap()[1][7], shading.of(0).unwrap()[1][7]), (9, FACTOR_ONE));
        assert!(shading.of(1).is_none());
        let before = shading.clone();
        shading.set_rest([0.5, 1.0, 1.0]);
        assert!((0..3).all(|tile| shading.version_of(tile) != before.version_of(tile)));
        assert_eq!(shading.of(1).unwrap()[0], &[log_factor(0.5); TILE_PIXELS]);
    }
}
