//! Glossy surfaces in the sun: the stack's and the field's against the integral over the disc, and against each other.

use glam::Vec3;

use super::tests::{apart, live, mean, traced};
use super::*;
use crate::appendix_b::Appendix;
use crate::response::glossy_tests::{finished, mapped, plane, towards};
use crate::response::tests::{camera, options, quads, spot};

/// Mean of BRDF times cosine over the sun's disc, about the normal `normal`.
fn over_the_disc(material: &Appendix, normal: [f64; 3], view: [f64; 3], sun: Vec3) -> f64 {
    let (disc, steps) = (SunDisc::new(sun), 128u32);
    let grid = Grid::new(steps * steps);
    let of = |cell: u32| {
        let light = disc.direction(grid.point(cell, glam::Vec2::splat(0.5))).to_array().map(f64::from);
        let cosine: f64 = normal.iter().zip(light).map(|(n, l)| n * l).sum();
        material.brdf(normal, view, light) * cosine.max(0.0)
    };
    (0..steps * steps).map(of).sum::<f64>() / f64::from(steps * steps)
}

/// A sun `off_deg` degrees away from where a mirror floor shows it, turned about the vertical.
fn beside_the_mirror(view: [f64; 3], off_deg: f32) -> Vec3 {
    let [x, y, z] = view.map(|c| c as f32);
    glam::Quat::from_rotation_y(off_deg.to_radians()) * Vec3::new(-x, y, -z)
}

#[test]
fn a_plane_in_the_sun_shows_the_formula() {
    let eye = spot();
    let view = towards(&eye);
    for (metallic, roughness) in [(0.0, 0.2), (0.0, 1.0), (1.0, 0.25), (1.0, 0.6), (0.5, 0.5)] {
        let material = Appendix { base: 0.6, metallic, roughness };
        for off in [3.0, 12.0, 90.0] {
            let sun = beside_the_mirror(view, off);
            let want = over_the_disc(&material, [0.0, 1.0, 0.0], view, sun);
            // The plane of the field's sun ends at 2.
            let shown = want.min(65535.0 / 32768.0);
            let got = [traced, live].map(|way| f64::from(mean(&way(&plane(&material), &eye, options(1), sun))));
            assert!((got[0] / want - 1.0).abs() < 0.01, "{material:?} {off}: path-traced {} instead of {want}", got[0]);
            assert!((got[1] / shown - 1.0).abs() < 0.015, "{material:?} {off}: live {} instead of {shown}", got[1]);
        }
    }
}

#[test]
fn a_normal_map_leans_the_highlight() {
    let material = Appendix { base: 0.6, metallic: 1.0, roughness: 0.45 };
    let eye = camera([0.1, 0.8, 0.2], [0.0; 3], 0.1);
    for sun in [Vec3::new(0.3, 0.9, -0.2), Vec3::new(-0.5, 0.7, 0.1)] {
        let sun = sun.normalize();
        let [traced, live] = [traced, live].map(|way| mean(&way(&mapped(&material, 0.25), &eye, options(1), sun)));
        let level = over_the_disc(&material, [0.0, 1.0, 0.0], towards(&eye), sun) as f32;
        assert!((live / traced - 1.0).abs() < 0.02, "{live} live, {traced} path-traced");
        assert!((traced / level - 1.0).abs() > 0.1, "{traced} as on a level plane");
    }
}

#[test]
fn a_shadow_takes_the_highlight_too() {
    // The plate's shadow cuts the disc in half: both parts of the reflection halve.
    let material = Appendix { base: 0.6, metallic: 1.0, roughness: 0.6 };
    let plate = [[0.0, 9.0], [9.0, 9.0], [9.0, -9.0], [0.0, -9.0]].map(|[x, z]| Vec3::new(x, 5.0, z));
    let floor = crate::response::tests::floor(50.0, 0.0);
    let eye = camera([-0.4, 0.5, 0.2], [0.0; 3], 0.01);
    let whole = over_the_disc(&material, [0.0, 1.0, 0.0], towards(&eye), Vec3::Y) as f32;
    let shaded = finished(quads(&[(floor, 0.6), (plate, 0.6)]), &material);
    for way in [traced, live] {
        let got = mean(&way(&shaded, &eye, options(1), Vec3::Y));
        assert!((got / (0.5 * whole) - 1.0).abs() < 0.04, "{got} instead of {}", 0.5 * whole);
    }
}

#[test]
fn light_by_way_of_glossy_surfaces_is_the_same_both_ways() {
    let material = Appendix { base: 0.8, metallic: 0.0, roughness: 0.3 };
    let scene = finished(crate::response::tests::corner(0.8), &material);
    let eye = crate::response::tests::into_the_corner();
    let (sin, cos) = 35.0f32.to_radians().sin_cos();
    let sun = Vec3::new(0.0, sin, cos);
    let [traced, live] = [traced, live].map(|way| {
        let (all, direct) = (way(&scene, &eye, options(0), sun), way(&scene, &eye, options(1), sun));
        all.iter().zip(direct).map(|(all, direct)| all - direct).collect::<Vec<f32>>()
    });
    assert!((mean(&live) / mean(&traced) - 1.0).abs() < 0.015, "{} live, {} path-traced", mean(&live), mean(&traced));
    assert!(apart(&live, &traced) < 0.05, "{}", apart(&live, &traced));
}
