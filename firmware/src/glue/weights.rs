//! The weights of one moment: radiance per patch and the sun's irradiance, and their file form `W.csv`.
//!
//! `W.csv` is a header line, then `x,y,z,solid_angle_sr,r,g,b` per patch in the field's order; one more row after the
//! patches is the sun (its direction, its disc's solid angle, its irradiance on a plane normal to it), and zero
//! irradiance or no such row means no sun. Lines of three bare numbers `r g b`, one per patch, are read too; they
//! cannot say where a sun stands, so one line more than there are patches is refused. For listed directions, rows with
//! directions may come in any order, and bare rows are in the order of the set that the list came from.

use crate::patches::{PatchSet, add_sun};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Diameter of the sun's disc, degrees.
pub const SUN_DIAMETER_DEG: f64 = 0.533;

/// The header line of `W.csv`.
pub const CSV_HEADER: &str = "x,y,z,solid_angle_sr,r,g,b";

/// Solid angle of the sun's disc, sr.
pub fn sun_solid_angle_sr() -> f64 {
    std::f64::consts::TAU * (1.0 - (0.5 * SUN_DIAMETER_DEG).to_radians().cos())
}

pub use crate::weights::SunWeight;

/// Light per patch of a [`PatchSet`], and the sun.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PatchWeights {
    /// Mean RGB radiance per patch, in the set's order.
    pub radiance: Vec<[f32; 3]>,
    /// The sun, if one shines.
    pub sun: Option<SunWeight>,
}

/// Why weights could not be used; one line that names file, line and value.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The file could not be read or written.
    #[error("{name}: {source}")]
    Io {
        /// File name.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A line is not what it should be.
    #[error("{name}: line {line}: {what}")]
    Line {
        /// File name.
        name: String,
        /// Line number, from 1.
        line: usize,
        /// What is wrong and what to do.
        what: String,
    },
    /// The number of rows does not fit the patch set.
    #[error("{name}: {rows} rows of weights; this patch set has {patches} patches{hint}")]
    Count {
        /// File name.
        name: String,
        /// Rows found.
        rows: usize,
        /// Patches of the set.
        patches: usize,
        /// What to do.
        hint: &'static str,
    },
    /// A weight is not a light.
    #[error("weight of {what} is {value:?}; light must be finite and not negative")]
    Value {
        /// Which weight.
        what: String,
        /// Its value.
        value: [f32; 3],
    },
    /// The sun's direction is no unit vector.
    #[error("sun direction {0:?} is not a unit vector")]
    SunDirection([f32; 3]),
}

fn is_light(rgb: [f32; 3]) -> bool {
    rgb.iter().all(|&v| v.is_finite() && v >= 0.0)
}

impl PatchWeights {
    /// Takes over `weights` with their colours multiplied by `colour`; keeps its buffers.
    pub fn set_tinted(&mut self, weights: &PatchWeights, colour: [f32; 3]) {
        let tint = |rgb: [f32; 3]| core::array::from_fn(|c| rgb[c] * colour[c]);
        self.radiance.clear();
        self.radiance.extend(weights.radiance.iter().copied().map(tint));
        self.sun = weights.sun.map(|sun| SunWeight { irradiance: tint(sun.irradiance), ..sun });
    }

    /// Checks count, values and the sun's direction against a patch set.
    ///
    /// # Errors
    /// [`WeightsError`], naming the first weight that does not fit.
    pub fn check(&self, set: &PatchSet) -> Result<(), WeightsError> {
        if self.radiance.len() != set.len() {
            let (rows, patches) = (self.radiance.len(), set.len());
            return Err(WeightsError::Count { name: "weights".into(), rows, patches, hint: "" });
        }
        if let Some(at) = self.radiance.iter().position(|&rgb| !is_light(rgb)) {
            return Err(WeightsError::Value { what: format!("patch {at}"), value: self.radiance[at] });
        }
        if let Some(sun) = self.sun {
            if !is_light(sun.irradiance) {
                return Err(WeightsError::Value { what: "the sun".into(), value: sun.irradiance });
            }
            let length = sun.dir_world.iter().map(|c| c * c).sum::<f32>();
            if length.is_nan() || (length - 1.0).abs() >= 1e-3 {
                return Err(WeightsError::SunDirection(sun.dir_world));
            }
        }
        Ok(())
    }

