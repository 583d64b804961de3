//! Checks that cannot run here say so, past the test harness's capture, so that `tests/run` can count them.

use std::io::Write;
use std::path::PathBuf;

/// Tells that `check` was left out and why; the line starts with `skipped: `.
pub fn skip(check: &str, why: &str) {
    // The harness captures the print macros only. Nobody is helped by a failure to complain.
    let _ = writeln!(std::io::stderr(), "skipped: {check}: {why}");
}

/// The folder of public scenes, skies and reference pictures: `RELUME_SHARED`, or `shared` beside the repository.
pub fn shared() -> Option<PathBuf> {
    let beside = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared"));
    let folder = std::env::var_os("RELUME_SHARED").map_or_else(beside, PathBuf::from);
    folder.join("scenes").is_dir().then_some(folder)
}

/// The maps that `tests/skies` has fetched, by name.
pub fn fetched_skies() -> Option<Vec<PathBuf>> {
    let folder = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../target/skies")).ok()?;
    let mut maps: Vec<PathBuf> = folder.flatten().map(|entry| entry.path()).collect();
    maps.retain(|map| map.extension().is_some_and(|ending| ending == "exr"));
    maps.sort();
    (!maps.is_empty()).then_some(maps)
}

/// True for root, whom permissions do not stop and who may mount.
pub fn is_root() -> bool {
    std::process::Command::new("id").arg("-u").output().is_ok_and(|out| out.stdout.trim_ascii() == b"0")
}
