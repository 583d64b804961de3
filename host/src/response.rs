//! The camera's response: from codes to linear fractions of full well, per channel.
//!
//! File: CSV rows `code/max,R,G,B`, code/max rising from 0 to 1, R, G and B linear with full well = 1; a header line may
//! precede them. Between rows the curve is linear.

pub mod blocks;
pub mod calibration;
mod spline;

use std::fmt::Write as _;
use std::path::Path;

/// Why a response curve could not be used; one line that names file and row.
#[derive(Debug, thiserror::Error)]
pub enum ResponseError {
    /// The file could not be read or written.
    #[error("{name}: {source}")]
    Io {
        /// File name.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A row is not what it should be.
    #[error("{name}: line {line}: {what}")]
    Row {
        /// File name.
        name: String,
        /// Line number, from 1.
        line: usize,
        /// What is wrong and what to do.
        what: String,
    },
    /// The rows make no curve.
    #[error("{name}: {what}")]
    Curve {
        /// File name.
        name: String,
        /// What is wrong and what to do.
        what: &'static str,
    },
}

/// Linear full-well fraction by code / max.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// Rows of code / max and the three channels' fractions.
    rows: Vec<[f64; 4]>,
}

impl Default for Response {
    fn default() -> Self {
        Response { rows: vec![[0.0; 4], [1.0; 4]] }
    }
}

impl Response {
    /// A curve from rows `[code/max, r, g, b]`; `name` is what errors call it.
    ///
    /// # Errors
    /// [`ResponseError`] (lines are counted by rows) unless the codes run from 0 to 1 and every channel rises (it may stay level)
    /// within 0..=1.
    pub fn from_rows(rows: Vec<[f64; 4]>, name: &str) -> Result<Self, ResponseError> {
        let curve = |what| Err(ResponseError::Curve { name: name.into(), what });
        let row = |at: usize, what: String| Err(ResponseError::Row { name: name.into(), line: at + 1, what });
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
            return curve("no rows; write code/max,R,G,B");
        };
        if rows.len() < 2 || first[0].abs() > 1e-6 || (last[0] - 1.0).abs() > 1e-6 {
            return curve("code/max must run from 0 to 1");
        }
        for (at, values) in rows.iter().enumerate() {
            if !values.iter().all(|v| v.is_finite() && (-1e-6..=1.0 + 1e-6).contains(v)) {
                return row(at, format!("{values:?}: values must lie between 0 and 1 (full well = 1)"));
            }
            if at > 0 && values[0] <= rows[at - 1][0] {
                return row(at, format!("code/max {} does not rise", values[0]));
            }
            if at > 0 && (1..4).any(|k| values[k] < rows[at - 1][k]) {
                return row(at, format!("{values:?} falls below the row before; a response curve rises"));
            }
        }
        if (1..4).any(|k| last[k] <= first[k]) {
            return curve("a channel stays level; a response curve rises");
        }
        Ok(Response { rows })
    }

    /// Reads a curve file.
    ///
    /// # Errors
    /// [`ResponseError`], naming the file and the line at fault.
    pub fn load(path: &Path) -> Result<Self, ResponseError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| ResponseError::Io { name: name.clone(), source })?;
        let (mut rows, mut lines) = (Vec::new(), Vec::new());
        for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let fields: Vec<&str> = line.split(',').map(str::trim).collect();
            let numbers: Vec<f64> = fields.iter().filter_map(|field| field.parse().ok()).collect();
            match <[f64; 4]>::try_from(numbers) {
                Ok(row) if fields.len() == 4 => {
                    rows.push(row);
                    lines.push(index + 1);
                }
                _ if index == 0 => {}
                _ => {
                    let what = format!("`{line}`: write four numbers code/max,R,G,B");
                    return Err(ResponseError::Row { name, line: index + 1, what });
                }
            }
        }
        Self::from_rows(rows, &name).map_err(|error| match error {
            ResponseError::Row { name, line, what } => ResponseError::Row { name, line: lines[line - 1], what },
            other => other,
        })
    }

    /// The text of the curve file.
    pub fn to_csv(&self) -> String {
        let mut text = String::from("code/max,R,G,B\n");
        for [code, r, g, b] in &self.rows {
            let _ = writeln!(text, "{code},{r},{g},{b}");
        }
        text
    }

    /// Writes the curve file.
    ///
    /// # Errors
    /// [`ResponseError::Io`], naming the file.
    pub fn save(&self, path: &Path) -> Result<(), ResponseError> {
        let io = |source| ResponseError::Io { name: path.display().to_string(), source };
        std::fs::write(path, self.to_csv()).map_err(io)
    }

    /// The rows `[code/max, R, G, B]`.
    pub fn rows(&self) -> &[[f64; 4]] {
        &self.rows
    }

    /// The largest code / max up to which the curve shows no light in any channel: the black level.
    pub fn black(&self) -> f64 {
        let dark = self.rows.iter().take_while(|row| row[1..].iter().all(|&v| v <= 0.0));
        dark.last().map_or(0.0, |row| row[0])
    }

    /// Full-well fraction of a channel at code / max (0..=1).
    pub fn fraction(&self, code: f64, channel: usize) -> f64 {
        let after = self.rows.partition_point(|row| row[0] <= code).clamp(1, self.rows.len() - 1);
        let (a, b) = (&self.rows[after - 1], &self.rows[after]);
        let part = ((code - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
        a[channel + 1] + (b[channel + 1] - a[channel + 1]) * part
    }
}

#[cfg(test)]
mod tests;
