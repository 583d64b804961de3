//! Lat-long radiance maps: where a pixel looks, how large it is, and reading and writing `.hdr` and `.exr`.
//!
//! Row 0 is the zenith; `theta = pi * (row + 0.5) / height`; `u = (col + 0.5) / width = 0.5 + atan2(z, x) / (2 pi)`.
//! The centre column is +X, three quarters is +Z, one quarter is -Z, the edges are -X.

use std::f64::consts::{PI, TAU};
use std::fs;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

/// Smallest height of a map that is accepted, pixels.
pub const MIN_HEIGHT: usize = 8;
/// Largest height of a map that is accepted, pixels.
pub const MAX_HEIGHT: usize = 8192;

/// Rec.709 luminance of linear RGB.
pub fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// Why a radiance map could not be used; one line that names the map and what is wrong.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The file could not be opened, read or written.
    #[error("{name}: {source}")]
    Io {
        /// File name.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The bytes are no picture in a known format, or end early.
    #[error("{name}: not a readable .hdr or .exr picture ({reason}); give a lat-long radiance map")]
    Unreadable {
        /// File name.
        name: String,
        /// What the decoder said, on one line.
        reason: String,
    },
    /// The size is not that of a lat-long map.
    #[error(
        "{name}: {width}x{height} pixels; a lat-long map is exactly twice as wide as high, from 16x8 to 16384x8192"
    )]
    Shape {
        /// File name.
        name: String,
        /// Width found, pixels.
        width: usize,
        /// Height found, pixels.
        height: usize,
    },
    /// A pixel is not a radiance.
    #[error("{name}: pixel (col {col}, row {row}) is {value:?}; radiance must be finite and not negative")]
    Pixel {
        /// File name.
        name: String,
        /// Column of the first bad pixel.
        col: usize,
        /// Row of the first bad pixel.
        row: usize,
        /// Its value.
        value: [f32; 3],
    },
}

/// Linear Rec.709 radiance over the whole sphere, in the map's own unit.
#[derive(Clone, Debug, PartialEq)]
pub struct RadianceMap {
    /// Pixels per row; twice `height`.
    pub width: usize,
    /// Rows, zenith first.
    pub height: usize,
    /// `width * height` RGB radiances, row by row.
    pub pixels: Vec<[f32; 3]>,
}

/// The four pixels around a direction and the shares of the right and the lower ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taps {
    pixels: [u32; 4],
    shares: [f32; 2],
}

impl RadianceMap {
    /// A map of `2 * height` x `height` pixels, each the value of `radiance` in the direction of its centre (unit, map frame).
    pub fn from_fn(height: usize, mut radiance: impl FnMut([f32; 3]) -> [f32; 3]) -> Self {
        let mut map = RadianceMap { width: 2 * height, height, pixels: Vec::with_capacity(2 * height * height) };
        for row in 0..height {
            for col in 0..2 * height {
                let dir = map.dir_map(col, row);
                map.pixels.push(radiance(dir));
            }
        }
        map
    }

    /// Unit direction of a pixel's centre, map frame.
    pub fn dir_map(&self, col: usize, row: usize) -> [f32; 3] {
        let theta = PI * (row as f64 + 0.5) / self.height as f64;
        let azimuth = ((col as f64 + 0.5) / self.width as f64 - 0.5) * TAU;
        let (sin, cos) = theta.sin_cos();
        [(sin * azimuth.cos()) as f32, cos as f32, (sin * azimuth.sin()) as f32]
    }

    /// Continuous pixel coordinates of a direction: `col + 0.5`, `row + 0.5` at a pixel's centre.
    pub fn position_of(&self, dir_map: [f32; 3]) -> [f64; 2] {
        let [x, y, z] = dir_map.map(f64::from);
        let u = 0.5 + z.atan2(x) / TAU;
        let theta = x.hypot(z).atan2(y);
        [u * self.width as f64, theta / PI * self.height as f64]
    }

    /// Column and row of the pixel that holds a direction.
    pub fn pixel_of(&self, dir_map: [f32; 3]) -> (usize, usize) {
        let [u, v] = self.position_of(dir_map);
        ((u as usize) % self.width, (v as usize).min(self.height - 1))
    }

