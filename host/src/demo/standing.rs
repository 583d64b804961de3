//! `relume demo --standing`: the whole chain against the truth.
//!
//! The built-in site with its temple marked as vanished. Through three days (clear, broken and grey) a path tracer that knows
//! neither patches nor fields draws what a view camera takes of the real site, and what it would take if the temple stood.
//! The post has the first picture, with the camera's noise, and the frames of its sky camera; what it shows is compared with
//! the second. Another renderer's pictures may stand beside the path tracer's (outside.rs).

mod judge;
mod outside;
mod view;

use std::path::Path;

use relume_bake::bake::{BakeOptions, bake};
use relume_bake::camera::Camera;
use relume_bake::demo_scene;
use relume_bake::environment::Reference;
use relume_bake::response::TransportOptions;
use relume_bake::scene::Scene;
use relume_firmware::patches::PatchSet;
use serde::Serialize;

use super::eye::{Eye, Seen};
use super::site::Site;
use crate::damage::Damage;
use crate::exposure::{ExposureControl, ExposureMode};
use crate::failure::{Failure, OrFail};
use crate::outfile::write_whole;
use crate::painter::Painter;
use crate::painter::field::FieldPainter;
use crate::plot::Canvas;
use crate::relight::FieldFile;
use crate::skymodel::Atmosphere;
use crate::sun::{parse_utc, sun_position};
use crate::view::Still;
use crate::weights::PatchWeights;
use judge::{Judgement, difference_map, judge};
use view::{ViewCamera, mean_of};

/// Width and height of the pictures.
const SIZE: (u32, u32) = (240, 160);
/// A day of autumn at the site.
const DATE: &str = "2026-10-02T00:00:00Z";
/// Share of the sky under cloud, and which clouds.
const DAYS: [(&str, f32, u64); 3] = [("clear", 0.0, 1), ("broken", 0.45, 23), ("grey", 1.0, 4)];
/// The sun stands at least so high, degrees.
const LOWEST_DEG: f64 = 4.0;

/// One moment.
#[derive(Clone, Debug, Serialize)]
struct Moment {
    day: &'static str,
    time_utc: String,
    sun_altitude_deg: f64,
    /// Against the built-in path tracer.
    #[serde(flatten)]
    own: Compared,
    /// Against another renderer, whose picture of the real site the post had, too.
    #[serde(skip_serializing_if = "Option::is_none")]
    outside: Option<Compared>,
    /// The two renderers' pictures of the site with its temple.
    #[serde(skip_serializing_if = "Option::is_none")]
    renderers: Option<Judgement>,
}

/// What the post shows against what a renderer draws.
#[derive(Clone, Debug, Serialize)]
struct Compared {
    /// With the light that the sky camera measured.
    camera: Judgement,
    /// With the light of the true sky: what is left is not the sky camera's.
    true_sky: Judgement,
    /// What chance leaves in the truth itself: half the median difference of two path traces whose mean it is.
    noise: f64,
    /// The view's gain, found over true, in the post's own way.
    gain_error: [f64; 3],
}

/// What a renderer draws of a moment: the real site, and twice, by other random numbers, the site with its temple.
struct Drawn {
    real: Reference,
    halves: [Reference; 2],
}

/// When one looks.
struct Hour {
    day: &'static str,
    unix_s: f64,
}

impl Hour {
    /// Day and time of day in UTC, `clear_0800`.
    fn name(&self) -> String {
        let time: String = crate::sun::format_utc(self.unix_s).chars().filter(char::is_ascii_digit).collect();
        format!("{}_{}", self.day, &time[8..12])
    }
}

/// What came of it.
#[derive(Clone, Debug, Serialize)]
struct Report {
    /// Colour differences, CIE DE2000, of covered pixels and of receivers in shadow or reflected light.
    moments: Vec<Moment>,
    /// Median and 95th percentile of the moments' medians and 95th percentiles, and the worst of both.
    median: [f64; 2],
    high: [f64; 2],
}

/// The site as it is and as it was.
struct Standing {
    whole: Scene,
    real: Scene,
    camera: Camera,
    file: FieldFile,
}

