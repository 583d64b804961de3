//! The weights of one moment on all levels of the way back.

use crate::weights::PatchWeights;
use relume_firmware::apart::UnpackedRows;
use relume_firmware::bound::{BoundLight, Bounds};
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::levels::{LEVELS, apart};
use relume_firmware::tile::Tile;
use relume_firmware::wayback::RowFacts;
use relume_firmware::weights::{
    Apart, FixedWeights, MAX_STANDOUTS, MOST_STANDOUTS, SunWeight, WeightError, WeightStep,
};

/// The weights of one moment on one level.
pub(super) struct Level {
    pub(super) weights: FixedWeights,
    pub(super) bound: BoundLight,
    /// Is this the newest moment's?
    ready: bool,
}

/// The weights of one moment on all levels; the higher ones only as far as they are asked for.
pub(super) struct Levels {
    kernel: Kernel,
    levels: Vec<Level>,
    before: FixedWeights,
    step: WeightStep,
    /// Does `step` lead from the moment before to this one, on level 0?
    stepped: bool,
    has_way_back: bool,
    bounds_on: bool,
    unpacked: Vec<Unpacked>,
    /// How often weights were unpacked for.
    moment: u64,
}

/// Unpacked rows of a patch that outshines the sky.
struct Unpacked {
    patch: Option<u16>,
    /// The last moment in which it stood out, counted from 1; 0 while there is none.
    moment: u64,
    codes: Vec<u8>,
    facts: Vec<RowFacts>,
}

impl Unpacked {
    /// Room for a patch of `field`, which the system does not give before it is written to.
    fn room(field: &Field<'_>) -> Self {
        let response = field.response();
        let facts = vec![RowFacts::default(); response.tiles()];
        Unpacked { patch: None, moment: 0, codes: vec![0; response.plane_len()], facts }
    }

    fn fill(&mut self, field: &Field<'_>, tiles: &[Tile<'_>], patch: u16, kernel: Kernel) {
        let way_back = field.way_back();
        for (index, tile) in tiles.iter().enumerate() {
            // The rows of one patch are small and far from each other: memory is asked for a few tiles ahead.
            if index + 4 < tiles.len() {
                way_back.prefetch_entry(index + 4, patch.into(), kernel);
            }
            if index + 2 < tiles.len() {
                way_back.prefetch_rows(index + 2, patch.into(), kernel);
            }
            let place = tile.plane_at..tile.plane_at + 3 * tile.padded_pixels();
            self.facts[index] = UnpackedRows::unpack(field, tile, patch, kernel, &mut self.codes[place]);
        }
    }
}

impl Levels {
    pub(super) fn new(field: &Field<'_>, kernel: Kernel) -> Self {
        let patches = field.patch_set().len();
        let level = || Level { weights: FixedWeights::dark(patches), bound: BoundLight::DARK, ready: false };
        Levels {
            kernel,
            levels: (0..LEVELS).map(|_| level()).collect(),
            before: FixedWeights::dark(patches),
            step: WeightStep::NONE,
            stepped: false,
            has_way_back: field.way_back().bytes() > 0,
            bounds_on: true,
            unpacked: (0..MAX_STANDOUTS).map(|_| Unpacked::room(field)).collect(),
            moment: 0,
        }
    }

    /// Unpacks the rows of the patches that outshine the sky now, unless they are still there: those that stood out last stay
    /// longest, because under clouds the same few come and go.
    pub(super) fn unpack(&mut self, field: &Field<'_>, tiles: &[Tile<'_>]) {
        self.moment += 1;
        let weights = &self.levels[0].weights;
        for known in &mut self.unpacked {
            if known.patch.is_some_and(|patch| weights.apart().any(|apart| apart.patch == patch)) {
                known.moment = self.moment;
            }
        }
        for new in weights.apart() {
            if self.unpacked.iter().any(|known| known.patch == Some(new.patch)) {
                continue;
            }
            let Some(slot) = self.unpacked.iter_mut().min_by_key(|known| known.moment) else { return };
            (slot.patch, slot.moment) = (Some(new.patch), self.moment);
            slot.fill(field, tiles, new.patch, self.kernel);
        }
    }

    /// What [`Levels::unpack`] unpacked for the newest weights, in their order, and how many there are.
    pub(super) fn unpacked(&self) -> ([UnpackedRows<'_>; MAX_STANDOUTS], usize) {
        let mut rows = [UnpackedRows { patch: 0, codes: &[], facts: &[] }; MAX_STANDOUTS];
        let mut count = 0;
        for apart in self.levels[0].weights.apart() {
            if let Some(known) = self.unpacked.iter().find(|known| known.patch == Some(apart.patch)) {
                rows[count] = UnpackedRows { patch: apart.patch, codes: &known.codes, facts: &known.facts };
                count += 1;
            }
        }
        (rows, count)
    }

    pub(super) fn set_bounds(&mut self, on: bool) {
        self.bounds_on = on;
    }

    /// The field's bounds, unless they are switched off.
    pub(super) fn bounds<'f>(&self, field: &Field<'f>) -> Option<Bounds<'f>> {
        field.bounds().filter(|_| self.bounds_on)
    }

    /// Are they not switched off?
    pub(super) fn bounds_on(&self) -> bool {
        self.bounds_on
    }

    /// Highest level of the field.
    pub(super) fn top(&self) -> usize {
        if self.has_way_back { LEVELS - 1 } else { 0 }
    }

    pub(super) fn get(&self, level: usize) -> &Level {
        &self.levels[level]
    }

    /// The change since the moment before, on level 0, where projections can be stepped.
    pub(super) fn step(&self) -> Option<&WeightStep> {
        self.stepped.then_some(&self.step)
    }

    /// Takes the weights of a new moment: the sky's radiance, and the sun that is shown.
    pub(super) fn set(
        &mut self,
        field: &Field<'_>,
        (radiance, sun): (&[[f32; 3]], Option<SunWeight>),
        exposure: f32,
    ) -> Result<(), WeightError> {
        let mut room = [Apart::default(); MOST_STANDOUTS];
        let apart = apart(0, field, radiance, self.kernel, &mut room);
        self.before.clone_from(&self.levels[0].weights);
        self.levels[0].weights.set(radiance, sun.as_ref(), exposure, apart)?;
        self.levels.iter_mut().for_each(|level| level.ready = false);
        self.stepped = self.step.set(&self.before, &self.levels[0].weights);
        self.finish(field, 0);
        Ok(())
    }

    /// Makes a higher level ready for the moment that [`Levels::set`] was given.
    pub(super) fn prepare(&mut self, field: &Field<'_>, level: usize, given: &PatchWeights, exposure: f32) {
        if self.levels[level].ready {
            return;
        }
        let mut room = [Apart::default(); MOST_STANDOUTS];
        let apart = apart(level, field, &given.radiance, self.kernel, &mut room);
        // The same numbers were accepted on level 0.
        let accepted = self.levels[level].weights.set(&given.radiance, given.sun.as_ref(), exposure, apart);
        debug_assert!(accepted.is_ok());
        self.finish(field, level);
    }

    fn finish(&mut self, field: &Field<'_>, level: usize) {
        let level = &mut self.levels[level];
        if let Some(bounds) = field.bounds().filter(|_| self.bounds_on) {
            bounds.light(&level.weights, self.kernel, &mut level.bound);
        }
        level.ready = true;
    }
}
