//! Pictures as the exr crate reads them: the tests' own eyes, without the code under test.

use exr::prelude::*;
use std::path::Path;

/// A linear picture in f64.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Premultiplied radiance, row 0 at the top.
    pub rgb: Vec<[f64; 3]>,
    /// Coverage; 1 where the file has none.
    pub alpha: Vec<f64>,
}

/// Reads R, G, B and, where there is one, A.
///
/// # Panics
/// If the file is no such picture.
pub fn read_exr(path: &Path) -> Linear {
    let image = read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![[0.0f32; 4]; size.area()]),
        |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b, a],
    );
    let layer = image.unwrap_or_else(|error| panic!("{}: {error}", path.display())).layer_data;
    let pixels = layer.channel_data.pixels.1;
    Linear {
        width: layer.size.width(),
        height: layer.size.height(),
        rgb: pixels.iter().map(|p| [p[0], p[1], p[2]].map(f64::from)).collect(),
        alpha: pixels.iter().map(|p| f64::from(p[3])).collect(),
    }
}

/// Reads the one channel of `coverage.exr`.
///
/// # Panics
/// If the file is no such picture.
pub fn read_grey(path: &Path) -> Vec<f64> {
    let layer = read_first_flat_layer_from_file(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let channel = layer.layer_data.channel_data.list.into_iter().next().expect("a channel");
    channel.sample_data.values_as_f32().map(f64::from).collect()
}

/// Writes an RGB picture whose pixel at (column, row) is `value`.
///
/// # Panics
/// If the file cannot be written.
pub fn write_exr(path: &Path, (width, height): (usize, usize), value: impl Fn(usize, usize) -> [f32; 3] + Sync) {
    let written = write_rgb_file(path, width, height, |x, y| {
        let [r, g, b] = value(x, y);
        (r, g, b)
    });
    written.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// Relative RMSE as the design defines it: rms of the difference over mean of `exact`, all channels, covered pixels.
pub fn relative_rmse(shown: &[[f64; 3]], exact: &[[f64; 3]], covered: &[f64]) -> f64 {
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for ((a, b), _) in shown.iter().zip(exact).zip(covered).filter(|(_, share)| **share > 0.0) {
        for c in 0..3 {
            squares += (a[c] - b[c]).powi(2);
            sum += b[c];
            count += 1.0;
        }
    }
    (squares / count).sqrt() / (sum / count)
}
