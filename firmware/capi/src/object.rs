//! The relighting of one field: light in, tiles out. Pointers are `memory`'s business.

use crate::block_state::{BandBlocks, Projected};
use crate::damage::Damage;
use crate::frame::Frame;
use crate::level::Levels;
use crate::tile_state::{FrameLight, TileState};
use crate::types::{RelumeError, RelumeRect};
use relume_firmware::bounce::{Rgb, mean_up};
use relume_firmware::bound::CodeSlope;
use relume_firmware::drawn::Dimmest;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::levels::{is_error_budget, may_be_lower};
use relume_firmware::relight::{LinearTile, TileLight};
use relume_firmware::sunlight::SunLight;
use relume_firmware::tile::{BLOCK_TILES, MAX_RANK, TILE_PIXELS, TILE_PX};
use relume_firmware::tone::ViewLight;
use relume_firmware::weights::SunWeight;

/// What all bands of a picture share; only [`Relighting::set_light`] changes it.
pub struct Relighting {
    field: Field<'static>,
    kernel: Kernel,
    view_light: ViewLight,
    levels: Levels,
    /// Largest error allowed, codes; `None`: what it comes to.
    error_budget: Option<f32>,
    slope: CodeSlope,
    /// Counts lights, from 1.
    light: u64,
    /// The newest direction of a sun that was up.
    sun_dir_world: Option<[f32; 3]>,
    /// What traces it.
    sun_light: Option<SunLight>,
    /// Its light on the bounce points, in the upper half, and the means up their tree.
    means: &'static mut [Rgb],
    /// Counts its changes, from 1.
    sun_number: u64,
    sun_is_up: bool,
}

/// Tiles of a call by what became of them, and how right they are.
#[derive(Clone, Copy, Default)]
pub struct Tally {
    /// Written, with geometry.
    pub drawn: u32,
    /// Left as they were, with geometry.
    pub kept: u32,
    /// Without geometry.
    pub empty: u32,
    /// With geometry, and sunlight of an earlier direction.
    pub sun_stale: u32,
    /// Bounds on the error of what is shown: linear, and codes.
    pub bound: (f32, f32),
}

impl Tally {
    /// Both together.
    pub fn plus(self, other: Tally) -> Tally {
        Tally {
            drawn: self.drawn + other.drawn,
            kept: self.kept + other.kept,
            empty: self.empty + other.empty,
            sun_stale: self.sun_stale + other.sun_stale,
            bound: (self.bound.0.max(other.bound.0), self.bound.1.max(other.bound.1)),
        }
    }
}

impl Relighting {
    /// In the dark, on this machine's fastest kernel. The large parts, both of this field and without light, lie elsewhere:
    /// weights would fill a small stack on their way, and how many `means` there are is the field's affair (two for each
    /// bounce point).
    pub fn new(field: Field<'static>, levels: Levels, means: &'static mut [Rgb]) -> Self {
        Relighting {
            field,
            kernel: Kernel::detect(),
            view_light: ViewLight::new(),
            levels,
            error_budget: None,
            slope: CodeSlope::new(),
            light: 1,
            sun_dir_world: None,
            sun_light: None,
            means,
            sun_number: 0,
            sun_is_up: false,
        }
    }

