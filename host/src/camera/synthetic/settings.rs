//! What the synthetic camera is like and where it stands.

use super::{Curve, Ghosts, Glare};
use crate::lens::Lens;
use crate::map::RadianceMap;
use crate::skymodel::Atmosphere;
use crate::sun::{Place, SunPosition};
use std::sync::Arc;

/// A camera whose filters have Rec.709 primaries.
pub const REC709: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// What the synthetic camera is like and where it stands.
#[derive(Clone, Debug)]
pub struct SyntheticSettings {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Lens and orientation; an equidistant one of 185 degrees that looks at the zenith if none.
    pub lens: Option<Lens>,
    /// Where it stands.
    pub place: Place,
    /// Where north lies, degrees from -Z towards +X.
    pub north_deg: f64,
    /// Air, clouds and ground.
    pub atmosphere: Atmosphere,
    /// A sun position that overrules time and place.
    pub sun: Option<SunPosition>,
    /// A radiance map that overrules the sky model (the sun is what the map shows of it).
    pub map: Option<Arc<RadianceMap>>,
    /// Time of the first frame, unix seconds.
    pub start_unix_s: f64,
    /// Time between frames, seconds.
    pub frame_interval_s: f64,
    /// Radiance x exposure x gain that fills the well, radiance unit x s.
    pub full_well_radiance_s: f64,
    /// Electrons of a full well.
    pub full_well_electrons: f64,
    /// Read noise, electrons rms.
    pub read_noise_electrons: f64,
    /// Code = 255 x fraction^(1 / gamma).
    pub gamma: f64,
    /// Response curves of red, green and blue that overrule `gamma`.
    pub curves: Option<[Curve; 3]>,
    /// Black level, share of the largest code.
    pub black: f64,
    /// Bits of a code, 8..=16; above 8 the codes are spread over 16 bits.
    pub bits: u32,
    /// Rows: what red, green and blue of the camera see of Rec.709 red, green and blue.
    pub camera_from_rec709: [[f64; 3]; 3],
    /// Share of light lost at 90 degrees off the axis, falling off with the square of the angle.
    pub vignetting: f64,
    /// Light scattered in lens and housing.
    pub glare: Glare,
    /// What passes before the sky.
    pub ghosts: Ghosts,
    /// Shortest exposure and step of exposure times, seconds.
    pub exposure_step_s: f64,
    /// Longest exposure, seconds.
    pub max_exposure_s: f64,
    /// Frames until a request shows.
    pub delay_frames: u32,
    /// Share of frames that never arrive; the sequence number shows the gap.
    pub dropped_share: f64,
    /// Share of frames in whose place the one before is handed out again.
    pub repeated_share: f64,
    /// Rows of the lat-long map through which the sky is seen; fewer are quicker and blur the clouds.
    pub sky_rows: usize,
    /// Noise.
    pub seed: u64,
}

impl Default for SyntheticSettings {
    fn default() -> Self {
        SyntheticSettings {
            width: 480,
            height: 480,
            lens: None,
            place: Place { latitude_deg: 48.0, longitude_deg: 11.0 },
            north_deg: 0.0,
            atmosphere: Atmosphere::default(),
            sun: None,
            map: None,
            start_unix_s: 1_782_043_200.0,
            frame_interval_s: 1.0 / 30.0,
            full_well_radiance_s: 0.04,
            full_well_electrons: 10_000.0,
            read_noise_electrons: 5.0,
            gamma: 2.2,
            curves: None,
            black: 0.0,
            bits: 8,
            camera_from_rec709: REC709,
            vignetting: 0.0,
            glare: Glare::default(),
            ghosts: Ghosts::default(),
            exposure_step_s: 1e-4,
            max_exposure_s: 0.5,
            delay_frames: 2,
            dropped_share: 0.0,
            repeated_share: 0.0,
            sky_rows: 128,
            seed: 1,
        }
    }
}

impl SyntheticSettings {
    /// The response curves of red, green and blue.
    pub fn curves(&self) -> [Curve; 3] {
        self.curves.unwrap_or([Curve::Power { gamma: self.gamma }; 3])
    }
}
