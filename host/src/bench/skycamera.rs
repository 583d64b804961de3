//! A sky camera whose pictures were rendered before, and what it costs a post: unpacking, merging and weights as they run at
//! the post, without the simulation of sky and sensor.

use super::clock::cpu_s;
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::unpack::{Layout, Matrix, PixelFormat, Range, Unpacker, YuvCoding};
use crate::camera::{Camera, CameraError, CameraLimits, Codes, Exposure, Frame};
use crate::clock::PostClock;
use crate::config::{ClockConfig, Config};
use crate::importance::importance;
use crate::lens::Lens;
use crate::relight::FieldFile;
use crate::response::Response;
use crate::sky_source::background::Background;
use crate::sky_source::calm::SERIES_S;
use crate::sky_source::captured::CapturedSky;
use crate::sky_source::{SkyReading, SkySource};
use crate::sun::Place;
use anyhow::Context;
use serde::Serialize;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A USB camera's picture, YUYV.
const SIZE: (usize, usize) = (1280, 960);
const INTERVAL_S: f64 = 1.0 / 30.0;
/// Frames after which the light is another, where there are several.
const FRAMES_PER_LIGHT: u64 = 20;
/// Pictures of one exposure, which differ by their noise.
const VARIANTS: usize = 2;
/// Series that are measured, and how long the sky may take to be found calm.
const CALM_SERIES: f64 = 4.0;
const UNTIL_CALM: Duration = Duration::from_secs(120);
/// How often the main thread looks meanwhile.
const POLL: Duration = Duration::from_millis(50);

/// What the sky camera costs while the sky is calm, all threads of the program together.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SkyCost {
    /// Width of the camera's picture.
    pub width_px: usize,
    /// Height of the camera's picture.
    pub height_px: usize,
    /// Exposures of a series.
    pub exposures: usize,
    /// Series in the time measured.
    pub series: u64,
    /// Time measured, seconds.
    pub seconds: f64,
    /// CPU time by wall time: 1 is a core.
    pub share_of_core: f64,
}

impl std::fmt::Display for SkyCost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let SkyCost { width_px, height_px, exposures, series, seconds, share_of_core } = self;
        let percent = 100.0 * share_of_core;
        write!(
            f,
            "calm sky, camera {width_px}x{height_px}    {percent:.2} % of a core: {series} series of {exposures} in {seconds:.0} s"
        )
    }
}

/// Watches a still sky as a post does, once it is known to be calm.
pub(super) fn calm(file: &FieldFile) -> anyhow::Result<SkyCost> {
    let clock = PostClock::start(ClockConfig::System { interval_s: 1.0 }, None);
    let (sky, rendered) = sky(file, &[1.0])?;
    let mut sky = Background::start(Box::new(sky), clock.clone(), Duration::ZERO)?;
    let (mut reading, mut series) = (SkyReading::default(), 0);
    let begun = Instant::now();
    while reading.series.is_none_or(|series| !series.is_calm) {
        anyhow::ensure!(begun.elapsed() < UNTIL_CALM, "the sky was not found calm: is the machine overloaded?");
        sky.read(clock.now(0), &mut reading)?;
        std::thread::sleep(POLL);
    }
    let rendered_before = rendered.load(Ordering::Relaxed);
    let (begun, from_s) = (Instant::now(), cpu_s());
    while begun.elapsed().as_secs_f64() < CALM_SERIES * SERIES_S {
        std::thread::sleep(POLL);
        series += u64::from(sky.read(clock.now(0), &mut reading)?);
    }
    let (cpu_s, seconds) = (cpu_s() - from_s, begun.elapsed().as_secs_f64());
    let report = reading.series.context("a camera's reading tells of its series")?;
    anyhow::ensure!(report.is_calm, "the sky did not stay calm: is the machine overloaded?");
    anyhow::ensure!(
        rendered.load(Ordering::Relaxed) == rendered_before,
        "a picture was rendered while it was measured"
    );
    Ok(SkyCost {
        width_px: SIZE.0,
        height_px: SIZE.1,
        exposures: report.plan.frames,
        series,
        seconds,
        share_of_core: cpu_s / seconds,
    })
}

