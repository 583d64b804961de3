//! `relume demo`: the built-in scene, baked and run through a day.

use super::args::Command;
use crate::failure::Failure;
use std::path::PathBuf;

pub(super) const COMMAND: Command = Command {
    name: "demo",
    help: "\
relume demo [--out DIR]

Bakes the built-in scene, runs a day from dawn to dusk under a simulated sky camera, and writes pictures, plots and a
summary into DIR (relume-demo if left out). Takes under two minutes on two cores.
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let mut out = PathBuf::from("relume-demo");
    while let Some(arg) = parser.next()? {
        match arg {
            lexopt::Arg::Long("out") => out = parser.value()?.into(),
            other => return Err(other.unexpected().into()),
        }
    }
    demo(&out)
}

#[cfg(feature = "demo")]
fn demo(out: &std::path::Path) -> Result<(), Failure> {
    crate::demo::run(out)
}

#[cfg(not(feature = "demo"))]
fn demo(_out: &std::path::Path) -> Result<(), Failure> {
    Err(Failure::bad("demo: this build leaves the baking tool out; build with --features demo"))
}