    /// Turns the sun into light of the patches around it ([`crate::patches::spread`]), for a field that does not answer
    /// suns. One that no patch is near shows nothing.
    pub fn take_sun_in(&mut self, set: &PatchSet) {
        if let Some(sun) = self.sun.take() {
            add_sun(set, sun.dir_world, sun.irradiance, &mut self.radiance);
        }
    }

    /// Irradiance on the horizontal plane from above, sky and sun, per channel; patches count at their centroids.
    pub fn horizontal_irradiance(&self, set: &PatchSet) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let mut add = |rgb: [f32; 3], scale: f64| {
            for k in 0..3 {
                sum[k] += f64::from(rgb[k]) * scale;
            }
        };
        for (patch, &rgb) in self.radiance.iter().enumerate().take(set.upper()) {
            add(rgb, f64::from(set.solid_angle_sr(patch)) * f64::from(set.dir_world(patch)[1]).max(0.0));
        }
        if let Some(sun) = self.sun {
            add(sun.irradiance, f64::from(sun.dir_world[1]).max(0.0));
        }
        sum
    }

    /// The text of `W.csv`.
    pub fn to_csv(&self, set: &PatchSet) -> String {
        let mut text = String::from(CSV_HEADER);
        text.push('\n');
        let mut row = |d: [f32; 3], omega: f64, rgb: [f32; 3]| {
            let _ = writeln!(text, "{},{},{},{},{},{},{}", d[0], d[1], d[2], omega, rgb[0], rgb[1], rgb[2]);
        };
        for (patch, &rgb) in self.radiance.iter().enumerate() {
            row(set.dir_world(patch), f64::from(set.solid_angle_sr(patch)), rgb);
        }
        let dark = SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: [0.0; 3] };
        let sun = self.sun.unwrap_or(dark);
        row(sun.dir_world, sun_solid_angle_sr(), sun.irradiance);
        text
    }

    /// Writes `W.csv`; the file appears whole or not at all.
    ///
    /// # Errors
    /// [`WeightsError::Io`], naming the file.
    pub fn save(&self, set: &PatchSet, path: &Path) -> Result<(), WeightsError> {
        let io = |source| WeightsError::Io { name: path.display().to_string(), source };
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut file = tempfile::NamedTempFile::new_in(folder).map_err(io)?;
        file.write_all(self.to_csv(set).as_bytes()).map_err(io)?;
        file.as_file().sync_all().map_err(io)?;
        file.persist(path).map_err(|error| io(error.error))?;
        Ok(())
    }

    /// Reads `W.csv` for a patch set.
    ///
    /// # Errors
    /// [`WeightsError`], naming the file and the line at fault.
    pub fn load(path: &Path, set: &PatchSet) -> Result<Self, WeightsError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| WeightsError::Io { name: name.clone(), source })?;
        Self::from_csv(&text, &name, set)
    }

    /// Reads the text of `W.csv`; `name` is what errors call it.
    ///
    /// # Errors
    /// As [`PatchWeights::load`].
    pub fn from_csv(text: &str, name: &str, set: &PatchSet) -> Result<Self, WeightsError> {
        let mut weights = PatchWeights { radiance: vec![[f32::NAN; 3]; set.len()], sun: None };
        let mut rows = 0;
        for (index, line) in text.lines().enumerate() {
            if line.trim().is_empty() || (rows == 0 && line.trim().eq_ignore_ascii_case(CSV_HEADER)) {
                continue;
            }
            let refuse = |what: String| WeightsError::Line { name: name.into(), line: index + 1, what };
            let row = parse_row(line).map_err(refuse)?;
            weights.take_row(rows, row, set).map_err(refuse)?;
            rows += 1;
        }
        if rows < set.len() || rows > set.len() + 1 {
            let hint = "; write one row per patch in the field's order, then the sun";
            return Err(WeightsError::Count { name: name.into(), rows, patches: set.len(), hint });
        }
        Ok(weights)
    }

    fn take_row(&mut self, row: usize, (place, rgb): Row, set: &PatchSet) -> Result<(), String> {
        if row < set.len() {
            let patch = patch_of_row(row, place, set)?;
            if !self.radiance[patch][0].is_nan() {
                return Err(format!("direction {:?} has a row already", set.dir_world(patch)));
            }
            self.radiance[patch] = rgb;
        } else if row == set.len() {
            let Some(dir) = place else {
                return Err(format!(
                    "one bare row more than the {} patches; a sun needs its direction: write x,y,z,solid_angle_sr,r,g,b rows",
                    set.len()
                ));
            };
            if rgb.iter().any(|&v| v > 0.0) {
                let length = dir.iter().map(|c| c * c).sum::<f32>().sqrt();
                if length.is_nan() || (length - 1.0).abs() >= 1e-3 {
                    return Err(format!("sun direction {dir:?} is not a unit vector"));
                }
                self.sun = Some(SunWeight { dir_world: dir.map(|c| c / length), irradiance: rgb });
            }
        }
        Ok(())
    }
}

