//! An exposure series to linear radiance.
//!
//! Each unclipped code gives an estimate fraction / (exposure x gain) with the variance of a stated sensor (shot noise,
//! read noise, one code's width); estimates are averaged by inverse variance, channel by channel.

use crate::camera::{Codes, Frame};
use crate::response::Response;

/// How codes become radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct MergeSettings {
    /// Response curve.
    pub response: Response,
    /// Code / max of black.
    pub black: f64,
    /// Code / max from which a code counts as clipped.
    pub clip: f64,
    /// Electrons of a full well.
    pub full_well_electrons: f64,
    /// Read noise, electrons rms.
    pub read_noise_electrons: f64,
}

impl Default for MergeSettings {
    fn default() -> Self {
        MergeSettings {
            response: Response::default(),
            black: 0.0,
            clip: 250.0 / 255.0,
            full_well_electrons: 10_000.0,
            read_noise_electrons: 5.0,
        }
    }
}

/// Why a series could not be merged; one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// Nothing to merge.
    #[error("no frames to merge")]
    Empty,
    /// A frame differs in size from the first.
    #[error("frame {0} has another size than the first frame")]
    Size(usize),
    /// A frame's exposure is no time.
    #[error("frame {0}: exposure time x gain is {1}; it must be positive")]
    Exposure(usize, f64),
}

/// What a merged pixel is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelState {
    /// Every channel was measured.
    Valid,
    /// A channel was clipped in every frame; its value is the least it can be.
    Clipped,
}

/// Linear radiance in the camera's frame, in full-well fractions per second.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Merged {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` RGB radiances.
    pub radiance: Vec<[f32; 3]>,
    /// Per pixel.
    pub state: Vec<PixelState>,
    /// When the last frame was taken, unix seconds.
    pub captured_at_s: f64,
}

/// Per code: weight (inverse variance of the fraction) and weight x fraction; weight 0 if clipped.
type CodeTable = Vec<[f32; 2]>;

/// Merges series; keeps its tables from one series to the next.
#[derive(Clone, Debug)]
pub struct Merger {
    settings: MergeSettings,
    /// Per channel, for 8-bit codes then 16-bit ones; the latter made when first needed.
    tables: [Option<[CodeTable; 3]>; 2],
    /// Sum of weight x time^2 and of weight x fraction x time, per channel of each pixel.
    sums: Vec<[f32; 2]>,
}

impl Merger {
    /// A merger for a camera.
    pub fn new(settings: MergeSettings) -> Self {
        Merger { settings, tables: [None, None], sums: Vec::new() }
    }

    fn table(&self, channel: usize, max: u16) -> CodeTable {
        let s = &self.settings;
        let at = |code: f64| s.response.fraction(code, channel);
        let black = at(s.black);
        let full = (at(1.0) - black).max(1e-6);
        let step = 1.0 / f64::from(max);
        let entry = |code: u16| {
            let share = f64::from(code) * step;
            if share >= s.clip {
                return [0.0; 2];
            }
            let fraction = ((at(share) - black) / full).max(0.0);
            let width = (at((share + step).min(1.0)) - at((share - step).max(0.0))) / (2.0 * full);
            let variance = fraction / s.full_well_electrons
                + (s.read_noise_electrons / s.full_well_electrons).powi(2)
                + width * width / 12.0;
            let weight = 1.0 / variance.max(1e-12);
            [weight as f32, (weight * fraction) as f32]
        };
        (0..=max).map(entry).collect()
    }

    /// Merges a series into a buffer that is reused.
    ///
    /// # Errors
    /// [`MergeError`] for no frames, frames of different sizes, exposures that are no times.
    pub fn merge(&mut self, frames: &[Frame], into: &mut Merged) -> Result<(), MergeError> {
        let first = frames.first().ok_or(MergeError::Empty)?;
        let pixels = first.width * first.height;
        for (index, frame) in frames.iter().enumerate() {
            if (frame.width, frame.height) != (first.width, first.height) || frame.codes.len() != pixels * 3 {
                return Err(MergeError::Size(index));
            }
            let product = frame.exposure.product_s();
            if !(product.is_finite() && product > 0.0) {
                return Err(MergeError::Exposure(index, product));
            }
        }
        self.sums.clear();
        self.sums.resize(pixels * 3, [0.0; 2]);
        for frame in frames {
            self.add(frame);
        }
        self.finish(frames, first, into);
        Ok(())
    }

    fn add(&mut self, frame: &Frame) {
        let deep = usize::from(matches!(frame.codes, Codes::U16(_)));
        if self.tables[deep].is_none() {
            let made = [0, 1, 2].map(|channel| self.table(channel, frame.codes.max()));
            self.tables[deep] = Some(made);
        }
        let Some(tables) = &self.tables[deep] else { return };
        let time = frame.exposure.product_s() as f32;
        let mut take = |index: usize, code: usize| {
            let [weight, weighted] = tables[index % 3][code];
            let sum = &mut self.sums[index];
            sum[0] += weight * time * time;
            sum[1] += weighted * time;
        };
        match &frame.codes {
            Codes::U8(codes) => codes.iter().enumerate().for_each(|(i, &code)| take(i, usize::from(code))),
            Codes::U16(codes) => codes.iter().enumerate().for_each(|(i, &code)| take(i, usize::from(code))),
        }
    }

    fn finish(&self, frames: &[Frame], first: &Frame, into: &mut Merged) {
        let pixels = first.width * first.height;
        let shortest = frames.iter().map(|f| f.exposure.product_s()).fold(f64::INFINITY, f64::min);
        // A channel that no frame measured is at least what just clips in the shortest.
        let least: [f32; 3] = std::array::from_fn(|k| {
            let (at, black) = (
                self.settings.response.fraction(self.settings.clip, k),
                self.settings.response.fraction(self.settings.black, k),
            );
            ((at - black).max(0.0) / shortest) as f32
        });
        (into.width, into.height) = (first.width, first.height);
        into.captured_at_s = frames.iter().map(|f| f.captured_at_s).fold(f64::NEG_INFINITY, f64::max);
        into.radiance.clear();
        into.state.clear();
        for sums in self.sums[..pixels * 3].chunks_exact(3) {
            let measured = sums.iter().all(|sum| sum[0] > 0.0);
            into.state.push(if measured { PixelState::Valid } else { PixelState::Clipped });
            into.radiance
                .push(std::array::from_fn(|k| if sums[k][0] > 0.0 { sums[k][1] / sums[k][0] } else { least[k] }));
        }
    }
}

#[cfg(test)]
mod tests;
