//! `relume demo --standing`: the whole chain against the truth.
//!
//! The built-in site with its temple marked as vanished. Through three days (clear, broken and grey) a path tracer that knows
//! neither patches nor fields draws what a view camera takes of the real site through its lens, and what it would take if the
//! temple stood. The post is opened from files as `relume run` opens it, and its loop runs through the day: the field is baked for
//! the camera as marks on its still tell (measured.rs), the view is the first picture in the camera's own response, with its
//! noise, exposure and white balance (view.rs), the light comes of the frames of its sky camera. What it shows is compared with
//! the second picture. Another renderer's pictures may stand beside the path tracer's (outside.rs); those are through a pinhole,
//! which every renderer has.

mod film;
mod judge;
mod measured;
mod opened;
mod outside;
mod passing;
mod pictures;
mod report;
#[cfg(test)]
mod tests;
mod vanished;
mod view;

use std::path::Path;

use relume_bake::demo_scene;
use relume_bake::environment::Reference;

use super::site::Site;
use crate::config::{SkyKind, Weather};
use crate::failure::{Failure, OrFail};
use crate::outfile::write_whole;
use crate::sky_source::simulated::atmosphere;
use crate::skymodel::SkyModel;
use crate::sun::{format_utc, parse_utc, sun_position};
use judge::judge;
use opened::{Running, Shown, shown};
pub use passing::passing;
use report::{Compared, Moment, Report};
use vanished::Vanished;
use view::{ViewCamera, mean_of};

/// A day of autumn at the site.
const DATE: &str = "2026-10-02T00:00:00Z";
/// Share of the sky under cloud, and which clouds.
const DAYS: [(&str, f64, u64); 3] = [("clear", 0.0, 1), ("broken", 0.45, 23), ("grey", 1.0, 4)];
/// Haze of a fine day.
const TURBIDITY: f64 = 3.0;
/// The sun stands at least so high, degrees.
const LOWEST_DEG: f64 = 4.0;

/// What the study costs.
#[derive(Clone, Copy)]
struct Effort {
    /// Width and height of the pictures.
    size: (u32, u32),
    /// Paths per pixel of each trace.
    samples: u32,
    /// Paths per pixel and patch of the bake, and its rays to the sun.
    bake_paths: (u32, u32),
}

impl Effort {
    const FULL: Effort = Effort { size: (240, 160), samples: 176, bake_paths: (4, 20) };
}

/// What is before the view camera's sensor.
#[derive(Clone, Copy)]
enum Lens {
    Pinhole,
    /// One that the installer has measured.
    Distorting,
}

/// What a renderer draws of a moment: the real site, and twice, by other random numbers, the site with its temple.
struct Drawn {
    real: Reference,
    halves: [Reference; 2],
}

/// A day's sky.
struct Day {
    name: &'static str,
    weather: Weather,
}

impl Day {
    fn all() -> impl Iterator<Item = Day> {
        let weather = |cloud_cover, seed| Weather { turbidity: TURBIDITY, cloud_cover, seed };
        DAYS.into_iter().map(move |(name, cover, seed)| Day { name, weather: weather(cover, seed) })
    }

    /// The true sky.
    fn sky(&self, unix_s: f64) -> Result<SkyModel, Failure> {
        SkyModel::at(atmosphere(Site::in_config(), self.weather), unix_s, Site::place(), 0.0).or_runtime()
    }

    /// Every `step_s` seconds while the sun stands high enough.
    fn hours(&self, step_s: f64) -> Result<Vec<Hour>, Failure> {
        let midnight = parse_utc(DATE).or_runtime()?;
        let mut hours = Vec::new();
        for step in 0..(24.0 * 3600.0 / step_s) as u32 {
            let unix_s = midnight + f64::from(step) * step_s;
            if sun_position(unix_s, Site::place()).or_runtime()?.altitude_deg >= LOWEST_DEG {
                hours.push(Hour { day: self.name, unix_s });
            }
        }
        Ok(hours)
    }
}

/// When one looks.
#[derive(Clone, Copy)]
struct Hour {
    day: &'static str,
    unix_s: f64,
}

impl Hour {
    /// Day and time of day in UTC, `clear_0800`.
    fn name(&self) -> String {
        let time: String = format_utc(self.unix_s).chars().filter(char::is_ascii_digit).collect();
        format!("{}_{}", self.day, &time[8..12])
    }
}

/// The pictures of a moment, sRGB.
struct Row {
    day: &'static str,
    /// As it is.
    real: Vec<u32>,
    /// As the post shows it.
    shown: Vec<u32>,
    /// As it would be.
    truth: Vec<u32>,
}

