//! A recorded camera: a folder of PNG frames (8 or 16 bit) and `frames.json`.
//!
//! `frames.json`: `[{"file":"a.png","time_s":0.01,"gain":1,"captured_at":"2026-06-21T12:00:00Z"}, ...]`; `time_s` is the
//! exposure time in seconds; `gain` (1 if left out) and `captured_at` (unix seconds or RFC 3339) may be left out.

use super::{Camera, CameraError, CameraLimits, Codes, Exposure, Frame};
use crate::sun::parse_utc;
use serde::Deserialize;
use std::io::BufReader;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    file: String,
    time_s: f64,
    #[serde(default = "one")]
    gain: f64,
    captured_at: Option<Moment>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Moment {
    Seconds(f64),
    Text(String),
}

fn one() -> f64 {
    1.0
}

/// A recorded frame that has not been read yet.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// The picture.
    pub path: PathBuf,
    /// The exposure it was taken with.
    pub exposure: Exposure,
    /// When it was taken, unix seconds; 0 if the recording does not say.
    pub captured_at_s: f64,
}

/// Frames of a folder, in the order of `frames.json`. A request moves on to the next frame of that exposure.
#[derive(Debug)]
pub struct ReplayCamera {
    entries: Vec<Recorded>,
    next: usize,
    wanted: Option<Exposure>,
    size: (usize, usize),
    repeat: bool,
}

fn refuse(name: &Path, what: impl ToString) -> CameraError {
    let what = what.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    CameraError::Recording { name: name.display().to_string(), what }
}

fn entry(index: usize, raw: Entry, folder: &Path, list: &Path) -> Result<Recorded, CameraError> {
    let bad = |field: &str, what: &str| Err(refuse(list, format!("entry {index} ({}): {field}: {what}", raw.file)));
    if !(raw.time_s.is_finite() && raw.time_s > 0.0) {
        return bad("time_s", "must be a positive exposure time in seconds");
    }
    if !(raw.gain.is_finite() && raw.gain > 0.0) {
        return bad("gain", "must be positive");
    }
    let captured_at_s = match &raw.captured_at {
        None => 0.0,
        Some(Moment::Seconds(seconds)) if seconds.is_finite() => *seconds,
        Some(Moment::Seconds(_)) => return bad("captured_at", "must be finite"),
        Some(Moment::Text(text)) => match parse_utc(text) {
            Ok(seconds) => seconds,
            Err(error) => return bad("captured_at", &error.to_string()),
        },
    };
    let exposure = Exposure { exposure_s: raw.time_s, gain: raw.gain };
    Ok(Recorded { path: folder.join(&raw.file), exposure, captured_at_s })
}

/// Reads `frames.json` of a folder and checks every entry, without reading the pictures.
///
/// # Errors
/// [`CameraError::Recording`], naming file, entry and field.
pub fn read_list(folder: &Path) -> Result<Vec<Recorded>, CameraError> {
    let list = folder.join("frames.json");
    let text = std::fs::read_to_string(&list).map_err(|error| refuse(&list, error))?;
    let raw: Vec<Entry> = serde_json::from_str(&text).map_err(|error| refuse(&list, error))?;
    if raw.is_empty() {
        return Err(refuse(&list, "no entries; list at least one frame"));
    }
    raw.into_iter().enumerate().map(|(index, raw)| entry(index, raw, folder, &list)).collect()
}

/// Reads one recorded picture into a frame.
///
/// # Errors
/// [`CameraError::Recording`], naming the picture.
pub fn read_frame(recorded: &Recorded, sequence: u64, into: &mut Frame) -> Result<(), CameraError> {
    let path = &recorded.path;
    let file = std::fs::File::open(path).map_err(|error| refuse(path, error))?;
    let reader = image::ImageReader::with_format(BufReader::new(file), image::ImageFormat::Png);
    let picture = reader.decode().map_err(|error| refuse(path, error))?;
    (into.width, into.height) = (picture.width() as usize, picture.height() as usize);
    let deep = picture.color().bytes_per_pixel() / picture.color().channel_count() > 1;
    into.codes =
        if deep { Codes::U16(picture.into_rgb16().into_raw()) } else { Codes::U8(picture.into_rgb8().into_raw()) };
    into.exposure = recorded.exposure;
    into.sequence = sequence;
    into.captured_at_s = recorded.captured_at_s;
    Ok(())
}

impl ReplayCamera {
    /// Opens a folder; `repeat` starts over after the last frame instead of ending.
    ///
    /// # Errors
    /// [`CameraError::Recording`], naming file and entry: a bad list, a first picture that cannot be read.
    pub fn open(folder: &Path, repeat: bool) -> Result<Self, CameraError> {
        let entries = read_list(folder)?;
        let mut first = Frame::default();
        read_frame(&entries[0], 0, &mut first)?;
        Ok(ReplayCamera { entries, next: 0, wanted: None, size: (first.width, first.height), repeat })
    }

