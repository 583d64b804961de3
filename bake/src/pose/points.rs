//! Measured points: where a still shows a place of the world. One per line: `u,v,x,y,z`.

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;
use std::path::{Path, PathBuf};

/// Fewer points do not tell pose and focal length with anything left to check them by.
pub const FEWEST: usize = 6;
/// Points closer to a line than this share of their spread are on it.
const LINE: f64 = 1e-3;

/// A place of the world, and where the still shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Its line in the file, counted from 1.
    pub line: usize,
    /// Column and row in the still, px from its top left corner: the first pixel's centre is (0.5, 0.5).
    pub position_px: [f64; 2],
    /// World position, m.
    pub world: DVec3,
}

/// Why points cannot be used; one line that names the file and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PointsError {
    /// The file cannot be read.
    #[error("{}: cannot read the points: {reason}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// A line of it is not five numbers.
    #[error("{}: line {line}: {text:?} is not u,v,x,y,z: write pixels and world metres, five finite numbers", file.display())]
    Line {
        /// The file.
        file: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What it says.
        text: String,
    },
    /// A pixel that the still does not have.
    #[error(
        "{}: line {line}: pixel ({}, {}) lies outside the still of {}x{}; write pixels of this still from its top left corner",
        file.display(), position_px[0], position_px[1], size_px[0], size_px[1]
    )]
    Outside {
        /// The file.
        file: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What it says, px.
        position_px: [f64; 2],
        /// Width and height of the still, px.
        size_px: [u32; 2],
    },
    /// Two lines name the same pixel or the same place.
    #[error("{}: line {line} repeats the {what} of line {before}; leave one of them out", file.display())]
    Twice {
        /// The file.
        file: PathBuf,
        /// Counted from 1.
        line: usize,
        /// The earlier line.
        before: usize,
        /// Pixel or place.
        what: &'static str,
    },
    /// Too few.
    #[error("{}: {count} points; at least {FEWEST} are needed, 12 and more are better", file.display())]
    Few {
        /// The file.
        file: PathBuf,
        /// Points that are there.
        count: usize,
    },
    /// They tell no pose.
    #[error("{}: all {what} lie on a line, which tells no pose; measure others beside it", file.display())]
    OnALine {
        /// The file.
        file: PathBuf,
        /// Pixels or places.
        what: &'static str,
    },
}

/// Reads and checks the points of a still of `size_px` (width, height). Empty lines, lines that begin with `#` and a first
/// line of names are passed over.
///
/// # Errors
/// [`PointsError`].
pub fn load(file: &Path, size_px: [u32; 2]) -> Result<Vec<Point>, PointsError> {
    let text = std::fs::read_to_string(file)
        .map_err(|error| PointsError::Read { file: file.to_owned(), reason: error.to_string() })?;
    parse(&text, file, size_px)
}

/// [`load`] of a file's text.
///
/// # Errors
/// [`PointsError`].
pub fn parse(text: &str, file: &Path, size_px: [u32; 2]) -> Result<Vec<Point>, PointsError> {
    let mut points: Vec<Point> = Vec::new();
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    for (index, raw) in text.lines().enumerate() {
        let (line, trimmed) = (index + 1, raw.trim());
        let is_head = points.is_empty() && trimmed.starts_with(['u', 'U']);
        if trimmed.is_empty() || trimmed.starts_with('#') || is_head {
            continue;
        }
        let [u, v, x, y, z] = numbers(trimmed).ok_or_else(|| PointsError::Line {
            file: file.to_owned(),
            line,
            text: trimmed.chars().take(60).collect(),
        })?;
        let point = Point { line, position_px: [u, v], world: DVec3::new(x, y, z) };
        check(&point, &points, file, size_px)?;
        points.push(point);
    }
    if points.len() < FEWEST {
        return Err(PointsError::Few { file: file.to_owned(), count: points.len() });
    }
    let on_a_line = |what, places: Vec<DVec3>| match spread(&places)[1] {
        Spread(across, along) if across <= LINE * along => Err(PointsError::OnALine { file: file.to_owned(), what }),
        _ => Ok(()),
    };
    on_a_line("places", points.iter().map(|point| point.world).collect())?;
    let flat = |point: &Point| DVec3::new(point.position_px[0], point.position_px[1], 0.0);
    on_a_line("pixels", points.iter().map(flat).collect())?;
    Ok(points)
}

