//! A post on the virtual board: what its screen shows, pixel for pixel, and that nothing ends it. The scenarios are
//! `tests/board/post_check.py` and `view_check.py`; here their field is baked, and their pictures are made again from the light
//! that the post logged.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use relume_tests::skip::skip;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};

/// The pixels of a screendump (PPM) of this size, such as `640x480`.
fn read_ppm(path: &Path, size: &str) -> Vec<u8> {
    let bytes = std::fs::read(path).unwrap();
    let header = format!("P6\n{}\n255\n", size.replace('x', " "));
    assert!(bytes.starts_with(header.as_bytes()), "{}: {:?}", path.display(), &bytes[..16]);
    bytes[header.len()..].to_vec()
}

/// The same pictures headless, on this machine's processor, from the logged light, over a still if there was a view; those of the
/// last two lights.
fn shown_again(folder: &Path, name: &str) -> [Vec<u8>; 2] {
    // Title and caption as on the board.
    let post = std::fs::read_to_string(folder.join("out/POST.toml")).unwrap();
    let words = post.lines().filter(|line| line.starts_with("title") || line.starts_with("caption"));
    let mut keys: Vec<String> = words.map(String::from).collect();
    let view = format!("out/{name}.view.png");
    if folder.join(&view).exists() {
        keys.push(format!("view = '{view}'"));
    }
    let text = format!(
        "{}\nfield = 'a.field'\nsky = 'logged'\n[camera]\nlight_log = 'out/{name}.jsonl'\n\
         [display]\nkind = 'headless'\nfolder = '{name}'\n",
        keys.join("\n")
    );
    put(&folder.join(format!("{name}.toml")), text + "[run]\nstart = 2027-06-21T08:00:00Z\n");
    relume_in(folder, &["run", &format!("{name}.toml")]).well();
    let pictures: Vec<String> = names(&folder.join(name)).into_iter().filter(|file| file.ends_with(".png")).collect();
    assert!(pictures.len() >= 2, "{name}: {} lights were logged", pictures.len());
    let read = |back: usize| {
        let file = folder.join(name).join(&pictures[pictures.len() - back]);
        image::open(file).unwrap().into_rgb8().into_raw()
    };
    [read(1), read(2)]
}

/// A field of this size, baked once for all scenarios of a run.
fn field(size: &str) -> PathBuf {
    static BAKED: Mutex<Vec<String>> = Mutex::new(Vec::new());
    let mut baked = BAKED.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("board-field-{size}"));
    if !baked.iter().any(|done| done == size) {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), &format!("board-field-{size}"));
        write_courtyard(&folder);
        let args = ["scene", "scene.glb", "--camera", "camera.json", "--size", size, "--directions", "64"];
        bake_in(&folder, &[&args[..], &["--max-hits", "2", "--sun-paths", "16", "-o", "a.field"]].concat()).well();
        baked.push(size.to_owned());
    }
    folder.join("a.field")
}

/// Takes a field of this size and runs a scenario of `tests/board` with it; the folder with what came of it, unless there is no
/// board. One board at a time: they share this machine.
fn run_scenario(scenario: &str, size: &str, more: &[&str]) -> Option<PathBuf> {
    static ONE_BOARD: Mutex<()> = Mutex::new(());
    let Some(programs) = std::env::var_os("RELUME_BOARD_PROGRAMS") else {
        skip(
            "the virtual board",
            "set RELUME_BOARD_PROGRAMS to a folder with relume, usbcam and usbcam-probe for arm64",
        );
        return None;
    };
    let _one = ONE_BOARD.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), &format!("{scenario}-{size}"));
    std::fs::copy(field(size), folder.join("a.field")).unwrap();
    let check = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("board/{scenario}.py"));
    let status = Command::new("python3").arg(check).arg(&folder).arg(programs).arg(size).args(more).status().unwrap();
    assert!(status.success(), "see the findings above");
    Some(folder)
}

/// Places of the pixels in which a picture of the screen differs from another.
fn differing(screen: &[u8], picture: &[u8]) -> Vec<usize> {
    let pixels = screen.chunks_exact(3).zip(picture.chunks_exact(3)).enumerate();
    pixels.filter(|(_, (shown, made))| shown != made).map(|(at, _)| at).collect()
}

/// Runs the scenario of the post with a picture of this size and compares what the screen showed in the pictures taken.
fn on_the_board(size: &str, more: &[&str], taken: &[&str]) {
    let Some(folder) = run_scenario("post_check", size, more) else { return };
    for name in taken {
        let screen = read_ppm(&folder.join(format!("out/{name}.ppm")), size);
        let differing = shown_again(&folder, name).map(|picture| differing(&screen, &picture).len());
        eprintln!("{size} {name}: {differing:?} pixels differ from the pictures of the last light and the one before");
        assert!(differing.contains(&0), "{size} {name}: {differing:?} pixels differ");
    }
    let own = image::open(folder.join("out/screenshot.png")).unwrap().into_rgb8().into_raw();
    let off = differing(&read_ppm(&folder.join("out/shot_1.ppm"), size), &own).len();
    assert_eq!(off, 0, "{size}: pixels in which the post's own screenshot is not what the screen showed");
}

/// The same with a live view: two frames that stood still, and one over the last picture of a view that was lost, while the post
/// went on.
fn live_view_on_the_board(size: &str) {
    let Some(folder) = run_scenario("view_check", size, &[]) else { return };
    let screen = |name: &str| read_ppm(&folder.join(format!("out/{name}.ppm")), size);
    let sides: Vec<usize> = size.split('x').map(|side| side.parse().unwrap()).collect();
    // The badge tells of the loss, in the lower left.
    let is_badge = |at: usize| at / sides[0] > sides[1] * 2 / 3 && at % sides[0] < sides[0] * 2 / 3;
    for (name, lights, with_badge) in [("view_a", 1, false), ("view_b", 1, false), ("held", 2, true)] {
        let counts = shown_again(&folder, name).map(|picture| {
            let places = differing(&screen(name), &picture);
            places.into_iter().filter(|&at| !(with_badge && is_badge(at))).count()
        });
        eprintln!("{size} {name}: {counts:?} pixels differ from the pictures of the last light and the one before");
        assert!(counts[..lights].contains(&0), "{size} {name}: {counts:?} pixels differ");
    }
    assert_ne!(screen("view_a"), screen("view_b"), "the view moves");
}

#[test]
#[ignore = "boots a virtual board; tests/run runs it"]
fn a_post_on_the_board_shows_what_the_bench_shows_and_outlives_every_fault() {
    // On the first socket by dumb buffers, on the second one, by GBM, and with modes set the legacy way.
    on_the_board("640x480", &[], &["morning", "evening", "moved", "gbm", "legacy"]);
}

#[test]
#[ignore = "boots a virtual board once more"]
fn a_post_on_the_board_shows_a_live_view_as_the_bench_shows_a_still() {
    live_view_on_the_board("640x480");
}

#[test]
#[ignore = "bakes large pictures for a virtual board"]
fn larger_pictures_on_the_board_are_those_of_the_bench() {
    let pictures = |size: &&str| on_the_board(size, &["--pictures"], &["morning", "evening"]);
    ["1280x720", "1920x1080"].iter().for_each(pictures);
}
