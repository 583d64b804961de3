//! A captured map into sun and sky, and the sky into patches.
//!
//! The sun is looked for above the horizon where a cap of 0.6 degrees gathers most light. The sky behind it is in-painted
//! from the ring around it; what stands above that within 1 degree of the excess's centroid (at least one and a half rows
//! on coarse maps) is taken out of the map, channel by channel, so sky + sun = map.
//!
//! It counts as the sun only if, gathered into a disc of 0.533 degrees, it would be at least [`MIN_DISC_CONTRAST`] times as
//! bright as the ring (a cloud or a hole between clouds that fills the cap and is twice as bright as its surround stays
//! below), and if it is at least [`MIN_IRRADIANCE_SHARE`] of the light of the sky (glints, lamps and overcast skies stay below).
//!
//! The sky's mean over each patch then gives to its neighbours what stands at one side of it (moments.rs).

use super::cells::cell_means;
use super::map::{MapError, RadianceMap, luminance};
use super::moments::Moments;
use super::patchsums::{PatchSums, means, patch_sums};
use super::weights::{PatchWeights, SunWeight, sun_solid_angle_sr};
use crate::patches::PatchSet;
use std::f64::consts::{PI, TAU};

/// Radius within which the excess over the in-painted sky is the sun's, degrees.
pub const SUN_RADIUS_DEG: f64 = 1.0;
/// Least radiance of the disc over the radiance of the ring around it.
pub const MIN_DISC_CONTRAST: f64 = 30.0;
/// Least irradiance of the sun, on a plane normal to it, over pi times the upper hemisphere's mean radiance.
pub const MIN_IRRADIANCE_SHARE: f64 = 0.01;

const SEARCH_RADIUS_DEG: f64 = 0.6;
const CANDIDATES: usize = 64;

/// A map cut in two.
#[derive(Clone, Debug)]
pub struct Split {
    /// The map without the sun.
    pub sky: RadianceMap,
    /// The sun, in the map's frame, if one stands out.
    pub sun: Option<SunWeight>,
}

/// A pixel near a direction.
#[derive(Clone, Copy)]
struct Near {
    index: usize,
    dir: [f64; 3],
    omega: f64,
    angle: f64,
}

fn angle_between(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    cross.iter().map(|c| c * c).sum::<f64>().sqrt().atan2(dot)
}

/// Pixels whose centres lie within `radius` (radians) of a direction and above the horizon.
fn pixels_near(map: &RadianceMap, dir: [f64; 3], radius: f64) -> Vec<Near> {
    let step = PI / map.height as f64;
    let theta = dir[0].hypot(dir[2]).atan2(dir[1]);
    let rows =
        ((theta - radius) / step).max(0.0) as usize..(((theta + radius) / step) as usize + 1).min(map.height / 2);
    let [middle, _] = map.position_of(dir.map(|c| c as f32));
    let reach = if theta > radius { (radius.sin() / theta.sin()).min(1.0).asin() } else { PI };
    let reach = (reach / TAU * map.width as f64).ceil() as i64 + 1;
    let mut near = Vec::new();
    for row in rows {
        let omega = map.solid_angle_sr(row);
        let from = middle as i64 - reach;
        for col in from..(from + 2 * reach + 1).min(from + map.width as i64) {
            let col = col.rem_euclid(map.width as i64) as usize;
            let pixel = map.dir_map(col, row).map(f64::from);
            let angle = angle_between(pixel, dir);
            if angle <= radius {
                near.push(Near { index: row * map.width + col, dir: pixel, omega, angle });
            }
        }
    }
    near
}