    /// Exact solid angle of one pixel of a row, sr.
    pub fn solid_angle_sr(&self, row: usize) -> f64 {
        let step = PI / self.height as f64;
        (TAU / self.width as f64) * ((row as f64 * step).cos() - ((row + 1) as f64 * step).cos())
    }

    /// Radiance in a direction, bilinear between pixel centres; columns wrap, rows end at the poles.
    pub fn sample(&self, dir_map: [f32; 3]) -> [f32; 3] {
        self.mix(&self.taps(dir_map))
    }

    /// What [`Self::sample`] takes from where: the same for every map of this size.
    pub fn taps(&self, dir_map: [f32; 3]) -> Taps {
        let [u, v] = self.position_of(dir_map);
        let (u, v) = ((u - 0.5).rem_euclid(self.width as f64), (v - 0.5).clamp(0.0, (self.height - 1) as f64));
        let (col, row) = ((u as usize).min(self.width - 1), v as usize);
        let (next_col, next_row) = ((col + 1) % self.width, (row + 1).min(self.height - 1));
        let at = |c: usize, r: usize| (r * self.width + c) as u32;
        Taps {
            pixels: [at(col, row), at(next_col, row), at(col, next_row), at(next_col, next_row)],
            shares: [(u - col as f64) as f32, (v - row as f64) as f32],
        }
    }

    /// The radiance that taps of a map of this size take.
    pub fn mix(&self, taps: &Taps) -> [f32; 3] {
        let [a, b, c, d] = taps.pixels.map(|pixel| self.pixels[pixel as usize]);
        let [fu, fv] = taps.shares;
        std::array::from_fn(|k| (a[k] * (1.0 - fu) + b[k] * fu) * (1.0 - fv) + (c[k] * (1.0 - fu) + d[k] * fu) * fv)
    }

    /// Integral of radiance over the whole sphere, per channel (radiance x sr).
    pub fn integral(&self) -> [f64; 3] {
        self.weighted(|_| 1.0)
    }

    /// Irradiance on the horizontal plane from above, per channel; exact for radiance constant within a row's height.
    pub fn horizontal_irradiance(&self) -> [f64; 3] {
        let step = PI / self.height as f64;
        // Mean of cos(theta) over the row's solid angle above the horizon: (sin^2 t1 - sin^2 t0) / 2 / (cos t0 - cos t1).
        self.weighted(|row| {
            let (t0, t1) = ((row as f64 * step).min(PI / 2.0), ((row + 1) as f64 * step).min(PI / 2.0));
            let whole = (row as f64 * step).cos() - ((row + 1) as f64 * step).cos();
            0.5 * (t1.sin().powi(2) - t0.sin().powi(2)) / whole
        })
    }

