//! A proposal for the sky camera's mask: what is below the horizon, and what stays dark beside the sky.
//!
//! In every frame a pixel counts as bright when it has at least [`BRIGHT`] of the light that most pixels of its altitude have
//! (the upper quartile of a band of 10 degrees, but no less than 0.6 of the band above, which an obstructed horizon needs).
//! What is bright in two of five frames is sky: the darkest part of a clear sky moves with the sun, walls and trees stay.
//! Sunlit walls and snow may pass for sky: the proposal is to be looked at and painted over.

use crate::lens::Lens;
use crate::lens::mask::SkyMask;
use crate::quantile::{median, quantile};

const BANDS: usize = 9;
/// Share of a band's light.
const BRIGHT: f32 = 0.35;
const BAND_ABOVE: f32 = 0.6;
/// Share of frames.
const OFTEN: f64 = 0.4;
/// Frames from which on obstacles are proposed.
const MIN_FRAMES: u32 = 3;
/// Median light between which a frame tells sky from walls.
const EXPOSED: std::ops::RangeInclusive<f32> = 0.04..=0.9;

/// Looks for obstacles in frames of one lens.
pub struct ObstacleFinder {
    size: (usize, usize),
    /// Band of altitude per pixel; none below the horizon or where the lens images nothing.
    bands: Vec<Option<u8>>,
    bright: Vec<u32>,
    frames: u32,
}

impl ObstacleFinder {
    /// For a lens and its picture's size.
    pub fn new(lens: &Lens, (width, height): (usize, usize)) -> Self {
        let band = |pixel: usize| {
            let dir = lens.unproject([(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5])?;
            let altitude_deg = dir[1].clamp(-1.0, 1.0).asin().to_degrees();
            (altitude_deg >= 0.0).then(|| ((altitude_deg / 10.0) as u8).min(BANDS as u8 - 1))
        };
        let bands = (0..width * height).map(band).collect();
        ObstacleFinder { size: (width, height), bands, bright: vec![0; width * height], frames: 0 }
    }

    /// Takes in a daylight frame's linear light per pixel; too bright and too dark ones are passed over.
    pub fn add(&mut self, light: &[f32]) {
        let mut values: Vec<Vec<f32>> = vec![Vec::new(); BANDS];
        for (&value, band) in light.iter().zip(&self.bands) {
            if let Some(band) = band {
                values[usize::from(*band)].push(value);
            }
        }
        let mut all: Vec<f32> = values.iter().flatten().copied().collect();
        if !median(&mut all).is_some_and(|median| EXPOSED.contains(&median)) {
            return;
        }
        let mut needed = [0.0; BANDS];
        let mut above = 0.0;
        for (band, mut values) in values.into_iter().enumerate().rev() {
            above = quantile(&mut values, 0.75).unwrap_or(0.0).max(BAND_ABOVE * above);
            needed[band] = BRIGHT * above;
        }
        for ((bright, &value), band) in self.bright.iter_mut().zip(light).zip(&self.bands) {
            *bright += u32::from(band.is_some_and(|band| value >= needed[usize::from(band)]));
        }
        self.frames += 1;
    }

    /// The proposal, and how many frames told of obstacles (0: only the horizon is masked).
    pub fn propose(self) -> (SkyMask, u32) {
        let (width, height) = self.size;
        let frames = if self.frames >= MIN_FRAMES { self.frames } else { 0 };
        let least = (OFTEN * f64::from(frames)).ceil() as u32;
        let sky: Vec<bool> = self.bright.iter().map(|&bright| bright >= least).collect();
        // Single pixels are noise: most of the nine around decide.
        let smooth = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
            let around =
                rows.flat_map(|row| (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |col| row * width + col));
            let (yes, all) = around
                .filter(|&near| self.bands[near].is_some())
                .fold((0, 0), |(yes, all), near| (yes + usize::from(sky[near]), all + 1));
            2 * yes > all
        };
        (SkyMask::from_fn(width, height, |pixel| self.bands[pixel].is_some() && smooth(pixel)), frames)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skymodel::{Atmosphere, SkyModel};
    use crate::sun::SunPosition;

    #[test]
    fn a_dark_house_and_a_tree_are_proposed_and_a_clear_sky_is_not() {
        let lens = Lens::zenith_equidistant(120, 120, 190.0);
        let at = |pixel: usize| lens.unproject([(pixel % 120) as f64 + 0.5, (pixel / 120) as f64 + 0.5]);
        // A house to the east up to 25 degrees, a trunk of 6 degrees to the south-west up to 50, half as bright as the ground.
        let blocked = |d: [f64; 3]| {
            let (azimuth, altitude) = (d[0].atan2(-d[2]).to_degrees(), d[1].asin().to_degrees());
            (azimuth - 90.0).abs() < 35.0 && altitude < 25.0 || (azimuth + 135.0).abs() < 3.0 && altitude < 50.0
        };
        let mut finder = ObstacleFinder::new(&lens, (120, 120));
        for hour in 0..9 {
            let sun = SunPosition {
                azimuth_deg: 90.0 + 22.0 * f64::from(hour),
                altitude_deg: 12.0 + 5.0 * f64::from(4 - (hour - 4_i32).abs()),
            };
            let sky = SkyModel::new(Atmosphere::default(), sun, 0.0, 0.0);
            let mean: f32 = sky.weights(&relume_firmware::patches::PatchSet::new(64).unwrap()).radiance[..64]
                .iter()
                .map(|v| v[1])
                .sum::<f32>()
                / 64.0;
            let dark = 0.5 * sky.ground_radiance()[1];
            let light = |pixel: usize| {
                at(pixel).map_or(0.0, |d| {
                    let value = if d[1] < 0.0 || blocked(d) { dark } else { sky.radiance(d.map(|c| c as f32))[1] };
                    (0.25 * value / mean).min(1.0)
                })
            };
            finder.add(&(0..120 * 120).map(light).collect::<Vec<_>>());
        }
        let (mask, frames) = finder.propose();
        assert_eq!(frames, 9);
        let (mut wrong, mut all, mut hidden) = (0, 0, 0);
        for pixel in 0..120 * 120 {
            let truth = at(pixel).is_some_and(|d| d[1] >= 0.0 && !blocked(d));
            wrong += usize::from(truth != mask.is_sky(pixel));
            hidden += usize::from(truth && !mask.is_sky(pixel));
            all += usize::from(truth);
        }
        println!("{wrong} pixels of {all} wrong, of these {hidden} of the sky");
        assert!(wrong * 50 < all, "{wrong} of {all}");
    }

    #[test]
    fn without_frames_only_the_horizon_is_masked() {
        let lens = Lens::zenith_equidistant(60, 60, 190.0);
        let (mask, frames) = ObstacleFinder::new(&lens, (60, 60)).propose();
        assert_eq!(frames, 0);
        assert!(mask.is_sky(30 * 60 + 30) && !mask.is_sky(0));
    }
}
