//! The camera's colours: from its own red, green and blue to Rec.709.
//!
//! `CAMERA.json`: `{"white_balance":[r,g,b],"matrix":[[3x3]]}`: Rec.709 = matrix x (white_balance x camera), both linear. The
//! matrix's rows sum to 1 and the green of the white balance is 1, so that light of the colour of D65 keeps its green
//! value, comes out grey, and radiance keeps its unit. Without the file the camera's colours count as Rec.709.

pub mod chart;
pub mod difference;
pub mod spaces;

use crate::outfile::{OutError, write_whole};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// Why a colour file could not be used; one line that names file and field.
#[derive(Debug, thiserror::Error)]
pub enum ColourError {
    /// The file could not be read.
    #[error("{name}: {source}")]
    Io {
        /// File name.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no description of colours.
    #[error("{name}: {reason}")]
    Json {
        /// File name.
        name: String,
        /// What the parser said.
        reason: String,
    },
    /// A field's value makes no sense.
    #[error("{name}: {field}: {what}")]
    Value {
        /// File name.
        name: String,
        /// The field at fault.
        field: &'static str,
        /// What is wrong and what to do.
        what: &'static str,
    },
}

/// How a camera's linear colours become linear Rec.709.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraColour {
    /// Factors of the camera's red, green and blue; green's is 1.
    pub white_balance: [f64; 3],
    /// From balanced camera colours to Rec.709; rows sum to 1.
    pub matrix: [[f64; 3]; 3],
}

impl Default for CameraColour {
    /// The camera's colours are Rec.709 already.
    fn default() -> Self {
        CameraColour { white_balance: [1.0; 3], matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] }
    }
}

impl CameraColour {
    /// Reads `CAMERA.json`.
    ///
    /// # Errors
    /// [`ColourError`], naming the file and the field at fault.
    pub fn load(path: &Path) -> Result<Self, ColourError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| ColourError::Io { name: name.clone(), source })?;
        let colour: CameraColour = serde_json::from_str(&text)
            .map_err(|reason| ColourError::Json { name: name.clone(), reason: reason.to_string() })?;
        let bad = |field, what| Err(ColourError::Value { name: name.clone(), field, what });
        if !colour.white_balance.iter().all(|w| (0.01..=100.0).contains(w)) {
            return bad("white_balance", "must be three factors between 0.01 and 100");
        }
        if !colour.matrix.iter().flatten().all(|m| m.abs() <= 100.0) {
            return bad("matrix", "must hold finite numbers");
        }
        if colour.matrix.iter().any(|row| (row.iter().sum::<f64>() - 1.0).abs() > 1e-3) {
            return bad("matrix", "every row must sum to 1, so that balanced white stays white");
        }
        Ok(colour)
    }

    /// Writes `CAMERA.json`, whole.
    ///
    /// # Errors
    /// [`OutError`], naming the file.
    pub fn save(&self, path: &Path) -> Result<(), OutError> {
        write_whole(path, |out| {
            serde_json::to_writer(&mut *out, self)?;
            out.write_all(b"\n")
        })
    }

    /// Matrix and white balance in one: Rec.709 = this x camera.
    pub fn to_rec709(&self) -> [[f32; 3]; 3] {
        self.matrix.map(|row| std::array::from_fn(|k| (row[k] * self.white_balance[k]) as f32))
    }
}

#[cfg(test)]
mod tests;
