use crate::camera::replay::read_list;
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::lens::{Lens, LensFile, ZENITH_NORTH_UP};
use crate::response::Response;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

const SIZE: usize = 240;

fn relume(args: &[&str]) -> Result<(), crate::failure::Failure> {
    crate::cli::run(args.iter().map(OsString::from))
}

/// The lens of the simulated camera: level, turned by 20 degrees, its centre off the picture's.
fn truth() -> Lens {
    let (sin, cos) = 20f64.to_radians().sin_cos();
    let [east, up, south] = ZENITH_NORTH_UP;
    let turned = |a: [f64; 3], b: [f64; 3], c: f64, s: f64| [0, 1, 2].map(|k| c * a[k] + s * b[k]);
    let file = LensFile {
        focal_px: 74.0,
        center_px: [121.4, 118.7],
        camera_to_world: [turned(east, south, cos, -sin), up, turned(south, east, cos, sin)],
        ..Lens::zenith_equidistant(SIZE, SIZE, 180.0).file()
    };
    file.lens("truth").unwrap()
}

/// A post with a simulated camera in a folder of its own, from a time on.
fn post(folder: &Path, start: &str) -> String {
    truth().file().save(&folder.join("lens.json")).unwrap();
    let text = format!(
        "field = 'not-baked-yet.field'\nsky = 'synthetic'\n[camera]\nlens = 'lens.json'\n[site]\nlatitude = 48.0\nlongitude = \
         11.0\n[display]\nkind = 'headless'\nfolder = 'o'\n[run]\nstart = {start}\n"
    );
    let file = folder.join("POST.toml");
    std::fs::write(&file, text).unwrap();
    file.display().to_string()
}

fn in_folder(folder: &Path) -> impl Fn(&str) -> String {
    let folder: PathBuf = folder.into();
    move |name| folder.join(name).display().to_string()
}

#[test]
fn a_captured_series_tells_the_cameras_response() {
    let folder = tempfile::tempdir().unwrap();
    let file = in_folder(folder.path());
    let post = post(folder.path(), "2026-06-21T12:00:00Z");
    let (frames, curve) = (file("frames"), file("curve.csv"));
    relume(&["sky", "capture", &post, "--series", "12", "-o", &frames]).unwrap();
    let listed = read_list(Path::new(&frames)).unwrap();
    assert_eq!(listed.len(), 12);
    for pair in listed.windows(2) {
        let stops = (pair[1].exposure.product_s() / pair[0].exposure.product_s()).log2();
        assert!((stops - 1.0).abs() < 0.6 && pair[1].captured_at_s > pair[0].captured_at_s, "{pair:?}");
    }
    relume(&["sky", "response", &frames, "-o", &curve]).unwrap();
    let found = Response::load(Path::new(&curve)).unwrap();
    let true_rows = SyntheticCamera::new(SyntheticSettings { width: 8, height: 8, ..SyntheticSettings::default() });
    let (mut squares, mut count) = (0.0, 0.0);
    for (row, known) in found.rows().iter().zip(true_rows.response_rows()).skip(20).take(230) {
        for k in 1..4 {
            squares += (row[k] / known[k]).ln().powi(2);
            count += 1.0;
        }
    }
    let rms_log: f64 = f64::sqrt(squares / count);
    println!("response of a captured series, RMS log error {rms_log:.4}");
    assert!(rms_log < 0.02, "{rms_log}");
}

