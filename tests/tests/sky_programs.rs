//! The sky camera's programs one after the other: exposure series -> merged picture -> weights.

#![allow(clippy::unwrap_used)]

use relume::lens::Lens;
use relume::weights::PatchWeights;
use relume_tests::files::{fresh_folder, put};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_site;
use relume_tests::skycamera::{Sensor, exposures, settings, take};

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
