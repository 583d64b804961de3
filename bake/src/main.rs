//! `relume-bake`: see `relume-bake --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    match relume_bake::cli::run(std::env::args_os()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("relume-bake: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
