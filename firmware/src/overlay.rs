//! The overlay: title and caption at the foot, a badge for staff, a compass for the installer.
//!
//! Everything is painted over the clean picture in linear light, and every pixel of a label's area is written anew from
//! it: drawing twice, or over a picture that was drawn anew in part, gives the same pixels.
//!
//! The letters are the X11 "misc-fixed" bitmap fonts ("Public domain font. Share and enjoy.", kept by Markus Kuhn), as
//! `embedded-graphics` carries them. A character is taken from the first of eleven parts of ISO 8859 that has it: Latin
//! letters of all Europe, Greek, Cyrillic. Greek with several accents is spelled with one; other scripts are `?`.

mod badge;
mod caption;
mod compass;
mod letters;
mod lines;
mod paint;
mod shapes;
mod spelling;

pub use badge::Badge;
pub use caption::Words;
pub use compass::Compass;

use crate::composite::ViewPixels;
use crate::surface::Surface;
use crate::tone::ViewLight;
use embedded_graphics::geometry::Size;
use embedded_graphics::primitives::Rectangle;
use letters::Faces;
use paint::Paint;

/// What is shown over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Labels<'a> {
    /// At the foot.
    pub words: Words<'a>,
    /// In the lower left corner, above the words.
    pub badge: Option<Badge<'a>>,
    /// At the top.
    pub compass: Option<Compass>,
}

/// Draws labels on surfaces of one size.
#[derive(Clone, Debug)]
pub struct Overlay {
    size: Size,
    faces: Faces,
    light: ViewLight,
}

impl Overlay {
    /// An overlay for surfaces of this size, px.
    pub fn new(size: Size) -> Self {
        Overlay { size, faces: Faces::of(size), light: ViewLight::new() }
    }

    /// The areas that words, badge and compass are drawn in, px; of size zero for what is not there or has no room.
    pub fn areas(&self, labels: &Labels<'_>) -> [Rectangle; 3] {
        let words = self.words(labels);
        [
            words.area(),
            self.badge(labels).map_or_else(Rectangle::zero, |badge| badge.area()),
            self.compass(labels).map_or_else(Rectangle::zero, |compass| compass.area()),
        ]
    }

    /// Are the words shown to the end?
    pub fn has_room(&self, words: &Words<'_>) -> bool {
        caption::Layout::new(self.size, self.faces, words).is_whole(words)
    }

    /// Draws the part of the labels that lies inside `clip` over the picture `under`, which has the surface's size and
    /// no labels on it.
    pub fn draw(&self, labels: &Labels<'_>, under: ViewPixels<'_>, surface: &mut Surface<'_>, clip: &Rectangle) {
        let mut paint = Paint::new(&self.light, under, surface, clip);
        self.words(labels).draw(&mut paint);
        if let Some(badge) = self.badge(labels) {
            badge.draw(&mut paint);
        }
        if let Some(compass) = self.compass(labels) {
            compass.draw(&mut paint);
        }
    }

    /// Puts the picture `under`, without labels, back into an area.
    pub fn restore(&self, under: ViewPixels<'_>, surface: &mut Surface<'_>, area: &Rectangle) {
        Paint::new(&self.light, under, surface, area).restore();
    }

    fn words<'a>(&self, labels: &Labels<'a>) -> caption::Layout<'a> {
        caption::Layout::new(self.size, self.faces, &labels.words)
    }

    fn badge<'a>(&self, labels: &Labels<'a>) -> Option<badge::Layout<'a>> {
        let floor = self.words(labels).area().top_left.y;
        labels.badge.map(|badge| badge::Layout::new(self.size, self.faces, &badge, floor))
    }

    fn compass(&self, labels: &Labels<'_>) -> Option<compass::Layout> {
        labels.compass.map(|compass| compass::Layout::new(self.size, self.faces, &compass))
    }
}

/// The first character that is shown as `?` because no font has it.
pub fn first_unreadable(text: &str) -> Option<char> {
    text.chars().find(|&c| c != '\n' && !spelling::is_readable(c))
}

#[cfg(test)]
mod tests;