    /// All recorded frames, in order.
    pub fn entries(&self) -> &[Recorded] {
        &self.entries
    }

    /// The exposures of one pass: those of the recording up to the first that comes again.
    pub fn series(&self) -> Vec<Exposure> {
        let mut series: Vec<Exposure> = Vec::new();
        for entry in &self.entries {
            if series.iter().any(|known| known.same_as(&entry.exposure)) {
                break;
            }
            series.push(entry.exposure);
        }
        series
    }
}

impl Camera for ReplayCamera {
    fn limits(&self) -> CameraLimits {
        let times = self.entries.iter().map(|entry| entry.exposure.exposure_s);
        CameraLimits {
            width: self.size.0,
            height: self.size.1,
            min_exposure_s: times.clone().fold(f64::INFINITY, f64::min),
            max_exposure_s: times.fold(0.0, f64::max),
            exposure_step_s: 0.0,
            max_gain: self.entries.iter().map(|entry| entry.exposure.gain).fold(1.0, f64::max),
            delay_frames: 0,
        }
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        let distance = |other: &Exposure| (other.product_s() / exposure.product_s()).ln().abs();
        let recorded = self.entries.iter().map(|entry| entry.exposure);
        let nearest = recorded.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(exposure);
        self.wanted = Some(nearest);
        Ok(nearest)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        let count = self.entries.len();
        let end = if self.repeat { self.next + count } else { count };
        let fits = |at: &usize| self.wanted.is_none_or(|wanted| self.entries[at % count].exposure.same_as(&wanted));
        let at = (self.next..end).find(fits).ok_or(CameraError::Ended)?;
        self.next = at + 1;
        let index = at % count;
        read_frame(&self.entries[index], at as u64, into)?;
        if (into.width, into.height) != self.size {
            let (width, height) = self.size;
            let what =
                format!("entry {index}: {}x{} pixels; the first frame has {width}x{height}", into.width, into.height);
            return Err(refuse(&self.entries[index].path, what));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::take_series;

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        image::RgbImage::from_fn(4, 2, |x, _| image::Rgb([x as u8 * 10, 1, 2]))
            .save(folder.path().join("a.png"))
            .unwrap();
        let deep = image::ImageBuffer::from_fn(4, 2, |x, y| image::Rgb([x as u16 * 1000, y as u16, 65535u16]));
        deep.save(folder.path().join("b.png")).unwrap();
        folder
    }

    fn write(folder: &tempfile::TempDir, text: &str) {
        std::fs::write(folder.path().join("frames.json"), text).unwrap();
    }

    #[test]
    fn frames_come_back_with_their_values() {
        let folder = folder();
        let list = r#"[{"file":"a.png","time_s":0.01},{"file":"b.png","time_s":0.04,"gain":2,"captured_at":"1970-01-01T00:01:00Z"}]"#;
        write(&folder, list);
        let mut camera = ReplayCamera::open(folder.path(), false).unwrap();
        let mut frames = Vec::new();
        take_series(&mut camera, &ReplayCamera::open(folder.path(), false).unwrap().series(), &mut frames).unwrap();
        assert_eq!(frames.len(), 2);
        assert_eq!((frames[0].codes.max(), frames[0].codes.get(3)), (255, 10));
        assert_eq!((frames[1].codes.max(), frames[1].codes.get(3), frames[1].captured_at_s), (65535, 1000, 60.0));
        assert_eq!(frames[1].exposure.product_s(), 0.08);
        assert!(matches!(camera.frame(&mut Frame::default()), Err(CameraError::Ended)));
    }

    #[test]
    fn bad_lists_name_file_and_entry() {
        let folder = folder();
        let good = r#"{"file":"a.png","time_s":0.01}"#;
        let cases = [
            (r#"{"file":"a.png","time_s":0}"#, "entry 1 (a.png): time_s"),
            (r#"{"file":"a.png","time_s":1,"gain":-1}"#, "entry 1 (a.png): gain"),
            (r#"{"file":"a.png","time_s":1,"captured_at":"noon"}"#, "entry 1 (a.png): captured_at"),
            (r#"{"file":"a.png","time":1}"#, "unknown field `time`"),
        ];
        for (bad, expected) in cases {
            write(&folder, &format!("[{good},{bad}]"));
            let error = ReplayCamera::open(folder.path(), false).unwrap_err().to_string();
            assert!(error.contains("frames.json") && error.contains(expected) && !error.contains('\n'), "{error}");
        }
        write(&folder, r#"[{"file":"none.png","time_s":1}]"#);
        assert!(ReplayCamera::open(folder.path(), false).unwrap_err().to_string().contains("none.png"));
        write(&folder, "[]");
        assert!(ReplayCamera::open(folder.path(), false).is_err());
    }
}
