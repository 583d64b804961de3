//! A whole post with all its threads, by a program that notes who asks for memory: no frame of ours does.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, put};
use relume_tests::program::{bake_in, counted};
use relume_tests::scene::write_courtyard;
use std::time::{Duration, Instant};

/// Seconds in which room is made, and those that are watched.
const WARM_UP_S: &str = "2";
const SPAN_S: &str = "3";

/// A sky camera (a synthetic one), brackets, a sun that goes on, and pictures.
#[test]
fn frames_of_a_post_with_all_its_threads_ask_for_no_memory_of_their_own() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "counted");
    write_courtyard(&folder);
    let args = ["scene", "scene.glb", "--camera", "camera.json", "--size", "64x48", "--directions", "64"];
    bake_in(&folder, &[&args[..], &["-o", "a.field"]].concat()).well();
    let post = "title = 'The yard'\nfield = 'a.field'\nsky = 'synthetic'\n[site]\nlatitude = 41.9\nlongitude = 12.5\n\
                [weather]\ncloud_cover = 0.2\n[display]\nkind = 'headless'\nfolder = 'shown'\n\
                [run]\nstart = 2026-06-21T09:00:00Z\nstep_s = 6\nspeed = 60.0\n";
    put(&folder.join("post.toml"), post);
    let report = folder.join("report.json");
    let mut child = counted()
        .args(["run", "post.toml"])
        .current_dir(&folder)
        .envs([("RELUME_COUNTED_WARM_UP_S", WARM_UP_S), ("RELUME_COUNTED_S", SPAN_S)])
        .envs([("RELUME_COUNTED_HEALTH", "shown/health.json"), ("RELUME_COUNTED_REPORT", "report.json")])
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while !report.exists() && begun.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(50));
    }
    std::process::Command::new("kill").arg("-TERM").arg(child.id().to_string()).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let told: serde_json::Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    eprintln!("{} frames: {:#}", told["frames"], told["origins"]);
    assert!(told["frames"].as_u64().unwrap() > 5 && told["lost"] == 0, "{}", told["frames"]);
    let has = |origin: &str| told["origins"].as_array().unwrap().iter().any(|row| row["origin"] == origin);
    assert!(has("relume's words") && has("picture encoder"), "the counter counts: {}", told["origins"]);
    let stacks = told["stacks"].as_array().unwrap().iter();
    let ours: Vec<_> = stacks.filter(|stack| stack["origin"] == "relume").collect();
    assert!(ours.is_empty(), "{} stacks of ours, such as {:#}", ours.len(), ours[0]);
}
