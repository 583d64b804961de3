//! What a command may end with other than success, and the one line it says about it.

use std::fmt;

/// Why a command stopped; decides the exit code.
#[derive(Debug)]
pub enum Failure {
    /// Arguments or input are at fault: exit code 2. Starting again changes nothing.
    BadInput(anyhow::Error),
    /// Something failed on the way (disk full, device lost): exit code 1. Starting again may help.
    Runtime(anyhow::Error),
}

impl Failure {
    /// A fault of arguments or input, told in one line.
    pub fn bad(message: impl fmt::Display) -> Self {
        Failure::BadInput(anyhow::anyhow!("{message}"))
    }

    /// A fault of the moment, told in one line.
    pub fn runtime(message: impl fmt::Display) -> Self {
        Failure::Runtime(anyhow::anyhow!("{message}"))
    }

    /// The process's exit code: 2 for bad input, 1 for a failure at run time.
    pub fn exit_code(&self) -> u8 {
        match self {
            Failure::BadInput(_) => 2,
            Failure::Runtime(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    /// Cause after cause, each told once, always on one line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Failure::BadInput(error) | Failure::Runtime(error)) = self;
        let mut text = error.to_string();
        for cause in error.chain().skip(1).map(ToString::to_string) {
            if !text.contains(&cause) {
                text = format!("{text}: {cause}");
            }
        }
        let mut words = text.split(['\n', '\r']).map(str::trim).filter(|part| !part.is_empty());
        f.write_str(words.next().unwrap_or("failed without a reason"))?;
        words.try_for_each(|part| write!(f, " {part}"))
    }
}

impl From<lexopt::Error> for Failure {
    fn from(error: lexopt::Error) -> Self {
        Failure::BadInput(error.into())
    }
}

/// Where an error becomes a [`Failure`]: the caller knows whether it speaks of input or of the moment.
pub trait OrFail<T> {
    /// Errors are the input's fault (exit code 2).
    fn or_bad(self) -> Result<T, Failure>;
    /// Errors are the moment's fault (exit code 1).
    fn or_runtime(self) -> Result<T, Failure>;
}

impl<T, E: Into<anyhow::Error>> OrFail<T> for Result<T, E> {
    fn or_bad(self) -> Result<T, Failure> {
        self.map_err(|error| Failure::BadInput(error.into()))
    }

    fn or_runtime(self) -> Result<T, Failure> {
        self.map_err(|error| Failure::Runtime(error.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_once() {
        let cause = || std::io::Error::other("no such file");
        let told = anyhow::Error::from(cause()).context("a.png: no such file");
        assert_eq!(Failure::BadInput(told).to_string(), "a.png: no such file");
        let untold = anyhow::Error::from(cause()).context("a.png");
        assert_eq!(Failure::BadInput(untold).to_string(), "a.png: no such file");
    }

    #[test]
    fn several_lines_become_one() {
        let failure = Failure::bad("first\n  second\r\n\nthird");
        assert_eq!(failure.to_string(), "first second third");
        assert_eq!(failure.exit_code(), 2);
        assert_eq!(Failure::runtime("x").exit_code(), 1);
    }
}
