//! The sky camera's programs one after the other: exposure series -> merged picture -> weights.

#![allow(clippy::unwrap_used)]

use relume::camera::Exposure;
use relume::colour::CameraColour;
use relume::lens::Lens;
use relume::response::Response;
use relume::weights::PatchWeights;
use relume_tests::files::{fresh_folder, put};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_site;
use relume_tests::skycamera::{Sensor, Series, exposures, quantiles, response_error, settings, take};
use std::path::Path;

/// A camera that looks at the zenith, north at the top of its picture.
const LENS: &str =
    r#"{"model":"equidistant","focal_px":76.4,"center_px":[160,120],"camera_to_world":[[-1,0,0],[0,0,1],[0,1,0]]}"#;

#[test]
fn a_sun_that_is_clipped_in_every_frame_is_not_lost_between_merging_and_weights() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "clipped_sun");
    let sun = relume::sun::SunPosition { azimuth_deg: 152.0, altitude_deg: 48.0 };
    put(&folder.join("lens.json"), LENS);
    let mut camera = settings(Sensor::Power, 9203);
    (camera.width, camera.height, camera.sun) = (320, 240, Some(sun));
    camera.lens = Some(Lens::load(&folder.join("lens.json")).unwrap());
    camera.atmosphere.cloud_cover = 0.0;
    let series = take(camera, &exposures(1.25e-4, 8.0, 4));
    series.save(&folder.join("frames")).unwrap();
    let scale = series.camera.radiance_scale();
    let truth = series.camera.sky().sun().unwrap().irradiance.map(|e| f64::from(e) / scale);
    write_site(&folder);
    let bake = ["scene", "scene.glb", "--camera", "camera.json", "--size", "16x12", "--directions", "64"];
    bake_in(&folder, &[&bake[..], &["--materials", "lambert", "--sun-paths", "1", "-o", "a.field"]].concat()).well();
    let field = relume::relight::FieldFile::open(&folder.join("a.field")).unwrap();
    let merge = |out: &str| {
        let args = ["sky", "merge", "frames", "--response", "frames/curve_truth.csv", "-o", out];
        relume_in(&folder, &args).well().stderr
    };
    let weights = |map: &str| {
        let args = ["sky", "weights", map, "--lens", "lens.json", "--field", "a.field", "--sun", "152,48"];
        let told = relume_in(&folder, &[&args[..], &["-o", "w.csv", "--json"]].concat()).well().stdout;
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        let sun = PatchWeights::load(&folder.join("w.csv"), field.field().patch_set()).unwrap().sun;
        (told["sun"].as_str().unwrap().to_owned(), sun.map_or([0.0; 3], |sun| sun.irradiance))
    };
    let told = merge("sky.exr");
    assert!(told.contains("pixels are clipped in every frame"), "{told}");
    let (source, found) = weights("sky.exr");
    eprintln!("the sun {found:?}, true {truth:?}, by {source}");
    assert_eq!(source, "model");
    assert!((0..3).all(|c| (f64::from(found[c]) / truth[c] - 1.0).abs() < 0.05), "{found:?} {truth:?}");
    // What a file cannot hold is told.
    let told = merge("sky.hdr");
    assert!(told.contains("an .hdr cannot tell where") && told.contains("--probe"), "{told}");
}

/// Frames one stop apart, and 3 stops.
fn fourteen() -> Vec<Exposure> {
    exposures(6.25e-5, 2.0, 14)
}

fn four() -> Vec<Exposure> {
    exposures(1.25e-4, 8.0, 4)
}

/// RMS log error of the curve that `sky response` finds from a folder of frames.
fn calibrated(folder: &Path, frames: &str, curve: &str, series: &Series) -> f64 {
    relume_in(folder, &["sky", "response", frames, "-o", curve]).well();
    let found = Response::load(&folder.join(curve)).unwrap();
    response_error(|code, k| found.fraction(code, k), &series.camera.response_rows()).0
}

