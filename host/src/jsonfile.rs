//! Small files of settings in JSON: read, refused with file and field, written whole.

use crate::outfile::{OutError, write_whole};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::Write;
use std::path::Path;

/// Why such a file could not be used; one line.
#[derive(Debug, thiserror::Error)]
pub enum JsonError {
    /// The file could not be read.
    #[error("{name}: {source}")]
    Io {
        /// File name.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not what the file should hold.
    #[error("{name}: {reason}")]
    Json {
        /// File name.
        name: String,
        /// What the parser said.
        reason: String,
    },
    /// A field's value makes no sense.
    #[error("{name}: {field}: {what}")]
    Value {
        /// File name.
        name: String,
        /// The field at fault.
        field: &'static str,
        /// What is wrong and what to do.
        what: String,
    },
}

/// Reads a file.
///
/// # Errors
/// [`JsonError::Io`] and [`JsonError::Json`], naming it.
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, JsonError> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|source| JsonError::Io { name: name.clone(), source })?;
    serde_json::from_str(&text).map_err(|reason| JsonError::Json { name, reason: reason.to_string() })
}

/// Writes a file, whole, as one line.
///
/// # Errors
/// [`OutError`], naming it.
pub fn save(path: &Path, value: &impl Serialize) -> Result<(), OutError> {
    write_whole(path, |out| {
        serde_json::to_writer(&mut *out, value)?;
        out.write_all(b"\n")
    })
}
