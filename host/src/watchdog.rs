//! The service manager's watchdog (systemd, `sd_notify(3)`): fed by the loop itself after a frame was presented, so that a
//! loop that hangs is started again.

use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

/// The connection to the service manager.
#[derive(Debug)]
pub struct Watchdog {
    socket: UnixDatagram,
    manager: SocketAddr,
    /// How often it wants to be fed; `None` if not at all.
    interval: Option<Duration>,
    fed: Instant,
    is_ready: bool,
}

impl Watchdog {
    /// The service manager that started this program, if one did and listens.
    pub fn of_this_service() -> Option<Self> {
        let socket = std::env::var("NOTIFY_SOCKET").ok()?;
        let limit_us = std::env::var("WATCHDOG_USEC").ok().and_then(|us| us.parse().ok());
        Self::new(&socket, limit_us.map(Duration::from_micros))
    }

    /// A manager that listens at `socket` (a path, or an abstract name after `@`) and gives up after `limit`.
    pub fn new(socket: &str, limit: Option<Duration>) -> Option<Self> {
        let manager = match socket.strip_prefix('@') {
            Some(name) => SocketAddr::from_abstract_name(name).ok()?,
            None => SocketAddr::from_pathname(socket).ok()?,
        };
        let socket = UnixDatagram::unbound().ok()?;
        // A manager that does not read must not hold up the picture.
        socket.set_nonblocking(true).ok()?;
        let interval = limit.map(|limit| limit / 3);
        Some(Watchdog { socket, manager, interval, fed: Instant::now(), is_ready: false })
    }

    /// A frame was presented: tells the first time that the service is up, then feeds the watchdog in time.
    pub fn frame(&mut self) {
        if !self.is_ready {
            self.is_ready = true;
            self.tell(b"READY=1");
        }
        if self.interval.is_some_and(|interval| self.fed.elapsed() >= interval) {
            self.tell(b"WATCHDOG=1");
        }
    }

    /// The loop has ended.
    pub fn stopping(&mut self) {
        self.tell(b"STOPPING=1");
    }

    fn tell(&mut self, what: &[u8]) {
        // Nobody is there to be told that the manager does not listen.
        let _ = self.socket.send_to_addr(what, &self.manager);
        self.fed = Instant::now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manager_hears_of_the_first_frame_and_then_in_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).unwrap();
        manager.set_nonblocking(true).unwrap();
        let heard = || {
            let mut bytes = [0; 64];
            manager.recv(&mut bytes).ok().map(|length| String::from_utf8_lossy(&bytes[..length]).into_owned())
        };
        let mut watchdog = Watchdog::new(path.to_str().unwrap(), Some(Duration::from_secs(3000))).unwrap();
        watchdog.frame();
        assert_eq!(heard().as_deref(), Some("READY=1"));
        watchdog.frame();
        assert_eq!(heard(), None, "it is not due yet");
        let mut watchdog = Watchdog::new(path.to_str().unwrap(), Some(Duration::ZERO)).unwrap();
        watchdog.frame();
        watchdog.stopping();
        assert_eq!([heard(), heard(), heard()].map(Option::unwrap), ["READY=1", "WATCHDOG=1", "STOPPING=1"]);
        let mut deaf = Watchdog::new("@relume-test-nobody-listens", None).unwrap();
        deaf.frame();
    }
}
