use super::boxes::Stretch;
use super::*;
use crate::random::Random;
use crate::response::tests::{camera, floor, quads};
use glam::Vec3;

/// Moments of random responses and skies over `parts` finest parts, and these themselves.
fn random_moments(parts: usize, random: &mut Random) -> (Moments, Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let draw = |random: &mut Random| (0..parts).map(|_| random.unit()).collect::<Vec<f64>>();
    let responses: Vec<Vec<f64>> = (0..7).map(|_| draw(random)).collect();
    let skies: Vec<Vec<f64>> = (0..5).map(|_| draw(random)).collect();
    let product = |rows: &[Vec<f64>], share: f64| {
        let at = |k: usize| rows.iter().map(|row| share * row[k / parts] * row[k % parts]).sum();
        (0..parts * parts).map(at).collect()
    };
    (Moments { response: product(&responses, 1.0), light: product(&skies, 0.2) }, responses, skies)
}

/// Against the definition: the square of the sum over a patch's parts of response times light, both less their means.
#[test]
fn a_rectangles_error_is_that_of_its_definition() {
    let mut random = Random::new(11);
    let (moments, responses, skies) = random_moments(16, &mut random);
    let boxes = Boxes::new(&moments, 0.3, [2, 2], |_| true);
    // Height 2 of 4 halves from the horizon, azimuth the second half: columns 2 and 3, rows 0 and 1.
    for (rectangle, parts) in [
        ([Stretch(1), Stretch(1)], (0..16).collect::<Vec<_>>()),
        ([Stretch(2), Stretch(3)], vec![8, 9, 12, 13]),
        ([Stretch(7), Stretch(2)], vec![3, 7]),
        ([Stretch(5), Stretch(6)], vec![9]),
    ] {
        let centred = |row: &[f64]| {
            let mean = parts.iter().map(|&k| row[k]).sum::<f64>() / parts.len() as f64;
            parts.iter().map(|&k| row[k] - mean).collect::<Vec<f64>>()
        };
        let mut want = 0.0;
        for response in &responses {
            let response = centred(response);
            want += 0.3 * response.iter().map(|v| v * v).sum::<f64>();
            for sky in &skies {
                want += 0.2 * response.iter().zip(centred(sky)).map(|(r, l)| r * l).sum::<f64>().powi(2);
            }
        }
        let found = boxes.error(rectangle);
        assert!((found - want).abs() < 1e-9, "{rectangle:?}: {found} for {want}");
    }
}

/// All ways to cut a rectangle: number of patches and error.
fn all_ways(boxes: &Boxes, rectangle: [Stretch; 2]) -> Vec<(usize, f64)> {
    let mut ways = vec![(1, boxes.error(rectangle))];
    for axis in 0..2 {
        let Some([first, second]) = boxes.halves(rectangle, axis) else { continue };
        let (first, second) = (all_ways(boxes, first), all_ways(boxes, second));
        ways.extend(first.iter().flat_map(|a| second.iter().map(move |b| (a.0 + b.0, a.1 + b.1))));
    }
    ways
}

/// Number of patches and error of cuts in a set's order.
fn told(boxes: &Boxes, cuts: &mut impl Iterator<Item = Cut>, rectangle: [Stretch; 2]) -> (usize, f64) {
    let halves = match cuts.next() {
        Some(Cut::Height) => boxes.halves(rectangle, 0),
        Some(Cut::Azimuth) => boxes.halves(rectangle, 1),
        _ => return (1, boxes.error(rectangle)),
    };
    let [first, second] = halves.unwrap().map(|half| told(boxes, cuts, half));
    (first.0 + second.0, first.1 + second.1)
}

/// Every way to cut two cells is tried. Where a number of patches is one that some price gives, no way is better.
#[test]
fn no_cuts_of_as_many_patches_are_better() {
    let mut random = Random::new(5);
    let (whole, mut corners) = ([Stretch(1), Stretch(1)], 0);
    for round in 0..20 {
        // Cuts in height need a cut in azimuth before them in every other round.
        let cells = [0, 1].map(|_| {
            let (moments, ..) = random_moments(8, &mut random);
            Boxes::new(&moments, 0.1, [1, 2], |cuts| cuts > 0 || round % 2 == 0)
        });
        let ways = cells.each_ref().map(|cell| all_ways(cell, whole));
        let mut least = [f64::INFINITY; 17];
        for (a, b) in ways[0].iter().flat_map(|a| ways[1].iter().map(move |b| (a, b))) {
            least[a.0 + b.0] = least[a.0 + b.0].min(a.1 + b.1);
        }
        for patches in 2..=16 {
            let mut cuts = tree::best_cuts(&cells, patches).into_iter();
            let found = cells.each_ref().map(|cell| told(cell, &mut cuts, whole));
            assert_eq!((found[0].0 + found[1].0, cuts.next()), (patches, None));
            let error = found[0].1 + found[1].1;
            let line = |from: usize, to: usize| {
                let share = (patches - from) as f64 / (to - from) as f64;
                least[from] + share * (least[to] - least[from])
            };
            let corner = (2..patches).all(|from| (patches + 1..=16).all(|to| least[patches] < line(from, to)));
            // Between two prices' numbers of patches one more cut is the best single one only.
            assert!(!corner || error <= (1.0 + 1e-9) * least[patches] + 1e-12, "{round} {patches}: {error}");
            corners += usize::from(corner);
        }
    }
    assert!(corners > 100, "{corners}");
}

