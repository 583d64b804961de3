//! `usbcam-probe`: reads the virtual camera through V4L2, as a program at the post does, and judges what comes.
//!
//! Frames must be stamped (`usbcam run --stamp`). One line per finding; exit status 1 where something is not as it must be.
//! `hold` is also another program that has the camera, and `set` sets a control of any camera while others use it.

use anyhow::{Context, bail, ensure};
use relume_usbcam::log::monotonic_s;
use relume_usbcam::stream::{STAMP_BYTES, STAMP_MARK};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use v4l::buffer::{Metadata, Type};
use v4l::control::{Control, Value};
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream;
use v4l::video::Capture;
use v4l::{Device, FourCC};

const HELP: &str =
    "usbcam-probe wait | expose LATENCY LOG | rate WxH FRAMES | hold [FRAMES] | set CAMERA CONTROL VALUE";

const AUTO_WHITE_BALANCE: u32 = 0x0098_090c;
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
const MANUAL: i64 = 1;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["wait"] => wait(),
        ["expose", latency, log] => expose(latency.parse()?, Path::new(log)),
        ["rate", size, frames] => rate(size.parse()?, frames.parse()?),
        ["hold"] => hold(u32::MAX),
        ["hold", frames] => hold(frames.parse()?),
        ["set", camera, control, value] => set(camera, control, value.parse()?),
        _ => bail!("{HELP}"),
    }
}

/// The camera's picture node.
fn node() -> Option<PathBuf> {
    node_of(relume_usbcam::descriptors::PRODUCT)
}

/// The picture node of a camera by the beginning of its name: a UVC camera has a second one for metadata.
fn node_of(name: &str) -> Option<PathBuf> {
    let class = std::fs::read_dir("/sys/class/video4linux").ok()?;
    let reads = |path: PathBuf, text: &str| std::fs::read_to_string(path).is_ok_and(|found| found.starts_with(text));
    let found = class
        .flatten()
        .find(|entry| reads(entry.path().join("name"), name) && reads(entry.path().join("index"), "0"))?;
    Some(Path::new("/dev").join(found.file_name())).filter(|path| path.exists())
}

