//! A page about a finished bake: `index.html` with its maps as PNG beside it.
//!
//! Maps are drawn from black over violet and orange to light yellow; what each end means stands in the caption.

use crate::error::{ExactTile, TestLight};
use crate::info::Info;
use crate::noise::Noise;
use crate::png::write_png;
use crate::report::Report;
use relume_firmware::field::Field;
use relume_firmware::glue::outfile::{OutError, write_whole};
use relume_firmware::patches::PatchSet;
use relume_firmware::tile::TILE_PX;
use relume_firmware::weights::WeightError;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The folder cannot be made.
    #[error("{}: {source}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What happened.
        source: std::io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] OutError),
    /// A held-out sky is not for this field.
    #[error("a held-out sky: {0}")]
    Sky(#[from] WeightError),
}

/// What a page is about.
pub struct Subject<'a> {
    /// The field.
    pub field: &'a Field<'a>,
    /// Its name.
    pub name: &'a str,
    /// What its bake says.
    pub report: &'a Report,
    /// Exact sums of its tiles under the held-out skies, and these.
    pub exact: &'a [ExactTile],
    /// The held-out skies.
    pub light: &'a TestLight,
}

/// Writes the page into `folder`, which is made if it is not there.
///
/// # Errors
/// [`PageError`].
pub fn write(folder: &Path, subject: &Subject<'_>) -> Result<(), PageError> {
    std::fs::create_dir_all(folder).map_err(|source| PageError::Folder { folder: folder.to_owned(), source })?;
    let field = subject.field;
    let mut page = format!(
        "<!doctype html><meta charset=utf-8><title>{0}</title><style>body{{font:15px sans-serif;max-width:62em;margin:2em \
         auto}}img{{max-width:100%;image-rendering:pixelated;background:#ddd}}figure{{margin:2em 0}}pre{{overflow:auto}}\
         </style><h1>{0}</h1>",
        escaped(subject.name)
    );
    let tiles = field.response();
    Map::of_tiles(field, |tile| tiles.tile(tile).rank() as f64).write(folder, "rank.png", "Ranks", &mut page)?;
    let bytes = |tile: usize| tiles.tile(tile).bytes() as f64 / tiles.tile(tile).pixels().max(1) as f64;
    Map::of_tiles(field, bytes).write(folder, "bytes.png", "Bytes of U and scales read per pixel", &mut page)?;
    error_map(folder, subject, &mut page)?;
    if let Some(noise) = &subject.report.noise {
        noise_dome(folder, field.patch_set(), noise, &mut page)?;
    }
    let info = Info::of(field, subject.name).to_string();
    let _ = write!(page, "<h2>In numbers</h2><pre>{}</pre>", escaped(&info));
    Ok(write_whole(&folder.join("index.html"), |out| out.write_all(page.as_bytes()))?)
}

fn error_map(folder: &Path, subject: &Subject<'_>, page: &mut String) -> Result<(), PageError> {
    let worst = subject.report.held_out.iter().enumerate().max_by(|a, b| a.1.rmse.total_cmp(&b.1.rmse));
    let Some((index, sky)) = worst else { return Ok(()) };
    let field = subject.field;
    let mut map = Map::new(field.width(), field.height());
    for (tile, codes) in subject.light.code_errors(field, subject.exact, index)?.into_iter().enumerate() {
        map.fill(field, tile, |pixel| codes.get(pixel).copied().map(f64::from));
    }
    let caption = format!("Largest code error of a pixel's channels under the sky '{}', the worst of all", sky.sky);
    map.write(folder, "error.png", &caption, page)
}

