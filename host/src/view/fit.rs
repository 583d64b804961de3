//! A camera's picture as the view: 8-bit sRGB words of the field's size.
//!
//! A picture of that size is taken as it is, or by its camera's own curve ([`super::curve`]). One of the same shape is scaled,
//! in linear light: by a triangle as wide as the coarser of the two grids, that is bilinear when it grows and free of aliases
//! when it shrinks. Other shapes are refused: what of a picture is to be seen is a question of lens and pose, not of scaling.

use super::curve::{LightTables, ViewCurve};
use crate::camera::{Codes, Frame};

/// Shapes may differ by so much; the surplus is cut off on both sides.
const SHAPE_TOLERANCE: f64 = 0.01;
/// Fraction bits of a tap's weight.
const WEIGHT_BITS: u32 = 15;

/// A picture of another shape than the field; one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "gives {}x{} pixels, another shape than the field's {}x{}: ask for a size of that shape (view_camera.size), or bake the \
     field for the camera",
    found.0, found.1, field.0, field.1
)]
pub struct ShapeError {
    found: (usize, usize),
    field: (usize, usize),
}

/// Brings pictures to one size; keeps its buffers.
#[derive(Clone, Debug)]
pub struct Fit {
    size: (usize, usize),
    curve: Option<ViewCurve>,
    /// Where there is a curve, or something to scale.
    tables: Option<LightTables>,
    scaler: Option<Scaler>,
}

impl Fit {
    /// For a field of `size` = width and height, px.
    pub fn new(size: (usize, usize)) -> Self {
        Fit { size, curve: None, tables: None, scaler: None }
    }

    /// Takes pictures by the curve of their camera; without one their codes are sRGB.
    #[must_use]
    pub fn with_curve(mut self, curve: Option<ViewCurve>) -> Self {
        (self.curve, self.tables) = (curve, None);
        self
    }

    /// Can a picture of `found` = width and height stand behind the field?
    ///
    /// # Errors
    /// [`ShapeError`] if it would have to be stretched.
    pub fn check(&self, found: (usize, usize)) -> Result<(), ShapeError> {
        let shape = |(width, height): (usize, usize)| width as f64 / height as f64;
        let stretch = shape(found) / shape(self.size);
        let fits = (stretch - 1.0).abs() <= SHAPE_TOLERANCE;
        if fits { Ok(()) } else { Err(ShapeError { found, field: self.size }) }
    }

    /// Fills `pixels_bgrx` (`0x00RRGGBB` sRGB, row 0 at the top) with a frame; allocates only when its size or depth has
    /// changed. Codes of 16 bits that are sRGB are rounded to 8 first.
    ///
    /// # Errors
    /// [`ShapeError`]; the pixels then stay as they were.
    pub fn fit(&mut self, frame: &Frame, pixels_bgrx: &mut Vec<u32>) -> Result<(), ShapeError> {
        let from = (frame.width, frame.height);
        self.check(from)?;
        pixels_bgrx.resize(self.size.0 * self.size.1, 0);
        let same = from == self.size;
        if !same && self.scaler.as_ref().is_none_or(|scaler| scaler.from != from) {
            self.scaler = Some(Scaler::new(from, self.size));
        }
        let has_curve = self.curve.is_some();
        let codes = if has_curve && matches!(frame.codes, Codes::U16(_)) { 65536 } else { 256 };
        if (has_curve || !same) && self.tables.as_ref().is_none_or(|tables| tables.codes() != codes) {
            self.tables = Some(LightTables::new(self.curve.as_ref(), codes));
        }
        let way = match (&self.tables, &mut self.scaler) {
            (Some(tables), Some(scaler)) if !same => Way::Scaled(scaler, tables),
            (Some(tables), _) if has_curve => Way::ByCurve(tables),
            _ => Way::AsItIs,
        };
        match &frame.codes {
            Codes::U8(codes) => way.bring(codes, usize::from, pixels_bgrx),
            Codes::U16(codes) if has_curve => way.bring(codes, usize::from, pixels_bgrx),
            Codes::U16(codes) => way.bring(codes, |code| (usize::from(code) + 128) / 257, pixels_bgrx),
        }
        Ok(())
    }
}