    fn weighted(&self, factor: impl Fn(usize) -> f64) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (row, pixels) in self.pixels.chunks_exact(self.width).enumerate() {
            let mut line = [0.0; 3];
            for pixel in pixels {
                for k in 0..3 {
                    line[k] += f64::from(pixel[k]);
                }
            }
            let scale = self.solid_angle_sr(row) * factor(row);
            for k in 0..3 {
                sum[k] += line[k] * scale;
            }
        }
        sum
    }

    /// Checks shape and every pixel; `name` is what the error calls the map.
    ///
    /// # Errors
    /// [`MapError::Shape`] or [`MapError::Pixel`], naming the first bad pixel.
    pub fn check(&self, name: &str) -> Result<(), MapError> {
        check_shape(name, self.width, self.height)?;
        if self.pixels.len() != self.width * self.height {
            return Err(MapError::Unreadable { name: name.into(), reason: "pixels are missing".into() });
        }
        let bad = self.pixels.iter().position(|rgb| rgb.iter().any(|&v| !(v.is_finite() && v >= 0.0)));
        match bad {
            Some(at) => Err(MapError::Pixel {
                name: name.into(),
                col: at % self.width,
                row: at / self.width,
                value: self.pixels[at],
            }),
            None => Ok(()),
        }
    }

    /// Reads a `.hdr` (Radiance RGBE) or `.exr` (first layer with R, G and B) file, told apart by content, and checks it.
    ///
    /// # Errors
    /// [`MapError`], naming the file and what is wrong with it.
    pub fn load(path: &Path) -> Result<Self, MapError> {
        let name = path.display().to_string();
        let io = |source| MapError::Io { name: path.display().to_string(), source };
        let mut magic = [0u8; 4];
        let got = fs::File::open(path).and_then(|mut file| file.read(&mut magic)).map_err(io)?;
        let map = match &magic[..got] {
            [0x76, 0x2f, 0x31, 0x01] => load_exr(path, &name)?,
            [b'#', b'?', ..] => load_hdr(BufReader::new(fs::File::open(path).map_err(io)?), &name)?,
            _ => return Err(MapError::Unreadable { name, reason: "neither format's first bytes".into() }),
        };
        map.check(&name)?;
        Ok(map)
    }

    /// Writes the map: `.hdr` as Radiance RGBE, anything else as a 32-bit float EXR. The file appears whole or not at all.
    ///
    /// # Errors
    /// [`MapError::Io`] where the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), MapError> {
        let io = |source| MapError::Io { name: path.display().to_string(), source };
        let mut bytes = Vec::new();
        let is_hdr = path.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("hdr"));
        let coded = if is_hdr { self.encode_hdr(&mut bytes) } else { self.encode_exr(&mut bytes) };
        coded.map_err(|reason| io(std::io::Error::other(reason)))?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut file = tempfile::NamedTempFile::new_in(folder).map_err(io)?;
        BufWriter::new(&mut file).write_all(&bytes).map_err(io)?;
        file.as_file().sync_all().map_err(io)?;
        file.persist(path).map_err(|error| io(error.error))?;
        Ok(())
    }

    fn encode_hdr(&self, bytes: &mut Vec<u8>) -> Result<(), String> {
        let pixels: Vec<image::Rgb<f32>> = self.pixels.iter().map(|&rgb| image::Rgb(rgb)).collect();
        let encoder = image::codecs::hdr::HdrEncoder::new(bytes);
        encoder.encode(&pixels, self.width, self.height).map_err(|error| error.to_string())
    }

    fn encode_exr(&self, bytes: &mut Vec<u8>) -> Result<(), String> {
        use exr::prelude::*;
        let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
            let [r, g, b] = self.pixels[at.y() * self.width + at.x()];
            (r, g, b)
        });
        let image = Image::from_channels((self.width, self.height), channels);
        image.write().to_buffered(std::io::Cursor::new(bytes)).map_err(|error| error.to_string())
    }
}

fn check_shape(name: &str, width: usize, height: usize) -> Result<(), MapError> {
    if width == 2 * height && (MIN_HEIGHT..=MAX_HEIGHT).contains(&height) {
        return Ok(());
    }
    Err(MapError::Shape { name: name.into(), width, height })
}

