//! The stack's sun and the live sun of a field, both against closed forms and against each other.

use std::f32::consts::PI;

use glam::Vec3;
use relume_firmware::bounce::mean_up;
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;
use relume_firmware::sunlight::SunLight;

use super::*;
use crate::bake::{BakeOptions, bake};
use crate::camera::{Camera, Optics, Projection};
use crate::response::TransportOptions;
use crate::response::tests::{SIZE, corner, floor, into_the_corner, near, options, quads, spot};
use crate::scene::Scene;

/// Towards +Z, at an altitude in degrees.
fn towards(altitude_deg: f32) -> Vec3 {
    let (sin, cos) = altitude_deg.to_radians().sin_cos();
    Vec3::new(0.0, sin, cos)
}

/// Red response of every pixel to a sun, path-traced as for a stack. All pixels must be covered.
pub(super) fn traced(scene: &Scene, camera: &Camera, options: TransportOptions, sun: Vec3) -> Vec<f32> {
    let patches = PatchSet::new(16).unwrap_or_else(|error| panic!("{error}"));
    let transport = Transport::new(scene, camera, patches, SIZE, options).unwrap_or_else(|error| panic!("{error}"));
    let (tile, sun) = (transport.tile(0, 0), SunDisc::new(sun));
    let further = transport.gather(&transport.bounce_points(), &tile, Some(&sun)).sun;
    transport.sun_tile(&tile, &further, &sun).chunks_exact(3).map(|rgb| rgb[0]).collect()
}

/// The same by way of a field.
pub(super) fn live(scene: &Scene, camera: &Camera, transport: TransportOptions, sun: Vec3) -> Vec<f32> {
    let options = BakeOptions { size: SIZE, directions: 16, transport, progress: false, ..BakeOptions::default() };
    let baked = bake(scene, camera, &options).unwrap_or_else(|error| panic!("{error}"));
    let field = Field::new(&baked.bytes).unwrap_or_else(|error| panic!("{error}"));
    let light = SunLight::new(&field, sun.to_array());
    let points = field.bounce().points();
    let mut means = vec![[0.0; 3]; 2 * points];
    light.points(&field, 0, &mut means[points..]);
    mean_up(&mut means);
    let mut slot = vec![0u16; 3 * 256];
    light.tile(&field, 0, &means, &mut slot);
    slot[..256].iter().map(|&v| f32::from(v) / 32768.0).collect()
}

pub(super) fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len() as f32
}

/// Relative rms difference.
pub(super) fn apart(a: &[f32], b: &[f32]) -> f32 {
    let squares: f32 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / a.len() as f32).sqrt() / mean(b)
}

#[test]
fn a_plane_shows_the_cosine() {
    let scene = quads(&[(floor(50.0, 0.0), 0.6)]);
    for altitude in [5.0f32, 30.0, 80.0] {
        let want = 0.6 / PI * altitude.to_radians().sin();
        near(mean(&traced(&scene, &spot(), options(0), towards(altitude))), want, 2e-3);
        near(mean(&live(&scene, &spot(), options(0), towards(altitude))), want, 2e-3);
    }
    assert!(traced(&scene, &spot(), options(0), Vec3::NEG_Y).iter().all(|&v| v == 0.0));
}

#[test]
fn the_shadow_of_an_edge_is_as_soft_as_the_disc_is_wide() {
    let height = 2.0;
    let radius = height * (0.5 * SUN_DIAMETER_DEG).to_radians().tan();
    // All pixels must look at less of the floor than a hundredth of the penumbra.
    let camera = Camera { fov_y_deg: 0.005, ..spot() };
    for share in [-1.5f32, -0.8, -0.3, 0.0, 0.5, 0.9, 1.2] {
        let edge = share * radius;
        let plate = [[edge, 9.0], [9.0, 9.0], [9.0, -9.0], [edge, -9.0]].map(|[x, z]| Vec3::new(x, height, z));
        let scene = quads(&[(floor(50.0, 0.0), 0.5), (plate, 0.5)]);
        // The part of a circle on one side of a chord.
        let u = share.clamp(-1.0, 1.0);
        let seen = 1.0 - (u.acos() - u * (1.0 - u * u).sqrt()) / PI;
        let want = 0.5 / PI * seen;
        let got = [traced, live].map(|way| mean(&way(&scene, &camera, options(1), Vec3::Y)));
        assert!(got.iter().all(|got| (got - want).abs() < 0.015 * 0.5 / PI), "{share}: {got:?} instead of {want}");
    }
}

