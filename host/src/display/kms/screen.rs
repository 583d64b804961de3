//! A screen that is plugged in and ours: two buffers, flipped.

use super::KmsConfig;
use super::buffer::{ScreenBuffer, fourcc, open_gbm};
use super::card::Card;
use super::output::choose_output;
use super::pipe::Pipe;
use super::socket::{CLASS, Look, Socket};
use super::trouble::Trouble;
use crate::display::Frame;
use crate::display::pack::Placement;
use drm::{Device as _, DriverCapability};
use std::io;
use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// A flip that takes longer than this will not be done.
const FLIP_LIMIT: Duration = Duration::from_millis(500);

/// A screen.
pub(super) struct Screen {
    // Dropped in this order: what was shown before comes back while its buffers are still there.
    pipe: Pipe,
    buffers: [ScreenBuffer; 2],
    back: usize,
    placement: Placement,
    card: Rc<Card>,
    socket: Socket,
    by_gbm: bool,
    /// The newest frame that the pipe was given, or that looked as the one given did.
    queued: Option<u64>,
    /// The newest frame that is known to have been on the screen, and since when.
    shown: Option<(u64, Instant)>,
}

impl Screen {
    /// Takes the card and the output that the post's file asks for, for pictures of `picture` pixels.
    ///
    /// # Errors
    /// Why not.
    pub(super) fn open(path: &Path, config: &KmsConfig, picture: (usize, usize)) -> Result<Self, Trouble> {
        let refused = |error: io::Error| Trouble::of(path, &error);
        let card = Rc::new(Card::open(path).map_err(|error| Trouble::of_opening(path, &error))?);
        card.acquire_master_lock().map_err(refused)?;
        let output = choose_output(&card, config, picture)?;
        let socket = Socket::new(Path::new(CLASS), card.path(), &output.name);
        let (rotation, name) = (config.rotation.and(output.orientation), output.name.clone());
        let (width, height) = output.mode.size();
        let size = (usize::from(width), usize::from(height));
        let pipe = Pipe::new(&card, output, config.modesetting);
        if let Some(formats) = pipe.formats()
            && !formats.contains(&(fourcc(config.format) as u32))
        {
            return Err(Trouble::Unfit(format!(
                "{name} does not take {}; leave display.format out",
                fourcc(config.format)
            )));
        }
        let (buffers, by_gbm) = both(&card, config, size, picture).map_err(|error| Trouble::System {
            what: format!("{name}: no memory for {width}x{height} pixels: {error}"),
        })?;
        let placement = Placement::centred(picture, size, rotation, config.format, buffers[0].stride());
        let placement = placement.ok_or_else(|| {
            let (w, h) = rotation.turned(picture);
            Trouble::Unfit(format!(
                "{name} has {width}x{height} pixels; the picture needs {w}x{h}: bake the field for this display"
            ))
        })?;
        Ok(Screen { pipe, buffers, back: 0, placement, card, socket, by_gbm, queued: None, shown: None })
    }

    /// What it is, in a few words.
    pub(super) fn words(&self) -> String {
        let output = self.pipe.output();
        let (width, height) = output.mode.size();
        let buffers = if self.by_gbm { "gbm" } else { "dumb" };
        let way = self.pipe.way();
        let words = format!("{} {width}x{height}@{}, {way}, {buffers} buffers", output.name, output.mode.vrefresh());
        self.note().map_or_else(|| words.clone(), |note| format!("{words}; {note}"))
    }

    /// The socket it hangs on, such as `HDMI-A-1`.
    pub(super) fn name(&self) -> &str {
        &self.pipe.output().name
    }

    /// Its card's node.
    pub(super) fn node(&self) -> &Path {
        self.card.path()
    }

    /// What the installer should know of it.
    pub(super) fn note(&self) -> Option<&str> {
        self.pipe.output().note.as_deref()
    }

    /// Are card and monitor still there, with the mode? A picture that stands still flips nothing and would not tell.
    pub(super) fn look(&self) -> Look {
        // A card that was taken away answers nothing any more, though another may have come under its name.
        if self.card.get_driver_capability(DriverCapability::DumbBuffer).is_err() {
            return Look::Gone;
        }
        self.socket.look(&self.pipe.output().mode.name().to_string_lossy())
    }

    /// Shows a picture: writes what the back buffer lacks of it, and flips. Waits for the flip before, and so keeps the
    /// screen's pace. A picture that brings nothing new is left out.
    ///
    /// # Errors
    /// What the system says, [`io::ErrorKind::TimedOut`] where a flip is not done in time.
    pub(super) fn show(&mut self, frame: &Frame<'_>) -> io::Result<()> {
        self.buffers.iter_mut().for_each(|buffer| buffer.age(frame.damage));
        let front = 1 - self.back;
        if !self.buffers[front].is_stale() {
            if self.pipe.is_flipping() {
                self.queued = Some(frame.number);
            } else {
                self.shown = Some((frame.number, Instant::now()));
            }
            return Ok(());
        }
        if self.pipe.is_flipping() && !self.pipe.wait(FLIP_LIMIT)? {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.note_flip();
        let buffer = &mut self.buffers[self.back];
        buffer.write(frame, &self.placement)?;
        self.pipe.show(buffer.framebuffer())?;
        (self.back, self.queued) = (front, Some(frame.number));
        Ok(())
    }

    /// When the frame `number`, or one after it, was first on the screen; `None` while that is not known. Does not wait.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn when_shown(&mut self, number: u64) -> io::Result<Option<Instant>> {
        if self.pipe.is_flipping() {
            self.pipe.wait(Duration::ZERO)?;
        }
        self.note_flip();
        Ok(self.shown.filter(|(shown, _)| *shown >= number).map(|(_, at)| at))
    }

    /// The frame given to the pipe is on the screen, if its flip is done.
    fn note_flip(&mut self) {
        if let Some(at) = self.pipe.flipped()
            && let Some(number) = self.queued.take()
        {
            self.shown = Some((number, at));
        }
    }
}

/// Two buffers, of GBM where that may be and can; true if they are.
fn both(
    card: &Rc<Card>,
    config: &KmsConfig,
    size: (usize, usize),
    picture: (usize, usize),
) -> io::Result<([ScreenBuffer; 2], bool)> {
    let both = |gbm: Option<&_>| -> io::Result<[ScreenBuffer; 2]> {
        let one = || ScreenBuffer::new(card, gbm, size, config.format, picture);
        Ok([one()?, one()?])
    };
    let gbm = open_gbm(card, config.buffers, config.format);
    match gbm.as_ref().map(|device| both(Some(device))) {
        Some(Ok(buffers)) => Ok((buffers, true)),
        _ => Ok((both(None)?, false)),
    }
}
