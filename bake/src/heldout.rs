//! Held-out skies: light that no prior knows, to tell a finished field's error by.
//!
//! The clear ones are Preetham, Shirley and Smits' (1999), the clouds are fractal value noise; the prior of
//! [`crate::prior`] has neither. The sun's disc is left out of all: it is a light of its own.

mod clouds;
mod preetham;
mod rooms;

use clouds::Clouds;
use preetham::{ClearSky, luminance};
use relume_firmware::glue::map::{MapError, RadianceMap};
use relume_firmware::glue::split;
use relume_firmware::patches::PatchSet;
use std::f64::consts::PI;
use std::path::Path;

/// A held-out sky over a patch set.
#[derive(Clone, Debug, PartialEq)]
pub struct TestSky {
    /// What reports call it.
    pub name: String,
    /// RGB radiance per patch, in the set's order.
    pub radiance: Vec<[f32; 3]>,
}

/// Name, turbidity, the sun's azimuth (degrees from +X towards +Z) and altitude, share of the sky under cloud.
type Recipe = (&'static str, f64, [f64; 2], f64);

const RECIPES: [Recipe; 8] = [
    ("clear", 2.5, [120.0, 45.0], 0.0),
    ("very clear, high sun", 2.0, [20.0, 75.0], 0.0),
    ("hazy", 6.0, [250.0, 25.0], 0.0),
    ("low sun", 4.0, [80.0, 8.0], 0.0),
    ("scattered cloud", 2.5, [330.0, 35.0], 0.3),
    ("broken cloud", 3.0, [200.0, 55.0], 0.55),
    ("cloud with gaps", 3.5, [290.0, 30.0], 0.85),
    ("overcast", 5.0, [160.0, 40.0], 1.0),
];

/// Reflectance of the ground below the horizon.
const GROUND: f64 = 0.2;
/// Patches larger than this are looked at more often, sr.
const LARGE_SR: f32 = 0.1;

/// A captured map as a held-out sky, named as its file; its sun, if one stands out, is left out.
///
/// # Errors
/// [`MapError`], which names the file.
pub fn captured(path: &Path, set: &PatchSet) -> Result<TestSky, MapError> {
    let map = RadianceMap::load(path)?;
    let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Ok(TestSky { name, radiance: split::weights(&map, set, 0.0)?.radiance })
}

/// Held-out light for a set: skies where its horizon is the ground's, else rooms.
pub fn held_out(set: &PatchSet) -> Vec<TestSky> {
    let is_outdoors = set.horizon().is_some_and(|[_, up, _]| up > 0.999);
    if is_outdoors { test_skies(set) } else { rooms::rooms(set) }
}

/// Held-out light for a set that others may have made, and some of its lights alone.
pub fn test_lights(set: &PatchSet) -> Vec<TestSky> {
    held_out(set).into_iter().chain(rooms::lone_lights(set)).collect()
}

/// The held-out skies over a patch set; the same on every machine.
pub fn test_skies(set: &PatchSet) -> Vec<TestSky> {
    RECIPES.iter().enumerate().map(|(index, recipe)| test_sky(set, index as u64, recipe)).collect()
}

fn test_sky(set: &PatchSet, seed: u64, &(name, turbidity, sun_deg, cover): &Recipe) -> TestSky {
    let clear = ClearSky::new(turbidity, sun_deg.map(f64::to_radians));
    let means = |sky: &dyn Fn([f64; 3]) -> [f64; 3]| (0..set.upper()).map(|patch| mean(set, patch, sky)).collect();
    let mut upper: Vec<[f64; 3]> = means(&|dir| clear.radiance(dir));
    if cover > 0.0 {
        let omega = |patch: usize| f64::from(set.solid_angle_sr(patch));
        let light = upper.iter().enumerate().map(|(patch, &rgb)| omega(patch) * luminance(rgb)).sum::<f64>();
        let light = light / (0..upper.len()).map(omega).sum::<f64>();
        let clouds = Clouds::new(seed, cover, light);
        upper = means(&|dir| clouds.before(dir, &clear));
    }
    let cosine = |patch: usize| f64::from(set.dir_world(patch)[1]) * f64::from(set.solid_angle_sr(patch));
    let irradiance = |c: usize| upper.iter().enumerate().map(|(patch, rgb)| rgb[c] * cosine(patch)).sum::<f64>();
    let ground = [0, 1, 2].map(|c| GROUND * irradiance(c) / PI);
    let all = upper.into_iter().chain((0..set.lower()).map(|_| ground));
    TestSky { name: name.to_owned(), radiance: all.map(|rgb| rgb.map(|v| v as f32)).collect() }
}

/// Strata of a patch, per side.
fn strata(set: &PatchSet, patch: usize) -> usize {
    if set.solid_angle_sr(patch) > LARGE_SR { 8 } else { 4 }
}

/// Mean of a sky over a patch.
fn mean(set: &PatchSet, patch: usize, sky: &dyn Fn([f64; 3]) -> [f64; 3]) -> [f64; 3] {
    let side = strata(set, patch);
    let at = |k: usize| (k as f32 + 0.5) / side as f32;
    let mut sum = [0.0; 3];
    for k in 0..side * side {
        let [x, y, z] = set.sample(patch, [at(k / side), at(k % side)]).map(f64::from);
        // A listed patch's cap may reach below the horizon.
        let rgb = sky([x, y.max(0.0), z]);
        sum = std::array::from_fn(|c| sum[c] + rgb[c] / (side * side) as f64);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skies_are_light_and_differ() {
        let set = PatchSet::new(64).unwrap();
        let skies = test_skies(&set);
        for sky in &skies {
            assert_eq!(sky.radiance.len(), set.len(), "{}", sky.name);
            assert!(sky.radiance.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{}", sky.name);
        }
        let shape = |sky: &TestSky| {
            let green: Vec<f32> = sky.radiance.iter().take(set.upper()).map(|rgb| rgb[1]).collect();
            let norm = green.iter().map(|v| v * v).sum::<f32>().sqrt();
            green.into_iter().map(move |v| v / norm).collect::<Vec<f32>>()
        };
        for (index, sky) in skies.iter().enumerate() {
            for other in &skies[index + 1..] {
                let alike: f32 = shape(sky).iter().zip(shape(other)).map(|(a, b)| a * b).sum();
                assert!(alike < 0.995, "{} and {}: {alike}", sky.name, other.name);
            }
        }
    }
}
