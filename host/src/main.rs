//! `relume`: the program at the post. Everything happens in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    match relume::cli::run(std::env::args_os().skip(1)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            use std::io::Write;
            // A closed standard error must not turn a failure into a panic.
            let _ = writeln!(std::io::stderr(), "relume: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