fn numbers(line: &str) -> Option<[f64; 5]> {
    let split = |by: fn(char) -> bool| line.split(by).map(str::trim).filter(|part| !part.is_empty());
    let parts: Vec<&str> = if line.contains([',', ';']) {
        line.split([',', ';']).map(str::trim).collect()
    } else {
        split(char::is_whitespace).collect()
    };
    let values: Option<Vec<f64>> = parts.into_iter().map(|part| part.parse().ok()).collect();
    let values: [f64; 5] = values?.try_into().ok()?;
    values.iter().all(|v| v.is_finite() && v.abs() < 1e9).then_some(values)
}

fn check(point: &Point, before: &[Point], file: &Path, size_px: [u32; 2]) -> Result<(), PointsError> {
    let (line, position_px) = (point.line, point.position_px);
    let file = file.to_owned();
    if (0..2).any(|c| !(0.0..=f64::from(size_px[c])).contains(&position_px[c])) {
        return Err(PointsError::Outside { file, line, position_px, size_px });
    }
    for other in before {
        let same = [(position_px == other.position_px, "pixel"), (point.world == other.world, "place")];
        if let Some((_, what)) = same.into_iter().find(|(same, _)| *same) {
            return Err(PointsError::Twice { file, line, before: other.line, what });
        }
    }
    Ok(())
}

/// A standard deviation, and the largest one of the same points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spread(pub f64, pub f64);

/// Standard deviations of places along their three principal axes, largest first.
pub(super) fn spread(places: &[DVec3]) -> [Spread; 3] {
    let share = 1.0 / places.len().max(1) as f64;
    let mean = places.iter().sum::<DVec3>() * share;
    let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
    let sum = places.iter().fold(DMat3::ZERO, |sum, &place| sum + outer(place - mean));
    let matrix = Matrix3::from_column_slice(&sum.to_cols_array()) * share;
    let mut values = matrix.symmetric_eigenvalues().map(|value| value.max(0.0).sqrt());
    values.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
    [0, 1, 2].map(|k| Spread(values[k], values[0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: [&str; 6] = ["1,2,0,0,0", "90,3,5,0,0", "50,70,2,4,0", "20,60,1,3,2", "70,20,4,1,-3", "33,44,2,2,1"];

    fn with(index: usize, line: &str) -> Result<Vec<Point>, PointsError> {
        let mut lines = GOOD;
        lines[index] = line;
        parse(&format!("u,v,x,y,z\n# corners\n\n{}\n", lines.join("\n")), Path::new("p.csv"), [100, 80])
    }

    #[test]
    fn lines_are_read_with_their_numbers() {
        let points = with(0, " 1.5 ; 2 ; -3e1 ; 0 ; 0 ").unwrap();
        let expected = Point { line: 4, position_px: [1.5, 2.0], world: DVec3::new(-30.0, 0.0, 0.0) };
        assert_eq!((points.len(), points[0]), (6, expected));
    }

    #[test]
    fn faults_name_the_line() {
        let bad = [
            ("1,2,3,4", "line 6: \"1,2,3,4\""),
            ("1,2,3,4,5,6", "line 6"),
            ("1,2,nan,4,5", "line 6"),
            ("1,2,inf,4,5", "line 6"),
            ("a,2,3,4,5", "line 6"),
            ("1,,3,4,5", "line 6"),
            ("101,2,3,4,5", "outside the still of 100x80"),
            ("1,2,3,4,5", "line 6 repeats the pixel of line 4"),
            ("9,2,0,0,0", "line 6 repeats the place of line 4"),
        ];
        for (line, told) in bad {
            let error = with(2, line).unwrap_err().to_string();
            assert!(error.starts_with("p.csv: ") && error.contains(told) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn points_that_tell_no_pose_are_refused() {
        let line = |places: bool| {
            let text: Vec<String> = (0..8)
                .map(|k| {
                    let bend = f64::from(k * k);
                    let (v, y) = if places { (bend, 2.0 * f64::from(k)) } else { (3.0 * f64::from(k), bend) };
                    format!("{},{v},{k},{y},{}", 2 * k, -k)
                })
                .collect();
            parse(&text.join("\n"), Path::new("p.csv"), [100, 80]).unwrap_err().to_string()
        };
        assert!(line(true).contains("all places lie on a line") && line(false).contains("all pixels lie on a line"));
        let few = parse(&GOOD[..5].join("\n"), Path::new("p.csv"), [100, 80]).unwrap_err().to_string();
        assert!(few.contains("5 points"), "{few}");
        assert!(load(Path::new("/nowhere/p.csv"), [1, 1]).unwrap_err().to_string().contains("/nowhere/p.csv"));
    }
}
