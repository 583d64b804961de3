//! What a tile shows, whether that may stay, and how right it is.

use crate::block_state::Projected;
use crate::frame::{Target, ViewIdentity};
use relume_firmware::bound::CodeSlope;
use relume_firmware::coefficients::TileReach;
use relume_firmware::drawn::{Dimmest, DrawnTile, HALF_CODE, Off, ShownLight, SunDrift, dark_shares};
use relume_firmware::field::Field;
use relume_firmware::tile::{TILE_PIXELS, Tile};
use relume_firmware::weights::FixedWeights;

/// The light of a frame beside the blocks' coefficients.
#[derive(Clone, Copy)]
pub struct FrameLight<'a> {
    /// The light's number.
    pub number: u64,
    /// The level of the way back that it is taken from.
    pub level: usize,
    /// The sun's weight; 0: no sun.
    pub sun_q16: [u32; 3],
    /// Patches apart: shown by their own rows.
    pub weights: &'a FixedWeights,
    /// Turns bounds on light into bounds on codes.
    pub slope: &'a CodeSlope,
}

impl<'a> FrameLight<'a> {
    fn on(&self, projected: &'a Projected) -> ShownLight<'a> {
        ShownLight {
            coefficients: &projected.coefficients,
            weights: self.weights,
            unpacked: &[],
            sun_q16: self.sun_q16,
        }
    }
}

/// Where and over which view a tile was last drawn.
type Place = (Target, ViewIdentity);

/// One tile's state from frame to frame.
pub struct TileState {
    /// Valid where `place` is known.
    drawn: DrawnTile,
    place: Option<Place>,
    /// Number of the light that the tile was last found to show, or near enough; 0: none.
    judged_light: u64,
    /// The level that it was drawn from.
    level: usize,
    /// Number of the sun's direction that the tile's plane was traced for; 0: none.
    pub traced_sun: u64,
    sun: SunDrift,
    dark_shares: [f32; 3],
    /// Bounds on what is shown now: linear, and codes with rounding.
    pub shown_bound: (f32, f32),
    /// Does the view show through anywhere?
    shows_view: bool,
    /// Has the tile no geometry?
    pub empty: bool,
}

impl TileState {
    /// A tile that was never drawn.
    pub fn new(tile: &Tile<'_>) -> Self {
        TileState {
            drawn: DrawnTile::NOTHING,
            place: None,
            judged_light: 0,
            level: 0,
            traced_sun: 0,
            sun: SunDrift::default(),
            dark_shares: dark_shares(tile),
            shown_bound: (0.0, 0.0),
            shows_view: tile.pixels() < TILE_PIXELS || tile.coverage.is_some(),
            empty: tile.pixels() == 0,
        }
    }

    /// Forgets what was drawn.
    pub fn forget(&mut self) {
        self.place = None;
    }

    /// Takes a new response to the sun of direction number `sun` over the old one.
    pub fn take_sun(&mut self, sun: u64, slot: &mut [u16], fresh: &[u16]) {
        let (mut largest, mut peak) = (0, 0);
        for (old, &new) in slot.iter_mut().zip(fresh) {
            largest = largest.max(old.abs_diff(new));
            peak = peak.max(*old).max(new);
            *old = new;
        }
        self.sun.retraced(u32::from(largest), u32::from(peak));
        self.traced_sun = sun;
        self.judged_light = 0;
    }

    /// Was the tile drawn here and over this view?
    pub fn in_place(&self, target: Target, view: ViewIdentity) -> bool {
        self.place.is_some_and(|(at, over)| at == target && (!self.shows_view || over == view))
    }

    /// Does the tile show light number `light` from this level already?
    pub fn shows_light(&self, light: u64, level: usize) -> bool {
        self.empty || (self.judged_light == light && self.level == level)
    }

    /// Would the tile change by less than half a code? Remembers it if so, and how right the tile still is.
    pub fn may_stay(&mut self, tile: (&Field<'_>, &Tile<'_>), projected: &Projected, light: FrameLight<'_>) -> bool {
        // With as many patches apart as on higher levels only the same light can be compared.
        if self.place.is_none() || self.level > 0 || light.level > 0 {
            return false;
        }
        // No room for a table of reaches: the worst that a tile can have.
        let shown = light.on(projected);
        let error = Off::of(tile, &shown, (&projected.coefficients, &projected.bound));
        let moved = self.drawn.moved(tile, &shown, (&TileReach(&[]), &self.sun), &error);
        if self.drawn.dimmest().codes(light.slope, &self.dark_shares, &moved) >= HALF_CODE {
            return false;
        }
        self.note_bound(light, error.and_moved(&moved));
        self.judged_light = light.number;
        true
    }

    /// Notes that the tile was drawn.
    pub fn note_drawn(
        &mut self,
        tile: (&Field<'_>, &Tile<'_>),
        projected: &Projected,
        (light, dimmest): (FrameLight<'_>, Dimmest),
        place: Place,
    ) {
        self.drawn.set(&light.on(projected), dimmest);
        self.place = Some(place);
        (self.judged_light, self.level) = (light.number, light.level);
        self.sun.reset();
        let exact = (&projected.coefficients, &projected.bound);
        self.note_bound(light, Off::of(tile, &light.on(projected), exact));
    }

    /// `error`: how far what is shown may be from what is meant.
    fn note_bound(&mut self, light: FrameLight<'_>, error: Off) {
        self.shown_bound = (error.linear(), self.drawn.dimmest().codes_rounded(light.slope, &self.dark_shares, &error));
    }
}
