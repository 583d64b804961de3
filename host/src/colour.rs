//! The camera's colours: from its own red, green and blue to Rec.709.
//!
//! `CAMERA.json`: `{"white_balance":[r,g,b],"matrix":[[3x3]]}`: Rec.709 = matrix x (white_balance x camera), both linear. The
//! matrix's rows sum to 1 and the green of the white balance is 1, so that light of the colour of D65 keeps its green
//! value, comes out grey, and radiance keeps its unit. Without the file the camera's colours count as Rec.709.

pub mod chart;
pub mod difference;
pub mod spaces;

use crate::jsonfile::{self, JsonError};
use crate::outfile::OutError;
use serde::{Deserialize, Serialize};
use std::path::Path;

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
    /// [`JsonError`], naming the file and the field at fault.
    pub fn load(path: &Path) -> Result<Self, JsonError> {
        let colour: CameraColour = jsonfile::load(path)?;
        let bad = |field, what: &str| {
            Err(JsonError::Value { name: path.display().to_string(), field, what: what.to_owned() })
        };
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
        jsonfile::save(path, self)
    }

    /// The way back: camera = this x Rec.709; none where the matrix has no inverse.
    pub fn from_rec709(&self) -> Option<[[f64; 3]; 3]> {
        let rows = inverse(self.matrix)?;
        Some(std::array::from_fn(|i| rows[i].map(|v| v / self.white_balance[i])))
    }

    /// Matrix and white balance in one: Rec.709 = this x camera.
    pub fn to_rec709(&self) -> [[f32; 3]; 3] {
        self.matrix.map(|row| std::array::from_fn(|k| (row[k] * self.white_balance[k]) as f32))
    }
}

/// Inverse by cofactors; none of a singular matrix.
fn inverse(m: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let cofactor = |i: usize, j: usize| {
        let [a, b, c, d] = [(i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3];
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    let of = |i: usize| std::array::from_fn(|j| cofactor(j, i) / determinant);
    (determinant.abs() > 1e-9).then(|| std::array::from_fn(of))
}

#[cfg(test)]
mod tests;
