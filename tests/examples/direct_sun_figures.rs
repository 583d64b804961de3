//! How right a post's direct sunlight is at any minute: `cargo run --release -p relume-tests --example direct_sun_figures --
//! OUT_DIR (demo | SCENE.glb CAMERA.json) [COUNT [SEED [WIDTHxHEIGHT]]]`.
//!
//! The live sun, whose visibility is traced through the geometry that a field carries, against an exact disc (`src/directsun.rs`) at
//! random minutes of 2026 with the sun above 10 degrees, over Rome (the demo over its own site). Writes `minutes.csv`, and of the
//! worst minute `worst.png`: the live sun, the exact one, and their difference: red where the live sun is too bright, blue where too
//! dark, full colour from a fifth of full sun on.

use glam::{Vec3, Vec3A};
use relume::picture::{srgb_code, write_png};
use relume::sun::{Place, SunPosition, dir_world, format_utc, parse_utc, sun_position};
use relume_bake::bake::{BakeOptions, bake};
use relume_bake::camera::Camera;
use relume_bake::demo_scene;
use relume_bake::response::TransportOptions;
use relume_bake::scene::{Scene, Shading, load};
use relume_firmware::field::Field;
use relume_firmware::sunlight::SunLight;
use relume_firmware::tile::TILE_PX;
use relume_tests::directsun::{Apart, DirectSun, Pixel, apart, off_of_full};
use relume_tests::random::Random;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const LOWEST_DEG: f64 = 10.0;
const YEAR_MIN: u32 = 365 * 24 * 60;
const ROME_DEG: [f64; 2] = [41.8986, 12.4769];
/// What direct sunlight needs of a field.
const LAYERS: [&[u8; 4]; 4] = [b"CAST", b"CBVH", b"FRGT", b"FRAG"];

type Failure = Box<dyn std::error::Error>;

struct Study {
    out: PathBuf,
    scene: Scene,
    camera: Camera,
    place: Place,
    count: usize,
    seed: u64,
    size: (u32, u32),
}

impl Study {
    fn of_arguments() -> Result<Self, Failure> {
        let mut args = std::env::args().skip(1);
        let mut next = |what: &str| args.next().ok_or_else(|| format!("{what} is missing"));
        let out = PathBuf::from(next("OUT_DIR")?);
        let (scene, camera, site) = match next("demo or SCENE.glb")?.as_str() {
            "demo" => (demo_scene::temple().0, demo_scene::temple().1, demo_scene::SITE_DEG),
            file => {
                let camera = Camera::load(Path::new(&next("CAMERA.json")?))?;
                (load(Path::new(file), Shading::Lambert)?.scene, camera, ROME_DEG)
            }
        };
        let count = args.next().map_or(Ok(100), |text| text.parse())?;
        let seed = args.next().map_or(Ok(8191), |text| text.parse())?;
        let size = args.next().unwrap_or_else(|| "256x192".into());
        let (width, height) = size.split_once('x').ok_or("WIDTHxHEIGHT: write 256x192")?;
        let size = (width.parse()?, height.parse()?);
        let place = Place { latitude_deg: site[0], longitude_deg: site[1] };
        Ok(Study { out, scene: scene.shaded(Shading::Lambert), camera, place, count, seed, size })
    }

    /// A field that knows of light no more than the sun needs.
    fn field(&self) -> Result<Vec<u8>, Failure> {
        let transport =
            TransportOptions { max_hits: 1, direct_classes: 1, paths: 1, sun_paths: 1, ..TransportOptions::default() };
        let options = BakeOptions { size: self.size, directions: 16, transport, ..BakeOptions::default() };
        Ok(bake(&self.scene, &self.camera, &options)?.bytes)
    }

    /// Times, unix seconds, and where the sun stands then.
    fn minutes(&self) -> Result<Vec<(f64, SunPosition)>, Failure> {
        let (start_unix_s, mut random) = (parse_utc("2026-01-01T00:00:00Z")?, Random::new(self.seed, 0));
        let mut minutes = Vec::new();
        while minutes.len() < self.count {
            let unix_s = start_unix_s + 60.0 * f64::from(random.bits() % YEAR_MIN);
            let sun = sun_position(unix_s, self.place)?;
            if sun.altitude_deg > LOWEST_DEG {
                minutes.push((unix_s, sun));
            }
        }
        Ok(minutes)
    }
}

/// The live sun's direct light, `None` where the field has no pixel; rows from the top.
fn live_picture(field: &Field<'_>, dir_world: [f32; 3]) -> Vec<Option<Vec3A>> {
    let (light, response) = (SunLight::new(field, dir_world), field.response());
    let mut picture = vec![None; field.width() * field.height()];
    for index in 0..response.tiles() {
        let tile = response.tile(index);
        let padded = tile.padded_pixels();
        let mut slot = vec![0u16; 3 * padded];
        // No light on the bounce points: the direct part alone.
        light.tile(field, index, &[], &mut slot);
        let (column, row) = (index % response.grid().0, index / response.grid().0);
        for (k, pixel) in tile.covered().enumerate() {
            let at = (row * TILE_PX + pixel / TILE_PX) * field.width() + column * TILE_PX + pixel % TILE_PX;
            let rgb = [0, 1, 2].map(|c| f32::from(slot[c * padded + k]) / 32768.0);
            picture[at] = Some(Vec3A::from(rgb));
        }
    }
    picture
}