/// The patch that a row is for.
fn patch_of_row(row: usize, dir: Option<[f32; 3]>, set: &PatchSet) -> Result<usize, String> {
    let patch = match (set.listed(), dir) {
        (None, _) => row,
        (Some(list), None) => list.patch_of_row(row).unwrap_or(row),
        (Some(_), Some(dir)) => set.patch_of(dir),
    };
    let own = set.dir_world(patch);
    match dir {
        Some(dir) if dir.iter().zip(own).any(|(a, b)| (a - b).abs() > 1e-3) => Err(format!(
            "direction {dir:?} is not that of patch {patch} ({own:?}); these weights belong to another patch set"
        )),
        _ => Ok(patch),
    }
}

/// A row's direction, if it has one, and its light.
type Row = (Option<[f32; 3]>, [f32; 3]);

fn parse_row(line: &str) -> Result<Row, String> {
    let fields = line.split(|c: char| c == ',' || c.is_whitespace()).filter(|field| !field.is_empty());
    let mut numbers = [0.0f32; 7];
    let mut count = 0;
    for field in fields {
        let number: f32 = field.parse().map_err(|_| format!("`{field}` is not a number"))?;
        if !number.is_finite() {
            return Err(format!("`{field}` is not finite"));
        }
        if count < numbers.len() {
            numbers[count] = number;
        }
        count += 1;
    }
    let [x, y, z, _, r, g, b] = numbers;
    let row = match count {
        3 => (None, [x, y, z]),
        7 => (Some([x, y, z]), [r, g, b]),
        _ => return Err(format!("{count} numbers; write {CSV_HEADER} or three bare numbers r g b")),
    };
    if row.1.iter().any(|&v| v < 0.0) {
        return Err(format!("light {:?} is negative", row.1));
    }
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> (PatchSet, PatchWeights) {
        let set = PatchSet::new(64).unwrap();
        let radiance = (0..set.len()).map(|i| [i as f32 * 0.1, 1.0 / (i + 1) as f32, 3e-7]).collect();
        let sun = Some(SunWeight { dir_world: [0.6, 0.8, 0.0], irradiance: [10.0, 9.0, 8.5] });
        (set, PatchWeights { radiance, sun })
    }

    #[test]
    fn csv_comes_back_exactly() {
        let (set, weights) = example();
        let text = weights.to_csv(&set);
        assert_eq!(text.lines().count(), set.len() + 2);
        let back = PatchWeights::from_csv(&text, "w.csv", &set).unwrap();
        assert_eq!(back.radiance, weights.radiance);
        assert_eq!(back.sun.unwrap().irradiance, weights.sun.unwrap().irradiance);
        let dark = PatchWeights { sun: None, ..weights };
        assert_eq!(PatchWeights::from_csv(&dark.to_csv(&set), "w.csv", &set).unwrap(), dark);
    }

    #[test]
    fn bare_numbers_are_patches_only() {
        let (set, _) = example();
        let text = "1 2 3\n".repeat(set.len());
        let weights = PatchWeights::from_csv(&text, "w.csv", &set).unwrap();
        assert_eq!((weights.radiance[67], weights.sun), ([1.0, 2.0, 3.0], None));
        let text = "1, 2, 3\n".repeat(set.len() + 1);
        let error = PatchWeights::from_csv(&text, "w.csv", &set).unwrap_err().to_string();
        assert!(error.contains("line 69") && error.contains("direction"), "{error}");
    }

    #[test]
    fn bad_rows_are_named_by_line() {
        let (set, weights) = example();
        let text = weights.to_csv(&set);
        let with = |line: usize, new: &str| {
            let lines: Vec<&str> = text.lines().enumerate().map(|(i, l)| if i == line { new } else { l }).collect();
            PatchWeights::from_csv(&lines.join("\n"), "w.csv", &set).unwrap_err().to_string()
        };
        for bad in ["NaN 1 1", "inf 1 1", "-1 0 0", "1 2", "a b c", "0,1,0,0.1,1,1,1"] {
            let error = with(5, bad);
            assert!(error.starts_with("w.csv: line 6: "), "{error}");
        }
        assert!(with(set.len() + 1, "1,1,1,0.1,1,1,1").contains("unit vector"));
        assert!(PatchWeights::from_csv("1 2 3\n", "w.csv", &set).unwrap_err().to_string().contains("1 rows"));
    }

    #[test]
    fn a_uniform_sky_has_irradiance_pi() {
        let set = PatchSet::new(256).unwrap();
        let weights = PatchWeights { radiance: vec![[1.0; 3]; set.len()], sun: None };
        weights.check(&set).unwrap();
        let irradiance = weights.horizontal_irradiance(&set)[1];
        assert!((irradiance / std::f64::consts::PI - 1.0).abs() < 3e-3, "{irradiance}");
    }

    /// A list out of order: rows with directions find their patch, bare ones count as the source did.
    #[test]
    fn rows_for_listed_directions() {
        use crate::patches::{Listed, ListedPatch};
        let patch = |dir_world, row| ListedPatch { dir_world, solid_angle_sr: 0.5, row };
        let list = [patch([0.0, 1.0, 0.0], 1), patch([0.6, 0.8, 0.0], 2), patch([0.0, -1.0, 0.0], 0)];
        let set = PatchSet::of_list(Listed::new(&list, None).unwrap());
        let bare = PatchWeights::from_csv("1 1 1\n2 2 2\n3 3 3\n", "w", &set).unwrap();
        assert_eq!(bare.radiance, [[2.0; 3], [3.0; 3], [1.0; 3]]);
        let text = "0.6,0.8,0,1,3,3,3\n0,-1,0,1,1,1,1\n0,1,0,1,2,2,2\n0,1,0,1,0.5,0.5,0.5\n";
        let mut placed = PatchWeights::from_csv(text, "w", &set).unwrap();
        assert_eq!(placed.radiance, bare.radiance);
        assert_eq!(PatchWeights::from_csv(&bare.to_csv(&set), "w", &set).unwrap(), bare);
        // The sun in the zenith is the zenith's patch: irradiance over solid angle.
        placed.take_sun_in(&set);
        assert_eq!((placed.sun, placed.radiance[1]), (None, [3.0; 3]));
        assert!((placed.radiance[0][0] - 3.0).abs() < 1e-6, "{placed:?}");
        let twice = PatchWeights::from_csv("0,1,0,1,2,2,2\n0,1,0,1,2,2,2\n0,-1,0,1,2,2,2\n", "w", &set);
        assert!(twice.unwrap_err().to_string().contains("line 2"));
        let foreign = PatchWeights::from_csv("0,0.9,0.436,1,2,2,2\n", "w", &set);
        assert!(foreign.unwrap_err().to_string().contains("another patch set"));
    }
}
