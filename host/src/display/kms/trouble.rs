//! Why there is no screen, and what may bring one.

use rustix::io::Errno;
use std::io;
use std::path::{Path, PathBuf};

/// Why there is no screen; one line that says what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Trouble {
    #[error("no display card in /dev/dri")]
    NoCard,
    #[error("{} is not there", .0.display())]
    Gone(PathBuf),
    #[error("{} may not be used: another program shows on it; stop it (a desktop?)", .0.display())]
    Taken(PathBuf),
    #[error("{} may not be used; add this user to the group video", .0.display())]
    Denied(PathBuf),
    /// A card that only computes.
    #[error("{} drives no display", .0.display())]
    NoDisplay(PathBuf),
    /// Nothing is wrong but that nothing is plugged in.
    #[error("nothing is plugged into {0}")]
    Unplugged(String),
    /// What is plugged in is not what the post's file asks for.
    #[error("{0}")]
    Unfit(String),
    #[error("{} does not flip", .0.display())]
    Stalled(PathBuf),
    #[error("{what}")]
    System { what: String },
}

/// What may cure a trouble, and so when it is worth to try again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cure {
    /// The card comes back, or its user goes: asking costs nothing.
    Card,
    /// A monitor comes, or another one. Asking for them takes long: monitors answer slowly.
    Monitor,
    /// Nobody knows; trying takes long.
    Patience,
}

impl Trouble {
    /// What the system's error means when a card's node is opened.
    pub(super) fn of_opening(card: &Path, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::PermissionDenied => Trouble::Denied(card.to_path_buf()),
            _ => Self::of(card, error),
        }
    }

    /// What the system's error means on a card that is open.
    pub(super) fn of(card: &Path, error: &io::Error) -> Self {
        let node = card.to_path_buf();
        match error.raw_os_error().map(Errno::from_raw_os_error) {
            Some(Errno::NODEV | Errno::NXIO | Errno::NOENT) => Trouble::Gone(node),
            // Who may open it may show on it, unless another program does.
            Some(Errno::BUSY | Errno::ACCESS | Errno::PERM) => Trouble::Taken(node),
            _ if error.kind() == io::ErrorKind::TimedOut => Trouble::Stalled(node),
            _ => Trouble::System { what: format!("{}: {error}", node.display()) },
        }
    }

    /// Whether a post opens with it. Another monitor, or another file, cures what is unplugged or does not fit, and a start
    /// tried again every few seconds would cure neither: the post runs, and its badge and state tell what is wrong.
    pub(super) fn is_lived_with(&self) -> bool {
        matches!(self, Trouble::Unplugged(_) | Trouble::Unfit(_))
    }

    /// What may cure it.
    pub(super) fn cure(&self) -> Cure {
        match self {
            Trouble::NoCard | Trouble::Gone(_) | Trouble::Taken(_) | Trouble::Denied(_) => Cure::Card,
            Trouble::NoDisplay(_) | Trouble::Unplugged(_) | Trouble::Unfit(_) => Cure::Monitor,
            Trouble::Stalled(_) | Trouble::System { .. } => Cure::Patience,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_that_refuses_says_what_to_do() {
        let told = |errno: Errno| Trouble::of(Path::new("/dev/dri/card0"), &errno.into());
        assert_eq!(told(Errno::NODEV).to_string(), "/dev/dri/card0 is not there");
        assert!(told(Errno::BUSY).to_string().contains("another program shows on it"));
        assert_eq!(told(Errno::ACCESS), told(Errno::BUSY), "of a card that is open");
        let opening = Trouble::of_opening(Path::new("/dev/dri/card0"), &Errno::ACCESS.into());
        assert!(opening.to_string().contains("group video"));
        let late = Trouble::of(Path::new("a"), &io::ErrorKind::TimedOut.into());
        assert_eq!((late.to_string(), late.cure()), ("a does not flip".into(), Cure::Patience));
        assert_eq!((told(Errno::NODEV).cure(), told(Errno::BUSY).cure()), (Cure::Card, Cure::Card));
    }
}