/// A minute's sun, the differences at the points and all over, and both pictures.
struct Minute {
    unix_s: f64,
    sun: SunPosition,
    apart: [Apart; 2],
    live: Vec<Option<Vec3A>>,
    exact: Vec<Pixel>,
}

fn main() -> Result<(), Failure> {
    let study = Study::of_arguments()?;
    std::fs::create_dir_all(&study.out)?;
    let bytes = study.field()?;
    let field = Field::new(&bytes)?;
    tell_bytes(&field);
    let exact = DirectSun::new(&study.scene, &study.camera, study.size, study.seed);
    let mut csv = String::from("utc,azimuth_deg,altitude_deg,rms_points,seen_points,worst_points,rms,seen,worst\n");
    let (mut all, mut worst): (Vec<[Apart; 2]>, Option<Minute>) = (Vec::new(), None);
    for (unix_s, sun) in study.minutes()? {
        let dir = dir_world(sun, study.camera.north_deg);
        let (live, exact) = (live_picture(&field, dir), exact.picture(Vec3::from(dir)));
        let apart = [apart(&live, &exact, |p| p.at_points), apart(&live, &exact, |p| p.all_over)];
        write!(csv, "{},{:.3},{:.3}", format_utc(unix_s), sun.azimuth_deg, sun.altitude_deg)?;
        for Apart { rms, seen, worst } in apart {
            write!(csv, ",{rms:.6},{seen:.7},{worst:.4}")?;
        }
        csv.push('\n');
        all.push(apart);
        if worst.as_ref().is_none_or(|worst| worst.apart[1].rms < apart[1].rms) {
            worst = Some(Minute { unix_s, sun, apart, live, exact });
        }
    }
    std::fs::write(study.out.join("minutes.csv"), csv)?;
    tell(&all);
    worst.map_or(Ok(()), |worst| draw(&study, &worst))
}

fn tell_bytes(field: &Field<'_>) {
    let of = |kind: &[u8; 4]| field.layers().filter(|layer| &layer.kind == kind).map(|layer| layer.length).sum();
    let bytes: [u64; 4] = LAYERS.map(of);
    let (sum, covered) = (bytes.iter().sum::<u64>() as f64, field.response().covered() as f64);
    println!("{covered} pixels; stored for direct sunlight: {:.2} MB, {:.1} bytes per pixel", sum / 1e6, sum / covered);
    println!(
        "of that geometry {:.2} MB; a traced sun reads all of it, a frame its plane: {:.1} bytes per pixel",
        (bytes[0] + bytes[1]) as f64 / 1e6,
        2.0 * field.response().plane_len() as f64 / covered
    );
}

fn tell(all: &[[Apart; 2]]) {
    for (way, name) in ["exact disc from the same 16 points", "exact disc from all over the pixel"].iter().enumerate() {
        let of = |figure: fn(&Apart) -> f64| {
            let mut values: Vec<f64> = all.iter().map(|apart| figure(&apart[way])).collect();
            values.sort_by(f64::total_cmp);
            (values[values.len() / 2], values[values.len() - 1])
        };
        let (rms, seen, worst) = (of(|apart| apart.rms), of(|apart| apart.seen), of(|apart| apart.worst));
        println!(
            "{name}, {} minutes, median / worst: rms {:.2} / {:.2} % of the mean; off by more than a fifth of full sun {:.4} / \
             {:.4} % of pixels; largest {:.0} / {:.0} % of full sun",
            all.len(),
            100.0 * rms.0,
            100.0 * rms.1,
            100.0 * seen.0,
            100.0 * seen.1,
            100.0 * worst.0,
            100.0 * worst.1
        );
    }
}

/// Live, exact and difference side by side, white paint in full sun white.
fn draw(study: &Study, minute: &Minute) -> Result<(), Failure> {
    let (width, height) = (study.size.0 as usize, study.size.1 as usize);
    let mut pixels = vec![0x80_80_80u32; 3 * width * height];
    for (at, (live, pixel)) in minute.live.iter().zip(&minute.exact).enumerate() {
        let Some(live) = *live else { continue };
        let exact = 0.5 * (pixel.all_over[0] + pixel.all_over[1]);
        let lit = |rgb: Vec3A| {
            rgb.to_array()
                .iter()
                .fold(0, |code, &v| code << 8 | u32::from(srgb_code(f64::from(v) * std::f64::consts::PI)))
        };
        let off = (off_of_full(live, pixel, exact) * 5.0 * 255.0).clamp(-255.0, 255.0);
        let [red, blue] = [off.max(0.0), (-off).max(0.0)].map(|part| part as u32);
        let place = at / width * 3 * width + at % width;
        (pixels[place], pixels[place + width]) = (lit(live), lit(exact));
        pixels[place + 2 * width] = red << 16 | blue;
    }
    write_png(&study.out.join("worst.png"), 3 * width, height, &pixels)?;
    let SunPosition { azimuth_deg, altitude_deg } = minute.sun;
    println!(
        "worst minute: {}, sun at {azimuth_deg:.1}, {altitude_deg:.1} degrees, rms {:.2} %",
        format_utc(minute.unix_s),
        100.0 * minute.apart[1].rms
    );
    Ok(())
}
