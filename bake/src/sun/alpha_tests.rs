//! Sunlight through sheets that let some of it pass: closed forms, on the stack's way and on the board's.

use std::f32::consts::PI;

use glam::Vec3;

use super::tests::{live, mean, traced};
use crate::response::tests::alpha::{ALPHA, HEIGHT, SHEET, covered_floor, cut_out, from_above};
use crate::response::tests::{camera, near, options, spot};
use crate::scene::Alpha;
use crate::texture::Wrap;

const FLOOR: f32 = 0.6;
/// Irradiance 1 on what faces it, 50 degrees up.
fn sun() -> Vec3 {
    let (sin, cos) = 50f32.to_radians().sin_cos();
    Vec3::new(0.6 * cos, sin, 0.8 * cos)
}

#[test]
fn a_blended_sheet_takes_its_share_of_the_sun() {
    let scene = covered_floor(Alpha::Blend, ALPHA);
    let full = sun().y / PI;
    for way in [traced, live] {
        near(mean(&way(&scene, &spot(), options(1), sun())), FLOOR * (1.0 - ALPHA) * full, 2e-3);
        // What the eye sees of the sheet is in full sun, and of the floor in the sheet's light shadow.
        let want = ALPHA * SHEET * full + (1.0 - ALPHA) * FLOOR * (1.0 - ALPHA) * full;
        near(mean(&way(&scene, &from_above(), options(1), sun())), want, 0.02);
        // To and fro, as skylight goes.
        let want = FLOOR * (1.0 - ALPHA) * full / (1.0 - ALPHA * SHEET * FLOOR);
        near(mean(&way(&scene, &spot(), options(0), sun())), want, 0.03);
    }
}

#[test]
fn the_sun_comes_through_the_holes_of_a_masked_sheet() {
    // Squares of 50 m, so that the live sun's pieces of the endless sheet resolve them; the first is a hole.
    let scene = cut_out(2, 100.0, Wrap::Repeat, |x, y| (x + y) % 2 == 1);
    let full = FLOOR * sun().y / PI;
    let towards = sun() * (HEIGHT / sun().y);
    for (square, want) in [([25.0, 25.0], full), ([75.0, 25.0], 0.0), ([-25.0, 25.0], 0.0), ([75.0, 75.0], full)] {
        // The floor that the sun looks at through the middle of the square.
        let [x, z] = [square[0] - towards.x, square[1] - towards.z].map(f64::from);
        let eye = camera([x + 0.3, 0.5, z + 0.2], [x, 0.0, z], 0.1);
        for way in [traced, live] {
            let found = mean(&way(&scene, &eye, options(1), sun()));
            assert!((found - want).abs() < 2e-3 * full, "{square:?}: {found} instead of {want}");
        }
    }
}
