//! A still with the scene's edges, the measured points and ten times their residuals drawn upon it, for an eye to judge.

use super::Seen;
use super::edges::Line;
use super::model::diagonal_px;
use image::{DynamicImage, ImageDecoder, ImageReader, RgbImage};
use std::path::{Path, PathBuf};

/// Residuals are drawn so many times longer.
pub const LONGER: f64 = 10.0;

const EDGES: [u8; 3] = [0, 230, 255];
const FITS: [u8; 3] = [255, 225, 0];
const STRAY: [u8; 3] = [255, 40, 40];
const HALO: [u8; 3] = [0, 0, 0];

/// A still that cannot be read; one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: cannot be read as a PNG, JPEG or TIFF picture: {reason}", file.display())]
pub struct StillError {
    file: PathBuf,
    reason: String,
}

/// Reads a still as 8-bit sRGB, upright as its EXIF orientation says.
///
/// # Errors
/// [`StillError`].
pub fn load_still(file: &Path) -> Result<RgbImage, StillError> {
    let decode = || -> image::ImageResult<DynamicImage> {
        let mut decoder = ImageReader::open(file)?.with_guessed_format()?.into_decoder()?;
        let orientation = decoder.orientation()?;
        let mut picture = DynamicImage::from_decoder(decoder)?;
        picture.apply_orientation(orientation);
        Ok(picture)
    };
    let told = |reason: String| StillError { file: file.to_owned(), reason };
    let picture = decode().map_err(|error| told(error.to_string()))?.into_rgb8();
    if picture.width() == 0 || picture.height() == 0 { Err(told("it has no pixels".to_owned())) } else { Ok(picture) }
}

/// `still` with all that is drawn upon it, `[y][x]` RGBA.
pub fn draw(still: &RgbImage, edges: &[Line], seen: &[Seen]) -> Vec<[u8; 4]> {
    let size = [still.width(), still.height()];
    let unit = (diagonal_px(size) / 1400.0).max(1.0);
    let mut pixels: Vec<[f32; 3]> = still.pixels().map(|pixel| pixel.0.map(f32::from)).collect();
    let mut sheet = Sheet::new(size);
    let mut ink = |lines: &[Line], color: [u8; 3], width: f64| {
        sheet.ink(&mut pixels, lines, (HALO, 0.55), width + 2.0 * unit);
        sheet.ink(&mut pixels, lines, (color, 1.0), width);
    };
    ink(edges, EDGES, unit);
    for (wanted, color) in [(true, FITS), (false, STRAY)] {
        let marks: Vec<Line> = seen.iter().filter(|s| s.fits == wanted).flat_map(|s| mark(s, unit)).collect();
        ink(&marks, color, 1.2 * unit);
    }
    pixels.into_iter().map(|[r, g, b]| [r, g, b, 255.0].map(|v: f32| v.round() as u8)).collect()
}

/// A ring around a point, its line's number, and an arrow along its residual.
fn mark(seen: &Seen, unit: f64) -> Vec<Line> {
    let [u, v] = seen.point.position_px;
    let on_ring = |k: u32| {
        let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 20.0).sin_cos();
        [u + 6.0 * unit * cos, v + 6.0 * unit * sin]
    };
    let mut lines: Vec<Line> = (0..20).map(|k| [on_ring(k), on_ring(k + 1)]).collect();
    lines.extend(number(seen.point.line, [u + 9.0 * unit, v - 9.0 * unit], 2.2 * unit));
    let Some([du, dv]) = seen.residual_px else { return lines };
    let length = LONGER * du.hypot(dv);
    if length > unit {
        let tip = [u + LONGER * du, v + LONGER * dv];
        lines.push([[u, v], tip]);
        let (along, barb) = ([du, dv].map(|c| c * LONGER / length), (0.4 * length).min(5.0 * unit));
        for side in [-0.5, 0.5] {
            let back = [along[0] + side * along[1], along[1] - side * along[0]];
            lines.push([tip, [tip[0] - barb * back[0], tip[1] - barb * back[1]]]);
        }
    }
    lines
}

