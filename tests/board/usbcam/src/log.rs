//! A line per change, with the seconds of CLOCK_MONOTONIC, which V4L2 stamps its buffers with too.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Seconds of CLOCK_MONOTONIC.
pub fn monotonic_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// A log; clones write to the same one.
#[derive(Clone, Debug, Default)]
pub struct Log(Option<Arc<Mutex<File>>>);

impl Log {
    /// A log that is appended to a file, which others may empty meanwhile; standard error if none.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn open(path: Option<&Path>) -> std::io::Result<Self> {
        let open = |path| OpenOptions::new().create(true).append(true).open(path);
        Ok(Log(path.map(open).transpose()?.map(|file| Arc::new(Mutex::new(file)))))
    }

    /// Writes a line.
    pub fn line(&self, text: impl fmt::Display) {
        // One write per line: lines of other threads and programs stay whole. A full disk must not end the camera.
        let line = format!("{:.4} {text}\n", monotonic_s());
        let _ = match &self.0 {
            Some(file) => file.lock().unwrap_or_else(PoisonError::into_inner).write_all(line.as_bytes()),
            None => std::io::stderr().write_all(line.as_bytes()),
        };
    }
}
