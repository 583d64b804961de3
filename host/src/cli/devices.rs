//! `relume devices`: what cameras and displays are there.

use super::args::Command;
use crate::failure::Failure;

pub(super) const COMMAND: Command = Command {
    name: "devices",
    help: "\
relume devices [--json]

Lists the V4L2 cameras (formats, sizes with their frames a second, controls), their sub-devices and the DRM displays
(connectors and modes) of this machine. Nothing is changed.
Needs a build with the feature `board`: cargo build --release -p relume --no-default-features --features board
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let mut json = false;
    while let Some(arg) = parser.next()? {
        match arg {
            lexopt::Arg::Long("json") => json = true,
            other => return Err(other.unexpected().into()),
        }
    }
    list(json)
}

#[cfg(feature = "board")]
fn list(json: bool) -> Result<(), Failure> {
    let devices = crate::devices::list();
    if json { super::say_json(&devices) } else { super::say(&devices.to_string()) }
}

#[cfg(not(feature = "board"))]
fn list(_json: bool) -> Result<(), Failure> {
    Err(Failure::bad("devices: this build has no drivers; build with --features board"))
}
