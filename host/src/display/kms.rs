//! A screen through DRM/KMS. It may be unplugged, come back with another mode, or lose its card: pictures then go nowhere
//! until there is a screen again, and the post goes on.

mod buffer;
mod card;
mod output;
mod pipe;
mod screen;
mod socket;
mod trouble;

pub use card::Card;
pub use output::connector_name;

use super::config::{BufferKind, KmsConfig};
use super::{Display, DisplayError, Frame};
use screen::Screen;
use socket::{CLASS, Look, Sockets};
use std::path::Path;
use std::time::{Duration, Instant};
use trouble::{Cure, Trouble};

/// How often the socket is looked at, and a lost screen is tried again where that costs nothing.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// How often a screen is tried again whose trouble has no known cure.
const TRY_EVERY: Duration = Duration::from_secs(2);
/// How often a card is asked for its monitors where the kernel does not tell of them; its own polling is as slow.
const ASK_EVERY: Duration = Duration::from_secs(10);

/// What becomes of pictures, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outlook {
    /// They are shown: on what.
    Shown(String),
    /// Nothing is plugged in; that may come.
    Unplugged(String),
    /// What is plugged in cannot show them as the post's file asks: why.
    Unfit(String),
}

/// A display behind a DRM card.
pub struct Kms {
    config: KmsConfig,
    picture: (usize, usize),
    screen: Option<Screen>,
    /// Why there is no screen, and the same in words.
    trouble: Option<(Trouble, String)>,
    /// How the sockets were when a screen was last tried.
    sockets: Sockets,
    tried: Instant,
    looked: Instant,
}

impl Kms {
    /// A display for pictures of `picture` pixels.
    ///
    /// # Errors
    /// [`DisplayError::Screen`] where the card is not there, or another program has it. Nothing plugged in is no error, nor is
    /// a monitor that does not fit (no such mode or format, too few pixels): another one may come, and until then
    /// [`Display::trouble`] tells what is wrong.
    pub fn open(config: &KmsConfig, picture: (usize, usize)) -> Result<Self, DisplayError> {
        let mut display = Self::without_screen(config, picture);
        display.find();
        display.opened()
    }

    fn without_screen(config: &KmsConfig, picture: (usize, usize)) -> Self {
        let now = Instant::now();
        let sockets = Sockets::look(Path::new(CLASS));
        Kms { config: config.clone(), picture, screen: None, trouble: None, sockets, tried: now, looked: now }
    }

    /// Itself, unless there is a trouble that a post does not open with.
    fn opened(self) -> Result<Self, DisplayError> {
        match &self.trouble {
            Some((trouble, words)) if !trouble.is_lived_with() => Err(DisplayError::Screen(words.clone())),
            _ => Ok(self),
        }
    }

    /// What pictures go to, in a few words, or why nowhere.
    pub fn outlook(&self) -> Outlook {
        match (&self.screen, &self.trouble) {
            (Some(screen), _) => Outlook::Shown(screen.words()),
            (None, Some((Trouble::Unplugged(_), words))) => Outlook::Unplugged(words.clone()),
            (None, Some((_, words))) => Outlook::Unfit(words.clone()),
            (None, None) => Outlook::Unplugged("no screen has been looked for".into()),
        }
    }

    /// Takes the first card that does.
    fn find(&mut self) {
        self.tried = Instant::now();
        let cards = self.config.card.as_ref().map_or_else(Card::all, |card| vec![card.clone()]);
        let mut trouble = Trouble::NoCard;
        for card in &cards {
            match Screen::open(card, &self.config, self.picture) {
                Ok(screen) => {
                    eprintln!("display: {}", screen.words());
                    (self.screen, self.trouble) = (Some(screen), None);
                    return;
                }
                // A card that only computes hides none that could show.
                Err(Trouble::NoDisplay(_)) if trouble != Trouble::NoCard => {}
                Err(found) => trouble = found,
            }
        }
        self.lose(trouble);
    }

    fn lose(&mut self, trouble: Trouble) {
        self.screen = None;
        let words = trouble.to_string();
        if self.trouble().is_none_or(|before| before != words) {
            eprintln!("display: {words}");
        }
        self.trouble = Some((trouble, words));
    }

