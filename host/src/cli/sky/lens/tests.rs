use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Camera, Codes, Exposure, Frame};
use crate::lens::{Lens, LensFile, LensModel, ZENITH_NORTH_UP};
use crate::response::Response;
use crate::skymodel::Atmosphere;
use crate::sun::{Place, parse_utc};
use std::ffi::OsString;
use std::path::Path;

const SIZE: usize = 400;

/// A camera under a sky, and the days of its frames.
struct Scene {
    model: LensModel,
    k: [f64; 4],
    camera_to_world: [[f64; 3]; 3],
    latitude_deg: f64,
    days: &'static [&'static str],
    cloud_cover: f32,
    seed: u64,
}

impl Scene {
    fn truth(&self) -> LensFile {
        LensFile {
            model: self.model,
            focal_px: 121.0,
            center_px: [203.2, 196.6],
            k: self.k,
            camera_to_world: self.camera_to_world,
            ..Lens::zenith_equidistant(SIZE, SIZE, 180.0).file()
        }
    }

    /// Writes a short exposure every fifteen minutes and some middling ones; one frame in nine has a reflection, one in twenty a
    /// wrong time.
    fn record(&self, folder: &Path) {
        let settings = SyntheticSettings {
            width: SIZE,
            height: SIZE,
            lens: Some(self.truth().lens("truth").unwrap()),
            place: Place { latitude_deg: self.latitude_deg, longitude_deg: 11.0 },
            atmosphere: Atmosphere { cloud_cover: self.cloud_cover, cloud_seed: self.seed, ..Atmosphere::default() },
            delay_frames: 0,
            sky_rows: 32,
            seed: self.seed,
            ..SyntheticSettings::default()
        };
        let mut camera = SyntheticCamera::new(settings);
        let rows = camera.response_curve().iter().enumerate().map(|(i, &v)| [i as f64 / 255.0, v, v, v]).collect();
        Response::from_rows(rows, "r").unwrap().save(&folder.join("response.csv")).unwrap();
        let mut list = Vec::new();
        for day in self.days {
            let midnight = parse_utc(&format!("{day}T00:00:00Z")).unwrap();
            for tick in 0..96 {
                let time_s = midnight + 900.0 * f64::from(tick);
                camera.see(time_s);
                if camera.sky().sun().is_none() {
                    continue;
                }
                let exposures: &[f64] = if tick % 6 == 0 { &[1e-4, 6e-4] } else { &[1e-4] };
                for &exposure_s in exposures {
                    list.push(shoot(&mut camera, time_s, exposure_s, folder, list.len()));
                }
            }
        }
        std::fs::write(folder.join("frames.json"), format!("[{}]", list.join(",\n"))).unwrap();
    }
}

/// Takes and writes one frame; its entry in the list.
fn shoot(camera: &mut SyntheticCamera, time_s: f64, exposure_s: f64, folder: &Path, number: usize) -> String {
    let mut frame = Frame::default();
    camera.request(Exposure { exposure_s, gain: 1.0 }).unwrap();
    camera.set_time(time_s);
    camera.frame(&mut frame).unwrap();
    let Codes::U8(mut codes) = frame.codes else { panic!("8-bit codes") };
    if number.is_multiple_of(9) {
        let (x, y) = (number * 37 % 300 + 50, number * 91 % 300 + 50);
        (0..9).for_each(|i| codes[3 * ((y + i / 3) * SIZE + x + i % 3)..][..3].fill(255));
    }
    let name = format!("{number:04}.png");
    image::RgbImage::from_raw(SIZE as u32, SIZE as u32, codes).unwrap().save(folder.join(&name)).unwrap();
    let said_s = if number % 20 == 7 { time_s + 5400.0 } else { time_s };
    format!(r#"{{"file":"{name}","time_s":{exposure_s},"captured_at":{said_s}}}"#)
}

fn relume(args: &[&str]) -> Result<(), crate::failure::Failure> {
    crate::cli::run(args.iter().map(OsString::from))
}

/// RMS over the sky in pixels and degrees, and the worst in degrees.
fn off(found: &Lens, truth: &Lens) -> (f64, f64, f64) {
    let (mut px, mut degrees) = (Vec::new(), Vec::new());
    for pixel in (0..SIZE * SIZE).step_by(61) {
        let at = [(pixel % SIZE) as f64 + 0.5, (pixel / SIZE) as f64 + 0.5];
        let Some(dir) = truth.unproject(at).filter(|dir| dir[1] > 0.08) else { continue };
        let seen = found.project(dir).unwrap();
        let other = found.unproject(at).unwrap();
        px.push((seen[0] - at[0]).hypot(seen[1] - at[1]));
        let chord = (0..3).map(|k| (dir[k] - other[k]).powi(2)).sum::<f64>().sqrt();
        degrees.push((2.0 * (0.5 * chord).asin()).to_degrees());
    }
    let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
    (rms(&px), rms(&degrees), degrees.iter().copied().fold(0.0, f64::max))
}

/// North-up tilted by 12 degrees to the east and turned by 25.
fn tilted() -> [[f64; 3]; 3] {
    let turn = |axis: [usize; 2], degrees: f64, m: [[f64; 3]; 3]| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let mut turned = m;
        turned[axis[0]] = [0, 1, 2].map(|j| cos * m[axis[0]][j] - sin * m[axis[1]][j]);
        turned[axis[1]] = [0, 1, 2].map(|j| sin * m[axis[0]][j] + cos * m[axis[1]][j]);
        turned
    };
    turn([2, 0], 25.0, turn([0, 1], -12.0, ZENITH_NORTH_UP))
}