fn one_line(text: impl ToString) -> String {
    text.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

fn load_hdr(reader: impl std::io::BufRead, name: &str) -> Result<RadianceMap, MapError> {
    use image::ImageDecoder;
    let unreadable = |reason: image::ImageError| MapError::Unreadable { name: name.into(), reason: one_line(reason) };
    let decoder = image::codecs::hdr::HdrDecoder::new_nonstrict(reader).map_err(unreadable)?;
    let (width, height) = (decoder.metadata().width as usize, decoder.metadata().height as usize);
    check_shape(name, width, height)?;
    let mut bytes = vec![0u8; decoder.total_bytes() as usize];
    decoder.read_image(&mut bytes).map_err(unreadable)?;
    let value = |b: &[u8]| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
    let pixels = bytes.chunks_exact(12).map(|p| [value(&p[..4]), value(&p[4..8]), value(&p[8..])]).collect();
    Ok(RadianceMap { width, height, pixels })
}

fn load_exr(path: &Path, name: &str) -> Result<RadianceMap, MapError> {
    use exr::prelude::*;
    let unreadable = |reason: Error| MapError::Unreadable { name: name.into(), reason: one_line(reason) };
    // The size is checked before anything of that size is allocated.
    let meta = MetaData::read_from_file(path, false).map_err(unreadable)?;
    for header in &meta.headers {
        check_shape(name, header.layer_size.width(), header.layer_size.height())?;
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| RadianceMap {
                width: size.width(),
                height: size.height(),
                pixels: vec![[0.0; 3]; size.width() * size.height()],
            },
            |map, at, (r, g, b): (f32, f32, f32)| map.pixels[at.y() * map.width + at.x()] = [r, g, b],
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(unreadable)?;
    Ok(image.layer_data.channel_data.pixels)
}

/// The folder of shared test material: `RELUME_SHARED`, else `../shared` beside the workspace; says so when there is none.
#[cfg(test)]
pub(crate) fn shared_folder() -> Option<std::path::PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let folder = std::env::var_os("RELUME_SHARED").map_or(beside, Into::into);
    let found = folder.join("skies").is_dir();
    if !found {
        eprintln!("SKIPPED: no shared skies (set RELUME_SHARED to their folder)");
    }
    found.then_some(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_look_where_the_convention_says() {
        let map = RadianceMap::from_fn(512, |_| [0.0; 3]);
        for (u, axis) in [(0.5, [1.0, 0.0, 0.0]), (0.75, [0.0, 0.0, 1.0]), (0.25, [0.0, 0.0, -1.0])] {
            let [found, _] = map.position_of(axis);
            assert!((found / 1024.0 - u).abs() < 1e-9, "{axis:?}");
        }
        assert!(map.dir_map(0, 0)[1] > 0.999 && map.dir_map(0, 511)[1] < -0.999);
        for (col, row) in [(0, 0), (17, 100), (1023, 511), (512, 256)] {
            assert_eq!(map.pixel_of(map.dir_map(col, row)), (col, row));
        }
    }

    #[test]
    fn integrals_equal_closed_forms() {
        let map = RadianceMap::from_fn(16, |_| [1.0, 2.0, 0.5]);
        assert!((map.integral()[0] - 2.0 * TAU).abs() < 1e-9);
        assert!((map.horizontal_irradiance()[1] - 2.0 * PI).abs() < 1e-9);
        // Radiance cos(theta) gives 2 pi / 3 on the horizontal plane.
        let map = RadianceMap::from_fn(256, |d| [d[1].max(0.0); 3]);
        assert!((map.horizontal_irradiance()[0] / (TAU / 3.0) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn files_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let map = RadianceMap::from_fn(8, |d| [d[0].abs() + 0.1, 2.0, 1e-3]);
        map.save(&folder.path().join("m.exr")).unwrap();
        assert_eq!(RadianceMap::load(&folder.path().join("m.exr")).unwrap(), map);
        map.save(&folder.path().join("m.hdr")).unwrap();
        let back = RadianceMap::load(&folder.path().join("m.hdr")).unwrap();
        for (a, b) in map.pixels.iter().zip(&back.pixels) {
            assert!((a[0] - b[0]).abs() < 0.02, "{a:?} {b:?}");
        }
    }

    #[test]
    fn bad_maps_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.exr");
        for value in [f32::NAN, f32::INFINITY, -1.0] {
            let mut map = RadianceMap::from_fn(8, |_| [1.0; 3]);
            map.pixels[3 * 16 + 5][1] = value;
            map.save(&path).unwrap();
            let text = RadianceMap::load(&path).unwrap_err().to_string();
            assert!(text.contains("col 5, row 3") && text.contains("bad.exr"), "{text}");
        }
        let map = RadianceMap { width: 9, height: 8, pixels: vec![[1.0; 3]; 72] };
        map.save(&path).unwrap();
        assert!(matches!(RadianceMap::load(&path), Err(MapError::Shape { width: 9, .. })));
        RadianceMap::from_fn(64, |d| d).save(&path).ok();
        let whole = fs::read(&path).unwrap();
        for cut in [3, 40, whole.len() / 2] {
            fs::write(&path, &whole[..cut]).unwrap();
            let text = RadianceMap::load(&path).unwrap_err().to_string();
            assert!(text.contains("bad.exr") && !text.contains('\n'), "{text}");
        }
        assert!(matches!(RadianceMap::load(&folder.path().join("none.hdr")), Err(MapError::Io { .. })));
    }
}
