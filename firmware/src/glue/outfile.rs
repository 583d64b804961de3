//! Files that appear whole or not at all: written beside their place, then renamed into it.

use super::failure::Failure;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutError {
    /// The folder it should go to does not exist, is no folder, or may not be written to.
    #[error("{}: cannot write there: {reason}", path.display())]
    Place {
        /// The file asked for.
        path: PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// Writing failed on the way; nothing was left behind.
    #[error("{}: writing failed: {reason}", path.display())]
    Write {
        /// The file asked for.
        path: PathBuf,
        /// What happened and what to do.
        reason: String,
    },
}

impl From<OutError> for Failure {
    fn from(error: OutError) -> Self {
        match error {
            OutError::Place { .. } => Failure::BadInput(error.into()),
            OutError::Write { .. } => Failure::Runtime(error.into()),
        }
    }
}

/// Checks that `path` can be written, before any work is done: its folder exists and takes a new file. What killed programs
/// left of it is cleared away.
///
/// # Errors
/// [`OutError::Place`], or [`OutError::Write`] where the disk is already full.
pub fn check_writable(path: &Path) -> Result<(), OutError> {
    let path = resolve(path)?;
    if is_special(&path) {
        return Ok(());
    }
    clear_leftovers(&path);
    temp_beside(&path).map(drop)
}

/// Removes the temporary files that programs which were killed while they wrote `path` left beside it. Those that a program
/// is writing are locked by it, and stay.
pub fn clear_leftovers(path: &Path) {
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let (Some(name), Ok(entries)) = (path.file_name(), fs::read_dir(folder_of(&path))) else { return };
    let prefix = temp_prefix(name);
    for entry in entries.flatten() {
        let is_temp = is_temp_name(&entry.file_name().to_string_lossy(), &prefix);
        if is_temp && entry.file_type().is_ok_and(|kind| kind.is_file()) && is_left(&entry.path()) {
            // One that cannot be removed does no more harm than before.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Is nobody writing this file?
fn is_left(temp: &Path) -> bool {
    File::open(temp).is_ok_and(|file| file.try_lock().is_ok())
}

/// Writes `path` through `fill`: into a temporary file in the same folder, flushed to the disk, then renamed.
/// A reader sees the old file or the new one, never a part; on any error nothing is left behind.
/// Devices and pipes are written straight, because a rename would replace them.
///
/// # Errors
/// [`OutError`]: the place, or what went wrong while writing.
pub fn write_whole(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), io::Error>,
) -> Result<(), OutError> {
    let path = resolve(path)?;
    if is_special(&path) {
        let mut file = File::options().write(true).open(&path).map_err(|e| write_error(&path, &e))?;
        return pour(&mut file, fill).map_err(|e| write_error(&path, &e));
    }
    let mut temp = temp_beside(&path)?;
    pour(temp.as_file_mut(), fill).map_err(|e| write_error(&path, &e))?;
    temp.as_file().sync_data().map_err(|e| write_error(&path, &e))?;
    temp.persist(&path).map_err(|e| write_error(&path, &e.error))?;
    Ok(())
}

fn pour(
    file: &mut File,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), io::Error>,
) -> Result<(), io::Error> {
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    fill(&mut writer)?;
    writer.flush()
}

/// Follows links, so that a rename replaces the file meant and not the link to it.
fn resolve(path: &Path) -> Result<PathBuf, OutError> {
    if path.is_dir() {
        let reason = "it is a folder; name a file".to_string();
        return Err(OutError::Place { path: path.to_path_buf(), reason });
    }
    Ok(fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf()))
}

fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|meta| !meta.is_file())
}

