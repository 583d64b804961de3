//! What the loop of a post costs at its own pace under a still sky: relight, composite, labels, and the copy to the memory of a
//! display; over a still, and over a live view with all of it but the camera. Beside it what the sky camera costs, and how long light
//! takes to the display's memory.

use super::clock::cpu_s;
use super::skycamera::{self, SkyCost};
use crate::camera::{Camera, CameraError, CameraLimits, Exposure, Frame};
use crate::clock::{Moment, PostClock};
use crate::config::{ClockConfig, Config};
use crate::display::pack::{PixelFormat, Placement, Rotation};
use crate::display::{self, Display, DisplayError};
use crate::health::WELL;
use crate::painter::field::{FieldPainter, SUN_STEP_DEG};
use crate::post::{LatencyParts, Parts, Post, PostReport, Signals};
use crate::relight::FieldFile;
use crate::response::Response;
use crate::sky_source::background::Background;
use crate::sky_source::{SkyFault, SkyReading, SkySource};
use crate::view::Still;
use crate::view::curve::ViewCurve;
use crate::view::live::{BackgroundView, CameraView, ViewSource};
use crate::weights::PatchWeights;
use anyhow::Context;
use serde::Serialize;
use std::cell::RefCell;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Frames a second.
const PACE: f64 = 30.0;
/// Frames before the measured ones, and those.
const WARM_UP: u64 = 30;
const FRAMES: u64 = 150;
/// How long the first frame waits for a picture, and for light, whose pictures are rendered first.
const FIRST_PICTURE: Duration = Duration::from_secs(3);
const FIRST_LIGHT: Duration = Duration::from_secs(60);

/// The loop's cost, all threads of the program together.
#[derive(Clone, Debug, Serialize)]
pub struct LoopReport {
    /// Width of the picture.
    pub width_px: usize,
    /// Height of the picture.
    pub height_px: usize,
    /// Frames measured in each case, at 30 a second.
    pub frames: u64,
    /// A still behind.
    pub still_view: LoopCost,
    /// A camera's picture behind, a new one for every frame, of the field's size.
    pub live_view: LoopCost,
    /// The same through the curve of the view's camera.
    pub live_view_by_curve: LoopCost,
    /// The same as they are, with pictures half as wide and half as high, which are scaled.
    pub live_view_scaled: LoopCost,
    /// The sky camera alone while the sky is calm.
    pub calm_sky: SkyCost,
    /// From light to pixel while the sky changes, over a still.
    pub light_to_pixel: LightToPixel,
}

/// Where the time goes from a picture of the sky to the memory of a display.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LightToPixel {
    /// Series whose light was shown.
    pub shown: u64,
    /// Mean of the parts. A display's own refresh comes on top.
    pub mean: LatencyParts,
    /// The worst from the last picture of a series to its light in the display's memory, milliseconds.
    pub worst_ms: f64,
}

/// One case.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LoopCost {
    /// CPU time of a frame, mean, milliseconds.
    pub cpu_ms_per_frame: f64,
    /// CPU time by wall time: 1 is a core.
    pub share_of_core: f64,
    /// Frames since the start in which nothing but the view was composited; `None` over a still.
    pub frames_composited: Option<u64>,
}

/// Runs a post with this field once per case.
///
/// # Errors
/// If the field cannot be read, or a post does not run.
pub fn run(field: &Path) -> anyhow::Result<LoopReport> {
    // A post shows one field until it ends.
    let file: &'static FieldFile = Box::leak(Box::new(FieldFile::open(field)?));
    let size = (file.field().width(), file.field().height());
    let live = |parts: usize, curve: Option<ViewCurve>| -> anyhow::Result<Box<dyn ViewSource>> {
        let camera = Moving { size: (size.0 / parts, size.1 / parts), number: 0 };
        let view = CameraView::new("camera", Box::new(camera), size).with_curve(curve);
        let mut view = BackgroundView::start(view, Duration::from_secs_f64(1.0 / PACE))?;
        view.wait(FIRST_PICTURE, &AtomicBool::new(false));
        Ok(Box::new(view))
    };
    let linear = ViewCurve::new(Response::default(), "a linear camera")?;
    Ok(LoopReport {
        width_px: size.0,
        height_px: size.1,
        frames: FRAMES,
        still_view: cost(file, None)?,
        live_view: cost(file, Some(live(1, None)?))?,
        live_view_by_curve: cost(file, Some(live(1, Some(linear))?))?,
        live_view_scaled: cost(file, Some(live(2, None)?))?,
        calm_sky: skycamera::calm(file)?,
        light_to_pixel: light_to_pixel(file)?,
    })
}

fn cost(file: &'static FieldFile, view: Option<Box<dyn ViewSource>>) -> anyhow::Result<LoopCost> {
    let times = RefCell::new(Vec::with_capacity((WARM_UP + FRAMES) as usize));
    let sky = Box::new(Even { patches: file.field().patch_set().len(), told: false });
    let report = post(file, sky, view, &times)?;
    let times = times.borrow();
    let (from, to) = times.get(WARM_UP as usize).zip(times.last()).context("the post ended early")?;
    let cpu_s = to.1 - from.1;
    Ok(LoopCost {
        cpu_ms_per_frame: 1e3 * cpu_s / FRAMES as f64,
        share_of_core: cpu_s / to.0.duration_since(from.0).as_secs_f64(),
        frames_composited: report.health.view.map(|view| view.frames_composited),
    })
}

