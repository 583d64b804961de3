//! A screen that is plugged in and ours: two buffers, flipped.

use super::KmsConfig;
use super::buffer::{ScreenBuffer, fourcc, open_gbm};
use super::card::Card;
use super::output::Output;
use super::pipe::Pipe;
use crate::display::Frame;
use crate::display::pack::Placement;
use drm::Device as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

/// A flip that takes longer than this will not be done.
const FLIP_LIMIT: Duration = Duration::from_millis(500);

/// A screen.
pub(super) struct Screen {
    // Dropped in this order: what was shown before comes back while its buffers are still there.
    pipe: Pipe,
    buffers: [ScreenBuffer; 2],
    back: usize,
    placement: Placement,
    socket: Socket,
    by_gbm: bool,
}

/// A connector in `/sys`: reading its state there asks the kernel, not the monitor, and takes microseconds.
#[derive(Clone, Debug)]
pub(super) struct Socket {
    folder: PathBuf,
}

impl Socket {
    pub(super) fn new(card: &Path, connector: &str) -> Self {
        let card = card.file_name().unwrap_or_default().to_string_lossy();
        Socket { folder: Path::new("/sys/class/drm").join(format!("{card}-{connector}")) }
    }

    /// `None`: the kernel does not say.
    pub(super) fn is_plugged(&self) -> Option<bool> {
        let state = fs::read_to_string(self.folder.join("status")).ok()?;
        Some(state.trim() == "connected")
    }

    /// Does the monitor that is there now still offer a mode of this name (`1920x1080`)? `true` if the kernel does not say.
    fn offers(&self, mode: &str) -> bool {
        let modes = fs::read_to_string(self.folder.join("modes"));
        modes.map_or(true, |modes| modes.lines().any(|line| line.trim() == mode))
    }
}

/// What a look at the socket found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    Well,
    Unplugged,
    ModeGone,
}

impl Screen {
    /// Takes the card and the output that the post's file asks for, for pictures of `picture` pixels.
    ///
    /// # Errors
    /// Why not, in one line.
    pub(super) fn open(path: &Path, config: &KmsConfig, picture: (usize, usize)) -> Result<Self, String> {
        let card = Card::open(path).map_err(|error| super::refusal(path, &error))?;
        card.acquire_master_lock().map_err(|error| super::refusal(path, &error))?;
        let card = Rc::new(card);
        let output = Output::find(&card, config, picture)?;
        let socket = Socket::new(path, &output.name);
        let (rotation, name) = (config.rotation.and(output.orientation), output.name.clone());
        let (width, height) = output.mode.size();
        let size = (usize::from(width), usize::from(height));
        let pipe = Pipe::new(&card, output);
        if let Some(formats) = pipe.formats()
            && !formats.contains(&(fourcc(config.format) as u32))
        {
            return Err(format!("{name} does not take {}; leave display.format out", fourcc(config.format)));
        }
        let gbm = open_gbm(&card, config.buffers, config.format);
        let no_memory = |error: io::Error| format!("{name}: no memory for {width}x{height} pixels: {error}");
        let both = |gbm: Option<&_>| -> io::Result<[ScreenBuffer; 2]> {
            let one = || ScreenBuffer::new(&card, gbm, size, config.format, picture);
            Ok([one()?, one()?])
        };
        let (buffers, by_gbm) = match gbm.as_ref().map(|device| both(Some(device))) {
            Some(Ok(buffers)) => (buffers, true),
            _ => (both(None).map_err(no_memory)?, false),
        };
        let placement = Placement::centred(picture, size, rotation, config.format, buffers[0].stride());
        let placement = placement.ok_or_else(|| {
            let (w, h) = rotation.turned(picture);
            format!("{name} has {width}x{height} pixels; the picture needs {w}x{h}: bake the field for this display")
        })?;
        Ok(Screen { pipe, buffers, back: 0, placement, socket, by_gbm })
    }

    /// What it is, in a few words.
    pub(super) fn words(&self) -> String {
        let output = self.pipe.output();
        let (width, height) = output.mode.size();
        let buffers = if self.by_gbm { "gbm" } else { "dumb" };
        let way = self.pipe.way();
        format!("{} {width}x{height}@{}, {way}, {buffers} buffers", output.name, output.mode.vrefresh())
    }

    /// The socket it hangs on.
    pub(super) fn socket(&self) -> &Socket {
        &self.socket
    }

    /// Is the monitor still there, with its mode?
    pub(super) fn look(&self) -> Look {
        match self.socket.is_plugged() {
            Some(false) => Look::Unplugged,
            _ => {
                let name = self.pipe.output().mode.name().to_string_lossy();
                if self.socket.offers(&name) { Look::Well } else { Look::ModeGone }
            }
        }
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
            return Ok(());
        }
        if self.pipe.is_flipping() && !self.pipe.wait(FLIP_LIMIT)? {
            return Err(io::ErrorKind::TimedOut.into());
        }
        let buffer = &mut self.buffers[self.back];
        buffer.write(frame, &self.placement)?;
        self.pipe.show(buffer.framebuffer())?;
        self.back = front;
        Ok(())
    }
}
