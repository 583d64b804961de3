//! `relume demo --day`: the built-in scene in a small bake, and a day in fast time over it (`daylong.rs`).

use std::path::Path;
use std::time::Instant;

use relume_bake::bake::{BakeOptions, bake};
use relume_bake::demo_scene;
use relume_bake::response::TransportOptions;

use crate::config::Config;
use crate::daylong::{self, Report};
use crate::failure::{Failure, OrFail};
use crate::outfile::write_whole;
use crate::relight::FieldFile;
use crate::sun::parse_utc;

/// Width and height of the pictures.
const SIZE: (u32, u32) = (120, 80);
/// A day of autumn at the site, and where its clocks stand, seconds east of UTC.
const DATE: &str = "2026-10-02T00:00:00Z";
const EAST_S: f64 = 3.0 * 3600.0;
/// Share of the sky under cloud.
const CLOUD_COVER: f64 = 0.35;

/// Bakes, runs the day and writes `day.json` and `day.png` into the folder `out`, which is made if need be; what it found,
/// in words.
///
/// # Errors
/// [`Failure`]: bad input when `out` cannot be used, a failure at run time for all else.
pub fn fast_day(out: &Path, moments: usize, seed: u64) -> Result<String, Failure> {
    let bad_folder =
        |error| Failure::bad(format!("--out {}: {error}; name a folder that can be written", out.display()));
    std::fs::create_dir_all(out).map_err(bad_folder)?;
    let scratch = tempfile::Builder::new().prefix(".relume-demo-").tempdir_in(out).map_err(bad_folder)?;
    let file = small_field(scratch.path())?;
    let config = post_file(scratch.path(), seed)?;
    let (date, started) = (parse_utc(DATE).or_runtime()?, Instant::now());
    let report = daylong::run(&config, &file.field(), date, moments)?;
    write_whole(&out.join("day.json"), |file| Ok(serde_json::to_writer_pretty(file, &report)?))?;
    daylong::draw(&report, date - EAST_S).save(&out.join("day.png"))?;
    scratch.close().or_runtime()?;
    Ok(words(&report, started.elapsed().as_secs_f64(), out))
}

fn small_field(folder: &Path) -> Result<FieldFile, Failure> {
    let (scene, camera) = demo_scene::temple();
    let options = BakeOptions {
        size: SIZE,
        transport: TransportOptions { paths: 2, sun_paths: 10, ..TransportOptions::default() },
        site: Some(demo_scene::SITE_DEG),
        ..BakeOptions::default()
    };
    let baked = bake(&scene, &camera, &options).or_runtime()?;
    let path = folder.join("temple.field");
    write_whole(&path, |out| std::io::Write::write_all(out, &baked.bytes))?;
    FieldFile::open(&path).or_runtime()
}

/// The post that the day is run with.
fn post_file(folder: &Path, seed: u64) -> Result<Config, Failure> {
    let [latitude, longitude] = demo_scene::SITE_DEG;
    let text = format!(
        "field = 'temple.field'\nsky = 'synthetic'\n[site]\nlatitude = {latitude:?}\nlongitude = {longitude:?}\n\
         [weather]\ncloud_cover = {CLOUD_COVER}\nseed = {seed}\n[display]\nkind = 'headless'\nfolder = '.'\n\
         [run]\nstart = {DATE}\n"
    );
    let path = folder.join("POST.toml");
    std::fs::write(&path, text).or_runtime()?;
    Config::load(&path).or_runtime()
}

fn words(report: &Report, took_s: f64, out: &Path) -> String {
    let per_cent = |[median, worst]: [f64; 2]| format!("median {:.2} %, worst {:.1} %", 100.0 * median, 100.0 * worst);
    format!(
        "{} moments from dawn to dusk in {took_s:.0} s; pictures over a range of 1 to {:.0}\n\
         picture under the camera's light against that under the true sky, relative RMSE: {}\n\
         in sunshine: {}\nthe sky alone: {}\n\
         {} changes of the exposures, {} of them back to what was left just before; {} pictures without light\n\
         {}: day.json, day.png\n",
        report.moments.len(),
        report.brightness_range,
        per_cent(report.error),
        per_cent(report.error_in_sunshine),
        per_cent(report.sky_error),
        report.plan_changes,
        report.flaps,
        report.dark,
        out.display()
    )
}
