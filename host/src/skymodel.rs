//! A simulated sky: Hosek-Wilkie's clear sky, a direct beam, twilight, drifting clouds and the ground they light.
//!
//! Unit: radiance in W sr^-1 m^-2 weighted by the eye's response, so that 683 x Rec.709 luminance is cd/m^2.
//! - Clear sky: Hosek & Wilkie 2012, RGB data, sun at 0..90 degrees, turbidity 1..10.
//! - Direct beam: extraterrestrial 133.1 klx in the colour of the AM0 spectrum, attenuated by Rayleigh scattering, Angstrom
//!   aerosol (exponent 1.3, beta = 0.04608 T - 0.04586) and 0.35 cm of ozone, after Leckner 1978 as in Preetham, Shirley &
//!   Smits 1999, over the air mass of Kasten & Young 1989; each channel at one wavelength (610, 550, 465 nm).
//! - Below the horizon the sky at sunset fades by 10^(0.475 per degree), which meets the 3.4 lx of civil and the 0.006 lx of
//!   nautical twilight, and turns to a dim blue; at night 0.002 lx remain.

mod dome;

use crate::clouds::Clouds;
use crate::map::{RadianceMap, luminance};
use crate::sun::{Place, SunError, SunPosition, sun_position};
use crate::weights::{PatchWeights, SUN_DIAMETER_DEG, SunWeight};
pub use dome::ClearDome;
use dome::horizontal_irradiance;
use relume_firmware::patches::PatchSet;
use std::f32::consts::PI;

/// Extraterrestrial beam, RGB: 133.1 klx / 683 in the colour of the AM0 spectrum.
const BEAM: [f32; 3] = [194.9 * 1.096, 194.9 * 0.977, 194.9 * 0.944];
const WAVELENGTH_UM: [f32; 3] = [0.610, 0.550, 0.465];
/// Ozone's optical depth at air mass 1 for 0.35 cm.
const OZONE_DEPTH: [f32; 3] = [0.042, 0.030, 0.002];

/// What the air and the ground are like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Atmosphere {
    /// Haze: 2 very clear, 3 clear, 6 hazy, 10 thick; clamped to 1.7..10.
    pub turbidity: f32,
    /// RGB albedo of the ground, 0..1.
    pub ground_albedo: [f32; 3],
    /// Share of the sky under cloud, 0..1; 1 is overcast.
    pub cloud_cover: f32,
    /// Which cloud field.
    pub cloud_seed: u64,
    /// Drift of the clouds, cloud heights per second, towards +X.
    pub cloud_drift_per_s: f64,
}

impl Default for Atmosphere {
    fn default() -> Self {
        Atmosphere {
            turbidity: 3.0,
            ground_albedo: [0.2; 3],
            cloud_cover: 0.0,
            cloud_seed: 1,
            cloud_drift_per_s: 0.004,
        }
    }
}

/// The sky of one moment.
#[derive(Clone, Debug)]
pub struct SkyModel {
    atmosphere: Atmosphere,
    clouds: Clouds,
    dome: ClearDome,
    /// Direct beam above the clouds.
    beam: [f32; 3],
    /// Horizontal irradiance above the clouds.
    above_clouds: [f32; 3],
    /// Horizontal irradiance on the ground.
    on_ground: [f32; 3],
}

/// Irradiance of the unclouded sun on a plane normal to it, RGB; 0 when the whole disc is below the horizon.
pub fn clear_beam(altitude_deg: f32, turbidity: f32) -> [f32; 3] {
    let visible = disc_share(altitude_deg);
    if visible <= 0.0 {
        return [0.0; 3];
    }
    let altitude = altitude_deg.clamp(0.0, 90.0);
    let air_mass = 1.0 / (altitude.to_radians().sin() + 0.50572 * (altitude + 6.07995).powf(-1.6364));
    let beta = (0.04608 * turbidity.clamp(1.7, 10.0) - 0.04586).max(0.0);
    std::array::from_fn(|k| {
        let depth = 0.008735 * WAVELENGTH_UM[k].powf(-4.08) + beta * WAVELENGTH_UM[k].powf(-1.3) + OZONE_DEPTH[k];
        BEAM[k] * (-depth * air_mass).exp() * visible
    })
}

/// Share of the sun's disc above the horizon.
fn disc_share(altitude_deg: f32) -> f32 {
    let h = (altitude_deg / (0.5 * SUN_DIAMETER_DEG as f32)).clamp(-1.0, 1.0);
    0.5 + (h * (1.0 - h * h).sqrt() + h.asin()) / PI
}

