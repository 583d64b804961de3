//! A cloud passes before the sun: what the post's exposure and its picture do, frame by frame.
//!
//! The view camera keeps its exposure, so that the view's gain is one number. The post's is not: where its light is late by a series
//! of the sky camera, or tells too much or too little of the sun beside a cloud's edge, the gain makes up for that, so that the
//! temple stays as bright as the ground around it. So it is the picture that is judged: the mean light of the temple over
//! the true one, as shown, and as it would be with the true gain.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::opened::{Running, Shown, shown};
use super::vanished::Vanished;
use super::view::ViewCamera;
use super::{Day, Effort, Lens, TURBIDITY, usable};
use crate::clouds::Clouds;
use crate::config::{SkyKind, Weather};
use crate::demo::site::Site;
use crate::failure::{Failure, OrFail};
use crate::map::luminance;
use crate::outfile::write_whole;
use crate::picture::srgb_linear;
use crate::plot::{Axis, Canvas, Chart, Series};
use crate::sky_source::simulated::atmosphere;
use crate::sun::{dir_world, format_utc, parse_utc, sun_position};

/// From series to series, and how much older than the view the light is.
const STEP_S: f64 = 3.0;
const LATE_S: f64 = 1.5;
/// Seconds that a passage takes, of which the first are sunny.
const LASTS_S: f64 = 150.0;
const SUNNY_S: f64 = 15.0;
/// Shares of the clear sky's beam: less is a cloud before the sun, more is none.
const CLOUDED: f64 = 0.1;
const SUNNY: f64 = 0.95;
/// Share of the sky under cloud.
const COVER: f64 = 0.35;
/// From when on passages are looked for, in steps of half of [`SUNNY_S`]; and under how many clouds, one after the other.
const BEGIN: &str = "2026-10-02T07:00:00Z";
const STARTS: usize = 2880;
const SEEDS: u64 = 40;

/// What the study costs.
const EFFORT: Effort = Effort { size: (96, 64), samples: 12, bake_paths: (2, 10) };

/// One frame.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Frame {
    /// Seconds since the first.
    second: f64,
    /// Share of the clear sky's beam in the view.
    beam: f64,
    /// The gain that the post uses over the view's, green.
    gain: f64,
    /// Mean light of the temple as shown, over the true one.
    temple: f64,
    /// The same if the gain were the view's.
    temple_at_true_gain: f64,
}

/// One passage.
#[derive(Clone, Debug, Serialize)]
struct Passage {
    clouds: u64,
    start_utc: String,
    /// By the light that the sky camera measures.
    frames: Vec<Frame>,
    /// By the light of the true sky, as late.
    true_sky: Vec<Frame>,
}

/// What passages do to a figure that should stay 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Swing {
    /// Least and most.
    range: [f64; 2],
    /// Largest change from a frame to the next, as a share.
    jump: f64,
    /// Mean distance from 1.
    mean_off: f64,
}

impl Swing {
    fn of(passages: &[&[Frame]], pick: fn(&Frame) -> f64) -> Self {
        let mut swing = Swing { range: [f64::INFINITY, 0.0], jump: 0.0, mean_off: 0.0 };
        let count = passages.iter().map(|frames| frames.len()).sum::<usize>().max(1) as f64;
        for frames in passages {
            let values: Vec<f64> = frames.iter().map(pick).collect();
            for &value in &values {
                swing.range = [swing.range[0].min(value), swing.range[1].max(value)];
                swing.mean_off += (value - 1.0).abs() / count;
            }
            let jumps = values.windows(2).map(|pair| (pair[1] / pair[0] - 1.0).abs());
            swing.jump = jumps.fold(swing.jump, f64::max);
        }
        swing
    }
}

impl fmt::Display for Swing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Swing { range: [least, most], jump, mean_off } = self;
        let [least, most, jump, mean_off] = [least - 1.0, most - 1.0, *jump, *mean_off].map(|share| 100.0 * share);
        write!(f, "{least:+.1} to {most:+.1} %, mean {mean_off:.1}, {jump:.1} from a frame to the next")
    }
}

