//! A field file in a memory map.

#![allow(unsafe_code)]

use memmap2::Mmap;
use relume_firmware::field::{Field, FieldError};
use relume_firmware::receivers::Receivers;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Why a field file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FieldFileError {
    /// It cannot be read.
    #[error("{}: cannot read the field: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// It is no sound field.
    #[error("{}: {source}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: FieldError,
    },
}

/// A checked field over a memory-mapped file.
///
/// Replace a field by renaming a new file over it; a file that is cut short while it is in use ends the program.
#[derive(Debug)]
pub struct FieldFile {
    // Before the map: fields drop in order, and this borrows from it.
    field: Field<'static>,
    receivers: Option<Receivers<'static>>,
    _map: Mmap,
}

impl FieldFile {
    /// Maps and checks a field file.
    ///
    /// # Errors
    /// [`FieldFileError`], naming the file.
    pub fn open(path: &Path) -> Result<Self, FieldFileError> {
        let read = |source| FieldFileError::Read { path: path.to_owned(), source };
        let file = File::open(path).map_err(read)?;
        let length = file.metadata().map_err(read)?.len();
        if length == 0 {
            let source = FieldError::NotAField;
            return Err(FieldFileError::Field { path: path.to_owned(), source });
        }
        // SAFETY: the map is read only and private to this value; that nobody rewrites the file in place is the
        // documented condition of use, kept by relume-bake, which replaces files by renaming.
        let map = unsafe { Mmap::map(&file) }.map_err(read)?;
        // SAFETY: the map's address does not change when `Mmap` moves; the slice lives in `field` and `receivers`, which are
        // dropped before the map, and accessors hand it out only for as long as `self` is borrowed.
        let bytes: &'static [u8] = unsafe { std::slice::from_raw_parts(map.as_ptr(), map.len()) };
        let unsound = |source| FieldFileError::Field { path: path.to_owned(), source };
        let field = Field::new(bytes).map_err(unsound)?;
        let receivers = Receivers::of(&field).map_err(unsound)?;
        Ok(FieldFile { field, receivers, _map: map })
    }

    /// The field.
    pub fn field(&self) -> Field<'_> {
        self.field
    }

    /// Its receivers, if it has any.
    pub fn receivers(&self) -> Option<Receivers<'_>> {
        self.receivers
    }
}