/// How a picture's codes become the view's pixels.
enum Way<'t> {
    AsItIs,
    ByCurve(&'t LightTables),
    Scaled(&'t mut Scaler, &'t LightTables),
}

impl Way<'_> {
    /// `place` of a code is that in the tables.
    fn bring<T: Copy>(self, codes: &[T], place: impl Fn(T) -> usize, pixels_bgrx: &mut [u32]) {
        let pixels = pixels_bgrx.iter_mut().zip(codes.chunks_exact(3));
        match self {
            Way::AsItIs => pixels.for_each(|(pixel, rgb)| {
                let [r, g, b] = [0, 1, 2].map(|channel| place(rgb[channel]) as u8);
                *pixel = u32::from_be_bytes([0, r, g, b]);
            }),
            Way::ByCurve(tables) => {
                let shown = tables.shown();
                pixels.for_each(|(pixel, rgb)| {
                    let [r, g, b] = [0, 1, 2].map(|channel| shown[channel][place(rgb[channel])]);
                    *pixel = u32::from_be_bytes([0, r, g, b]);
                });
            }
            Way::Scaled(scaler, tables) => scaler.scale(codes, place, tables, pixels_bgrx),
        }
    }
}

/// Where each coordinate of one axis takes its light: `width` taps from `first` on, weights of 1/32768 that add up to 1.
#[derive(Clone, Debug)]
struct Taps {
    first: Vec<usize>,
    weights: Vec<u32>,
    width: usize,
}

impl Taps {
    /// From `from` coordinates to `to`; one step there is `pitch` here, and the middles lie upon each other.
    fn new(from: usize, to: usize, pitch: f64) -> Self {
        let radius = pitch.max(1.0);
        let width = (2.0 * radius).ceil() as usize + 1;
        let width = width.min(from);
        let (mut firsts, mut weights) = (Vec::with_capacity(to), Vec::with_capacity(to * width));
        for at in 0..to {
            let centre = (at as f64 + 0.5 - 0.5 * to as f64) * pitch + 0.5 * from as f64 - 0.5;
            let first = ((centre - radius).ceil().max(0.0) as usize).min(from - width);
            let exact: Vec<f64> =
                (0..width).map(|k| (1.0 - ((first + k) as f64 - centre).abs() / radius).max(0.0)).collect();
            firsts.push(first);
            weights.extend(rounded(&exact));
        }
        Taps { first: firsts, weights, width }
    }

    /// The taps of coordinate `at`.
    fn of(&self, at: usize) -> (usize, &[u32]) {
        (self.first[at], &self.weights[at * self.width..(at + 1) * self.width])
    }
}

/// Weights whose sum is exactly 1; what rounding loses goes to the largest.
fn rounded(exact: &[f64]) -> Vec<u32> {
    let one = f64::from(1u32 << WEIGHT_BITS) / exact.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut weights: Vec<u32> = exact.iter().map(|weight| (weight * one).round() as u32).collect();
    let sum: u32 = weights.iter().sum();
    if let Some(largest) = weights.iter_mut().max() {
        *largest = (*largest + (1 << WEIGHT_BITS)).saturating_sub(sum);
    }
    weights
}

/// Scales pictures of one size to another, rows first.
#[derive(Clone, Debug)]
struct Scaler {
    from: (usize, usize),
    to: (usize, usize),
    columns: Taps,
    rows: Taps,
    /// One row of the picture, linear.
    line: Vec<u16>,
    /// The picture with its rows scaled: `[from.height][to.width][3]`, linear.
    between: Vec<u16>,
    /// Sums of one row.
    sums: Vec<u32>,
}

impl Scaler {
    fn new(from: (usize, usize), to: (usize, usize)) -> Self {
        // One pitch for both axes keeps pixels square; the smaller one leaves no edge without light.
        let pitch = (from.0 as f64 / to.0 as f64).min(from.1 as f64 / to.1 as f64);
        Scaler {
            from,
            to,
            columns: Taps::new(from.0, to.0, pitch),
            rows: Taps::new(from.1, to.1, pitch),
            line: vec![0; from.0 * 3],
            between: vec![0; from.1 * to.0 * 3],
            sums: vec![0; to.0 * 3],
        }
    }

