//! An exposure series to linear radiance.
//!
//! Each unclipped code gives an estimate fraction / (exposure x gain) with the variance of a sensor (shot noise, read noise, one
//! code's width, the curve's error), stated or found from the frames; estimates are averaged by inverse variance, channel
//! by channel. Exposures that do not fit their neighbours' are corrected first; samples that do not fit a pixel's others are
//! left out after (birds, clouds that move).

mod ghosts;
mod kernel;
mod scales;
mod sensornoise;
mod tables;

use crate::camera::{Codes, Frame};
use crate::response::Response;
use ghosts::{GhostFilter, MOST_FRAMES, View, reference_of, views};
use kernel::{Merging, Source};
use scales::ScaleGauge;
use sensornoise::NoiseGauge;
pub use sensornoise::SensorNoise;
pub(crate) use tables::CURVE_ERROR;
use tables::{Facts, FrameTables, format_of, longest_s};

/// How codes become radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct MergeSettings {
    /// Response curve.
    pub response: Response,
    /// Code / max of black; that of the curve where it is larger.
    pub black: f64,
    /// Code / max from which a code counts as clipped.
    pub clip: f64,
    /// The sensor's noise; found from the frames if none.
    pub noise: Option<SensorNoise>,
}

impl Default for MergeSettings {
    fn default() -> Self {
        MergeSettings { response: Response::default(), black: 0.0, clip: 250.0 / 255.0, noise: None }
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

/// What was found out about a series while it was merged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MergeReport {
    /// The noise that weights came from.
    pub noise: SensorNoise,
    /// True exposure over the stated one per frame, in the series' order; 1 unless a frame was corrected.
    pub exposure_factors: Vec<f64>,
    /// The usual log ratio (natural) of neighbouring exposures' radiances: far from 0 where curve or times are wrong.
    pub drift: f64,
    /// The same per natural log of the exposures' ratio: by how much the response's exponent seems to be off. None where too
    /// little is seen in two exposures.
    pub slope: Option<f64>,
    /// Place of the frame that what moved is taken from.
    pub reference: usize,
    /// Pixels of which samples were left out.
    pub ghost_pixels: usize,
    /// True where so many pixels disagree that curve or times must be wrong; no sample was left out then.
    pub inconsistent: bool,
}

/// Series whose noise is averaged before it is held.
const NOISE_SERIES: usize = 16;
/// Pixels of a series that exposures are judged by, and noise, in all channels.
const SCALE_PIXELS: usize = 1365;
const NOISE_PIXELS: usize = 5461;

/// Merges series; keeps its tables and buffers from one series to the next.
#[derive(Clone, Debug)]
pub struct Merger {
    settings: MergeSettings,
    /// For 8-bit codes and 16-bit ones, made when first needed.
    facts: [Option<Facts>; 2],
    tables: Vec<FrameTables>,
    /// Corrected exposure time x gain per frame, seconds.
    products_s: Vec<f64>,
    /// Places of the frames by rising exposure.
    order: Vec<usize>,
    suspects: Vec<u32>,
    noise_gauge: NoiseGauge,
    noise_series: usize,
    scale_gauge: ScaleGauge,
    factors: Vec<f64>,
    ghosts: GhostFilter,
    report: MergeReport,
}

impl Merger {
    /// A merger for a camera.
    pub fn new(settings: MergeSettings) -> Self {
        Merger {
            settings,
            facts: [None, None],
            tables: Vec::new(),
            products_s: Vec::new(),
            order: Vec::new(),
            suspects: Vec::new(),
            noise_gauge: NoiseGauge::default(),
            noise_series: 0,
            scale_gauge: ScaleGauge::default(),
            factors: Vec::new(),
            ghosts: GhostFilter::default(),
            report: MergeReport::default(),
        }
    }

    /// What was found out about the last series.
    pub fn report(&self) -> &MergeReport {
        &self.report
    }

    /// Merges a series, in any order, into a buffer that is reused. Allocates nothing once it has seen a series of that many
    /// frames of that size.
    ///
    /// # Errors
    /// [`MergeError`] for no frames, frames of different sizes, exposures that are no times.
    pub fn merge(&mut self, frames: &[Frame], into: &mut Merged) -> Result<(), MergeError> {
        let pixels = check(frames)?;
        for format in frames.iter().map(format_of) {
            let max = if format == 0 { 255 } else { 65_535 };
            self.facts[format].get_or_insert_with(|| Facts::new(&self.settings, max));
        }
        self.gauge(frames, pixels);
        self.set_tables(frames);
        self.run(frames, pixels, into);
        self.settle(frames, pixels, into);
        into.captured_at_s = frames.iter().map(|f| f.captured_at_s).fold(f64::NEG_INFINITY, f64::max);
        Ok(())
    }

