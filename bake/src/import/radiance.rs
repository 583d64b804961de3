//! Radiance's patch pictures, as `rcontrib -o patch_%04d.hdr -f reinhart.cal -e MF:1 -b rbin -bn Nrbins` writes them: one
//! `.hdr` or `.exr` per patch of Tregenza's sky (MF 1) or Reinhart's (MF 2), number 0 the ground, the last one the zenith.
//!
//! The patches' directions and solid angles are those of Radiance's `reinsrc.cal` (G. Ward, 2013): `7 MF` rows of height
//! `90 / (7 MF + 0.5)` degrees with `MF` times 30, 30, 24, 24, 18, 12, 6 patches, the first of each row centred at north,
//! clockwise; then the cap at the zenith. Radiance's axes are x east, y north, z up; here they are +X, -Z and +Y.

use super::fault::ImportError;
use super::source::{LightPicture, Side, Source};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::{Path, PathBuf};

/// Patches in each of Tregenza's rows, from the horizon up (P. R. Tregenza, Subdivision of the sky hemisphere for
/// luminance measurements, Lighting Research & Technology 19, 1987).
const TREGENZA: [usize; 7] = [30, 30, 24, 24, 18, 12, 6];
/// Subdivisions that fit a field.
const KNOWN: [usize; 2] = [1, 2];

/// Direction and solid angle of every patch.
pub(super) fn patches(mf: usize) -> Vec<([f64; 3], f64)> {
    let height = FRAC_PI_2 / (7.0 * mf as f64 + 0.5);
    let mut all = vec![([0.0, -1.0, 0.0], TAU)];
    for row in 0..7 * mf {
        let (count, low) = (mf * TREGENZA[row / mf], height * row as f64);
        let omega = TAU / count as f64 * ((low + height).sin() - low.sin());
        for column in 0..count {
            let (sin, cos) = (TAU * column as f64 / count as f64).sin_cos();
            let (up, level) = (low + 0.5 * height).sin_cos();
            all.push(([level * sin, up, -level * cos], omega));
        }
    }
    all.push(([0.0, 1.0, 0.0], TAU * (1.0 - (0.5 * height).cos())));
    all
}

pub(super) fn open(folder: &Path, files: &[PathBuf]) -> Result<Source, ImportError> {
    let mut numbered: BTreeMap<usize, &PathBuf> = BTreeMap::new();
    let is_picture = |file: &&PathBuf| {
        let ext = file.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        matches!(ext.as_str(), "hdr" | "pic" | "exr")
    };
    for file in files.iter().filter(is_picture) {
        let number = number_of(file).ok_or_else(|| {
            let what = "its name does not end in a patch number; Radiance patch pictures are named like patch_0001.hdr";
            ImportError::file(file, what)
        })?;
        if let Some(other) = numbered.insert(number, file) {
            return Err(ImportError::file(file, format!("patch {number} is {} already", other.display())));
        }
    }
    if numbered.is_empty() {
        let what = "no manifest.toml, no .lp file and no Radiance patch pictures (.hdr, .exr) here";
        return Err(ImportError::file(folder, what));
    }
    let last = numbered.keys().last().copied().unwrap_or(0);
    let patches = KNOWN.into_iter().map(patches).find(|patches| patches.len() > last).ok_or_else(|| {
        let what =
            format!("patch {last} is unknown: MF 1 has patches 0 to 145 and MF 2 0 to 577; more do not fit a field");
        ImportError::file(numbered[&last], what)
    })?;
    let mut source = Source::new(folder, "Radiance patches", Side::Before([0.0, 1.0, 0.0]));
    for (number, &(dir_world, solid_angle_sr)) in patches.iter().enumerate() {
        let file = numbered.get(&number).ok_or_else(|| {
            let (found, all) = (numbered.len(), patches.len());
            ImportError::file(folder, format!("patch {number} is missing: {found} pictures of {all}"))
        })?;
        let solid_angle_sr = Some(solid_angle_sr);
        source.pictures.push(LightPicture { file: file.to_path_buf(), dir_world, solid_angle_sr, irradiance: None });
    }
    Ok(source)
}

/// The digits that a name ends in.
fn number_of(file: &Path) -> Option<usize> {
    let stem = file.file_stem()?.to_string_lossy().into_owned();
    let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    stem[stem.len() - digits..].parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn patches_are_those_of_radiance() {
        for (mf, count) in [(1, 146), (2, 578)] {
            let all = patches(mf);
            assert_eq!(all.len(), count);
            let total: f64 = all.iter().map(|patch| patch.1).sum();
            assert!((total - 2.0 * TAU).abs() < 1e-12, "{total}");
            // An even sky's irradiance: pi, but for what cells differ from their middles.
            let level: f64 = all.iter().skip(1).map(|(dir, omega)| dir[1] * omega).sum();
            assert!((level / PI - 1.0).abs() < 0.01, "{level}");
        }
        // reinsrc.cal by hand: patch 1 is north, 6 degrees up; 8 is 84 degrees clockwise, almost east; 31 begins the second
        // row at 18 degrees.
        let all = patches(1);
        let near = |dir: [f64; 3], want: [f64; 3]| dir.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-4);
        assert!(near(all[1].0, [0.0, 0.104528, -0.994522]), "{:?}", all[1]);
        assert!(near(all[8].0, [0.989074, 0.104528, -0.103956]), "{:?}", all[8]);
        assert!(near(all[31].0, [0.0, 0.309017, -0.951057]), "{:?}", all[31]);
        assert!(near(all[145].0, [0.0, 1.0, 0.0]) && near(all[0].0, [0.0, -1.0, 0.0]));
        // Romega of patch 1: 2 pi / 30 * sin(12 degrees).
        assert!((all[1].1 - 0.0435445).abs() < 1e-6, "{}", all[1].1);
        // MF 2: rows of 6.2069 degrees, 60 in the first; patch 16 stands at 90 degrees, patch 61 begins the second row.
        let all = patches(2);
        assert!(near(all[16].0, [0.998533, 0.054139, 0.0]), "{:?}", all[16]);
        assert!(near(all[61].0, [0.0, 0.161782, -0.986827]), "{:?}", all[61]);
    }

    #[test]
    fn numbers_end_names() {
        let of = |name: &str| number_of(Path::new(name));
        assert_eq!((of("a/p_0012.hdr"), of("0.exr"), of("sky2_7.hdr")), (Some(12), Some(0), Some(7)));
        assert_eq!((of("view.hdr"), of("p_12b.hdr")), (None, None));
    }
}
