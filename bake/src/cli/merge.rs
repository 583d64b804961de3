//! `relume-bake merge`: shares of a plan -> the field.

use super::arguments::{Arguments, scene_and_camera, told};
use super::scene::save;
use super::{HELP, print};
use crate::bake::{BakeError, Baked};
use crate::camera::Camera;
use crate::jobs::{Intake, Jobs, Scenes};
use crate::ledger::{LedgerError, Reader};
use crate::plan::Plan;
use crate::scene::Scene;
use relume_firmware::glue::failure::{Failure, OrFail};
use relume_firmware::glue::outfile::check_writable;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub(super) fn act(parser: &mut lexopt::Parser) -> Result<(), Failure> {
    let Some(arguments) = Arguments::parse(parser)? else { return print(HELP) };
    arguments.only("merge", &["out", "threads", "json", "report"], "all that makes the field is the plan's")?;
    let Some((plan_file, shares)) = arguments.files.split_first() else {
        return Err(super::arguments::missing("merge", "the plan"));
    };
    let out = arguments.out("merge")?;
    let plan = Plan::load(plan_file).or_bad()?;
    let shares = in_order(&plan, shares)?;
    check_writable(out)?;
    let (scene, camera, names) = scene_and_camera(&plan.scene, plan.camera.as_deref(), plan.materials)?;
    plan.check(plan_file, &scene, &camera).map_err(|error| told(error, &names))?;
    let baked = arguments.on_threads(|| join(&plan, &scene, &camera, &shares))?;
    save(out, &baked.map_err(|error| told(error, &names))?, arguments.json, arguments.report.as_deref())
}

/// A share's file and where its tiles begin and end.
struct Share {
    file: PathBuf,
    numbers: std::ops::Range<u32>,
}

/// The shares, sorted; all tiles of the plan are in one of them.
fn in_order(plan: &Plan, files: &[PathBuf]) -> Result<Vec<Share>, Failure> {
    let mut shares = Vec::with_capacity(files.len());
    for file in files {
        let opened = open(file).or_bad()?;
        let reader = Reader::new(file, &opened).or_bad()?;
        if reader.identity != plan.identity {
            return Err(LedgerError::Other(file.clone())).or_bad();
        }
        shares.push(Share { file: file.clone(), numbers: reader.numbers });
    }
    shares.sort_by_key(|share| (share.numbers.start, share.numbers.end));
    let mut end = 0;
    for share in shares.iter().map(|share| &share.numbers).chain([&(plan.tiles..plan.tiles + 1)]) {
        if share.start > end {
            let missing = format!("merge: tiles {end}..{} are in none of the shares; bake them, too", share.start);
            return Err(Failure::bad(missing));
        }
        end = end.max(share.end);
    }
    Ok(shares)
}

fn open(file: &Path) -> Result<File, LedgerError> {
    File::open(file).map_err(|source| LedgerError::Io { file: file.to_owned(), source })
}

fn join(plan: &Plan, scene: &Scene, camera: &Camera, shares: &[Share]) -> Result<Baked, BakeError> {
    let (started, options) = (Instant::now(), plan.options());
    let scenes = Scenes::new(scene);
    let jobs = Jobs::new(&scenes, camera, &options)?;
    let mut intake = Intake::new(&jobs);
    for share in shares {
        let file = open(&share.file)?;
        let mut reader = Reader::new(&share.file, &file)?;
        while let Some(block) = reader.next_block() {
            intake.push(block);
        }
        reader.finish()?;
    }
    intake.finish(jobs, camera, &options, started.elapsed())
}
