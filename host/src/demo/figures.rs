//! Pictures and charts of the demo.

use std::path::Path;

use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::RgbColor;

use super::day::Moment;
use super::site::{SIZE, Site};
use super::trace::Trace;
use crate::failure::Failure;
use crate::picture::{srgb_code, write_png};
use crate::plot::{Axis, Canvas, Cell, Chart, Series, contact_sheet};

/// Hours of which the whole picture is written.
const FULL: [f64; 5] = [7.5, 9.0, 13.0, 17.0, 18.5];

/// Writes `contact_sheet.png`, `picture_HHMM.png`, `reference_HHMM.png`, `skipped.png` and `error.png` into `out`.
pub(super) fn write(out: &Path, hours: &[Moment], drift: &[Moment], traces: &[Trace]) -> Result<(), Failure> {
    let cell = |moment: &Moment| Cell { picture: moment.picture.clone(), caption: caption(moment) };
    let cells: Vec<Cell> = hours.iter().map(cell).collect();
    let [latitude, longitude] = [Site::place().latitude_deg, Site::place().longitude_deg];
    let title = format!("A day at {latitude} N {longitude} E, 2 October, relit from a sky camera");
    contact_sheet(&title, &cells, 5).save(&out.join("contact_sheet.png"))?;
    for hour in FULL {
        if let Some(moment) = hours.iter().find(|moment| (moment.hour() - hour).abs() < 0.01) {
            moment.picture.save(&out.join(format!("picture_{}.png", moment.clock().replace(':', ""))))?;
        }
    }
    for trace in traces {
        let moment = &hours[trace.moment];
        let code = |value: f32| u32::from(srgb_code(f64::from(value * moment.exposure)));
        let shown = |[r, g, b]: &[f32; 3]| code(*r) << 16 | code(*g) << 8 | code(*b);
        let pixels: Vec<u32> = trace.picture.rgb.iter().map(shown).collect();
        let name = format!("reference_{}.png", moment.clock().replace(':', ""));
        let (width, height) = (trace.picture.width as usize, trace.picture.height as usize);
        write_png(&out.join(name), width, height, &pixels)?;
    }
    skipped(hours, drift).save(&out.join("skipped.png"))?;
    error(hours, traces).save(&out.join("error.png"))?;
    Ok(())
}

fn caption(moment: &Moment) -> String {
    let height = moment.sun.altitude_deg;
    let azimuth = moment.sun.azimuth_deg;
    let light = match moment.weights.sun {
        Some(_) => format!("sun {height:.0}\u{b0} high in {azimuth:.0}\u{b0}"),
        None if height > 0.0 => format!("sun {height:.0}\u{b0} high, covered"),
        None => format!("sun {:.0}\u{b0} below the horizon", -height),
    };
    format!("{}  {light}", moment.clock())
}

/// Shares of the work that a moment was spared, per cent: (name, share).
pub(super) fn spared(moment: &Moment) -> [(&'static str, f64); 4] {
    let counters = &moment.counters;
    let share = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
    let with_geometry = counters.tiles_drawn + counters.tiles_kept;
    [
        ("tiles kept as drawn, of those with geometry", share(counters.tiles_kept, with_geometry)),
        ("tiles without geometry", share(counters.tiles_empty, counters.tiles)),
        ("patches without light", share(counters.patches_dark, counters.patches)),
        ("blocks not even projected, of those with geometry", share(counters.blocks_spared, counters.blocks)),
    ]
}

fn skipped(hours: &[Moment], drift: &[Moment]) -> Canvas {
    let chart = |title: &str, x: Axis, moments: &[Moment], at: &dyn Fn(&Moment) -> f64| {
        let y = Axis::linear("skipped, %").with_range(0.0, 100.0);
        let mut chart = Chart::new(title, x, y);
        let names = ["tiles kept", "tiles without geometry", "patches without light", "blocks not projected"];
        for (index, name) in names.into_iter().enumerate() {
            let points = moments.iter().map(|moment| (at(moment), spared(moment)[index].1)).collect();
            chart = chart.with(Series::line(name, points).with_markers());
        }
        let sun = moments.iter().map(|m| (at(m), if m.counters.sun_traced { 0.0 } else { 100.0 })).collect();
        chart.with(Series::line("sun not traced", sun)).draw(960, 330)
    };
    let span =
        |moments: &[Moment]| (moments.first().map_or(0.0, Moment::hour), moments.last().map_or(24.0, Moment::hour));
    let (from, to) = span(hours);
    let day = Axis::hours("local time", from.floor(), to.ceil(), 1.0);
    let (start, _) = span(drift);
    let seconds = Axis::linear(format!("seconds after {}", drift.first().map_or_else(String::new, Moment::clock)));
    let above = chart("Work skipped, a picture every half hour", day, hours, &Moment::hour);
    let below = chart("Work skipped under drifting clouds", seconds, drift, &|moment| (moment.hour() - start) * 3600.0);
    let mut both = Canvas::new(960, 660, Rgb888::WHITE);
    both.paste(&above, 0, 0);
    both.paste(&below, 0, 330);
    both
}

fn error(hours: &[Moment], traces: &[Trace]) -> Canvas {
    let from = hours.first().map_or(0.0, Moment::hour).floor();
    let to = hours.last().map_or(24.0, Moment::hour).ceil();
    let exact = hours.iter().filter_map(|m| m.error.map(|error| (m.hour(), 100.0 * error))).collect();
    let traced = |pick: fn(&Trace) -> f64| traces.iter().map(|t| (hours[t.moment].hour(), 100.0 * pick(t))).collect();
    Chart::new("Error over the day", Axis::hours("local time", from, to, 1.0), Axis::log("relative RMSE, %"))
        .with(Series::line("sky against the exact sum", exact).with_markers())
        .with(Series::scatter("against a path trace (8x8 blocks), true sky", traced(|t| t.transport.block_rmse)))
        .with(Series::scatter("against a path trace (8x8 blocks), sky camera", traced(|t| t.camera.block_rmse)))
        .draw(960, 420)
}

/// Width and height of what is drawn, for the summary.
pub(super) fn size_told() -> String {
    format!("{}x{}", SIZE.0, SIZE.1)
}