/// Runs posts through `count` passages and writes `passing.json` and `passing.png` into the folder `out`; what they did, in words.
///
/// # Errors
/// [`Failure`]: bad input when `out` cannot be used, a failure at run time for all else.
pub fn passing(out: &Path, count: usize, seed: u64) -> Result<String, Failure> {
    let scratch = usable(out)?;
    let site = Vanished::bake(scratch.path(), &EFFORT, Lens::Pinhole, seed)?;
    let mut passages: Vec<Passage> = Vec::new();
    for number in 0..count as u64 {
        let clouds = passages.last().map_or(1000 * seed, |last| last.clouds + 1);
        let taken = Taken::of(&site, EFFORT, STEP_S, clouds)?;
        let passage = Passage {
            clouds: taken.day.weather.seed,
            start_utc: format_utc(taken.start_unix_s),
            frames: taken.shown(scratch.path(), &site, SkyKind::Synthetic)?,
            true_sky: taken.shown(scratch.path(), &site, SkyKind::Simulated)?,
        };
        eprintln!("passage {}, {}: {}", number + 1, passage.start_utc, told(&[&passage.frames]));
        passages.push(passage);
    }
    scratch.close().or_runtime()?;
    write_whole(&out.join("passing.json"), |file| Ok(serde_json::to_writer_pretty(file, &passages)?))?;
    draw(&passages).save(&out.join("passing.png"))?;
    let of = |pick: fn(&Passage) -> &[Frame]| told(&passages.iter().map(pick).collect::<Vec<_>>());
    Ok(format!(
        "{count} clouds before the sun, off the truth\nby the sky camera's light: {}\nby the true light, as late: {}\n{}: passing.json, passing.png\n",
        of(|passage| &passage.frames),
        of(|passage| &passage.true_sky),
        out.display()
    ))
}

fn told(passages: &[&[Frame]]) -> String {
    let swing = |pick| Swing::of(passages, pick);
    format!(
        "gain {}; temple's light {}; that at the true gain {}",
        swing(|frame| frame.gain),
        swing(|frame| frame.temple),
        swing(|frame| frame.temple_at_true_gain)
    )
}

/// A chart per passage.
fn draw(passages: &[Passage]) -> Canvas {
    let (width, height) = (900, 320);
    let white = embedded_graphics::pixelcolor::Rgb888::new(255, 255, 255);
    let mut sheet = Canvas::new(width, height * passages.len() as u32, white);
    for (row, passage) in (0u32..).zip(passages) {
        let line = |name: &str, pick: fn(&Frame) -> f64| {
            Series::line(name, passage.frames.iter().map(|frame| (frame.second, pick(frame))).collect())
        };
        let chart =
            Chart::new(&passage.start_utc, Axis::linear("s"), Axis::linear("over the truth").with_range(0.0, 2.0))
                .with(line("beam that passes", |frame| frame.beam))
                .with(line("gain", |frame| frame.gain))
                .with(line("temple's light", |frame| frame.temple))
                .with(line("at the true gain", |frame| frame.temple_at_true_gain));
        sheet.paste(&chart.draw(width, height), 0, row * height);
    }
    sheet
}

/// A passage as the view camera takes it, frame by frame.
pub(super) struct Taken {
    day: Day,
    start_unix_s: f64,
    step_s: f64,
    size: (u32, u32),
    /// The view camera's gains, which stay.
    gains: [f64; 3],
    beams: Vec<f64>,
    views: Vec<Vec<u32>>,
    /// Mean light of the temple, were it there.
    temples: Vec<f64>,
}

