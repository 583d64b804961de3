//! The light of a time and place through a clear-sky model, without a camera.

use super::{SkyFault, SkyReading, SkySource, SunSource};
use crate::clock::Moment;
use crate::config::{Site, Weather};
use crate::skymodel::{Atmosphere, SkyModel};
use relume_firmware::patches::PatchSet;

/// Time and place through the clear-sky model; no camera.
pub struct SimulatedSky {
    site: Site,
    atmosphere: Atmosphere,
    patches: PatchSet,
    north_deg: f64,
}

impl SimulatedSky {
    /// A simulated sky for a field's patches; `north_deg` as in the field's camera.
    pub fn new(site: Site, weather: Weather, patches: PatchSet, north_deg: f64) -> Self {
        SimulatedSky { site, atmosphere: atmosphere(site, weather), patches, north_deg }
    }
}

/// The model's air and ground for a site and its weather.
pub fn atmosphere(site: Site, weather: Weather) -> Atmosphere {
    Atmosphere {
        turbidity: weather.turbidity as f32,
        ground_albedo: [site.ground_albedo as f32; 3],
        cloud_cover: weather.cloud_cover as f32,
        cloud_seed: weather.seed,
        ..Atmosphere::default()
    }
}

impl SkySource for SimulatedSky {
    fn read(&mut self, moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let model = SkyModel::at(self.atmosphere, moment.unix_s, self.site.place, self.north_deg)
            .map_err(|e| SkyFault::Failed(e.to_string()))?;
        let mut weights = model.weights(&self.patches);
        if !moment.trusted {
            weights.sun = None;
        }
        let sun = match weights.sun {
            Some(_) => SunSource::Model,
            None if !moment.trusted => SunSource::ClockNotTrusted,
            None if model.sun_dir()[1] < 0.0 => SunSource::BelowHorizon,
            None => SunSource::Covered,
        };
        *into = SkyReading { weights, sun, ..SkyReading::default() };
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sun::{Place, parse_utc, position_of};

    #[test]
    fn noon_has_a_southern_sun_and_midnight_none() {
        let place = Place { latitude_deg: 41.9, longitude_deg: 12.5 };
        let site = Site { place, elevation_m: 0.0, ground_albedo: 0.2 };
        let weather = Weather { turbidity: 3.0, cloud_cover: 0.0, seed: 1 };
        let mut sky = SimulatedSky::new(site, weather, PatchSet::new(64).unwrap(), 0.0);
        let at = |unix_s| Moment { unix_s, trusted: true };
        let mut read = |time: &str| {
            let mut reading = SkyReading::default();
            sky.read(at(parse_utc(time).unwrap()), &mut reading).unwrap();
            reading
        };
        let noon = read("2026-06-21T11:12:00Z");
        assert_eq!(noon.sun, SunSource::Model);
        // Solar noon at 12.5 degrees east is 12:00 - 50 min + 2 min; altitude 90 - 41.9 + 23.44.
        let stands = position_of(noon.weights.sun.unwrap().dir_world, 0.0);
        assert!((stands.azimuth_deg - 180.0).abs() < 2.0 && (stands.altitude_deg - 71.5).abs() < 0.3, "{stands:?}");
        let night = read("2026-06-21T23:00:00Z");
        assert_eq!(night.sun, SunSource::BelowHorizon);
        assert!(night.weights.radiance[0][1] < 1e-3 * noon.weights.radiance[0][1]);
    }
}
