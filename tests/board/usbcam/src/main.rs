//! `usbcam`: a virtual USB sky camera for the board tests. Everything happens in the library.

use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    match relume_usbcam::cli::run(std::env::args_os().skip(1)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // A closed standard error must not turn a failure into a panic.
            let _ = writeln!(std::io::stderr(), "usbcam: {error:#}");
            ExitCode::from(2)
        }
    }
}
