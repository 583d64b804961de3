//! `relume-bake info`: what is in a field.

use crate::noise::Noise;
use crate::report::Report;
use relume_firmware::field::{CameraRecord, Field};
use relume_firmware::glue::failure::Failure;
use relume_firmware::lens::{Lens, Projection};
use relume_firmware::receivers::Receivers;
use relume_firmware::tile::MAX_RANK;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// The facts of a field file.
#[derive(Clone, Debug, Serialize)]
pub struct Info {
    file: String,
    version: u16,
    file_bytes: usize,
    width: usize,
    height: usize,
    patch_set_id: String,
    patches_upper: usize,
    patches_lower: usize,
    /// Smallest and largest of the patches above the horizon.
    patch_solid_angles_sr: [f32; 2],
    /// They are cut to the scene.
    adaptive: bool,
    covered_pixels: usize,
    camera: CameraInfo,
    error_target: f32,
    site: Option<[f32; 2]>,
    seed: u64,
    max_hits: u32,
    bytes_per_covered_pixel: f64,
    bytes_stored_per_covered_pixel: f64,
    ranks: Ranks,
    sun_casters: usize,
    sun_highlights: bool,
    receivers: Option<ReceiverInfo>,
    layers: Vec<LayerInfo>,
    bake: Option<Report>,
}

#[derive(Clone, Debug, Serialize)]
struct CameraInfo {
    position: [f32; 3],
    target: [f32; 3],
    up: [f32; 3],
    fov_y_deg: f32,
    north_deg: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    lens: Option<LensInfo>,
}

/// The lens over the field's pixels.
#[derive(Clone, Copy, Debug, Serialize)]
struct LensInfo {
    model: &'static str,
    focal_px: [f64; 2],
    principal_px: [f64; 2],
    k: [f64; 4],
}

impl LensInfo {
    fn of(lens: Lens) -> Self {
        let model = match lens.projection {
            Projection::Radial => "radial",
            Projection::KannalaBrandt => "kannala_brandt",
        };
        LensInfo { model, focal_px: lens.focal_px, principal_px: lens.principal_px, k: lens.k }
    }
}

/// What a field says about its receivers; their bytes are not among those of its covered pixels.
#[derive(Clone, Copy, Debug, Serialize)]
struct ReceiverInfo {
    /// Pixels that show some.
    pixels: usize,
    /// Layers with the virtual geometry and without it.
    bytes: [usize; 2],
    /// What a frame reads of both, per pixel that shows some.
    bytes_per_pixel: f64,
}

impl ReceiverInfo {
    fn of(receivers: &Receivers<'_>) -> Self {
        let pixels = receivers.with.response().covered();
        let read = bytes_read(&receivers.with) + bytes_read(&receivers.without);
        ReceiverInfo { pixels, bytes: receivers.bytes(), bytes_per_pixel: read as f64 / pixels.max(1) as f64 }
    }
}

/// Bytes of a response and its coverage that a frame may read.
fn bytes_read(field: &Field<'_>) -> usize {
    let tiles = field.response();
    let own = (0..tiles.tiles()).map(|t| tiles.tile(t).bytes());
    own.chain((0..tiles.blocks()).map(|block| tiles.v_bytes(block))).sum()
}

/// Ranks of the tiles, counted by covered pixels.
#[derive(Clone, Copy, Debug, Serialize)]
struct Ranks {
    mean: f64,
    tenth: usize,
    median: usize,
    nine_tenths: usize,
    max: usize,
}

impl Ranks {
    fn of(field: &Field<'_>) -> Self {
        let tiles = field.response();
        let mut pixels = [0usize; MAX_RANK + 1];
        (0..tiles.tiles()).map(|t| tiles.tile(t)).for_each(|tile| pixels[tile.rank()] += tile.pixels());
        let covered = tiles.covered();
        let until = |share: f64| {
            let mut left = share * covered as f64;
            pixels.iter().position(|&count| (left -= count as f64, left <= 0.0).1).unwrap_or(0)
        };
        let sum: usize = pixels.iter().enumerate().map(|(rank, count)| rank * count).sum();
        Ranks {
            mean: sum as f64 / covered.max(1) as f64,
            tenth: until(0.1),
            median: until(0.5),
            nine_tenths: until(0.9),
            max: pixels.iter().rposition(|&count| count > 0).unwrap_or(0),
        }
    }
}

#[derive(Clone, Debug, Serialize)]
struct LayerInfo {
    kind: String,
    bytes: u64,
}

