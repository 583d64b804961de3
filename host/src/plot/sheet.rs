//! Contact sheets: a grid of pictures, each with its caption.

use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::text::Alignment;

use super::canvas::{Canvas, LARGE, MEDIUM};

const GAP: u32 = 8;
const CAPTION: u32 = 20;
const TITLE: u32 = 32;
const PAPER: Rgb888 = Rgb888::new(0x1c, 0x1c, 0x1e);
const TEXT: Rgb888 = Rgb888::new(0xe8, 0xe4, 0xdc);

/// A picture of a contact sheet and the line of text below it.
#[derive(Clone, Debug)]
pub struct Cell {
    /// The picture.
    pub picture: Canvas,
    /// One short line; what is wider than the picture runs over.
    pub caption: String,
}

/// A sheet with `columns` pictures in a row, in reading order, under a title.
pub fn contact_sheet(title: &str, cells: &[Cell], columns: u32) -> Canvas {
    let columns = columns.clamp(1, (cells.len() as u32).max(1));
    let rows = (cells.len() as u32).div_ceil(columns);
    let width = cells.iter().map(|cell| cell.picture.width()).max().unwrap_or(0);
    let height = cells.iter().map(|cell| cell.picture.height()).max().unwrap_or(0) + CAPTION;
    let mut sheet = Canvas::new(columns * (width + GAP) + GAP, TITLE + rows * (height + GAP), PAPER);
    let middle = sheet.width() as i32 / 2;
    sheet.text(title, (middle, TITLE as i32 / 2), LARGE, TEXT, Alignment::Center);
    for (index, cell) in cells.iter().enumerate() {
        let left = GAP + index as u32 % columns * (width + GAP);
        let top = TITLE + index as u32 / columns * (height + GAP);
        sheet.paste(&cell.picture, left, top);
        let anchor = ((left + width / 2) as i32, (top + height - CAPTION / 2) as i32);
        sheet.text(&cell.caption, anchor, MEDIUM, TEXT, Alignment::Center);
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_in_reading_order() {
        let cell = |blue| Cell { picture: Canvas::new(20, 10, Rgb888::new(0, 0, blue)), caption: "x".to_owned() };
        let sheet = contact_sheet("days", &[cell(200), cell(210), cell(220)], 2);
        assert_eq!((sheet.width(), sheet.height()), (2 * 28 + 8, 32 + 2 * 38));
        let at = |x: u32, y: u32| sheet.pixels()[(y * sheet.width() + x) as usize];
        assert_eq!([at(8, 32), at(36, 32), at(8, 70)], [[0, 0, 200], [0, 0, 210], [0, 0, 220]]);
        assert_eq!(contact_sheet("", &[], 4).height(), 32);
    }
}
