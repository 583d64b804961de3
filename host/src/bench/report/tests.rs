use super::*;

pub(in crate::bench) fn report() -> BenchReport {
    let method = |name: &str, ms, rmse| MethodReport {
        name: name.to_owned(),
        budget: None,
        cpu_ms_per_frame: ms,
        rmse_median: Some(rmse),
        rmse_worst: Some(rmse),
        rmse_worst_without_sun: None,
        rmse_worst_with_sun: Some(2.0 * rmse),
        worst_code: Some(7),
        share_off_by_more_than_one: None,
        code_error_worst_without_sun: Some(1.25),
        bound_codes_worst_without_sun: Some(2.75),
        times_faster_than_dense_f32_openblas: None,
        errors_per_sky: vec![SkyErrors {
            sky: "a".into(),
            has_sun: true,
            rmse,
            worst_code: 7,
            share_off_by_more_than_one: 0.5,
            code_error: 1.25,
            bound_codes: Some(2.75),
        }],
    };
    let timing = |name: &str, threads, ms, reused| Timing {
        name: name.to_owned(),
        budget: None,
        threads,
        cpu_ms_per_frame: ms,
        cpu_ms_per_frame_with_sun: None,
        cpu_ms_per_frame_without_sun: Some(ms),
        cpu_ms_per_frame_coefficients_reused: reused,
        wall_ms_per_frame: ms,
        bytes_read_per_covered_pixel: 30.0,
        share_of_read_bandwidth: 0.5,
        times_faster_than_dense_f32_openblas: None,
        times_faster_than_dense_f32_openblas_coefficients_reused: None,
    };
    let in_cache = Section {
        field_copies: 1,
        field_bytes: 1 << 20,
        rivals_bytes: 0,
        last_level_cache_bytes: 32 << 20,
        sun_included: false,
        timings: vec![
            timing(DENSE_NAME, 1, 42.0, None),
            timing(DENSE_NAME, 2, 50.0, None),
            timing(RELUME_NAME, 2, 1.0, None),
            timing(RELUME_NAME, 1, 0.5, Some(0.25)),
        ],
    };
    BenchReport {
        skies: vec!["a".into(), "b".into()],
        skies_with_sun: 1,
        width_px: 64,
        height_px: 32,
        covered_px: 1000,
        bytes_per_covered_pixel: 24.0,
        bytes_stored_per_covered_pixel: 31.5,
        share_of_read_bandwidth: 0.75,
        read_bandwidth_one_thread_bytes_per_cpu_s: 1e10,
        read_bandwidth_two_threads_bytes_per_cpu_s: 2e10,
        read_bandwidth_buffer_bytes: 1 << 30,
        sun_trace_cpu_ms: None,
        methods: vec![method(DENSE_NAME, 42.0, 1e-7), method(RELUME_NAME, 0.5, 0.0025)],
        in_cache,
        beyond_cache: None,
        bounds: Some(bounds()),
        lights: None,
        skipping: Vec::new(),
    }
}

fn bounds() -> BoundsReport {
    let sky = super::super::bounds::SkyBounds {
        sky: "a".into(),
        tiles: 9,
        tiles_dark: 1,
        bound_linear: 0.02,
        error_linear: 0.01,
        looseness: Some(2.0),
        looseness_dark: None,
        bound_codes: 2.75,
        error_codes: 1.25,
        share_of_tiles_below_error: 0.0,
    };
    BoundsReport {
        looseness_worst: Some(2.0),
        looseness_dark_worst: None,
        share_of_tiles_below_error: 0.0,
        with_bounds_cpu_ms: 1.0,
        without_bounds_cpu_ms: 0.9,
        share_of_frame_time: 0.1,
        per_sky: vec![sky],
    }
}

#[test]
fn a_bound_below_the_error_is_told() {
    let mut report = report();
    assert_eq!(report.broken_bound(), None);
    report.bounds.as_mut().unwrap().per_sky[0].share_of_tiles_below_error = 0.125;
    let line = report.broken_bound().unwrap();
    assert!(line.contains("sky a") && line.contains("12.50 %"), "{line}");
}

fn keys(value: &serde_json::Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

/// What users' programs read since the first release of the command.
#[test]
fn json_keeps_the_first_keys() {
    let json = serde_json::to_value(report()).unwrap();
    let top =
        ["skies", "bytes_per_covered_pixel", "bytes_stored_per_covered_pixel", "share_of_read_bandwidth", "methods"];
    assert!(top.iter().all(|key| keys(&json).contains(key)), "{json}");
    let method = [
        "name",
        "budget",
        "cpu_ms_per_frame",
        "rmse_median",
        "rmse_worst",
        "worst_code",
        "share_off_by_more_than_one",
        "times_faster_than_dense_f32_openblas",
    ];
    assert!(method.iter().all(|key| keys(&json["methods"][0]).contains(key)), "{json}");
    assert!(json["methods"][1]["share_off_by_more_than_one"].is_null());
    assert_eq!(json["methods"][1]["rmse_median"], 0.0025);
    assert!(json["beyond_cache"].is_null());
}

/// A number says its unit: in its own key, or it is one of the plain counts and fractions.
#[test]
fn every_number_names_its_unit() {
    fn walk(key: &str, value: &serde_json::Value) {
        const UNITS: [&str; 8] =
            ["_codes", "_linear", "_ms", "_px", "bytes", "_bytes_per_cpu_s", "per_covered_pixel", "_ms_per_frame"];
        const PLAIN: [&str; 15] = [
            "tiles",
            "looseness",
            "code_error",
            "bound_codes_",
            "cpu_ms",
            "rmse_",
            "rmse",
            "share_",
            "worst_code",
            "times_faster_",
            "threads",
            "skies_with_sun",
            "field_copies",
            "cpu_ms_per_frame",
            "wall_ms_per_frame",
        ];
        match value {
            serde_json::Value::Object(map) => map.iter().for_each(|(key, value)| walk(key, value)),
            serde_json::Value::Array(list) => list.iter().for_each(|value| walk(key, value)),
            serde_json::Value::Number(_) => {
                let named =
                    UNITS.iter().any(|unit| key.ends_with(unit)) || PLAIN.iter().any(|name| key.starts_with(name));
                assert!(named, "{key} has no unit");
            }
            _ => {}
        }
    }
    walk("", &serde_json::to_value(report()).unwrap());
}

#[test]
fn times_faster_is_against_the_dense_sum_on_as_many_threads() {
    let mut section = report().in_cache;
    section.compare_with_dense();
    let times: Vec<_> = section.timings.iter().map(|m| m.times_faster_than_dense_f32_openblas).collect();
    assert_eq!(times, [Some(1.0), Some(1.0), Some(50.0), Some(84.0)]);
    let reused = section.timing(RELUME_NAME, None, 1).unwrap();
    assert_eq!(reused.times_faster_than_dense_f32_openblas_coefficients_reused, Some(168.0));
    let mut alone = report().in_cache;
    alone.timings.retain(|timing| timing.name == RELUME_NAME);
    alone.compare_with_dense();
    assert_eq!(alone.timings[0].times_faster_than_dense_f32_openblas, None);
}

#[test]
fn the_table_shows_what_was_measured() {
    let text = report().to_string();
    assert!(text.contains("0.250 %") && text.contains("42.000") && text.contains("75 %"), "{text}");
    assert!(text.contains("in cache") && !text.contains("beyond"), "{text}");
}