fn scenes() -> [(&'static str, Scene); 3] {
    let bent = [-0.03, 0.004, -0.001, 0.0];
    [
        (
            "equidistant, level, 48 N, June",
            Scene {
                model: LensModel::Equidistant,
                k: [0.0; 4],
                camera_to_world: ZENITH_NORTH_UP,
                latitude_deg: 48.0,
                days: &["2026-06-12", "2026-06-14"],
                cloud_cover: 0.35,
                seed: 3501,
            },
        ),
        (
            "kannala_brandt, tilted 12, 30 N, February to May",
            Scene {
                model: LensModel::KannalaBrandt,
                k: bent,
                camera_to_world: tilted(),
                latitude_deg: 30.0,
                days: &["2026-02-11", "2026-05-03"],
                cloud_cover: 0.3,
                seed: 3502,
            },
        ),
        (
            "equisolid, tilted 12, 37 S, October",
            Scene {
                model: LensModel::Equisolid,
                k: [0.0; 4],
                camera_to_world: tilted(),
                latitude_deg: -37.0,
                days: &["2026-10-08", "2026-10-20"],
                cloud_cover: 0.0,
                seed: 3503,
            },
        ),
    ]
}

#[test]
fn the_program_finds_lens_and_orientation_from_simulated_frames() {
    let [level, _, equisolid] = scenes();
    check(&[level, equisolid]);
}

/// Kannala-Brandt's four numbers, where the tilted picture shows sky beyond the sun's path; the longest of the scenes.
#[test]
#[ignore = "takes half a minute"]
fn the_program_finds_a_bent_lens_from_simulated_frames() {
    let [_, bent, _] = scenes();
    check(&[bent]);
}

fn check(scenes: &[(&str, Scene)]) {
    for (name, scene) in scenes {
        let folder = tempfile::tempdir().unwrap();
        scene.record(folder.path());
        let file = |name: &str| folder.path().join(name).display().to_string();
        let frames = folder.path().display().to_string();
        let site = format!("{},11", scene.latitude_deg);
        let (lens, plot, mask, response) =
            (file("lens.json"), file("plot.png"), file("mask.png"), file("response.csv"));
        let mut args = vec!["sky", "lens", &frames, "--site", &site, "--response", &response, "-o", &lens];
        args.extend(["--plot", &plot, "--mask", &mask]);
        if scene.model == LensModel::Equisolid {
            args.extend(["--model", "equisolid"]);
        }
        relume(&args).unwrap_or_else(|failure| panic!("{name}: {failure}"));
        let found = Lens::load(Path::new(&lens)).unwrap();
        let (px, degrees, worst) = off(&found, &scene.truth().lens("truth").unwrap());
        println!("{name}: over the sky {px:.3} px, {degrees:.3} degrees rms, worst {worst:.3}");
        assert!(px < 0.5 && degrees < 0.1, "{name}: {px} px, {degrees} degrees");
        let share = found.mask().unwrap().share();
        assert!((0.3..0.8).contains(&share), "{name}: {share} of the picture is sky");
        if let Some(keep) = std::env::var_os("RELUME_KEEP_PLOT") {
            std::fs::copy(&plot, Path::new(&keep).join(format!("{}.png", scene.seed))).unwrap();
            std::fs::copy(&mask, Path::new(&keep).join(format!("{}-mask.png", scene.seed))).unwrap();
        }
    }
}

#[test]
fn what_cannot_be_used_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let frames = folder.path().display().to_string();
    let out = folder.path().join("l.json").display().to_string();
    let list = |text: &str| std::fs::write(folder.path().join("frames.json"), text).unwrap();
    let fails = |more: &[&str], parts: &[&str]| {
        let mut args = vec!["sky", "lens", &frames, "-o", &out];
        args.extend(more);
        let failure = relume(&args).unwrap_err();
        let text = failure.to_string();
        assert!(failure.exit_code() == 2 && !text.contains('\n'), "{text}");
        assert!(parts.iter().all(|part| text.contains(part)), "{text} lacks one of {parts:?}");
    };
    fails(&[], &["--site LAT,LON is missing"]);
    fails(&["--site", "48,11", "--model", "pinhole"], &["pinhole", "kannala_brandt"]);
    list(r#"[{"file":"a.png","time_s":1}]"#);
    fails(&["--site", "48,11"], &["frames.json", "entry 0", "captured_at"]);
    list(r#"[{"file":"a.png","time_s":1,"captured_at":"2026-06-21T23:00:00Z"}]"#);
    fails(&["--site", "48,11"], &["frames.json", "degrees high at 48,11"]);
    list(r#"[{"file":"a.png","time_s":1,"captured_at":"2026-06-21T11:00:00Z"}]"#);
    fails(&["--site", "48,11"], &["a.png"]);
    image::RgbImage::new(40, 40).save(folder.path().join("a.png")).unwrap();
    fails(&["--site", "48,11"], &["only 0 frames"]);
    assert!(!Path::new(&out).exists());
}