impl Info {
    /// Reads and checks a field.
    ///
    /// # Errors
    /// Bad input when the file cannot be read or is no sound field.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let fault = |what: &dyn fmt::Display| Failure::bad(format!("{}: {what}", path.display()));
        let bytes = std::fs::read(path).map_err(|error| fault(&error))?;
        let field = Field::new(&bytes).map_err(|error| fault(&error))?;
        Receivers::of(&field).map_err(|error| fault(&error))?;
        Ok(Self::of(&field, &path.display().to_string()))
    }

    /// Of a field in memory, called `file`.
    pub fn of(field: &Field<'_>, file: &str) -> Self {
        let header = field.header();
        let CameraRecord { position, target, up, fov_y_deg, north_deg, lens } = header.camera;
        let lens = lens.map(LensInfo::of);
        let covered = field.response().covered();
        let receivers = Receivers::of(field).ok().flatten().map(|receivers| ReceiverInfo::of(&receivers));
        let own_bytes = field.file_bytes() - receivers.map_or(0, |receivers| receivers.bytes.iter().sum());
        let per_pixel = |bytes: usize| bytes as f64 / covered.max(1) as f64;
        let sizes = || (0..header.patches.upper()).map(|patch| header.patches.solid_angle_sr(patch));
        let kind = |kind: [u8; 4]| String::from_utf8_lossy(&kind).into_owned();
        Info {
            file: file.to_owned(),
            version: relume_firmware::field::VERSION,
            file_bytes: field.file_bytes(),
            width: field.width(),
            height: field.height(),
            patch_set_id: format!("{:08x}", header.patches.id()),
            patches_upper: header.patches.upper(),
            patches_lower: header.patches.lower(),
            patch_solid_angles_sr: [f32::min, f32::max].map(|pick| sizes().reduce(pick).unwrap_or_default()),
            adaptive: header.patches.subdivided().is_some(),
            covered_pixels: covered,
            camera: CameraInfo { position, target, up, fov_y_deg, north_deg, lens },
            error_target: header.error_target,
            site: header.site,
            seed: header.seed,
            max_hits: header.max_hits,
            bytes_per_covered_pixel: per_pixel(bytes_read(field)),
            bytes_stored_per_covered_pixel: per_pixel(own_bytes),
            ranks: Ranks::of(field),
            sun_casters: field.sun_surfaces().casters().len(),
            sun_highlights: field.sun_surfaces().is_glossy(),
            receivers,
            layers: field.layers().map(|layer| LayerInfo { kind: kind(layer.kind), bytes: layer.length }).collect(),
            bake: serde_json::from_slice(field.meta()).ok(),
        }
    }

    /// One JSON object.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

fn write_noise(f: &mut fmt::Formatter<'_>, noise: &Noise) -> fmt::Result {
    // Patches that hardly light anything are all noise and mean nothing: the worst of all is not told.
    let [median, high] = [0.5, 0.9].map(|share| 100.0 * noise.of_patches(share));
    writeln!(f, "noise     {median:.0} % of a patch's mean light in a pixel: median patch; {high:.0} %: nine in ten")?;
    for sky in &noise.skies {
        writeln!(f, "noise     {:22} {:.2} % of the mean in a pixel", sky.sky, 100.0 * sky.noise)?;
    }
    Ok(())
}

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let camera = &self.camera;
        writeln!(f, "{}: Relume field version {}, {} bytes, sound", self.file, self.version, self.file_bytes)?;
        writeln!(f, "picture   {} x {} px, {} covered", self.width, self.height, self.covered_pixels)?;
        write!(f, "patches   {} + {} (set {})", self.patches_upper, self.patches_lower, self.patch_set_id)?;
        if self.adaptive {
            let [least, most] = self.patch_solid_angles_sr;
            write!(f, ", cut to the scene: {least:.4} to {most:.4} sr above the horizon")?;
        }
        writeln!(f)?;
        writeln!(
            f,
            "camera    at {:?} towards {:?}, {} degrees high, north {}",
            camera.position, camera.target, camera.fov_y_deg, camera.north_deg
        )?;
        if let Some(LensInfo { model, focal_px: [fx, _], principal_px: [cx, cy], k }) = camera.lens {
            writeln!(f, "lens      {model}, focal length {fx:.2} px, axis at ({cx:.2}, {cy:.2}) px, k {k:.6?}")?;
        }
        writeln!(
            f,
            "bytes     {:.1} read and {:.1} stored per covered pixel",
            self.bytes_per_covered_pixel, self.bytes_stored_per_covered_pixel
        )?;
        let Ranks { mean, tenth, median, nine_tenths, max } = self.ranks;
        writeln!(
            f,
            "rank      {mean:.1} on average; {tenth}, {median}, {nine_tenths} at 10, 50, 90 % of pixels; {max} at most"
        )?;
        let target = 100.0 * self.error_target;
        writeln!(
            f,
            "target    {target:.3} % of a pixel as bright as the picture's bright end, under the prior's skies"
        )?;
        for error in self.bake.iter().flat_map(|bake| &bake.held_out) {
            writeln!(
                f,
                "error     {:22} {:.3} % RMSE, worst code {}, {:.3} % of values off by more than one",
                error.sky,
                100.0 * error.rmse,
                error.worst_code,
                100.0 * error.share_off_by_more_than_one
            )?;
        }
        if let Some(noise) = self.bake.as_ref().and_then(|bake| bake.noise.as_ref()) {
            write_noise(f, noise)?;
        }
        let gleams = if self.sun_highlights { ", with highlights" } else { "" };
        writeln!(f, "sun       {} casters{gleams}", self.sun_casters)?;
        if let Some(ReceiverInfo { pixels, bytes: [with, without], bytes_per_pixel }) = self.receivers {
            let bytes = with + without;
            writeln!(f, "receivers {pixels} px, {bytes} bytes apart, {bytes_per_pixel:.1} read per pixel of theirs")?;
        }
        for layer in &self.layers {
            writeln!(f, "layer     {} {:>12} bytes", layer.kind, layer.bytes)?;
        }
        Ok(())
    }
}
