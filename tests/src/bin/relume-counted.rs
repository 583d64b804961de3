//! `relume`, by an allocator that notes where memory is asked for: after `RELUME_COUNTED_WARM_UP_S` seconds, and for
//! `RELUME_COUNTED_S` from then on, between two times that the post writes its state to `RELUME_COUNTED_HEALTH`. What was seen
//! goes to `RELUME_COUNTED_REPORT`, as JSON, while the post runs on.

use relume_tests::counting::{Counting, sites};
use relume_tests::origins::report;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn seconds(name: &str) -> anyhow::Result<Duration> {
    let text = std::env::var(name).map_err(|_| anyhow::anyhow!("{name} is not set; give seconds"))?;
    text.parse().map(Duration::from_secs_f64).map_err(|_| anyhow::anyhow!("{name}={text}: no number of seconds"))
}

fn file(name: &str) -> anyhow::Result<PathBuf> {
    std::env::var_os(name).map(PathBuf::from).ok_or_else(|| anyhow::anyhow!("{name} is not set; name a file"))
}

/// Waits until the state is written anew; the frames that it tells of.
fn next_state(health: &Path) -> u64 {
    let frames = || {
        let state: serde_json::Value = serde_json::from_slice(&std::fs::read(health).ok()?).ok()?;
        state["frames"].as_u64()
    };
    let before = frames();
    loop {
        std::thread::sleep(Duration::from_millis(10));
        match frames() {
            Some(now) if before != Some(now) => return now,
            _ => {}
        }
    }
}

fn count() -> anyhow::Result<()> {
    let (warm_up, span) = (seconds("RELUME_COUNTED_WARM_UP_S")?, seconds("RELUME_COUNTED_S")?);
    let (health, into) = (file("RELUME_COUNTED_HEALTH")?, file("RELUME_COUNTED_REPORT")?);
    std::thread::sleep(warm_up);
    let first = next_state(&health);
    let begun = Instant::now();
    sites::watch();
    std::thread::sleep(span);
    let took = begun.elapsed();
    let (sites, lost) = sites::watched();
    let frames = next_state(&health) - first;
    let unfinished = into.with_extension("part");
    std::fs::write(&unfinished, report(&sites, lost, frames, took)?)?;
    Ok(std::fs::rename(&unfinished, into)?)
}

fn main() -> ExitCode {
    std::thread::spawn(|| {
        if let Err(error) = count() {
            eprintln!("relume-counted: {error}");
        }
    });
    match relume::cli::run(std::env::args_os().skip(1)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("relume: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