/// Stripes of shadow under a wide lens: the board looks through it at the points that the bake looks at.
#[test]
fn shadows_lie_alike_behind_a_lens() {
    let stripe = |k: f32| [[k, 9.0], [k + 0.4, 9.0], [k + 0.4, -9.0], [k, -9.0]].map(|[x, z]| Vec3::new(x, 2.5, z));
    let stripes = (-8..8).map(|k| (stripe(k as f32), 0.5));
    let scene = quads(&std::iter::once((floor(90.0, 0.0), 0.6)).chain(stripes).collect::<Vec<_>>());
    let lens = |projection, focal_px, k1| {
        let ideal = Optics::ideal(projection, [32, 32], focal_px);
        Optics { principal_px: [16.9, 15.2], k: [k1, 0.0, 0.0, 0.0], ..ideal }
    };
    for optics in [lens(Projection::KannalaBrandt, 18.0, 0.02), lens(Projection::Radial, 24.0, -0.1)] {
        let camera = Camera { position: [0.3, 1.5, 0.2], optics: Some(optics), ..spot() };
        let [a, b] = [traced, live].map(|way| way(&scene, &camera, options(1), towards(70.0)));
        let lit = a.iter().filter(|&&v| v > 0.9 * 0.6 / PI * 70f32.to_radians().sin()).count();
        assert!((64..220).contains(&lit), "{lit} of 256 pixels in full sun");
        let off = apart(&b, &a);
        eprintln!("live and path-traced differ by {off}");
        assert!(off < 0.02, "{optics:?}: live and path-traced differ by {off}");
    }
}

#[test]
fn a_sunlit_wall_lights_the_floor_by_its_form_factor() {
    // Point at distance 1 before an endless wall of height 1 that stands upright on its plane.
    let form_factor = 0.5 * (1.0 - 1.0 / 2.0f32.sqrt());
    for altitude in [10.0f32, 45.0] {
        let (sin, cos) = altitude.to_radians().sin_cos();
        let want = 0.5 / PI * (sin + form_factor * 0.5 * cos);
        near(mean(&traced(&corner(0.5), &spot(), options(2), towards(altitude))), want, 3e-3);
        near(mean(&live(&corner(0.5), &spot(), options(2), towards(altitude))), want, 3e-3);
    }
}

#[test]
fn light_of_many_bounces_has_little_grain_and_is_the_same_both_ways() {
    for altitude in [8.0, 35.0] {
        let ways = [traced, live].map(|way| {
            let seeds = [1, 2].map(|seed| {
                let options = TransportOptions { seed, ..options(0) };
                way(&corner(0.8), &into_the_corner(), options, towards(altitude))
            });
            let direct = way(&corner(0.8), &into_the_corner(), options(1), towards(altitude));
            seeds.map(|all| all.iter().zip(&direct).map(|(all, direct)| all - direct).collect::<Vec<f32>>())
        });
        // Two pictures with noise differ by the root of two times it.
        let seeds = ways.each_ref().map(|[one, other]| apart(one, other));
        assert!(seeds.iter().all(|&off| off < 0.045), "{altitude}: two seeds differ by {seeds:?}");
        let difference = apart(&ways[1][0], &ways[0][0]);
        eprintln!("{altitude}: two seeds differ by {seeds:?}, live and path-traced by {difference}");
        assert!(difference < 0.045, "{altitude}: live and path-traced indirect light differ by {difference}");
        near(mean(&ways[1][0]), mean(&ways[0][0]), 0.01);
    }
}
