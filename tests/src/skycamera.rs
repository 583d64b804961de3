//! Simulated exposure series with known truth: what figures of response, radiance and ghosts are measured on.

use relume::camera::recording::Recording;
use relume::camera::synthetic::{Curve, Ghosts, SyntheticCamera, SyntheticSettings};
use relume::camera::{Camera, Exposure, Frame, take_series};
use relume::map::RadianceMap;
use relume::response::Response;
use relume::skymodel::Atmosphere;
use relume::sun::SunPosition;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// A simulated sensor of a known kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// 8 bits, one power law for all channels.
    Power,
    /// 8 bits, three film curves that differ.
    Film,
    /// 8 bits, sRGB in green, power laws of their own in red and blue.
    Mixed,
    /// 12 bits, linear, on a black level.
    Linear,
}

/// All sensors.
pub const SENSORS: [Sensor; 4] = [Sensor::Power, Sensor::Film, Sensor::Mixed, Sensor::Linear];

impl Sensor {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Sensor::Power => "power",
            Sensor::Film => "film",
            Sensor::Mixed => "mixed",
            Sensor::Linear => "linear",
        }
    }

    fn set(self, settings: &mut SyntheticSettings) {
        let film = |exponent, half| Curve::Film { exponent, half };
        settings.curves = match self {
            Sensor::Power => None,
            Sensor::Film => Some([film(0.8, 0.3), film(0.9, 0.4), film(0.75, 0.5)]),
            Sensor::Mixed => Some([Curve::Power { gamma: 1.9 }, Curve::Srgb, Curve::Power { gamma: 2.5 }]),
            Sensor::Linear => Some([Curve::Linear; 3]),
        };
        if self == Sensor::Linear {
            (settings.bits, settings.black) = (12, 0.0625);
        }
    }
}

/// A series and what it was taken of.
pub struct Series {
    /// The frames, by rising exposure.
    pub frames: Vec<Frame>,
    /// The camera, after the series.
    pub camera: SyntheticCamera,
    /// Radiance on the sensor without birds, full-well fractions per second, as of each frame.
    pub truth: Vec<Vec<[f32; 3]>>,
    /// True where ghosts passed.
    pub ghost_mask: Vec<bool>,
}

impl Series {
    /// Writes the frames as files: PNGs, `frames.json`, and the camera's true curve, `curve_truth.csv`.
    ///
    /// # Errors
    /// When there are such files, or one cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), Box<dyn Error>> {
        let mut recording = Recording::open(folder, false)?;
        self.frames.iter().try_for_each(|frame| recording.add(frame))?;
        Response::from_rows(self.camera.response_rows(), "truth")?.save(&folder.join("curve_truth.csv"))?;
        Ok(())
    }
}

/// Exposures from the shortest on, a factor apart.
pub fn exposures(shortest_s: f64, factor: f64, count: i32) -> Vec<Exposure> {
    (0..count).map(|i| Exposure { exposure_s: shortest_s * factor.powi(i), gain: 1.0 }).collect()
}

/// Settings of a sensor under the simulated sky: sun and clouds follow from the seed.
pub fn settings(sensor: Sensor, seed: u64) -> SyntheticSettings {
    let turn = seed as f64 * 137.5;
    let mut settings = SyntheticSettings {
        width: 640,
        height: 480,
        sun: Some(SunPosition { azimuth_deg: turn % 360.0, altitude_deg: 15.0 + turn % 50.0 }),
        atmosphere: Atmosphere { cloud_cover: 0.35, cloud_seed: seed, ..Atmosphere::default() },
        exposure_step_s: 1e-7,
        max_exposure_s: 1e4,
        delay_frames: 2,
        sky_rows: 256,
        seed,
        ..SyntheticSettings::default()
    };
    sensor.set(&mut settings);
    settings
}

/// The same under a captured map, scaled so that its 98th percentile above the horizon has radiance 60.
pub fn under_map(mut settings: SyntheticSettings, path: &Path) -> Option<SyntheticSettings> {
    let mut map = RadianceMap::load(path).ok()?;
    let mut upper: Vec<f32> = map.pixels[..map.pixels.len() / 2].iter().map(|p| p[1]).collect();
    let at = upper.len() * 98 / 100;
    let bright = *upper.select_nth_unstable_by(at, f32::total_cmp).1;
    map.pixels.iter_mut().for_each(|pixel| *pixel = pixel.map(|v| v * 60.0 / bright));
    settings.map = Some(Arc::new(map));
    Some(settings)
}

/// Birds and one cloud whose edge drifts.
pub fn ghosts(seed: u64) -> Ghosts {
    Ghosts { birds: 12, bird_px: 5.0, clouds: 3, cloud_px: 50.0, cloud_px_per_frame: 1.5, seed, ..Ghosts::default() }
}

/// Takes a series.
///
/// # Panics
/// Where the simulated camera gives no frame.
pub fn take(settings: SyntheticSettings, exposures: &[Exposure]) -> Series {
    let mut camera = SyntheticCamera::new(settings);
    let mut frames = Vec::new();
    if let Err(error) = take_series(&mut camera, exposures, &mut frames) {
        panic!("the simulated camera gave no series: {error}");
    }
    let scale = camera.radiance_scale() as f32;
    let fractions = |v: [f32; 3]| v.map(|v| v / scale);
    let of = |frame: &Frame| camera.truth_at_sensor(frame.sequence).into_iter().map(fractions).collect();
    let truth = frames.iter().map(of).collect();
    let sequences: Vec<u64> = frames.iter().map(|frame| frame.sequence).collect();
    let ghost_mask = camera.ghost_mask(&sequences);
    let _ = camera.limits();
    Series { frames, camera, truth, ghost_mask }
}

/// RMS over codes 16..=247 of 255 whose true fraction is above 0.002, and all channels, of ln(found / true), its mean over the codes of a channel taken off; and the
/// largest difference between the channels' means (what a grey would be off in colour).
pub fn response_error(found: impl Fn(f64, usize) -> f64, truth: &[[f64; 4]]) -> (f64, f64) {
    let (mut square, mut means) = (0.0, [0.0f64; 3]);
    let rows = &truth[16..=247];
    let mut count = 0.0;
    for k in 0..3 {
        let seen = rows.iter().filter(|row| row[k + 1] > 2e-3);
        let logs: Vec<f64> = seen.map(|row| (found(row[0], k).max(1e-9) / row[k + 1]).ln()).collect();
        means[k] = logs.iter().sum::<f64>() / logs.len() as f64;
        square += logs.iter().map(|log| (log - means[k]).powi(2)).sum::<f64>();
        count += logs.len() as f64;
    }
    let spread = means.iter().copied().fold(f64::MIN, f64::max) - means.iter().copied().fold(f64::MAX, f64::min);
    ((square / count).sqrt(), spread)
}

/// Median and 95th percentile of relative errors.
pub fn quantiles(mut errors: Vec<f64>) -> [f64; 2] {
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors.get((errors.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    [at(0.5), at(0.95)]
}
