//! Shapes with smooth edges: a pixel is covered by how far its centre lies inside.

use super::paint::{Ink, Paint};
use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::primitives::Rectangle;
use libm::{ceilf, fabsf, floorf, sqrtf};

/// A place on the surface, px; (0, 0) is the first pixel's top left corner.
pub(super) type Place = (f32, f32);

impl Paint<'_, '_> {
    pub(super) fn disc(&mut self, middle: Place, radius: f32, ink: Ink) {
        self.fill(&around(&[middle], radius), ink, |x, y| length(x - middle.0, y - middle.1) - radius);
    }

    /// A circle's line.
    pub(super) fn ring(&mut self, middle: Place, radius: f32, thick: f32, ink: Ink) {
        let half = thick / 2.0;
        let distance = |x, y| fabsf(length(x - middle.0, y - middle.1) - radius) - half;
        self.fill(&around(&[middle], radius + half), ink, distance);
    }

    /// A line with round ends.
    pub(super) fn stroke(&mut self, from: Place, to: Place, thick: f32, ink: Ink) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let square = (dx * dx + dy * dy).max(f32::MIN_POSITIVE);
        self.fill(&around(&[from, to], thick / 2.0), ink, |x, y| {
            let along = (((x - from.0) * dx + (y - from.1) * dy) / square).clamp(0.0, 1.0);
            length(x - from.0 - along * dx, y - from.1 - along * dy) - thick / 2.0
        });
    }

    /// A triangle, its corners in any order.
    pub(super) fn triangle(&mut self, corners: [Place; 3], ink: Ink) {
        let edge = |k: usize, x: f32, y: f32| {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let (dx, dy) = (b.0 - a.0, b.1 - a.1);
            ((x - a.0) * dy - (y - a.1) * dx) / length(dx, dy).max(f32::MIN_POSITIVE)
        };
        let turn = if edge(0, corners[2].0, corners[2].1) > 0.0 { -1.0 } else { 1.0 };
        self.fill(&around(&corners, 0.0), ink, |x, y| {
            (0..3).map(|k| turn * edge(k, x, y)).fold(f32::NEG_INFINITY, f32::max)
        });
    }
}

fn length(x: f32, y: f32) -> f32 {
    sqrtf(x * x + y * y)
}

/// The pixels within `reach` of some places.
fn around(places: &[Place], reach: f32) -> Rectangle {
    let bound = |pick: fn(&Place) -> f32| {
        let low = places.iter().map(pick).fold(f32::INFINITY, f32::min) - reach - 1.0;
        let high = places.iter().map(pick).fold(f32::NEG_INFINITY, f32::max) + reach + 1.0;
        (floorf(low) as i32, (ceilf(high) - floorf(low)) as u32)
    };
    let ((x, width), (y, height)) = (bound(|place| place.0), bound(|place| place.1));
    Rectangle::new(Point::new(x, y), Size::new(width, height))
}
