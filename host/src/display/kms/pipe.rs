//! Setting the mode and flipping: atomically where the card can, else the legacy way.

use super::card::Card;
use super::output::{self, Output, planes};
use crate::display::config::Modesetting;
use drm::control::atomic::AtomicModeReq;
use drm::control::property::{self, Value};
use drm::control::{AtomicCommitFlags, Device as _, Event, PageFlipFlags, ResourceHandle, crtc, framebuffer, plane};
use drm::{ClientCapability, Device as _};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::io;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Properties of the plane that a flip or a new mode sets.
const PLANE: [&str; 10] =
    ["FB_ID", "CRTC_ID", "SRC_X", "SRC_Y", "SRC_W", "SRC_H", "CRTC_X", "CRTC_Y", "CRTC_W", "CRTC_H"];

/// A flip's event is read with the next frame at the latest; a stamp further back is none.
const OLDEST_FLIP: Duration = Duration::from_secs(1);

/// What an atomic request names.
struct Atomic {
    plane: plane::Handle,
    others: Vec<plane::Handle>,
    plane_properties: [property::Handle; PLANE.len()],
    mode_id: property::Handle,
    active: property::Handle,
    connector_crtc: property::Handle,
}

/// A screen that shows framebuffers, and what was there before.
pub(super) struct Pipe {
    card: Rc<Card>,
    output: Output,
    atomic: Option<Atomic>,
    before: Option<crtc::Info>,
    is_set: bool,
    flips: bool,
    /// When the newest framebuffer was first on the screen.
    flipped: Option<Instant>,
}

impl Pipe {
    /// Prepares an output; nothing is shown yet.
    pub(super) fn new(card: &Rc<Card>, output: Output, modesetting: Modesetting) -> Self {
        let can = modesetting == Modesetting::Auto
            && card.set_client_capability(ClientCapability::UniversalPlanes, true).is_ok()
            && card.set_client_capability(ClientCapability::Atomic, true).is_ok();
        let atomic = if can { Atomic::find(card, &output) } else { None };
        let before = card.get_crtc(output.crtc).ok();
        Pipe { card: Rc::clone(card), output, atomic, before, is_set: false, flips: false, flipped: None }
    }

    pub(super) fn output(&self) -> &Output {
        &self.output
    }

    /// `atomic` or `legacy`.
    pub(super) fn way(&self) -> &'static str {
        if self.atomic.is_some() { "atomic" } else { "legacy" }
    }

    /// The formats (fourcc) that the screen's plane takes; `None` if that is not known.
    pub(super) fn formats(&self) -> Option<Vec<u32>> {
        Some(self.card.get_plane(self.atomic.as_ref()?.plane).ok()?.formats().to_vec())
    }

    /// When the newest framebuffer was first on the screen; none while its flip is under way.
    pub(super) fn flipped(&self) -> Option<Instant> {
        self.flipped.filter(|_| !self.flips)
    }

    /// Is a flip under way?
    pub(super) fn is_flipping(&self) -> bool {
        self.flips
    }

    /// Shows a framebuffer from the next refresh on; the first time, sets the mode.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn show(&mut self, framebuffer: framebuffer::Handle) -> io::Result<()> {
        if !self.is_set {
            self.set_mode(framebuffer)?;
            (self.is_set, self.flipped) = (true, Some(Instant::now()));
            return Ok(());
        }
        match &self.atomic {
            Some(atomic) => {
                let mut request = AtomicModeReq::new();
                let value = Value::Framebuffer(Some(framebuffer));
                request.add_property(atomic.plane, atomic.plane_properties[0], value);
                self.card.atomic_commit(AtomicCommitFlags::NONBLOCK | AtomicCommitFlags::PAGE_FLIP_EVENT, request)?;
            }
            None => self.card.page_flip(self.output.crtc, framebuffer, PageFlipFlags::EVENT, None)?,
        }
        self.flips = true;
        Ok(())
    }

    /// Waits until the flip under way is done, no longer than `limit`; false if it is not.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn wait(&mut self, limit: Duration) -> io::Result<bool> {
        let limit = Timespec::try_from(limit).map_err(io::Error::other)?;
        while self.flips {
            let mut descriptors = [PollFd::new(&*self.card, PollFlags::IN)];
            match poll(&mut descriptors, Some(&limit)) {
                Ok(0) => return Ok(false),
                Ok(_) if descriptors[0].revents().intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL) => {
                    return Err(io::ErrorKind::BrokenPipe.into());
                }
                Ok(_) => {}
                Err(rustix::io::Errno::INTR) => continue,
                Err(error) => return Err(error.into()),
            }
            for event in self.card.receive_events()? {
                if let Event::PageFlip(flip) = event {
                    (self.flips, self.flipped) = (false, Some(instant_of(flip.duration)));
                }
            }
        }
        Ok(true)
    }

    fn set_mode(&self, framebuffer: framebuffer::Handle) -> io::Result<()> {
        let Some(atomic) = &self.atomic else {
            // The legacy cursor is a plane of its own; a card without one says so.
            #[allow(deprecated)]
            let _ = self.card.set_cursor(self.output.crtc, None::<&drm::control::dumbbuffer::DumbBuffer>);
            let (output, mode) = (&self.output, self.output.mode);
            return self.card.set_crtc(output.crtc, Some(framebuffer), (0, 0), &[output.connector], Some(mode));
        };
        let blob = self.card.create_property_blob(&self.output.mode)?;
        let request = atomic.mode_request(&self.output, framebuffer, blob);
        let test = AtomicCommitFlags::TEST_ONLY | AtomicCommitFlags::ALLOW_MODESET;
        let done = self
            .card
            .atomic_commit(test, request.clone())
            .and_then(|()| self.card.atomic_commit(AtomicCommitFlags::ALLOW_MODESET, request));
        if let Value::Blob(id) = blob {
            // The kernel keeps what it uses.
            let _ = self.card.destroy_property_blob(id);
        }
        done
    }
}

