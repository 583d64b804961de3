//! Letters: one face made of the same font in eleven encodings, at whole scales.

use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::image::GetPixel;
use embedded_graphics::mono_font::mapping::{self, StrGlyphMapping};
use embedded_graphics::mono_font::*;
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::OriginDimensions;

/// Parts of ISO 8859, the ones most often met first: western, Cyrillic, Greek, central, Turkish, western with the euro,
/// south-eastern, Baltic, Celtic, northern and southern. (The fonts have part 10 too, which adds nothing.)
const ENCODINGS: [StrGlyphMapping<'static>; 11] = [
    mapping::ISO_8859_1,
    mapping::ISO_8859_5,
    mapping::ISO_8859_7,
    mapping::ISO_8859_2,
    mapping::ISO_8859_9,
    mapping::ISO_8859_15,
    mapping::ISO_8859_16,
    mapping::ISO_8859_13,
    mapping::ISO_8859_14,
    mapping::ISO_8859_4,
    mapping::ISO_8859_3,
];

/// One font in all [`ENCODINGS`], in their order.
type Fonts = [MonoFont<'static>; ENCODINGS.len()];

macro_rules! fonts {
    ($name:ident) => {
        [
            iso_8859_1::$name,
            iso_8859_5::$name,
            iso_8859_7::$name,
            iso_8859_2::$name,
            iso_8859_9::$name,
            iso_8859_15::$name,
            iso_8859_16::$name,
            iso_8859_13::$name,
            iso_8859_14::$name,
            iso_8859_4::$name,
            iso_8859_3::$name,
        ]
    };
}

static SMALLEST: Fonts = fonts!(FONT_6X10);
static SMALL: Fonts = fonts!(FONT_7X13);
static MEDIUM: Fonts = fonts!(FONT_9X15);
static MEDIUM_BOLD: Fonts = fonts!(FONT_9X15_BOLD);
static LARGE: Fonts = fonts!(FONT_10X20);

/// Rows of the largest font.
const MOST_ROWS: usize = 20;

/// A font at a whole scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    fonts: &'static Fonts,
    scale: u32,
}

/// The faces for a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Faces {
    /// Of the title: some 60 letters to a row.
    pub title: Face,
    /// Of all else: some 80 to 100 letters to a row.
    pub text: Face,
}

impl Faces {
    /// By the surface's width, or that of a 16:9 surface of its height if this is less.
    pub(super) fn of(size: Size) -> Self {
        let width = size.width.min(size.height.saturating_mul(16) / 9);
        let (title, text) = match width {
            0..320 => ((&SMALLEST, 1), (&SMALLEST, 1)),
            320..640 => ((&MEDIUM_BOLD, 1), (&SMALL, 1)),
            640..1024 => ((&LARGE, 1), (&MEDIUM, 1)),
            1024..1600 => ((&LARGE, 2), (&SMALL, 2)),
            _ => ((&LARGE, (width + 320) / 640), (&LARGE, (width + 480) / 960)),
        };
        let face = |(fonts, scale)| Face { fonts, scale };
        Faces { title: face(title), text: face(text) }
    }
}

/// Does one of the fonts have the character?
pub(super) fn has_glyph(c: char) -> bool {
    place(c).is_some()
}

/// Encoding and place in it.
fn place(c: char) -> Option<(usize, usize)> {
    // Places that a part of ISO 8859 leaves open are inside its ranges here, and blank.
    if c.is_control() || matches!(c, '\u{3a2}' | '\u{3cf}') {
        return None;
    }
    ENCODINGS.iter().enumerate().find_map(|(encoding, mapping)| {
        let (first, range) = mapping.ranges().find(|(_, range)| range.contains(&c))?;
        Some((encoding, first + (c as usize - *range.start() as usize)))
    })
}

impl Face {
    /// Pixels of a letter with the space around it.
    pub(super) fn cell(&self) -> Size {
        self.fonts[0].character_size * self.scale
    }

