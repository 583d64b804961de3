//! The dome of a clear sky, without the sun's disc: Hosek & Wilkie's by day, twilight after it.

use crate::sun::{SunPosition, dir_world};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

const NIGHT: [f32; 3] = [0.5e-6, 0.8e-6, 1.6e-6];
const TWILIGHT_DECADES_PER_DEG: f32 = 0.475;

/// A clear sky of one moment.
#[derive(Clone, Debug)]
pub struct ClearDome {
    state: Option<SkyState>,
    altitude_deg: f32,
    sun_dir: [f32; 3],
}

impl ClearDome {
    /// The dome of a haze (turbidity, clamped to 1.7..10) over a ground (RGB albedo, clamped to 0..1); `north_deg` as in the camera
    /// file.
    pub fn new(turbidity: f32, ground_albedo: [f32; 3], sun: SunPosition, north_deg: f64) -> Self {
        let altitude_deg = sun.altitude_deg.clamp(-90.0, 90.0) as f32;
        let params = SkyParams {
            elevation: altitude_deg.max(0.0).to_radians().min(FRAC_PI_2),
            turbidity: turbidity.clamp(1.7, 10.0),
            albedo: ground_albedo.map(|a| a.clamp(0.0, 1.0)),
        };
        ClearDome { state: SkyState::new(&params).ok(), altitude_deg, sun_dir: dir_world(sun, north_deg) }
    }

    /// Unit direction towards the sun.
    pub fn sun_dir(&self) -> [f32; 3] {
        self.sun_dir
    }

    /// Radiance in a unit direction above the horizon.
    pub fn radiance(&self, dir: [f32; 3]) -> [f32; 3] {
        let Some(state) = &self.state else { return NIGHT };
        let cos_gamma = (0..3).map(|k| dir[k] * self.sun_dir[k]).sum::<f32>().clamp(-1.0, 1.0);
        let (gamma, theta) = (cos_gamma.acos(), dir[1].clamp(0.0, 1.0).acos());
        let channels = [Channel::R, Channel::G, Channel::B];
        let day = channels.map(|channel| state.radiance(theta, gamma, channel).max(0.0));
        if self.altitude_deg >= 0.0 {
            return std::array::from_fn(|k| day[k] + NIGHT[k]);
        }
        let fade = 10f32.powf(TWILIGHT_DECADES_PER_DEG * self.altitude_deg);
        let blue = (-self.altitude_deg / 8.0).clamp(0.0, 1.0);
        let dusk = [0.55, 0.85, 1.6].map(|tint| 0.6 * tint * (0.7 + 0.3 * (1.0 - dir[1])));
        std::array::from_fn(|k| fade * (day[k] * (1.0 - blue) + dusk[k] * blue) + NIGHT[k])
    }

    /// Horizontal irradiance under it.
    pub fn horizontal_irradiance(&self) -> [f32; 3] {
        horizontal_irradiance(|dir| self.radiance(dir))
    }
}

/// Horizontal irradiance of a sky by 512 directions uniform in sin^2 of the zenith angle and in azimuth.
pub(super) fn horizontal_irradiance(radiance: impl Fn([f32; 3]) -> [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for i in 0..16 {
        let radius = ((i as f32 + 0.5) / 16.0).sqrt();
        let up = (1.0 - radius * radius).sqrt();
        for j in 0..32 {
            let (sin, cos) = ((j as f32 + 0.5) / 32.0 * TAU).sin_cos();
            let value = radiance([radius * cos, up, radius * sin]);
            sum = std::array::from_fn(|k| sum[k] + value[k] * PI / 512.0);
        }
    }
    sum
}
