//! The overlay: words on the surface, drawn with `embedded-graphics`.

use crate::surface::{Surface, rgb, xrgb};
use embedded_graphics::Drawable;
use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::iso_8859_1::{FONT_7X13, FONT_10X20};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{OriginDimensions, RgbColor};
use embedded_graphics::primitives::Rectangle;
use embedded_graphics::text::{Baseline, Text};

const MARGIN: i32 = 8;

/// The strip that [`caption`] draws on, for a surface of this size.
pub fn caption_area(size: Size) -> Rectangle {
    let height = (caption_font(size).character_size.height + MARGIN as u32).min(size.height);
    Rectangle::new(Point::new(0, (size.height - height) as i32), Size::new(size.width, height))
}

fn caption_font(size: Size) -> &'static embedded_graphics::mono_font::MonoFont<'static> {
    if size.width < 800 { &FONT_7X13 } else { &FONT_10X20 }
}

/// Draws one line of text (ISO 8859-1) in a darkened strip at the foot of the surface. What does not fit is cut off.
/// The picture below the strip must be drawn anew first, since the strip darkens what is there.
pub fn caption(surface: &mut Surface<'_>, text: &str) {
    let size = surface.size();
    let area = caption_area(size);
    for y in area.rows() {
        for word in surface.row_mut(y as usize) {
            *word = xrgb(rgb(*word).map(|code| code / 3));
        }
    }
    let style = MonoTextStyle::new(caption_font(size), Rgb888::WHITE);
    let at = area.top_left + Point::new(MARGIN, MARGIN / 2);
    let Ok(_) = Text::with_baseline(text, at, style, Baseline::Top).draw(surface);
}
