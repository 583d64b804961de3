//! The plot of `relume sky lens`: the sun's path over the picture, and the residuals over the hours of the day.

use crate::plot::{Axis, Canvas, Chart, Series};
use crate::sunpath::PathFit;
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_9X15_BOLD;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{Drawable, Point, Primitive};
use embedded_graphics::primitives::{Circle, PrimitiveStyle};
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};

const HORIZON: Rgb888 = Rgb888::new(0x9c, 0xdc, 0xff);
const SEEN: Rgb888 = Rgb888::new(0xe6, 0x9f, 0x00);
const EXPECTED: Rgb888 = Rgb888::new(0x00, 0xe0, 0x9e);
/// The picture is shown about this wide, pixels.
const PICTURE: usize = 720;
const CHART: (u32, u32) = (720, 300);

/// The picture (its brightest codes, RGB) with the horizon, where the sun was seen (ring) and where it should be (dot), above the
/// residuals.
pub(super) fn draw(fit: &PathFit, brightest: &[u8], (width, height): (usize, usize)) -> Canvas {
    let zoom = PICTURE as f64 / width as f64;
    let size = (PICTURE as u32, (height as f64 * zoom).round() as u32);
    let mut canvas = background(brightest, (width, height), size);
    let at = |[x, y]: [f64; 2]| Point::new((x * zoom).round() as i32, (y * zoom).round() as i32);
    for tenth in 0..3600 {
        let (sin, cos) = (f64::from(tenth) / 10.0).to_radians().sin_cos();
        if let Some(place) = fit.lens.project([sin, 0.0, -cos]) {
            let Ok(()) =
                Circle::with_center(at(place), 1).into_styled(PrimitiveStyle::with_fill(HORIZON)).draw(&mut canvas);
        }
    }
    for (letter, dir) in [("N", [0.0, -1.0]), ("E", [1.0, 0.0]), ("S", [0.0, 1.0]), ("W", [-1.0, 0.0])] {
        // 8 degrees above the horizon, so that the letter stands within the circle.
        if let Some(place) = fit.lens.project([0.99 * dir[0], 0.139, 0.99 * dir[1]]) {
            let style = TextStyleBuilder::new().alignment(Alignment::Center).baseline(Baseline::Middle).build();
            let ink = MonoTextStyle::new(&FONT_9X15_BOLD, HORIZON);
            let Ok(_) = Text::with_text_style(letter, at(place), ink, style).draw(&mut canvas);
        }
    }
    for found in &fit.found {
        let ring = PrimitiveStyle::with_stroke(SEEN, 1);
        let Ok(()) = Circle::with_center(at(found.seen_px), 11).into_styled(ring).draw(&mut canvas);
        let dot = PrimitiveStyle::with_fill(EXPECTED);
        let Ok(()) = Circle::with_center(at(found.expected_px), 3).into_styled(dot).draw(&mut canvas);
    }
    let chart = residuals(fit).draw(CHART.0, CHART.1);
    let mut whole = Canvas::new(size.0.max(CHART.0), size.1 + CHART.1, Rgb888::new(255, 255, 255));
    whole.paste(&canvas, 0, 0);
    whole.paste(&chart, 0, size.1);
    whole
}

/// The picture at the plot's size, dimmed so that marks show.
fn background(brightest: &[u8], (width, height): (usize, usize), (columns, rows): (u32, u32)) -> Canvas {
    let pixel = |index: u32| {
        let (x, y) = (index % columns, index / columns);
        let (col, row) = (x as usize * width / columns as usize, y as usize * height / rows as usize);
        let from = 3 * (row.min(height - 1) * width + col.min(width - 1));
        let code = |k: usize| brightest.get(from + k).map_or(0, |&code| (u16::from(code) * 2 / 3) as u8);
        u32::from_be_bytes([0, code(0), code(1), code(2)])
    };
    Canvas::from_xrgb(columns, rows, &(0..columns * rows).map(pixel).collect::<Vec<_>>())
}

fn residuals(fit: &PathFit) -> Chart {
    let (rms_px, rms_deg) = fit.rms();
    let hour = |unix_s: f64| unix_s.rem_euclid(86_400.0) / 3600.0;
    let points = |axis: usize| {
        fit.found.iter().map(|f| (hour(f.captured_at_s), f.seen_px[axis] - f.expected_px[axis])).collect::<Vec<_>>()
    };
    let title = format!("{} frames: residual {rms_px:.2} px rms, {rms_deg:.3} degrees", fit.found.len());
    Chart::new(title, Axis::linear("hour of the day, UTC"), Axis::linear("seen - expected, pixels"))
        .with(Series::scatter("to the right", points(0)))
        .with(Series::scatter("down", points(1)))
}
