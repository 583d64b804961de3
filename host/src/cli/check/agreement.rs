//! Whether the sky camera's exposures agree, by the response curve that the post's file names, and its sun with the ephemeris, by the
//! lens.

use super::Table;
use crate::bracket::{MergeSettings, Merged, Merger};
use crate::camera::series::Series;
use crate::camera::{Camera, CameraError, CameraLimits, Exposure};
use crate::capture::{Capture, CaptureSettings};
use crate::config::Config;
use crate::lens::Lens;
use crate::relight::FieldFile;
use crate::response::Response;
use crate::sky_source::agreement::{Usual, disagreement, sun_astray};
use crate::sun::{Place, sun_position};
use relume_firmware::patches::PatchSet;

/// Series of a recording that are looked at, most.
pub(super) const RECORDED: usize = 32;
/// Series that a real camera takes.
#[cfg(feature = "board")]
pub(super) const TAKEN: usize = 12;

/// Merges up to `count` series of these exposures and adds a line when they tell anything; frames that cannot be read are a
/// fault, those that do not come are none.
pub(super) fn exposures(
    config: &Config,
    lens: Option<&Lens>,
    (camera, exposures): (&mut dyn Camera, &[Exposure]),
    count: usize,
    table: &mut Table,
) {
    // A curve that cannot be read has a line of its own.
    let Ok(response) = config.camera.response.as_ref().map(|path| Response::load(path)).transpose() else { return };
    let settings = MergeSettings { response: response.unwrap_or_default(), ..MergeSettings::default() };
    let (mut merger, mut merged) = (Merger::new(settings), Merged::default());
    let (mut series, mut agreement) = (Series::default(), Usual::default());
    let mut sun = lens.and_then(|lens| SunWatch::new(config, lens, camera.limits()));
    for _ in 0..count {
        match series.take(camera, exposures) {
            Err(error @ CameraError::Recording { .. }) => {
                table.add("exposures", Err::<((), String), _>(error));
                return;
            }
            Err(_) => break,
            Ok(()) => {}
        }
        if merger.merge(series.frames(), &mut merged).is_ok() {
            agreement.add(merger.report().slope);
            sun.iter_mut().for_each(|watch| watch.look(&merged));
        }
    }
    if let Some(words) = sun.and_then(|mut watch| sun_astray(watch.astray_deg.median())) {
        table.advise("sun", words);
    }
    let Some(slope) = agreement.median() else { return };
    match disagreement(Some(slope), config.camera.response.is_some()) {
        Some(words) => table.advise("exposures", words),
        None => {
            let percent = 100.0 * (slope.abs() * std::f64::consts::LN_2).exp_m1();
            table.say("exposures", format!("they agree within {percent:.1} % per stop"));
        }
    }
}

/// Patches of the capture by which the sun is looked for: their number does not matter.
const PATCHES: usize = 64;

/// Where the sun stands in series of a camera whose place is known.
struct SunWatch {
    capture: Capture,
    place: Place,
    astray_deg: Usual,
}

impl SunWatch {
    /// None without a place, or where lens and pictures do not fit, which has a line of its own.
    fn new(config: &Config, lens: &Lens, limits: CameraLimits) -> Option<Self> {
        let place = config.site?.place;
        let field = FieldFile::open(&config.field).ok();
        let north_deg = field.map_or(0.0, |file| f64::from(file.field().camera().north_deg));
        let settings = CaptureSettings { north_deg, ..CaptureSettings::default() };
        let set = PatchSet::new(PATCHES).ok()?;
        let capture = Capture::new(lens, (limits.width, limits.height), set, settings, None).ok()?;
        Some(SunWatch { capture, place, astray_deg: Usual::default() })
    }

    /// Series without a time tell nothing.
    fn look(&mut self, merged: &Merged) {
        let sun = (merged.captured_at_s > 0.0).then(|| sun_position(merged.captured_at_s, self.place).ok()).flatten();
        self.astray_deg.add(sun.and_then(|sun| self.capture.sun_astray_deg(merged, sun)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::recording::Recording;
    use crate::camera::replay::ReplayCamera;
    use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
    use std::path::Path;

    /// Nine series of a simulated camera over a clear June noon; its curve beside them.
    fn record(folder: &Path) -> Lens {
        let settings = SyntheticSettings { width: 96, height: 96, sky_rows: 64, ..SyntheticSettings::default() };
        let start_unix_s = settings.start_unix_s;
        let mut camera = SyntheticCamera::new(settings);
        let mut recording = Recording::open(&folder.join("frames"), false).unwrap();
        let exposures = [1e-4, 8e-4, 6.4e-3].map(|exposure_s| Exposure { exposure_s, gain: 1.0 });
        let mut series = Series::default();
        for number in 0..9 {
            camera.set_time(start_unix_s + 60.0 * f64::from(number));
            series.take(&mut camera, &exposures).unwrap();
            series.frames().iter().for_each(|frame| recording.add(frame).unwrap());
        }
        Response::from_rows(camera.response_rows(), "its own").unwrap().save(&folder.join("r.csv")).unwrap();
        camera.lens().clone()
    }

    fn told(folder: &Path, response: &str, lens: &Lens) -> String {
        let file = folder.join("POST.toml");
        let text = format!(
            "field = 'a'\nsky = 'replay'\n[site]\nlatitude = 48.0\nlongitude = 11.0\n[camera]\nframes = 'frames'\n\
             lens = 'l'\n{response}\n[display]\nkind = 'headless'\nfolder = 'o'\n"
        );
        std::fs::write(&file, text).unwrap();
        let config = Config::load(&file).unwrap();
        let mut camera = ReplayCamera::open(&folder.join("frames"), false).unwrap();
        let (series, mut table) = (camera.series(), Table::default());
        exposures(&config, Some(lens), (&mut camera, &series), RECORDED, &mut table);
        table.text()
    }

    #[test]
    fn a_curve_and_a_lens_that_are_not_the_cameras_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let lens = record(folder.path());
        let well = told(folder.path(), "response = 'r.csv'", &lens);
        assert!(well.starts_with("ok   exposures") && well.lines().count() == 1, "{well}");
        let linear = told(folder.path(), "", &lens);
        assert!(linear.starts_with("see  exposures") && linear.contains("camera.response is missing"), "{linear}");
        let turned = lens.turned([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]);
        let told = told(folder.path(), "response = 'r.csv'", &turned);
        assert!(told.contains("see  sun") && told.contains("camera.lens"), "{told}");
    }
}