/// Strokes of the digits on a grid of 2 x 4, as pairs of corners `column + 3 * row`.
const DIGITS: [&[(u8, u8)]; 10] = [
    &[(0, 2), (2, 14), (14, 12), (12, 0)],
    &[(1, 13)],
    &[(0, 2), (2, 8), (8, 6), (6, 12), (12, 14)],
    &[(0, 2), (2, 14), (14, 12), (6, 8)],
    &[(0, 6), (6, 8), (2, 14)],
    &[(2, 0), (0, 6), (6, 8), (8, 14), (14, 12)],
    &[(2, 0), (0, 12), (12, 14), (14, 8), (8, 6)],
    &[(0, 2), (2, 14)],
    &[(0, 2), (2, 14), (14, 12), (12, 0), (6, 8)],
    &[(8, 6), (6, 0), (0, 2), (2, 14), (14, 12)],
];

/// The strokes of a number whose last digit's lower left corner lies at `at`.
fn number(value: usize, at: [f64; 2], step: f64) -> Vec<Line> {
    let corner = |place: f64, code: u8| {
        [at[0] + (place * 3.2 + f64::from(code % 3)) * step, at[1] + (f64::from(code / 3) - 4.0) * step]
    };
    let digits = value.to_string();
    let strokes = |(place, digit): (usize, u8)| {
        DIGITS[usize::from(digit - b'0')].iter().map(move |&(a, b)| [corner(place as f64, a), corner(place as f64, b)])
    };
    digits.bytes().enumerate().flat_map(strokes).collect()
}

/// How much of each pixel a set of lines covers.
struct Sheet {
    size: [u32; 2],
    /// `[y][x]`, 0 between uses.
    covered: Vec<f32>,
}

impl Sheet {
    fn new(size: [u32; 2]) -> Self {
        Sheet { size, covered: vec![0.0; size[0] as usize * size[1] as usize] }
    }

    /// Lays lines of `width` px in one colour over `pixels`; where they cross they are no darker.
    fn ink(&mut self, pixels: &mut [[f32; 3]], lines: &[Line], (color, opacity): ([u8; 3], f32), width: f64) {
        for line in lines {
            self.stroke(line, 0.5 * width);
        }
        for (pixel, covered) in pixels.iter_mut().zip(&mut self.covered) {
            let share = opacity * std::mem::take(covered);
            for (value, ink) in pixel.iter_mut().zip(color) {
                *value += share * (f32::from(ink) - *value);
            }
        }
    }

    fn stroke(&mut self, &[a, b]: &Line, radius: f64) {
        let reach = radius + 1.0;
        let range = |c: usize| {
            let end = f64::from(self.size[c]);
            let [low, high] = [a[c].min(b[c]) - reach, a[c].max(b[c]) + reach].map(|v| v.clamp(0.0, end));
            low.floor() as u32..high.ceil() as u32
        };
        let along = [b[0] - a[0], b[1] - a[1]];
        let squared = along[0] * along[0] + along[1] * along[1];
        for y in range(1) {
            for x in range(0) {
                let from = [f64::from(x) + 0.5 - a[0], f64::from(y) + 0.5 - a[1]];
                let share = ((from[0] * along[0] + from[1] * along[1]) / squared.max(1e-12)).clamp(0.0, 1.0);
                let distance = (from[0] - share * along[0]).hypot(from[1] - share * along[1]);
                let covered = (radius + 0.5 - distance).clamp(0.0, 1.0) as f32;
                let pixel = &mut self.covered[y as usize * self.size[0] as usize + x as usize];
                *pixel = pixel.max(covered);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::points::Point;

    #[test]
    fn lines_are_as_wide_as_asked_and_stay_within_the_picture() {
        let mut sheet = Sheet::new([20, 10]);
        let mut pixels = vec![[0.0; 3]; 200];
        sheet.ink(&mut pixels, &[[[-5.0, 5.0], [30.0, 5.0]], [[3.0, -4.0], [3.0, 40.0]]], ([255; 3], 1.0), 2.0);
        let column: f32 = (0..10).map(|y| pixels[20 * y + 10][0]).sum();
        assert!((column - 2.0 * 255.0).abs() < 1.0, "{column}");
        assert!(sheet.covered.iter().all(|&covered| covered == 0.0));
    }

    #[test]
    fn a_stray_is_red_and_its_arrow_ten_times_its_residual() {
        let still = RgbImage::new(200, 100);
        let point = Point { line: 7, position_px: [50.0, 50.0], world: glam::DVec3::ZERO };
        let drawn = draw(&still, &[], &[Seen { point, residual_px: Some([10.0, 0.0]), fits: false }]);
        let [red, green, blue, _] = drawn[50 * 200 + 140];
        assert!(red > 140 && green < 30 && blue < 30, "({red}, {green}, {blue})");
        assert_eq!(drawn[50 * 200 + 160][..3], [0; 3]);
    }
}
