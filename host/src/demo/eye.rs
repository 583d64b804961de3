//! The sky camera of the demo: exposure series of the synthetic camera -> weights, with the truth beside them.

use relume_firmware::patches::PatchSet;

use crate::bracket::MergeSettings;
use crate::camera::Camera;
use crate::camera::synthetic::{Glare, SyntheticCamera, SyntheticSettings};
use crate::capture::{Capture, CaptureSettings};
use crate::failure::{Failure, OrFail};
use crate::lightmeter::LightMeter;
use crate::response::Response;
use crate::skymodel::{Atmosphere, SkyModel};
use crate::sun::{Place, SunPosition, sun_position};
use crate::weights::PatchWeights;

const PIXELS: usize = 240;

/// Looks at the sky of a place.
pub(super) struct Eye {
    camera: SyntheticCamera,
    meter: LightMeter,
    capture: Capture,
    place: Place,
}

/// What was seen, and what there was to see.
pub(super) struct Seen {
    pub weights: PatchWeights,
    pub truth: SkyModel,
    pub sun: SunPosition,
}

impl Eye {
    /// A camera that looks at the zenith under `atmosphere`, for weights of `patches`.
    pub fn new(place: Place, atmosphere: Atmosphere, patches: PatchSet, unix_s: f64) -> Result<Self, Failure> {
        let settings = SyntheticSettings {
            width: PIXELS,
            height: PIXELS,
            place,
            atmosphere,
            start_unix_s: unix_s,
            glare: Glare::usual(PIXELS),
            ..SyntheticSettings::default()
        };
        let camera = SyntheticCamera::new(settings);
        let curve = camera.response_curve();
        let rows = curve.iter().enumerate().map(|(code, &f)| [code as f64 / 255.0, f, f, f]).collect();
        let response = Response::from_rows(rows, "the synthetic camera's response").or_runtime()?;
        let capture = CaptureSettings {
            radiance_scale: camera.radiance_scale(),
            ground_albedo: atmosphere.ground_albedo,
            turbidity: atmosphere.turbidity,
            north_deg: 0.0,
        };
        Ok(Eye {
            meter: LightMeter::merging(camera.limits(), MergeSettings { response, ..MergeSettings::default() }),
            capture: Capture::new(camera.lens(), (PIXELS, PIXELS), patches, capture, None).or_runtime()?,
            camera,
            place,
        })
    }

    /// One series at a moment (Unix seconds); more while the exposures do not fit the light yet.
    pub fn look(&mut self, unix_s: f64) -> Result<Seen, Failure> {
        let merged = self.meter.look(&mut self.camera, |camera| {
            camera.set_time(unix_s);
            camera
        });
        let merged = merged.or_runtime()?;
        let sun = sun_position(unix_s, self.place).or_runtime()?;
        let weights = self.capture.weights(merged, Some(sun)).or_runtime()?.weights;
        Ok(Seen { weights, truth: self.camera.sky().clone(), sun })
    }
}