/// A captured sky over prepared pictures for a field, each light for some frames; and how many were rendered.
pub(super) fn sky(file: &FieldFile, lights: &[f64]) -> anyhow::Result<(CapturedSky, Arc<AtomicU64>)> {
    let (field, folder) = (file.field(), tempfile::tempdir()?);
    let north_deg = f64::from(field.camera().north_deg);
    let place = forenoon(unix_s());
    let scene = |light: f64| {
        let full_well_radiance_s = SyntheticSettings::default().full_well_radiance_s / light;
        let (width, height) = SIZE;
        SyntheticSettings {
            width,
            height,
            place,
            north_deg,
            delay_frames: 0,
            full_well_radiance_s,
            ..Default::default()
        }
    };
    let scenes: Vec<SyntheticCamera> = lights.iter().map(|&light| SyntheticCamera::new(scene(light))).collect();
    let config = config(folder.path(), place, &scenes[0])?;
    let camera = Prepared::new(scenes)?;
    let rendered = Arc::clone(&camera.rendered);
    let sky = CapturedSky::with_camera(Box::new(camera), &config, *field.patch_set(), north_deg)?;
    Ok((sky.with_importance(&importance(&field)), rendered))
}

fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// Where the sun stands some 30 to 60 degrees high at a time.
fn forenoon(unix_s: f64) -> Place {
    let utc_h = unix_s.rem_euclid(86_400.0) / 3600.0;
    Place { latitude_deg: 20.0, longitude_deg: (15.0 * (10.0 - utc_h) + 180.0).rem_euclid(360.0) - 180.0 }
}

/// A post's file for the camera, with its lens and curve.
fn config(folder: &Path, place: Place, scene: &SyntheticCamera) -> anyhow::Result<Config> {
    Lens::zenith_equidistant(SIZE.0, SIZE.1, 185.0).file().save(&folder.join("lens.json"))?;
    Response::from_rows(scene.response_rows(), "response")?.save(&folder.join("response.csv"))?;
    let Place { latitude_deg, longitude_deg } = place;
    let text = format!(
        "field = 'a'\nsky = 'camera'\n[site]\nlatitude = {latitude_deg:?}\nlongitude = {longitude_deg:?}\n[camera]\n\
         device = 'prepared'\nlens = 'lens.json'\nresponse = 'response.csv'\n[display]\nkind = 'headless'\nfolder = '.'\n"
    );
    let file = folder.join("POST.toml");
    std::fs::write(&file, text)?;
    Ok(Config::load(&file)?)
}

/// Pictures of one exposure: of each light, so many variants.
struct Picture {
    exposure: Exposure,
    bytes: Vec<Vec<u8>>,
}

/// A camera that streams at its pace; what it shows was rendered when its exposure was first asked for.
struct Prepared {
    scenes: Vec<SyntheticCamera>,
    pictures: Vec<Picture>,
    unpacker: Unpacker,
    /// The picture that stands, and those asked for, by the frames from which they show.
    standing: usize,
    pending: VecDeque<(u64, usize)>,
    /// Frames handed out: noise never repeats from one to the next, however many were missed between them.
    handed: usize,
    started: Instant,
    rendered: Arc<AtomicU64>,
}

/// Frames until a request shows.
const DELAY: u64 = 2;

impl Prepared {
    fn new(scenes: Vec<SyntheticCamera>) -> anyhow::Result<Self> {
        let coding = YuvCoding { range: Range::Full, matrix: Matrix::Bt601 };
        let (width, height) = SIZE;
        let layout = Layout { format: PixelFormat::Yuyv, width, height, stride: 2 * width, coding };
        let mut camera = Prepared {
            scenes,
            pictures: Vec::new(),
            unpacker: Unpacker::new(layout)?,
            standing: 0,
            pending: VecDeque::new(),
            handed: 0,
            started: Instant::now(),
            rendered: Arc::new(AtomicU64::new(0)),
        };
        let first = camera.limits().nearest(Exposure { exposure_s: 0.0, gain: 1.0 });
        camera.standing = camera.picture_of(first)?;
        Ok(camera)
    }