impl Standing {
    fn bake(folder: &Path) -> Result<Self, Failure> {
        let (whole, camera) = demo_scene::site();
        let options = BakeOptions {
            size: SIZE,
            transport: TransportOptions { paths: 4, sun_paths: 20, ..TransportOptions::default() },
            site: Some(demo_scene::SITE_DEG),
            ..BakeOptions::default()
        };
        let baked = bake(&whole, &camera, &options).or_runtime()?;
        let path = folder.join("site.field");
        write_whole(&path, |out| std::io::Write::write_all(out, &baked.bytes))?;
        Ok(Standing { real: whole.real(), whole, camera, file: FieldFile::open(&path).or_runtime()? })
    }
}

/// Bakes, runs the days in steps of `step_h` hours and writes `standing.json`, `standing.png` (a row per moment: as it is, as the
/// post shows it, as it would be, colour differences) and `flicker.html` into the folder `out`; what it found, in words.
/// With a folder `truth` of another renderer's pictures only the moments that it drew are run, and pictures show its truth.
///
/// # Errors
/// [`Failure`]: bad input when `out` or `truth` cannot be used, a failure at run time for all else.
pub fn standing(out: &Path, step_h: f64, seed: u64, truth: Option<&Path>) -> Result<String, Failure> {
    let scratch = usable(out)?;
    let site = Standing::bake(scratch.path())?;
    let (mut moments, mut rows) = (Vec::new(), Vec::new());
    through_the_days(*site.file.field().patch_set(), step_h, |eye, hour| {
        let outside = match truth {
            Some(folder) if !outside::is_drawn(folder, &hour) => return Ok(()),
            other => other.map(|folder| outside::drawn(folder, &hour)).transpose()?,
        };
        let (moment, row) = look(&site, eye, &hour, seed, outside)?;
        eprintln!("{} {}: {}", hour.day, moment.time_utc, moment.outside.as_ref().unwrap_or(&moment.own).camera);
        moments.push(moment);
        rows.push(row);
        Ok(())
    })?;
    if moments.is_empty() {
        return Err(outside::nothing_drawn(truth.unwrap_or(out)));
    }
    let report = Report::of(moments);
    write_whole(&out.join("standing.json"), |file| Ok(serde_json::to_writer_pretty(file, &report)?))?;
    strip(&rows).save(&out.join("standing.png"))?;
    flicker(&rows[rows.len() / 6], out)?;
    scratch.close().or_runtime()?;
    Ok(report.words(out))
}

/// Writes into `out` what another renderer needs to draw the moments; in words, what that is.
///
/// # Errors
/// [`Failure`]: bad input when `out` cannot be used, a failure at run time for all else.
pub fn export(out: &Path, step_h: f64) -> Result<String, Failure> {
    usable(out)?.close().or_runtime()?;
    let (scene, camera) = demo_scene::site();
    let patches = PatchSet::new(BakeOptions::default().directions).or_runtime()?;
    let mut skies = Vec::new();
    through_the_days(patches, step_h, |eye, hour| {
        skies.push(outside::write_sky(out, &hour, &eye.look(hour.unix_s)?.truth)?);
        Ok(())
    })?;
    outside::write_site(out, &scene, &camera, &skies)
}

/// Makes the folder `out`; a folder in it that goes with its value.
fn usable(out: &Path) -> Result<tempfile::TempDir, Failure> {
    let bad_folder =
        |error| Failure::bad(format!("--out {}: {error}; name a folder that can be written", out.display()));
    std::fs::create_dir_all(out).map_err(bad_folder)?;
    tempfile::Builder::new().prefix(".relume-demo-").tempdir_in(out).map_err(bad_folder)
}

/// Every moment of the days at which the sun stands high enough.
fn through_the_days(
    patches: PatchSet,
    step_h: f64,
    mut see: impl FnMut(&mut Eye, Hour) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let midnight = parse_utc(DATE).or_runtime()?;
    for (day, cloud_cover, cloud_seed) in DAYS {
        let atmosphere = Atmosphere { cloud_cover, cloud_seed, ..Atmosphere::default() };
        let mut eye = Eye::new(Site::place(), atmosphere, patches, midnight)?;
        for step in 0..(24.0 / step_h) as u32 {
            let unix_s = midnight + f64::from(step) * step_h * 3600.0;
            if sun_position(unix_s, Site::place()).or_runtime()?.altitude_deg >= LOWEST_DEG {
                see(&mut eye, Hour { day, unix_s })?;
            }
        }
    }
    Ok(())
}

/// The pictures of a moment: as it is, as the post shows it, as it would be.
type Row = [Vec<u32>; 3];