impl SkyModel {
    /// The sky with the sun at a position; `north_deg` as in the camera file; `time_s` moves the clouds.
    pub fn new(atmosphere: Atmosphere, sun: SunPosition, north_deg: f64, time_s: f64) -> Self {
        let dome = ClearDome::new(atmosphere.turbidity, atmosphere.ground_albedo, sun, north_deg);
        let beam = clear_beam(sun.altitude_deg as f32, atmosphere.turbidity);
        let (clear, height) = (dome.horizontal_irradiance(), dome.sun_dir()[1].max(0.0));
        let mut model = SkyModel {
            atmosphere,
            clouds: Clouds::new(&atmosphere, time_s),
            dome,
            beam,
            above_clouds: std::array::from_fn(|k| clear[k] + beam[k] * height),
            on_ground: [0.0; 3],
        };
        let is_cloudy = atmosphere.cloud_cover > 0.0;
        let under = if is_cloudy { horizontal_irradiance(|dir| model.radiance(dir)) } else { clear };
        let passed = model.clouds.transmission(model.sun_dir());
        model.on_ground = std::array::from_fn(|k| under[k] + beam[k] * passed * height);
        model
    }

    /// The sky at a time (unix seconds) and place.
    ///
    /// # Errors
    /// [`SunError`] where the ephemeris cannot tell the sun's position.
    pub fn at(atmosphere: Atmosphere, unix_s: f64, place: Place, north_deg: f64) -> Result<Self, SunError> {
        Ok(Self::new(atmosphere, sun_position(unix_s, place)?, north_deg, unix_s))
    }

    /// Unit direction towards the sun.
    pub fn sun_dir(&self) -> [f32; 3] {
        self.dome.sun_dir()
    }

    /// Radiance without the sun's disc in a unit direction; the ground's below the horizon.
    pub fn radiance(&self, dir: [f32; 3]) -> [f32; 3] {
        if dir[1] < 0.0 {
            return self.ground_radiance();
        }
        let clear = self.dome.radiance(dir);
        let depth = self.clouds.optical_depth(dir);
        if depth <= 0.0 {
            return clear;
        }
        // A cloud hides by e^-depth what is behind it and passes down a share of the light that falls on it, less when thick;
        // thin edges before the sun scatter its beam forward.
        let (passed, sun_dir) = ((-depth).exp(), self.sun_dir());
        let cos_gamma = (0..3).map(|k| dir[k] * sun_dir[k]).sum::<f32>();
        let forward = 0.6 * (-(1.0 - cos_gamma) / 0.05).exp() * (1.0 + depth).recip();
        let share = 0.25 + 0.65 * (-depth / 6.0).exp();
        std::array::from_fn(|k| {
            let white = (self.above_clouds[k] * share + self.beam[k] * forward) / PI;
            clear[k] * passed + white * (1.0 - passed)
        })
    }

    /// Radiance of the ground: albedo x horizontal irradiance / pi.
    pub fn ground_radiance(&self) -> [f32; 3] {
        std::array::from_fn(|k| self.atmosphere.ground_albedo[k].clamp(0.0, 1.0) * self.on_ground[k] / PI)
    }

    /// Horizontal irradiance on the ground, sky and sun, RGB.
    pub fn horizontal_irradiance(&self) -> [f32; 3] {
        self.on_ground
    }

    /// The sun as clouds leave it; none when it is below the horizon or hidden (less than 1e-6 of the unclouded noon sun).
    pub fn sun(&self) -> Option<SunWeight> {
        let passed = self.clouds.transmission(self.sun_dir());
        let irradiance = self.beam.map(|v| v * passed);
        let mut dir_world = self.sun_dir();
        if dir_world[1] < 0.0 {
            let level = dir_world[0].hypot(dir_world[2]);
            dir_world = [dir_world[0] / level, 0.0, dir_world[2] / level];
        }
        (luminance(irradiance) > 1e-6 * luminance(BEAM)).then_some(SunWeight { dir_world, irradiance })
    }

    /// The sky as a map of `2 * height` x `height` pixels, without the sun's disc.
    pub fn map(&self, height: usize) -> RadianceMap {
        RadianceMap::from_fn(height, |dir| self.radiance(dir))
    }

    /// The sky as a map with the sun's disc painted in; the disc's pixels hold exactly its irradiance.
    pub fn map_with_sun(&self, height: usize) -> RadianceMap {
        let mut map = self.map(height);
        if let Some(sun) = self.sun() {
            paint_disc(&mut map, &sun);
        }
        map
    }

    /// Patch weights and sun, straight from the model: 36 directions per upper patch, the ground in the lower ones.
    pub fn weights(&self, set: &PatchSet) -> PatchWeights {
        let ground = self.ground_radiance();
        let mean = |patch: usize| {
            let mut sum = [0.0; 3];
            for i in 0..36 {
                let u = [((i % 6) as f32 + 0.5) / 6.0, ((i / 6) as f32 + 0.5) / 6.0];
                let value = self.radiance(set.sample(patch, u));
                sum = std::array::from_fn(|k| sum[k] + value[k] / 36.0);
            }
            sum
        };
        let radiance = (0..set.len()).map(|p| if p < set.upper() { mean(p) } else { ground }).collect();
        PatchWeights { radiance, sun: self.sun() }
    }
}

