//! What the sky camera sees to weights: every valid pixel's solid angle counts once, the rest is filled and counted.
//!
//! - What vignetting took is given back, and the camera's colours become Rec.709; pixels that the lens's mask leaves out are
//!   no sky.
//! - A pixel's solid angle goes to the patches its 2x2 sub-samples fall in; the lens's exact Jacobian gives its size.
//! - Patches of which less than a quarter was seen are filled from a smooth sky (real spherical harmonics up to order 2,
//!   least squares over the seen patches).
//! - The sun's place is the ephemeris'. What stands above the in-painted sky within 1 degree of it is taken out of the
//!   patches. Its irradiance is that excess where no pixel of it is clipped, else the clear-sky model's, scaled by the
//!   lower quartile of measured over modelled patch luminance (clouds are brighter than the clear sky behind them).
//! - The lower hemisphere, which the camera does not see, is ground albedo x horizontal irradiance / pi.

mod intake;

use crate::bracket::{Merged, PixelState};
use crate::colour::CameraColour;
use crate::lens::Lens;
use crate::map::luminance;
use crate::skymodel::{Atmosphere, SkyModel, clear_beam};
use crate::split::{MIN_DISC_CONTRAST, MIN_IRRADIANCE_SHARE, SUN_RADIUS_DEG};
use crate::sun::{SunPosition, dir_world};
use crate::weights::{PatchWeights, SunWeight, sun_solid_angle_sr};
use intake::Intake;
use relume_firmware::patches::PatchSet;

/// Share of a patch that must have been seen.
const SEEN_SHARE: f64 = 0.25;
/// A clipped pixel at the sun's place shows the sun if it is at least this much brighter than the sky around it.
const CLIPPED_CONTRAST: f64 = 3.0;

/// What the capture must know besides the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureSettings {
    /// Radiance of one full-well fraction per second, in the unit the weights shall have.
    pub radiance_scale: f64,
    /// RGB albedo of the ground, 0..1.
    pub ground_albedo: [f32; 3],
    /// Turbidity of the clear-sky model for a clipped sun.
    pub turbidity: f32,
    /// Where north lies, degrees from -Z towards +X.
    pub north_deg: f64,
}

impl Default for CaptureSettings {
    fn default() -> Self {
        CaptureSettings { radiance_scale: 1.0, ground_albedo: [0.2; 3], turbidity: 3.0, north_deg: 0.0 }
    }
}

/// Where the sun's weight comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SunSource {
    /// No position was given; the sun, if seen, stays in the patches.
    NoPosition,
    /// The sun is below the horizon.
    BelowHorizon,
    /// Nothing stands out where the sun is.
    Covered,
    /// Measured from pixels that are not clipped.
    Measured,
    /// Clear-sky model scaled by what the sky shows; pixels of the disc are clipped.
    ClearSkyModel,
}

/// Weights of one series and what they rest on.
#[derive(Clone, Debug, PartialEq)]
pub struct Captured {
    /// The weights.
    pub weights: PatchWeights,
    /// Where the sun comes from.
    pub sun_source: SunSource,
    /// Upper patches filled from the smooth sky.
    pub filled_patches: usize,
    /// Pixels above the horizon that were clipped in every frame, the sun's not counted.
    pub clipped_pixels: usize,
}

/// Why a picture cannot become weights; one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CaptureError {
    /// Lens file and picture differ in size.
    #[error("the lens is for {lens_width}x{lens_height} pixels; the camera gives {width}x{height}")]
    Size {
        /// Width the lens is for.
        lens_width: usize,
        /// Height the lens is for.
        lens_height: usize,
        /// Width of the picture.
        width: usize,
        /// Height of the picture.
        height: usize,
    },
    /// No pixel looks above the horizon.
    #[error("no unmasked pixel looks above the horizon; check camera_to_world and the mask")]
    NoSky,
}

/// The part of a pixel's solid angle that lies in a patch.
#[derive(Clone, Copy)]
struct Share {
    pixel: u32,
    patch: u16,
    omega: f32,
}

/// A pixel with its direction and solid angle above the horizon.
#[derive(Clone, Copy)]
struct SkyPixel {
    pixel: u32,
    dir: [f32; 3],
    omega: f32,
}