#[test]
fn the_captured_path_of_the_sun_tells_the_lens() {
    let folder = tempfile::tempdir().unwrap();
    let file = in_folder(folder.path());
    let post = post(folder.path(), "2026-06-21T03:00:00Z");
    let (frames, lens) = (file("frames"), file("found.json"));
    let capture = |more: &[&str]| {
        let args = ["sky", "capture", &post, "--sun", "--every", "24m", "--for", "16h", "-o", &frames];
        relume(&[&args[..], more].concat())
    };
    capture(&[]).unwrap();
    let listed = read_list(Path::new(&frames)).unwrap();
    let shortest = listed.iter().filter(|frame| frame.exposure.product_s() < 1.5e-4).count();
    assert!((30..=41).contains(&shortest) && shortest < listed.len(), "{shortest} of {}", listed.len());
    // It is gone on with only when that was meant.
    let refused = capture(&[]).unwrap_err();
    assert!(refused.exit_code() == 2 && refused.to_string().contains("--resume"), "{refused}");
    capture(&["--resume"]).unwrap();
    assert_eq!(read_list(Path::new(&frames)).unwrap().len(), 2 * listed.len());
    let response = file("response.csv");
    let camera = SyntheticCamera::new(SyntheticSettings { width: 8, height: 8, ..SyntheticSettings::default() });
    Response::from_rows(camera.response_rows(), "r").unwrap().save(Path::new(&response)).unwrap();
    let args = ["sky", "lens", &frames, "--site", "48,11", "--model", "equidistant", "--response", &response];
    relume(&[&args[..], &["-o", &lens]].concat()).unwrap();
    let (found, truth) = (Lens::load(Path::new(&lens)).unwrap(), truth());
    let mut worst_deg: f64 = 0.0;
    for pixel in (0..SIZE * SIZE).step_by(97) {
        let at = [(pixel % SIZE) as f64 + 0.5, (pixel / SIZE) as f64 + 0.5];
        let Some(dir) = truth.unproject(at).filter(|dir| dir[1] > 0.1) else { continue };
        let cosine: f64 = found.unproject(at).unwrap().iter().zip(dir).map(|(a, b)| a * b).sum();
        worst_deg = worst_deg.max(cosine.min(1.0).acos().to_degrees());
    }
    println!("lens of a captured path, worst over the sky {worst_deg:.3} degrees");
    assert!(worst_deg < 0.4, "{worst_deg}");
}

#[test]
fn what_cannot_be_captured_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = in_folder(folder.path());
    let post = post(folder.path(), "2026-06-21T00:00:00Z");
    let out = file("frames");
    let fails = |args: &[&str], code: u8, parts: &[&str]| {
        let failure = relume(&[&["sky", "capture"], args].concat()).unwrap_err();
        let text = failure.to_string();
        assert!(failure.exit_code() == code && !text.contains('\n'), "{code}: {text}");
        assert!(parts.iter().all(|part| text.contains(part)), "{text} lacks one of {parts:?}");
        assert!(!Path::new(&out).exists());
    };
    fails(&["-o", &out], 2, &["POST.toml is missing"]);
    fails(&[&post, "--sun"], 2, &["-o FRAMES_DIR is missing"]);
    fails(&[&post, "-o", &out], 2, &["--series", "--sun"]);
    fails(&[&post, "--sun", "--series", "4", "-o", &out], 2, &["not both"]);
    fails(&[&post, "--series", "4", "--for", "1h", "-o", &out], 2, &["--for"]);
    fails(&[&post, "--series", "1", "-o", &out], 2, &["--series 1"]);
    fails(&[&post, "--sun", "--every", "5", "-o", &out], 2, &["--every 5", "5m"]);
    fails(&[&post, "--series", "4", "-o", &file("no/frames")], 2, &["no/frames", "does not exist"]);
    fails(&[&post, "--series", "4", "-o", "/proc/frames"], 2, &["/proc/frames"]);
    fails(&[&post, "--sun", "--every", "10m", "--for", "1h", "-o", &out], 1, &["no frame", "4 degrees high"]);
    let with = |sky: &str, more: &str| {
        let text = format!(
            "field = 'f'\nsky = '{sky}'\n{more}\n[site]\nlatitude = 48.0\nlongitude = 11.0\n[display]\nkind = \
             'headless'\nfolder = 'o'\n"
        );
        std::fs::write(file("other.toml"), text).unwrap();
        file("other.toml")
    };
    fails(&[&with("simulated", ""), "--sun", "-o", &out], 2, &["other.toml", "simulated", "has no camera"]);
    let missing = with("camera", "[camera]\ndevice = '/dev/video77'");
    if cfg!(feature = "board") {
        fails(&[&missing, "--sun", "-o", &out], 1, &["the camera is gone"]);
    } else {
        fails(&[&missing, "--sun", "-o", &out], 2, &["--features board"]);
    }
}