/// `count` unit directions spread evenly over the sun's disc around a unit direction.
pub fn disc_directions(axis: [f32; 3], count: u32) -> impl Iterator<Item = [f64; 3]> {
    let radius = (0.5 * SUN_DIAMETER_DEG).to_radians();
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let unit = |v: [f64; 3]| v.map(|c| c / v.iter().map(|c| c * c).sum::<f64>().sqrt());
    let axis = unit(axis.map(f64::from));
    // Two unit vectors that span the disc, and spiral points in it.
    let seed = if axis[1].abs() < 0.9 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
    let right = unit(cross(seed, axis));
    let up = cross(axis, right);
    (0..count).map(move |i| {
        let r = radius * ((f64::from(i) + 0.5) / f64::from(count)).sqrt();
        let (sin, cos) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
        unit(std::array::from_fn(|k| axis[k] + r * (right[k] * cos + up[k] * sin)))
    })
}

/// Adds the sun's disc to a map; pixels share it by the area of the disc they hold.
pub fn paint_disc(map: &mut RadianceMap, sun: &SunWeight) {
    let count = 4096;
    for dir in disc_directions(sun.dir_world, count) {
        let (col, row) = map.pixel_of(dir.map(|c| c as f32));
        let scale = 1.0 / (map.solid_angle_sr(row) * f64::from(count));
        let pixel = &mut map.pixels[row * map.width + col];
        *pixel = std::array::from_fn(|k| pixel[k] + (f64::from(sun.irradiance[k]) * scale) as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sky(altitude_deg: f64, cloud_cover: f32) -> SkyModel {
        let atmosphere = Atmosphere { cloud_cover, ..Atmosphere::default() };
        SkyModel::new(atmosphere, SunPosition { azimuth_deg: 140.0, altitude_deg }, 0.0, 1000.0)
    }

    #[test]
    fn light_is_finite_and_falls_with_the_sun() {
        let mut brighter = f32::INFINITY;
        for altitude in (-90..=90).rev() {
            for cover in [0.0, 0.5, 1.0] {
                let model = sky(f64::from(altitude), cover);
                let map = model.map_with_sun(16);
                assert!(map.check("model").is_ok(), "{altitude} {cover}");
                assert!(map.pixels.iter().all(|p| luminance(*p) > 0.0));
            }
            let now = luminance(sky(f64::from(altitude), 0.0).horizontal_irradiance());
            assert!(now <= brighter * 1.0001, "{altitude}: {now} {brighter}");
            brighter = now;
        }
    }

    #[test]
    fn illuminances_are_those_of_real_skies() {
        // Clear-sky global illuminance by sun altitude: IES RP-21 / EN 17037 tables give about 100, 75 and 30 klx.
        for (altitude, klx) in [(60.0, 100.0), (45.0, 77.0), (20.0, 30.0)] {
            let found = 0.683 * luminance(sky(altitude, 0.0).horizontal_irradiance());
            assert!((found / klx - 1.0).abs() < 0.15, "{altitude}: {found} klx");
        }
        let civil = 683.0 * luminance(sky(-6.0, 0.0).horizontal_irradiance());
        assert!((1.0..8.0).contains(&civil), "{civil} lx");
        // Overcast: a fifth to a half of the clear sky's light, no sun.
        let (clear, grey) = (sky(45.0, 0.0), sky(45.0, 1.0));
        let share = luminance(grey.horizontal_irradiance()) / luminance(clear.horizontal_irradiance());
        assert!((0.15..0.5).contains(&share) && grey.sun().is_none(), "{share}");
    }

    #[test]
    fn the_low_sun_is_red_and_sets_smoothly() {
        let (high, low) = (clear_beam(60.0, 3.0), clear_beam(3.0, 3.0));
        assert!(low[0] / low[2] > 3.0 * high[0] / high[2], "{low:?} {high:?}");
        assert!((disc_share(0.0) - 0.5).abs() < 1e-6 && disc_share(-0.3) == 0.0 && disc_share(0.3) == 1.0);
        assert!(sky(-0.3, 0.0).sun().is_none());
    }

    #[test]
    fn painted_disc_weights_and_map_agree() {
        let set = PatchSet::new(256).unwrap();
        let model = sky(40.0, 0.4);
        let sun = model.sun().unwrap();
        for height in [64, 512] {
            let gained = model.map_with_sun(height).integral()[1] - model.map(height).integral()[1];
            assert!((gained / f64::from(sun.irradiance[1]) - 1.0).abs() < 1e-3, "{height}: {gained}");
        }
        let direct = model.weights(&set);
        let through_map = crate::split::integrate(&model.map(512), &set, 0.0);
        let (mut off, mut mean) = (0.0, 0.0);
        for (a, b) in direct.radiance.iter().zip(&through_map).take(set.upper()) {
            off += f64::from(luminance(*a) - luminance(*b)).powi(2);
            mean += f64::from(luminance(*b));
        }
        let relative = (off / 256.0).sqrt() / (mean / 256.0);
        assert!(relative < 0.03, "{relative}");
        let ground = direct.radiance[set.upper()][1];
        let expected = 0.2 * direct.horizontal_irradiance(&set)[1] / std::f64::consts::PI;
        assert!((f64::from(ground) / expected - 1.0).abs() < 0.02, "{ground} {expected}");
    }
}
