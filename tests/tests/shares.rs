//! A bake in shares, and one that is killed and goes on: the very bytes of a bake in one go.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::program::{bake_in, relume_bake};
use relume_tests::scene::write_courtyard;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// What is baked: 4 x 3 tiles of the plan, the last row of them cut.
const BAKE: [&str; 12] = [
    "scene.glb",
    "--camera",
    "camera.json",
    "--size",
    "128x90",
    "--directions",
    "32",
    "--max-hits",
    "2",
    "--sun-paths",
    "8",
    "-o",
];

fn args<'a>(command: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&[command][..], &BAKE, &[out], more].concat()
}

fn courtyard(name: &str) -> PathBuf {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), name);
    write_courtyard(&folder);
    folder
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

#[test]
fn shares_join_to_the_field_of_one_bake() {
    let folder = courtyard("shares");
    bake_in(&folder, &args("scene", "whole.field", &[])).well();
    std::fs::create_dir(folder.join("plans")).unwrap();
    let told = bake_in(&folder, &args("plan", "plans/a.toml", &["--json"])).well();
    assert_eq!(told.stdout, "{\"tiles\":12}\n");
    let share = |tiles: &str, out: &str| {
        let args = ["scene", "--plan", "plans/a.toml", "--tiles", tiles, "-o", out];
        bake_in(&folder, &args)
    };
    // In any order, on any number of threads, and some twice.
    for (tiles, out) in [("7..12", "c"), ("0..1", "a"), ("1..8", "b")] {
        share(tiles, out).well();
    }
    let merge =
        |plan: &str, shares: &[&str], out: &str| bake_in(&folder, &[&["merge", plan], shares, &["-o", out]].concat());
    merge("plans/a.toml", &["c", "a", "b"], "joined.field").well();
    assert!(bytes(&folder.join("joined.field")) == bytes(&folder.join("whole.field")), "the bytes differ");

    share("0..13", "d").refused(2, &["--tiles", "13", "12 tiles"]);
    // What would do nothing is not passed over in silence.
    for (option, value) in [("--preview", "x.png"), ("--report", "x"), ("--stack", "x"), ("--sun", "130,40")] {
        bake_in(&folder, &args("plan", "x.toml", &[option, value])).refused(2, &["plan", option, "does nothing here"]);
    }
    bake_in(&folder, &args("plan", "x.toml", &["--resume"])).refused(2, &["--resume does nothing here"]);
    let more = ["scene", "--plan", "plans/a.toml", "--tiles", "0..1", "-o", "d", "--seed", "3"];
    bake_in(&folder, &more).refused(2, &["scene --plan: --seed does nothing here", "the plan's"]);
    bake_in(&folder, &["merge", "plans/a.toml", "a", "-o", "x", "--error", "1%"]).refused(2, &["merge: --error"]);
    merge("plans/a.toml", &["c", "a"], "x").refused(2, &["tiles 1..7", "none of the shares"]);
    merge("plans/a.toml", &["c", "a", "whole.field"], "x").refused(2, &["whole.field", "no blocks"]);
    put(&folder.join("cut"), &bytes(&folder.join("b"))[..bytes(&folder.join("b")).len() - 9]);
    merge("plans/a.toml", &["c", "a", "cut"], "x").refused(2, &["cut", "6 of 7 tiles", "--resume"]);
    bake_in(&folder, &args("plan", "other.toml", &["--seed", "2"])).well();
    merge("other.toml", &["c", "a", "b"], "x").refused(2, &["another bake"]);
    let camera = std::fs::read_to_string(folder.join("camera.json")).unwrap();
    put(&folder.join("camera.json"), camera.replace("\"fov_y_deg\"", "\"north_deg\": 3, \"fov_y_deg\""));
    share("0..1", "d").refused(2, &["a.toml", "changed", "plan again"]);
    assert!(!names(&folder).iter().any(|name| name == "x" || name.starts_with('d') || name.ends_with(".part")));
}

#[test]
fn a_plan_keeps_the_sampling_that_a_noise_asked_for() {
    let folder = courtyard("noise");
    bake_in(&folder, &args("plan", "usual.toml", &[])).well();
    let told = bake_in(&folder, &args("plan", "coarse.toml", &["--noise", "60%"])).well();
    assert!(told.stderr.contains("sampling: 4 rays to a patch, 1 paths"), "{}", told.stderr);
    bake_in(&folder, &args("scene", "coarse.field", &["--noise", "60%", "--preview", "look.png", "--report", "page"]))
        .well();
    bake_in(&folder, &["scene", "--plan", "coarse.toml", "--tiles", "0..12", "-o", "share"]).well();
    bake_in(&folder, &["merge", "coarse.toml", "share", "-o", "joined.field"]).well();
    assert!(bytes(&folder.join("joined.field")) == bytes(&folder.join("coarse.field")), "the bytes differ");
    let paths = |plan: &str| std::fs::read_to_string(folder.join(plan)).unwrap().contains("paths = 1\n");
    assert!(paths("coarse.toml") && !paths("usual.toml"));
    let info = bake_in(&folder, &["info", "coarse.field"]).well().stdout;
    let noise: Vec<&str> = info.lines().filter(|line| line.starts_with("noise")).collect();
    assert_eq!(noise.len(), 9, "{info}");
    let look = std::fs::read(folder.join("look.png")).unwrap();
    assert!(look.starts_with(b"\x89PNG"));
    let page = std::fs::read_to_string(folder.join("page/index.html")).unwrap();
    assert!(page.contains("ranks") || page.contains("Ranks"), "{page}");
    for map in ["rank.png", "bytes.png", "error.png", "noise.png"] {
        assert!(page.contains(map) && std::fs::read(folder.join("page").join(map)).unwrap().starts_with(b"\x89PNG"));
    }

    let scene = |more: &[&str]| bake_in(&folder, &args("scene", "x.field", more));
    scene(&["--noise", "0%"]).refused(2, &["--noise 0%", "percentage"]);
    scene(&["--time", "10"]).refused(2, &["--time 10", "unit"]);
    scene(&["--time", "10m", "--resume"]).refused(2, &["--resume", "--time"]);
}

#[test]
fn a_killed_bake_goes_on_and_gives_the_same_bytes() {
    let folder = courtyard("killed");
    bake_in(&folder, &args("scene", "whole.field", &[])).well();
    let part = folder.join("a.field.part");
    let mut bake = relume_bake()
        .args(args("scene", "a.field", &["--threads", "1"]))
        .current_dir(&folder)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // Some blocks are there, and not all.
    let begun = Instant::now();
    while std::fs::metadata(&part).map_or(0, |meta| meta.len()) < 1000 {
        assert!(begun.elapsed() < Duration::from_secs(300), "no block was done");
        assert!(bake.try_wait().unwrap().is_none(), "it was over before it could be killed");
        std::thread::sleep(Duration::from_millis(2));
    }
    bake.kill().unwrap();
    bake.wait().unwrap();
    let left = bytes(&part).len();
    assert!(left > 100 && !folder.join("a.field").exists());

    bake_in(&folder, &args("scene", "a.field", &[])).refused(2, &["a.field.part", "--resume"]);
    bake_in(&folder, &args("scene", "a.field", &["--resume", "--seed", "2"])).refused(2, &["another bake"]);
    assert_eq!(bytes(&part).len(), left, "what was done is kept");
    bake_in(&folder, &args("scene", "a.field", &["--resume"])).well();
    assert!(bytes(&folder.join("a.field")) == bytes(&folder.join("whole.field")), "the bytes differ");
    assert!(!part.exists());
}