    /// Looks at neighbouring exposures of some pixels: exposures that do not fit, and the noise.
    fn gauge(&mut self, frames: &[Frame], pixels: usize) {
        self.order.clear();
        self.order.extend(0..frames.len());
        let product = |i: usize| frames[i].exposure.product_s();
        self.order.sort_unstable_by(|&a, &b| product(a).total_cmp(&product(b)));
        self.scale_gauge.clear();
        let wants_noise = self.settings.noise.is_none() && self.noise_series < NOISE_SERIES;
        for place in 1..self.order.len() {
            let (short, long) = (&frames[self.order[place - 1]], &frames[self.order[place]]);
            self.gauge_pair(short, long, pixels);
            if wants_noise && short.exposure.gain == long.exposure.gain {
                self.gauge_noise(short, long, pixels);
            }
        }
        if wants_noise {
            self.noise_series += 1;
            self.report.noise = self.noise_gauge.noise().unwrap_or_default();
        }
        if let Some(stated) = self.settings.noise {
            self.report.noise = stated;
        }
        self.correct(frames);
    }

    fn gauge_pair(&mut self, short: &Frame, long: &Frame, pixels: usize) {
        let facts = [short, long].map(|frame| self.facts[format_of(frame)].as_ref());
        let r = (short.exposure.product_s() / long.exposure.product_s()) as f32;
        if let [Some(short_facts), Some(long_facts)] = facts {
            for_some(SCALE_PIXELS, pixels, |at, channel| {
                let fraction = |facts: &Facts, frame: &Frame| facts.judged[channel][usize::from(frame.codes.get(at))];
                self.scale_gauge.take(fraction(short_facts, short), fraction(long_facts, long), r);
            });
        }
        self.scale_gauge.end_pair(r);
    }

    /// Shot noise grows with gain: both frames must have the same.
    fn gauge_noise(&mut self, short: &Frame, long: &Frame, pixels: usize) {
        let facts = [short, long].map(|frame| self.facts[format_of(frame)].as_ref());
        let [Some(short_facts), Some(long_facts)] = facts else { return };
        let r = short.exposure.product_s() / long.exposure.product_s();
        for_some(NOISE_PIXELS, pixels, |at, channel| {
            let fact = |facts: &Facts, frame: &Frame| facts.channels[channel][usize::from(frame.codes.get(at))];
            self.noise_gauge.take(&fact(short_facts, short), &fact(long_facts, long), r as f32);
        });
        self.noise_gauge.end_pair(r, short.exposure.gain);
    }

    fn correct(&mut self, frames: &[Frame]) {
        self.report.drift = self.scale_gauge.drift().into();
        self.report.slope = self.scale_gauge.slope().map(f64::from);
        self.scale_gauge.factors(&mut self.factors);
        let report = &mut self.report;
        report.exposure_factors.clear();
        report.exposure_factors.resize(frames.len(), 1.0);
        for (&place, &factor) in self.order.iter().zip(&self.factors) {
            report.exposure_factors[place] = factor;
        }
        self.products_s.clear();
        let corrected = frames.iter().zip(&report.exposure_factors);
        self.products_s.extend(corrected.map(|(frame, factor)| frame.exposure.product_s() * factor));
    }

    fn set_tables(&mut self, frames: &[Frame]) {
        let longest = longest_s(&self.products_s);
        if self.tables.len() < frames.len() {
            self.tables.resize_with(frames.len(), FrameTables::empty);
        }
        for ((tables, frame), product) in self.tables.iter_mut().zip(frames).zip(&self.products_s) {
            if let Some(facts) = &self.facts[format_of(frame)] {
                tables.set(facts, product / longest, frame.exposure.gain, self.report.noise);
            }
        }
    }

