//! The kernel's virtual USB host controller (module vhci-hcd), through its files in sysfs.

use std::fs;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

const FOLDER: &str = "/sys/devices/platform/vhci_hcd.0";
/// The hub of super-speed ports, as the status file calls it.
const HUB: &str = "ss";
/// A free port's state.
const FREE: &str = "004";
/// Bus 1, device 2: the kernel keeps the number and asks nothing of it.
const DEVICE_ID: u32 = 0x0001_0002;
/// Super speed in the kernel's enum usb_device_speed.
const SUPER_SPEED: u32 = 5;
/// How long the kernel may take to give a port back.
const PATIENCE: Duration = Duration::from_secs(10);

/// Why the camera could not be plugged or unplugged; one line.
#[derive(Debug, thiserror::Error)]
pub enum VhciError {
    /// The controller is not there.
    #[error("{FOLDER} is missing: load the kernel's module vhci-hcd and run as root")]
    Missing,
    /// All ports are taken.
    #[error("{FOLDER}/status: no free super-speed port; unplug another camera")]
    Full,
    /// A file could not be read or written.
    #[error("{FOLDER}/{file}: {source}")]
    Io {
        /// Which.
        file: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The kernel does not let go of a port.
    #[error("port {0} is still busy after 10 s")]
    Busy(u32),
}

/// A port of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Port(pub u32);

fn status() -> Result<String, VhciError> {
    if !Path::new(FOLDER).exists() {
        return Err(VhciError::Missing);
    }
    fs::read_to_string(Path::new(FOLDER).join("status")).map_err(|source| VhciError::Io { file: "status", source })
}

fn write(file: &'static str, text: String) -> Result<(), VhciError> {
    fs::write(Path::new(FOLDER).join(file), text).map_err(|source| VhciError::Io { file, source })
}

/// Lines of the status file: hub, port, state, then more.
fn first_free(status: &str) -> Option<Port> {
    status.lines().find_map(|line| {
        let mut words = line.split_whitespace();
        let (hub, port, state) = (words.next()?, words.next()?, words.next()?);
        (hub == HUB && state == FREE).then(|| port.parse().ok().map(Port)).flatten()
    })
}

fn is_free(status: &str, port: Port) -> bool {
    status.lines().any(|line| {
        let mut words = line.split_whitespace().skip(1);
        words.next().and_then(|number| number.parse().ok()) == Some(port.0) && words.next() == Some(FREE)
    })
}

/// Gives the kernel a socket at whose other end a device answers; it begins to ask at once.
///
/// # Errors
/// [`VhciError`] without the controller, a free port or the right to use it.
pub fn attach(socket: &UnixStream) -> Result<Port, VhciError> {
    let port = first_free(&status()?).ok_or(VhciError::Full)?;
    write("attach", format!("{} {} {DEVICE_ID} {SUPER_SPEED}", port.0, socket.as_raw_fd()))?;
    Ok(port)
}

/// Has the kernel unplug the device.
///
/// # Errors
/// [`VhciError`] where it does not.
pub fn detach(port: Port) -> Result<(), VhciError> {
    write("detach", port.0.to_string())
}

/// Waits until the kernel has torn down the device at a port.
///
/// # Errors
/// [`VhciError::Busy`] when it takes longer than 10 s.
pub fn wait_until_free(port: Port) -> Result<(), VhciError> {
    let begun = Instant::now();
    while !is_free(&status()?, port) {
        if begun.elapsed() > PATIENCE {
            return Err(VhciError::Busy(port.0));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATUS: &str = "hub port sta spd dev      sockfd local_busid\n\
                          hs  0000 004 000 00000000 000000 0-0\n\
                          hs  0001 006 003 00010002 000003 3-1\n\
                          ss  0008 006 005 00010002 000004 4-1\n\
                          ss  0009 004 000 00000000 000000 0-0\n";

    #[test]
    fn the_first_free_super_speed_port_is_taken() {
        assert_eq!(first_free(STATUS), Some(Port(9)));
        assert!(is_free(STATUS, Port(9)) && !is_free(STATUS, Port(8)));
        assert_eq!(first_free("hub port sta\nhs 0000 004\n"), None);
    }
}
