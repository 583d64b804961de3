//! `relume bench` as a whole: every method over a small field, in cache and beyond, and what its figures have in common.
//! No time is judged.

#![allow(clippy::unwrap_used)]

use relume_tests::files::fresh_folder;
use relume_tests::picture::write_exr;
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

fn baked() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "bench");
        write_courtyard(&folder);
        let args = ["scene", "scene.glb", "--camera", "camera.json", "--size", "64x48", "--directions", "64"];
        bake_in(&folder, &[&args[..], &["--stack", "stack", "--sun", "130,42", "-o", "a.field"]].concat()).well();
        // Lighter towards +X: turned, it is another sky.
        write_exr(&folder.join("sky.exr"), (64, 32), |x, _| [0.5 + (x as f32 / 64.0 * 3.0).sin(), 0.6, 0.7]);
        folder
    })
}

fn measured(args: &[&str]) -> Value {
    let out = relume_in(baked(), &[&["bench", "a.field", "--json"], args].concat()).well();
    serde_json::from_str(&out.stdout).unwrap()
}

/// The entries of a list whose `name` is this.
fn named<'a>(list: &'a Value, name: &str) -> Vec<&'a Value> {
    list.as_array().unwrap().iter().filter(|entry| entry["name"] == name).collect()
}

const OPENBLAS: [(&str, usize); 3] =
    [("dense_f32_openblas", 1), ("global_pca_openblas", 3), ("median_cut_lights_openblas", 4)];

#[test]
fn a_study_holds_every_method_in_and_beyond_the_cache() {
    let args = ["--stack", "stack", "--sky", "sky.exr", "--sky", "sky.exr@90", "--cache", "1", "--plot", "plot.png"];
    let report = measured(&args);
    let methods = &report["methods"];
    assert_eq!((report["skies"].as_array().unwrap().len(), report["skies_with_sun"].as_u64()), (11, Some(6)));
    assert_eq!(report["skies"][1], "sky@90");
    assert!(image::open(baked().join("plot.png")).unwrap().width() > 500);

    let with_openblas = !named(methods, "dense_f32_openblas").is_empty();
    if !with_openblas {
        eprintln!("skipped: the rivals by OpenBLAS: it is not here");
    }
    for (name, count) in OPENBLAS.into_iter().filter(|_| with_openblas).chain([("dense_int8", 1), ("relume", 7)]) {
        assert_eq!(named(methods, name).len(), count, "{name}");
        assert_eq!(named(&report["in_cache"]["timings"], name).len(), 2 * count, "{name}");
        let beyond = if name == "relume" { 1 } else { count };
        assert_eq!(named(&report["beyond_cache"]["timings"], name).len(), 2 * beyond, "{name}");
    }
    let rmse = |entry: &Value| entry["rmse_worst_without_sun"].as_f64().unwrap();
    assert!(rmse(named(methods, "dense_int8")[0]) < 0.01);
    let relume = named(methods, "relume");
    assert!(relume[3]["budget"] == "all ranks" && rmse(relume[3]) < 0.01, "{}", relume[3]);
    for under_budget in &relume {
        let of = |key: &str| under_budget[key].as_f64().unwrap();
        assert!(of("code_error_worst_without_sun") <= of("bound_codes_worst_without_sun"), "{under_budget}");
    }
    further_sections_hold(&report);
    if with_openblas {
        let dense = named(methods, "dense_f32_openblas")[0];
        assert!(rmse(dense) < 1e-5 && dense["rmse_worst"].as_f64().unwrap() < 1e-5, "{dense}");
        // 64 + 4 patches' f32 for each channel, and the sun's in half of the frames.
        let bytes = named(&report["beyond_cache"]["timings"], "dense_f32_openblas")[0]["bytes_read_per_covered_pixel"]
            .as_f64()
            .unwrap();
        assert!((816.0..=828.0).contains(&bytes), "{bytes}");
        // More components and more lights are never much worse; the best of each is far from the worst.
        for name in ["global_pca_openblas", "median_cut_lights_openblas"] {
            let errors: Vec<f64> = named(methods, name).into_iter().map(rmse).collect();
            assert!(errors.last() < errors.first() && errors.iter().all(|e| *e < 1.0), "{name}: {errors:?}");
        }
    }
    let held = |section: &str, key: &str| report[section][key].as_u64().unwrap();
    assert_eq!(held("in_cache", "field_copies"), 1);
    assert!(held("beyond_cache", "field_bytes") >= 4 << 20 && held("beyond_cache", "rivals_bytes") >= 4 << 20);
    // What fills the cache is what a frame reads, not what lies in the file besides.
    let copy = held("beyond_cache", "field_bytes") as f64 / held("beyond_cache", "field_copies") as f64;
    let read = report["bytes_per_covered_pixel"].as_f64().unwrap() * report["covered_px"].as_f64().unwrap();
    assert!(copy < 2.0 * read, "{copy} bytes a copy, {read} read");
}

