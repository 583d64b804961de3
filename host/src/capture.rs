//! What the sky camera sees to weights: every valid pixel's solid angle counts once, the rest is filled and marked.
//!
//! - What vignetting took is given back, and the camera's colours become Rec.709; pixels that the lens's mask leaves out are
//!   no sky.
//! - A patch's radiance is the mean over its own part of the picture (`capture/shares.rs`); of what stands at one side of it, its
//!   neighbours get a part at last (`relume_firmware::glue::moments`).
//! - What was not seen of a patch is filled from a smooth sky (`smooth.rs`): all of it where less than a quarter was seen,
//!   else the difference that the smooth sky makes between the patch and its seen part.
//! - The sun's place is the ephemeris'. What stands above the in-painted sky within 1 degree of it (or the clipped blob) is
//!   taken out of the patches. Its irradiance is that excess where no pixel of it is clipped. Else it is the clear-sky
//!   model's beam, in the haze and unit that the clear parts of the sky tell (`capture/clearsky.rs`), times what comes through
//!   of it by what is seen around the disc (`capture/beam.rs`).
//! - The lower hemisphere, which the camera does not see, is ground albedo x horizontal irradiance / pi.

mod astray;
mod beam;
mod clearsky;
mod halo;
mod intake;
mod shares;
mod sunlight;
mod sunspot;

use crate::bracket::{Merged, PixelState};
use crate::colour::CameraColour;
use crate::lens::Lens;
use crate::map::luminance;
use crate::moments::Moments;
use crate::skymodel::clear_beam;
use crate::smooth::SmoothSky;
use crate::sun::SunPosition;
use crate::weights::PatchWeights;
use beam::Beam;
use clearsky::ClearSky;
use intake::Intake;
use relume_firmware::patches::PatchSet;
use shares::Shares;
use sunspot::SunSpot;

/// Share of a patch that must have been seen.
const SEEN_SHARE: f64 = 0.25;
/// A share of a patch that is less than this does not count as missing: what rounding leaves.
const MISSING: f32 = 0.01;
/// What the capture must know besides the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureSettings {
    /// Radiance of one full-well fraction per second, in the unit the weights shall have.
    pub radiance_scale: f64,
    /// RGB albedo of the ground, 0..1.
    pub ground_albedo: [f32; 3],
    /// Turbidity of the clear-sky model for a clipped sun, until the sky has told its own.
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SunSource {
    /// No position was given; the sun, if seen, stays in the patches.
    #[default]
    NoPosition,
    /// The sun is below the horizon.
    BelowHorizon,
    /// Nothing stands out where the sun is.
    Covered,
    /// Measured from pixels that are not clipped.
    Measured,
    /// Clear-sky model scaled by what the sky shows; pixels of the disc are clipped.
    ClearSkyModel,
    /// The same, less what is before the sun.
    Veiled,
}

/// Weights of one series and what they rest on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Captured {
    /// The weights.
    pub weights: PatchWeights,
    /// Where the sun comes from.
    pub sun_source: SunSource,
    /// Share of the clear-sky beam that comes through, 0..=1, where the sun is the model's.
    pub beam_share: Option<f64>,
    /// Per patch the share of its solid angle that was not seen and filled from the smooth sky, 0..=1; 0 for the lower ones,
    /// of which nothing is ever seen.
    pub filled_share: Vec<f32>,
    /// Upper patches of which less than a quarter was seen.
    pub filled_patches: usize,
    /// Pixels above the horizon that were clipped in every frame, the sun's not counted.
    pub clipped_pixels: usize,
    /// Horizontal irradiance of the sky without the sun, pixel by pixel, the filled parts counted at their patches.
    pub sky_irradiance: [f64; 3],
}

impl Captured {
    /// How far the sum of radiance x solid angle x max(y, 0) over the patches is off the picture's own horizontal
    /// irradiance (luminance, relative; the sun left out of both). Patches count at their centroids.
    pub fn irradiance_off(&self, set: &PatchSet) -> f64 {
        let sky = PatchWeights { radiance: self.weights.radiance.clone(), sun: None };
        let light = |rgb: [f64; 3]| f64::from(luminance(rgb.map(|v| v as f32)));
        let truth = light(self.sky_irradiance);
        if truth > 0.0 { light(sky.horizontal_irradiance(set)) / truth - 1.0 } else { 0.0 }
    }
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

/// A patch's sums over its pixels, per channel: radiance x solid angle, and that times the direction, whose height makes it
/// horizontal irradiance.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    light: [f64; 3],
    by_dir: [[f64; 3]; 3],
}

/// A merged picture in the weights' unit, with its geometry.
struct SkyPicture<'p> {
    merged: &'p Merged,
    sky: &'p [[f32; 3]],
    dirs: &'p [[f32; 3]],
    omegas: &'p [f32],
}

