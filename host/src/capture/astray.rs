//! Whether the sun stands in the picture where time, place and lens say.

use super::Capture;
use crate::bracket::Merged;
use crate::sun::{SunPosition, angle_deg, dir_world};

/// The sun is this many times brighter than the sky's mean, at least; what is half as bright as the brightest is its spot.
const CONTRAST: f64 = 4.0;
const SPOT_SHARE: f32 = 0.5;
/// Widest spot, RMS distance from its centre, degrees: bright cloud is wider.
const WIDEST_DEG: f64 = 3.0;
/// Lowest sun whose spot is not the horizon's glow, degrees.
const LOWEST_DEG: f64 = 8.0;

impl Capture {
    /// Angle between the one bright spot of a merged picture and the sun's place by time, place and lens, degrees; none without
    /// such a spot, and of a low sun. A wrong lens, orientation, north, place or clock shows as one angle in all pictures,
    /// clouds as another in each.
    pub fn sun_astray_deg(&self, merged: &Merged, sun: SunPosition) -> Option<f64> {
        if sun.altitude_deg < LOWEST_DEG || merged.radiance.len() != self.shares.omegas.len() {
            return None;
        }
        let counted =
            || merged.radiance.iter().zip(&self.shares.omegas).zip(&self.shares.dirs).filter(|((_, o), _)| **o > 0.0);
        let (mut brightest, mut light, mut whole) = (0.0f32, 0.0, 0.0);
        for ((value, omega), _) in counted() {
            brightest = brightest.max(value[1]);
            light += f64::from(value[1] * omega);
            whole += f64::from(*omega);
        }
        if f64::from(brightest) * whole < CONTRAST * light {
            return None;
        }
        let (mut sum, mut spot) = ([0.0f64; 3], 0.0);
        for ((_, omega), dir) in counted().filter(|((value, _), _)| value[1] >= SPOT_SHARE * brightest) {
            (0..3).for_each(|k| sum[k] += f64::from(dir[k] * omega));
            spot += f64::from(*omega);
        }
        let length = sum.iter().map(|c| c * c).sum::<f64>().sqrt();
        // For directions close together the mean's length is 1 - (RMS angle)^2 / 2.
        let spread_deg = (2.0 * (1.0 - length / spot).max(0.0)).sqrt().to_degrees();
        let centre = sum.map(|c| (c / length) as f32);
        (spread_deg < WIDEST_DEG).then(|| angle_deg(centre, dir_world(sun, self.settings.north_deg)))
    }
}