/// Noise per patch over the dome: zenith in the middle, the horizon at the rim, +X to the right and +Z down.
fn noise_dome(folder: &Path, set: &PatchSet, noise: &Noise, page: &mut String) -> Result<(), PageError> {
    const SIDE: usize = 257;
    // Patches that hardly light anything are all noise: what nine in ten keep below is the bright end.
    let most = f64::from(noise.of_patches(0.9));
    let mut map = Map::new(SIDE, SIDE);
    map.top = Some(most);
    for (at, value) in map.values.iter_mut().enumerate() {
        let middle = (SIDE / 2) as f64;
        let [x, z] = [at % SIDE, at / SIDE].map(|pixel| (pixel as f64 - middle) / middle);
        let radius = x.hypot(z);
        if radius <= 1.0 {
            let (sin, cos) = (radius * std::f64::consts::FRAC_PI_2).sin_cos();
            let scale = if radius > 0.0 { sin / radius } else { 0.0 };
            let patch = set.patch_of([(x * scale) as f32, cos.max(0.0) as f32, (z * scale) as f32]);
            *value = noise.patches.get(patch).map(|&noise| f64::from(noise));
        }
    }
    let caption = "Noise of a pixel per patch, over its mean: zenith in the middle, +X right, +Z down";
    map.write(folder, "noise.png", caption, page)
}

/// Values of a picture, some of them missing.
struct Map {
    width: usize,
    height: usize,
    values: Vec<Option<f64>>,
    /// What the bright end means; the largest value if nothing is said.
    top: Option<f64>,
}

impl Map {
    fn new(width: usize, height: usize) -> Self {
        Map { width, height, values: vec![None; width * height], top: None }
    }

    /// One value per tile, at its covered pixels.
    fn of_tiles(field: &Field<'_>, of: impl Fn(usize) -> f64) -> Self {
        let mut map = Map::new(field.width(), field.height());
        for tile in 0..field.response().tiles() {
            let value = of(tile);
            map.fill(field, tile, |_| Some(value));
        }
        map
    }

    /// Values of a tile's covered pixels, in mask order.
    fn fill(&mut self, field: &Field<'_>, tile: usize, value: impl Fn(usize) -> Option<f64>) {
        let columns = field.width().div_ceil(TILE_PX);
        let (x0, y0) = (tile % columns * TILE_PX, tile / columns * TILE_PX);
        for (pixel, at) in field.response().tile(tile).covered().enumerate() {
            let (x, y) = (x0 + at % TILE_PX, y0 + at / TILE_PX);
            if let Some(place) = self.values.get_mut(y * self.width + x) {
                *place = value(pixel);
            }
        }
    }

    fn write(&self, folder: &Path, file: &str, caption: &str, page: &mut String) -> Result<(), PageError> {
        let largest = self.values.iter().flatten().copied().fold(0.0, f64::max);
        let top = self.top.unwrap_or(largest);
        let share = |value: f64| if top > 0.0 { (value / top).clamp(0.0, 1.0) } else { 0.0 };
        let rgba = |value: &Option<f64>| value.map_or([0; 4], |value| ramp(share(value)));
        let pixels: Vec<[u8; 4]> = self.values.iter().map(rgba).collect();
        write_png(&folder.join(file), (self.width as u32, self.height as u32), &pixels)?;
        let _ = write!(
            page,
            "<figure><img src={file} alt=\"\"><figcaption>{}: black 0, light yellow {top:.3}{}.</figcaption></figure>",
            escaped(caption),
            if largest > top { " and more" } else { "" }
        );
        Ok(())
    }
}

/// Black, violet, orange, light yellow; brightness rises evenly, so that it is told without colours, too.
fn ramp(share: f64) -> [u8; 4] {
    const STOPS: [[f64; 3]; 5] =
        [[0.0, 0.0, 4.0], [87.0, 16.0, 110.0], [188.0, 55.0, 84.0], [249.0, 142.0, 9.0], [252.0, 255.0, 164.0]];
    let at = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let low = (at as usize).min(STOPS.len() - 2);
    let [r, g, b] = std::array::from_fn(|c| STOPS[low][c] + (STOPS[low + 1][c] - STOPS[low][c]) * (at - low as f64));
    [r.round() as u8, g.round() as u8, b.round() as u8, 255]
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ramp_rises_from_black_to_yellow() {
        assert_eq!((ramp(0.0), ramp(1.0), ramp(9.0)), ([0, 0, 4, 255], [252, 255, 164, 255], [252, 255, 164, 255]));
        let luminance = |share: f64| {
            let [r, g, b, _] = ramp(share).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        assert!((0..100).all(|k| luminance(f64::from(k) / 100.0) < luminance(f64::from(k + 1) / 100.0)));
    }
}
