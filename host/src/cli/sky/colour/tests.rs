use crate::bracket::{Merged, PixelState};
use crate::capture::{Capture, CaptureSettings};
use crate::colour::CameraColour;
use crate::colour::chart::COLORCHECKER_LAB_D50;
use crate::colour::spaces::{D50, D65, REC709_OF_XYZ, Triple, adapt, apply, xyz_of_lab};
use crate::lens::Lens;
use relume_firmware::patches::PatchSet;
use std::ffi::OsString;

/// What the camera makes of linear Rec.709.
const CAMERA_OF_REC709: [Triple; 3] = [[0.45, 0.30, 0.04], [0.15, 0.75, 0.18], [0.03, 0.18, 0.60]];

/// A linear 16-bit photograph of a ColorChecker in a row of six by four squares of 20 pixels.
fn photograph() -> image::ImageBuffer<image::Rgb<u16>, Vec<u16>> {
    image::ImageBuffer::from_fn(120, 80, |x, y| {
        let lab = COLORCHECKER_LAB_D50[(y / 20 * 6 + x / 20) as usize];
        let rec709 = apply(&REC709_OF_XYZ, adapt(xyz_of_lab(lab, D50), D50, D65));
        image::Rgb(apply(&CAMERA_OF_REC709, rec709).map(|v| (40_000.0 * v.max(0.0)).round() as u16))
    })
}

fn relume(args: &[&str]) -> Result<(), crate::failure::Failure> {
    crate::cli::run(args.iter().map(OsString::from))
}

#[test]
fn a_photographed_chart_makes_the_captured_sky_the_right_colour() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (chart, camera) = (file("chart.png"), file("camera.json"));
    photograph().save(&chart).unwrap();
    relume(&["sky", "colour", &chart, "--corners", "10,10,110,10,110,70,10,70", "-o", &camera]).unwrap();
    let colour = CameraColour::load(camera.as_ref()).unwrap();

    // An evening sky as the camera sees it, through the capture.
    let sky = [0.9, 0.7, 0.55];
    let seen = apply(&CAMERA_OF_REC709, sky).map(|v| v as f32);
    let merged = Merged {
        width: 60,
        height: 60,
        radiance: vec![seen; 3600],
        state: vec![PixelState::Valid; 3600],
        captured_at_s: 0.0,
    };
    let lens = Lens::zenith_equidistant(60, 60, 184.0);
    let mut capture =
        Capture::new(&lens, (60, 60), PatchSet::new(64).unwrap(), CaptureSettings::default(), None).unwrap();
    let ratio = |capture: &mut Capture| {
        let [r, g, b] = capture.weights(&merged, None).unwrap().weights.radiance[0].map(f64::from);
        [r / g, b / g]
    };
    let (truth, plain) = ([sky[0] / sky[1], sky[2] / sky[1]], ratio(&mut capture));
    capture.set_colour(&colour);
    let right = ratio(&mut capture);
    assert!((plain[0] / truth[0] - 1.0).abs() > 0.1, "{plain:?} {truth:?}");
    assert!((0..2).all(|k| (right[k] / truth[k] - 1.0).abs() < 5e-3), "{right:?} {truth:?}");
}

#[test]
fn what_cannot_be_used_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (chart, patches, out) = (file("chart.png"), file("patches.csv"), file("camera.json"));
    let fails = |more: &[&str], parts: &[&str]| {
        let mut args = vec!["sky", "colour", &chart, "-o", &out];
        args.extend(more);
        let failure = relume(&args).unwrap_err();
        let text = failure.to_string();
        assert!(failure.exit_code() == 2 && !text.contains('\n'), "{text}");
        assert!(parts.iter().all(|part| text.contains(part)), "{text} lacks one of {parts:?}");
    };
    fails(&[], &["--chart", "--corners"]);
    fails(&["--chart", &patches], &["patches.csv"]);
    std::fs::write(&patches, "x,y,L,a,b\n10,10,50,0,0\n30,10,40,20\n").unwrap();
    fails(&["--chart", &patches], &["patches.csv", "line 3"]);
    fails(&["--corners", "10,10,110,10,110,70,10,70"], &["chart.png"]);
    photograph().save(&chart).unwrap();
    fails(&["--corners", "10,10,210,10,210,70,10,70"], &["chart.png", "patch 4", "within the picture"]);
    fails(&["--corners", "10,10,110,10,110,70,10,70", "--light", "2000"], &["--light 2000", "4000"]);
    assert!(!std::path::Path::new(&out).exists());
}