/// Median and 95th percentile of the relative radiance error of `sky merge`, over the pixels that are not clipped.
fn merged_error(folder: &Path, frames: &str, curve: &str, series: &Series) -> [f64; 2] {
    use exr::prelude::*;
    relume_in(folder, &["sky", "merge", frames, "--response", curve, "-o", "merged.exr"]).well();
    let blank = |size: Vec2<usize>, _: &_| (size.width(), vec![(0.0, 0.0, 0.0, 0.0); size.area()]);
    // Rows come in any order.
    let set = |(width, pixels): &mut (usize, Vec<_>), at: Vec2<usize>, pixel: (f32, f32, f32, f32)| {
        pixels[at.y() * *width + at.x()] = pixel;
    };
    let channels = read().no_deep_data().largest_resolution_level().specific_channels();
    let channels = channels.required("R").required("G").required("B").required("clipped");
    let image = channels.collect_pixels(blank, set).first_valid_layer().all_attributes();
    let (width, pixels) = image.from_file(folder.join("merged.exr")).unwrap().layer_data.channel_data.pixels;
    assert_eq!((width, pixels.len()), (640, 640 * 480));
    let seen = pixels.iter().zip(&series.truth[0]).filter(|((.., clipped), truth)| *clipped == 0.0 && truth[1] > 0.0);
    quantiles(
        seen.flat_map(|(&(r, g, b, _), t)| [r / t[0], g / t[1], b / t[2]]).map(|v| f64::from(v - 1.0).abs()).collect(),
    )
}

#[test]
fn response_and_radiance_keep_their_bounds_through_the_programs() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "calibration");
    for (sensor, seed) in [(Sensor::Mixed, 6421), (Sensor::Linear, 6422)] {
        let name = sensor.name();
        let [long, short, curve] = ["long", "short", "curve.csv"].map(|part| format!("{name}_{part}"));
        let series = take(settings(sensor, seed), &fourteen());
        series.save(&folder.join(&long)).unwrap();
        let response = calibrated(&folder, &long, &curve, &series);
        let own = merged_error(&folder, &long, &curve, &series);
        let later = take(settings(sensor, seed + 1000), &four());
        later.save(&folder.join(&short)).unwrap();
        let stored = merged_error(&folder, &short, &curve, &later);
        let steep = calibrated(&folder, &short, "steep.csv", &later);
        eprintln!(
            "{name} {seed}: response {response:.4}, from 4 {steep:.4}; radiance {own:.4?}, 4 frames {stored:.4?}"
        );
        assert!(response <= 0.004 && steep <= 0.025, "{name}: {response} {steep}");
        assert!(own[0] <= 0.007 && own[1] <= 0.02, "{name}: {own:?}");
        assert!(stored[0] <= 0.013 && stored[1] <= 0.042, "{name}: {stored:?}");
    }
}

#[test]
fn a_plot_of_the_response_shows_three_curves_and_frames_of_a_camera_that_stands_still_are_refused() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "response_plot");
    let mut camera = settings(Sensor::Film, 6431);
    (camera.width, camera.height) = (320, 240);
    let series = take(camera, &exposures(1.25e-4, 4.0, 6));
    series.save(&folder.join("frames")).unwrap();
    relume_in(&folder, &["sky", "response", "frames", "--plot", "plot.png", "-o", "curve.csv"]).well();
    let plot = image::open(folder.join("plot.png")).unwrap().into_rgb8();
    assert_eq!(plot.dimensions(), (900, 600));
    // The curves' own colours, each drawn across most of the width.
    for color in [[200, 30, 30], [20, 140, 40], [30, 60, 200]] {
        let columns = (0..900).filter(|&x| (0..600).any(|y| plot.get_pixel(x, y).0 == color)).count();
        assert!(columns > 500, "{color:?}: {columns} columns");
    }
    // The third picture in the place of the fourth.
    let list = std::fs::read_to_string(folder.join("frames/frames.json")).unwrap();
    let list: serde_json::Value = serde_json::from_str(&list).unwrap();
    let [third, fourth] = [2, 3].map(|at| list[at]["file"].as_str().unwrap().to_owned());
    std::fs::copy(folder.join("frames").join(&third), folder.join("frames").join(&fourth)).unwrap();
    for (task, out) in [("response", "second.csv"), ("merge", "second.exr")] {
        let refused = relume_in(&folder, &["sky", task, "frames", "-o", out]);
        assert_eq!(refused.code, Some(2), "{}", refused.stderr);
        let told = &refused.stderr;
        assert!(told.contains(&third) && told.contains(&fourth) && told.contains("same picture"), "{told}");
        assert!(!folder.join(out).exists());
    }
}

