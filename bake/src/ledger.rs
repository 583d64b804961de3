//! Blocks that are done, on disk: what an interrupted bake goes on from, and a share of a bake for `relume-bake merge`.
//!
//! ```text
//! first line   "RELUME-BLOCKS 1 IDENTITY FIRST END": of the bake (plan.rs), hexadecimal, and the numbers of the blocks
//! then, one after the other and in order, per block
//!    0 u32 bytes of the block        4 u32 CRC-32 of the block        8 the block, by postcard
//! ```
//! Whatever comes after the last whole block (a killed bake, a full disk) is cut off when the file is opened again.

use crate::job::DoneBlock;
use std::fs::{File, TryLockError};
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

const MAGIC: &str = "RELUME-BLOCKS 1";
/// No line before the blocks is longer, bytes.
const LONGEST_LINE: u64 = 128;
/// No block is larger, bytes.
const LARGEST_BLOCK: usize = 1 << 28;

/// Why blocks cannot be kept or taken; one line.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// The file is there and nobody said to go on with it.
    #[error("{}: an interrupted bake left it; add --resume to go on with it, or delete it", .0.display())]
    There(PathBuf),
    /// Another program writes it.
    #[error("{}: another bake is writing it; wait for it, or choose another output", .0.display())]
    Busy(PathBuf),
    /// No such file, or something else.
    #[error("{}: holds no blocks of a bake", .0.display())]
    Foreign(PathBuf),
    /// It belongs to another bake.
    #[error("{}: blocks of another bake (other scene, camera, options or version); bake it anew", .0.display())]
    Other(PathBuf),
    /// Blocks are missing at its end.
    #[error("{}: unfinished, {done} of {wanted} tiles; bake it again with --resume", file.display())]
    Unfinished {
        /// The file.
        file: PathBuf,
        /// Blocks that are there.
        done: u32,
        /// Blocks it should have.
        wanted: u32,
    },
    /// No room is left.
    #[error("{}: the disk is full; free some space and go on with --resume, or choose another folder", .0.display())]
    Full(PathBuf),
    /// The file cannot be read or written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What happened.
        source: std::io::Error,
    },
}

impl LedgerError {
    /// Would it help to start again once the disk is well?
    pub fn is_of_the_disk(&self) -> bool {
        matches!(self, LedgerError::Busy(_) | LedgerError::Full(_))
            || matches!(self, LedgerError::Io { source, .. } if source.kind() != ErrorKind::NotFound)
    }
}

/// A file of blocks that grows.
#[derive(Debug)]
pub struct Ledger {
    path: PathBuf,
    file: File,
    first: u32,
    next: u32,
}

impl Ledger {
    /// Opens a file for the blocks `numbers` of the bake `identity`. With `resume`, blocks that an earlier run left there are
    /// handed to `done` in order; otherwise the file must be new.
    ///
    /// # Errors
    /// [`LedgerError`].
    pub fn open(
        path: &Path,
        (identity, numbers): (u32, Range<u32>),
        resume: bool,
        mut done: impl FnMut(DoneBlock),
    ) -> Result<Self, LedgerError> {
        let io = |source| LedgerError::Io { file: path.to_owned(), source };
        let fresh = !path.exists();
        if !fresh && !resume {
            return Err(LedgerError::There(path.to_owned()));
        }
        let mut file = File::options().read(true).write(true).create(true).truncate(false).open(path).map_err(io)?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => return Err(LedgerError::Busy(path.to_owned())),
            Err(TryLockError::Error(source)) if source.kind() != ErrorKind::Unsupported => {
                return Err(io(source));
            }
            _ => {}
        }
        let mut next = numbers.start;
        if file.metadata().map_err(io)?.len() > 0 {
            let end = {
                let mut reader = Reader::new(path, &file)?;
                if (reader.identity, &reader.numbers) != (identity, &numbers) {
                    return Err(LedgerError::Other(path.to_owned()));
                }
                while let Some(block) = reader.next_block() {
                    next = block.number + 1;
                    done(block);
                }
                reader.end
            };
            file.set_len(end).and_then(|()| file.seek(SeekFrom::Start(end))).map_err(io)?;
        } else {
            writeln!(file, "{MAGIC} {identity:08x} {} {}", numbers.start, numbers.end).map_err(io)?;
        }
        Ok(Ledger { path: path.to_owned(), file, first: numbers.start, next })
    }

    /// Number of the first block that is not there yet.
    pub fn next(&self) -> u32 {
        self.next
    }

    /// Adds the next block.
    ///
    /// # Errors
    /// [`LedgerError::Full`] and [`LedgerError::Io`]; the blocks before stay good, and without any the file goes.
    pub fn append(&mut self, block: &DoneBlock) -> Result<(), LedgerError> {
        let io = |source| LedgerError::Io { file: self.path.clone(), source };
        let bytes = postcard::to_stdvec(block).map_err(|error| io(std::io::Error::other(error.to_string())))?;
        let mut record = Vec::with_capacity(8 + bytes.len());
        record.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
        record.extend_from_slice(&crc32fast::hash(&bytes).to_le_bytes());
        record.extend_from_slice(&bytes);
        if let Err(error) = self.file.write_all(&record) {
            if self.next == self.first {
                let _ = std::fs::remove_file(&self.path);
            }
            let is_full = matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded);
            return Err(if is_full { LedgerError::Full(self.path.clone()) } else { io(error) });
        }
        self.next = block.number + 1;
        Ok(())
    }

    /// Deletes the file, as far as that goes.
    pub fn discard(self) {
        let _ = std::fs::remove_file(&self.path);
    }

    /// Puts the finished file in place, under another name.
    ///
    /// # Errors
    /// [`LedgerError::Io`].
    pub fn rename(self, to: &Path) -> Result<(), LedgerError> {
        let moved = self.file.sync_data().and_then(|()| std::fs::rename(&self.path, to));
        moved.map_err(|source| LedgerError::Io { file: to.to_owned(), source })
    }
}