    /// The fast loop over all pixels.
    fn run(&mut self, frames: &[Frame], pixels: usize, into: &mut Merged) {
        (into.width, into.height) = (frames[0].width, frames[0].height);
        into.radiance.resize(pixels, [0.0; 3]);
        into.state.resize(pixels, PixelState::Valid);
        self.suspects.clear();
        self.suspects.reserve(pixels);
        let shortest = self.products_s.iter().copied().fold(f64::INFINITY, f64::min);
        let clip = frames.first().and_then(|frame| self.facts[format_of(frame)].as_ref()).map_or([1.0; 3], |f| f.clip);
        let mut merging = Merging {
            radiance: &mut into.radiance,
            state: &mut into.state,
            suspects: &mut self.suspects,
            least: clip.map(|clip| clip / shortest as f32),
            per_second: (1.0 / longest_s(&self.products_s)) as f32,
        };
        let tables = &self.tables;
        if frames.iter().all(|frame| matches!(frame.codes, Codes::U8(_))) {
            kernel::merge(|i| source_u8(frames.get(i)?, &tables[i]), &mut merging);
        } else {
            kernel::merge(|i| source_u16(frames.get(i)?, &tables[i]), &mut merging);
        }
    }

    /// One standard deviation per channel of the series that was merged last, by the sensor's noise; the radiance itself where a
    /// channel was clipped in every frame. What ghosts left out is not told apart. Allocates.
    pub fn uncertainty(&self, frames: &[Frame], merged: &Merged) -> Vec<[f32; 3]> {
        let mut weights = vec![[0.0f32; 3]; merged.radiance.len()];
        for view in views(frames, &self.facts, &self.products_s, self.report.noise) {
            for (pixel, weight) in weights.iter_mut().enumerate() {
                *weight = std::array::from_fn(|channel| weight[channel] + view.weight(pixel, channel));
            }
        }
        let sigma = |weight: f32, radiance: f32| if weight > 0.0 { weight.sqrt().recip() } else { radiance };
        let pixels = weights.iter().zip(&merged.radiance);
        pixels.map(|(weight, radiance)| std::array::from_fn(|k| sigma(weight[k], radiance[k]))).collect()
    }

    /// Judges the pixels whose samples disagree.
    fn settle(&mut self, frames: &[Frame], pixels: usize, into: &mut Merged) {
        let report = &mut self.report;
        (report.reference, report.ghost_pixels) = (0, 0);
        report.inconsistent = self.suspects.len() as f64 > MergeSettings::MOST_SUSPECT * pixels as f64;
        if self.suspects.is_empty() || report.inconsistent || frames.len() > MOST_FRAMES {
            return;
        }
        let mut seen = views(frames, &self.facts, &self.products_s, report.noise);
        let views: [Option<View<'_>>; MOST_FRAMES] = std::array::from_fn(|_| seen.next());
        report.reference = reference_of(&views, pixels);
        report.ghost_pixels = self.ghosts.settle(&views, report.reference, &self.suspects, into);
    }
}

/// Calls for every channel value (its place in the frame, its channel) of some of a frame's pixels.
fn for_some(wanted: usize, pixels: usize, mut look: impl FnMut(usize, usize)) {
    // An odd step, so that rows of even length are not all looked at in the same columns.
    let stride = (pixels / wanted).max(1) | 1;
    for pixel in (0..pixels).step_by(stride) {
        (0..3).for_each(|channel| look(3 * pixel + channel, channel));
    }
}

fn check(frames: &[Frame]) -> Result<usize, MergeError> {
    let first = frames.first().ok_or(MergeError::Empty)?;
    let pixels = first.width * first.height;
    for (index, frame) in frames.iter().enumerate() {
        let same_format = format_of(frame) == format_of(first);
        let same_size = (frame.width, frame.height) == (first.width, first.height);
        if !same_size || !same_format || frame.codes.len() != pixels * 3 {
            return Err(MergeError::Size(index));
        }
        let product = frame.exposure.product_s();
        if !(product.is_finite() && product > 0.0) {
            return Err(MergeError::Exposure(index, product));
        }
    }
    Ok(pixels)
}

fn source_u8<'a>(frame: &'a Frame, tables: &'a FrameTables) -> Option<Source<'a, u8, 256>> {
    let Codes::U8(codes) = &frame.codes else { return None };
    Some(Source { codes, tables: tables.entries()? })
}

fn source_u16<'a>(frame: &'a Frame, tables: &'a FrameTables) -> Option<Source<'a, u16, 65_536>> {
    let Codes::U16(codes) = &frame.codes else { return None };
    Some(Source { codes, tables: tables.entries()? })
}

#[cfg(test)]
mod tests;
