//! A lens's vignetting from frames of an evenly lit surface: white paper or opal glass close before the lens.
//!
//! The sky itself cannot tell it: its brightness falls off towards the horizon by itself, and so does the sun's, along the
//! very angles along which the lens of an upright camera loses light. Nor can the response curve be told from it by one
//! exposure: linearise the frames.
//!
//! Medians over rings of one degree around the axis, each frame relative to its centre, then least squares of
//! 1 + a1 q + a2 q^2 + a3 q^3, q = (theta / 90 degrees)^2. Light that grows from one side to the other cancels in the rings.

use crate::least_squares::minimise;
use crate::lens::Lens;
use crate::quantile::median;

/// Rings of one degree, to where vignetting is followed.
const RINGS: usize = 100;
/// Rings that make a frame's centre.
const CENTRE: usize = 8;
/// Rings without so many pixels tell nothing.
const MIN_PIXELS: usize = 8;
/// A flat field that ends nearer to the axis than this says too little of the rest, degrees.
const MIN_REACH: usize = 30;
/// Light (full-well fraction) from which a pixel may be clipped, and below which a centre is too dark.
const BRIGHT: f32 = 0.93;
const DARK: f64 = 0.02;

/// Why frames are no flat field; one line.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FlatError {
    /// No frame is neither clipped nor dark.
    #[error("no flat-field frame is neither clipped nor dark at its centre")]
    Exposure,
    /// The rings end too near to the axis.
    #[error("the flat field reaches only {0} degrees off the axis; light the whole picture evenly")]
    Reach(usize),
    /// The curve is no curve.
    #[error("no vignetting curve fits the flat field")]
    NoFit,
}

/// Gathers flat-field frames of one lens.
pub struct FlatField<'a> {
    lens: &'a Lens,
    size: (usize, usize),
    /// Light relative to the centre, per ring, one entry per frame.
    rings: Vec<Vec<f64>>,
}

/// A vignetting curve and how well it fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vignetting {
    /// As `LENS.json` has them.
    pub coefficients: [f64; 3],
    /// RMS difference of the rings, share of the centre's light.
    pub rms: f64,
    /// Degrees off the axis to which the frames reach.
    pub reach_deg: usize,
}

impl<'a> FlatField<'a> {
    /// For a lens and its picture's size.
    pub fn new(lens: &'a Lens, size: (usize, usize)) -> Self {
        FlatField { lens, size, rings: vec![Vec::new(); RINGS] }
    }

    /// Adds a frame's linear light per pixel; clipped and dark ones are passed over.
    pub fn add(&mut self, light: &[f32]) {
        let mut rings: Vec<Vec<f64>> = vec![Vec::new(); RINGS];
        for (pixel, &value) in light.iter().enumerate().take(self.size.0 * self.size.1) {
            let at = [(pixel % self.size.0) as f64 + 0.5, (pixel / self.size.0) as f64 + 0.5];
            let Some(ring) = self.lens.angle_off_axis(at).map(|theta| theta.to_degrees() as usize) else { continue };
            if ring < RINGS {
                if value >= BRIGHT {
                    return;
                }
                rings[ring].push(value.into());
            }
        }
        let mut middle: Vec<f64> = rings[..CENTRE].iter().flatten().copied().collect();
        let Some(centre) = median(&mut middle).filter(|&centre| centre >= DARK) else { return };
        for (all, mut ring) in self.rings.iter_mut().zip(rings) {
            if ring.len() >= MIN_PIXELS {
                all.extend(median(&mut ring).map(|value| value / centre));
            }
        }
    }

    /// The curve of all frames.
    ///
    /// # Errors
    /// [`FlatError`] where they do not tell one.
    pub fn fit(self) -> Result<Vignetting, FlatError> {
        let points: Vec<(f64, f64)> = self
            .rings
            .into_iter()
            .enumerate()
            .filter_map(|(ring, mut values)| Some((((ring as f64 + 0.5) / 90.0).powi(2), median(&mut values)?)))
            .filter(|(_, share)| *share > 0.0)
            .collect();
        let Some(&(last, _)) = points.last() else { return Err(FlatError::Exposure) };
        let reach_deg = (90.0 * last.sqrt()).round() as usize;
        if reach_deg < MIN_REACH {
            return Err(FlatError::Reach(reach_deg));
        }
        let curve = |p: &[f64], q: f64| p[0] * (1.0 + q * (p[1] + q * (p[2] + q * p[3])));
        let residuals = |p: &[f64]| Some(points.iter().map(|&(q, share)| curve(p, q) - share).collect());
        let found = minimise(&[1.0, 0.0, 0.0, 0.0], &[1e-4; 4], residuals).ok_or(FlatError::NoFit)?;
        let [_, coefficients @ ..] = <[f64; 4]>::try_from(found.parameters).map_err(|_| FlatError::NoFit)?;
        Ok(Vignetting { coefficients, rms: (found.cost / points.len() as f64).sqrt(), reach_deg })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::LensFile;

    #[test]
    fn a_known_fall_off_comes_back_under_uneven_light() {
        let truth = LensFile { vignetting: [-0.35, 0.12, -0.05], ..Lens::zenith_equidistant(160, 160, 190.0).file() };
        let lens = truth.lens("l").unwrap();
        let mut flat = FlatField::new(&lens, (160, 160));
        let light = |pixel: usize, level: f64| {
            let (x, y) = ((pixel % 160) as f64 + 0.5, (pixel / 160) as f64 + 0.5);
            // A tenth more light on one side, codes of 8 bits.
            let value = level * (1.0 + 0.1 * (x - 80.0) / 80.0) * lens.transmission([x, y]).unwrap_or(0.0);
            ((value * 255.0).round() / 255.0) as f32
        };
        for level in [0.2, 0.5, 0.8, 1.5] {
            flat.add(&(0..160 * 160).map(|pixel| light(pixel, level)).collect::<Vec<_>>());
        }
        let found = flat.fit().unwrap();
        let back = LensFile { vignetting: found.coefficients, ..truth }.lens("l").unwrap();
        for theta in 0..=90 {
            let at = [80.0 + lens.file().focal_px * f64::from(theta).to_radians(), 80.0];
            let off = back.transmission(at).unwrap() / lens.transmission(at).unwrap() - 1.0;
            assert!(off.abs() < 0.01, "{theta} degrees: {off} ({found:?})");
        }
    }

    #[test]
    fn frames_that_tell_nothing_are_refused() {
        let lens = Lens::zenith_equidistant(64, 64, 190.0);
        let fit = |light: f32| {
            let mut flat = FlatField::new(&lens, (64, 64));
            flat.add(&[light; 64 * 64]);
            flat.fit()
        };
        assert_eq!((fit(1.0), fit(0.001)), (Err(FlatError::Exposure), Err(FlatError::Exposure)));
        let narrow = Lens::zenith_equidistant(64, 64, 40.0);
        let mut flat = FlatField::new(&narrow, (64, 64));
        flat.add(&[0.5; 64 * 64]);
        assert!(matches!(flat.fit(), Err(FlatError::Reach(_))));
    }
}