/// Reads the blocks of a file in order.
pub struct Reader<'f> {
    path: PathBuf,
    from: BufReader<&'f File>,
    /// The bake they belong to.
    pub identity: u32,
    /// The blocks that the file is for.
    pub numbers: Range<u32>,
    next: u32,
    /// Where the last whole block ended.
    end: u64,
}

impl<'f> Reader<'f> {
    /// Reads the first line.
    ///
    /// # Errors
    /// [`LedgerError::Foreign`] for any other file.
    pub fn new(path: &Path, file: &'f File) -> Result<Self, LedgerError> {
        let foreign = || LedgerError::Foreign(path.to_owned());
        let mut from = BufReader::with_capacity(1 << 20, file);
        let mut line = String::new();
        from.by_ref().take(LONGEST_LINE).read_line(&mut line).map_err(|_| foreign())?;
        let fields: Vec<&str> = line.strip_prefix(MAGIC).ok_or_else(foreign)?.split_whitespace().collect();
        let [identity, first, end] = fields[..] else { return Err(foreign()) };
        let identity = u32::from_str_radix(identity, 16).map_err(|_| foreign())?;
        let [first, last] = [first, end].map(|number| number.parse::<u32>().map_err(|_| foreign()));
        let numbers = first?..last?;
        if !line.ends_with('\n') || numbers.is_empty() {
            return Err(foreign());
        }
        Ok(Reader { path: path.to_owned(), from, identity, next: numbers.start, numbers, end: line.len() as u64 })
    }

    /// The next block; none at the end, or where the file is damaged.
    pub fn next_block(&mut self) -> Option<DoneBlock> {
        if self.next >= self.numbers.end {
            return None;
        }
        let mut head = [0u8; 8];
        self.from.read_exact(&mut head).ok()?;
        let [length, crc] = [0, 4].map(|at| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]));
        let length = Some(length as usize).filter(|&length| length <= LARGEST_BLOCK)?;
        let mut bytes = vec![0; length];
        self.from.read_exact(&mut bytes).ok()?;
        let block: DoneBlock = postcard::from_bytes(&bytes).ok().filter(|_| crc32fast::hash(&bytes) == crc)?;
        if block.number != self.next {
            return None;
        }
        self.next += 1;
        self.end += (head.len() + length) as u64;
        Some(block)
    }

    /// Were all blocks there?
    ///
    /// # Errors
    /// [`LedgerError::Unfinished`].
    pub fn finish(self) -> Result<(), LedgerError> {
        if self.next == self.numbers.end {
            return Ok(());
        }
        let done = self.next - self.numbers.start;
        Err(LedgerError::Unfinished { file: self.path, done, wanted: self.numbers.end - self.numbers.start })
    }
}

#[cfg(test)]
mod tests;