/// The pixel, among the brightest above the horizon, around which a small cap gathers most light.
fn candidate(map: &RadianceMap) -> Option<[f64; 3]> {
    let upper = map.width * (map.height / 2);
    let mut brightest: Vec<(f32, usize)> = Vec::with_capacity(CANDIDATES + 1);
    for (index, &rgb) in map.pixels[..upper].iter().enumerate() {
        let value = luminance(rgb);
        if brightest.len() < CANDIDATES || brightest.last().is_some_and(|last| value > last.0) {
            let at = brightest.partition_point(|&(other, _)| other >= value);
            brightest.insert(at, (value, index));
            brightest.truncate(CANDIDATES);
        }
    }
    let gathered = |index: usize| {
        let dir = map.dir_map(index % map.width, index / map.width).map(f64::from);
        let near = pixels_near(map, dir, SEARCH_RADIUS_DEG.to_radians());
        (near.iter().map(|n| n.omega * f64::from(luminance(map.pixels[n.index]))).sum::<f64>(), dir)
    };
    brightest.iter().map(|&(_, index)| gathered(index)).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, dir)| dir)
}

/// What stands above the in-painted sky within `radius` of a direction.
struct Excess {
    /// Pixel index and RGB excess.
    pixels: Vec<(usize, [f32; 3])>,
    centroid: [f64; 3],
    /// Sum of excess x solid angle.
    irradiance: [f64; 3],
    /// Mean luminance of the ring the sky was in-painted from.
    ring: f64,
}

fn excess_around(map: &RadianceMap, dir: [f64; 3], radius: f64) -> Option<Excess> {
    let width = (0.5 * radius).max(1.5 * PI / map.height as f64);
    let near = pixels_near(map, dir, radius + width);
    let (ring, cap): (Vec<Near>, Vec<Near>) = near.iter().partition(|n| n.angle > radius);
    if ring.is_empty() || cap.is_empty() {
        return None;
    }
    let ring_light: f64 = ring.iter().map(|n| n.omega * f64::from(luminance(map.pixels[n.index]))).sum();
    let ring_mean = ring_light / ring.iter().map(|n| n.omega).sum::<f64>();
    let mut excess = Excess { pixels: Vec::new(), centroid: [0.0; 3], irradiance: [0.0; 3], ring: ring_mean };
    for pixel in &cap {
        let (mut sky, mut total) = ([0.0; 3], 0.0);
        for other in &ring {
            let apart: f64 = (0..3).map(|k| (pixel.dir[k] - other.dir[k]).powi(2)).sum();
            let weight = other.omega / apart.max(1e-12);
            total += weight;
            let beside = map.pixels[other.index];
            sky = std::array::from_fn(|k| sky[k] + weight * f64::from(beside[k]));
        }
        let value = map.pixels[pixel.index];
        let above: [f32; 3] = std::array::from_fn(|k| (value[k] - (sky[k] / total) as f32).max(0.0));
        let light = f64::from(luminance(above)) * pixel.omega;
        excess.irradiance = std::array::from_fn(|k| excess.irradiance[k] + f64::from(above[k]) * pixel.omega);
        excess.centroid = std::array::from_fn(|k| excess.centroid[k] + light * pixel.dir[k]);
        excess.pixels.push((pixel.index, above));
    }
    let length = excess.centroid.iter().map(|c| c * c).sum::<f64>().sqrt();
    excess.centroid = if length > 0.0 { excess.centroid.map(|c| c / length) } else { dir };
    Some(excess)
}

/// Splits a map into sky and sun; see the module's text. Energy is conserved in every channel.
pub fn split(map: &RadianceMap) -> Split {
    let whole = || Split { sky: map.clone(), sun: None };
    let radius = SUN_RADIUS_DEG.to_radians().max(1.5 * PI / map.height as f64);
    let Some(mut dir) = candidate(map) else { return whole() };
    for _ in 0..4 {
        let Some(excess) = excess_around(map, dir, radius) else { return whole() };
        dir = excess.centroid;
    }
    let Some(excess) = excess_around(map, dir, radius) else { return whole() };
    let light = f64::from(luminance(excess.irradiance.map(|v| v as f32)));
    let upper = map.width * (map.height / 2);
    let mut sky_light = -light;
    for (index, &rgb) in map.pixels[..upper].iter().enumerate() {
        sky_light += f64::from(luminance(rgb)) * map.solid_angle_sr(index / map.width);
    }
    let contrast = light / sun_solid_angle_sr() / excess.ring.max(1e-30);
    if !(light > 0.0 && contrast >= MIN_DISC_CONTRAST && light >= MIN_IRRADIANCE_SHARE * 0.5 * sky_light) {
        return whole();
    }
    let mut sky = map.clone();
    for (index, above) in excess.pixels {
        let pixel = &mut sky.pixels[index];
        *pixel = std::array::from_fn(|k| pixel[k] - above[k]);
    }
    let sun =
        SunWeight { dir_world: excess.centroid.map(|c| c as f32), irradiance: excess.irradiance.map(|v| v as f32) };
    Split { sky, sun: Some(sun) }
}