    fn scale<T: Copy>(
        &mut self,
        codes: &[T],
        place: impl Fn(T) -> usize,
        tables: &LightTables,
        pixels_bgrx: &mut [u32],
    ) {
        const HALF: u32 = 1 << (WEIGHT_BITS - 1);
        let light = tables.light();
        let across = self.to.0 * 3;
        for (row, out) in codes.chunks_exact(self.from.0 * 3).zip(self.between.chunks_exact_mut(across)) {
            for (pixel, rgb) in self.line.chunks_exact_mut(3).zip(row.chunks_exact(3)) {
                (0..3).for_each(|channel| pixel[channel] = light[channel][place(rgb[channel])]);
            }
            for (x, pixel) in out.chunks_exact_mut(3).enumerate() {
                let (first, weights) = self.columns.of(x);
                let mut sums = [HALF; 3];
                for (rgb, weight) in self.line[3 * first..].chunks_exact(3).zip(weights) {
                    sums.iter_mut().zip(rgb).for_each(|(sum, &light)| *sum += weight * u32::from(light));
                }
                pixel.iter_mut().zip(sums).for_each(|(value, sum)| *value = (sum >> WEIGHT_BITS) as u16);
            }
        }
        for (y, out) in pixels_bgrx.chunks_exact_mut(self.to.0).enumerate() {
            let (first, weights) = self.rows.of(y);
            self.sums.fill(HALF);
            for (row, weight) in self.between[first * across..].chunks_exact(across).zip(weights) {
                self.sums.iter_mut().zip(row).for_each(|(sum, &value)| *sum += weight * u32::from(value));
            }
            for (pixel, sums) in out.iter_mut().zip(self.sums.chunks_exact(3)) {
                let code = |sum: u32| tables.srgb(sum >> WEIGHT_BITS);
                *pixel = u32::from_be_bytes([0, code(sums[0]), code(sums[1]), code(sums[2])]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::srgb_code;
    use crate::response::Response;

    fn frame(width: usize, height: usize, rgb: impl Fn(usize, usize) -> [u8; 3]) -> Frame {
        let mut frame = Frame::default();
        for (at, pixel) in frame.codes_u8(width, height).chunks_exact_mut(3).enumerate() {
            pixel.copy_from_slice(&rgb(at % width, at / width));
        }
        frame
    }

    fn fitted(frame: &Frame, size: (usize, usize)) -> Vec<[u8; 3]> {
        let mut pixels = Vec::new();
        Fit::new(size).fit(frame, &mut pixels).unwrap();
        pixels.iter().map(|word| word.to_be_bytes()).map(|[_, r, g, b]| [r, g, b]).collect()
    }

    #[test]
    fn the_right_size_is_taken_as_it_is() {
        let picture = frame(5, 3, |x, y| [x as u8, y as u8, 200]);
        let pixels = fitted(&picture, (5, 3));
        assert_eq!((pixels[0], pixels[14]), ([0, 0, 200], [4, 2, 200]));
        let mut deep = Frame::default();
        deep.codes_u16(1, 1).copy_from_slice(&[65535, 257 * 18, 257 * 18 + 129]);
        assert_eq!(fitted(&deep, (1, 1)), [[255, 18, 19]]);
    }

    #[test]
    fn an_even_picture_keeps_every_code_at_every_size() {
        for code in 0..=255 {
            let picture = frame(32, 18, |_, _| [code, 255 - code, 7]);
            for size in [(16, 9), (48, 27), (64, 36), (80, 45)] {
                assert!(fitted(&picture, size).iter().all(|&rgb| rgb == [code, 255 - code, 7]), "{code} at {size:?}");
            }
        }
    }

    #[test]
    fn halving_averages_light_and_not_codes() {
        // Black and white lines one pixel wide are half of white's light: code 188, not 128.
        let lines = frame(64, 36, |x, _| [if x % 2 == 0 { 0 } else { 255 }; 3]);
        let pixels = fitted(&lines, (32, 18));
        assert!(pixels[40..52].iter().all(|&rgb| rgb == [188; 3]), "{:?}", &pixels[40..52]);
    }

    /// A ramp that is linear in light stays the same ramp, with no shift of half a pixel.
    #[test]
    fn a_ramp_stays_where_it_is() {
        let light = |u: f64| srgb_code(0.1 + 0.8 * u);
        let ramp = frame(64, 36, |x, y| [light((x as f64 + 0.5) / 64.0), light((y as f64 + 0.5) / 36.0), 0]);
        for (width, height) in [(32, 18), (128, 72), (96, 54), (80, 45)] {
            for (at, rgb) in fitted(&ramp, (width, height)).into_iter().enumerate() {
                let (x, y) = (at % width, at / width);
                // At the edges there is nothing beyond to average with.
                let inside = (4..width - 4).contains(&x) && (4..height - 4).contains(&y);
                let expected = [(x, width), (y, height)].map(|(at, of)| light((at as f64 + 0.5) / of as f64));
                let off = |k: usize| rgb[k].abs_diff(expected[k]);
                assert!(!inside || (off(0) <= 1 && off(1) <= 1), "{rgb:?} {expected:?} at {x} {y} of {width}x{height}");
            }
        }
    }

    /// Curves far from sRGB, another in each channel: a power law, and a film-like S over it.
    fn film(code: f64, channel: usize) -> f64 {
        let toe = code * code * (3.0 - 2.0 * code);
        [code.powf(1.8), 0.5 * (toe + toe.powf(2.0)), code.powf(2.6)][channel]
    }

    fn by_film(size: (usize, usize)) -> Fit {
        let code = |row: u32| f64::from(row) / 1024.0;
        let rows = (0..=1024).map(|row| [code(row), film(code(row), 0), film(code(row), 1), film(code(row), 2)]);
        let response = Response::from_rows(rows.collect(), "film").unwrap();
        Fit::new(size).with_curve(Some(ViewCurve::new(response, "film").unwrap()))
    }

    #[test]
    fn a_cameras_own_curve_is_taken_to_linear_light_at_every_size_and_depth() {
        let mut pixels = Vec::new();
        for (size, is_deep) in [((32, 18), false), ((32, 18), true), ((16, 9), false), ((48, 27), true)] {
            let mut fit = by_film(size);
            for code in 0..=255u8 {
                let rgb = [code, 255 - code, code / 2];
                let expected: [u8; 3] =
                    std::array::from_fn(|channel| srgb_code(film(f64::from(rgb[channel]) / 255.0, channel)));
                let mut picture = frame(32, 18, |_, _| rgb);
                if is_deep {
                    let deep = rgb.map(|code| 257 * u16::from(code));
                    picture.codes_u16(32, 18).chunks_exact_mut(3).for_each(|pixel| pixel.copy_from_slice(&deep));
                }
                fit.fit(&picture, &mut pixels).unwrap();
                let mut shown = pixels.iter().map(|word| word.to_be_bytes()).map(|[_, r, g, b]| [r, g, b]);
                let off = |rgb: [u8; 3]| (0..3).map(|c| rgb[c].abs_diff(expected[c])).max();
                assert!(shown.all(|rgb| off(rgb) <= Some(1)), "{expected:?} at {size:?}");
            }
        }
        // Lines of black and white are half of white's light in every channel, whatever the curve.
        let lines = frame(64, 36, |x, _| [if x % 2 == 0 { 0 } else { 255 }; 3]);
        by_film((32, 18)).fit(&lines, &mut pixels).unwrap();
        assert!(pixels[40..52].iter().all(|&word| word == 0xbc_bcbc), "{:x}", pixels[44]);
    }

    #[test]
    fn another_shape_is_refused_with_what_to_do() {
        let mut pixels = vec![1, 2];
        let error = Fit::new((1920, 1080)).fit(&frame(64, 48, |_, _| [0; 3]), &mut pixels).unwrap_err().to_string();
        assert!(
            error.contains("64x48") && error.contains("1920x1080") && error.contains("view_camera.size"),
            "{error}"
        );
        assert_eq!(pixels, [1, 2]);
        // 1366x768 is 16:9 to within a third of a per cent.
        assert!(Fit::new((1920, 1080)).check((1366, 768)).is_ok());
    }
}