fn fitted(scene: &Scene, camera: &Camera, directions: usize) -> PatchSet {
    let options = BakeOptions { size: (28, 20), directions, ..BakeOptions::default() };
    PatchSet::of_subdivided(fit(scene, camera, &options).unwrap())
}

/// Mean number of patches per steradian where `holds`.
fn density(set: &PatchSet, holds: impl Fn(Vec3) -> bool) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..20_000 {
        let (y, azimuth) = ((f64::from(k) + 0.5) / 20_000.0, f64::from(k) * 2.399_963_229_728_653);
        let radius = (1.0 - y * y).sqrt();
        let dir = [radius * azimuth.cos(), y, radius * azimuth.sin()].map(|c| c as f32);
        if holds(Vec3::from(dir)) {
            sum += 1.0 / f64::from(set.solid_angle_sr(set.patch_of(dir)));
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

/// A floor below a lid with a slit along x: the sky shows through the slit alone.
#[test]
fn patches_are_small_where_a_slit_shows_the_sky() {
    let lid =
        |from: f32, to: f32| [[-90.0, from], [90.0, from], [90.0, to], [-90.0, to]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let scene = quads(&[(floor(90.0, 0.0), 0.5), (lid(-90.0, 0.3), 0.0), (lid(0.6, 90.0), 0.0)]);
    let set = fitted(&scene, &camera([0.0, 0.9, -0.6], [0.0, 0.0, 0.0], 40.0), 64);
    // Seen from the floor around the middle, the slit lies between 10 and 35 degrees of the zenith towards +Z.
    let tilt = |dir: Vec3| dir.z.atan2(dir.y).to_degrees();
    let slit = density(&set, |dir| (5.0..45.0).contains(&tilt(dir)) && dir.x.abs() < 0.8);
    let lidded = density(&set, |dir| !(-25.0..70.0).contains(&tilt(dir)));
    assert!(slit > 5.0 * lidded, "{slit} and {lidded} patches per sr");
    assert_eq!((set.len(), set.lower()), (68, 1));
}

/// An open floor answers by the cosine: no patch of the upper half is much smaller than others as bright.
#[test]
fn patches_stay_large_under_a_smooth_response() {
    let scene = quads(&[(floor(90.0, 0.0), 0.5)]);
    let set = fitted(&scene, &camera([0.0, 2.0, 0.0], [0.0, 0.0, -1.0], 40.0), 128);
    let high = density(&set, |dir| dir.y > 0.5);
    let most = (0..set.upper()).map(|patch| 1.0 / f64::from(set.solid_angle_sr(patch))).fold(0.0, f64::max);
    assert!(most < 6.0 * high, "{most} of {high} patches per sr");
}

#[test]
fn the_same_patches_on_any_number_of_threads() {
    let scene = crate::response::tests::corner(0.7);
    let camera = crate::response::tests::into_the_corner();
    let on = |threads: usize, directions: usize, sphere: bool| {
        let options = BakeOptions { size: (12, 9), directions, sphere, ..BakeOptions::default() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit(&scene, &camera, &options).unwrap())
    };
    assert_eq!(on(1, 64, false), on(3, 64, false));
    for (directions, sphere, patches) in [(16, false, 17), (300, false, 318), (40, true, 40)] {
        let set = PatchSet::of_subdivided(on(2, directions, sphere));
        assert_eq!((set.len(), set.horizon().is_none()), (patches, sphere));
    }
}

#[test]
fn too_many_directions_are_refused() {
    let scene = quads(&[(floor(9.0, 0.0), 0.5)]);
    let options = BakeOptions { size: (16, 12), directions: 1025, ..BakeOptions::default() };
    let refused = fit(&scene, &camera([0.0, 2.0, 0.0], [0.0, 0.0, -1.0], 40.0), &options);
    assert!(matches!(refused, Err(BakeError::Patches(_))), "{refused:?}");
}

/// The most patches there may be: the finest cells do not fit one set.
#[test]
fn a_thousand_directions_are_cut_in_several_goes() {
    assert_eq!(finest_cuts(1024), [4, 4]);
    let (at_once, parts) = ((MAX_PATCHES - 17) / 255, 256);
    let pilot = Pilot::new(false, 0..at_once, [4, 4]);
    assert!(pilot.parts.iter().all(|part| part.len() == parts) && pilot.set.len() == at_once * 256 + 17 - at_once);
    assert_eq!(finest_cuts(16), [3, 3]);
    assert_eq!(Pilot::new(false, 0..17, [3, 3]).set.len(), MAX_PATCHES);
}