fn look(
    site: &Standing,
    eye: &mut Eye,
    hour: &Hour,
    seed: u64,
    outside: Option<Drawn>,
) -> Result<(Moment, Row), Failure> {
    let seen = eye.look(hour.unix_s)?;
    let camera = ViewCamera::exposed(&seen.truth, &site.camera, seed ^ hour.unix_s as u64);
    let traced = |scene, paths| camera.trace(scene, paths).or_runtime();
    let drawn = Drawn { real: traced(&site.real, 0)?, halves: [traced(&site.whole, 1)?, traced(&site.whole, 2)?] };
    let (own, own_row) = compare(site, &camera, &seen, &drawn)?;
    let other = outside.map(|other| Ok::<_, Failure>((compare(site, &camera, &seen, &other)?, other))).transpose()?;
    let renderers = other.as_ref().map(|((_, row), _)| {
        let whole = mean_of(&drawn.halves[0], &drawn.halves[1]);
        judge(&own_row[2], &row[2], (&drawn.real, &whole), site.file.field())
    });
    let (outside, row) = match other {
        Some(((compared, row), _)) => (Some(compared), row),
        None => (None, own_row),
    };
    let time_utc = crate::sun::format_utc(hour.unix_s);
    let sun_altitude_deg = seen.sun.altitude_deg;
    Ok((Moment { day: hour.day, time_utc, sun_altitude_deg, own, outside, renderers }, row))
}

/// What the post makes of the real site as it is drawn, against the site with its temple as it is drawn.
fn compare(site: &Standing, camera: &ViewCamera<'_>, seen: &Seen, drawn: &Drawn) -> Result<(Compared, Row), Failure> {
    let Drawn { real, halves } = drawn;
    let whole = mean_of(&halves[0], &halves[1]);
    let (as_it_is, as_it_would_be) = (camera.picture(real, true), camera.picture(&whole, false));
    let true_weights = seen.truth.weights(site.file.field().patch_set());
    let (by_camera, _) = show(site, &as_it_is, &seen.weights)?;
    let (by_truth, gain) = show(site, &as_it_is, &true_weights)?;
    let judged = |a: &[u32], b: &[u32]| judge(a, b, (real, &whole), site.file.field());
    let [first, second] = halves.each_ref().map(|half| camera.picture(half, false));
    let compared = Compared {
        camera: judged(&by_camera, &as_it_would_be),
        true_sky: judged(&by_truth, &as_it_would_be),
        noise: 0.5 * judged(&first, &second).median,
        gain_error: std::array::from_fn(|c| gain[c] / camera.gains()[c] - 1.0),
    };
    Ok((compared, [as_it_is, by_camera, as_it_would_be]))
}

/// What the post shows over a view, and the view's gain.
fn show(site: &Standing, view: &[u32], weights: &PatchWeights) -> Result<(Vec<u32>, [f64; 3]), Failure> {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let still = Still { width, height, pixels_bgrx: view.to_vec() };
    let mut painter = FieldPainter::new(site.file.field(), still, 0);
    painter.show_receivers(site.file.receivers());
    let mut control = ExposureControl::new(ExposureMode::View);
    painter.relight(weights, 1.0).or_runtime()?;
    let gain = painter.view_gain().map(|seen| seen.gain);
    control.see_gain(gain);
    let mut balanced = weights.clone();
    balanced.set_tinted(weights, control.colour());
    painter.relight(&balanced, control.factor()).or_runtime()?;
    painter.draw(&mut Damage::none(width, height)).or_runtime()?;
    Ok((painter.pixels_bgrx().to_vec(), gain.unwrap_or([f64::NAN; 3])))
}

impl Report {
    fn of(moments: Vec<Moment>) -> Self {
        let of = |pick: fn(&Judgement) -> f64| middle_and_worst(moments.iter().map(|moment| pick(&moment.own.camera)));
        Report { median: of(|j| j.median), high: of(|j| j.high), moments }
    }

    fn words(&self, out: &Path) -> String {
        let [median, high] = [self.median, self.high];
        let outside: Vec<(&str, &Compared)> =
            self.moments.iter().filter_map(|moment| Some((moment.day, moment.outside.as_ref()?))).collect();
        let own: Vec<(&str, &Compared)> = self.moments.iter().map(|moment| (moment.day, &moment.own)).collect();
        format!(
            "colour differences (DE2000) of covered pixels and shadowed receivers: median {:.2} (worst moment {:.2}), 95 % {:.2} ({:.2})\n\
             {}{}{}: standing.json, standing.png, flicker.html\n",
            median[0],
            median[1],
            high[0],
            high[1],
            days_in_words(&own),
            self.outside_in_words(&outside),
            out.display()
        )
    }