/// Bakes, runs a post through the days in steps of `step_h` hours and writes `standing.json`, `standing.png` (a row per moment: as it
/// is, as the post shows it, as it would be, colour differences) and `flicker.html` into the folder `out`; what it found, in words.
/// With a folder `truth` of another renderer's pictures only the moments that it drew are run, and pictures show its truth.
///
/// # Errors
/// [`Failure`]: bad input when `out` or `truth` cannot be used, a failure at run time for all else.
pub fn standing(out: &Path, step_h: f64, seed: u64, truth: Option<&Path>) -> Result<String, Failure> {
    let effort = Effort::FULL;
    let (report, rows) = study(out, effort, step_h * 3600.0, seed, truth)?;
    write_whole(&out.join("standing.json"), |file| Ok(serde_json::to_writer_pretty(file, &report)?))?;
    pictures::strip(&rows, effort.size).save(&out.join("standing.png"))?;
    pictures::flicker(&rows, effort.size, out)?;
    Ok(report.words(out))
}

/// Writes into `out` what another renderer needs to draw the moments; in words, what that is.
///
/// # Errors
/// [`Failure`]: bad input when `out` cannot be used, a failure at run time for all else.
pub fn export(out: &Path, step_h: f64) -> Result<String, Failure> {
    usable(out)?.close().or_runtime()?;
    let (scene, camera) = demo_scene::site();
    let mut skies = Vec::new();
    for day in Day::all() {
        for hour in day.hours(step_h * 3600.0)? {
            skies.push(outside::write_sky(out, &hour, &day.sky(hour.unix_s)?)?);
        }
    }
    outside::write_site(out, Effort::FULL.size, (&scene, &camera), &skies)
}

/// Makes the folder `out`; a folder in it that goes with its value.
fn usable(out: &Path) -> Result<tempfile::TempDir, Failure> {
    let bad_folder =
        |error| Failure::bad(format!("--out {}: {error}; name a folder that can be written", out.display()));
    std::fs::create_dir_all(out).map_err(bad_folder)?;
    tempfile::Builder::new().prefix(".relume-demo-").tempdir_in(out).map_err(bad_folder)
}

/// The study itself; nothing of it stays in `out`.
fn study(
    out: &Path,
    effort: Effort,
    step_s: f64,
    seed: u64,
    truth: Option<&Path>,
) -> Result<(Report, Vec<Row>), Failure> {
    let scratch = usable(out)?;
    let lens = if truth.is_some() { Lens::Pinhole } else { Lens::Distorting };
    let site = Vanished::bake(scratch.path(), &effort, lens, seed)?;
    let look = Look { site: &site, folder: scratch.path(), effort, step_s, seed, truth };
    let (mut moments, mut rows) = (Vec::new(), Vec::new());
    for day in Day::all() {
        let drawn = |hour: &Hour| truth.is_none_or(|folder| outside::is_drawn(folder, hour));
        let hours: Vec<Hour> = day.hours(step_s)?.into_iter().filter(drawn).collect();
        // A post runs on through moments that follow each other.
        for hours in hours.chunk_by(|a, b| b.unix_s - a.unix_s < 1.5 * step_s) {
            for (moment, row) in look.through(&day, hours)? {
                eprintln!(
                    "{} {}: {}",
                    moment.day,
                    moment.time_utc,
                    moment.outside.as_ref().unwrap_or(&moment.own).camera
                );
                moments.push(moment);
                rows.push(row);
            }
        }
    }
    if moments.is_empty() {
        return Err(outside::nothing_drawn(truth.unwrap_or(out)));
    }
    let report = Report::of(moments, site.reprojection_px);
    scratch.close().or_runtime()?;
    Ok((report, rows))
}

/// How moments are looked at.
struct Look<'l> {
    site: &'l Vanished,
    /// Holds the site's field, and takes the post's files.
    folder: &'l Path,
    effort: Effort,
    step_s: f64,
    seed: u64,
    truth: Option<&'l Path>,
}

