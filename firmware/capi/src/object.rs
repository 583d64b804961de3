//! The relighting of one field: light in, tiles out. Pointers are `memory`'s business.

use crate::damage::Damage;
use crate::frame::Frame;
use crate::tile_state::{FrameLight, TileState};
use crate::types::{RelumeError, RelumeRect};
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::relight::{Coefficients, LinearTile, TileLight};
use relume_firmware::sunlight::SunLight;
use relume_firmware::tile::{MAX_RANK, TILE_PIXELS, TILE_PX};
use relume_firmware::tone::ViewLight;
use relume_firmware::weights::{FixedWeights, SunWeight};

/// What all bands of a picture share; only [`Relighting::set_light`] changes it.
pub struct Relighting {
    field: Field<'static>,
    kernel: Kernel,
    view_light: ViewLight,
    weights: FixedWeights,
    /// Counts lights, from 1.
    light: u64,
    /// The newest direction of a sun that was up, and what traces it.
    sun: Option<([f32; 3], SunLight)>,
    /// Counts its changes, from 1.
    sun_number: u64,
    sun_is_up: bool,
}

/// Tiles of a call by what became of them.
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
}

impl Tally {
    /// Both together.
    pub fn plus(self, other: Tally) -> Tally {
        Tally {
            drawn: self.drawn + other.drawn,
            kept: self.kept + other.kept,
            empty: self.empty + other.empty,
            sun_stale: self.sun_stale + other.sun_stale,
        }
    }
}

impl Relighting {
    /// In the dark, on this machine's fastest kernel.
    pub fn new(field: Field<'static>) -> Self {
        Relighting {
            field,
            kernel: Kernel::detect(),
            view_light: ViewLight::new(),
            weights: FixedWeights::dark(field.patch_set().len()),
            light: 1,
            sun: None,
            sun_number: 0,
            sun_is_up: false,
        }
    }

    /// The field.
    pub fn field(&self) -> &Field<'static> {
        &self.field
    }

    /// Patches without light.
    pub fn patches_dark(&self) -> usize {
        self.weights.dark_patches()
    }

    /// Takes the light of a moment. A sun at or below the horizon, or without irradiance, is none.
    ///
    /// # Errors
    /// What is wrong with it; nothing has changed then.
    pub fn set_light(&mut self, radiance: &[[f32; 3]], sun: SunWeight, exposure: f32) -> Result<(), RelumeError> {
        // Whatever is not nothing goes to the weights, which refuse what is no sun.
        let sun = Some(sun).filter(|sun| sun.irradiance.iter().any(|&e| e != 0.0));
        self.weights.set(radiance, sun.as_ref(), exposure)?;
        let sun = sun.filter(|sun| sun.dir_world[1] >= 0.0);
        self.light += 1;
        self.sun_is_up = sun.is_some();
        if let Some(SunWeight { dir_world, .. }) = sun
            && self.sun.as_ref().is_none_or(|(old, _)| *old != dir_world)
        {
            self.sun = Some((dir_world, SunLight::new(&self.field, dir_world)));
            self.sun_number += 1;
        }
        Ok(())
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
        let Some((_, sun)) = &self.sun else { return };
        let begin = self.slots_of(band).start;
        let mut fresh = [0u16; 3 * TILE_PIXELS];
        for (column, state) in states.iter_mut().enumerate() {
            if state.empty || state.traced_sun == self.sun_number {
                continue;
            }
            let index = self.first_tile(band) + column;
            let tile = self.field.response().tile(index);
            let fresh = &mut fresh[..3 * tile.padded_pixels()];
            sun.tile(&self.field, index, self.kernel, fresh);
            let at = tile.plane_at - begin;
            state.take_sun(self.sun_number, &mut slots[at..at + fresh.len()], fresh);
        }
    }

    /// Is the sun up while a tile has never seen one?
    pub fn lacks_sun(&self, states: &[TileState]) -> bool {
        self.sun_is_up && states.iter().any(|state| !state.empty && state.traced_sun == 0)
    }

    /// Draws what has changed in a band. `states` are the band's tiles, `plane` is the whole plane.
    pub fn relight_band(
        &self,
        band: usize,
        (states, plane): (&mut [TileState], &[u16]),
        frame: &Frame<'_>,
        damage: &mut Damage<'_>,
    ) -> Tally {
        let sun = self.sun_is_up.then_some((plane, self.weights.sun_q16()));
        let tile_light = TileLight { sun, standouts: self.weights.standouts() };
        let frame_light = FrameLight {
            sun_q16: if self.sun_is_up { self.weights.sun_q16() } else { [0; 3] },
            standouts: self.weights.standouts(),
        };
        let light = (self.light, frame_light);
        let mut tally = Tally::default();
        let (mut linear, mut coefficients) = (LinearTile::new(), Coefficients::ZERO);
        for (column, state) in states.iter_mut().enumerate() {
            let index = self.first_tile(band) + column;
            let stale = self.sun_is_up && !state.empty && state.traced_sun != self.sun_number;
            tally.sun_stale += u32::from(stale);
            tally.empty += u32::from(state.empty);
            let in_place = !frame.redraw && state.in_place(frame.target(), frame.view());
            let mut stays = in_place && state.shows_light(self.light);
            if !stays {
                self.project(index, state.empty, &mut coefficients);
                stays = in_place && state.may_stay(&self.field, index, &coefficients, light);
            }
            if stays {
                tally.kept += u32::from(!state.empty);
                continue;
            }
            coefficients.pixels(&self.field, index, &tile_light, self.kernel, &mut linear);
            let at = (column * TILE_PX, band * TILE_PX);
            self.write(index, at, &linear, frame, damage);
            state.note_drawn(&coefficients, light, (frame.target(), frame.view()));
            tally.drawn += u32::from(!state.empty);
        }
        tally
    }

    fn project(&self, index: usize, empty: bool, coefficients: &mut Coefficients) {
        if empty {
            *coefficients = Coefficients::ZERO;
        } else {
            coefficients.project(&self.field.response().tile(index), &self.weights, self.kernel, MAX_RANK);
        }
    }

    fn write(&self, index: usize, at: (usize, usize), linear: &LinearTile, frame: &Frame<'_>, damage: &mut Damage<'_>) {
        let tile = self.field.response().tile(index);
        frame.write_tile(at, &tile, linear, self.field.coverage(index), (&self.view_light, self.kernel));
        let (width, height) = frame.tile_size(at);
        let [x, y, width, height] = [at.0, at.1, width, height].map(|px| px as u32);
        damage.add(RelumeRect { x, y, width, height });
    }
}
