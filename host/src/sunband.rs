//! The band of sky that the sun keeps to at a site, and what to do about a sun outside it.

use crate::sun::SunPosition;

/// The sun's declination reaches 23.44 degrees; refraction (0.6) and the disc's radius (0.27) widen the band.
const MOST_DECLINATION_DEG: f64 = 23.44 + 0.6 + 0.27;

/// Declination of a direction at a latitude, degrees.
pub fn declination_deg(sun: SunPosition, latitude_deg: f64) -> f64 {
    let [_, up, north] = equatorial(sun, latitude_deg);
    let _ = up;
    north.clamp(-1.0, 1.0).asin().to_degrees()
}

/// Axes: west, towards the equator's highest point, celestial north.
fn equatorial(sun: SunPosition, latitude_deg: f64) -> [f64; 3] {
    let (sin_az, cos_az) = sun.azimuth_deg.to_radians().sin_cos();
    let (up, level) = sun.altitude_deg.to_radians().sin_cos();
    let (sin_lat, cos_lat) = latitude_deg.to_radians().sin_cos();
    let (east, north) = (level * sin_az, level * cos_az);
    [-east, up * cos_lat - north * sin_lat, up * sin_lat + north * cos_lat]
}

/// The nearest sun of the site's band: the same hour angle, the declination brought into range. `None` when the sun is
/// in the band already.
pub fn nearest(sun: SunPosition, latitude_deg: f64) -> Option<SunPosition> {
    let declination = declination_deg(sun, latitude_deg);
    if declination.abs() <= MOST_DECLINATION_DEG {
        return None;
    }
    let [west, high, _] = equatorial(sun, latitude_deg);
    let hour = west.atan2(high);
    let (north, around) = (MOST_DECLINATION_DEG.copysign(declination)).to_radians().sin_cos();
    let (west, high) = (around * hour.sin(), around * hour.cos());
    let (sin_lat, cos_lat) = latitude_deg.to_radians().sin_cos();
    let up = high * cos_lat + north * sin_lat;
    let level_north = north * cos_lat - high * sin_lat;
    Some(SunPosition {
        azimuth_deg: (-west).atan2(level_north).to_degrees().rem_euclid(360.0),
        altitude_deg: up.clamp(-1.0, 1.0).asin().to_degrees(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sun::{Place, sun_position};

    #[test]
    fn every_sun_of_a_year_is_in_the_band() {
        for latitude_deg in [-66.0, -33.9, 0.0, 41.9, 78.2] {
            let place = Place { latitude_deg, longitude_deg: 12.5 };
            for hour in (0..8760).step_by(7) {
                let sun = sun_position(1_767_225_600.0 + 3600.0 * f64::from(hour), place).unwrap();
                assert!(nearest(sun, latitude_deg).is_none(), "{latitude_deg} {hour}: {sun:?}");
            }
        }
    }

    #[test]
    fn a_sun_in_the_north_at_forty_degrees_is_brought_back() {
        let sun = SunPosition { azimuth_deg: 350.0, altitude_deg: 40.0 };
        let back = nearest(sun, 41.9).unwrap();
        assert!((declination_deg(back, 41.9) - MOST_DECLINATION_DEG).abs() < 1e-9);
        // Close below the pole, hour angle 101 degrees: sin(alt) = sin 24.3 sin 41.9 + cos 24.3 cos 41.9 cos 101.
        assert!((back.altitude_deg - 8.5).abs() < 0.2 && (back.azimuth_deg - 295.2).abs() < 0.5, "{back:?}");
        let noon = nearest(SunPosition { azimuth_deg: 180.0, altitude_deg: 85.0 }, 41.9).unwrap();
        assert!((noon.altitude_deg - (90.0 - 41.9 + MOST_DECLINATION_DEG)).abs() < 1e-9 && noon.azimuth_deg == 180.0);
    }
}