impl Look<'_> {
    /// Moments that one run of a post shows.
    fn through(&self, day: &Day, hours: &[Hour]) -> Result<Vec<(Moment, Row)>, Failure> {
        let cameras: Result<Vec<ViewCamera<'_>>, Failure> = hours.iter().map(|hour| self.camera(day, hour)).collect();
        let cameras = cameras?;
        let drawn: Result<Vec<Drawn>, Failure> = cameras.iter().map(|camera| self.draw(camera)).collect();
        let drawn = drawn?;
        let own = self.compare(day, hours, &cameras, &drawn)?;
        let others = match self.truth {
            Some(folder) => {
                let others = hours.iter().map(|hour| outside::drawn(folder, hour, self.effort.size));
                self.compare(day, hours, &cameras, &others.collect::<Result<Vec<_>, _>>()?)?
                    .into_iter()
                    .map(Some)
                    .collect()
            }
            None => hours.iter().map(|_| None).collect::<Vec<_>>(),
        };
        let mut found = Vec::new();
        for (((hour, drawn), own), other) in hours.iter().zip(&drawn).zip(own).zip(others) {
            found.push(self.moment(hour, drawn, own, other)?);
        }
        Ok(found)
    }

    fn camera(&self, day: &Day, hour: &Hour) -> Result<ViewCamera<'_>, Failure> {
        let seed = self.seed.wrapping_mul(1_000_003) ^ hour.unix_s as u64 ^ day.weather.seed << 40;
        Ok(ViewCamera::exposed(day.sky(hour.unix_s)?, &self.site.camera, seed))
    }

    fn draw(&self, camera: &ViewCamera<'_>) -> Result<Drawn, Failure> {
        let Effort { size, samples, .. } = self.effort;
        let traced = |scene, paths| camera.trace(scene, (size, samples), paths).or_runtime();
        let Vanished { real, whole, .. } = self.site;
        Ok(Drawn { real: traced(real, 0)?, halves: [traced(whole, 1)?, traced(whole, 2)?] })
    }

    /// What the post makes of the real site as it is drawn, against the site with its temple as it is drawn.
    fn compare(
        &self,
        day: &Day,
        hours: &[Hour],
        cameras: &[ViewCamera<'_>],
        drawn: &[Drawn],
    ) -> Result<Vec<(Compared, Row)>, Failure> {
        let views: Vec<Vec<u32>> =
            cameras.iter().zip(drawn).map(|(camera, drawn)| camera.picture(&drawn.real)).collect();
        let running = Running { start_unix_s: hours[0].unix_s, step_s: self.step_s };
        let show = |sky| shown(self.folder, (day, sky), running, (&views, self.effort.size));
        let (by_camera, by_truth) = (show(SkyKind::Synthetic)?, show(SkyKind::Simulated)?);
        let moments = cameras.iter().zip(drawn).zip(by_camera.into_iter().zip(&by_truth));
        Ok(moments.map(|((camera, drawn), shown)| self.judged(day, (camera, drawn), shown)).collect())
    }

    /// One frame under the light that the sky camera measured and one under the true sky against the truth.
    fn judged(
        &self,
        day: &Day,
        (camera, drawn): (&ViewCamera<'_>, &Drawn),
        (by_camera, by_truth): (Shown, &Shown),
    ) -> (Compared, Row) {
        let whole = mean_of(&drawn.halves[0], &drawn.halves[1]);
        let truth = camera.ideal(&whole);
        let against = |a: &[u32], b: &[u32]| judge(a, b, (&drawn.real, &whole), &self.site.covered);
        let [first, second] = drawn.halves.each_ref().map(|half| camera.ideal(half));
        let noise = against(&first, &second);
        // The light is relit in the view's colours.
        let true_light = camera.light_sum(self.site.file.field().patch_set());
        let tint = |c: usize| by_truth.light[c] / true_light[c];
        let compared = Compared {
            camera: against(&by_camera.pixels_bgrx, &truth),
            true_sky: against(&by_truth.pixels_bgrx, &truth),
            noise: 0.5 * noise.median,
            noise_of_blocks: 0.5 * noise.median_of_blocks,
            gain_error: std::array::from_fn(|c| by_truth.exposure * tint(c) / camera.gains[c] - 1.0),
        };
        let (real, shown) = (camera.ideal(&drawn.real), by_camera.pixels_bgrx);
        (compared, Row { day: day.name, real, shown, truth })
    }

    fn moment(
        &self,
        hour: &Hour,
        drawn: &Drawn,
        (own, own_row): (Compared, Row),
        other: Option<(Compared, Row)>,
    ) -> Result<(Moment, Row), Failure> {
        let renderers = other.as_ref().map(|(_, row)| {
            let whole = mean_of(&drawn.halves[0], &drawn.halves[1]);
            judge(&own_row.truth, &row.truth, (&drawn.real, &whole), &self.site.covered)
        });
        let (outside, row) = match other {
            Some((compared, row)) => (Some(compared), row),
            None => (None, own_row),
        };
        let moment = Moment {
            day: hour.day,
            time_utc: format_utc(hour.unix_s),
            sun_altitude_deg: sun_position(hour.unix_s, Site::place()).or_runtime()?.altitude_deg,
            clipped: clipped(&row.real),
            own,
            outside,
            renderers,
        };
        Ok((moment, row))
    }
}

/// Share of the channel values that are white.
fn clipped(pixels: &[u32]) -> f64 {
    let white = |word: &u32| word.to_be_bytes()[1..].iter().filter(|&&code| code == 255).count();
    pixels.iter().map(white).sum::<usize>() as f64 / (3 * pixels.len().max(1)) as f64
}
