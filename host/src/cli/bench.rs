//! `relume bench`: time against error on this machine.

use super::args::{Command, place, required};
use crate::bench::{Options, run};
use crate::failure::{Failure, OrFail};
use std::path::PathBuf;

pub(super) const COMMAND: Command = Command {
    name: "bench",
    help: "\
relume bench FIELD [--stack STACK_DIR] [--sky MAP]... [--figure OUT.png] [--json]

Time per frame for several budgets, beside a dense f32 sum by OpenBLAS when that library is there.

  --stack STACK_DIR   the uncompressed stack: measures errors too, over all skies (without it those keys are null)
  --sky MAP           a lat-long radiance map; may be given more than once
  --figure OUT.png    time against error as a picture (with --stack)
  --json              the figures as one JSON object on standard output
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    use lexopt::prelude::{Long, Value};
    let (mut field, mut stack, mut figure) = (None::<PathBuf>, None::<PathBuf>, None::<PathBuf>);
    let (mut skies, mut json) = (Vec::<PathBuf>::new(), false);
    while let Some(arg) = parser.next()? {
        match arg {
            Long("stack") => stack = Some(parser.value()?.into()),
            Long("sky") => skies.push(parser.value()?.into()),
            Long("figure") => figure = Some(parser.value()?.into()),
            Long("json") => json = true,
            Value(value) => place(value, &mut [&mut field])?,
            other => return Err(other.unexpected().into()),
        }
    }
    let field = required(field, "FIELD")?;
    let report = run(&Options { field, stack, skies }).or_bad()?;
    if let (Some(path), Some(chart)) = (figure, crate::bench::figure(&report)) {
        chart.draw(900, 520).save(&path).or_runtime()?;
    }
    if json { super::say_json(&report) } else { super::say(&report.to_string()) }
}
