//! The rebuilt disc in the camera's picture.

use super::{ProbeError, Probed};
use crate::bracket::PixelState;
use crate::skymodel::disc_directions;

const POINTS: u32 = 4096;

/// An even disc of the sun.
pub(super) struct Disc {
    /// Irradiance on a plane normal to it, Rec.709.
    pub irradiance: [f64; 3],
    /// One standard deviation of it.
    pub sigma: [f64; 3],
    /// To its centre, in the world.
    pub dir_world: [f32; 3],
}

impl Probed<'_> {
    /// Adds a disc to the pixels that it covers; they count as measured then. False where it is outside the picture.
    ///
    /// # Errors
    /// [`ProbeError::Colour`] for colours without a way back.
    pub(super) fn add(&mut self, disc: &Disc) -> Result<bool, ProbeError> {
        let to_camera = self.colour.from_rec709().ok_or(ProbeError::Colour)?;
        let irradiance = to_camera.map(|row| (0..3).map(|k| row[k] * disc.irradiance[k]).sum::<f64>().max(0.0));
        // The errors of the probe's channels are independent of each other.
        let sigma = to_camera.map(|row| (0..3).map(|k| (row[k] * disc.sigma[k]).powi(2)).sum::<f64>().sqrt());
        let covered = self.covered(disc.dir_world);
        let points = covered.len() as f64;
        for same in covered.chunk_by(|a, b| a == b) {
            let index = same[0];
            let at = [(index % self.merged.width) as f64 + 0.5, (index / self.merged.width) as f64 + 0.5];
            let Some(omega) = self.lens.solid_angle_sr(at) else { continue };
            let passed = self.lens.transmission(at).unwrap_or(1.0);
            let per_irradiance = passed * same.len() as f64 / (points * omega);
            let pixel = &mut self.merged.radiance[index];
            *pixel = std::array::from_fn(|k| pixel[k] + (irradiance[k] * per_irradiance) as f32);
            self.merged.state[index] = PixelState::Valid;
            if let Some(before) = self.sigma.as_mut().and_then(|sigma| sigma.get_mut(index)) {
                *before = std::array::from_fn(|k| before[k].hypot((sigma[k] * per_irradiance) as f32));
            }
        }
        Ok(!covered.is_empty())
    }

    /// The pixel under every point of the disc, sorted.
    fn covered(&self, dir_world: [f32; 3]) -> Vec<usize> {
        let (width, height) = (self.merged.width, self.merged.height);
        let inside = |at: [f64; 2]| {
            let inside = (0.0..width as f64).contains(&at[0]) && (0.0..height as f64).contains(&at[1]);
            inside.then(|| at[1] as usize * width + at[0] as usize)
        };
        let points = disc_directions(dir_world, POINTS);
        let mut covered: Vec<usize> = points.filter_map(|dir| self.lens.project(dir).and_then(inside)).collect();
        covered.sort_unstable();
        covered
    }
}