    /// Calls `pixel` with the place and the coverage (0 to 1) of every pixel that the glyph of `c` inks, the place
    /// relative to the cell's top left. Scaled glyphs have their steps cut: where two sides of a font's pixel that meet
    /// in a corner are unlike the two others, that corner's triangle is theirs.
    pub(super) fn ink(&self, c: char, mut pixel: impl FnMut(Point, f32)) {
        let glyph = self.glyph(c);
        let scale = self.scale as i32;
        for y in 0..glyph.height {
            for x in 0..glyph.width {
                let (own, cuts) = glyph.pixel(x, y, self.scale > 1);
                if !own && cuts == [0.0; 4] {
                    continue;
                }
                for (v, u) in (0..scale).flat_map(|v| (0..scale).map(move |u| (v, u))) {
                    let coverage = f32::from(u8::from(own)) + cut(cuts, u, v, scale);
                    if coverage > 0.0 {
                        pixel(Point::new(x as i32 * scale + u, y as i32 * scale + v), coverage);
                    }
                }
            }
        }
    }

    fn glyph(&self, c: char) -> Glyph {
        let (encoding, place) = place(c).or_else(|| self::place('?')).unwrap_or_default();
        let font = &self.fonts[encoding];
        let cell = font.character_size;
        let per_row = (font.image.size().width / cell.width).max(1) as usize;
        let corner =
            Point::new((place % per_row) as i32 * cell.width as i32, (place / per_row) as i32 * cell.height as i32);
        let mut glyph =
            Glyph { rows: [0; MOST_ROWS + 2], width: cell.width, height: (cell.height as usize).min(MOST_ROWS) };
        for (y, row) in glyph.rows[1..].iter_mut().take(glyph.height).enumerate() {
            let is_on = |x: i32| font.image.pixel(corner + Point::new(x, y as i32)) == Some(BinaryColor::On);
            *row = (0..cell.width).filter(|&x| is_on(x as i32)).fold(0, |row, x| row | 2 << x);
        }
        glyph
    }
}

/// A font's pixels: bit x + 1 of row y + 1, and nothing around.
struct Glyph {
    rows: [u32; MOST_ROWS + 2],
    width: u32,
    height: usize,
}

impl Glyph {
    /// Is the pixel inked, and what do its corners' triangles change, from top left clockwise.
    fn pixel(&self, x: u32, y: usize, cuts: bool) -> (bool, [f32; 4]) {
        let at = |x: u32, y: usize| self.rows[y] >> x & 1 != 0;
        let (x, y) = (x + 1, y + 1);
        let own = at(x, y);
        let sides = [at(x - 1, y), at(x, y - 1), at(x + 1, y), at(x, y + 1)];
        let corner = |k: usize| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|side| sides[(k + side) % 4]);
            if cuts && a == b && c == d && a != c && a != own { if own { -1.0 } else { 1.0 } } else { 0.0 }
        };
        (own, [0, 1, 2, 3].map(corner))
    }
}

/// What the triangles of half a font's pixel change in the part (u, v) of `scale` x `scale` parts.
fn cut(cuts: [f32; 4], u: i32, v: i32, scale: i32) -> f32 {
    let (right, below) = (scale - 1 - u, scale - 1 - v);
    let steps = [u + v, right + v, right + below, u + below];
    cuts.iter().zip(steps).map(|(cut, steps)| cut * below_diagonal(scale as f32 / 2.0 - steps as f32)).sum()
}

/// Share of the unit square where x + y is below `bound`.
fn below_diagonal(bound: f32) -> f32 {
    let bound = bound.clamp(0.0, 2.0);
    if bound <= 1.0 { bound * bound / 2.0 } else { 1.0 - (2.0 - bound) * (2.0 - bound) / 2.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_corner_is_an_eighth_of_a_pixel_at_every_scale() {
        for scale in 2..=9 {
            let parts = (0..scale).flat_map(|v| (0..scale).map(move |u| (u, v)));
            let area: f32 = parts.map(|(u, v)| cut([1.0, 0.0, 0.0, 0.0], u, v, scale)).sum();
            assert!((area / (scale * scale) as f32 - 0.125).abs() < 1e-6, "{scale}: {area}");
        }
    }
}
