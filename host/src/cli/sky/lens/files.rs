//! What `relume sky lens` writes: the lens file and the mask beside it.

use super::Outcome;
use crate::failure::{Failure, OrFail};
use crate::lens::LensFile;
use std::path::{Path, PathBuf};

pub(super) fn write(outcome: &Outcome, out: &Path, mask_path: Option<&Path>) -> Result<(), Failure> {
    let mut file = outcome.fit.lens.file();
    if let Some(vignetting) = &outcome.vignetting {
        file.vignetting = vignetting.coefficients;
    }
    if let (Some((mask, _)), Some(path)) = (&outcome.mask, mask_path) {
        mask.save(path)?;
        file.mask = Some(seen_from(out, path)?);
    }
    check(&file, out)?;
    file.save(out)?;
    Ok(())
}

/// What is written must be readable: a curve of vignetting may run wild beyond its frames.
fn check(file: &LensFile, out: &Path) -> Result<(), Failure> {
    file.lens(&out.display().to_string()).map(drop).or_bad()
}

/// The mask's name beside the lens file, or its whole path.
fn seen_from(out: &Path, mask: &Path) -> Result<PathBuf, Failure> {
    let folder = |path: &Path| path.parent().filter(|f| *f != Path::new("")).unwrap_or(Path::new(".")).canonicalize();
    let (Ok(beside), Ok(of_mask), Some(name)) = (folder(out), folder(mask), mask.file_name()) else {
        return Err(Failure::bad(format!("{}: its folder cannot be found", mask.display())));
    };
    Ok(if beside == of_mask { name.into() } else { of_mask.join(name) })
}