/// Turns merged pictures of one camera into weights of one patch set.
pub struct Capture {
    set: PatchSet,
    settings: CaptureSettings,
    lens: Lens,
    size: (usize, usize),
    shares: Shares,
    filled_share: Vec<f32>,
    filled_patches: usize,
    clear_sky: ClearSky,
    beam: Beam,
    intake: Intake,
    /// Scratch: Rec.709 radiance per picture pixel in the weights' unit, and sums per patch.
    sky: Vec<[f32; 3]>,
    sums: Vec<Sums>,
    aside: Vec<[[f64; 3]; 3]>,
    moments: Option<Moments>,
    smooth: SmoothSky,
    spot: SunSpot,
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
        let shares = Shares::new(lens, (width, height), &set, mask);
        if shares.count() == 0 {
            return Err(CaptureError::NoSky);
        }
        let unseen = |patch: usize| (1.0 - shares.seen[patch] / f64::from(set.solid_angle_sr(patch))).max(0.0) as f32;
        let marked = |patch: usize| if patch < set.upper() && unseen(patch) > MISSING { unseen(patch) } else { 0.0 };
        let filled_share: Vec<f32> = (0..set.len()).map(marked).collect();
        Ok(Capture {
            filled_patches: filled_share.iter().filter(|&&share| !is_enough(share)).count(),
            filled_share,
            set,
            settings,
            lens: lens.clone(),
            size: (width, height),
            shares,
            clear_sky: ClearSky::default(),
            beam: Beam::default(),
            intake: Intake::new(lens, (width, height)),
            sky: Vec::new(),
            sums: Vec::new(),
            aside: Vec::new(),
            moments: Moments::new(&set),
            smooth: SmoothSky::default(),
            spot: SunSpot::default(),
        })
    }

    /// Sets how the camera's colours become Rec.709; at first they count as such.
    pub fn set_colour(&mut self, colour: &CameraColour) {
        self.intake.set_colour(colour);
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

    /// Sets the radiance of one full-well fraction per second.
    pub fn set_radiance_scale(&mut self, radiance_scale: f64) {
        self.settings.radiance_scale = radiance_scale;
    }

    /// Per picture pixel the sum of its solid angle in each patch times that patch's value: what a pixel matters for.
    pub fn pixel_importance(&self, per_patch: &[f32]) -> Vec<f32> {
        let mut importance = vec![0.0; self.size.0 * self.size.1];
        for share in &self.shares.shares {
            importance[share.pixel as usize] += share.omega * per_patch.get(usize::from(share.patch)).unwrap_or(&1.0);
        }
        importance
    }

    /// Share of the sky's pixels that are clipped.
    pub fn clipped_share(&self, merged: &Merged) -> f64 {
        self.clipped_pixels(merged) as f64 / self.shares.count().max(1) as f64
    }

    fn clipped_pixels(&self, merged: &Merged) -> usize {
        let states = merged.state.iter().zip(&self.shares.omegas);
        states.filter(|(state, omega)| **omega > 0.0 && **state == PixelState::Clipped).count()
    }

    /// Weights of a merged picture; `sun` is the ephemeris' position, none while the time is not known.
    ///
    /// # Errors
    /// [`CaptureError::Size`] for a picture of another size.
    pub fn weights(&mut self, merged: &Merged, sun: Option<SunPosition>) -> Result<Captured, CaptureError> {
        let mut captured = Captured::default();
        self.weights_into(merged, sun, &mut captured)?;
        Ok(captured)
    }

    /// The same into memory that is reused.
    ///
    /// # Errors
    /// [`CaptureError::Size`] for a picture of another size.
    pub fn weights_into(
        &mut self,
        merged: &Merged,
        sun: Option<SunPosition>,
        into: &mut Captured,
    ) -> Result<(), CaptureError> {
        if (merged.width, merged.height) != self.size {
            let (lens_width, lens_height) = self.size;
            return Err(CaptureError::Size { lens_width, lens_height, width: merged.width, height: merged.height });
        }
        self.intake.take(merged, self.settings.radiance_scale as f32, &mut self.sky);
        into.clipped_pixels = self.clipped_pixels(merged);
        let up = sun.filter(|position| luminance(clear_beam(position.altitude_deg as f32, 3.0)) > 0.0);
        (into.weights.sun, into.beam_share) = (None, None);
        into.sun_source = match (sun, up) {
            (None, _) => SunSource::NoPosition,
            (_, None) => SunSource::BelowHorizon,
            (_, Some(position)) => self.take_out_sun(merged, position, into),
        };
        if into.weights.sun.is_none() {
            self.fill_patches(into);
        }
        self.settle(into);
        self.fill_ground(into);
        into.filled_share.clone_from(&self.filled_share);
        into.filled_patches = self.filled_patches;
        Ok(())
    }

    /// Mean radiance per upper patch, and what was not seen.
    fn fill_patches(&mut self, into: &mut Captured) {
        self.sums.clear();
        self.sums.resize(self.set.len(), Sums::default());
        (0..self.set.len()).for_each(|patch| self.sum(patch));
        self.fill_from_sums(into);
    }

    /// The same where the picture has changed within some degrees of a direction.
    fn fill_patches_near(&mut self, dir_world: [f32; 3], within_deg: f32, into: &mut Captured) {
        for patch in 0..self.set.len() {
            if self.shares.is_near(patch, self.set.dir_world(patch), dir_world, within_deg) {
                self.sum(patch);
            }
        }
        self.fill_from_sums(into);
    }

    fn sum(&mut self, patch: usize) {
        let mut sums = Sums::default();
        for share in self.shares.of_patch(patch) {
            let (value, omega) = (self.sky[share.pixel as usize], f64::from(share.omega));
            let dir = self.shares.dirs[share.pixel as usize].map(f64::from);
            let light = value.map(|v| f64::from(v) * omega);
            sums.light = std::array::from_fn(|k| sums.light[k] + light[k]);
            let by_dir = |k: usize| std::array::from_fn(|m| sums.by_dir[k][m] + light[k] * dir[m]);
            sums.by_dir = std::array::from_fn(by_dir);
        }
        self.sums[patch] = sums;
    }

    fn fill_from_sums(&mut self, into: &mut Captured) {
        let radiance = &mut into.weights.radiance;
        radiance.clear();
        let means = self.sums.iter().zip(&self.shares.seen);
        radiance.extend(
            means.map(|(sums, &seen)| sums.light.map(|v| if seen > 0.0 { (v / seen).max(0.0) as f32 } else { 0.0 })),
        );
        if self.filled_share.iter().any(|&share| share > 0.0) {
            self.fill_missing(radiance);
        }
        let mut level = [0.0; 3];
        for sums in &self.sums {
            level = std::array::from_fn(|k| level[k] + sums.by_dir[k][1]);
        }
        for (patch, value) in radiance.iter().enumerate().take(self.set.upper()) {
            let missing = self.filled_share[patch] * self.set.solid_angle_sr(patch);
            let weight = f64::from(missing * self.set.dir_world(patch)[1]);
            level = std::array::from_fn(|k| level[k] + weight * f64::from(value[k]));
        }
        into.sky_irradiance = level;
    }

    /// Moves in part to its neighbours what stands at one side of a patch's seen part.
    fn settle(&mut self, into: &mut Captured) {
        let Some(moments) = &self.moments else { return };
        let about = |Sums { light, by_dir }: &Sums, middle: &[f64; 3]| -> [[f64; 3]; 3] {
            std::array::from_fn(|k| std::array::from_fn(|m| by_dir[k][m] - light[k] * middle[m]))
        };
        let patches = self.sums.iter().zip(&self.shares.middles).zip(&self.filled_share);
        self.aside.clear();
        self.aside.extend(patches.map(|((sums, middle), &missing)| match is_enough(missing) {
            true => about(sums, middle),
            false => Default::default(),
        }));
        moments.settle(&mut into.weights.radiance, &self.aside);
    }

    fn fill_missing(&mut self, radiance: &mut [[f32; 3]]) {
        let (set, missing) = (&self.set, &self.filled_share);
        self.smooth.fit(set, radiance, |patch| is_enough(missing[patch]));
        for patch in (0..set.upper()).filter(|&patch| missing[patch] > 0.0) {
            let whole = self.smooth.at(set.dir_world(patch));
            radiance[patch] = if is_enough(missing[patch]) {
                let dir = self.shares.seen_dirs[patch];
                let length = dir.iter().map(|c| c * c).sum::<f32>().sqrt().max(1e-6);
                let part = self.smooth.at(dir.map(|c| c / length));
                std::array::from_fn(|k| (radiance[patch][k] + whole[k] - part[k]).max(0.5 * radiance[patch][k]))
            } else {
                whole
            };
        }
    }

    fn fill_ground(&mut self, into: &mut Captured) {
        let irradiance = into.weights.horizontal_irradiance(&self.set);
        let albedo = self.settings.ground_albedo;
        let ground = std::array::from_fn(|k| albedo[k] * (irradiance[k] / std::f64::consts::PI) as f32);
        into.weights.radiance[self.set.upper()..].fill(ground);
    }
}

/// Was enough of a patch seen of which this share was not?
fn is_enough(missing: f32) -> bool {
    f64::from(1.0 - missing) >= SEEN_SHARE
}

#[cfg(test)]
mod tests;
