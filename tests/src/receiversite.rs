//! The site with receivers: baked, under two skies, and as a view camera sees it by a path tracer.

use crate::files::put;
use crate::light::Light;
use crate::program::bake_in;
use crate::scene::write_site;
use relume::map::RadianceMap;
use relume_bake::environment::{Environment, Reference, reference};
use relume_bake::material::Shading;
use relume_bake::scene::Scene;
use std::path::Path;

/// Width and height of its pictures.
pub const SIZE: (u32, u32) = (96, 64);
/// Its stack's sun, azimuth and altitude in degrees.
pub const SUN: &str = "230,38";

/// Bakes the site into a folder: `a.field`, and its stacks below `stack`.
///
/// # Panics
/// If it does not bake.
pub fn bake_site(folder: &Path) {
    write_site(folder);
    bake_in(folder, &bake_args("scene", "a.field", &["--stack", "stack", "--sun", SUN])).well();
}

/// What it is baked with.
pub fn bake_args<'a>(command: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let args = [
        command,
        "scene.glb",
        "--camera",
        "camera.json",
        "--size",
        "96x64",
        "--directions",
        "128",
        "--materials",
        "lambert",
        "-o",
        out,
    ];
    [&args[..], more].concat()
}

/// sRGB of linear light (IEC 61966-2-1).
#[must_use]
pub fn code(linear: f64) -> f64 {
    let v = linear.clamp(0.0, 1.0);
    255.0 * if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light of an sRGB code.
#[must_use]
pub fn linear(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// A camera's picture of linear light, row 0 at the top, whose codes 0..=255 are `code` of light and channel.
///
/// # Panics
/// If it cannot be written.
pub fn save_view(path: &Path, picture: &Reference, code: impl Fn(f64, usize) -> f64) {
    let rgb = |x, y| {
        let pixel = picture.rgb[(y * picture.width + x) as usize];
        image::Rgb([0, 1, 2].map(|channel| code(f64::from(pixel[channel]), channel).round() as u8))
    };
    image::RgbImage::from_fn(picture.width, picture.height, rgb).save(path).expect("a picture");
}

/// A map of 128 x 64 pixels, and a sun.
#[derive(Clone, Debug)]
pub struct Sky {
    /// What its files are called.
    pub name: &'static str,
    /// Radiance, row 0 the zenith.
    pub pixels: Vec<[f32; 3]>,
    /// Direction and irradiance.
    pub sun: Option<([f32; 3], [f32; 3])>,
}

/// Direction of the stack's sun.
#[must_use]
pub fn sun_dir_world() -> [f32; 3] {
    let (azimuth, altitude) = (230f32.to_radians(), 38f32.to_radians());
    [altitude.cos() * azimuth.sin(), altitude.sin(), -altitude.cos() * azimuth.cos()]
}

/// A sky that brightens towards -X, with a sun.
#[must_use]
pub fn clear() -> Sky {
    let pixel = |k: usize| {
        let (x, row) = ((k % 128) as f32 / 128.0, k / 128);
        let glow = (std::f32::consts::TAU * x).cos() + 1.0;
        if row < 32 { [0.3 + 0.3 * glow, 0.4 + 0.3 * glow, 0.7 + 0.2 * glow] } else { [0.25, 0.24, 0.2] }
    };
    Sky { name: "clear", pixels: (0..128 * 64).map(pixel).collect(), sun: Some((sun_dir_world(), [3.0, 2.8, 2.5])) }
}

/// A grey one, three times as bright at the zenith as at the horizon (Moon and Spencer).
#[must_use]
pub fn overcast() -> Sky {
    let pixel = |k: usize| {
        let height = (std::f32::consts::PI * ((k / 128) as f32 + 0.5) / 64.0).cos();
        if height > 0.0 {
            [0.3 * (1.0 + 2.0 * height), 0.31 * (1.0 + 2.0 * height), 0.33 * (1.0 + 2.0 * height)]
        } else {
            [0.1; 3]
        }
    };
    Sky { name: "overcast", pixels: (0..128 * 64).map(pixel).collect(), sun: None }
}

impl Sky {
    /// What the camera of the site sees of a scene under it, by a path tracer that knows neither patches nor fields.
    ///
    /// # Panics
    /// If the folder has no site.
    #[must_use]
    pub fn traced(&self, folder: &Path, scene: &Scene, seed: u64) -> Reference {
        let camera = relume_bake::camera::Camera::load(&folder.join("camera.json")).expect("a camera");
        let environment = Environment::new(128, 64, self.pixels.clone(), self.sun).expect("a sky");
        reference(scene, &camera, &environment, SIZE, 400, seed)
    }

    /// Its weights for the site's field.
    ///
    /// # Panics
    /// If the folder has no baked site.
    #[must_use]
    pub fn light(&self, folder: &Path) -> Light {
        let map = RadianceMap { width: 128, height: 64, pixels: self.pixels.clone() };
        let field = relume::relight::FieldFile::open(&folder.join("a.field")).expect("a field");
        let sky = relume::split::weights(&map, field.field().patch_set(), 0.0).expect("weights");
        assert!(sky.sun.is_none());
        let radiance = sky.radiance.iter().map(|rgb| rgb.map(f64::from)).collect();
        Light { radiance, sun: self.sun.map(|(_, light)| light.map(f64::from)) }
    }

    /// The same as a file.
    ///
    /// # Panics
    /// If it cannot be written.
    #[must_use]
    pub fn csv(&self, folder: &Path) -> String {
        let name = format!("{}.csv", self.name);
        put(&folder.join(&name), self.light(folder).csv(&folder.join("stack")));
        name
    }

    /// The same as the log of a post, for so many frames.
    ///
    /// # Panics
    /// If it cannot be written.
    pub fn log(&self, folder: &Path, frames: u32) {
        let light = self.light(folder);
        let sun = light.sun.map(|light| (sun_dir_world(), light));
        let logged = (0..frames).map(|frame| {
            let unix_s = 1_782_014_400.0 + f64::from(frame);
            serde_json::json!({"frame": frame, "unix_s": unix_s, "exposures": [], "radiance": light.radiance, "sun": sun})
                .to_string()
        });
        put(&folder.join("light.jsonl"), logged.collect::<Vec<_>>().join("\n") + "\n");
    }
}

/// The scene of a baked site.
///
/// # Panics
/// If the folder has none.
#[must_use]
pub fn scene_of(folder: &Path) -> Scene {
    relume_bake::scene::load(&folder.join("scene.glb"), Shading::Lambert).expect("a scene").scene
}

/// Codes between two pictures: median, 95 %, mean.
#[must_use]
pub fn off(a: &image::RgbImage, b: &image::RgbImage) -> (f64, f64, f64) {
    let differences = a.as_raw().iter().zip(b.as_raw()).map(|(&a, &b)| f64::from(a.abs_diff(b)));
    let mut differences: Vec<f64> = differences.collect();
    differences.sort_by(f64::total_cmp);
    let at = |share: f64| differences[(share * (differences.len() - 1) as f64) as usize];
    (at(0.5), at(0.95), differences.iter().sum::<f64>() / differences.len() as f64)
}
