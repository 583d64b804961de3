//! Folders for a test's files.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A new, empty folder of this name below `base` (`env!("CARGO_TARGET_TMPDIR")` of an integration test).
///
/// # Panics
/// If it cannot be made.
pub fn fresh_folder(base: &str, name: &str) -> PathBuf {
    let folder = Path::new(base).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    folder
}

/// Names of what a folder holds, hidden files included, sorted.
///
/// # Panics
/// If it cannot be read.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Writes a file, whole: tests that share a folder never read half of one.
///
/// # Panics
/// If it cannot be written.
pub fn put(path: &Path, bytes: impl AsRef<[u8]>) {
    static WRITTEN: AtomicU64 = AtomicU64::new(0);
    let number = WRITTEN.fetch_add(1, Ordering::Relaxed);
    let beside = path.with_added_extension(format!("{}-{number}", std::process::id()));
    let written = std::fs::write(&beside, bytes).and_then(|()| std::fs::rename(&beside, path));
    written.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}
