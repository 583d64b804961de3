//! A view camera's own curve: its codes -> linear light -> sRGB.
//!
//! What is behind the picture is mixed with it in linear light, and the display takes the result for sRGB. Of a camera that
//! renders otherwise (a film-like curve, or none) both would be wrong: the light of its codes, and how bright they are shown. So
//! its pictures become sRGB where they come in, by a table per channel, and everything behind that point (shadows on receivers,
//! the view's gain, edges, masks, the display) is right as it is. The other way, virtual pixels by the camera's curve, would
//! leave the camera's codes alone, but show real and virtual alike with the wrong contrast, and need another tone in every kernel.
//!
//! Noise stays, as its light is; what is clipped stays white, and black stays black. A code is off by half an sRGB code at
//! most, as any rounding to 8 bits; but where the camera's curve is flatter than sRGB's its codes lie further apart, and where
//! it is steeper some fall together. [`ViewCurve::grain`] tells both.

use crate::picture::{srgb_code, srgb_linear};
use crate::response::{Response, ResponseError};
use std::path::Path;

/// Light that the ends of a curve may be off from black and from white: less than four sRGB codes, and less than half of one.
const ENDS: f64 = 1e-3;

/// The curve of a camera whose pictures are a view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewCurve(Response);

/// How a curve's 256 codes become sRGB ones; of the worst channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grain {
    /// sRGB codes that come of them.
    pub distinct: usize,
    /// sRGB codes from one to the next, at most.
    pub widest_step: u8,
}

impl ViewCurve {
    /// Reads a curve as `relume sky response` writes it: rows `code/max,R,G,B`, linear, full well = 1.
    ///
    /// # Errors
    /// [`ResponseError`], naming file and line; also of a curve that does not lead from black to white.
    pub fn load(path: &Path) -> Result<Self, ResponseError> {
        ViewCurve::new(Response::load(path)?, &path.display().to_string())
    }

    /// The same where a curve is named.
    ///
    /// # Errors
    /// As [`ViewCurve::load`].
    pub fn load_named(path: Option<&Path>) -> Result<Option<Self>, ResponseError> {
        path.map(ViewCurve::load).transpose()
    }

    /// Of a response curve; `name` is what errors call it.
    ///
    /// # Errors
    /// [`ResponseError::Curve`] where a channel does not begin at 0 or not end at 1: black and clipped pixels would be tinted.
    pub fn new(response: Response, name: &str) -> Result<Self, ResponseError> {
        let curve = |what| Err(ResponseError::Curve { name: name.into(), what });
        let ends = |code: f64| (0..3).map(|channel| response.fraction(code, channel)).collect::<Vec<_>>();
        if ends(0.0).iter().any(|&light| light > ENDS) {
            return curve(
                "code 0 of a view must be light 0 in every channel, or black is shown grey; subtract what it begins at",
            );
        }
        if ends(1.0).iter().any(|&light| light < 1.0 - ENDS) {
            return curve(
                "the largest code of a view must be light 1 in every channel, or what is clipped is shown tinted; divide each channel by its last value",
            );
        }
        Ok(ViewCurve(response))
    }

    /// What 8-bit pictures lose by it.
    pub fn grain(&self) -> Grain {
        let tables = LightTables::new(Some(self), 256);
        let mut worst = Grain { distinct: 256, widest_step: 0 };
        for codes in &tables.shown {
            let steps = || codes.windows(2).map(|pair| pair[1] - pair[0]);
            worst.distinct = worst.distinct.min(1 + steps().filter(|&step| step > 0).count());
            worst.widest_step = worst.widest_step.max(steps().max().unwrap_or(0));
        }
        worst
    }
}

/// Linear light and sRGB of every code of a camera.
#[derive(Clone, Debug)]
pub(super) struct LightTables {
    /// `[channel][code]`, 65535 for white.
    light: [Vec<u16>; 3],
    /// `[channel][code]`: what is shown for it.
    shown: [Vec<u8>; 3],
    /// sRGB codes of linear light.
    srgb: Vec<u8>,
}

