//! What a person judges the study by: a strip of its moments, and pages that flicker between shown and true.

use std::fmt::Write as _;
use std::path::Path;

use super::Row;
use super::judge::difference_map;
use crate::failure::Failure;
use crate::outfile::write_whole;
use crate::plot::Canvas;

fn canvas(pixels: &[u32], (width, height): (u32, u32)) -> Canvas {
    Canvas::from_xrgb(width, height, pixels)
}

/// A row per moment: as it is, as shown, as it would be, and how far the latter two differ.
pub(super) fn strip(rows: &[Row], size: (u32, u32)) -> Canvas {
    let black = embedded_graphics::pixelcolor::Rgb888::new(0, 0, 0);
    let mut strip = Canvas::new(4 * size.0, rows.len() as u32 * size.1, black);
    for (y, Row { real, shown, truth, .. }) in (0u32..).zip(rows) {
        for (x, picture) in (0u32..).zip([real, shown, truth, &difference_map(shown, truth)]) {
            strip.paste(&canvas(picture, size), x * size.0, y * size.1);
        }
    }
    strip
}

/// A page that changes between what is shown and what would be, twice a second: the middle moment of each day.
pub(super) fn flicker(rows: &[Row], size: (u32, u32), out: &Path) -> Result<(), Failure> {
    let mut page = String::from(
        "<!doctype html><meta charset=\"utf-8\"><title>Shown and true, in turn</title><style>body{background:#222;margin:2em}\
         div{position:relative;width:960px;margin-bottom:1em}img{display:block;width:960px;image-rendering:pixelated}\
         img+img{position:absolute;top:0;animation:turn 1s steps(1) infinite}@keyframes turn{50%{opacity:0}}</style>\n",
    );
    let mut days: Vec<&str> = rows.iter().map(|row| row.day).collect();
    days.dedup();
    for day in days {
        let own: Vec<&Row> = rows.iter().filter(|row| row.day == day).collect();
        let Row { shown, truth, .. } = own[own.len() / 2];
        for (picture, of) in [(truth, "truth"), (shown, "shown")] {
            canvas(picture, size).save(&out.join(format!("flicker_{day}_{of}.png")))?;
        }
        // A String takes all that is written.
        let _ = writeln!(
            page,
            "<div><img src=\"flicker_{day}_truth.png\" alt=\"{day}, true\"><img src=\"flicker_{day}_shown.png\" alt=\"{day}, shown\"></div>"
        );
    }
    write_whole(&out.join("flicker.html"), |file| std::io::Write::write_all(file, page.as_bytes()))?;
    Ok(())
}
