//! From the camera's own radiance to that of the sky: what vignetting took is given back, colours become Rec.709.

use crate::bracket::Merged;
use crate::colour::CameraColour;
use crate::lens::Lens;

/// What every pixel goes through, tabulated once.
pub(super) struct Intake {
    /// 1 / share of the light that passes, per pixel; empty where all passes.
    given_back: Vec<f32>,
    /// Rows of camera RGB -> Rec.709; none where they are the same.
    to_rec709: Option<[[f32; 3]; 3]>,
}

impl Intake {
    /// For a lens and a picture size; colours count as Rec.709.
    pub fn new(lens: &Lens, (width, height): (usize, usize)) -> Self {
        let at = |pixel: usize| [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5];
        let given_back: Vec<f32> = (0..width * height)
            .map(|pixel| {
                lens.transmission(at(pixel)).filter(|&passed| passed > 0.0).map_or(1.0, |passed| 1.0 / passed) as f32
            })
            .collect();
        let all_passes = given_back.iter().all(|&factor| factor == 1.0);
        Intake { given_back: if all_passes { Vec::new() } else { given_back }, to_rec709: None }
    }

    pub fn set_colour(&mut self, colour: &CameraColour) {
        self.to_rec709 = (*colour != CameraColour::default()).then(|| colour.to_rec709());
    }

    /// The sky's radiance per pixel, times `scale`, into a buffer that is reused. Colours outside Rec.709 have negative parts.
    pub fn take(&self, merged: &Merged, scale: f32, sky: &mut Vec<[f32; 3]>) {
        sky.clear();
        sky.extend(merged.radiance.iter().map(|rgb| rgb.map(|v| v * scale)));
        for (value, factor) in sky.iter_mut().zip(&self.given_back) {
            *value = value.map(|v| v * factor);
        }
        if let Some(rows) = &self.to_rec709 {
            for value in sky.iter_mut() {
                let [r, g, b] = *value;
                *value = rows.map(|row| row[0] * r + row[1] * g + row[2] * b);
            }
        }
    }
}
