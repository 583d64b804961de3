//! The sky camera's lens, and whether it is the lens of the pictures that come.

use super::Table;
use crate::lens::Lens;
use std::path::Path;

/// Reads the lens file.
pub(super) fn lens(path: &Path, table: &mut Table) -> Option<Lens> {
    table.add("lens", Lens::load(path).map(|lens| (lens.clone(), words(&lens, path))))
}

fn words(lens: &Lens, path: &Path) -> String {
    let mask = lens.mask().map(|mask| format!("{:.0} % of the picture is sky by its mask", 100.0 * mask.share()));
    let vignetting = if lens.has_vignetting() { "its vignetting is known" } else { "no vignetting is given" };
    format!("{} is a lens; {vignetting}; {}", path.display(), mask.unwrap_or_else(|| "no mask".into()))
}

/// What to do about a real camera whose pictures are not of the lens's size.
#[cfg(feature = "board")]
pub(super) const ASK_FOR_SIZE: &str = "take it as camera.size, or calibrate again (relume sky lens)";

/// Adds a line where the lens was measured at another size than the pictures' `size`, with what to do.
pub(super) fn fits(lens: Option<&Lens>, size: (usize, usize), cure: &str, table: &mut Table) {
    if let Err(fault) = fit(lens.and_then(Lens::size), size, cure) {
        table.add("lens size", Err::<((), String), _>(fault));
    }
}

fn fit(lens: Option<(usize, usize)>, (width, height): (usize, usize), cure: &str) -> Result<(), String> {
    match lens {
        Some((w, h)) if (w, h) != (width, height) => {
            Err(format!("the pictures are {width}x{height} and the lens was measured at {w}x{h}: {cure}"))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_of_another_size_is_told_with_what_to_do() {
        assert_eq!(fit(Some((1280, 960)), (1280, 960), "x"), Ok(()));
        assert_eq!(fit(None, (1280, 960), "x"), Ok(()), "a file that names no size is taken as it is");
        let told = fit(Some((1280, 960)), (1920, 1080), "take it").unwrap_err();
        assert_eq!(told, "the pictures are 1920x1080 and the lens was measured at 1280x960: take it");
        let mut table = Table::default();
        fits(Some(&Lens::zenith_equidistant(64, 64, 180.0)), (32, 32), "x", &mut table);
        assert!(table.text().starts_with("BAD  lens size"), "{}", table.text());
        fits(Some(&Lens::zenith_equidistant(32, 32, 180.0)), (32, 32), "x", &mut table);
        assert_eq!(table.rows.len(), 1, "what fits needs no line");
    }
}