/// A probe that stands true beside a lens that darkens its edge, filters of its own, and a picture turned from north.
#[test]
fn the_probes_sun_is_right_for_any_lens_colours_and_north() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "probe_north");
    let sun = relume::sun::SunPosition { azimuth_deg: 152.0, altitude_deg: 48.0 };
    put(&folder.join("lens.json"), LENS.replace("]]}", r#"]],"vignetting":[-0.4,0,0]}"#));
    let colour = CameraColour {
        white_balance: [1.9, 1.0, 1.5],
        matrix: [[1.5, -0.4, -0.1], [-0.2, 1.3, -0.1], [0.1, -0.6, 1.5]],
    };
    colour.save(&folder.join("camera.json")).unwrap();
    let mut camera = settings(Sensor::Power, 6441);
    (camera.width, camera.height, camera.sun) = (320, 240, Some(sun));
    camera.lens = Some(Lens::load(&folder.join("lens.json")).unwrap());
    (camera.vignetting, camera.north_deg) = (0.4, 40.0);
    camera.camera_from_rec709 = colour.from_rec709().unwrap();
    camera.atmosphere.cloud_cover = 0.0;
    let series = take(camera, &four());
    series.save(&folder.join("frames")).unwrap();
    let (scale, lens) = (series.camera.radiance_scale(), series.camera.lens());
    let truth = series.camera.sky().sun().unwrap().irradiance.map(|e| f64::from(e) / scale);
    let mut horizontal = [0.0; 3];
    for (pixel, rgb) in series.camera.truth().iter().enumerate() {
        let at = [(pixel % 320) as f64 + 0.5, (pixel / 320) as f64 + 0.5];
        let (Some(dir), Some(omega)) = (lens.unproject(at), lens.solid_angle_sr(at)) else { continue };
        (0..3).for_each(|k| horizontal[k] += f64::from(rgb[k]) / scale * omega * dir[1].max(0.0));
    }
    put(&folder.join("probe.json"), format!(r#"{{"E_horizontal":{horizontal:?}}}"#));
    let rebuilt = |more: &[&str]| {
        let args = ["sky", "merge", "frames", "--response", "frames/curve_truth.csv", "--lens", "lens.json", "--probe"];
        let told = relume_in(&folder, &[&args[..], &["probe.json", "--sun", "152,48", "-o", "m.exr"], more].concat());
        let told = told.well().stderr;
        let words = told.split("irradiance ").nth(1).map(|rest| rest.split_whitespace().take(3));
        let sun: Vec<f64> = words.into_iter().flatten().map(|word| word.parse().unwrap()).collect();
        eprintln!("{more:?}: {sun:?}, true {truth:?}");
        (0..3).all(|k| sun.get(k).is_some_and(|found| (found / truth[k] - 1.0).abs() < 0.04))
    };
    assert!(rebuilt(&["--north", "40", "--colour", "camera.json"]));
    assert!(!rebuilt(&["--north", "40"]), "the camera's colours are not the probe's");
    assert!(!rebuilt(&["--colour", "camera.json"]), "the sun is not where north were at the top");
}
