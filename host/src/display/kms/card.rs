//! A DRM card: its node, and why it may refuse.

use std::fs::{self, File};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};

/// An open card.
#[derive(Debug)]
pub struct Card {
    file: File,
    path: PathBuf,
}

impl Card {
    /// Opens a card's node, such as `/dev/dri/card0`, or a link to it.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(path: &Path) -> io::Result<Self> {
        // A link, such as one of /dev/dri/by-path, has another name than the card has in /sys.
        let path = fs::canonicalize(path)?;
        let file = File::options().read(true).write(true).open(&path)?;
        Ok(Card { file, path })
    }

    /// The node; no link.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The node as a file.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// The nodes of all cards of this machine, in order.
    pub fn all() -> Vec<PathBuf> {
        let entries = fs::read_dir("/dev/dri").into_iter().flatten().flatten();
        let is_card = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("card"));
        let mut nodes: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_card).collect();
        nodes.sort();
        nodes
    }
}

impl AsFd for Card {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

impl drm::Device for Card {}
impl drm::control::Device for Card {}