    /// The picture of an exposure that the camera can take.
    fn picture_of(&mut self, exposure: Exposure) -> Result<usize, CameraError> {
        if let Some(known) = self.pictures.iter().position(|picture| picture.exposure == exposure) {
            return Ok(known);
        }
        let (mut bytes, mut frame, seen_s) = (Vec::new(), Frame::default(), unix_s());
        for scene in &mut self.scenes {
            for _ in 0..VARIANTS {
                scene.set_time(seen_s);
                scene.request(exposure)?;
                scene.frame(&mut frame)?;
                bytes.push(yuyv(&frame));
            }
        }
        self.rendered.fetch_add(1, Ordering::Relaxed);
        self.pictures.push(Picture { exposure, bytes });
        Ok(self.pictures.len() - 1)
    }

    fn sequence(&self) -> u64 {
        (self.started.elapsed().as_secs_f64() / INTERVAL_S) as u64
    }
}

impl Camera for Prepared {
    fn limits(&self) -> CameraLimits {
        CameraLimits { delay_frames: DELAY as u32, ..self.scenes[0].limits() }
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        let accepted = self.limits().nearest(exposure);
        let picture = self.picture_of(accepted)?;
        self.pending.push_back((self.sequence() + DELAY, picture));
        Ok(accepted)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        let sequence = self.sequence() + 1;
        let due = Duration::from_secs_f64(sequence as f64 * INTERVAL_S);
        std::thread::sleep(due.saturating_sub(self.started.elapsed()));
        while let Some((_, picture)) = self.pending.pop_front_if(|(from, _)| *from <= sequence) {
            self.standing = picture;
        }
        let light = (sequence / FRAMES_PER_LIGHT) as usize % self.scenes.len();
        let picture = &self.pictures[self.standing];
        self.handed += 1;
        let bytes = &picture.bytes[light * VARIANTS + self.handed % VARIANTS];
        into.captured_at_s = unix_s();
        (into.exposure, into.sequence) = (picture.exposure, sequence);
        let refused = |error| CameraError::Device { path: "prepared pictures".into(), what: format!("{error}") };
        self.unpacker.unpack(bytes, into).map_err(refused)
    }
}

/// RGB codes to YUYV of full range by BT.601; two pixels share their chroma.
fn yuyv(frame: &Frame) -> Vec<u8> {
    let Codes::U8(codes) = &frame.codes else { return Vec::new() };
    let pairs = codes.chunks_exact(6).flat_map(|pair| {
        let luma = |p: &[u8]| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]);
        let [y0, y1] = [luma(&pair[..3]), luma(&pair[3..])];
        let mean = |k: usize| 0.5 * (f32::from(pair[k]) + f32::from(pair[k + 3]));
        let y = 0.5 * (y0 + y1);
        let chroma = |value: f32, share: f32| 128.0 + 0.5 * (value - y) / (1.0 - share);
        [y0, chroma(mean(2), 0.114), y1, chroma(mean(0), 0.299)].map(|value| value.round() as u8)
    });
    pairs.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sun::sun_position;

    #[test]
    fn prepared_pictures_unpack_to_what_was_rendered() {
        let mut frame = Frame::default();
        let codes = frame.codes_u8(SIZE.0, SIZE.1);
        codes.chunks_exact_mut(6).enumerate().for_each(|(at, pair)| {
            let colour = [at % 200 + 20, at % 130 + 60, at % 170 + 40].map(|code| code as u8);
            pair.copy_from_slice(&[colour, colour].concat());
        });
        let coding = YuvCoding { range: Range::Full, matrix: Matrix::Bt601 };
        let layout = Layout { format: PixelFormat::Yuyv, width: SIZE.0, height: SIZE.1, stride: 2 * SIZE.0, coding };
        let mut back = Frame::default();
        Unpacker::new(layout).unwrap().unpack(&yuyv(&frame), &mut back).unwrap();
        let off = (0..frame.codes.len()).map(|at| frame.codes.get(at).abs_diff(back.codes.get(at))).max();
        assert!(off <= Some(2), "{off:?}");
    }

    #[test]
    fn the_sun_stands_well_above_the_horizon_at_any_time() {
        for hour in 0..24 * 365 {
            let unix_s = 1_782_000_000.0 + 3600.0 * f64::from(hour);
            let altitude_deg = sun_position(unix_s, forenoon(unix_s)).unwrap().altitude_deg;
            assert!((25.0..75.0).contains(&altitude_deg), "{hour}: {altitude_deg}");
        }
    }
}