    /// The field.
    pub fn field(&self) -> &Field<'static> {
        &self.field
    }

    /// The instructions in use.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// Uses others from now on.
    pub fn set_kernel(&mut self, kernel: Kernel) {
        self.kernel = kernel;
    }

    /// Patches without light.
    pub fn patches_dark(&self) -> usize {
        self.levels.get(0).weights.dark_patches()
    }

    /// Patches shown by their own rows.
    pub fn patches_apart(&self) -> usize {
        self.levels.get(0).weights.apart().count()
    }

    /// A call's bound; NaN where the field has none.
    pub fn known_bound(&self, tally: Tally) -> (f32, f32) {
        if self.field.bounds().is_some() { tally.bound } else { (f32::NAN, f32::NAN) }
    }

    /// Allows so much error in codes; `None`: whatever it comes to.
    ///
    /// # Errors
    /// If no frame can keep to it.
    pub fn set_error_budget(&mut self, codes: Option<f32>) -> Result<(), RelumeError> {
        if codes.is_some_and(|codes| !is_error_budget(codes) || self.field.bounds().is_none()) {
            return Err(RelumeError::Budget);
        }
        self.error_budget = codes;
        Ok(())
    }

    /// May a block on this level, whose tiles are these, try one level less?
    pub fn may_be_lower<'a>(&self, level: usize, mut tiles: impl Iterator<Item = &'a TileState>) -> bool {
        let Some(codes) = self.error_budget else { return false };
        level > 0 && tiles.all(|tile| tile.empty || may_be_lower(tile.shown_bound.1, codes))
    }

    /// Is a block on this level, whose tiles are these, further off than it may be, and does the field have more?
    pub fn must_be_higher<'a>(&self, level: usize, mut tiles: impl Iterator<Item = &'a TileState>) -> bool {
        let Some(codes) = self.error_budget else { return false };
        level < self.levels.top() && tiles.any(|tile| !tile.empty && tile.shown_bound.1 > codes)
    }

    /// Makes a level ready for the newest light.
    pub fn prepare(&mut self, level: usize) {
        self.levels.prepare(&self.field, level, self.kernel);
    }

    /// Takes the light of a moment. A sun at or below the horizon, or without irradiance, is none. `false`: it is the same
    /// as before.
    ///
    /// # Errors
    /// What is wrong with it; nothing has changed then.
    pub fn set_light(&mut self, radiance: &[[f32; 3]], sun: SunWeight, exposure: f32) -> Result<bool, RelumeError> {
        // Whatever is not nothing goes to the weights, which refuse what is no sun.
        let sun = Some(sun).filter(|sun| sun.irradiance.iter().any(|&e| e != 0.0));
        if self.levels.is(radiance, sun, exposure) {
            return Ok(false);
        }
        self.levels.set(&self.field, (radiance, sun, exposure), self.kernel)?;
        let sun = sun.filter(|sun| sun.dir_world[1] >= 0.0);
        self.light += 1;
        self.sun_is_up = sun.is_some();
        if let Some(SunWeight { dir_world, .. }) = sun
            && self.sun_dir_world != Some(dir_world)
        {
            self.look_at_sun(dir_world);
        }
        Ok(true)
    }

    /// Looks at a new sun from every bounce point. Every tile's indirect light takes from points all over the scene, so
    /// this comes before any band is traced, and nothing here changes while bands are.
    fn look_at_sun(&mut self, dir_world: [f32; 3]) {
        let sun_light = SunLight::new(&self.field, dir_world);
        let points = self.means.len() / 2;
        sun_light.points(&self.field, 0, &mut self.means[points..]);
        mean_up(self.means);
        self.sun_dir_world = Some(dir_world);
        self.sun_light = Some(sun_light);
        self.sun_number += 1;
    }

    fn first_tile(&self, band: usize) -> usize {
        band * self.field.response().grid().0
    }

    /// Where the band's slots lie in a plane laid out like the row scales. Bands' slots do not overlap, because a
    /// field's places rise with the tiles' numbers.
    pub fn slots_of(&self, band: usize) -> core::ops::Range<usize> {
        let (response, first) = (self.field.response(), self.first_tile(band));
        let last = response.tile(first + response.grid().0 - 1);
        response.tile(first).plane_at..last.plane_at + 3 * last.padded_pixels()
    }

    /// Traces the sun's light in those tiles of a band that have not seen its newest direction. `states` are the
    /// band's tiles, `slots` its part of the plane ([`Relighting::slots_of`]).
    pub fn trace_band(&self, band: usize, states: &mut [TileState], slots: &mut [u16]) {
        let Some(sun_light) = &self.sun_light else { return };
        let begin = self.slots_of(band).start;
        let mut fresh = [0u16; 3 * TILE_PIXELS];
        for (column, state) in states.iter_mut().enumerate() {
            if state.empty || state.traced_sun == self.sun_number {
                continue;
            }
            let index = self.first_tile(band) + column;
            let tile = self.field.response().tile(index);
            let fresh = &mut fresh[..3 * tile.padded_pixels()];
            sun_light.tile(&self.field, index, self.means, fresh);
            let at = tile.plane_at - begin;
            state.take_sun(self.sun_number, &mut slots[at..at + fresh.len()], fresh);
        }
    }

    /// Is the sun up while a tile has never seen one?
    pub fn lacks_sun(&self, states: &[TileState]) -> bool {
        self.sun_is_up && states.iter().any(|state| !state.empty && state.traced_sun == 0)
    }

    /// Draws what has changed in a band. `states` are the band's tiles, `blocks` its row of blocks, `plane` is the whole
    /// plane.
    pub fn relight_band(
        &self,
        band: usize,
        (states, mut blocks, plane): (&mut [TileState], BandBlocks<'_>, &[u16]),
        frame: &Frame<'_>,
        damage: &mut Damage<'_>,
    ) -> Tally {
        let sun = self.sun_is_up.then_some((plane, self.levels.get(0).weights.sun_q16()));
        let mut tally = Tally::default();
        let mut linear = LinearTile::new();
        for (column, state) in states.iter_mut().enumerate() {
            let index = self.first_tile(band) + column;
            let stays = self.bring_up_to_date(index, (state, &mut blocks), sun, frame, &mut linear);
            if !stays {
                let at = (column * TILE_PX, band * TILE_PX);
                let (width, height) = frame.tile_size(at);
                let [x, y, width, height] = [at.0, at.1, width, height].map(|px| px as u32);
                damage.add(RelumeRect { x, y, width, height });
            }
            let shown = u32::from(!state.empty);
            tally = tally.plus(Tally {
                drawn: shown * u32::from(!stays),
                kept: shown * u32::from(stays),
                empty: 1 - shown,
                sun_stale: shown * u32::from(self.sun_is_up && state.traced_sun != self.sun_number),
                bound: if state.empty { (0.0, 0.0) } else { state.shown_bound },
            });
        }
        tally
    }

    /// Draws a tile unless it may stay; does it?
    fn bring_up_to_date(
        &self,
        index: usize,
        (state, blocks): (&mut TileState, &mut BandBlocks<'_>),
        sun: Option<(&[u16], [u32; 3])>,
        frame: &Frame<'_>,
        linear: &mut LinearTile,
    ) -> bool {
        let columns = self.field.response().grid().0;
        let (row, column) = (index / columns, index % columns);
        let level = if state.empty { 0 } else { blocks.level(column / BLOCK_TILES) };
        let in_place = !frame.redraw && state.in_place(frame.target(), frame.view());
        if in_place && state.shows_light(self.light, level) {
            return true;
        }
        let projected = match state.empty {
            true => &Projected::DARK,
            false => blocks.get(column / BLOCK_TILES, |projected| self.project((index, level), projected)),
        };
        let weights = &self.levels.get(level).weights;
        let light = TileLight { sun, weights, unpacked: &[] };
        let sun_q16 = sun.map_or([0; 3], |(_, q16)| q16);
        let frame_light = FrameLight { number: self.light, level, sun_q16, weights, slope: &self.slope };
        let tile = &self.field.response().tile(index);
        if in_place && state.may_stay((&self.field, tile), projected, frame_light) {
            return true;
        }
        let at = (column * TILE_PX, row * TILE_PX);
        let (tile, with) = ((&self.field, tile), (&self.view_light, self.kernel));
        let extent = frame.relight_tile(tile, at, (&projected.coefficients, &light), with, linear);
        let dimmest = Dimmest::of_extent(extent);
        state.note_drawn(tile, projected, (frame_light, dimmest), (frame.target(), frame.view()));
        false
    }

    /// Projects the light of a level on the block of a tile with geometry.
    fn project(&self, (index, level): (usize, usize), projected: &mut Projected) {
        let (response, level) = (self.field.response(), self.levels.get(level));
        projected.coefficients.project(&response.tile(index), &level.weights, self.kernel, MAX_RANK);
        if let Some(bounds) = self.field.bounds() {
            projected.bound = bounds.block(response.block_of(index), &level.bound, self.kernel);
        }
    }
}
