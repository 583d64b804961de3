//! The light of a moment on each level of the way back; the higher ones only as far as blocks ask for them.

use relume_firmware::bound::BoundLight;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::levels::{LEVELS, apart};
use relume_firmware::weights::{Apart, FixedWeights, MOST_STANDOUTS, SunWeight, WeightError};

/// The weights of one level.
pub struct Level {
    /// Patches apart are left out of them.
    pub weights: FixedWeights,
    /// What bounds need to know of them.
    pub bound: BoundLight,
    is_ready: bool,
}

impl Level {
    /// Without light.
    pub const fn dark(patches: usize) -> Self {
        Level { weights: FixedWeights::dark(patches), bound: BoundLight::DARK, is_ready: false }
    }
}

/// Levels that a field has: one without a way back.
pub fn level_count(field: &Field<'_>) -> usize {
    if field.way_back().bytes() > 0 { LEVELS } else { 1 }
}

/// The newest light on all levels.
pub struct Levels {
    levels: &'static mut [Level],
    /// Radiance per patch as it was given.
    radiance: &'static mut [[f32; 3]],
    sun: Option<SunWeight>,
    exposure: f32,
}

impl Levels {
    /// In the dark, in memory of the caller: [`level_count`] levels, and a radiance per patch.
    pub fn new(levels: &'static mut [Level], radiance: &'static mut [[f32; 3]]) -> Self {
        Levels { levels, radiance, sun: None, exposure: f32::NAN }
    }

    /// One level.
    pub fn get(&self, level: usize) -> &Level {
        &self.levels[level]
    }

    /// The highest.
    pub fn top(&self) -> usize {
        self.levels.len() - 1
    }

    /// Was this light given last?
    pub fn is(&self, radiance: &[[f32; 3]], sun: Option<SunWeight>, exposure: f32) -> bool {
        exposure == self.exposure && sun == self.sun && radiance == &*self.radiance
    }

    /// Takes the light of a moment.
    ///
    /// # Errors
    /// What is wrong with it; nothing has changed then.
    pub fn set(
        &mut self,
        field: &Field<'_>,
        (radiance, sun, exposure): (&[[f32; 3]], Option<SunWeight>, f32),
        kernel: Kernel,
    ) -> Result<(), WeightError> {
        self.set_level(field, 0, (radiance, sun, exposure), kernel)?;
        self.radiance.copy_from_slice(radiance);
        (self.sun, self.exposure) = (sun, exposure);
        self.levels[1..].iter_mut().for_each(|level| level.is_ready = false);
        Ok(())
    }

    /// Makes a level ready for the newest light.
    pub fn prepare(&mut self, field: &Field<'_>, level: usize, kernel: Kernel) {
        if !self.levels[level].is_ready {
            let radiance = core::mem::take(&mut self.radiance);
            // The same numbers were accepted on level 0.
            let accepted = self.set_level(field, level, (radiance, self.sun, self.exposure), kernel);
            debug_assert!(accepted.is_ok());
            self.radiance = radiance;
        }
    }

    fn set_level(
        &mut self,
        field: &Field<'_>,
        level: usize,
        (radiance, sun, exposure): (&[[f32; 3]], Option<SunWeight>, f32),
        kernel: Kernel,
    ) -> Result<(), WeightError> {
        let mut room = [Apart::default(); MOST_STANDOUTS];
        let apart = apart(level, field, radiance, kernel, &mut room);
        let level = &mut self.levels[level];
        level.weights.set(radiance, sun.as_ref(), exposure, apart)?;
        if let Some(bounds) = field.bounds() {
            bounds.light(&level.weights, kernel, &mut level.bound);
        }
        level.is_ready = true;
        Ok(())
    }
}