/// A post under a camera's sky that changes all the time.
fn light_to_pixel(file: &'static FieldFile) -> anyhow::Result<LightToPixel> {
    let clock = PostClock::start(ClockConfig::System { interval_s: 1.0 / PACE }, None);
    let (sky, _) = skycamera::sky(file, &[1.0, 0.8])?;
    let mut sky = Background::start(Box::new(sky), clock, Duration::ZERO)?;
    sky.wait(FIRST_LIGHT, &AtomicBool::new(false));
    let health = post(file, Box::new(sky), None, &RefCell::new(Vec::new()))?.health;
    let (mean, worst_ms) = health.latency_mean_parts.zip(health.latency_worst_ms).context("no light was shown")?;
    Ok(LightToPixel { shown: health.latency_count, mean, worst_ms })
}

/// Runs a post to its end.
fn post(
    file: &'static FieldFile,
    sky: Box<dyn SkySource + '_>,
    view: Option<Box<dyn ViewSource>>,
    times: &RefCell<Vec<(Instant, f64)>>,
) -> anyhow::Result<PostReport> {
    let (field, folder) = (file.field(), tempfile::tempdir()?);
    let size = (field.width(), field.height());
    let mut painter = FieldPainter::new(field, Still::black(size.0, size.1), 0);
    if view.is_some() {
        painter.expect_live_view();
    }
    // As in a post that lives by the system's clock: sunlight is traced beside the loop.
    painter.trace_behind(SUN_STEP_DEG)?;
    let config = config(folder.path())?;
    let parts = Parts {
        sky,
        view,
        painter: Box::new(painter),
        display: Box::new(Memory::new(size, times)?),
        clock: PostClock::start(ClockConfig::System { interval_s: 1.0 / PACE }, None),
    };
    let report = Post::new(&config, parts).run(&Signals::default()).map_err(|failure| anyhow::anyhow!("{failure}"))?;
    anyhow::ensure!(report.health.state == WELL, "the post is not well: {}", report.health.state);
    Ok(report)
}

/// A post with words over the picture, which ends by itself.
fn config(folder: &Path) -> anyhow::Result<Config> {
    let file = folder.join("POST.toml");
    let frames = WARM_UP + FRAMES + 1;
    let text = format!(
        "title = 'The temple on the hill'\ncaption = 'As it stood in the year 120'\nfield = 'a'\nsky = 'replay'\n\
         [camera]\nframes = 'a'\nlens = 'a'\n[display]\nkind = 'headless'\nfolder = '.'\n[run]\nframes = {frames}\n"
    );
    std::fs::write(&file, text)?;
    Ok(Config::load(&file)?)
}

/// An even sky that is told once.
struct Even {
    patches: usize,
    told: bool,
}

impl SkySource for Even {
    fn read(&mut self, _moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        into.weights = PatchWeights { radiance: vec![[1.0; 3]; self.patches], sun: None };
        Ok(!std::mem::replace(&mut self.told, true))
    }
}

/// A camera whose pictures differ, and cost nothing.
struct Moving {
    size: (usize, usize),
    number: u8,
}

impl Camera for Moving {
    fn limits(&self) -> CameraLimits {
        CameraLimits::nothing_to_set(self.size)
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        Ok(exposure)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        self.number = self.number.wrapping_add(1);
        into.codes_u8(self.size.0, self.size.1).iter_mut().step_by(1000).for_each(|code| *code = self.number);
        Ok(())
    }
}

/// A display's memory, and when what was presented.
struct Memory<'a> {
    size: (usize, usize),
    placement: Placement,
    memory: Vec<u32>,
    times: &'a RefCell<Vec<(Instant, f64)>>,
}

impl<'a> Memory<'a> {
    fn new(size: (usize, usize), times: &'a RefCell<Vec<(Instant, f64)>>) -> anyhow::Result<Self> {
        let placement = Placement::centred(size, size, Rotation::None, PixelFormat::Xrgb8888, size.0);
        let placement = placement.context("a picture fits into its own size")?;
        Ok(Memory { size, placement, memory: vec![0; size.0 * size.1], times })
    }
}

impl Display for Memory<'_> {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn present(&mut self, frame: &display::Frame<'_>) -> Result<(), DisplayError> {
        frame.damage.areas().for_each(|area| self.placement.write(frame, area, &mut self.memory));
        self.times.borrow_mut().push((Instant::now(), cpu_s()));
        Ok(())
    }
}

impl std::fmt::Display for LoopReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (width, height) = (self.width_px, self.height_px);
        writeln!(
            f,
            "the loop of a post at {width}x{height}, {PACE} frames a second, still sky; {} frames",
            self.frames
        )?;
        let cases = [
            ("still behind", self.still_view),
            ("live view", self.live_view),
            ("live view by its curve", self.live_view_by_curve),
            ("live view of half the size", self.live_view_scaled),
        ];
        for (name, cost) in cases {
            write!(
                f,
                "{name:<26} {:.3} ms a frame, {:.2} % of a core",
                cost.cpu_ms_per_frame,
                100.0 * cost.share_of_core
            )?;
            match cost.frames_composited {
                Some(frames) => writeln!(f, "; {frames} frames composited only")?,
                None => writeln!(f)?,
            }
        }
        writeln!(f, "{}", self.calm_sky)?;
        let LightToPixel { shown, mean, worst_ms } = self.light_to_pixel;
        writeln!(
            f,
            "light to pixel, mean of {shown}: series {:.0} ms; then weights {:.1}, relight {:.1}, display {:.1} ms; worst \
             {worst_ms:.1} ms after the series",
            mean.bracket_ms, mean.weights_ms, mean.relight_ms, mean.display_ms
        )
    }
}
