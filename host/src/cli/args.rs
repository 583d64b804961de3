//! What every command's arguments have in common.

use crate::failure::Failure;
use std::ffi::OsString;
use std::path::PathBuf;

/// A command: its name, its help, and what it does with its arguments.
pub(super) struct Command {
    pub name: &'static str,
    pub help: &'static str,
    pub act: fn(lexopt::Parser) -> Result<(), Failure>,
}

impl Command {
    /// Runs the command, or prints its help when asked for.
    pub(super) fn run(&self, rest: Vec<OsString>) -> Result<(), Failure> {
        let asks_help = |arg: &OsString| arg == "--help" || arg == "-h";
        if rest.iter().take_while(|arg| *arg != "--").any(asks_help) {
            return super::say(self.help);
        }
        (self.act)(lexopt::Parser::from_args(rest)).map_err(|failure| self.point_to_help(failure))
    }

    /// Adds where to read on to faults of the arguments themselves.
    fn point_to_help(&self, failure: Failure) -> Failure {
        match failure {
            Failure::BadInput(error) if error.is::<lexopt::Error>() => {
                Failure::bad(format!("{}: {error}; see `relume {} --help`", self.name, self.name))
            }
            other => other,
        }
    }
}

/// An argument that must be there.
pub(super) fn required<T>(value: Option<T>, what: &str) -> Result<T, Failure> {
    value.ok_or_else(|| Failure::BadInput(lexopt::Error::Custom(format!("{what} is missing").into()).into()))
}

/// Takes the next bare argument into the first free place; a further one is refused.
pub(super) fn place(value: OsString, places: &mut [&mut Option<PathBuf>]) -> Result<(), Failure> {
    match places.iter_mut().find(|place| place.is_none()) {
        Some(place) => {
            **place = Some(value.into());
            Ok(())
        }
        None => Err(lexopt::Arg::Value(value).unexpected().into()),
    }
}

/// A finite number within a range.
pub(super) fn number(
    parser: &mut lexopt::Parser,
    flag: &str,
    range: std::ops::RangeInclusive<f64>,
) -> Result<f64, Failure> {
    let text = parser.value()?.to_string_lossy().into_owned();
    let wrong = || Failure::bad(format!("{flag} {text}: must be a number from {} to {}", range.start(), range.end()));
    let value: f64 = text.trim().parse().map_err(|_| wrong())?;
    if range.contains(&value) { Ok(value) } else { Err(wrong()) }
}

/// A span of time such as 90s, 5m, 8h or 2d, seconds.
pub(super) fn span_s(parser: &mut lexopt::Parser, flag: &str) -> Result<f64, Failure> {
    const UNITS: [(char, f64); 4] = [('s', 1.0), ('m', 60.0), ('h', 3600.0), ('d', 86_400.0)];
    let text = parser.value()?.to_string_lossy().into_owned();
    let parts = UNITS.iter().find_map(|(unit, seconds)| Some((text.strip_suffix(*unit)?, seconds)));
    let value = parts.and_then(|(number, seconds)| Some(number.trim().parse::<f64>().ok()? * seconds));
    value
        .filter(|span_s| (1.0..=1e8).contains(span_s))
        .ok_or_else(|| Failure::bad(format!("{flag} {text}: must be a span of time such as 90s, 5m, 8h or 2d")))
}

/// `N` finite numbers with commas between them.
pub(super) fn numbers<const N: usize>(
    parser: &mut lexopt::Parser,
    flag: &str,
    names: &str,
) -> Result<[f64; N], Failure> {
    let text = parser.value()?.to_string_lossy().into_owned();
    let values: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    values
        .and_then(|values| values.try_into().ok())
        .ok_or_else(|| Failure::bad(format!("{flag} {text}: must be {N} numbers with commas between them, {names}")))
}

/// The arguments of commands that take `POST.toml [--json]`.
pub(super) fn post_arguments(parser: &mut lexopt::Parser) -> Result<(PathBuf, bool), Failure> {
    use lexopt::prelude::{Long, Value};
    let (mut file, mut json) = (None::<PathBuf>, false);
    while let Some(arg) = parser.next()? {
        match arg {
            Long("json") => json = true,
            Value(value) => place(value, &mut [&mut file])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok((required(file, "POST.toml")?, json))
}
