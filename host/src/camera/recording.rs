//! A recording that grows: a folder of PNG frames and `frames.json`, as [`super::replay`] reads it.
//!
//! A frame's picture is whole on the disk before the list names it, and the list is replaced whole: whatever ends the
//! recording, what was listed can be read.

use super::replay::{Recorded, read_frame, read_list};
use super::{CameraError, Codes, Frame};
use crate::failure::Failure;
use crate::outfile::{OutError, check_writable, write_whole};
use crate::picture::encode_png;
use crate::sun::format_utc;
use image::ExtendedColorType;
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Why a recording cannot be begun, or not go on; one line.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// There is one already.
    #[error("{}: holds a recording already; --resume goes on with it, or name another folder", .0.display())]
    Exists(PathBuf),
    /// What is there has pictures of another size.
    #[error("{}: its frames have {}x{} pixels, the camera gives {}x{}; name another folder", folder.display(), listed.0,
            listed.1, given.0, given.1)]
    Size {
        /// The recording.
        folder: PathBuf,
        /// Width and height of the frames that are there.
        listed: (usize, usize),
        /// Width and height of a new one.
        given: (usize, usize),
    },
    /// What is there cannot be read.
    #[error(transparent)]
    Listed(#[from] CameraError),
    /// The folder cannot be made.
    #[error("{}: cannot be made: {reason}", folder.display())]
    Folder {
        /// The recording.
        folder: PathBuf,
        /// What the system said.
        reason: io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Out(#[from] OutError),
}

impl From<RecordingError> for Failure {
    fn from(error: RecordingError) -> Self {
        match error {
            RecordingError::Out(out) => out.into(),
            other => Failure::BadInput(other.into()),
        }
    }
}

/// An entry of `frames.json`.
#[derive(Serialize)]
struct Entry {
    file: String,
    time_s: f64,
    gain: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    captured_at: Option<String>,
}

impl Entry {
    fn new(file: String, recorded: &Recorded) -> Self {
        let (time_s, gain) = (recorded.exposure.exposure_s, recorded.exposure.gain);
        let captured_at = (recorded.captured_at_s > 0.0).then(|| to_the_millisecond(recorded.captured_at_s));
        Entry { file, time_s, gain, captured_at }
    }
}

/// RFC 3339, UTC.
fn to_the_millisecond(unix_s: f64) -> String {
    let ms = (unix_s * 1e3).round();
    let whole = format_utc((ms / 1e3).floor());
    format!("{}.{:03}Z", whole.trim_end_matches('Z'), ms.rem_euclid(1e3))
}

/// A folder of frames that grows.
pub struct Recording {
    folder: PathBuf,
    entries: Vec<Entry>,
    size: Option<(usize, usize)>,
}

impl Recording {
    /// Looks whether a folder can take a recording; `resume` goes on with one that is there. It is made with the first frame.
    ///
    /// # Errors
    /// [`RecordingError`]: there is one, it cannot be read, or nothing can be written there.
    pub fn open(folder: &Path, resume: bool) -> Result<Self, RecordingError> {
        let list = folder.join("frames.json");
        let mut recording = Recording { folder: folder.to_path_buf(), entries: Vec::new(), size: None };
        if list.exists() {
            if !resume {
                return Err(RecordingError::Exists(folder.to_path_buf()));
            }
            recording.take_over(&read_list(folder)?)?;
        }
        check_writable(if folder.is_dir() { &list } else { folder })?;
        Ok(recording)
    }

    fn take_over(&mut self, listed: &[Recorded]) -> Result<(), RecordingError> {
        if let Some(first) = listed.first() {
            let mut frame = Frame::default();
            read_frame(first, 0, &mut frame)?;
            self.size = Some((frame.width, frame.height));
        }
        self.entries.extend(listed.iter().map(|recorded| {
            let name = recorded.path.strip_prefix(&self.folder).unwrap_or(&recorded.path);
            Entry::new(name.display().to_string(), recorded)
        }));
        Ok(())
    }

    /// Frames that it holds.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Does it hold none?
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Writes a frame, with the exposure and the time it carries, and lists it.
    ///
    /// # Errors
    /// [`RecordingError`]; the list is as before then.
    pub fn add(&mut self, frame: &Frame) -> Result<(), RecordingError> {
        let given = (frame.width, frame.height);
        if let Some(listed) = self.size.filter(|listed| *listed != given) {
            return Err(RecordingError::Size { folder: self.folder.clone(), listed, given });
        }
        let is_first = !self.folder.is_dir();
        if is_first {
            let refused = |reason| RecordingError::Folder { folder: self.folder.clone(), reason };
            std::fs::create_dir(&self.folder).map_err(refused)?;
        }
        let name = self.free_name();
        let path = self.folder.join(&name);
        write_whole(&path, |out| write_picture(out, frame)).inspect_err(|_| {
            // Nothing is left of a recording that has not begun. A folder that another has put something into stays.
            let _ = if is_first { std::fs::remove_dir(&self.folder) } else { Ok(()) };
        })?;
        let recorded = Recorded { path, exposure: frame.exposure, captured_at_s: frame.captured_at_s };
        self.entries.push(Entry::new(name, &recorded));
        self.list().inspect_err(|_| {
            self.entries.pop();
            // Unlisted it is of no use; where even this fails, it does no harm either.
            let _ = std::fs::remove_file(&recorded.path);
        })?;
        self.size = Some(given);
        Ok(())
    }

    /// A name that no file has: what a power cut left unlisted stays.
    fn free_name(&self) -> String {
        let is_free = |name: &String| !self.folder.join(name).exists();
        (self.entries.len()..).map(|number| format!("{number:05}.png")).find(is_free).unwrap_or_default()
    }

    /// Writes the list, an entry a line.
    fn list(&mut self) -> Result<(), OutError> {
        write_whole(&self.folder.join("frames.json"), |out| {
            for (at, entry) in self.entries.iter().enumerate() {
                out.write_all(if at == 0 { b"[\n" } else { b",\n" })?;
                serde_json::to_writer(&mut *out, entry)?;
            }
            out.write_all(b"\n]\n")
        })
    }
}

/// The codes as they are, 8 or 16 bit, without loss.
fn write_picture(out: impl Write, frame: &Frame) -> io::Result<()> {
    let (bytes, colour): (&[u8], _) = match &frame.codes {
        Codes::U8(codes) => (codes, ExtendedColorType::Rgb8),
        Codes::U16(codes) => (bytemuck::cast_slice(codes), ExtendedColorType::Rgb16),
    };
    encode_png(out, bytes, (frame.width, frame.height), colour)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Exposure;

    fn frame(deep: bool, size: (usize, usize), captured_at_s: f64) -> Frame {
        let exposure = Exposure { exposure_s: 1.0 / 3000.0, gain: 1.5 };
        let mut frame = Frame { exposure, captured_at_s, ..Frame::default() };
        if deep {
            frame.codes_u16(size.0, size.1).iter_mut().zip(0..).for_each(|(code, at)| *code = 777 * at);
        } else {
            frame.codes_u8(size.0, size.1).iter_mut().zip(0..).for_each(|(code, at)| *code = 3 * at);
        }
        frame
    }

    #[test]
    fn frames_come_back_as_they_were_taken() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("frames");
        for (deep, time_s) in [(false, 1_782_043_200.123), (true, 0.0)] {
            let _ = std::fs::remove_dir_all(&place);
            let taken = frame(deep, (5, 3), time_s);
            let mut recording = Recording::open(&place, false).unwrap();
            recording.add(&taken).unwrap();
            let listed = read_list(&place).unwrap();
            let mut back = Frame::default();
            read_frame(&listed[0], 0, &mut back).unwrap();
            assert!((back.captured_at_s - time_s).abs() < 1e-6, "{}", back.captured_at_s);
            assert_eq!(Frame { captured_at_s: time_s, ..back }, taken);
        }
    }

    #[test]
    fn what_is_there_is_gone_on_with_only_when_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("frames");
        Recording::open(&place, true).unwrap().add(&frame(false, (5, 3), 0.0)).unwrap();
        // As after a power cut between picture and list.
        std::fs::write(place.join("00001.png"), "half").unwrap();
        let refused = Recording::open(&place, false).err().unwrap().to_string();
        assert!(refused.contains("--resume") && !refused.contains('\n'), "{refused}");
        let mut resumed = Recording::open(&place, true).unwrap();
        resumed.add(&frame(false, (5, 3), 60.0)).unwrap();
        let other = resumed.add(&frame(false, (5, 4), 60.0)).unwrap_err().to_string();
        assert!(other.contains("5x3") && other.contains("5x4"), "{other}");
        let names: Vec<_> = read_list(&place).unwrap().iter().map(|r| r.path.clone()).collect();
        assert_eq!(names, ["00000.png", "00002.png"].map(|name| place.join(name)));
        assert_eq!(std::fs::read(place.join("00001.png")).unwrap(), b"half");
    }

    #[test]
    fn a_list_that_cannot_be_written_leaves_the_one_before() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("frames");
        let mut recording = Recording::open(&place, false).unwrap();
        recording.add(&frame(false, (5, 3), 0.0)).unwrap();
        let list = place.join("frames.json");
        std::fs::remove_file(&list).unwrap();
        // A folder in its place takes no list.
        std::fs::create_dir(&list).unwrap();
        assert!(recording.add(&frame(false, (5, 3), 0.0)).is_err());
        assert_eq!((recording.len(), place.join("00001.png").exists()), (1, false));
        std::fs::remove_dir(&list).unwrap();
        recording.add(&frame(false, (5, 3), 0.0)).unwrap();
        assert_eq!(read_list(&place).unwrap().len(), 2);
    }
}
