use super::*;
use crate::camera::CameraLimits;
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::sky_source::simulated::SimulatedSky;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

#[test]
fn a_synthetic_camera_measures_the_sky_it_stands_under() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("POST.toml");
    let text = "field = 'a'\nsky = 'synthetic'\n[site]\nlatitude = 48.0\nlongitude = 11.0\n\
                [display]\nkind = 'headless'\nfolder = 'o'\n";
    std::fs::write(&file, text).unwrap();
    let config = Config::load(&file).unwrap();
    let set = PatchSet::new(64).unwrap();
    let mut camera = CapturedSky::open(&config, set, 0.0).unwrap();
    let mut model = SimulatedSky::new(config.site.unwrap(), config.weather, set, 0.0);
    // Afternoon in June, then dusk: the exposures must follow over many stops.
    for unix_s in [1_782_052_000.0, 1_782_072_500.0] {
        let moment = Moment { unix_s, trusted: true };
        let (mut seen, mut truth) = (SkyReading::default(), SkyReading::default());
        camera.read(moment, &mut seen).unwrap();
        model.read(moment, &mut truth).unwrap();
        let mean = |r: &SkyReading| r.weights.radiance[..64].iter().map(|v| f64::from(v[1])).sum::<f64>();
        let ratio = mean(&seen) / mean(&truth);
        assert!((ratio - 1.0).abs() < 0.05, "{unix_s}: {ratio}");
        assert_eq!(seen.weights.sun.is_some(), truth.weights.sun.is_some(), "{unix_s}");
    }
    // Without the time there is no place for the sun.
    let mut reading = SkyReading::default();
    camera.read(Moment { unix_s: 1_782_052_000.0, trusted: false }, &mut reading).unwrap();
    assert!(reading.weights.sun.is_none());
}

/// A camera whose lens may be covered.
struct Capped(SyntheticCamera, Arc<AtomicBool>);

impl Camera for Capped {
    fn limits(&self) -> CameraLimits {
        self.0.limits()
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        self.0.request(exposure)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        self.0.frame(into)?;
        if self.1.load(Ordering::Relaxed) {
            into.codes_u8(into.width, into.height).fill(2);
        }
        Ok(())
    }
}

/// A post's file for a camera of 64x64 pixels.
fn real_camera(folder: &Path) -> Config {
    let lens = format!(
        r#"{{"model":"equidistant","focal_px":20,"center_px":[32,32],"width":64,"height":64,"camera_to_world":{:?}}}"#,
        crate::lens::ZENITH_NORTH_UP
    );
    std::fs::write(folder.join("lens.json"), lens).unwrap();
    let file = folder.join("POST.toml");
    let text = "field = 'a'\nsky = 'camera'\n[site]\nlatitude = 48.0\nlongitude = 11.0\n[camera]\ndevice = '/dev/null'\n\
                lens = 'lens.json'\n[display]\nkind = 'headless'\nfolder = 'o'\n";
    std::fs::write(&file, text).unwrap();
    Config::load(&file).unwrap()
}

#[test]
fn a_cap_on_the_lens_by_day_is_no_night() {
    let folder = tempfile::tempdir().unwrap();
    let config = real_camera(folder.path());
    let is_capped = Arc::new(AtomicBool::new(false));
    let noon = SunPosition { azimuth_deg: 180.0, altitude_deg: 60.0 };
    let (width, height, sun) = (64, 64, Some(noon));
    let synthetic = SyntheticCamera::new(SyntheticSettings { width, height, sun, ..SyntheticSettings::default() });
    let camera = Box::new(Capped(synthetic, Arc::clone(&is_capped)));
    let mut sky = CapturedSky::with_camera(camera, &config, PatchSet::new(64).unwrap(), 0.0).unwrap();
    let day = Moment { unix_s: 1_782_036_000.0, trusted: true };
    let (night, lost) = (Moment { unix_s: day.unix_s + 43_200.0, ..day }, Moment { trusted: false, ..day });
    let mut reading = SkyReading::default();
    // Exposures settle.
    (0..2).for_each(|_| assert!(sky.read(day, &mut reading).is_ok()));
    let before = reading.weights.radiance[0][1];
    is_capped.store(true, Ordering::Relaxed);
    let told = (0..10).map(|_| sky.read(day, &mut reading)).find(|read| !matches!(read, Ok(false))).unwrap();
    assert!(told.unwrap_err().to_string().contains("cap on the lens"));
    assert!(sky.read(day, &mut reading).is_err(), "and it stays told");
    for dark in [night, lost] {
        assert!(sky.read(dark, &mut reading).unwrap(), "who knows that it is day?");
    }
    is_capped.store(false, Ordering::Relaxed);
    // The first pictures are white, because exposures were the longest: they are no light.
    assert!((0..10).any(|_| sky.read(day, &mut reading).is_ok_and(|new| new)));
    let light = reading.weights.radiance[0][1];
    // Other exposures of a camera whose curve is not known tell another light.
    assert!((0.5..2.0).contains(&(light / before)), "{before} before the cap, {light} after it");
}
