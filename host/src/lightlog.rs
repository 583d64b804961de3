//! The light that a post relit, frame by frame, so that its pictures can be made again elsewhere, bit for bit.
//!
//! One JSON object per line: the frame's number, the post's time, the exposures that the weights were relit with (two where
//! the first asked for another), and the weights. It grows by about 8 kB with each new light: for rehearsals, not seasons.

use crate::weights::{PatchWeights, SunWeight};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

/// One line. What is logged is borrowed from the post, which asks for no memory for it; what was read is owned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoggedLight<'a> {
    /// Number of the frame that first showed it.
    pub frame: u64,
    /// The post's time, Unix seconds.
    pub unix_s: f64,
    /// Factors from radiance to display white that it was relit with, in order; the last is the one shown.
    pub exposures: Cow<'a, [f32]>,
    /// RGB radiance per patch.
    pub radiance: Cow<'a, [[f32; 3]]>,
    /// Direction towards the sun and its RGB irradiance.
    pub sun: Option<([f32; 3], [f32; 3])>,
}

impl LoggedLight<'_> {
    /// The weights.
    pub fn weights(self) -> PatchWeights {
        let sun = self.sun.map(|(dir_world, irradiance)| SunWeight { dir_world, irradiance });
        PatchWeights { radiance: self.radiance.into_owned(), sun }
    }
}

/// Why a log cannot be written or read; one line.
#[derive(Debug, thiserror::Error)]
#[error("{}: {what}", path.display())]
pub struct LightLogError {
    path: PathBuf,
    what: String,
}

/// A log that is being written.
#[derive(Debug)]
pub struct LightLog {
    path: PathBuf,
    file: BufWriter<File>,
}

impl LightLog {
    /// Starts a log; an older one of this name is replaced.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn create(path: &Path) -> Result<Self, LightLogError> {
        let file = File::create(path)
            .map_err(|error| LightLogError { path: path.to_path_buf(), what: format!("cannot be written: {error}") })?;
        Ok(LightLog { path: path.to_path_buf(), file: BufWriter::new(file) })
    }

    /// Adds a line.
    ///
    /// # Errors
    /// When it cannot be written, as on a full disk.
    pub fn add(&mut self, light: &LoggedLight<'_>) -> Result<(), LightLogError> {
        let written = serde_json::to_writer(&mut self.file, light)
            .map_err(std::io::Error::from)
            .and_then(|()| self.file.write_all(b"\n"))
            .and_then(|()| self.file.flush());
        written.map_err(|error| LightLogError { path: self.path.clone(), what: format!("the log ends here: {error}") })
    }
}

/// A log that is being read.
#[derive(Debug)]
pub struct LightLogReader {
    path: PathBuf,
    lines: std::io::Lines<BufReader<File>>,
    number: usize,
}

impl LightLogReader {
    /// Opens a log.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, LightLogError> {
        let file = File::open(path)
            .map_err(|error| LightLogError { path: path.to_path_buf(), what: format!("cannot be read: {error}") })?;
        Ok(LightLogReader { path: path.to_path_buf(), lines: BufReader::new(file).lines(), number: 0 })
    }
}

impl Iterator for LightLogReader {
    type Item = Result<LoggedLight<'static>, LightLogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let line = self.lines.next()?;
        self.number += 1;
        let fault =
            |what: String| LightLogError { path: self.path.clone(), what: format!("line {}: {what}", self.number) };
        Some(
            line.map_err(|error| fault(error.to_string()))
                .and_then(|line| serde_json::from_str(&line).map_err(|error| fault(format!("not a light: {error}")))),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("light.jsonl");
        // Every exponent, with mantissas that have no short decimal.
        let radiance: Vec<[f32; 3]> =
            (1..200u32).map(|k| [0x0012_3457, 0x0055_5555, 0x007f_ffff].map(|m| f32::from_bits(k << 23 | m))).collect();
        let light = LoggedLight {
            frame: 7,
            unix_s: 1_782_040_200.123,
            exposures: vec![0.1, 1.0 / 3.0].into(),
            radiance: radiance.into(),
            sun: Some(([0.6, 0.8, 0.0], [1e5, 9.7e4, 1.0 / 7.0])),
        };
        let mut log = LightLog::create(&path).unwrap();
        log.add(&light).unwrap();
        log.add(&light).unwrap();
        let read: Vec<LoggedLight<'_>> = LightLogReader::open(&path).unwrap().map(Result::unwrap).collect();
        assert_eq!(read, [light.clone(), light]);
    }

    #[test]
    fn a_broken_line_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("light.jsonl");
        std::fs::write(&path, "{\"frame\":1}\n").unwrap();
        let error = LightLogReader::open(&path).unwrap().next().unwrap().unwrap_err().to_string();
        assert!(error.contains("light.jsonl: line 1: not a light") && error.contains("unix_s"), "{error}");
        assert!(
            LightLogReader::open(&folder.path().join("none")).unwrap_err().to_string().contains("none: cannot be read")
        );
    }
}