/// The moment of an event by the monotonic clock, which `stamp` counts by on every card since Linux 4.15. Cards without a
/// refresh of their own may stamp nothing that makes sense; their event came when it was read.
fn instant_of(stamp: Duration) -> Instant {
    let now = clock_gettime(ClockId::Monotonic);
    let since_boot = Duration::try_from(now).unwrap_or_default();
    let age = since_boot.checked_sub(stamp).filter(|age| *age < OLDEST_FLIP).unwrap_or_default();
    Instant::now().checked_sub(age).unwrap_or_else(Instant::now)
}

impl Drop for Pipe {
    fn drop(&mut self) {
        // What was shown before, the console as a rule, comes back; a card that is gone shows nothing anyway.
        if let (true, Some(before)) = (self.is_set, &self.before) {
            let connectors = if before.mode().is_some() { vec![self.output.connector] } else { Vec::new() };
            let framebuffer = before.mode().and(before.framebuffer());
            let _ = self.card.set_crtc(self.output.crtc, framebuffer, before.position(), &connectors, before.mode());
        }
    }
}

impl Atomic {
    /// Finds what a request must name; `None` if the card lacks any of it.
    fn find(card: &Card, output: &Output) -> Option<Self> {
        let (plane, others) = planes(card, output.crtc)?;
        let mut plane_properties = [handle(card, plane, PLANE[0])?; PLANE.len()];
        for (found, name) in plane_properties.iter_mut().zip(PLANE) {
            *found = handle(card, plane, name)?;
        }
        Some(Atomic {
            plane,
            others,
            plane_properties,
            mode_id: handle(card, output.crtc, "MODE_ID")?,
            active: handle(card, output.crtc, "ACTIVE")?,
            connector_crtc: handle(card, output.connector, "CRTC_ID")?,
        })
    }

    /// Mode, connector and plane in one request; other planes on the screen (a cursor) go.
    fn mode_request(&self, output: &Output, framebuffer: framebuffer::Handle, mode: Value<'static>) -> AtomicModeReq {
        let (width, height) = output.mode.size();
        let whole = |length: u16| Value::UnsignedRange(u64::from(length) << 16);
        let values: [Value<'_>; PLANE.len()] = [
            Value::Framebuffer(Some(framebuffer)),
            Value::CRTC(Some(output.crtc)),
            Value::UnsignedRange(0),
            Value::UnsignedRange(0),
            whole(width),
            whole(height),
            Value::SignedRange(0),
            Value::SignedRange(0),
            Value::UnsignedRange(width.into()),
            Value::UnsignedRange(height.into()),
        ];
        let mut request = AtomicModeReq::new();
        request.add_property(output.connector, self.connector_crtc, Value::CRTC(Some(output.crtc)));
        request.add_property(output.crtc, self.mode_id, mode);
        request.add_property(output.crtc, self.active, Value::Boolean(true));
        for (property, value) in self.plane_properties.iter().zip(values) {
            request.add_property(self.plane, *property, value);
        }
        for &other in &self.others {
            // A plane's properties have the same handles on all planes of a card.
            request.add_property(other, self.plane_properties[0], Value::Framebuffer(None));
            request.add_property(other, self.plane_properties[1], Value::CRTC(None));
        }
        request
    }
}

fn handle<T: ResourceHandle>(card: &Card, object: T, name: &str) -> Option<property::Handle> {
    output::property(card, object, name).map(|(handle, _)| handle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flips_stamp_is_its_moment_and_nonsense_is_now() {
        let since_boot = Duration::try_from(clock_gettime(ClockId::Monotonic)).unwrap();
        let (before, stamp) = (Instant::now(), since_boot - Duration::from_millis(300));
        let flipped = instant_of(stamp);
        assert!(flipped <= before - Duration::from_millis(200) && flipped >= before - Duration::from_millis(400));
        for nonsense in [Duration::ZERO, since_boot + Duration::from_secs(50)] {
            assert!(instant_of(nonsense) >= before);
        }
    }
}