    fn outside_in_words(&self, outside: &[(&str, &Compared)]) -> String {
        if outside.is_empty() {
            return String::new();
        }
        let of = |pick: fn(&Judgement) -> f64| middle_and_worst(outside.iter().map(|(_, found)| pick(&found.camera)));
        let apart = |pick: fn(&Judgement) -> f64| {
            middle_and_worst(self.moments.iter().filter_map(|moment| moment.renderers.as_ref()).map(pick))
        };
        let ([median, high], [apart, blocks]) =
            ([of(|j| j.median), of(|j| j.high)], [apart(|j| j.median), apart(|j| j.median_of_blocks)]);
        format!(
            "against the other renderer: median {:.2} (worst moment {:.2}), 95 % {:.2} ({:.2}); the two renderers differ by {:.2}, of \
             4x4 pixels by {:.2}\n{}",
            median[0],
            median[1],
            high[0],
            high[1],
            apart[0],
            blocks[0],
            days_in_words(outside)
        )
    }
}

/// Of figures, one per moment.
fn middle_and_worst(figures: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut all: Vec<f64> = figures.collect();
    all.sort_by(f64::total_cmp);
    [all[all.len() / 2], all[all.len() - 1]]
}

/// The worst of each day.
fn days_in_words(moments: &[(&str, &Compared)]) -> String {
    let of_day = |day: &str| {
        let own = || moments.iter().filter(move |moment| moment.0 == day).map(|moment| moment.1);
        let worst = |pick: &dyn Fn(&Compared) -> f64| own().map(pick).fold(0.0, f64::max);
        format!(
            "{day}: {} moments; worst median {:.2}, worst 95 % {:.2}; under the true sky {:.2}, {:.2}; of 4x4 pixels {:.2}, {:.2}; \
             noise of the truth {:.2}; gain off by {:.1} % at most\n",
            own().count(),
            worst(&|m| m.camera.median),
            worst(&|m| m.camera.high),
            worst(&|m| m.true_sky.median),
            worst(&|m| m.true_sky.high),
            worst(&|m| m.camera.median_of_blocks),
            worst(&|m| m.camera.high_of_blocks),
            worst(&|m| m.noise),
            100.0 * worst(&|m| m.gain_error.iter().fold(0.0, |most, error| error.abs().max(most)))
        )
    };
    let days = DAYS.iter().map(|(day, ..)| *day).filter(|day| moments.iter().any(|moment| moment.0 == *day));
    days.map(of_day).collect()
}

fn canvas(pixels: &[u32]) -> Canvas {
    Canvas::from_xrgb(SIZE.0, SIZE.1, pixels)
}

/// A row per moment: as it is, as shown, as it would be, and how far the latter two differ.
fn strip(rows: &[Row]) -> Canvas {
    let mut strip =
        Canvas::new(4 * SIZE.0, rows.len() as u32 * SIZE.1, embedded_graphics::pixelcolor::Rgb888::new(0, 0, 0));
    for (y, [real, shown, truth]) in (0u32..).zip(rows) {
        for (x, picture) in (0u32..).zip([real, shown, truth, &difference_map(shown, truth)]) {
            strip.paste(&canvas(picture), x * SIZE.0, y * SIZE.1);
        }
    }
    strip
}

/// A page that changes between what is shown and what would be, twice a second.
fn flicker([_, shown, truth]: &Row, out: &Path) -> Result<(), Failure> {
    canvas(shown).save(&out.join("flicker_shown.png"))?;
    canvas(truth).save(&out.join("flicker_truth.png"))?;
    let page = "<!doctype html><meta charset=\"utf-8\"><title>Shown and true, in turn</title><style>body{background:#222;margin:2em}\
                div{position:relative}img{position:absolute;width:960px;image-rendering:pixelated}\
                img+img{animation:turn 1s steps(1) infinite}@keyframes turn{50%{opacity:0}}</style>\
                <div><img src=\"flicker_truth.png\" alt=\"true\"><img src=\"flicker_shown.png\" alt=\"shown\"></div>\n";
    write_whole(&out.join("flicker.html"), |file| std::io::Write::write_all(file, page.as_bytes()))?;
    Ok(())
}
