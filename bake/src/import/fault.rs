//! Why pictures cannot be imported.

use crate::bake::BakeError;
use relume_firmware::patches::MAX_PATCHES;
use std::path::{Path, PathBuf};

/// Why pictures cannot be imported; one line that names the file and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file cannot be read, or is not what it should be.
    #[error("{}: {fault}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// What is wrong and what to do.
        fault: String,
    },
    /// A line of a file is not what it should be.
    #[error("{}: line {line}: {fault}", file.display())]
    Line {
        /// The file.
        file: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong and what to do.
        fault: String,
    },
    /// A picture of another size than the first.
    #[error("{}: {}x{} pixels, but {} has {}x{}; all pictures of a set have one size", file.display(), size.0, size.1, first.display(), wanted.0, wanted.1)]
    Size {
        /// The picture.
        file: PathBuf,
        /// Its width and height, px.
        size: (usize, usize),
        /// The first picture.
        first: PathBuf,
        /// Its width and height, px.
        wanted: (usize, usize),
    },
    /// A pixel that is no light.
    #[error("{}: pixel (column {}, row {}) is {value}; it must be finite", file.display(), at.0, at.1)]
    Value {
        /// The picture.
        file: PathBuf,
        /// Column and row.
        at: (usize, usize),
        /// What it holds.
        value: f32,
    },
    /// More lights than a field can have.
    #[error("{}: {count} pictures; a field has at most {MAX_PATCHES} patches: leave some out", file.display())]
    TooMany {
        /// The set.
        file: PathBuf,
        /// Pictures.
        count: usize,
    },
    /// Two pictures of one light.
    #[error("{}: {first} and {second} have the same direction; leave one of them out", file.display())]
    SameDirection {
        /// The set.
        file: PathBuf,
        /// A picture.
        first: String,
        /// Another.
        second: String,
    },
    /// All pixels of all pictures are black, or masked.
    #[error("{}: nothing is lit in any picture; check the pictures and the mask", .0.display())]
    Dark(PathBuf),
    /// The spool cannot be written or read.
    #[error("{}: no room for the pictures beside the output ({source}); {need_mb} MB are needed", folder.display())]
    Spool {
        /// Where it is.
        folder: PathBuf,
        /// What the system said.
        source: std::io::Error,
        /// Size of the whole spool, MB.
        need_mb: u64,
    },
    /// What can happen to any bake.
    #[error(transparent)]
    Bake(#[from] BakeError),
}

impl ImportError {
    /// A fault of a file.
    pub(super) fn file(file: &Path, fault: impl std::fmt::Display) -> Self {
        // Decoders tell some faults in several lines.
        let fault = fault.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        ImportError::File { file: file.to_owned(), fault }
    }

    /// Would it help to start again once the disk is well?
    pub fn is_of_the_disk(&self) -> bool {
        use crate::stack::StackError;
        matches!(self, ImportError::Spool { .. } | ImportError::Bake(BakeError::Stack(StackError::Write { .. })))
    }
}