/// Mean radiance per patch (`set.len()` RGB values) of a map turned by `env_rot_deg` about +Y: world = RotY(deg) * map.
///
/// Pixels that straddle a border of patches are shared by exact area, so the sum of radiance x solid angle over the
/// patches is the map's integral. Of a list, each gets the mean over the directions that are nearest to it (cells.rs).
pub fn integrate(map: &RadianceMap, set: &PatchSet, env_rot_deg: f64) -> Vec<[f32; 3]> {
    match set.listed() {
        Some(list) => cell_means(map, list, env_rot_deg),
        None => means(&patch_sums(map, set, env_rot_deg), set),
    }
}

/// The same, with what stands at one side of a patch moved in part to its neighbours, where the set has such ([`Moments`]): the
/// weights that stand for a map without a sun.
pub fn settled(map: &RadianceMap, set: &PatchSet, env_rot_deg: f64) -> Vec<[f32; 3]> {
    let Some(moments) = Moments::new(set) else { return integrate(map, set, env_rot_deg) };
    let sums = patch_sums(map, set, env_rot_deg);
    // About the middle of an even map, summed up in the same way, so that such a map has no moments at all.
    let aside = |PatchSums { integral, by_dir }: &PatchSums| -> [[f64; 3]; 3] {
        let middle = by_dir[3].map(|v| v / integral[3].max(f64::MIN_POSITIVE));
        let moment = |k: usize| std::array::from_fn(|m| by_dir[k][m] - integral[k] * middle[m]);
        std::array::from_fn(|k| turned(moment(k), env_rot_deg))
    };
    let aside: Vec<_> = sums.iter().map(aside).collect();
    let mut radiance = means(&sums, set);
    moments.settle(&mut radiance, &aside);
    radiance
}

/// RotY(`env_rot_deg`) applied to a vector of the map's frame.
fn turned([x, y, z]: [f64; 3], env_rot_deg: f64) -> [f64; 3] {
    let (sin, cos) = env_rot_deg.to_radians().sin_cos();
    [x * cos + z * sin, y, z * cos - x * sin]
}

/// A direction of the map's frame in the world: RotY(`env_rot_deg`) applied to it.
pub fn rotate_to_world(dir_map: [f32; 3], env_rot_deg: f64) -> [f32; 3] {
    turned(dir_map.map(f64::from), env_rot_deg).map(|c| c as f32)
}

