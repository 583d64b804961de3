//! A picture of the bake while it runs: the small picture that every bake begins with, sharpened block by block.
//!
//! It costs nothing but the writing, since each block's sums under the held-out skies are there already. It shows the light of
//! one of these skies, without a sun.

use crate::error::{ExactTile, exposure_for};
use crate::job::DoneBlock;
use crate::png::write_png;
use relume_firmware::glue::outfile::OutError;
use relume_firmware::tile::{TILE_PX, covered_pixels};
use relume_firmware::tone::srgb_code;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The held-out sky that it shows: low sun behind haze, so that shapes stand out.
pub const PREVIEW_SKY: &str = "hazy";
/// How often the file is written.
const EVERY: Duration = Duration::from_secs(3);

/// Pixels of a part of a picture, in its own size.
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Column and row of each covered pixel, and its coverage.
    pub pixels: Vec<([u32; 2], f32)>,
    /// Their sums under every held-out sky.
    pub exact: ExactTile,
}

/// A small picture of a whole view.
#[derive(Clone, Debug, Default)]
pub struct SmallPicture {
    /// Width and height, px.
    pub size: (u32, u32),
    /// Its parts.
    pub parts: Vec<Part>,
}

/// The preview's picture and file.
pub struct Preview {
    file: PathBuf,
    size: (u32, u32),
    /// Index of the sky.
    sky: usize,
    exposure: f32,
    /// `[y][x]`, RGBA, alpha not multiplied in.
    pixels: Vec<[u8; 4]>,
    written: Option<Instant>,
}

impl Preview {
    /// A preview of a picture of `size`, blurred as `small` is, under the sky with index `sky`; written at once.
    pub fn new(file: PathBuf, size: (u32, u32), sky: usize, small: &SmallPicture) -> Self {
        let lit: Vec<f32> = small.parts.iter().flat_map(|part| of_sky(&part.exact, sky)).copied().collect();
        let exposure = exposure_for(lit).unwrap_or(1.0);
        let pixels = vec![[0; 4]; size.0 as usize * size.1 as usize];
        let mut preview = Preview { file, size, sky, exposure, pixels, written: None };
        preview.spread(small);
        preview.write_now_and_then();
        preview
    }

    /// The small picture, each of its pixels as large as it is there.
    fn spread(&mut self, small: &SmallPicture) {
        let first = |at: u32, of: u32, large: u32| (u64::from(at) * u64::from(large) / u64::from(of.max(1))) as u32;
        for part in &small.parts {
            let rgb = of_sky(&part.exact, self.sky).as_chunks::<3>().0;
            for (&([x, y], coverage), &rgb) in part.pixels.iter().zip(rgb) {
                let code = self.code(rgb, coverage);
                for py in first(y, small.size.1, self.size.1)..first(y + 1, small.size.1, self.size.1) {
                    let xs = first(x, small.size.0, self.size.0)..first(x + 1, small.size.0, self.size.0);
                    let row = py as usize * self.size.0 as usize;
                    self.pixels[row + xs.start as usize..row + xs.end as usize].fill(code);
                }
            }
        }
    }

    fn code(&self, rgb: [f32; 3], coverage: f32) -> [u8; 4] {
        let scale = f64::from(self.exposure) / f64::from(coverage.max(1.0 / 255.0));
        let [r, g, b] = rgb.map(|v| srgb_code((f64::from(v) * scale).clamp(0.0, 1.0)).round() as u8);
        [r, g, b, (coverage * 255.0).round() as u8]
    }

    /// Takes in a block that is done, and writes the file if it is old.
    pub fn add(&mut self, done: &DoneBlock) {
        for (tile, exact) in done.block.tiles.iter().zip(&done.exact) {
            let (x0, y0) = (tile.at.0 as usize * TILE_PX, tile.at.1 as usize * TILE_PX);
            let (columns, rows) = (self.size.0 as usize, self.size.1 as usize);
            for y in y0..(y0 + TILE_PX).min(rows) {
                self.pixels[y * columns + x0..y * columns + (x0 + TILE_PX).min(columns)].fill([0; 4]);
            }
            let rgb = of_sky(exact, self.sky).as_chunks::<3>().0;
            for ((at, &share), &rgb) in covered_pixels(tile.response.record.mask).zip(&tile.coverage).zip(rgb) {
                let code = self.code(rgb, f32::from(share) / 255.0);
                if let Some(pixel) = self.pixels.get_mut((y0 + at / TILE_PX) * columns + x0 + at % TILE_PX) {
                    *pixel = code;
                }
            }
        }
        self.write_now_and_then();
    }

    fn write_now_and_then(&mut self) {
        if self.written.is_none_or(|written| written.elapsed() >= EVERY) {
            // A look on the way is not worth a bake; the last one tells.
            let _ = self.write();
            self.written = Some(Instant::now());
        }
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// [`OutError`]: the place cannot be written, or the disk is full.
    pub fn write(&self) -> Result<(), OutError> {
        write_png(&self.file, self.size, &self.pixels)
    }
}

fn of_sky(exact: &ExactTile, sky: usize) -> &[f32] {
    exact.by_sky().nth(sky).unwrap_or(&[])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_picture_is_spread_over_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("preview.png");
        let exact = ExactTile::of_sums(vec![vec![0.4; 3], vec![0.1, 0.2, 0.4]]);
        let part = Part { pixels: vec![([1, 0], 0.5)], exact };
        let preview = Preview::new(file.clone(), (7, 4), 1, &SmallPicture { size: (2, 2), parts: vec![part] });
        assert!(preview.written.is_some());
        let png = image::open(file).unwrap().into_rgba8();
        assert_eq!(png.dimensions(), (7, 4));
        // The percentile of 0.1, 0.2, 0.4 is 0.396, shown as 0.8; a pixel half covered is shown as bright as what covers it.
        assert_eq!(png.get_pixel(6, 1).0, [170, 232, 255, 128]);
        assert_eq!(png.get_pixel(3, 0).0[3], 128);
        assert_eq!((png.get_pixel(2, 1).0[3], png.get_pixel(6, 2).0[3]), (0, 0));
    }
}
