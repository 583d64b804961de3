//! The sky camera's lens and orientation from the sun's own path over hours or days.
//!
//! 1. Every frame gives a few bright, compact spots ([`spot`]); one of them may be the sun.
//! 2. Two spots in two frames fix a focal length and an orientation, because the angle between the sun's places is known; the
//!    pair whose lens explains most frames tells which spots are the sun (random sample consensus, Fischler & Bolles 1981).
//! 3. Least squares over those spots with a robust loss ([`fit`]), in turns with looking for the nearest spots again.
//!
//! Every parameter but the orientation has a nominal value and a spread that lenses have around it. What the path cannot
//! tell better than that stays at its nominal value, and is named.

pub mod fit;
mod pairing;
mod parameters;
pub mod spot;

use crate::lens::{Lens, LensFile};
use spot::Spot;

/// Frames that a fit needs at the least.
pub const MIN_SIGHTINGS: usize = 8;
/// Lower than this the air bends light by amounts that vary with the weather, degrees.
pub const MIN_ALTITUDE_DEG: f64 = 4.0;

/// One frame: where the sun was, and what might be it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// When the frame was taken, unix seconds.
    pub captured_at_s: f64,
    /// Where the sun stood.
    pub sun_dir_world: [f64; 3],
    /// Bright spots of the frame, the brightest first.
    pub spots: Vec<Spot>,
}

/// A frame in which the sun was found where the lens says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// When the frame was taken, unix seconds.
    pub captured_at_s: f64,
    /// Where the sun was seen, pixels.
    pub seen_px: [f64; 2],
    /// Where the lens says it should be seen, pixels.
    pub expected_px: [f64; 2],
    /// Between them, pixels.
    pub off_px: f64,
    /// Between them, degrees of the sky.
    pub off_deg: f64,
}

/// What the sun's path told.
#[derive(Clone, Debug)]
pub struct PathFit {
    /// The lens, oriented.
    pub lens: Lens,
    /// The frames it rests on, in the order of the sightings.
    pub found: Vec<Found>,
    /// Frames with spots of which none was the sun.
    pub set_aside: usize,
    /// Frames without a spot.
    pub without_spot: usize,
    /// Keys of `LENS.json` that the path could not fix; they are at their nominal values.
    pub held: Vec<&'static str>,
    /// Standard error of the orientation, degrees.
    pub orientation_error_deg: f64,
    /// Standard error of directions over the sky above 5 degrees altitude, rms, degrees.
    pub sky_error_deg: f64,
    /// The same where it is worst.
    pub worst_sky_error_deg: f64,
}

/// Why there is no fit; one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PathError {
    /// Too few frames show anything that may be the sun.
    #[error(
        "only {0} frames show a spot that may be the sun, {MIN_SIGHTINGS} are needed: take short exposures over some \
         hours under a clear sky"
    )]
    TooFew(usize),
    /// No lens explains the spots.
    #[error(
        "no lens of this model puts the sun where the frames show bright spots (at best in {best} of {of} frames): check \
         place, captured_at (UTC) and the lens model"
    )]
    NoPath {
        /// Frames that the best lens explains.
        best: usize,
        /// Frames with spots.
        of: usize,
    },
    /// The spots follow the sun in a mirror.
    #[error(
        "the picture is mirrored: the bright spots follow the sun only when left and right are exchanged; turn the \
         camera's flip off"
    )]
    Mirrored,
}

impl PathFit {
    /// Root mean square of the residuals, pixels and degrees.
    pub fn rms(&self) -> (f64, f64) {
        rms(&self.found)
    }
}

/// Root mean square of residuals, pixels and degrees.
pub fn rms(found: &[Found]) -> (f64, f64) {
    let mean = |of: fn(&Found) -> f64| found.iter().map(|f| of(f).powi(2)).sum::<f64>() / found.len().max(1) as f64;
    (mean(|f| f.off_px).sqrt(), mean(|f| f.off_deg).sqrt())
}

/// Fits lens and orientation; `nominal` gives model, size and the values that parameters stay at where the path does not tell
/// them (its orientation plays no part).
///
/// # Errors
/// [`PathError`] when the spots are too few, or follow no path that the sun took.
pub fn fit(sightings: &[Sighting], nominal: &LensFile) -> Result<PathFit, PathError> {
    let usable: Vec<&Sighting> = sightings.iter().filter(|sighting| !sighting.spots.is_empty()).collect();
    if usable.len() < MIN_SIGHTINGS {
        return Err(PathError::TooFew(usable.len()));
    }
    let (start, explained) = pairing::best(&usable, nominal);
    // A quarter of the frames: half of a day may be clouded, and lamps or reflections outshine the sun in some.
    let needed = MIN_SIGHTINGS.max(usable.len() / 4);
    let mirrored: Vec<Sighting> = usable.iter().map(|sighting| mirrored(sighting, nominal)).collect();
    let (_, in_mirror) = pairing::best(&mirrored.iter().collect::<Vec<_>>(), nominal);
    // Short paths look alike in a mirror, and whole ones leave some frames that fit it, too.
    if in_mirror >= needed && 2 * in_mirror > 3 * explained {
        return Err(PathError::Mirrored);
    }
    let fitted = start.filter(|_| explained >= needed).and_then(|start| fit::refine(&usable, &start, nominal));
    let Some(mut fitted) = fitted.filter(|fitted| fitted.found.len() >= needed) else {
        return Err(PathError::NoPath { best: explained, of: usable.len() });
    };
    fitted.without_spot = sightings.len() - usable.len();
    Ok(fitted)
}

fn mirrored(sighting: &Sighting, nominal: &LensFile) -> Sighting {
    let flip = |spot: &Spot| Spot {
        position_px: [2.0 * nominal.center_px[0] - spot.position_px[0], spot.position_px[1]],
        ..*spot
    };
    Sighting { spots: sighting.spots.iter().map(flip).collect(), ..sighting.clone() }
}

#[cfg(test)]
mod tests;
