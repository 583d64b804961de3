//! A display without a screen: every n-th picture becomes a PNG in a folder.

use super::{Display, DisplayError, Frame};
use crate::picture::write_png;
use std::path::{Path, PathBuf};

/// Writes every `every`-th frame as `frame_000000.png` into a folder.
#[derive(Debug)]
pub struct Headless {
    folder: PathBuf,
    every: u64,
    size: (usize, usize),
    written: u64,
}

impl Headless {
    /// A display of `size` pixels that writes into `folder`; makes the folder (not its parents) if it is missing.
    ///
    /// # Errors
    /// [`DisplayError::Folder`] when the folder cannot be made or written to.
    pub fn open(folder: &Path, every: u64, size: (usize, usize)) -> Result<Self, DisplayError> {
        let unusable = |reason: String| DisplayError::Folder { path: folder.to_path_buf(), reason };
        if !folder.is_dir() {
            std::fs::create_dir(folder).map_err(|e| unusable(format!("{e}; create its parent folder first")))?;
        }
        crate::outfile::check_writable(&folder.join(file_name(0))).map_err(crate::picture::PictureError::from)?;
        Ok(Headless { folder: folder.to_path_buf(), every: every.max(1), size, written: 0 })
    }

    /// How many pictures were written so far.
    pub fn written(&self) -> u64 {
        self.written
    }
}

fn file_name(number: u64) -> String {
    format!("frame_{number:06}.png")
}

impl Display for Headless {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn present(&mut self, frame: &Frame<'_>) -> Result<(), DisplayError> {
        if (frame.width, frame.height) != self.size {
            return Err(DisplayError::Size { frame: (frame.width, frame.height), display: self.size });
        }
        if frame.number.is_multiple_of(self.every) {
            write_png(&self.folder.join(file_name(frame.number)), frame.width, frame.height, frame.pixels_bgrx)?;
            self.written += 1;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::damage::Damage;

    #[test]
    fn every_second_frame_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("pictures");
        let mut display = Headless::open(&out, 2, (1, 1)).unwrap();
        let damage = Damage::whole(1, 1);
        for number in 0..5 {
            let frame = Frame { width: 1, height: 1, pixels_bgrx: &[number as u32], number, damage: &damage };
            display.present(&frame).unwrap();
        }
        let mut names: Vec<_> =
            std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        assert_eq!(names, ["frame_000000.png", "frame_000002.png", "frame_000004.png"]);
        assert_eq!(display.written(), 3);
        assert_eq!(image::open(out.join(&names[2])).unwrap().into_rgb8().into_raw(), [0, 0, 4]);
    }

    #[test]
    fn wrong_size_and_missing_parents_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(Headless::open(&folder.path().join("a/b"), 1, (1, 1)), Err(DisplayError::Folder { .. })));
        let mut display = Headless::open(folder.path(), 1, (2, 1)).unwrap();
        let damage = Damage::whole(1, 1);
        let frame = Frame { width: 1, height: 1, pixels_bgrx: &[0], number: 0, damage: &damage };
        assert!(matches!(display.present(&frame), Err(DisplayError::Size { .. })));
    }
}