fn temp_beside(path: &Path) -> Result<tempfile::NamedTempFile, OutError> {
    let place = |reason: String| OutError::Place { path: path.to_path_buf(), reason };
    let Some(name) = path.file_name() else {
        return Err(place("it has no file name; name a file".into()));
    };
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(place(format!("the folder {} does not exist; create it first", folder.display())));
    }
    let temp = tempfile::Builder::new()
        .prefix(&temp_prefix(name))
        .rand_bytes(TEMP_RANDOM)
        .suffix(TEMP_SUFFIX)
        .permissions(fs::Permissions::from_mode(0o666))
        .tempfile_in(folder)
        .map_err(|e| if is_full(&e) { write_error(path, &e) } else { place(advice(&e)) })?;
    // The lock ends with the program, however that ends. A file system without locks has none to tell leftovers by either.
    let _ = temp.as_file().lock();
    Ok(temp)
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// A temporary file of `a.json` is `.a.json.`, six random letters or digits, and `.tmp`.
const TEMP_RANDOM: usize = 6;
const TEMP_SUFFIX: &str = ".tmp";

fn temp_prefix(name: &OsStr) -> String {
    format!(".{}.", name.to_string_lossy())
}

fn is_temp_name(name: &str, prefix: &str) -> bool {
    let random = name.strip_prefix(prefix).and_then(|rest| rest.strip_suffix(TEMP_SUFFIX));
    random.is_some_and(|random| random.len() == TEMP_RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge)
}

fn write_error(path: &Path, error: &io::Error) -> OutError {
    OutError::Write { path: path.to_path_buf(), reason: advice(error) }
}

fn advice(error: &io::Error) -> String {
    match error.kind() {
        _ if is_full(error) => "the disk is full; free some space or choose another folder".into(),
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only; choose another folder".into(),
        io::ErrorKind::PermissionDenied => "permission denied; allow writing or choose another folder".into(),
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_whole(&path, |w| w.write_all(b"old")).unwrap();
        let error = write_whole(&path, |w| {
            w.write_all(b"half of the new")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert!(matches!(&error, Err(OutError::Write { reason, .. }) if reason.contains("disk is full")), "{error:?}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn what_a_killed_program_left_is_cleared_away_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        // As after `kill -9`: the name stays, the lock is gone.
        let left = temp_beside(&path).unwrap().keep().unwrap();
        drop(left.0);
        let in_use = temp_beside(&path).unwrap();
        let others =
            [".a.txt.abc12.tmp", ".a.txt.abc_12.tmp", ".b.txt.abc123.tmp", "a.txt.abc123.tmp", ".a.txt.abc123"];
        others.iter().for_each(|name| fs::write(folder.path().join(name), "").unwrap());
        assert!(left.1.exists() && names(folder.path()).len() == 7);
        check_writable(&path).unwrap();
        assert!(!left.1.exists() && in_use.path().exists());
        assert_eq!(names(folder.path()).len(), 6);
        drop(in_use);
        clear_leftovers(Path::new("/no/such/folder/a.txt"));
    }

    #[test]
    fn a_missing_folder_or_a_folder_as_file_is_bad_input() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("no/such/a.png");
        let failure = Failure::from(check_writable(&missing).unwrap_err());
        assert_eq!(failure.exit_code(), 2);
        assert!(failure.to_string().contains("no/such does not exist"), "{failure}");
        assert_eq!(Failure::from(check_writable(folder.path()).unwrap_err()).exit_code(), 2);
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_read_only_place_is_bad_input() {
        // /proc refuses new files even to root, as a read-only mount does.
        let failure = Failure::from(check_writable(Path::new("/proc/a.png")).unwrap_err());
        assert_eq!(failure.exit_code(), 2, "{failure}");
    }

    #[test]
    fn a_device_is_written_and_stays_a_device() {
        write_whole(Path::new("/dev/null"), |w| w.write_all(b"x")).unwrap();
        assert!(is_special(Path::new("/dev/null")));
        let full = write_whole(Path::new("/dev/full"), |w| w.write_all(b"x"));
        assert!(matches!(full, Err(OutError::Write { .. })), "{full:?}");
    }

    #[test]
    fn a_link_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));
        fs::write(&real, "1").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write_whole(&link, |w| w.write_all(b"2")).unwrap();
        assert_eq!(fs::read(&real).unwrap(), b"2");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }
}
