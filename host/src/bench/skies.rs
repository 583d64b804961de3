//! The skies of a run: the given maps and simulated ones, and what happens to their suns.
//!
//! The simulated skies are Hosek-Wilkie's, a model of which the sky prior of `relume-bake` knows nothing (that is made of
//! CIE skies and clouds of its own). Six have the sun where the stack's stands: clear, very clear, hazy, thick haze, broken
//! and scattered cloud. Three have none to show: overcast, a sun 10 degrees high in the opposite quarter (its disc is left
//! out, its glow stays), and dusk. With three maps whose suns are left out, that is twelve skies, half of them with the sun.

use std::path::PathBuf;

use relume_firmware::field::Field;

use super::method::BenchSky;
use crate::exact::SAME_SUN_DEG;
use crate::map::RadianceMap;
use crate::skymodel::{Atmosphere, SkyModel};
use crate::sun::{SunPosition, angle_deg, position_of};
use crate::weights::{PatchWeights, SunWeight};

/// Where the simulated skies' sun stands when the stack has none.
const USUAL_SUN: SunPosition = SunPosition { azimuth_deg: 135.0, altitude_deg: 40.0 };
/// Share of the unclouded sun that a sky with gaps must let through, so that it differs from an overcast one.
const LEAST_SUN: f32 = 0.2;
/// Altitude of the low sun, degrees.
const LOW_SUN_DEG: f64 = 10.0;
/// Altitude of the sun at dusk, degrees.
const DUSK_SUN_DEG: f64 = -3.0;

/// Name of the simulated clear sky.
pub const CLEAR: &str = "simulated clear";
/// Name of the simulated overcast sky.
pub const OVERCAST: &str = "simulated overcast";

/// A radiance map to light the field with.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyMap {
    /// The file.
    pub path: PathBuf,
    /// Turn about +Y, degrees; positive turns +Z towards +X.
    pub env_rot_deg: f64,
}

impl SkyMap {
    /// `MAP`, or `MAP@DEG` for a map that is turned.
    pub fn parse(text: &std::ffi::OsStr) -> Self {
        let whole = || SkyMap { path: text.into(), env_rot_deg: 0.0 };
        let Some((path, turn)) = text.to_str().and_then(|text| text.rsplit_once('@')) else { return whole() };
        match turn.parse::<f64>() {
            Ok(env_rot_deg) if env_rot_deg.is_finite() => SkyMap { path: path.into(), env_rot_deg },
            _ => whole(),
        }
    }

    fn name(&self) -> String {
        let stem = self.path.file_stem().unwrap_or(self.path.as_os_str()).to_string_lossy();
        if self.env_rot_deg == 0.0 { stem.into_owned() } else { format!("{stem}@{}", self.env_rot_deg) }
    }
}

/// The given maps, then the simulated skies.
///
/// # Errors
/// If a map cannot be read or is not one.
pub fn load_skies(maps: &[SkyMap], field: &Field<'_>, stack_sun: Option<[f32; 3]>) -> anyhow::Result<Vec<BenchSky>> {
    let set = field.patch_set();
    let mut skies = Vec::with_capacity(maps.len() + 9);
    for sky in maps {
        let map = RadianceMap::load(&sky.path)?;
        skies.push(unlit(sky.name(), crate::split::weights(&map, set, sky.env_rot_deg)?));
    }
    let north_deg = f64::from(field.camera().north_deg);
    let sun = stack_sun.map_or(USUAL_SUN, |dir| position_of(dir, north_deg));
    for (name, model) in simulated(sun, north_deg) {
        skies.push(unlit(format!("simulated {name}"), model.weights(set)));
    }
    if !field.answers_sun() {
        skies.iter_mut().for_each(|sky| sky.weights.take_sun_in(set));
    }
    Ok(skies)
}

fn unlit(name: String, weights: PatchWeights) -> BenchSky {
    BenchSky { name, weights, exposure: 1.0, exact: None }
}

fn simulated(sun: SunPosition, north_deg: f64) -> Vec<(&'static str, SkyModel)> {
    let clear = |turbidity| SkyModel::new(Atmosphere { turbidity, ..Atmosphere::default() }, sun, north_deg, 0.0);
    let low = SunPosition { azimuth_deg: (sun.azimuth_deg + 180.0).rem_euclid(360.0), altitude_deg: LOW_SUN_DEG };
    let overcast = Atmosphere { cloud_cover: 1.0, ..Atmosphere::default() };
    let at = |sun, air| SkyModel::new(air, sun, north_deg, 0.0);
    vec![
        ("clear", clear(3.0)),
        ("broken cloud", clouded_sky(sun, north_deg, 0.5)),
        ("very clear", clear(2.0)),
        ("hazy", clear(6.0)),
        ("thick haze", clear(9.0)),
        ("scattered cloud", clouded_sky(sun, north_deg, 0.3)),
        ("overcast", at(sun, overcast)),
        ("low sun", at(low, Atmosphere::default())),
        ("dusk", at(SunPosition { altitude_deg: DUSK_SUN_DEG, ..sun }, Atmosphere::default())),
    ]
}

/// Part of the sky under cloud, the sun in a gap (or as near to one as the first 32 cloud fields come).
fn clouded_sky(sun: SunPosition, north_deg: f64, cloud_cover: f32) -> SkyModel {
    let beam = |sky: &SkyModel| sky.sun().map_or(0.0, |sun| crate::map::luminance(sun.irradiance));
    let least = LEAST_SUN * beam(&SkyModel::new(Atmosphere::default(), sun, north_deg, 0.0));
    let with_seed = |cloud_seed| {
        let air = Atmosphere { cloud_cover, cloud_seed, ..Atmosphere::default() };
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
    fn maps_may_be_turned() {
        let parse = |text: &str| SkyMap::parse(text.as_ref());
        let turned = parse("a/noon.hdr@-90.5");
        assert_eq!((turned.path.to_str(), turned.env_rot_deg), (Some("a/noon.hdr"), -90.5));
        assert_eq!((turned.name(), parse("a/noon.hdr").name()), ("noon@-90.5".to_owned(), "noon".to_owned()));
        for odd in ["noon@home.hdr", "noon@", "noon@inf"] {
            assert_eq!(parse(odd).path.to_str(), Some(odd));
        }
    }

    #[test]
    fn six_of_the_simulated_skies_have_the_sun_where_it_is_asked_for() {
        let sun = SunPosition { azimuth_deg: 126.0, altitude_deg: 50.0 };
        let dir = crate::sun::dir_world(sun, 12.0);
        let set = relume_firmware::patches::PatchSet::new(64).unwrap();
        let mut skies: Vec<_> =
            simulated(sun, 12.0).into_iter().map(|(name, model)| unlit(name.to_owned(), model.weights(&set))).collect();
        leave_out_foreign_suns(&mut skies, Some(dir));
        assert_eq!((skies.len(), skies.iter().filter(|sky| sky.has_sun()).count()), (9, 6));
        let light = |sky: &BenchSky| sky.weights.radiance.iter().map(|rgb| rgb[1]).sum::<f32>();
        assert!(skies.iter().all(|sky| light(sky) > 0.0));
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
