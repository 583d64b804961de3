//! Painting over a clean picture, in linear light: sRGB codes are decoded, laid over each other by coverage, encoded.

use super::letters::Face;
use crate::composite::ViewPixels;
use crate::surface::{Surface, rgb, xrgb};
use crate::tone::{ViewLight, code};
use embedded_graphics::geometry::Point;
use embedded_graphics::prelude::{OriginDimensions, PointsIter};
use embedded_graphics::primitives::Rectangle;
use libm::sqrtf;

/// An 8-bit sRGB colour.
pub(super) type Ink = [u8; 3];

pub(super) const WHITE: Ink = [255; 3];
pub(super) const PALE: Ink = [222; 3];
pub(super) const BLACK: Ink = [0; 3];
// Okabe and Ito's colours, which all eyes tell apart.
pub(super) const ORANGE: Ink = [230, 159, 0];
pub(super) const SKY_BLUE: Ink = [86, 180, 233];
pub(super) const YELLOW: Ink = [240, 228, 66];
pub(super) const VERMILLION: Ink = [213, 94, 0];

/// How much of the light behind a plate it takes away: white letters on it keep a contrast of 7 to 1 before a white
/// picture, (1 + 0.05) / (0.1 + 0.05).
pub(super) const VEIL: f32 = 0.9;

/// A surface to paint on, and what is painted over. Nothing outside `clip` is touched.
pub(super) struct Paint<'a, 's> {
    light: &'a ViewLight,
    under: ViewPixels<'a>,
    surface: &'a mut Surface<'s>,
    clip: Rectangle,
}

impl<'a, 's> Paint<'a, 's> {
    pub(super) fn new(
        light: &'a ViewLight,
        under: ViewPixels<'a>,
        surface: &'a mut Surface<'s>,
        clip: &Rectangle,
    ) -> Self {
        let whole = Rectangle::new(Point::zero(), surface.size());
        Paint { light, under, clip: whole.intersection(clip), surface }
    }

    /// The picture below, in all of the clip.
    pub(super) fn restore(&mut self) {
        let columns = self.clip.columns();
        for y in self.clip.rows() {
            let row = &mut self.surface.row_mut(y as usize)[columns.start as usize..columns.end as usize];
            self.under.copy_row(columns.start as usize, y as usize, row);
        }
    }

    /// Does any of the area lie inside the clip?
    pub(super) fn shows(&self, area: &Rectangle) -> bool {
        !self.clip.intersection(area).is_zero_sized()
    }

    /// Puts the picture below into an area with `veil` (0 to 1) of its light taken away, row by row.
    pub(super) fn veil(&mut self, area: &Rectangle, veil: impl Fn(i32) -> f32) {
        let area = self.clip.intersection(area);
        let columns = area.columns();
        let mut dimmed = ([0u8; 256], f32::NAN);
        for y in area.rows() {
            let passed = 1.0 - veil(y);
            if dimmed.1 != passed {
                dimmed = (core::array::from_fn(|shown| code(self.light.linear(shown as u8) * passed)), passed);
            }
            let row = &mut self.surface.row_mut(y as usize)[columns.start as usize..columns.end as usize];
            self.under.copy_row(columns.start as usize, y as usize, row);
            for word in row {
                *word = xrgb(rgb(*word).map(|shown| dimmed.0[usize::from(shown)]));
            }
        }
    }

    /// A veiled plate with round corners.
    pub(super) fn plate(&mut self, area: &Rectangle, radius: f32) {
        self.veil(area, |_| VEIL);
        let Some(end) = area.bottom_right() else { return };
        let (start, end) = (centre(area.top_left), centre(end));
        for at in self.clip.intersection(area).points() {
            let (x, y) = centre(at);
            let (dx, dy) = (radius - 0.5 - (x - start.0).min(end.0 - x), radius - 0.5 - (y - start.1).min(end.1 - y));
            if dx > 0.0 && dy > 0.0 {
                self.veil_one(at, VEIL * (0.5 + radius - sqrtf(dx * dx + dy * dy)).clamp(0.0, 1.0));
            }
        }
    }

    /// The picture below with `veil` of its light taken away, at one pixel of the clip.
    fn veil_one(&mut self, at: Point, veil: f32) {
        let (x, y) = (at.x as usize, at.y as usize);
        self.under.copy_row(x, y, &mut self.surface.row_mut(y)[x..=x]);
        self.blend(at, BLACK, veil);
    }

    /// Lays ink over what is there by its coverage, 0 to 1.
    pub(super) fn blend(&mut self, at: Point, ink: Ink, coverage: f32) {
        if coverage <= 0.0 || !self.clip.contains(at) {
            return;
        }
        let word = &mut self.surface.row_mut(at.y as usize)[at.x as usize];
        if coverage >= 1.0 {
            *word = xrgb(ink);
            return;
        }
        let below = rgb(*word);
        *word = xrgb(core::array::from_fn(|c| {
            let below = self.light.linear(below[c]);
            code(below + (self.light.linear(ink[c]) - below) * coverage)
        }));
    }

    /// Writes glyphs from left to right; `at` is the top left of the first one's cell.
    pub(super) fn write(&mut self, face: Face, at: Point, glyphs: impl Iterator<Item = char>, ink: Ink) {
        let cell = face.cell();
        for (k, c) in glyphs.enumerate() {
            let corner = at + Point::new(k as i32 * cell.width as i32, 0);
            if self.shows(&Rectangle::new(corner, cell)) {
                face.ink(c, |offset, coverage| self.blend(corner + offset, ink, coverage));
            }
        }
    }

    /// Fills a shape, given by its signed distance in pixels (negative inside), within an area around it.
    pub(super) fn fill(&mut self, around: &Rectangle, ink: Ink, distance: impl Fn(f32, f32) -> f32) {
        for at in self.clip.intersection(around).points() {
            let (x, y) = centre(at);
            self.blend(at, ink, 0.5 - distance(x, y));
        }
    }
}

fn centre(at: Point) -> (f32, f32) {
    (at.x as f32 + 0.5, at.y as f32 + 0.5)
}