impl Taken {
    /// The first passage that the clouds `seed` or later ones make, a frame every `step_s` seconds.
    pub(super) fn of(site: &Vanished, effort: Effort, step_s: f64, seed: u64) -> Result<Self, Failure> {
        let (day, start_unix_s) = first_passage(seed)?;
        let first = ViewCamera::exposed(day.sky(start_unix_s + LATE_S)?, &site.camera, seed);
        let (size, gains) = (effort.size, first.gains);
        let (beams, views, temples) = (Vec::new(), Vec::new(), Vec::new());
        let mut taken = Taken { day, start_unix_s, step_s, size, gains, beams, views, temples };
        for k in 0..(LASTS_S / step_s) as usize {
            let unix_s = start_unix_s + LATE_S + step_s * k as f64;
            let mut camera = ViewCamera::exposed(taken.day.sky(unix_s)?, &site.camera, seed);
            camera.gains = gains;
            // Every frame has the same paths, so that their noise does not flicker.
            let traced = |scene, paths| camera.trace(scene, (size, effort.samples), paths).or_runtime();
            taken.beams.push(beam(&taken.day, unix_s)?);
            taken.views.push(camera.picture(&traced(&site.real, 0)?));
            taken.temples.push(mean(&camera.ideal(&traced(&site.whole, 1)?), &site.covered));
        }
        Ok(taken)
    }

    /// What a post in `folder` makes of it by the light of `sky`.
    pub(super) fn shown(&self, folder: &Path, site: &Vanished, sky: SkyKind) -> Result<Vec<Frame>, Failure> {
        let running = Running { start_unix_s: self.start_unix_s, step_s: self.step_s };
        let shown = shown(folder, (&self.day, sky), running, (&self.views, self.size))?;
        let frame = |(k, shown): (usize, &Shown)| {
            let gain = shown.exposure / self.gains[1];
            let temple = mean(&shown.pixels_bgrx, &site.covered) / self.temples[k];
            let second = self.step_s * k as f64;
            Frame { second, beam: self.beams[k], gain, temple, temple_at_true_gain: temple / gain }
        };
        Ok(shown.iter().enumerate().map(frame).collect())
    }
}

/// Mean luminance of the covered pixels, linear.
fn mean(pixels: &[u32], covered: &[bool]) -> f64 {
    let light = |xrgb: &u32| {
        let [_, r, g, b] = xrgb.to_be_bytes();
        f64::from(luminance([r, g, b].map(|code| srgb_linear(code) as f32)))
    };
    let own: Vec<f64> = pixels.iter().zip(covered).filter(|(_, covered)| **covered).map(|(p, _)| light(p)).collect();
    own.iter().sum::<f64>() / own.len().max(1) as f64
}

/// Share of the beam that the clouds let through.
fn beam(day: &Day, unix_s: f64) -> Result<f64, Failure> {
    let clouds = Clouds::new(&atmosphere(Site::in_config(), day.weather), unix_s);
    let sun = sun_position(unix_s, Site::place()).or_runtime()?;
    Ok(f64::from(clouds.transmission(dir_world(sun, 0.0))))
}

/// A day, and when on it a cloud comes before the sun and goes.
fn first_passage(first_seed: u64) -> Result<(Day, f64), Failure> {
    let begin = parse_utc(BEGIN).or_runtime()?;
    for seed in first_seed..first_seed + SEEDS {
        let day = Day { name: "passing", weather: Weather { turbidity: TURBIDITY, cloud_cover: COVER, seed } };
        let at = |k: usize| begin + 0.5 * SUNNY_S * k as f64;
        let beams: Result<Vec<f64>, Failure> = (0..STARTS).map(|k| beam(&day, at(k))).collect();
        let window = (LASTS_S / (0.5 * SUNNY_S)) as usize;
        let is_passage = |run: &[f64]| {
            let mut ends = run[..3].iter().chain(&run[window - 2..]);
            ends.all(|&share| share > SUNNY) && run.iter().any(|&share| share < CLOUDED)
        };
        if let Some(start) = beams?.windows(window).position(is_passage) {
            return Ok((day, at(start)));
        }
    }
    Err(Failure::Runtime(anyhow::anyhow!("no cloud passes before the sun; choose another --seed")))
}
