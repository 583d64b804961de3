//! The staff's badge: one line on a plate in the lower left corner, above the caption.

use super::letters::Faces;
use super::lines::Lines;
use super::paint::{BLACK, ORANGE, Paint, SKY_BLUE, WHITE};
use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::primitives::Rectangle;

/// What staff should know. The sign's shape tells it without its colour: a tick in a disc, or a triangle with a `!`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Badge<'a> {
    /// Is all well?
    pub well: bool,
    /// A few words; what does not fit ends with dots.
    pub text: &'a str,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Layout<'a> {
    badge: Badge<'a>,
    faces: Faces,
    lines: Lines<'a>,
    area: Rectangle,
}

impl<'a> Layout<'a> {
    /// `floor`: the first row below the badge.
    pub(super) fn new(size: Size, faces: Faces, badge: &Badge<'a>, floor: i32) -> Self {
        let cell = faces.text.cell();
        let (gap, sign) = (cell.width, cell.height);
        // Gap to the edge, gap, sign, gap, text, gap.
        let columns = size.width.saturating_sub(5 * gap + sign) / cell.width;
        let lines = Lines::new(badge.text, columns as usize, 1);
        let text = lines.map(|line| line.columns() as u32 * cell.width + gap).sum::<u32>();
        let plate = Size::new(2 * gap + sign + text, cell.height + cell.height / 2);
        let corner = Point::new(gap as i32, floor - (plate.height + gap) as i32);
        let fits = corner.y >= 0 && gap + plate.width <= size.width;
        Layout { badge: *badge, faces, lines, area: Rectangle::new(corner, if fits { plate } else { Size::zero() }) }
    }

    pub(super) fn area(&self) -> Rectangle {
        self.area
    }

    pub(super) fn draw(&self, paint: &mut Paint<'_, '_>) {
        if !paint.shows(&self.area) {
            return;
        }
        let cell = self.faces.text.cell();
        let (gap, side) = (cell.width as f32, cell.height as f32);
        let (x, y) = (self.area.top_left.x as f32 + gap, self.area.top_left.y as f32 + side / 4.0);
        paint.plate(&self.area, side / 3.0);
        // On a square that is 1 wide.
        let at = |u: f32, v: f32| (x + u * side, y + v * side);
        if self.badge.well {
            paint.disc(at(0.5, 0.5), 0.5 * side, SKY_BLUE);
            paint.stroke(at(0.27, 0.53), at(0.43, 0.70), 0.12 * side, BLACK);
            paint.stroke(at(0.43, 0.70), at(0.73, 0.32), 0.12 * side, BLACK);
        } else {
            paint.triangle([at(0.5, -0.02), at(1.06, 0.98), at(-0.06, 0.98)], ORANGE);
            paint.stroke(at(0.5, 0.36), at(0.5, 0.62), 0.13 * side, BLACK);
            paint.disc(at(0.5, 0.82), 0.08 * side, BLACK);
        }
        let text = self.area.top_left + Point::new((2.0 * gap + side) as i32, (side / 4.0) as i32);
        for line in self.lines {
            paint.write(self.faces.text, text, line.glyphs(), WHITE);
        }
    }
}
