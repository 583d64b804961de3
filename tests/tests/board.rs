//! A post on the virtual board: what its screen shows, pixel for pixel, and that nothing ends it. The scenario is
//! `tests/board/post_check.py`; here its field is baked, and its pictures are made again from the light that it logged.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use relume_tests::skip::skip;
use std::path::Path;
use std::process::Command;

/// The pixels of a screendump (PPM) of this size, such as `640x480`.
fn read_ppm(path: &Path, size: &str) -> Vec<u8> {
    let bytes = std::fs::read(path).unwrap();
    let header = format!("P6\n{}\n255\n", size.replace('x', " "));
    assert!(bytes.starts_with(header.as_bytes()), "{}: {:?}", path.display(), &bytes[..16]);
    bytes[header.len()..].to_vec()
}

/// The same pictures headless, on this machine's processor, from the logged light; those of the last two lights.
fn shown_again(folder: &Path, name: &str) -> [Vec<u8>; 2] {
    // Title and caption as on the board.
    let post = std::fs::read_to_string(folder.join("out/POST.toml")).unwrap();
    let words = post.lines().filter(|line| line.starts_with("title") || line.starts_with("caption"));
    let words: Vec<&str> = words.collect();
    let text = format!(
        "{}\nfield = 'a.field'\nsky = 'logged'\n[camera]\nlight_log = 'out/{name}.jsonl'\n\
         [display]\nkind = 'headless'\nfolder = '{name}'\n",
        words.join("\n")
    );
    put(&folder.join(format!("{name}.toml")), text + "[run]\nstart = 2027-06-21T08:00:00Z\n");
    relume_in(folder, &["run", &format!("{name}.toml")]).well();
    let pictures: Vec<String> = names(&folder.join(name)).into_iter().filter(|file| file.ends_with(".png")).collect();
    assert!(pictures.len() > 2, "{name}: {} lights were logged", pictures.len());
    let read = |back: usize| {
        let file = folder.join(name).join(&pictures[pictures.len() - back]);
        image::open(file).unwrap().into_rgb8().into_raw()
    };
    [read(1), read(2)]
}

/// Runs the scenario with a picture of this size and compares what the screen showed in the pictures taken.
fn on_the_board(size: &str, more: &[&str], taken: &[&str]) {
    let Some(programs) = std::env::var_os("RELUME_BOARD_PROGRAMS") else {
        return skip(
            "the virtual board",
            "set RELUME_BOARD_PROGRAMS to a folder with relume, usbcam and usbcam-probe for arm64",
        );
    };
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), &format!("board-{size}"));
    write_courtyard(&folder);
    let args = ["scene", "scene.glb", "--camera", "camera.json", "--size", size, "--directions", "64"];
    bake_in(&folder, &[&args[..], &["--max-hits", "2", "-o", "a.field"]].concat()).well();
    let check = concat!(env!("CARGO_MANIFEST_DIR"), "/board/post_check.py");
    let status = Command::new("python3").arg(check).arg(&folder).arg(programs).arg(size).args(more).status().unwrap();
    assert!(status.success(), "see the findings above");
    for name in taken {
        let screen = read_ppm(&folder.join(format!("out/{name}.ppm")), size);
        let differing = shown_again(&folder, name).map(|picture| {
            let pixels = screen.chunks_exact(3).zip(picture.chunks_exact(3));
            pixels.filter(|(shown, made)| shown != made).count()
        });
        eprintln!("{size} {name}: {differing:?} pixels differ from the pictures of the last light and the one before");
        assert!(differing.contains(&0), "{size} {name}: {differing:?} pixels differ");
    }
}

#[test]
#[ignore = "boots a virtual board; tests/run runs it"]
fn a_post_on_the_board_shows_what_the_bench_shows_and_outlives_every_fault() {
    // On the first socket by dumb buffers, on the second one, and by GBM.
    on_the_board("640x480", &[], &["morning", "evening", "moved", "gbm"]);
}

#[test]
#[ignore = "bakes large pictures for a virtual board"]
fn larger_pictures_on_the_board_are_those_of_the_bench() {
    let pictures = |size: &&str| on_the_board(size, &["--pictures"], &["morning", "evening"]);
    ["1280x720", "1920x1080"].iter().for_each(pictures);
}