    /// Looks whether the screen is still there, or there again.
    fn look(&mut self) {
        self.looked = Instant::now();
        let Some(screen) = &self.screen else {
            if self.is_worth_trying() {
                self.find();
            }
            return;
        };
        let found = screen.look();
        if found == Look::Well {
            return;
        }
        self.sockets = Sockets::look(Path::new(CLASS));
        self.lose(match found {
            Look::Gone => Trouble::Gone(screen.node().to_path_buf()),
            _ => Trouble::Unplugged(screen.name().to_string()),
        });
        // The monitor may offer other modes now, or hang on another socket.
        if found != Look::Gone {
            self.find();
        }
    }

    /// Whether anything has changed, or enough time has passed, since a screen was last tried.
    fn is_worth_trying(&mut self) -> bool {
        let sockets = Sockets::look(Path::new(CLASS));
        let (changed, told) = (sockets != self.sockets, sockets.are_told());
        self.sockets = sockets;
        let waited = self.tried.elapsed();
        changed
            || match self.trouble.as_ref().map(|(trouble, _)| trouble.cure()) {
                Some(Cure::Monitor) => !told && waited >= ASK_EVERY,
                Some(Cure::Patience) => waited >= TRY_EVERY,
                Some(Cure::Card) | None => true,
            }
    }
}

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
            let trouble = Trouble::of(screen.node(), &error);
            self.lose(trouble);
        }
        Ok(())
    }

    fn when_shown(&mut self, number: u64) -> Option<Instant> {
        // A screen that is lost is told of with the next picture.
        self.screen.as_mut()?.when_shown(number).ok().flatten()
    }

    fn trouble(&self) -> Option<&str> {
        self.trouble.as_ref().map(|(_, words)| words.as_str())
    }

    fn note(&self) -> Option<&str> {
        self.screen.as_ref().and_then(Screen::note)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::damage::Damage;
    use output::{ModeFacts, fitting_mode};

    const NO_CARD: &str = "/dev/dri/card99";

    fn on_no_card() -> KmsConfig {
        KmsConfig { card: Some(NO_CARD.into()), ..KmsConfig::default() }
    }

    #[test]
    fn a_card_that_is_not_there_is_no_display() {
        let refused = Kms::open(&on_no_card(), (640, 480)).err().map(|error| error.to_string());
        assert_eq!(refused.as_deref(), Some("display: /dev/dri/card99 is not there"));
    }

    /// A display whose only trouble is this.
    fn troubled(trouble: Trouble) -> Kms {
        let mut display = Kms::without_screen(&on_no_card(), (640, 480));
        display.lose(trouble);
        display
    }

    #[test]
    fn a_post_opens_on_a_monitor_that_does_not_fit_and_tells() {
        let facts = [ModeFacts { size: (800, 600), refresh_hz: 60, preferred: true }];
        let no_such_mode = fitting_mode("HDMI-A-1", &facts, "1920x1080".parse().ok(), (640, 480)).unwrap_err();
        let too_small = fitting_mode("HDMI-A-1", &facts, None, (1280, 720)).unwrap_err();
        let words = [
            "HDMI-A-1 has no mode 1920x1080; it has 800x600@60",
            "HDMI-A-1 has no mode for 1280x720 pixels; it has 800x600@60",
        ];
        for (unfit, words) in [no_such_mode, too_small].into_iter().zip(words) {
            assert_eq!(unfit.cure(), Cure::Monitor, "a fitting monitor cures it");
            let mut display = troubled(unfit).opened().unwrap();
            assert_eq!(display.trouble(), Some(words));
            assert_eq!(display.outlook(), Outlook::Unfit(words.into()));
            let (pixels, damage) = (vec![0; 640 * 480], Damage::whole(640, 480));
            let frame = Frame { width: 640, height: 480, pixels_bgrx: &pixels, number: 0, damage: &damage };
            display.present(&frame).unwrap();
        }
        let unplugged = troubled(Trouble::Unplugged("HDMI-A-1".into())).opened().unwrap();
        assert_eq!(unplugged.outlook(), Outlook::Unplugged("nothing is plugged into HDMI-A-1".into()));
        assert!(troubled(Trouble::Taken(NO_CARD.into())).opened().is_err());
    }
}