impl LightTables {
    /// Of a camera with so many codes (256 or 65536); without a curve they are sRGB.
    pub(super) fn new(curve: Option<&ViewCurve>, codes: usize) -> Self {
        let last = (codes - 1) as f64;
        let linear = |code: usize, channel: usize| match curve {
            Some(ViewCurve(response)) => response.fraction(code as f64 / last, channel),
            None => srgb_linear((255.0 * code as f64 / last).round() as u8),
        };
        let srgb: Vec<u8> = (0..=65535).map(|light| srgb_code(f64::from(light) / 65535.0)).collect();
        let light: [Vec<u16>; 3] = std::array::from_fn(|channel| {
            (0..codes).map(|code| (65535.0 * linear(code, channel)).round() as u16).collect()
        });
        let shown = std::array::from_fn(|channel| light[channel].iter().map(|&l| srgb[usize::from(l)]).collect());
        LightTables { light, shown, srgb }
    }

    /// Codes that they are for.
    pub(super) fn codes(&self) -> usize {
        self.light[0].len()
    }

    /// Linear light of a code, 65535 for white, per channel.
    pub(super) fn light(&self) -> [&[u16]; 3] {
        std::array::from_fn(|channel| &self.light[channel][..])
    }

    /// What is shown for a code, per channel.
    pub(super) fn shown(&self) -> [&[u8]; 3] {
        std::array::from_fn(|channel| &self.shown[channel][..])
    }

    /// The sRGB code of linear light of which 65535 is white.
    #[inline]
    pub(super) fn srgb(&self, light: u32) -> u8 {
        self.srgb[light as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(light: impl Fn(f64, usize) -> f64) -> Result<ViewCurve, ResponseError> {
        let row = |code: u32| f64::from(code) / 255.0;
        let rows = (0..=255).map(|code| [row(code), light(row(code), 0), light(row(code), 1), light(row(code), 2)]);
        ViewCurve::new(Response::from_rows(rows.collect(), "view.csv")?, "view.csv")
    }

    #[test]
    fn a_curve_that_is_srgb_changes_no_code() {
        let srgb = curve(|code, _| srgb_linear((255.0 * code).round() as u8)).unwrap();
        let tables = LightTables::new(Some(&srgb), 256);
        assert!(tables.shown.iter().all(|codes| codes.iter().copied().eq(0..=255)));
        assert_eq!(srgb.grain(), Grain { distinct: 256, widest_step: 1 });
    }

    #[test]
    fn light_is_right_to_half_a_code_and_clipped_stays_white() {
        let power = [1.8, 2.0, 2.6];
        let tables = LightTables::new(Some(&curve(|code, channel| code.powf(power[channel])).unwrap()), 256);
        for (channel, power) in power.into_iter().enumerate() {
            for code in 0..256usize {
                let light = (code as f64 / 255.0).powf(power);
                let exact = relume_firmware::tone::srgb_code(light);
                let off = (f64::from(tables.shown()[channel][code]) - exact).abs();
                // Light in 65535ths is at most 0.025 codes where the curve is steepest.
                assert!(off <= 0.53, "{channel} {code}: {off}");
            }
            assert_eq!((tables.shown()[channel][0], tables.shown()[channel][255]), (0, 255));
        }
    }

    #[test]
    fn sixteen_bits_keep_what_eight_would_round_away() {
        let linear = curve(|code, _| code).unwrap();
        // Of a linear camera's 8 bits the darkest codes lie 13 sRGB codes apart, of 16 none.
        assert_eq!(linear.grain().widest_step, 13);
        let deep = LightTables::new(Some(&linear), 65536);
        assert!(deep.shown()[1].windows(2).all(|pair| pair[1] - pair[0] <= 1));
    }

    #[test]
    fn curves_that_would_tint_black_or_white_are_refused() {
        let error = curve(|code, channel| if channel == 1 { 0.9 * code } else { code }).unwrap_err().to_string();
        assert!(error.contains("view.csv") && error.contains("divide each channel"), "{error}");
        let error =
            curve(|code, channel| if channel == 2 { 0.02 + 0.98 * code } else { code }).unwrap_err().to_string();
        assert!(error.contains("view.csv") && error.contains("code 0"), "{error}");
    }
}
