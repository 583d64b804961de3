//! The skies of a run: the given maps and two simulated ones, and what happens to their suns.

use std::path::{Path, PathBuf};

use relume_firmware::field::Field;

use super::method::BenchSky;
use crate::exact::SAME_SUN_DEG;
use crate::map::RadianceMap;
use crate::skymodel::{Atmosphere, SkyModel};
use crate::sun::{SunPosition, angle_deg, position_of};
use crate::weights::{PatchWeights, SunWeight};

/// Where the simulated skies' sun stands when the stack has none.
const USUAL_SUN: SunPosition = SunPosition { azimuth_deg: 135.0, altitude_deg: 40.0 };
/// Share of the unclouded sun that a broken sky must let through, so that it differs from an overcast one.
const LEAST_SUN: f32 = 0.2;

/// The given maps, then a clear and a cloudy simulated sky whose sun stands where the stack's does.
///
/// # Errors
/// If a map cannot be read or is not one.
pub fn load_skies(maps: &[PathBuf], field: &Field<'_>, stack_sun: Option<[f32; 3]>) -> anyhow::Result<Vec<BenchSky>> {
    let set = field.patch_set();
    let mut skies = Vec::with_capacity(maps.len() + 2);
    for path in maps {
        let map = RadianceMap::load(path)?;
        skies.push(unlit(name_of(path), crate::split::weights(&map, set, 0.0)?));
    }
    let north_deg = f64::from(field.camera().north_deg);
    let sun = stack_sun.map_or(USUAL_SUN, |dir| position_of(dir, north_deg));
    skies.push(unlit("simulated clear".into(), clear_sky(sun, north_deg).weights(set)));
    skies.push(unlit("simulated broken cloud".into(), broken_sky(sun, north_deg).weights(set)));
    Ok(skies)
}

fn unlit(name: String, weights: PatchWeights) -> BenchSky {
    BenchSky { name, weights, exposure: 1.0, exact: None }
}

fn name_of(path: &Path) -> String {
    path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.to_string_lossy().into_owned())
}

fn clear_sky(sun: SunPosition, north_deg: f64) -> SkyModel {
    SkyModel::new(Atmosphere::default(), sun, north_deg, 0.0)
}

/// Half the sky under cloud, the sun in a gap (or as near to one as the first 32 cloud fields come).
fn broken_sky(sun: SunPosition, north_deg: f64) -> SkyModel {
    let beam = |sky: &SkyModel| sky.sun().map_or(0.0, |sun| crate::map::luminance(sun.irradiance));
    let least = LEAST_SUN * beam(&clear_sky(sun, north_deg));
    let with_seed = |cloud_seed| {
        let air = Atmosphere { cloud_cover: 0.5, cloud_seed, ..Atmosphere::default() };
        SkyModel::new(air, sun, north_deg, 0.0)
    };
    (1..32).map(with_seed).find(|sky| beam(sky) >= least).unwrap_or_else(|| with_seed(32))
}

/// Takes out of both sides every sun that the stack has no picture of, and returns a line for the log per sky so changed.
///
/// `stack_sun` is the direction of the stack's sun, `None` if it has none.
pub fn leave_out_foreign_suns(skies: &mut [BenchSky], stack_sun: Option<[f32; 3]>) -> Vec<String> {
    let mut notes = Vec::new();
    for sky in skies {
        let Some(sun) = &mut sky.weights.sun else { continue };
        let off_deg = stack_sun.map(|dir| angle_deg(dir, sun.dir_world));
        if let Some(dir) = stack_sun
            && off_deg.is_some_and(|off| off <= SAME_SUN_DEG)
        {
            // One and the same sun: between skies it is then not traced anew, which is timed apart.
            sun.dir_world = dir;
            continue;
        }
        sky.weights.sun = None;
        notes.push(match off_deg {
            Some(off) => {
                format!("sky {}: its sun stands {off:.2} degrees from the stack's; left out on both sides", sky.name)
            }
            None => format!("sky {}: the stack has no sun.exr; its sun is left out on both sides", sky.name),
        });
    }
    notes
}

/// Puts all suns where the first one stands. Without a stack nothing is compared but time, and a post traces the sun
/// only when it has moved, not with every frame.
pub fn gather_suns(skies: &mut [BenchSky]) {
    let Some(first) = skies.iter().find_map(|sky| sky.weights.sun) else { return };
    for sun in skies.iter_mut().filter_map(|sky| sky.weights.sun.as_mut()) {
        *sun = SunWeight { dir_world: first.dir_world, ..*sun };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::PatchWeights;

    fn tilted(degrees: f32) -> [f32; 3] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [sin, cos, 0.0]
    }

    fn sky(sun: Option<[f32; 3]>) -> BenchSky {
        let sun = sun.map(|dir_world| SunWeight { dir_world, irradiance: [1.0, 2.0, 3.0] });
        let weights = PatchWeights { radiance: vec![[1.0; 3]; 272], sun };
        BenchSky { name: "s".into(), weights, exposure: 1.0, exact: None }
    }

    #[test]
    fn small_angles_are_exact() {
        assert!((angle_deg(tilted(0.0), tilted(0.05)) - 0.05).abs() < 1e-4);
        assert!((angle_deg(tilted(-90.0), tilted(90.0)) - 180.0).abs() < 1e-4);
    }

    #[test]
    fn only_the_stacks_own_sun_stays() {
        let mut skies = [sky(Some(tilted(30.05))), sky(Some(tilted(31.0))), sky(None)];
        let notes = leave_out_foreign_suns(&mut skies, Some(tilted(30.0)));
        assert!(skies[0].weights.sun.is_some() && skies[1].weights.sun.is_none());
        assert!(notes.len() == 1 && notes[0].contains("1.00 degrees"), "{notes:?}");
        assert_eq!(leave_out_foreign_suns(&mut skies, None).len(), 1);
        assert!(skies[0].weights.sun.is_none());
    }

    #[test]
    fn gathered_suns_keep_their_light() {
        let mut skies = [sky(None), sky(Some(tilted(10.0))), sky(Some(tilted(50.0)))];
        gather_suns(&mut skies);
        assert!(skies[0].weights.sun.is_none());
        let sun = skies[2].weights.sun.unwrap();
        assert_eq!((sun.dir_world, sun.irradiance), (tilted(10.0), [1.0, 2.0, 3.0]));
    }
}
