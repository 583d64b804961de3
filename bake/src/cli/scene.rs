//! `relume-bake scene`: a whole bake, or a share of a plan.

use super::arguments::{Arguments, missing, scene_and_camera, told};
use super::{HELP, print};
use crate::bake::{BakeOptions, Baked, LedgerOptions, bake};
use crate::effort::Goal;
use crate::jobs::{Jobs, Scenes};
use crate::ledger::Ledger;
use crate::plan::Plan;
use crate::reportpage::{self, Subject};
use crate::survey::Notice;
use crate::write;
use relume_firmware::field::Field;
use relume_firmware::glue::failure::{Failure, OrFail};
use relume_firmware::glue::outfile::check_writable;
use std::path::{Path, PathBuf};

pub(super) fn act(parser: &mut lexopt::Parser) -> Result<(), Failure> {
    let Some(arguments) = Arguments::parse(parser)? else { return print(HELP) };
    match &arguments.plan {
        Some(plan) => bake_share(&arguments, plan),
        None if arguments.tiles.is_some() => Err(Failure::bad("--tiles goes with --plan PLAN.toml")),
        None => bake_whole(&arguments),
    }
}

/// Tells what is seldom meant.
pub(super) fn tell(notice: &Notice) {
    eprintln!("notice: {notice}");
}

/// The file that an unfinished one grows in.
fn part_of(out: &Path) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

fn bake_whole(arguments: &Arguments) -> Result<(), Failure> {
    let (scene, out) = (arguments.scene("scene")?, arguments.out("scene")?);
    let mut options = BakeOptions { notify: Some(tell), ..arguments.options("scene")? };
    if options.stack_sun.is_some() && options.stack.is_none() {
        return Err(Failure::bad("--sun goes with --stack DIR: it asks for the stack's sun.exr"));
    }
    if options.stack.is_some() && arguments.resume {
        return Err(Failure::bad("--resume does not go with --stack: a stack is baked in one go"));
    }
    if arguments.resume && matches!(arguments.goal, Some(Goal::Time(_))) {
        return Err(Failure::bad(
            "--resume does not go with --time: each run would choose another sampling; use --noise",
        ));
    }
    check_writable(out)?;
    options.preview.as_deref().map(check_writable).transpose()?;
    let (scene, camera, names) = scene_and_camera(scene, arguments.camera.as_deref(), arguments.shading)?;
    if options.stack.is_none() && !is_device(out) {
        options.ledger = Some(LedgerOptions { path: part_of(out), resume: arguments.resume });
    }
    let options = arguments.sampled((&scene, &camera, &names), options)?;
    let baked = arguments.on_threads(|| bake(&scene, &camera, &options))?;
    let baked = baked.map_err(|error| told(error, &names))?;
    save(out, &baked, arguments.json, arguments.report.as_deref())?;
    if let Some(kept) = &options.ledger {
        // The field is there: what is left of it in parts is of no use, and in nobody's way.
        let _ = std::fs::remove_file(&kept.path);
    }
    Ok(())
}

/// A device or a pipe has no neighbour to keep blocks in.
fn is_device(out: &Path) -> bool {
    std::fs::metadata(out).is_ok_and(|meta| !meta.is_file())
}

/// Writes a field, and a page about it into a folder if there is to be one, and tells about it.
pub(super) fn save(out: &Path, baked: &Baked, json: bool, folder: Option<&Path>) -> Result<(), Failure> {
    let report = &baked.report;
    write::save(out, &baked.bytes)?;
    if json {
        print(&format!("{}\n", report.to_json()))?;
    }
    eprintln!(
        "{}: {} bytes, rank {:.1} on average and {} at most, {:.1} bytes per covered pixel, {:.0} s",
        out.display(),
        baked.bytes.len(),
        report.rank_mean,
        report.rank_max,
        report.bytes_per_covered_pixel,
        report.seconds
    );
    folder.map(|folder| page(folder, out, baked)).transpose()?;
    Ok(())
}

/// Writes the page about a field that is saved as `out`.
fn page(folder: &Path, out: &Path, baked: &Baked) -> Result<(), Failure> {
    let name = out.display().to_string();
    let field = Field::new(&baked.bytes).or_runtime()?;
    let Baked { report, exact, light, .. } = baked;
    let written = reportpage::write(folder, &Subject { field: &field, name: &name, report, exact, light });
    written.or_runtime()?;
    eprintln!("{}", folder.join("index.html").display());
    Ok(())
}

fn bake_share(arguments: &Arguments, plan_file: &Path) -> Result<(), Failure> {
    const WHY: &str =
        "scene, camera, size, patches and sampling are the plan's, and a share has no stack, page or preview";
    arguments.only("scene --plan", &["plan", "tiles", "out", "resume", "threads"], WHY)?;
    if let Some(file) = arguments.files.first() {
        return Err(Failure::bad(format!("scene --plan: {} is one file too many: {WHY}", file.display())));
    }
    let out = arguments.out("scene")?;
    let numbers = arguments.tiles.clone().ok_or_else(|| missing("scene --plan", "--tiles A..B"))?;
    let plan = Plan::load(plan_file).or_bad()?;
    if numbers.end > plan.tiles {
        let (end, tiles) = (numbers.end, plan.tiles);
        return Err(Failure::bad(format!("--tiles: {end} is beyond the plan's {tiles} tiles (0..{tiles})")));
    }
    check_writable(out)?;
    let options = BakeOptions { progress: arguments.options.progress, ..plan.options() };
    let (scene, camera, names) = scene_and_camera(&plan.scene, plan.camera.as_deref(), plan.materials)?;
    plan.check(plan_file, &scene, &camera).map_err(|error| told(error, &names))?;
    let share = (plan.identity, numbers.clone());
    let mut ledger =
        Ledger::open(&part_of(out), share, arguments.resume, |_| ()).map_err(|error| told(error.into(), &names))?;
    let baked = arguments.on_threads(|| {
        let scenes = Scenes::new(&scene);
        let jobs = Jobs::new(&scenes, &camera, &options)?;
        jobs.run(ledger.next()..numbers.end, options.progress, |block| Ok(ledger.append(&block)?))
    })?;
    baked.map_err(|error| told(error, &names))?;
    ledger.rename(out).map_err(|error| told(error.into(), &names))?;
    eprintln!("{}: tiles {}..{} of {}", out.display(), numbers.start, numbers.end, plan.tiles);
    Ok(())
}
