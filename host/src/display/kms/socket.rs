//! Sockets as the kernel lists them in `/sys`. A look there takes microseconds: the kernel's own plug events and polling
//! keep it true, and no monitor is asked, as any question to the card itself may do.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Where the kernel lists cards and their sockets.
pub(super) const CLASS: &str = "/sys/class/drm";

/// The most that a file there holds.
const PAGE: usize = 4096;

/// The text of a small file, without allocating: a frame may ask for it. None where it cannot be read.
fn read<'p>(file: &Path, page: &'p mut [u8; PAGE]) -> Option<&'p str> {
    let (mut file, mut end) = (File::open(file).ok()?, 0);
    loop {
        match file.read(&mut page[end..]).ok()? {
            0 => return std::str::from_utf8(&page[..end]).ok(),
            more => end += more,
        }
    }
}

/// The socket that a screen hangs on.
#[derive(Clone, Debug)]
pub(super) struct Socket {
    status: PathBuf,
    modes: PathBuf,
    /// False where the kernel lists none.
    is_listed: bool,
}

/// What a look at a socket found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    Well,
    Unplugged,
    ModeGone,
    /// With its card.
    Gone,
}

impl Socket {
    /// The socket of this name, such as `HDMI-A-1`, of a card's node, such as `/dev/dri/card0`.
    pub(super) fn new(class: &Path, card: &Path, connector: &str) -> Self {
        let card = card.file_name().unwrap_or_default().to_string_lossy();
        let folder = class.join(format!("{card}-{connector}"));
        Socket { is_listed: folder.is_dir(), status: folder.join("status"), modes: folder.join("modes") }
    }

    /// Whether something is plugged in that still offers a mode of this name (`1920x1080`).
    pub(super) fn look(&self, mode: &str) -> Look {
        if !self.is_listed {
            return Look::Well;
        }
        let mut page = [0; PAGE];
        let Some(status) = read(&self.status, &mut page) else { return Look::Gone };
        if status.trim() == "disconnected" {
            return Look::Unplugged;
        }
        let modes = read(&self.modes, &mut page);
        let offers = modes.is_none_or(|modes| modes.lines().any(|line| line.trim() == mode));
        if offers { Look::Well } else { Look::ModeGone }
    }
}

/// All sockets, each with its state and what its monitor offers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Sockets(Vec<(String, String, String)>);

impl Sockets {
    /// Looks at all cards.
    pub(super) fn look(class: &Path) -> Self {
        let entries = fs::read_dir(class).into_iter().flatten().flatten();
        let state = |folder: PathBuf| {
            let status = fs::read_to_string(folder.join("status")).ok()?;
            let modes = fs::read_to_string(folder.join("modes")).unwrap_or_default();
            Some((folder.file_name()?.to_string_lossy().into_owned(), status.trim().to_string(), modes))
        };
        let mut sockets: Vec<_> = entries.filter_map(|entry| state(entry.path())).collect();
        sockets.sort();
        Sockets(sockets)
    }

    /// Whether the kernel tells of every socket what is plugged in. Where it does not, the card must be asked.
    pub(super) fn are_told(&self) -> bool {
        let is_told = |status: &str| matches!(status, "connected" | "disconnected");
        !self.0.is_empty() && self.0.iter().all(|(_, status, _)| is_told(status))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(class: &Path, socket: &str, status: &str, modes: &str) {
        let folder = class.join(socket);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("status"), format!("{status}\n")).unwrap();
        fs::write(folder.join("modes"), modes).unwrap();
    }

    #[test]
    fn a_monitor_that_goes_changes_or_takes_its_card_along_is_seen() {
        let class = tempfile::tempdir().unwrap();
        put(class.path(), "card0-HDMI-A-1", "connected", "1920x1080\n1280x720\n");
        let socket = Socket::new(class.path(), Path::new("/dev/dri/card0"), "HDMI-A-1");
        assert_eq!((socket.look("1280x720"), socket.look("640x480")), (Look::Well, Look::ModeGone));
        put(class.path(), "card0-HDMI-A-1", "disconnected", "");
        assert_eq!(socket.look("1280x720"), Look::Unplugged);
        fs::remove_dir_all(class.path().join("card0-HDMI-A-1")).unwrap();
        assert_eq!(socket.look("1280x720"), Look::Gone);
        let unlisted = Socket::new(class.path(), Path::new("/dev/dri/card1"), "HDMI-A-1");
        assert_eq!(unlisted.look("1280x720"), Look::Well, "where the kernel lists nothing, flips tell");
    }

    #[test]
    fn sockets_differ_when_a_monitor_comes_or_another_one() {
        let class = tempfile::tempdir().unwrap();
        assert!(!Sockets::look(class.path()).are_told());
        put(class.path(), "card0-HDMI-A-1", "disconnected", "");
        put(class.path(), "card0-HDMI-A-2", "disconnected", "");
        fs::create_dir(class.path().join("renderD128")).unwrap();
        let none = Sockets::look(class.path());
        assert!(none.are_told() && none == Sockets::look(class.path()));
        put(class.path(), "card0-HDMI-A-2", "connected", "640x480\n");
        let one = Sockets::look(class.path());
        put(class.path(), "card0-HDMI-A-2", "connected", "800x600\n");
        assert!(one != none && one != Sockets::look(class.path()));
        put(class.path(), "card0-HDMI-A-1", "unknown", "");
        assert!(!Sockets::look(class.path()).are_told());
    }
}
