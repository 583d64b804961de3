//! `relume sky lens`: lens and orientation of the sky camera from the sun's own path.

mod files;
mod plot;
mod words;

use crate::camera::Frame;
use crate::camera::replay::{Recorded, read_frame, read_list};
use crate::cli::args::{number, numbers, place, required};
use crate::failure::{Failure, OrFail};
use crate::flatfield::{FlatField, Vignetting};
use crate::grey::LinearGrey;
use crate::lens::mask::SkyMask;
use crate::lens::{Lens, LensFile, LensModel};
use crate::obstacles::ObstacleFinder;
use crate::outfile::check_writable;
use crate::response::Response;
use crate::sun::{Place, SunPosition, dir_world, sun_position};
use crate::sunpath::spot::SpotFinder;
use crate::sunpath::{self, MIN_ALTITUDE_DEG, PathFit, Sighting};
use std::path::{Path, PathBuf};

/// A frame counts among the short exposures of its moment up to this factor.
const SHORT: f64 = 4.0;
/// Frames this near in time make a moment, seconds.
const MOMENT_S: f64 = 120.0;
/// Frames that are looked at for obstacles.
const OBSTACLE_FRAMES: usize = 120;

#[derive(Default)]
struct Options {
    frames: Option<PathBuf>,
    site: Option<[f64; 2]>,
    model: Option<LensModel>,
    north_deg: f64,
    response: Option<PathBuf>,
    start: Option<PathBuf>,
    flat: Option<PathBuf>,
    mask: Option<PathBuf>,
    plot: Option<PathBuf>,
    out: Option<PathBuf>,
    json: bool,
}

/// What the command found, besides the lens file.
struct Outcome {
    fit: PathFit,
    vignetting: Option<Vignetting>,
    mask: Option<(SkyMask, u32)>,
}

pub(super) fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let options = parse(&mut parser)?;
    let folder = required(options.frames.as_ref(), "FRAMES_DIR")?;
    let out = required(options.out.as_ref(), "-o LENS.json")?;
    let [latitude_deg, longitude_deg] = required(options.site, "--site LAT,LON")?;
    for path in [Some(out), options.mask.as_ref(), options.plot.as_ref()].into_iter().flatten() {
        check_writable(path)?;
    }
    let response = options.response.as_deref().map(Response::load).transpose().or_bad()?.unwrap_or_default();
    let list = daylight(folder, Place { latitude_deg, longitude_deg })?;
    let mut watch = Watch::new(&response, options.plot.is_some());
    let mut sightings = Vec::new();
    for (recorded, sun) in shortest(&list) {
        let spots = watch.look(recorded)?;
        let sun_dir_world = dir_world(*sun, options.north_deg).map(f64::from);
        sightings.push(Sighting { captured_at_s: recorded.captured_at_s, sun_dir_world, spots });
    }
    let nominal = nominal(&options, watch.size()?)?;
    let told = |error| Failure::bad(format!("{}: {error}", folder.display()));
    let fit = sunpath::fit(&sightings, &nominal).map_err(told)?;
    let vignetting = options.flat.as_deref().map(|flat| flat_field(flat, &fit.lens, &response)).transpose()?;
    let mask = options.mask.as_ref().map(|_| obstacles(&list, &fit.lens, &response)).transpose()?;
    let outcome = Outcome { fit, vignetting, mask };
    files::write(&outcome, out, options.mask.as_deref())?;
    if let Some(path) = &options.plot {
        plot::draw(&outcome.fit, &watch.brightest, watch.size()?).save(path)?;
    }
    if options.json {
        super::super::say_json(&words::summary(&outcome))
    } else {
        super::super::say(&words::text(&outcome))
    }
}

fn parse(parser: &mut lexopt::Parser) -> Result<Options, Failure> {
    use lexopt::prelude::{Long, Short, Value};
    let mut o = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("site") => o.site = Some(numbers(parser, "--site", "latitude and longitude")?),
            Long("model") => o.model = Some(model(&parser.value()?.to_string_lossy())?),
            Long("north") => o.north_deg = number(parser, "--north", -360.0..=360.0)?,
            Long("response") => o.response = Some(parser.value()?.into()),
            Long("start") => o.start = Some(parser.value()?.into()),
            Long("flat") => o.flat = Some(parser.value()?.into()),
            Long("mask") => o.mask = Some(parser.value()?.into()),
            Long("plot") => o.plot = Some(parser.value()?.into()),
            Long("json") => o.json = true,
            Long("out") | Short('o') => o.out = Some(parser.value()?.into()),
            Value(value) => place(value, &mut [&mut o.frames])?,
            other => return Err(other.unexpected().into()),
        }
    }
    Ok(o)
}

fn model(name: &str) -> Result<LensModel, Failure> {
    match name {
        "equidistant" => Ok(LensModel::Equidistant),
        "equisolid" => Ok(LensModel::Equisolid),
        "kannala_brandt" => Ok(LensModel::KannalaBrandt),
        other => Err(Failure::bad(format!("--model {other}: choose equidistant, equisolid or kannala_brandt"))),
    }
}

