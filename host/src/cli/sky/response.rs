//! `relume sky response`: an exposure series into the camera's response curve.

use super::frames::read_all;
use crate::cli::args::{number, place, required};
use crate::failure::{Failure, OrFail};
use crate::outfile::{check_writable, write_whole};
use crate::plot::{Axis, Chart, Series};
use crate::response::Response;
use crate::response::calibration::{Calibration, calibrate};
use std::io::Write;
use std::path::PathBuf;

#[derive(Default)]
struct Options {
    frames: Option<PathBuf>,
    plot: Option<PathBuf>,
    black: Option<f64>,
    out: Option<PathBuf>,
}

pub(super) fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let folder = required(options.frames.as_ref(), "FRAMES_DIR")?;
    let out = required(options.out.as_ref(), "-o CURVE.csv")?;
    check_writable(out)?;
    if let Some(plot) = &options.plot {
        check_writable(plot)?;
    }
    let frames = read_all(folder)?;
    let told = |error| Failure::bad(format!("{}: {error}", folder.display()));
    let found = calibrate(&frames, options.black).map_err(told)?;
    tell(&found);
    write_whole(out, |file| file.write_all(found.response.to_csv().as_bytes()))?;
    match &options.plot {
        Some(path) => draw(&found.response).draw(900, 600).save(path).or_runtime(),
        None => Ok(()),
    }
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("plot") => o.plot = Some(parser.value()?.into()),
            Long("black") => o.black = Some(number(parser, "--black", 0.0..=0.5)?),
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Value(value) => place(value, &mut [&mut o.frames])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(o)
}

fn tell(found: &Calibration) {
    for (name, channel) in ["red", "green", "blue"].iter().zip(&found.channels) {
        let [low, high] = channel.seen;
        eprintln!(
            "{name}: {} flat blocks, codes {low:.3} to {high:.3} of the largest, residual {:.4} (RMS, natural log)",
            channel.blocks, channel.rms_log
        );
    }
    eprintln!("black level: {:.4} of the largest code", found.black);
    if let Some(left_out) = found.left_out {
        eprintln!(
            "frame {} was left out: it fits the others if its exposure is {:.3} times what frames.json says",
            left_out.frame, left_out.factor
        );
    }
}

fn draw(response: &Response) -> Chart {
    let mut chart = Chart::new(
        "Inverse response",
        Axis::linear("code / largest code").with_range(0.0, 1.0),
        Axis::log("light / full well").with_range(1e-4, 1.0),
    );
    for (channel, (name, [r, g, b])) in
        [("red", [200, 30, 30]), ("green", [20, 140, 40]), ("blue", [30, 60, 200])].into_iter().enumerate()
    {
        let points =
            response.rows().iter().filter(|row| row[channel + 1] >= 1e-4).map(|row| (row[0], row[channel + 1]));
        chart = chart.with(Series::line(name, points.collect()).with_color(r, g, b));
    }
    chart
}
