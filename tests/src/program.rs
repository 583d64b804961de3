//! The two programs as a user runs them.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// What a program did.
#[derive(Debug)]
pub struct Outcome {
    /// Its exit code; `None` when a signal ended it.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

/// A command of `relume`.
pub fn relume() -> Command {
    command("relume")
}

/// A command of `relume-bake`.
pub fn relume_bake() -> Command {
    command("relume-bake")
}

/// A command of `relume` that notes where memory is asked for: `relume-counted`.
pub fn counted() -> Command {
    command("relume-counted")
}

fn command(name: &str) -> Command {
    let mut command = Command::new(folder().join(name));
    // A backtrace would hide whether a panic's text is one line, and doubles its time.
    command.env("RUST_BACKTRACE", "0");
    command
}

/// Where the programs lie; builds them first, because `cargo test` builds a package's programs only for its own tests.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        if let Some(folder) = std::env::var_os("RELUME_PROGRAMS") {
            return folder.into();
        }
        let test = std::env::current_exe().expect("a running test has a file");
        let folder = test.parent().and_then(Path::parent).expect("tests lie in target/PROFILE/deps").to_owned();
        let release = folder.file_name().is_some_and(|name| name == "release");
        let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        build.args(["build", "--quiet", "--locked", "--workspace", "--bins"]).current_dir(env!("CARGO_MANIFEST_DIR"));
        build.args(release.then_some("--release"));
        // As the tests were built with, or everything would be compiled once more.
        if let Ok(features) = std::env::var("RELUME_TEST_FEATURES") {
            build.args(["--features", &features]);
        }
        build.env("CARGO_TARGET_DIR", folder.parent().expect("target/PROFILE"));
        let built = build.output().expect("cargo runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        folder
    })
}

/// Runs a command to its end.
///
/// # Panics
/// If it cannot be started.
pub fn run(command: &mut Command) -> Outcome {
    let Output { status, stdout, stderr } =
        command.output().unwrap_or_else(|error| panic!("{}: {error}", command.get_program().display()));
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    Outcome { code: status.code(), stdout: text(stdout), stderr: text(stderr) }
}

/// Runs `relume` with these arguments in `folder`.
///
/// # Panics
/// If it cannot be started.
pub fn relume_in(folder: &Path, args: &[&str]) -> Outcome {
    run(relume().args(args).current_dir(folder))
}

/// Runs `relume-bake` with these arguments in `folder`.
///
/// # Panics
/// If it cannot be started.
pub fn bake_in(folder: &Path, args: &[&str]) -> Outcome {
    run(relume_bake().args(args).current_dir(folder))
}

impl Outcome {
    /// Itself, when it ended well.
    ///
    /// # Panics
    /// If the exit code is not 0.
    pub fn well(self) -> Self {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        self
    }

    /// Checks a refusal: this exit code, and exactly one line on standard error beside notices about the scene, of the program,
    /// that names `parts`.
    ///
    /// # Panics
    /// If it is anything else.
    pub fn refused(&self, code: i32, parts: &[&str]) {
        let told: String = self
            .stderr
            .lines()
            .filter(|line| !line.starts_with("notice: "))
            .fold(String::new(), |told, line| told + line + "\n");
        assert_eq!(self.code, Some(code), "{told}");
        assert!(
            told.starts_with("relume") && self.stderr.ends_with('\n') && told.lines().count() == 1,
            "not one line: {told}"
        );
        assert!(!told.contains("panicked"), "{told}");
        for part in parts {
            assert!(told.contains(part), "{told:?} does not name {part:?}");
        }
    }
}