/// Turns merged pictures of one camera into weights of one patch set.
pub struct Capture {
    set: PatchSet,
    settings: CaptureSettings,
    size: (usize, usize),
    shares: Vec<Share>,
    pixels: Vec<SkyPixel>,
    intake: Intake,
    /// Scratch: Rec.709 radiance per picture pixel in the weights' unit.
    sky: Vec<[f32; 3]>,
}

/// The sun's neighbourhood in a picture.
struct SunSpot {
    /// Picture pixel and its in-painted radiance.
    inpainted: Vec<(usize, [f32; 3])>,
    irradiance: [f64; 3],
    ring: f64,
    clipped: bool,
    brightest: f64,
}

impl Capture {
    /// Prepares a lens, a picture size and a patch set; `mask` (row by row) is false where a pixel is no sky, besides those
    /// that the lens's own mask leaves out.
    ///
    /// # Errors
    /// [`CaptureError`] where lens and picture do not fit or nothing of the sky is seen.
    pub fn new(
        lens: &Lens,
        (width, height): (usize, usize),
        set: PatchSet,
        settings: CaptureSettings,
        mask: Option<&[bool]>,
    ) -> Result<Self, CaptureError> {
        if let Some((lens_width, lens_height)) = lens.size()
            && (lens_width, lens_height) != (width, height)
        {
            return Err(CaptureError::Size { lens_width, lens_height, width, height });
        }
        let (mut shares, mut pixels) = (Vec::new(), Vec::new());
        for pixel in 0..width * height {
            let left_out = mask.is_some_and(|mask| !mask.get(pixel).copied().unwrap_or(false));
            if left_out || lens.mask().is_some_and(|mask| !mask.is_sky(pixel)) {
                continue;
            }
            let omega = add_shares(lens, [(pixel % width) as f64, (pixel / width) as f64], pixel, &set, &mut shares);
            let centre = lens.unproject([(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5]);
            if let (true, Some(dir)) = (omega > 0.0, centre) {
                pixels.push(SkyPixel { pixel: pixel as u32, dir: dir.map(|c| c as f32), omega });
            }
        }
        if pixels.is_empty() {
            return Err(CaptureError::NoSky);
        }
        let intake = Intake::new(lens, (width, height));
        Ok(Capture { set, settings, size: (width, height), shares, pixels, intake, sky: Vec::new() })
    }

    /// Sets how the camera's colours become Rec.709; at first they count as such.
    pub fn set_colour(&mut self, colour: &CameraColour) {
        self.intake.set_colour(colour);
    }

    /// Sets the radiance of one full-well fraction per second.
    pub fn set_radiance_scale(&mut self, radiance_scale: f64) {
        self.settings.radiance_scale = radiance_scale;
    }

    /// Weights of a merged picture; `sun` is the ephemeris' position, none while the time is not known.
    ///
    /// # Errors
    /// [`CaptureError::Size`] for a picture of another size.
    pub fn weights(&mut self, merged: &Merged, sun: Option<SunPosition>) -> Result<Captured, CaptureError> {
        if (merged.width, merged.height) != self.size {
            let (lens_width, lens_height) = self.size;
            return Err(CaptureError::Size { lens_width, lens_height, width: merged.width, height: merged.height });
        }
        self.intake.take(merged, self.settings.radiance_scale as f32, &mut self.sky);
        let is_clipped = |p: &SkyPixel| merged.state[p.pixel as usize] == PixelState::Clipped;
        let mut clipped_pixels = self.pixels.iter().filter(|p| is_clipped(p)).count();
        let up = sun.filter(|position| luminance(clear_beam(position.altitude_deg as f32, 3.0)) > 0.0);
        let spot = up.and_then(|position| self.sun_spot(merged, dir_world(position, self.settings.north_deg)));
        for &(pixel, value) in spot.iter().flat_map(|spot| &spot.inpainted) {
            clipped_pixels -= usize::from(merged.state[pixel] == PixelState::Clipped);
            self.sky[pixel] = value;
        }
        let (radiance, filled_patches) = self.patches();
        let mut weights = PatchWeights { radiance, sun: None };
        let sun_source = match (sun, up, spot) {
            (None, ..) => SunSource::NoPosition,
            (_, None, _) => SunSource::BelowHorizon,
            (_, Some(position), Some(spot)) => self.add_sun(position, &spot, &mut weights),
            (_, Some(_), None) => SunSource::Covered,
        };
        let irradiance = weights.horizontal_irradiance(&self.set);
        let albedo = self.settings.ground_albedo;
        let ground = std::array::from_fn(|k| albedo[k] * (irradiance[k] / std::f64::consts::PI) as f32);
        weights.radiance[self.set.upper()..].fill(ground);
        Ok(Captured { weights, sun_source, filled_patches, clipped_pixels })
    }

    /// Radiance that the newest picture showed towards a direction, in the weights' unit and without the sun; none where no sky
    /// was seen.
    pub fn radiance_towards(&self, lens: &Lens, dir_world: [f32; 3]) -> Option<[f32; 3]> {
        let [x, y] = lens.project(dir_world.map(f64::from))?;
        let (width, height) = self.size;
        let inside = (0.0..width as f64).contains(&x) && (0.0..height as f64).contains(&y);
        let pixel = y.max(0.0) as usize * width + x.max(0.0) as usize;
        let is_sky = inside && lens.mask().is_none_or(|mask| mask.is_sky(pixel));
        is_sky.then(|| self.sky.get(pixel).copied()).flatten()
    }

    /// What stands above the in-painted sky within 1 degree of the sun (one and a half pixels if these are larger).
    fn sun_spot(&self, merged: &Merged, sun_dir: [f32; 3]) -> Option<SunSpot> {
        let cosine = |p: &SkyPixel| (0..3).map(|k| p.dir[k] * sun_dir[k]).sum::<f32>();
        let nearest = self.pixels.iter().max_by(|a, b| cosine(a).total_cmp(&cosine(b)))?;
        let radius = SUN_RADIUS_DEG.to_radians().max(1.5 * f64::from(nearest.omega).sqrt());
        let (inner, outer) = (radius.cos() as f32, (1.6 * radius).cos() as f32);
        let near: Vec<&SkyPixel> = self.pixels.iter().filter(|p| cosine(p) >= outer).collect();
        let (cap, ring): (Vec<&SkyPixel>, Vec<&SkyPixel>) = near.into_iter().partition(|p| cosine(p) >= inner);
        if cap.is_empty() || ring.is_empty() {
            return None;
        }
        let value = |p: &SkyPixel| self.sky[p.pixel as usize];
        let ring_omega: f32 = ring.iter().map(|p| p.omega).sum();
        let ring_mean = ring.iter().map(|p| p.omega * luminance(value(p))).sum::<f32>() / ring_omega;
        let mut spot = SunSpot {
            inpainted: Vec::new(),
            irradiance: [0.0; 3],
            ring: ring_mean.into(),
            clipped: false,
            brightest: 0.0,
        };
        for pixel in cap {
            let (mut sky, mut total) = ([0.0; 3], 0.0);
            for other in &ring {
                let apart: f32 = (0..3).map(|k| (pixel.dir[k] - other.dir[k]).powi(2)).sum();
                let weight = other.omega / apart.max(1e-9);
                total += weight;
                sky = std::array::from_fn(|k| sky[k] + weight * value(other)[k]);
            }
            let found = value(pixel);
            let left = std::array::from_fn(|k| found[k].min(sky[k] / total));
            spot.clipped |= merged.state[pixel.pixel as usize] == PixelState::Clipped;
            spot.brightest = spot.brightest.max(luminance(found).into());
            for k in 0..3 {
                spot.irradiance[k] += f64::from((found[k] - left[k]) * pixel.omega);
            }
            spot.inpainted.push((pixel.pixel as usize, left));
        }
        Some(spot)
    }

    /// Mean radiance per patch (lower ones 0), and how many upper ones had to be filled.
    fn patches(&self) -> (Vec<[f32; 3]>, usize) {
        let count = self.set.len();
        let (mut sums, mut seen) = (vec![[0.0f64; 3]; count], vec![0.0f64; count]);
        for share in &self.shares {
            let (value, omega) = (self.sky[share.pixel as usize], f64::from(share.omega));
            let sum = &mut sums[usize::from(share.patch)];
            for k in 0..3 {
                sum[k] += f64::from(value[k]) * omega;
            }
            seen[usize::from(share.patch)] += omega;
        }
        let enough = |p: usize| seen[p] >= SEEN_SHARE * f64::from(self.set.solid_angle_sr(p));
        let mut radiance: Vec<[f32; 3]> = (0..count)
            .map(|p| if seen[p] > 0.0 { sums[p].map(|v| (v / seen[p]).max(0.0) as f32) } else { [0.0; 3] })
            .collect();
        let missing: Vec<usize> = (0..self.set.upper()).filter(|&p| !enough(p)).collect();
        if !missing.is_empty() {
            let known: Vec<usize> = (0..self.set.upper()).filter(|&p| enough(p)).collect();
            crate::smooth::fill(&self.set, &mut radiance, &known, &missing);
        }
        (radiance, missing.len())
    }

    fn add_sun(&self, position: SunPosition, spot: &SunSpot, weights: &mut PatchWeights) -> SunSource {
        let above = position.altitude_deg.max(0.0);
        let dir = dir_world(SunPosition { altitude_deg: above, ..position }, self.settings.north_deg);
        let light = f64::from(luminance(spot.irradiance.map(|v| v as f32)));
        let upper = self.set.upper();
        let mean = weights.radiance[..upper].iter().map(|&v| f64::from(luminance(v))).sum::<f64>() / upper as f64;
        let stands_out = if spot.clipped {
            spot.brightest >= CLIPPED_CONTRAST * spot.ring
        } else {
            light / sun_solid_angle_sr() >= MIN_DISC_CONTRAST * spot.ring
                && light >= MIN_IRRADIANCE_SHARE * std::f64::consts::PI * mean
        };
        if !stands_out || light <= 0.0 {
            return SunSource::Covered;
        }
        let least = spot.irradiance.map(|v| v as f32);
        let (irradiance, source) = if spot.clipped {
            let modelled = self.modelled_sun(position, weights);
            (std::array::from_fn(|k| modelled[k].max(least[k])), SunSource::ClearSkyModel)
        } else {
            (least, SunSource::Measured)
        };
        weights.sun = Some(SunWeight { dir_world: dir, irradiance });
        source
    }

    /// The clear-sky beam in the measured sky's unit.
    fn modelled_sun(&self, position: SunPosition, weights: &PatchWeights) -> [f32; 3] {
        let atmosphere = Atmosphere {
            turbidity: self.settings.turbidity,
            ground_albedo: self.settings.ground_albedo,
            ..Atmosphere::default()
        };
        let model = SkyModel::new(atmosphere, position, self.settings.north_deg, 0.0).weights(&self.set);
        let pairs = weights.radiance.iter().zip(&model.radiance).take(self.set.upper());
        let mut ratios: Vec<f32> = pairs.map(|(a, b)| luminance(*a) / luminance(*b).max(1e-12)).collect();
        let quarter = ratios.len() / 4;
        let (_, &mut ratio, _) = ratios.select_nth_unstable_by(quarter, f32::total_cmp);
        clear_beam(position.altitude_deg as f32, self.settings.turbidity).map(|v| v * ratio)
    }
}

/// Adds the shares of a pixel with its corner at `corner`; returns its solid angle above the horizon.
fn add_shares(lens: &Lens, corner: [f64; 2], pixel: usize, set: &PatchSet, shares: &mut Vec<Share>) -> f32 {
    let (first, mut total) = (shares.len(), 0.0);
    for sub in 0..4 {
        let at = [corner[0] + 0.25 + 0.5 * f64::from(sub % 2), corner[1] + 0.25 + 0.5 * f64::from(sub / 2)];
        let (Some(dir), Some(density)) = (lens.unproject(at), lens.solid_angle_sr(at)) else { continue };
        if dir[1] < 0.0 {
            continue;
        }
        let (patch, omega) = (set.patch_of(dir.map(|c| c as f32)) as u16, 0.25 * density as f32);
        total += omega;
        match shares[first..].iter_mut().find(|share| share.patch == patch) {
            Some(share) => share.omega += omega,
            None => shares.push(Share { pixel: pixel as u32, patch, omega }),
        }
    }
    total
}

#[cfg(test)]
mod tests;
