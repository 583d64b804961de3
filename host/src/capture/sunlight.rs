//! The sun of a picture: out of the patches, together with what the lens scattered of it, into a weight of its own.

use super::beam::AUREOLE_DEG;
use super::clearsky::Measured;
use super::{Capture, Captured, SkyPicture, SunSource};
use crate::bracket::{Merged, PixelState};
use crate::map::luminance;
use crate::split::{MIN_DISC_CONTRAST, MIN_IRRADIANCE_SHARE};
use crate::sun::{SunPosition, dir_world};
use crate::weights::{SunWeight, sun_solid_angle_sr};

/// A clipped pixel at the sun's place shows the sun if it is at least this much brighter than the sky around it, as far as it could
/// be measured; or if what is around it tells of so much of the beam.
const CLIPPED_CONTRAST: f64 = 3.0;
const PLAIN_SHARE: f64 = 0.1;
/// Less than this share of the clear-sky beam is a veiled sun.
const VEILED: f64 = 0.75;

impl Capture {
    /// The sun to its own weight and the sky behind it to the patches; the picture as it was where none shines.
    pub(super) fn take_out_sun(&mut self, merged: &Merged, position: SunPosition, into: &mut Captured) -> SunSource {
        let sun_dir = dir_world(position, self.settings.north_deg);
        let picture = SkyPicture { merged, sky: &self.sky, dirs: &self.shares.dirs, omegas: &self.shares.omegas };
        if !self.spot.look(&self.lens, &picture, sun_dir) {
            return SunSource::Covered;
        }
        for &(pixel, _, left) in &self.spot.spot {
            self.sky[pixel as usize] = left;
        }
        self.fill_patches(into);
        let source = self.add_sun(position, into);
        let is_clipped = |&&(pixel, ..): &&(u32, _, _)| merged.state[pixel as usize] == PixelState::Clipped;
        if let Some(sun) = into.weights.sun {
            into.clipped_pixels -= self.spot.spot.iter().filter(is_clipped).count();
            self.take_out_halo(sun_dir, sun.irradiance, into);
        } else {
            for &(pixel, found, _) in &self.spot.spot {
                self.sky[pixel as usize] = found;
            }
        }
        source
    }

    fn add_sun(&mut self, position: SunPosition, into: &mut Captured) -> SunSource {
        let spot = &self.spot;
        let least = spot.irradiance.map(|v| v as f32);
        let light = f64::from(luminance(least));
        let upper = self.set.upper();
        let of_patch = |at: usize| f64::from(luminance(into.weights.radiance[at]) * self.set.solid_angle_sr(at));
        let sky = 0.5 * (0..upper).map(of_patch).sum::<f64>();
        if light <= 0.0 {
            return SunSource::Covered;
        }
        let (irradiance, source) = if spot.clipped {
            let Some((modelled, share)) = self.modelled_sun(position, &into.weights.radiance) else {
                return SunSource::Covered;
            };
            into.beam_share = Some(share);
            let source = if share < VEILED { SunSource::Veiled } else { SunSource::ClearSkyModel };
            (std::array::from_fn(|k| modelled[k].max(least[k])), source)
        } else if light / sun_solid_angle_sr() >= MIN_DISC_CONTRAST * spot.ring {
            (least, SunSource::Measured)
        } else {
            return SunSource::Covered;
        };
        if f64::from(luminance(irradiance)) < MIN_IRRADIANCE_SHARE * sky {
            return SunSource::Covered;
        }
        let above = SunPosition { altitude_deg: position.altitude_deg.max(0.0), ..position };
        into.weights.sun = Some(SunWeight { dir_world: dir_world(above, self.settings.north_deg), irradiance });
        source
    }

    /// Takes what the lens scattered of the sun out of the sky around it. What is left is no darker than the clear sky that comes
    /// through with the beam.
    pub(super) fn take_out_halo(&mut self, sun_dir: [f32; 3], irradiance: [f32; 3], into: &mut Captured) {
        let Some(believed) = self.beam.halo.believed() else { return };
        let least = into.beam_share.map_or([0.0; 3], |share| self.beam.least_clear().map(|clear| clear * share as f32));
        for (pixel, apart_deg) in self.spot.shown() {
            let (value, halo) = (&mut self.sky[pixel], self.beam.halo.at(apart_deg));
            *value = std::array::from_fn(|k| {
                let scattered = (believed * halo[k] * irradiance[k]).max(0.0);
                (value[k] - scattered).max(least[k].min(value[k]))
            });
        }
        self.fill_patches_near(sun_dir, AUREOLE_DEG as f32, into);
    }

    /// What comes through of the clear-sky beam in the measured sky's unit, and its share of that beam; none where what is
    /// clipped is no sun.
    fn modelled_sun(&mut self, sun: SunPosition, radiance: &[[f32; 3]]) -> Option<([f32; 3], f64)> {
        let clear = self.clear_sky.look(&Measured { set: &self.set, radiance, sun, settings: &self.settings });
        let stands_out = self.spot.brightest >= CLIPPED_CONTRAST * self.spot.ring;
        let share = match self.beam.look(&self.spot.near, &clear) {
            Some(share) if stands_out || share >= PLAIN_SHARE => share,
            None if stands_out => 1.0,
            _ => return None,
        };
        Some((clear.beam.map(|v| v * share as f32), share))
    }
}