/// Patch weights and sun of a captured map.
///
/// # Errors
/// [`MapError`] where the map's shape or a pixel is not usable.
pub fn weights(map: &RadianceMap, set: &PatchSet, env_rot_deg: f64) -> Result<PatchWeights, MapError> {
    map.check("sky map")?;
    let Split { sky, sun } = split(map);
    let in_world = |sun: SunWeight| SunWeight { dir_world: rotate_to_world(sun.dir_world, env_rot_deg), ..sun };
    Ok(PatchWeights { radiance: settled(&sky, set, env_rot_deg), sun: sun.map(in_world) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Towards an azimuth from -Z towards +X and an altitude, degrees.
    fn dir_world(azimuth_deg: f64, altitude_deg: f64) -> [f32; 3] {
        let (azimuth, altitude) = (azimuth_deg.to_radians(), altitude_deg.to_radians());
        let level = altitude.cos();
        [level * azimuth.sin(), altitude.sin(), -level * azimuth.cos()].map(|v| v as f32)
    }

    fn altitude_deg([_, y, _]: [f32; 3]) -> f64 {
        f64::from(y).asin().to_degrees()
    }

    fn sky(d: [f32; 3]) -> [f32; 3] {
        [1.0 + d[0] * d[2], 1.5 + d[1], 2.0 + 0.5 * d[2]]
    }

    fn with_disc(height: usize, centre: [f32; 3], radius_deg: f64, irradiance: f64) -> RadianceMap {
        let mut map = RadianceMap::from_fn(height, sky);
        let centre = centre.map(f64::from);
        let near = pixels_near(&map, centre, (radius_deg.to_radians()).max(1.2 * PI / height as f64));
        let total: f64 = near.iter().map(|n| n.omega).sum();
        for n in near {
            map.pixels[n.index] = map.pixels[n.index].map(|v| v + (irradiance / total) as f32);
        }
        map
    }

    #[test]
    fn a_known_sun_is_found_at_any_resolution_and_height() {
        for (height, tolerance_deg) in [(512, 0.15), (128, 0.6)] {
            for (azimuth_deg, altitude_deg) in [(10.0, 75.0), (271.0, 35.0), (90.2, 12.0), (180.0, 89.0)] {
                let dir = dir_world(azimuth_deg, altitude_deg);
                let map = with_disc(height, dir, 0.3, 2.0);
                let Split { sky, sun } = split(&map);
                let sun = sun.unwrap();
                let off = angle_between(sun.dir_world.map(f64::from), dir.map(f64::from)).to_degrees();
                assert!(off < tolerance_deg, "{height} {altitude_deg}: {off}");
                assert!((f64::from(sun.irradiance[1]) / 2.0 - 1.0).abs() < 0.01, "{sun:?}");
                let (whole, left) = (map.integral(), sky.integral());
                for k in 0..3 {
                    assert!((left[k] + f64::from(sun.irradiance[k]) - whole[k]).abs() < 1e-5 * whole[k]);
                }
            }
        }
    }

    #[test]
    fn clouds_lamps_and_ground_are_no_sun() {
        let up = dir_world(100.0, 40.0);
        assert!(split(&RadianceMap::from_fn(128, sky)).sun.is_none());
        // Clouds five times as bright as their surround (radiance 2), of 3 and of 0.9 degrees radius.
        assert!(split(&with_disc(512, up, 3.0, 5.0 * 2.0 * 0.0086)).sun.is_none());
        assert!(split(&with_disc(512, up, 0.9, 5.0 * 2.0 * 0.00078)).sun.is_none());
        assert!(split(&with_disc(512, up, 0.2, 0.02)).sun.is_none());
        // A glint on the ground.
        let mut map = RadianceMap::from_fn(256, sky);
        map.pixels[200 * 512 + 7] = [1e6; 3];
        assert!(split(&map).sun.is_none());
    }

    #[test]
    fn patches_keep_the_maps_integral() {
        for (n, height, turn) in [(256, 64, 0.0), (16, 9, 33.3), (1000, 128, -190.0)] {
            let set = PatchSet::new(n).unwrap();
            let map = RadianceMap::from_fn(height, sky);
            let patches = integrate(&map, &set, turn);
            let whole = map.integral();
            for k in 0..3 {
                let sum: f64 =
                    patches.iter().enumerate().map(|(p, v)| f64::from(v[k]) * f64::from(set.solid_angle_sr(p))).sum();
                assert!((sum / whole[k] - 1.0).abs() < 1e-5, "{n} {k}: {sum} {}", whole[k]);
            }
        }
    }

    #[test]
    fn patches_equal_means_over_their_own_directions() {
        let set = PatchSet::new(64).unwrap();
        let map = RadianceMap::from_fn(256, sky);
        for turn in [0.0, 40.0] {
            let patches = integrate(&map, &set, turn);
            for (patch, found) in patches.iter().enumerate() {
                let mut mean = [0.0; 3];
                for i in 0..1600 {
                    let u = [(i % 40) as f32 / 40.0 + 0.0125, (i / 40) as f32 / 40.0 + 0.0125];
                    let value = sky(rotate_to_world(set.sample(patch, u), -turn));
                    mean = std::array::from_fn(|k| mean[k] + value[k] / 1600.0);
                }
                for k in 0..3 {
                    assert!((found[k] - mean[k]).abs() < 5e-3, "{patch} {k}: {found:?} {mean:?}");
                }
            }
        }
    }

    /// A bright cloud of 2 degrees before an even sky: the direction that its light comes from, as surfaces see it. Means alone put it
    /// into the middle of its patch, 3 degrees off on the average.
    #[test]
    fn settled_patches_light_from_where_the_light_stands() {
        let set = PatchSet::new(256).unwrap();
        let even = RadianceMap::from_fn(360, |_| [1.0; 3]);
        let from = |radiance: &[[f32; 3]], before: &[[f32; 3]]| -> [f32; 3] {
            let more = |patch: usize| f64::from((radiance[patch][1] - before[patch][1]) * set.solid_angle_sr(patch));
            let sum = |m: usize| (0..set.upper()).map(|p| more(p) * f64::from(set.dir_world(p)[m])).sum::<f64>();
            let sum = [0, 1, 2].map(sum);
            let length = sum.iter().map(|c| c * c).sum::<f64>().sqrt();
            sum.map(|c| (c / length) as f32)
        };
        let before = weights(&even, &set, 0.0).unwrap().radiance;
        let (mut by_means, mut by_settled) = (Vec::new(), Vec::new());
        for k in 0..24 {
            let (cloud, turn) = (dir_world(47.0 * k as f64, 15.0 + 2.5 * k as f64), 15.0 * f64::from(k));
            let near =
                |d: [f32; 3]| if angle_between(d.map(f64::from), cloud.map(f64::from)) < 0.035 { 20.0 } else { 1.0 };
            let map = RadianceMap::from_fn(360, |d| [1.0, near(d), 0.5]);
            let truth = rotate_to_world(cloud, turn).map(f64::from);
            let off = |radiance: &[[f32; 3]]| angle_between(from(radiance, &before).map(f64::from), truth).to_degrees();
            by_means.push(off(&integrate(&map, &set, turn)));
            by_settled.push(off(&weights(&map, &set, turn).unwrap().radiance));
        }
        let [means, settled] = [&by_means, &by_settled].map(|off| off.iter().sum::<f64>() / off.len() as f64);
        assert!(means > 2.0 && settled < 0.3, "{means} and {settled} degrees off: {by_settled:.2?}");
    }

    #[test]
    fn turning_moves_the_sun_to_smaller_u() {
        let set = PatchSet::new(256).unwrap();
        let south = dir_world(180.0, 30.0);
        let found = weights(&with_disc(256, south, 0.3, 3.0), &set, 90.0).unwrap().sun.unwrap();
        let off = angle_between(found.dir_world.map(f64::from), dir_world(90.0, 30.0).map(f64::from));
        assert!(off.to_degrees() < 0.3, "{found:?}");
    }

    #[test]
    fn photographed_skies_split_as_measured() {
        let Some(folder) = super::super::map::shared_folder() else { return };
        // Altitude, its tolerance and the sun's share of horizontal irradiance.
        let cases = [("kloppenheim_05_1k", 74.7, 0.80), ("immenstadter_horn_1k", 35.0, 0.19)];
        for (name, expected_deg, share) in cases {
            let map = RadianceMap::load(&folder.join("skies").join(format!("{name}.hdr"))).unwrap();
            let sun = split(&map).sun.unwrap();
            let total = map.horizontal_irradiance()[1];
            let found = f64::from(sun.irradiance[1] * sun.dir_world[1]) / total;
            println!("{name}: {sun:?}, share {found:.3}");
            assert!((altitude_deg(sun.dir_world) - expected_deg).abs() < 0.7, "{name}: {sun:?}");
            assert!((found - share).abs() < 0.02, "{name}: {found}");
        }
        let map = RadianceMap::load(&folder.join("skies/potsdamer_platz_1k.hdr")).unwrap();
        let sun = split(&map).sun;
        let share = sun.map_or(0.0, |s| f64::from(s.irradiance[1] * s.dir_world[1]) / map.horizontal_irradiance()[1]);
        println!("potsdamer_platz_1k: {sun:?}, share {share:.4}");
        assert!(share < 0.015, "{share}");
    }
}