/// The frames that were taken while the sun was up, in order of time, with the sun's place.
fn daylight(folder: &Path, place: Place) -> Result<Vec<(Recorded, SunPosition)>, Failure> {
    let mut list = read_list(folder).or_bad()?;
    let fault = |what: String| Failure::bad(format!("{}: {what}", folder.join("frames.json").display()));
    if let Some(index) = list.iter().position(|recorded| recorded.captured_at_s <= 0.0) {
        return Err(fault(format!("entry {index}: captured_at is missing; the sun's place follows from it")));
    }
    list.sort_by(|a, b| a.captured_at_s.total_cmp(&b.captured_at_s));
    let mut up = Vec::new();
    for recorded in list {
        let sun = sun_position(recorded.captured_at_s, place).or_bad()?;
        if sun.altitude_deg >= MIN_ALTITUDE_DEG {
            up.push((recorded, sun));
        }
    }
    if up.is_empty() {
        return Err(fault(format!(
            "at no captured_at (UTC) does the sun stand {MIN_ALTITUDE_DEG} degrees high at {},{}; check both",
            place.latitude_deg, place.longitude_deg
        )));
    }
    Ok(up)
}

/// The short exposures of every moment: in long ones the sky around the sun clips, too, and hardly evenly.
fn shortest(list: &[(Recorded, SunPosition)]) -> impl Iterator<Item = &(Recorded, SunPosition)> {
    let product = |entry: &(Recorded, SunPosition)| entry.0.exposure.product_s();
    let time = |entry: &(Recorded, SunPosition)| entry.0.captured_at_s;
    list.iter().filter(move |entry| {
        let from = list.partition_point(|other| time(other) < time(entry) - MOMENT_S);
        let near = list[from..].iter().take_while(|other| time(other) <= time(entry) + MOMENT_S);
        product(entry) <= SHORT * near.map(product).fold(f64::INFINITY, f64::min)
    })
}

/// Looks for the sun, frame by frame.
struct Watch {
    finder: SpotFinder,
    frame: Frame,
    size: Option<(usize, usize)>,
    /// Largest 8-bit code of each pixel over all frames, for the plot; empty if there is none.
    brightest: Vec<u8>,
    keeps_brightest: bool,
}

impl Watch {
    fn new(response: &Response, keeps_brightest: bool) -> Self {
        let finder = SpotFinder::new(response.clone());
        Watch { finder, frame: Frame::default(), size: None, brightest: Vec::new(), keeps_brightest }
    }

    fn size(&self) -> Result<(usize, usize), Failure> {
        self.size.ok_or_else(|| Failure::bad("sky lens: there are no frames"))
    }

    fn look(&mut self, recorded: &Recorded) -> Result<Vec<crate::sunpath::spot::Spot>, Failure> {
        read_frame(recorded, 0, &mut self.frame).or_bad()?;
        let frame = &self.frame;
        let (width, height) = *self.size.get_or_insert((frame.width, frame.height));
        if (frame.width, frame.height) != (width, height) {
            let (path, w, h) = (recorded.path.display(), frame.width, frame.height);
            return Err(Failure::bad(format!("{path}: {w}x{h} pixels; the frames before have {width}x{height}")));
        }
        if self.keeps_brightest {
            self.brightest.resize(frame.codes.len(), 0);
            let shift = if frame.codes.max() > 255 { 8 } else { 0 };
            for (index, code) in self.brightest.iter_mut().enumerate() {
                *code = (*code).max((frame.codes.get(index) >> shift) as u8);
            }
        }
        Ok(self.finder.find(frame))
    }
}

/// The lens that parameters stay at where the sun's path does not tell them.
fn nominal(options: &Options, (width, height): (usize, usize)) -> Result<LensFile, Failure> {
    let start = match &options.start {
        Some(path) => Lens::load(path).or_bad()?,
        None => Lens::zenith_equidistant(width, height, 180.0),
    };
    if start.size().is_some_and(|size| size != (width, height)) {
        return Err(Failure::bad(format!("--start: the lens has another size than the frames' {width}x{height}")));
    }
    let mut file = LensFile { width: Some(width), height: Some(height), ..start.file() };
    file.model = match (options.model, &options.start) {
        (Some(model), _) => model,
        (None, Some(_)) => file.model,
        (None, None) => LensModel::KannalaBrandt,
    };
    if file.model != LensModel::KannalaBrandt {
        file.k = [0.0; 4];
    }
    Ok(file)
}

/// The linear light of some frames, one after another.
fn each_light(
    recorded: &[&Recorded],
    lens: &Lens,
    response: &Response,
    mut take: impl FnMut(&[f32]),
) -> Result<(), Failure> {
    let (mut frame, mut light, mut grey) = (Frame::default(), Vec::new(), LinearGrey::new(response.clone()));
    for recorded in recorded {
        read_frame(recorded, 0, &mut frame).or_bad()?;
        if lens.size().is_some_and(|size| size != (frame.width, frame.height)) {
            return Err(Failure::bad(format!("{}: has another size than the sun's frames", recorded.path.display())));
        }
        grey.take(&frame, &mut light);
        take(&light);
    }
    Ok(())
}

fn flat_field(folder: &Path, lens: &Lens, response: &Response) -> Result<Vignetting, Failure> {
    let list = read_list(folder).or_bad()?;
    let mut flat = FlatField::new(lens, lens.size().unwrap_or_default());
    each_light(&list.iter().collect::<Vec<_>>(), lens, response, |light| flat.add(light))?;
    flat.fit().map_err(|error| Failure::bad(format!("{}: {error}", folder.display())))
}

fn obstacles(list: &[(Recorded, SunPosition)], lens: &Lens, response: &Response) -> Result<(SkyMask, u32), Failure> {
    let stride = list.len().div_ceil(OBSTACLE_FRAMES).max(1);
    let some: Vec<&Recorded> = list.iter().step_by(stride).map(|entry| &entry.0).collect();
    let mut finder = ObstacleFinder::new(lens, lens.size().unwrap_or_default());
    each_light(&some, lens, response, |light| finder.add(light))?;
    Ok(finder.propose())
}

#[cfg(test)]
mod tests;
