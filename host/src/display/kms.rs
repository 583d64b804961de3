//! A screen through DRM/KMS. It may be unplugged, come back with another mode, or lose its card: pictures then go nowhere
//! until there is a screen again, and the post goes on.

mod buffer;
mod card;
mod output;
mod pipe;
mod screen;

pub use card::Card;
pub use output::connector_name;

use super::config::{BufferKind, KmsConfig};
use super::{Display, DisplayError, Frame};
use screen::{Look, Screen, Socket};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How often the socket is looked at, and a lost screen is tried again.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A display behind a DRM card.
pub struct Kms {
    config: KmsConfig,
    picture: (usize, usize),
    screen: Option<Screen>,
    /// Where the last screen was plugged in.
    socket: Option<Socket>,
    trouble: Option<String>,
    looked: Instant,
    opened: u64,
}

impl Kms {
    /// A display for pictures of `picture` pixels.
    ///
    /// # Errors
    /// [`DisplayError::Screen`] where the card, connector or mode is not there, or another program has it. Nothing plugged
    /// in is no error: the monitor may be switched on later.
    pub fn open(config: &KmsConfig, picture: (usize, usize)) -> Result<Self, DisplayError> {
        let mut display = Kms {
            config: config.clone(),
            picture,
            screen: None,
            socket: None,
            trouble: None,
            looked: Instant::now(),
            opened: 0,
        };
        display.find();
        match (&display.screen, &display.trouble) {
            (None, Some(trouble)) if !trouble.starts_with(NOTHING) => Err(DisplayError::Screen(trouble.clone())),
            _ => Ok(display),
        }
    }

    /// What pictures go to, in a few words.
    pub fn words(&self) -> String {
        match (&self.screen, &self.trouble) {
            (Some(screen), _) => screen.words(),
            (None, trouble) => trouble.clone().unwrap_or_default(),
        }
    }

    /// Takes the first card that does.
    fn find(&mut self) {
        let cards = self.config.card.as_ref().map_or_else(Card::all, |card| vec![card.clone()]);
        let mut trouble = "no display card in /dev/dri".to_string();
        for card in &cards {
            match Screen::open(card, &self.config, self.picture) {
                Ok(screen) => {
                    eprintln!("display: {}", screen.words());
                    self.socket = Some(screen.socket().clone());
                    (self.screen, self.trouble) = (Some(screen), None);
                    self.opened += 1;
                    return;
                }
                Err(reason) => trouble = reason,
            }
        }
        self.lose(trouble);
    }

    fn lose(&mut self, trouble: String) {
        self.screen = None;
        if self.trouble.as_ref() != Some(&trouble) {
            eprintln!("display: {trouble}");
        }
        self.trouble = Some(trouble);
    }

    /// Looks whether the screen is still there, or there again.
    fn look(&mut self) {
        self.looked = Instant::now();
        match self.screen.as_ref().map(Screen::look) {
            Some(Look::Well) => {}
            Some(Look::Unplugged) => self.lose(format!("{NOTHING} is plugged in")),
            Some(Look::ModeGone) => {
                self.lose("another monitor, without this mode".into());
                self.find();
            }
            // Asking a card for its monitors takes long; the socket it hung on tells whether that is worth it.
            None if self.socket.as_ref().and_then(Socket::is_plugged) == Some(false) => {}
            None => self.find(),
        }
    }
}

/// How troubles begin that a monitor plugged in cures.
const NOTHING: &str = "nothing";

impl Display for Kms {
    fn size(&self) -> (usize, usize) {
        self.picture
    }

    fn present(&mut self, frame: &Frame<'_>) -> Result<(), DisplayError> {
        if (frame.width, frame.height) != self.picture {
            return Err(DisplayError::Size { frame: (frame.width, frame.height), display: self.picture });
        }
        if self.looked.elapsed() >= LOOK_EVERY {
            self.look();
        }
        if let Some(screen) = &mut self.screen
            && let Err(error) = screen.show(frame)
        {
            let node = self.config.card.clone().unwrap_or_else(|| PathBuf::from("the display card"));
            self.lose(refusal(&node, &error));
        }
        Ok(())
    }

    fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }
}

/// Why a card refuses, in one line that says what to do.
fn refusal(node: &Path, error: &io::Error) -> String {
    use rustix::io::Errno;
    let node = node.display();
    match error.raw_os_error().map(Errno::from_raw_os_error) {
        Some(Errno::NODEV | Errno::NXIO | Errno::NOENT) => format!("{node} is not there"),
        Some(Errno::BUSY) => format!("{node} may not be used: another program shows on it; stop it (a desktop?)"),
        Some(Errno::ACCESS | Errno::PERM) => format!("{node} may not be used; add this user to the group video"),
        _ if error.kind() == io::ErrorKind::TimedOut => format!("{node} does not flip"),
        _ => format!("{node}: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::io::Errno;

    #[test]
    fn a_card_that_refuses_says_what_to_do() {
        let told = |errno: Errno| refusal(Path::new("/dev/dri/card0"), &errno.into());
        assert_eq!(told(Errno::NODEV), "/dev/dri/card0 is not there");
        assert!(told(Errno::BUSY).contains("another program shows on it"));
        assert!(told(Errno::ACCESS).contains("group video"));
        assert!(refusal(Path::new("a"), &io::ErrorKind::TimedOut.into()).contains("does not flip"));
    }

    #[test]
    fn a_card_that_is_not_there_is_no_display() {
        let config = KmsConfig { card: Some("/dev/dri/card99".into()), ..KmsConfig::default() };
        let refused = Kms::open(&config, (640, 480)).err().map(|error| error.to_string());
        assert_eq!(refused.as_deref(), Some("display: /dev/dri/card99 is not there"));
    }
}
