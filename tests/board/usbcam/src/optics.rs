//! What the camera is like and where it stands, and the files that tell the program under test.

use crate::offer::FrameSize;
use relume::camera::synthetic::SyntheticSettings;
use relume::lens::ZENITH_NORTH_UP;
use relume::response::{Response, ResponseError};
use relume::skymodel::Atmosphere;
use relume::sun::Place;
use std::path::Path;

/// Field of view across the smaller side of the picture, degrees.
const FIELD_DEG: f64 = 185.0;
/// Rows of the lat-long map that the sky is seen through.
const SKY_ROWS: usize = 64;
/// Radiance x exposure x gain that fills the well, radiance unit x s: 100 us saturate at 400 (a noon sky has 5 to 100, the
/// sun's disc 2e6), 1 s at gain 8 shows 1e-6 of that (civil twilight has 1e-3).
const FULL_WELL_RADIANCE_S: f64 = 0.04;

/// What is chosen at the start.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    /// Sensor, pixels.
    pub size: FrameSize,
    /// Where it stands.
    pub place: Place,
    /// Share of the sky under cloud, 0..=1.
    pub cloud_cover: f32,
    /// Clouds and noise.
    pub seed: u64,
    /// Time of day at the start, unix seconds.
    pub start_unix_s: f64,
}

/// The synthetic camera behind the USB camera: level, looking at the zenith, north up.
pub fn sensor(scene: &Scene) -> SyntheticSettings {
    SyntheticSettings {
        width: usize::from(scene.size.width),
        height: usize::from(scene.size.height),
        lens: None,
        place: scene.place,
        atmosphere: Atmosphere { cloud_cover: scene.cloud_cover, cloud_seed: scene.seed, ..Atmosphere::default() },
        start_unix_s: scene.start_unix_s,
        full_well_radiance_s: FULL_WELL_RADIANCE_S,
        vignetting: 0.0,
        exposure_step_s: 1e-4,
        max_exposure_s: 10.0,
        delay_frames: 0,
        sky_rows: SKY_ROWS,
        seed: scene.seed,
        ..SyntheticSettings::default()
    }
}

/// `LENS.json` of the sensor.
pub fn lens_json(size: FrameSize) -> String {
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    let focal_px = 0.5 * width.min(height) / (0.5 * FIELD_DEG).to_radians();
    format!(
        "{{\"model\":\"equidistant\",\"focal_px\":{focal_px},\"center_px\":[{},{}],\"camera_to_world\":{:?},\
         \"width\":{},\"height\":{}}}\n",
        0.5 * width,
        0.5 * height,
        ZENITH_NORTH_UP,
        size.width,
        size.height
    )
}

/// The response curve of the sensor, a row per code.
///
/// # Errors
/// [`ResponseError`] for a sensor whose gamma makes no curve.
pub fn response(sensor: &SyntheticSettings) -> Result<Response, ResponseError> {
    let rows = (0..=255).map(|code| f64::from(code) / 255.0).map(|code| {
        let fraction = code.powf(sensor.gamma);
        [code, fraction, fraction, fraction]
    });
    Response::from_rows(rows.collect(), "the sensor's response")
}

/// The table `[camera]` of a post's file for this camera.
pub fn camera_toml(sensor: &SyntheticSettings, lens: Option<&Path>, response: &Path) -> String {
    let lens = lens.map(|path| format!("lens = '{}'\n", path.display())).unwrap_or_default();
    format!("[camera]\n{lens}response = '{}'\nradiance_scale = {}\n", response.display(), sensor.full_well_radiance_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::camera::synthetic::SyntheticCamera;
    use relume::lens::Lens;

    fn scene() -> Scene {
        Scene {
            size: "64x48".parse().unwrap(),
            place: Place { latitude_deg: 48.0, longitude_deg: 11.0 },
            cloud_cover: 0.3,
            seed: 4,
            start_unix_s: 1.78e9,
        }
    }

    #[test]
    fn the_lens_file_is_the_synthetic_cameras_lens() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lens.json");
        std::fs::write(&path, lens_json(scene().size)).unwrap();
        let (loaded, camera) = (Lens::load(&path).unwrap(), SyntheticCamera::new(sensor(&scene())));
        assert_eq!(loaded.size(), Some((64, 48)));
        for at in [[32.0, 24.0], [20.5, 10.5], [50.0, 24.0]] {
            let (a, b) = (loaded.unproject(at).unwrap(), camera.lens().unproject(at).unwrap());
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{at:?}: {a:?} {b:?}");
        }
        // Zenith in the middle, the horizon at 90 / 92.5 of half the smaller side, north up.
        let north = loaded.project([0.0, 0.0, -1.0]).unwrap();
        assert!((north[0] - 32.0).abs() < 1e-9 && (north[1] - (24.0 - 24.0 * 90.0 / 92.5)).abs() < 1e-9, "{north:?}");
    }

    #[test]
    fn the_curve_file_is_the_sensors_power_law() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.csv");
        response(&sensor(&scene())).unwrap().save(&path).unwrap();
        let loaded = Response::load(&path).unwrap();
        for (code, channel) in [(0.0, 0), (51.0 / 255.0, 1), (0.8, 2), (1.0, 1)] {
            assert!((loaded.fraction(code, channel) - code.powf(2.2)).abs() < 1e-5, "{code}");
        }
        let toml = camera_toml(&sensor(&scene()), Some(Path::new("l.json")), &path);
        assert!(toml.contains("lens = 'l.json'\n") && toml.contains("radiance_scale = 0.04\n"), "{toml}");
    }
}
