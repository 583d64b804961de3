//! How a sky is cut to a scene, as text: the bytes of the layer CUTS in hexadecimal.

use crate::patches::Subdivided;
use std::fmt::Write;

/// The text of these cuts.
pub fn to_text(cells: &Subdivided) -> String {
    cells.layer().iter().fold(String::new(), |mut text, byte| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// The cuts of a text, if it is one.
pub fn of_text(text: &str) -> Option<Subdivided> {
    let bytes: Option<Vec<u8>> = text
        .as_bytes()
        .chunks(2)
        .map(|pair| {
            let digits = std::str::from_utf8(pair).ok().filter(|pair| pair.len() == 2 && !pair.starts_with('+'))?;
            u8::from_str_radix(digits, 16).ok()
        })
        .collect();
    Subdivided::decode(&bytes?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::Cut;

    #[test]
    fn the_text_brings_back_the_cuts() {
        let first = [Cut::Azimuth, Cut::Patch, Cut::Patch];
        let cells = Subdivided::new(false, first.into_iter().chain([Cut::Patch; 16])).unwrap();
        let text = to_text(&cells);
        assert_eq!(text, "10000100120000000200000000");
        assert_eq!(of_text(&text), Some(cells));
        for bad in ["", "1", &text[1..], &text[2..], &text.replace('2', "z"), &text.replacen("02", "+2", 1)] {
            assert_eq!(of_text(bad), None, "{bad}");
        }
    }
}
