//! Light and sight through sheets that let some of it pass, blended and masked: closed forms of endless planes.

use super::*;
use crate::texture::{Texture, Wrap};

/// Reflectance of the floor and of the sheet over it.
const FLOOR: f32 = 0.6;
pub(crate) const SHEET: f32 = 0.8;
/// Height of the sheet, m.
pub(crate) const HEIGHT: f32 = 2.0;
/// The sheet's alpha, a whole number of the field's opacities.
pub(crate) const ALPHA: f32 = 102.0 / 255.0;

/// A floor and a sheet over it, both as good as endless.
pub(crate) fn covered_floor(alpha: Alpha, opacity: f32) -> Scene {
    let mut scene = quads(&[(floor(200.0, 0.0), FLOOR), (floor(200.0, HEIGHT), SHEET)]);
    scene.materials[1].alpha = alpha;
    scene.materials[1].base_color[3] = opacity;
    scene
}

/// The same with a masked sheet whose picture of `edge` x `edge` texels is opaque where `is_there` says so; it is repeated over
/// every `period` metres, its first corner over the origin.
pub(crate) fn cut_out(edge: usize, period: f32, wrap: Wrap, is_there: impl Fn(usize, usize) -> bool) -> Scene {
    let mut scene = covered_floor(Alpha::Mask { cutoff: 0.5 }, 1.0);
    let texel = |at: usize| [255, 255, 255, if is_there(at % edge, at / edge) { 255 } else { 0 }];
    scene.textures = vec![Texture::new(edge, edge, (0..edge * edge).map(texel).collect(), [wrap; 2]).unwrap()];
    scene.materials[1].texture = Some(0);
    for triangle in &mut scene.triangles {
        triangle.uvs = triangle.positions.map(|at| Vec2::new(at.x, at.z) / period);
    }
    scene
}

/// Looks down on the sheet, so narrowly that all pixels see the same points of sheet and floor.
pub(crate) fn from_above() -> Camera {
    camera([0.3, 5.0, 0.2], [0.0; 3], 0.1)
}

#[test]
fn a_blended_sheet_takes_its_share_of_every_patch() {
    let [bare, veiled] = [0.0, ALPHA].map(|opacity| covered_floor(Alpha::Blend, opacity));
    let [bare, veiled] = [bare, veiled].map(|scene| tile(&scene, &spot(), options(1)));
    for patch in 0..bare.patches {
        let [without, with] = [&bare, &veiled].map(|tile| mean(tile, &tile.response, patch));
        assert!((with - (1.0 - ALPHA) * without).abs() < 0.002 * without + 1e-6, "{patch}: {with} of {without}");
    }
    near(under_white_sky(&veiled, &veiled.response), FLOOR * (1.0 - ALPHA), 2e-3);
}

#[test]
fn light_goes_to_and_fro_between_floor_and_blended_sheet() {
    // The floor sees the sky's share and what the sheet throws back of the floor's own light.
    let scene = covered_floor(Alpha::Blend, ALPHA);
    let want = FLOOR * (1.0 - ALPHA) / (1.0 - ALPHA * SHEET * FLOOR);
    let found = tile(&scene, &spot(), options(0));
    near(under_white_sky(&found, &found.response), want, 0.01);
    // From above, the eye sees the lit sheet in its own share and the floor in the rest.
    let found = tile(&scene, &from_above(), options(0));
    near(under_white_sky(&found, &found.response), ALPHA * SHEET + (1.0 - ALPHA) * want, 0.02);
    assert!(found.coverage.iter().all(|&share| share == 1.0));
}

#[test]
fn what_is_seen_through_a_sheet_alone_is_not_covered() {
    let mut scene = covered_floor(Alpha::Blend, ALPHA);
    scene.triangles.retain(|triangle| triangle.material == 1);
    let found = tile(&scene, &from_above(), options(0));
    let coverage = found.coverage.iter().sum::<f32>() / found.coverage.len() as f32;
    near(coverage, ALPHA, 0.05);
    // Premultiplied: the covered pixels' mean is over those that hold any of it.
    let share = found.covered.len() as f32 / found.coverage.len() as f32;
    near(under_white_sky(&found, &found.response) * share, SHEET * coverage, 0.01);
}

#[test]
fn a_masked_edge_hides_the_sky_as_a_plate_does() {
    // There for x > 0: two texels, the border halfway.
    let scene = cut_out(2, 800.0, Wrap::Clamp, |x, _| x == 1);
    let half = |scene: &Scene| Scene {
        triangles: scene.triangles.iter().map(|t| Triangle { uvs: t.uvs.map(|uv| uv + 0.5), ..*t }).collect(),
        ..scene.clone()
    };
    let scene = half(&scene);
    for x in [-3.0f64, -1.0, 0.5, 2.0] {
        let eye = camera([x + 0.3, 0.5, 0.2], [x, 0.0, 0.0], 0.1);
        let found = tile(&scene, &eye, options(1));
        // A half plane that begins at the angle whose tangent is x / height from the zenith.
        let begins = (-x as f32).atan2(HEIGHT);
        let want = FLOOR * (1.0 - 0.5 * (1.0 - begins.sin()));
        near(under_white_sky(&found, &found.response), want, 0.01);
    }
}

#[test]
fn a_fine_checkerboard_takes_half_of_all_light() {
    // Squares of 5 cm, far smaller than the height.
    let scene = cut_out(2, 0.1, Wrap::Repeat, |x, y| (x + y) % 2 == 0);
    let found = tile(&scene, &spot(), options(1));
    near(under_white_sky(&found, &found.response), 0.5 * FLOOR, 0.01);
    // To and fro as between blended ones, were each half as opaque.
    let found = tile(&scene, &spot(), options(0));
    near(under_white_sky(&found, &found.response), 0.5 * FLOOR / (1.0 - 0.5 * SHEET * FLOOR), 0.015);
}

#[test]
fn two_sheets_multiply() {
    let mut scene = covered_floor(Alpha::Blend, ALPHA);
    let lower: Vec<_> = scene.triangles.iter().filter(|t| t.material == 1).copied().collect();
    let lowered = |t: &Triangle| Triangle { positions: t.positions.map(|p| p - Vec3::Y), ..*t };
    scene.triangles.extend(lower.iter().map(lowered));
    let found = tile(&scene, &spot(), options(1));
    near(under_white_sky(&found, &found.response), FLOOR * (1.0 - ALPHA).powi(2), 2e-3);
}