fn wait() -> anyhow::Result<()> {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(20) {
        if let Some(path) = node().filter(|path| Device::with_path(path).is_ok()) {
            println!("{} after {:.2} s", path.display(), begun.elapsed().as_secs_f64());
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    bail!("no camera after 20 s")
}

fn open(size: Option<relume_usbcam::offer::FrameSize>) -> anyhow::Result<Device> {
    let device = Device::with_path(node().context("no camera")?)?;
    let mut format = Capture::format(&device)?;
    if let Some(size) = size {
        (format.width, format.height) = (u32::from(size.width), u32::from(size.height));
    }
    (format.fourcc, format.stride) = (FourCC::new(b"YUYV"), 0);
    let taken = Capture::set_format(&device, &format)?;
    println!("format {}x{} {} {}", taken.width, taken.height, taken.fourcc, taken.colorspace);
    ensure!((taken.width, taken.height) == (format.width, format.height), "the size was not taken");
    device.set_control(Control { id: AUTO_WHITE_BALANCE, value: Value::Boolean(false) })?;
    device.set_control(Control { id: EXPOSURE_AUTO, value: Value::Integer(MANUAL) })?;
    Ok(device)
}

/// Sets a control by the name that the driver gives it.
fn set(camera: &str, control: &str, value: i64) -> anyhow::Result<()> {
    let device = Device::with_path(node_of(camera).with_context(|| format!("no camera {camera}"))?)?;
    let controls = device.query_controls()?;
    let found = controls.iter().find(|known| known.name == control).with_context(|| format!("no control {control}"))?;
    Ok(device.set_control(Control { id: found.id, value: Value::Integer(value) })?)
}

fn set_exposure(device: &Device, exposure_100us: u32) -> std::io::Result<()> {
    device.set_control(Control { id: EXPOSURE_ABSOLUTE, value: Value::Integer(i64::from(exposure_100us)) })
}

fn stream(device: &Device) -> anyhow::Result<Stream<'_>> {
    let mut stream = Stream::with_buffers(device, Type::VideoCapture, 4)?;
    stream.set_timeout(Duration::from_secs(4));
    Ok(stream)
}

/// Frame number and exposure (100 us) of a stamped frame.
fn stamp(frame: &[u8]) -> anyhow::Result<(u32, u32)> {
    ensure!(frame.starts_with(STAMP_MARK), "the frame carries no stamp");
    let number = |at: usize| u32::from_le_bytes([frame[at], frame[at + 1], frame[at + 2], frame[at + 3]]);
    Ok((number(4), number(8)))
}

/// Frame during which the log says that an exposure was set last.
fn set_during(log: &Path, exposure_100us: u32) -> anyhow::Result<u32> {
    let text = std::fs::read_to_string(log)?;
    let wanted = format!("-> {exposure_100us} during frame ");
    let line = text.lines().rev().find(|line| line.contains("set ExposureTime") && line.contains(&wanted));
    let number = line.and_then(|line| line.rsplit(' ').next()).context("the log has no such setting")?;
    Ok(number.parse()?)
}

/// Sets exposures; the frames must change by the power law of the response, `latency + 1` frames after the setting.
fn expose(latency: u32, log: &Path) -> anyhow::Result<()> {
    let device = open(None)?;
    set_exposure(&device, 9)?;
    let mut stream = stream(&device)?;
    // What is set before the first frame delays nothing.
    for _ in 0..8 {
        CaptureStream::next(&mut stream)?;
    }
    let mut pictures: Vec<(u32, Vec<u8>)> = Vec::new();
    for exposure_100us in [10, 20, 40, 15, 30] {
        let begun = Instant::now();
        set_exposure(&device, exposure_100us)?;
        let answered = begun.elapsed();
        let mut stale = 0;
        let number = loop {
            let (frame, _) = CaptureStream::next(&mut stream)?;
            let (found, exposure) = stamp(frame)?;
            if exposure == exposure_100us {
                pictures.push((exposure, frame.to_vec()));
                break found;
            }
            stale += 1;
            ensure!(stale < 60, "exposure {exposure_100us} never came");
        };
        let after = number - set_during(log, exposure_100us)?;
        println!(
            "exposure {exposure_100us}: set in {:.1} ms, {stale} stale frames read, first in the {after}th frame after",
            answered.as_secs_f64() * 1e3
        );
        ensure!(after == latency + 1, "must be the {}th", latency + 1);
    }
    judge(&pictures)
}

/// Luma less black, over pixels that clip in neither picture, must rise by the ratio of exposures to 1 / 2.2.
fn judge(pictures: &[(u32, Vec<u8>)]) -> anyhow::Result<()> {
    let (base_exposure, base) = pictures.first().context("no pictures")?;
    for (exposure, picture) in pictures.iter().skip(1) {
        let pairs = base[STAMP_BYTES..].chunks_exact(4).zip(picture[STAMP_BYTES..].chunks_exact(4));
        let (mut sums, mut count) = ([0u64; 2], 0);
        for (a, b) in pairs.filter(|(a, b)| is_exposed(a) && is_exposed(b)) {
            sums[0] += u64::from(a[0]) - 16;
            sums[1] += u64::from(b[0]) - 16;
            count += 1;
        }
        ensure!(count > 1000, "only {count} pixels to judge by");
        let found = sums[1] as f64 / sums[0] as f64;
        let expected = (f64::from(*exposure) / f64::from(*base_exposure)).powf(1.0 / 2.2);
        println!("exposure {base_exposure} -> {exposure}: luma x {found:.4}, law {expected:.4}, {count} pixels");
        ensure!((found / expected - 1.0).abs() < 0.01, "off by more than 1 %");
    }
    Ok(())
}

/// No channel of the pair of pixels clips, none is in the noise.
fn is_exposed(pair: &[u8]) -> bool {
    let [y0, cb, y1, cr] = [pair[0], pair[1], pair[2], pair[3]].map(i32::from);
    let channels = [1166 * (y0 - 16) + 1602 * (cr - 128), 1166 * (y0 - 16) + 2023 * (cb - 128)];
    (y0 - y1).abs() < 12 && (50..200).contains(&y0) && channels.iter().all(|c| (40_000..225_000).contains(c))
}

fn rate(size: relume_usbcam::offer::FrameSize, frames: u32) -> anyhow::Result<()> {
    let device = open(Some(size))?;
    set_exposure(&device, 20)?;
    let opened = Instant::now();
    let mut stream = stream(&device)?;
    let (first, _) = CaptureStream::next(&mut stream)?;
    let (begun, first) = (Instant::now(), stamp(first)?.0);
    println!("first frame after {:.0} ms", opened.elapsed().as_secs_f64() * 1e3);
    let mut last = first;
    for _ in 0..frames {
        last = stamp(CaptureStream::next(&mut stream)?.0)?.0;
    }
    let fps = f64::from(frames) / begun.elapsed().as_secs_f64();
    println!("{size}: {fps:.2} frames/s read, {} of {} sensor frames", frames, last - first);
    Ok(())
}

/// Tells of everything unusual until the stream ends.
fn hold(frames: u32) -> anyhow::Result<()> {
    let device = open(None)?;
    set_exposure(&device, 20)?;
    let mut stream = stream(&device)?;
    let mut watch = Watch::default();
    let error = loop {
        if watch.frames == frames {
            println!("{frames} frames");
            return Ok(());
        }
        match CaptureStream::next(&mut stream) {
            Ok((frame, meta)) => watch.see(&frame[..frame.len().min(meta.bytesused as usize)], meta),
            Err(error) => break error,
        }
    };
    let ended_s = monotonic_s();
    // The driver tells readers before it takes the node away.
    let begun = Instant::now();
    while node().is_some() && begun.elapsed() < Duration::from_secs(1) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let (errno, there) = (error.raw_os_error(), node().is_some());
    println!("at {ended_s:.3} after {} frames: {error} ({errno:?}), node there: {there}", watch.frames);
    Ok(())
}

#[derive(Default)]
struct Watch {
    frames: u32,
    sequence: Option<u32>,
    hash: u64,
    repeated: u32,
    at_s: f64,
}

impl Watch {
    fn see(&mut self, frame: &[u8], meta: &Metadata) {
        let now_s = monotonic_s();
        if let Some(gap) = self.sequence.map(|last| meta.sequence.wrapping_sub(last)).filter(|gap| *gap != 1) {
            println!("frame {}: sequence went on by {gap}", self.frames);
        }
        if meta.flags.bits() & 0x40 != 0 {
            println!("frame {}: error flag, {} bytes", self.frames, frame.len());
        }
        if self.frames > 0 && now_s - self.at_s > 0.4 {
            println!("frame {}: after a pause of {:.2} s", self.frames, now_s - self.at_s);
        }
        let hash = frame.iter().fold(0u64, |hash, byte| hash.wrapping_mul(31).wrapping_add(u64::from(*byte)));
        self.repeated = if hash == self.hash { self.repeated + 1 } else { 0 };
        if self.repeated == 1 {
            println!("frame {}: the same picture again", self.frames);
        }
        let mean = frame.iter().step_by(2).map(|y| u64::from(*y)).sum::<u64>() / (frame.len() as u64 / 2).max(1);
        if self.frames.is_multiple_of(30) || mean < 18 {
            println!("frame {}: mean luma {mean}", self.frames);
        }
        (self.hash, self.sequence, self.at_s) = (hash, Some(meta.sequence), now_s);
        self.frames += 1;
    }
}
