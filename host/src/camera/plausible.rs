//! Whether pictures can be a sky at all: not the same one again and again, not noise, not black or white throughout.

use super::{Camera, CameraError, CameraLimits, Codes, Exposure, Frame};
use std::fmt;

/// The same picture so many times in a row is a stuck one: the noise of a sensor never repeats.
const STUCK_FRAMES: u32 = 4;
/// Codes of black and white, as shares of the largest code.
const BLACK: f64 = 0.02;
const WHITE: f64 = 0.98;
/// A picture with fewer pixels than this between black and white shows nothing, as a share; a round lens's corners are
/// black in a white one too.
const LEAST_SHADES: f64 = 0.001;
/// White pixels of a picture that is white through a round lens, at least.
const WHITE_SHARE: f64 = 0.25;
/// Exposures within this factor of a limit count as the limit: cameras round.
const AT_LIMIT: f64 = 2.0;
/// Neighbours in a picture are alike; those of noise differ as much as any two pixels, which gives 1.
const NOISE_RATIO: f64 = 0.7;
/// Noise of less than this deviation, as a share of the largest code, may be a dark sky's.
const NOISE_DEVIATION: f64 = 0.08;
/// How far away a neighbour is, px.
const NEIGHBOUR: usize = 2;
/// Pixels that the statistics look at, about.
const SAMPLES: usize = 8192;

/// What is wrong with pictures that come in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFault {
    /// Every code is as in the frames before.
    Stuck,
    /// Neighbouring pixels have nothing to do with each other.
    Noise,
    /// Black even at the longest exposure. A fault while the sun is up; a dark night looks the same.
    Black,
    /// White even at the shortest exposure.
    White,
}

impl fmt::Display for PictureFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PictureFault::Stuck => "stuck: the same one comes again and again",
            PictureFault::Noise => "nothing but noise",
            PictureFault::Black => "black at every exposure: cap on the lens?",
            PictureFault::White => "white at every exposure",
        })
    }
}

/// What one look at a picture gives.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Look {
    black: bool,
    white: bool,
    /// Share of pixels between black and white.
    shades: f64,
    /// Mean square difference of neighbours over twice the variance.
    roughness: f64,
    /// Standard deviation, share of the largest code.
    deviation: f64,
}

