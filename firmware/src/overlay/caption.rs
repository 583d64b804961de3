//! The caption: title and text at the foot, on a strip that fades into the picture.

use super::letters::{Face, Faces};
use super::lines::{Line, Lines};
use super::paint::{Ink, PALE, Paint, VEIL, WHITE};
use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::primitives::Rectangle;

/// Lines of text below the title, at most.
const CAPTION_LINES: usize = 2;

/// What stands at the foot of the picture; empty for none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Words<'a> {
    /// One line.
    pub title: &'a str,
    /// Two lines at most.
    pub caption: &'a str,
}

/// Where all of it goes, for one surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout<'a> {
    size: Size,
    faces: Faces,
    title: Lines<'a>,
    caption: Lines<'a>,
}

impl<'a> Layout<'a> {
    /// As many lines as a quarter of the surface's height holds.
    pub(super) fn new(size: Size, faces: Faces, words: &Words<'a>) -> Self {
        let columns = |face: Face| (size.width.saturating_sub(2 * pad(face)) / face.cell().width) as usize;
        let most = size.height / 4;
        let mut layout = Layout {
            size,
            faces,
            title: Lines::new(words.title, columns(faces.title), 1),
            caption: Lines::new("", 0, 0),
        };
        for lines in (1..=CAPTION_LINES).rev() {
            layout.caption = Lines::balanced(words.caption, columns(faces.text), lines);
            if layout.height() <= most {
                return layout;
            }
        }
        layout.caption = Lines::new("", 0, 0);
        if layout.height() > most {
            layout.title = Lines::new("", 0, 0);
        }
        layout
    }

    /// Is every line there, whole?
    pub(super) fn is_whole(&self, words: &Words<'_>) -> bool {
        let whole = |text: &str, lines: Lines<'_>| text.trim().is_empty() || lines.last().is_some_and(|l| !l.is_cut());
        whole(words.title, self.title) && whole(words.caption, self.caption)
    }

    /// Rows of the strip; 0 for no words.
    fn height(&self) -> u32 {
        match self.title.count() + self.caption.count() {
            0 => 0,
            _ => {
                let (title, text) = (self.faces.title.cell().height, self.faces.text.cell().height);
                self.above() + self.title.count() as u32 * title + self.caption.count() as u32 * text + self.below()
            }
        }
    }

    /// Rows in which the strip fades in.
    fn above(&self) -> u32 {
        self.faces.text.cell().height / 2
    }

    fn below(&self) -> u32 {
        self.faces.text.cell().height / 4
    }

    pub(super) fn area(&self) -> Rectangle {
        let height = self.height();
        let width = if height == 0 { 0 } else { self.size.width };
        Rectangle::new(Point::new(0, (self.size.height - height) as i32), Size::new(width, height))
    }

    pub(super) fn draw(&self, paint: &mut Paint<'_, '_>) {
        let area = self.area();
        if !paint.shows(&area) {
            return;
        }
        let (top, fade) = (area.top_left.y, self.above() as f32);
        paint.veil(&area, |y| {
            let t = (((y - top) as f32 + 0.5) / fade).min(1.0);
            VEIL * t * t * (3.0 - 2.0 * t)
        });
        let mut y = top + self.above() as i32;
        let mut line = |line: Line<'_>, face: Face, ink: Ink| {
            let inked = line.columns() as u32 * face.cell().width;
            let x = (self.size.width.saturating_sub(inked) / 2) as i32;
            paint.write(face, Point::new(x, y), line.glyphs(), ink);
            y += face.cell().height as i32;
        };
        self.title.for_each(|title| line(title, self.faces.title, WHITE));
        self.caption.for_each(|caption| line(caption, self.faces.text, PALE));
    }
}

/// Pixels left free beside the text.
fn pad(face: Face) -> u32 {
    face.cell().width
}