/// What must be so whatever the machine: bounds hold, and nothing is drawn that did not change.
fn further_sections_hold(report: &Value) {
    let bounds = &report["bounds"];
    assert_eq!(bounds["share_of_tiles_below_error"], 0.0);
    assert!(bounds["looseness_worst"].as_f64().unwrap() >= 1.0, "{bounds}");
    let lights = &report["lights"];
    let seen = lights["single_patches"]["patches"].as_u64().unwrap() + lights["patches_unseen"].as_u64().unwrap();
    assert_eq!(seen, 68);
    for light in [&lights["torch"], &lights["sun_left_in_sky"], &lights["single_patches"]["worst_error"]] {
        assert!(light["error_codes"].as_f64().unwrap() <= light["bound_codes"].as_f64().unwrap(), "{light}");
    }
    let skipping = report["skipping"].as_array().unwrap();
    assert_eq!(skipping.len(), 2);
    for sky in skipping {
        assert_eq!(sky["still_sky"]["counters"]["tiles_kept"].as_f64(), sky["tiles"].as_f64(), "{sky}");
        let live = &sky["live_view"]["counters"];
        assert_eq!(live["tiles_drawn"].as_f64(), Some(0.0), "{sky}");
        assert!(live["tiles_composited"].as_f64().unwrap() > 0.0, "{sky}");
        for budget in sky["in_time"].as_array().unwrap() {
            // The bound is against the uncompressed response, the error against the field's own picture.
            let of = |key: &str| budget[key].as_f64().unwrap();
            assert!(of("allowed_ms") > 0.0 && of("error_codes_worst") >= 0.0 && of("frames_until_finished") < 300.0);
        }
        let ramp = &sky["clear_to_overcast"];
        assert_eq!(ramp["frames"], 300);
        // Tiles change a little between frames, so that an oracle need not draw all of them each time.
        let of = |key: &str| ramp[key].as_u64().unwrap();
        assert!(of("tiles_drawn_by_oracle") > 0 && of("tiles_drawn_by_oracle") < 300 * sky["tiles"].as_u64().unwrap());
        assert!(of("tiles_drawn") > 0, "{ramp}");
    }
}

#[test]
fn without_a_stack_errors_are_null_and_times_are_there() {
    let report = measured(&["--in-cache-only", "--error-codes", "3", "--time-ms", "0.05", "--time-ms", "2"]);
    let budgets: Vec<&Value> = named(&report["methods"], "relume").into_iter().map(|m| &m["budget"]).collect();
    assert_eq!(budgets, ["2 ranks", "4 ranks", "8 ranks", "all ranks", "error 3 codes"]);
    let times: Vec<f64> = report["skipping"][0]["in_time"]
        .as_array()
        .unwrap()
        .iter()
        .map(|t| t["allowed_ms"].as_f64().unwrap())
        .collect();
    assert!(times.len() == 2 && (times[0] - 0.05).abs() < 1e-9 && (times[1] - 2.0).abs() < 1e-9, "{times:?}");
    assert!(report["beyond_cache"].is_null() && report["bounds"].is_null() && report["lights"].is_null());
    assert!(!report["skipping"].as_array().unwrap().is_empty());
    for method in report["methods"].as_array().unwrap() {
        assert!(method["rmse_median"].is_null() && method["worst_code"].is_null(), "{method}");
        assert!(method["cpu_ms_per_frame"].as_f64().unwrap() > 0.0, "{method}");
        assert!(method["errors_per_sky"].as_array().unwrap().is_empty(), "{method}");
    }
    for timing in named(&report["in_cache"]["timings"], "relume") {
        assert!(timing["cpu_ms_per_frame_coefficients_reused"].as_f64().unwrap() > 0.0, "{timing}");
    }
}

#[test]
fn bad_arguments_are_named() {
    relume_in(baked(), &["bench", "a.field", "--cache", "0"]).refused(2, &["--cache 0"]);
    relume_in(baked(), &["bench", "a.field", "--error-codes", "0.5"]).refused(2, &["--error-codes 0.5"]);
    relume_in(baked(), &["bench", "a.field", "--sky", "none.hdr@10"]).refused(2, &["none.hdr"]);
    relume_in(baked(), &["bench", "a.field", "--plot", "no/such/folder.png"]).refused(2, &["folder.png"]);
}