/// A hash of all codes; equal pictures have equal ones.
fn fingerprint(codes: &Codes) -> u64 {
    let mix = |hash: u64, word: u64| (hash ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    let bytes: &[u8] = match codes {
        Codes::U8(codes) => codes,
        Codes::U16(codes) => bytemuck::cast_slice(codes),
    };
    let (words, rest) = bytes.as_chunks::<8>();
    let hash = words.iter().fold(bytes.len() as u64, |hash, &word| mix(hash, u64::from_le_bytes(word)));
    rest.iter().fold(hash, |hash, &byte| mix(hash, u64::from(byte)))
}

/// Green alone, as a share of the largest code: every format has it at its finest.
fn look(frame: &Frame) -> Look {
    let (width, height) = (frame.width, frame.height);
    let scale = 1.0 / f64::from(frame.codes.max());
    let green = |x: usize, y: usize| f64::from(frame.codes.get((y * width + x) * 3 + 1)) * scale;
    // Two pixels on, because nearer ones share their chroma. Neither neighbour may be out of the picture.
    let step = (width * height / SAMPLES).max(1);
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    let (mut across, mut down) = (0.0, 0.0);
    let (mut dark, mut light) = (0.0, 0.0);
    for at in (0..width * height).step_by(step) {
        let (x, y) = (at % width, at / width);
        if x + NEIGHBOUR >= width || y + NEIGHBOUR >= height {
            continue;
        }
        let value = green(x, y);
        count += 1.0;
        sum += value;
        squares += value * value;
        across += (value - green(x + NEIGHBOUR, y)).powi(2);
        down += (value - green(x, y + NEIGHBOUR)).powi(2);
        dark += f64::from(u8::from(value <= BLACK));
        light += f64::from(u8::from(value >= WHITE));
    }
    if count == 0.0 {
        return Look { black: false, white: false, shades: 0.0, roughness: 0.0, deviation: 0.0 };
    }
    let variance = (squares / count - (sum / count).powi(2)).max(0.0);
    let rough = f64::min(across, down) / count / (2.0 * variance).max(1e-12);
    let shades = (count - dark - light) / count;
    let white = light >= WHITE_SHARE * count && shades < LEAST_SHADES;
    let black = dark >= (1.0 - LEAST_SHADES) * count;
    Look { black, white, shades, roughness: rough, deviation: variance.sqrt() }
}

/// A camera whose pictures are looked at before they are handed on. Stuck and noisy ones become errors. Black and white
/// ones are handed on, as the choice of exposures needs them; [`Plausible::fault`] tells when no exposure is left.
pub struct Plausible<C> {
    inner: C,
    fault: Option<PictureFault>,
    is_black: bool,
    last: Option<(u64, Exposure)>,
    repeats: u32,
}

impl<C: Camera> Plausible<C> {
    /// Watches a camera.
    pub fn new(inner: C) -> Self {
        Plausible { inner, fault: None, is_black: false, last: None, repeats: 0 }
    }

    /// What was wrong with the newest picture, or is still wrong with the camera.
    pub fn fault(&self) -> Option<PictureFault> {
        self.fault
    }

    /// Whether the newest picture was black, at whatever exposure.
    pub fn is_black(&self) -> bool {
        self.is_black
    }

    /// The camera inside.
    pub fn inner_mut(&mut self) -> &mut C {
        &mut self.inner
    }

    /// Whether this is the picture before, at its exposure too often or at another one at all.
    fn is_stuck(&mut self, frame: &Frame) -> bool {
        let print = fingerprint(&frame.codes);
        let Some((before, exposure)) = self.last.replace((print, frame.exposure)) else { return false };
        if before != print {
            self.repeats = 0;
            return false;
        }
        self.repeats += 1;
        let known = frame.exposure.product_s() > 0.0 && exposure.product_s() > 0.0;
        let ratio = frame.exposure.product_s() / exposure.product_s();
        let brighter = known && !(1.0 / AT_LIMIT..=AT_LIMIT).contains(&ratio);
        // Once another exposure has shown that it is stuck, the way back to the first one changes nothing.
        if brighter {
            self.repeats = STUCK_FRAMES;
        }
        self.repeats + 1 >= STUCK_FRAMES
    }

    fn judge(&mut self, frame: &Frame) -> Option<PictureFault> {
        let look = look(frame);
        self.is_black = look.black;
        let limits = self.inner.limits();
        let asked = frame.exposure.product_s();
        if look.shades < 10.0 * LEAST_SHADES {
            // Clipped codes repeat by nature.
            self.last = None;
            self.repeats = 0;
        }
        if look.black || look.white {
            let at_longest = asked * AT_LIMIT >= limits.max_exposure_s * limits.max_gain;
            let at_shortest = asked > 0.0 && asked <= limits.min_exposure_s * AT_LIMIT;
            // What is known of the camera stands until a picture shows.
            let standing = |fault| self.fault.filter(|&before| before == fault);
            return match look.black {
                true if at_longest => Some(PictureFault::Black),
                true => standing(PictureFault::Black),
                false if at_shortest => Some(PictureFault::White),
                false => standing(PictureFault::White),
            };
        }
        if look.shades >= 10.0 * LEAST_SHADES && self.is_stuck(frame) {
            return Some(PictureFault::Stuck);
        }
        let noise = look.roughness > NOISE_RATIO && look.deviation > NOISE_DEVIATION;
        noise.then_some(PictureFault::Noise)
    }
}

impl<C: Camera> Camera for Plausible<C> {
    fn stand_frames(&self) -> u32 {
        self.inner.stand_frames()
    }

    fn limits(&self) -> CameraLimits {
        self.inner.limits()
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        self.inner.request(exposure)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        self.inner.frame(into)?;
        self.fault = self.judge(into);
        match self.fault {
            Some(fault @ (PictureFault::Stuck | PictureFault::Noise)) => Err(CameraError::Implausible(fault)),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
