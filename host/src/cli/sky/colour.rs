//! `relume sky colour`: the camera's colours from a photographed chart.

use crate::camera::replay::{Recorded, read_frame};
use crate::camera::{Exposure, Frame};
use crate::cli::args::{number, numbers, place, required};
use crate::colour::chart::{ChartFit, Patch, colorchecker, fit, read_patches, sample};
use crate::failure::{Failure, OrFail};
use crate::outfile::check_writable;
use crate::response::Response;
use serde::Serialize;
use std::path::PathBuf;

/// Daylight of the white of Rec.709, kelvin.
const D65_K: f64 = 6504.0;

#[derive(Default)]
struct Options {
    frame: Option<PathBuf>,
    chart: Option<PathBuf>,
    corners: Option<[f64; 8]>,
    response: Option<PathBuf>,
    light_k: Option<f64>,
    out: Option<PathBuf>,
    json: bool,
}

/// What the chart told, as JSON.
#[derive(Debug, Serialize)]
struct Summary {
    patches: usize,
    light_k: f64,
    delta_e_2000_median: f64,
    delta_e_2000_worst: f64,
    delta_e_2000_left_out_median: f64,
    delta_e_2000_left_out_worst: f64,
    delta_e_2000_balanced_only_median: f64,
}

pub(super) fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let path = required(options.frame.as_ref(), "CHART_FRAME.png")?;
    let out = required(options.out.as_ref(), "-o CAMERA.json")?;
    check_writable(out)?;
    let patches = patches(&options)?;
    let response = options.response.as_deref().map(Response::load).transpose().or_bad()?.unwrap_or_default();
    let mut frame = Frame::default();
    let exposure = Exposure { exposure_s: 1.0, gain: 1.0 };
    read_frame(&Recorded { path: path.clone(), exposure, captured_at_s: 0.0 }, 0, &mut frame).or_bad()?;
    let light_k = options.light_k.unwrap_or(D65_K);
    let told = |error| Failure::bad(format!("{}: {error}", path.display()));
    let fitted = sample(&frame, &response, &patches).and_then(|samples| fit(&samples, light_k)).map_err(told)?;
    fitted.colour.save(out)?;
    let said = summary(&fitted, light_k);
    if options.json { super::super::say_json(&said) } else { super::super::say(&text(&said, &fitted, &options)) }
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("chart") => o.chart = Some(parser.value()?.into()),
            Long("corners") => o.corners = Some(numbers(parser, "--corners", "x,y of four patches")?),
            Long("response") => o.response = Some(parser.value()?.into()),
            Long("light") => o.light_k = Some(number(parser, "--light", 4000.0..=25_000.0)?),
            Long("json") => o.json = true,
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Value(value) => place(value, &mut [&mut o.frame])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(o)
}

fn patches(options: &Options) -> Result<Vec<Patch>, Failure> {
    match (&options.chart, options.corners) {
        (Some(path), None) => {
            let name = path.display().to_string();
            let text = std::fs::read_to_string(path).map_err(|error| Failure::bad(format!("{name}: {error}")))?;
            read_patches(&text, &name).or_bad()
        }
        (None, Some([ax, ay, bx, by, cx, cy, dx, dy])) => Ok(colorchecker([[ax, ay], [bx, by], [cx, cy], [dx, dy]])),
        _ => Err(Failure::bad("sky colour: give one of --chart PATCHES.csv and --corners X,Y,X,Y,X,Y,X,Y")),
    }
}

fn median_and_worst(values: &[f64]) -> (f64, f64) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted.get(sorted.len() / 2).copied().unwrap_or(0.0), sorted.last().copied().unwrap_or(0.0))
}

fn summary(fitted: &ChartFit, light_k: f64) -> Summary {
    let (delta_e_2000_median, delta_e_2000_worst) = median_and_worst(&fitted.fitted);
    let (delta_e_2000_left_out_median, delta_e_2000_left_out_worst) = median_and_worst(&fitted.left_out);
    Summary {
        patches: fitted.fitted.len(),
        light_k,
        delta_e_2000_median,
        delta_e_2000_worst,
        delta_e_2000_left_out_median,
        delta_e_2000_left_out_worst,
        delta_e_2000_balanced_only_median: median_and_worst(&fitted.balanced_only).0,
    }
}

fn text(said: &Summary, fitted: &ChartFit, options: &Options) -> String {
    let light = if options.light_k.is_some() { "" } else { ", assumed: give --light KELVIN for another" };
    let response = match &options.response {
        Some(path) => format!("linearised by {}", path.display()),
        None => "taken for linear: give --response CURVE.csv for another camera".into(),
    };
    format!(
        "{} patches under daylight of {:.0} K{light}; {response}\n\
         white balance {:.4?}\nmatrix        {:.4?}\n\
         delta E 2000  {:.2} median, {:.2} worst; of patches left out of the fit {:.2}, {:.2}; white balance alone {:.2} median\n",
        said.patches,
        said.light_k,
        fitted.colour.white_balance,
        fitted.colour.matrix,
        said.delta_e_2000_median,
        said.delta_e_2000_worst,
        said.delta_e_2000_left_out_median,
        said.delta_e_2000_left_out_worst,
        said.delta_e_2000_balanced_only_median
    )
}

#[cfg(test)]
mod tests;
