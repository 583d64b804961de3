//! The response of the study's view camera: an S-shaped curve over a power law, another in each channel, far from sRGB.

use std::path::Path;

use crate::failure::{Failure, OrFail};
use crate::response::Response;

/// Exponents of the power law.
const POWERS: [f64; 3] = [2.0, 2.2, 2.4];
/// Share of the S in the curve.
const S_SHARE: f64 = 0.4;
/// Halvings after which an inverse is exact to f64.
const HALVINGS: u32 = 52;

/// Linear light (full well = 1) of code / 255 in a channel; rises from 0 to 1.
pub(super) fn light(code: f64, channel: usize) -> f64 {
    let s = (code * code * (3.0 - 2.0 * code)).powf(1.3);
    (1.0 - S_SHARE) * code.powf(POWERS[channel]) + S_SHARE * s
}

/// The code that linear light of a channel is rendered as; what is brighter than full well is clipped.
pub(super) fn code(linear: f64, channel: usize) -> u8 {
    let wanted = linear.clamp(0.0, 1.0);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if light(middle, channel) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    (255.0 * high).round() as u8
}

/// Writes the curve file of the camera, as a calibration without error would.
pub(super) fn save(path: &Path) -> Result<(), Failure> {
    let row = |code: u32| {
        let code = f64::from(code) / 255.0;
        [code, light(code, 0), light(code, 1), light(code, 2)]
    };
    let curve = Response::from_rows((0..=255).map(row).collect(), "the view camera's response").or_runtime()?;
    curve.save(path).or_runtime()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::srgb_linear;

    #[test]
    fn codes_come_back_and_the_curve_is_far_from_srgb() {
        for channel in 0..3 {
            assert!((0..=255u8).all(|k| code(light(f64::from(k) / 255.0, channel), channel) == k), "{channel}");
            assert_eq!((code(-0.1, channel), code(1.7, channel)), (0, 255));
            // Taken for sRGB a mid grey would be wrong by a quarter.
            assert!(light(0.5, channel) / srgb_linear(128) > 1.25);
        }
    }
}
