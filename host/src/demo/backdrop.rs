//! The view of the demo: what a camera would see behind the site, painted from the same sky model.
//!
//! A real post has a still or a second camera for this. Here the sky of the moment stands above the horizon and the sea
//! below it, which mirrors the sky by Fresnel's law for waves seen at a low angle and fades into the haze.

use rayon::prelude::*;
use relume_bake::camera::Camera;

use crate::map::luminance;
use crate::picture::srgb_code;
use crate::skymodel::SkyModel;

/// Height of the eye above the sea, m; sets how far away the water below the horizon is.
const ABOVE_SEA_M: f32 = 45.0;
/// Distance over which haze takes all but 1/e of what is behind it, m.
const HAZE_M: f32 = 9_000.0;
/// Reflectance of what comes up out of the water.
const WATER: [f32; 3] = [0.012, 0.030, 0.042];

/// Pixels `0x00RRGGBB` of the view; `gains` are the exposure factors of red, green and blue.
pub(super) fn paint(sky: &SkyModel, camera: &Camera, (width, height): (u32, u32), gains: [f32; 3]) -> Vec<u32> {
    let view = camera.view(width, height);
    let pixel = |index: u32| {
        let (x, y) = (index % width, index / width);
        let Some(direction) = view.direction(x as f32 + 0.5, y as f32 + 0.5) else { return 0 };
        let direction = direction.to_array();
        let radiance = if direction[1] >= 0.0 { sky.radiance(direction) } else { sea(sky, direction) };
        let code = |channel: usize| {
            // Half a code of noise: a clear sky changes too slowly for 8 bits.
            let exact = f64::from(radiance[channel] * gains[channel]);
            let (low, high) = (srgb_code(exact * 0.995), srgb_code(exact * 1.005 + 1e-4));
            u32::from(if dither(x, y, channel as u32) { high } else { low })
        };
        code(0) << 16 | code(1) << 8 | code(2)
    };
    (0..width * height).into_par_iter().map(pixel).collect()
}

/// The largest exposure that leaves the brighter part of the visible sky on the display: 1.2 / the 75th percentile of
/// its luminance over a coarse grid.
pub(super) fn most_exposure(sky: &SkyModel, camera: &Camera, (width, height): (u32, u32)) -> f64 {
    let view = camera.view(width, height);
    let direction = |index: u32| {
        let (x, y) = (index % 24 * width / 24, index / 24 * height / 16);
        Some(view.direction(x as f32, y as f32)?.to_array())
    };
    let above = (0..24 * 16).filter_map(direction).filter(|direction| direction[1] > 0.0);
    let mut values: Vec<f32> = above.map(|direction| luminance(sky.radiance(direction))).collect();
    values.sort_by(f32::total_cmp);
    let bright = values.get(values.len() * 3 / 4).copied().unwrap_or(0.0);
    1.2 / f64::from(bright.max(f32::MIN_POSITIVE))
}

fn sea(sky: &SkyModel, direction: [f32; 3]) -> [f32; 3] {
    let below = -direction[1];
    // Waves lean the mirror towards the viewer, so that it shows a higher part of the sky.
    let up = (below + 0.16).min(1.0);
    let level = direction[0].hypot(direction[2]).max(1e-6);
    let across = (1.0 - up * up).sqrt() / level;
    let mirrored = sky.radiance([direction[0] * across, up, direction[2] * across]);
    let horizon = sky.radiance([direction[0] / level, 0.004, direction[2] / level]);
    let fresnel = 0.02 + 0.98 * (1.0 - (below + 0.10).min(1.0)).powi(5);
    let haze = 1.0 - (-ABOVE_SEA_M / (below.max(1e-5) * HAZE_M)).exp();
    let irradiance = sky.horizontal_irradiance();
    std::array::from_fn(|k| {
        let water = fresnel * mirrored[k] + WATER[k] * irradiance[k] / std::f32::consts::PI;
        water + (horizon[k] - water) * haze
    })
}

/// A fair coin per pixel and channel.
fn dither(x: u32, y: u32, channel: u32) -> bool {
    let mut bits = x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b) ^ channel.wrapping_mul(0xc2b2_ae35);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x2c1b_3c6d);
    bits = (bits ^ (bits >> 12)).wrapping_mul(0x297a_2d39);
    (bits ^ (bits >> 15)) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skymodel::Atmosphere;
    use crate::sun::SunPosition;

    #[test]
    fn the_sky_is_blue_above_and_the_sea_darker_below() {
        let sun = SunPosition { azimuth_deg: 180.0, altitude_deg: 45.0 };
        let sky = SkyModel::new(Atmosphere::default(), sun, 0.0, 0.0);
        let (position, target) = ([0.0, 3.0, 0.0], [0.0, 3.0, -10.0]);
        let camera = Camera { position, target, up: [0.0, 1.0, 0.0], fov_y_deg: 60.0, north_deg: 0.0, optics: None };
        let pixels = paint(&sky, &camera, (8, 32), [0.008; 3]);
        let [_, red, _, blue] = pixels[3].to_be_bytes();
        assert!(blue > red + 20, "{red} {blue}");
        let green = |row: usize| pixels[row * 8 + 3].to_be_bytes()[2];
        assert!(green(31) < green(14), "{} {}", green(31), green(14));
    }
}
