//! Draws against the f64 integral of appendix B.

use super::*;
use crate::appendix_b::Appendix;
use crate::strata::Grid;

fn lobe(material: &Appendix) -> Lobe {
    let (base, metallic) = (material.base as f32, material.metallic as f32);
    let f0 = 0.04 + (base - 0.04) * metallic;
    Lobe { alpha: (material.roughness as f32).powi(2), f0: [f0; 3], f90: 1.0, coat_f0: 0.04, coat_f90: 1.0 }
}

fn view(cosine: f32) -> Vec3A {
    let sine = (1.0 - cosine * cosine).sqrt();
    Vec3A::new(0.6 * sine, cosine, -0.8 * sine)
}

fn materials() -> impl Iterator<Item = Appendix> {
    let of = |metallic: f64| [0.1, 0.5, 1.0].map(|roughness| Appendix { base: 0.7, metallic, roughness });
    [0.0, 0.4, 1.0].into_iter().flat_map(of)
}

fn gloss(material: &Appendix, cosine: f32) -> (Gloss, Vec3A) {
    let albedo = Vec3A::splat((material.base * (1.0 - material.metallic)) as f32);
    (Gloss::new(lobe(material), albedo, view(cosine), Vec3A::Y, Vec3A::ZERO), albedo)
}

#[test]
fn the_brdf_is_the_appendix_s() {
    for material in materials() {
        for k in 0..200u32 {
            let share = |m: u32| (k.wrapping_mul(m) % 1013) as f32 / 1012.0;
            let (gloss, albedo) = gloss(&material, 0.02 + 0.97 * share(7));
            let light = cosine_direction(Vec3A::Y, Vec2::new(0.01 + 0.98 * share(11), 0.01 + 0.98 * share(13)));
            let double = |v: Vec3A| v.to_array().map(f64::from);
            let want = std::f64::consts::PI
                * material.brdf([0.0, 1.0, 0.0], double(gloss.view), double(light))
                * f64::from(light.y);
            let got = f64::from(gloss.sent_on(albedo * light.y, light, 1.0).x);
            assert!((got / want - 1.0).abs() < 2e-3, "{material:?} {k}: {got} instead of {want}");
        }
    }
}

#[test]
fn drawn_paths_bring_the_furnace_s_light() {
    let grid = Grid::new(1 << 16);
    for material in materials() {
        for cosine in [0.25f32, 0.9] {
            let (gloss, albedo) = gloss(&material, cosine);
            let mut sum = 0.0f64;
            for cell in 0..1 << 16 {
                let drawn = gloss.draw(Vec3A::Y, albedo, grid.point(cell, Vec2::splat(0.5)));
                let above = drawn.dir_world.y > 0.0;
                assert!((drawn.dir_world.length() - 1.0).abs() < 1e-3, "{drawn:?}");
                sum += if above { f64::from(drawn.weight.x) } else { 0.0 };
            }
            let got = sum / f64::from(1 << 16);
            let want = material.furnace(gloss.view.to_array().map(f64::from));
            assert!((got / want - 1.0).abs() < 5e-3, "{material:?} at {cosine}: {got} instead of {want}");
            let told = f64::from(gloss.reflectance.x);
            assert!((told / want - 1.0).abs() < 0.02, "{material:?} at {cosine}: told {told} instead of {want}");
        }
    }
}

#[test]
fn a_lobe_s_density_is_that_of_its_draws() {
    // In cells of height and azimuth, the share of draws against the density's integral.
    for roughness in [0.3, 0.8] {
        let material = Appendix { base: 0.7, metallic: 1.0, roughness };
        let (gloss, _) = gloss(&material, 0.6);
        let (rows, columns, draws) = (6usize, 8usize, 1u32 << 17);
        let place = |d: Vec3A| {
            let azimuth = (d.z.atan2(d.x) / std::f32::consts::TAU).rem_euclid(1.0);
            let row = ((d.y * rows as f32) as usize).min(rows - 1);
            row * columns + ((azimuth * columns as f32) as usize).min(columns - 1)
        };
        let mut found = vec![0.0f32; rows * columns];
        let grid = Grid::new(draws);
        for cell in 0..draws {
            let light = gloss.draw_from_lobe(grid.point(cell, Vec2::splat(0.5)));
            if light.y > 0.0 {
                found[place(light)] += 1.0 / draws as f32;
            }
        }
        let mut want = vec![0.0f32; rows * columns];
        let (fine, all) = (480, 480.0f32 * 640.0);
        for k in 0..fine * 640 {
            let (height, azimuth) =
                (((k / 640) as f32 + 0.5) / fine as f32, ((k % 640) as f32 + 0.5) / 640.0 * std::f32::consts::TAU);
            let radius = (1.0 - height * height).sqrt();
            let light = Vec3A::new(radius * azimuth.cos(), height, radius * azimuth.sin());
            let density = gloss.lobe.density(gloss.normal.to_array(), gloss.view.to_array(), light.to_array());
            want[place(light)] += density * std::f32::consts::TAU / all;
        }
        for (got, want) in found.iter().zip(&want) {
            assert!((got - want).abs() < 2e-3 + 0.02 * want, "roughness {roughness}: {got} instead of {want}");
        }
    }
}
