//! The command line: `relume COMMAND ...`; one file per command.

mod args;
mod bench;
mod check;
mod demo;
mod devices;
mod relight;
pub(crate) mod run;
mod sky;

use crate::failure::{Failure, OrFail};
use args::Command;
use std::ffi::OsString;
use std::io::{self, Write};

const HELP: &str = "\
relume: a vanished building, lit by the sky that is over its site now

  relume demo [--out DIR]           bake the built-in scene and run a day; pictures and a report
  relume run POST.toml              the post: capture, relight, composite, show
  relume relight FIELD ...          one picture of a field under one sky
  relume sky capture|response|lens|colour   frames of the sky camera; its calibration
  relume sky merge|weights          frames -> radiance map -> weights
  relume bench FIELD ...            time against error on this machine
  relume check POST.toml            what is wrong with a post, before it opens
  relume devices                    cameras and displays of this machine (feature `board`)

relume COMMAND --help tells a command's options. Exit codes: 0 done, 1 failed at run time, 2 bad arguments or input.
";

const COMMANDS: &[Command] =
    &[demo::COMMAND, run::COMMAND, relight::COMMAND, sky::COMMAND, bench::COMMAND, check::COMMAND, devices::COMMAND];

/// Runs one command; `args` are those after the program's name.
///
/// # Errors
/// [`Failure`], which carries the exit code and the one line to print.
pub fn run(args: impl IntoIterator<Item = OsString>) -> Result<(), Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut parser = lexopt::Parser::from_args(args);
    match parser.next()? {
        None => Err(Failure::bad("no command; `relume --help` lists them")),
        Some(Long("help") | Short('h')) => say(HELP),
        Some(Long("version") | Short('V')) => say(&format!("relume {}\n", env!("CARGO_PKG_VERSION"))),
        Some(Value(name)) => {
            let name = name.to_string_lossy().into_owned();
            let Some(command) = COMMANDS.iter().find(|command| command.name == name) else {
                let names = COMMANDS.iter().map(|command| command.name);
                let nearest = names.min_by_key(|known| strsim::damerau_levenshtein(known, &name)).unwrap_or("demo");
                return Err(Failure::bad(format!("unknown command {name}; did you mean {nearest}?")));
            };
            let rest: Vec<OsString> = parser.raw_args()?.collect();
            command.run(rest)
        }
        Some(other) => Err(Failure::bad(format!("{}; name a command first", other.unexpected()))),
    }
}

/// Writes to standard output. A reader that has gone (`relume ... | head`) is no failure.
fn say(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Failure::runtime(format!("standard output: {error}"))),
        Ok(()) => Ok(()),
    }
}

/// One JSON object on standard output.
fn say_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let mut text = serde_json::to_string(value).or_runtime()?;
    text.push('\n');
    say(&text)
}

#[cfg(test)]
mod tests;
