//! What a kept tile may have changed by is never below the truth: sky, sun and both.

use relume_firmware::bound::{BoundLight, CodeSlope};
use relume_firmware::coefficients::{Coefficients, TileReach};
use relume_firmware::drawn::{Dimmest, DrawnTile, Off, ShownLight, SunDrift, dark_shares};
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::relight::{LinearTile, TileLight};
use relume_firmware::tone::srgb_code;
use relume_firmware::weights::{FixedWeights, LightApart, SunWeight};
use relume_tests::stressfield::Matter::*;
use relume_tests::stressfield::StressField;
use relume_tests::stresslight::{self as light, Chance, PatchLight};

/// A light with all that belongs to one tile under it.
struct Moment {
    weights: FixedWeights,
    coefficients: Coefficients,
    bound: [[f32; 3]; 2],
    plane: Vec<u16>,
}

impl Moment {
    fn new(field: &Field<'_>, index: usize, given: &PatchLight, sun: f32, plane: Vec<u16>) -> Self {
        let tile = field.response().tile(index);
        let mut weights = FixedWeights::dark(given.len());
        let sun = SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: [sun, 0.9 * sun, 0.7 * sun] };
        weights.set(given, Some(&sun), 0.5, LightApart::NONE).unwrap();
        let (mut coefficients, mut bound_light) = (Coefficients::ZERO, BoundLight::DARK);
        coefficients.project(&tile, &weights, Kernel::detect(), usize::MAX);
        let bounds = field.bounds().unwrap();
        bounds.light(&weights, Kernel::SCALAR, &mut bound_light);
        let bound = bounds.block(field.response().block_of(index), &bound_light, Kernel::SCALAR);
        Moment { weights, coefficients, bound, plane }
    }

    fn shown(&self) -> ShownLight<'_> {
        let sun_q16 = self.weights.sun_q16();
        ShownLight { coefficients: &self.coefficients, weights: &self.weights, unpacked: &[], sun_q16 }
    }

    fn draw(&self, field: &Field<'_>, index: usize, linear: &mut LinearTile) -> Dimmest {
        let light =
            TileLight { sun: Some((&self.plane, self.weights.sun_q16())), weights: &self.weights, unpacked: &[] };
        let extent = self.coefficients.pixels(field, &field.response().tile(index), &light, Kernel::detect(), linear);
        Dimmest::of_extent(extent)
    }
}

/// Holds the bound on the change of one tile against its pixels; the bound over the truth, where that is visible.
fn hold(field: &Field<'_>, index: usize, before: &Moment, after: &Moment) -> Option<f32> {
    let tile = field.response().tile(index);
    let (mut old, mut new) = (LinearTile::new(), LinearTile::new());
    let mut drawn = DrawnTile::NOTHING;
    drawn.set(&before.shown(), before.draw(field, index, &mut old));
    after.draw(field, index, &mut new);
    let own = tile.plane_at..tile.plane_at + 3 * tile.padded_pixels();
    let values = before.plane[own.clone()].iter().zip(&after.plane[own]);
    let mut drift = SunDrift::default();
    let moved = values.clone().map(|(a, b)| u32::from(a.abs_diff(*b))).max().unwrap_or(0);
    drift.retraced(moved, values.map(|(a, b)| u32::from(*a.max(b))).max().unwrap_or(0));
    let mut reach = vec![0.0; TileReach::len_of(&tile)];
    TileReach::measure(&tile, &mut reach);
    let mut truth = 0.0f64;
    for (old, new) in (0..tile.pixels()).flat_map(|x| old.rgb(x).into_iter().zip(new.rgb(x))) {
        let code = |light: f32| srgb_code(f64::from(light).clamp(0.0, 1.0));
        truth = truth.max((code(new) - code(old)).abs());
    }
    let mut looseness = None;
    for reach in [&reach[..], &[]] {
        let since = (&TileReach(reach), &drift);
        let error = Off::of((field, &tile), &after.shown(), (&after.coefficients, &after.bound));
        let off = drawn.moved((field, &tile), &after.shown(), since, &error);
        let bound = drawn.dimmest().codes(&CodeSlope::new(), &dark_shares(&tile), &off);
        assert!(f64::from(bound) * 1.0001 + 1e-3 >= truth, "tile {index}: {bound} is below {truth}; {off:?}");
        looseness.get_or_insert(bound / truth as f32);
    }
    looseness.filter(|_| truth > 0.1)
}

#[test]
fn a_kept_tile_changes_no_more_than_its_bound_says() {
    let stress =
        StressField::new(64, (61, 43), 0.004, &[Street, Checkers, BlackRows, Dim, Holes, OnlyRed, Street], 1.0);
    let field = stress.field();
    let mut chance = Chance(7);
    let mut all: [Vec<f32>; 4] = Default::default();
    for round in 0..160 {
        let kind = round as usize % 4;
        let sky = light::captured(&stress.patches, round, 0.3);
        let share = 0.5f32.powi(chance.below(9) as i32);
        let other = match chance.below(3) {
            0 => light::times(&sky, 1.0 + share),
            1 => light::captured(&stress.patches, round + 1000, 0.4),
            _ => light::torch(&stress.patches, round, 2.0),
        };
        let mix = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| a[c] + share * (b[c] - a[c]));
        let mixed: PatchLight = sky.iter().zip(&other).map(mix).collect();
        let suns = [(0.0, 0.0), (3.0, 3.0 * (1.0 - share)), (2.0 * (1.0 - share), 2.0), (2.0, 2.0)][kind];
        let most = 1 + chance.below(20_000);
        let plane: Vec<u16> = (0..field.response().plane_len())
            .map(|_| if chance.below(3) == 0 { chance.below(most / 50 + 1) } else { chance.below(most) } as u16)
            .collect();
        let moved = plane.iter().map(|&v| if kind == 3 { v.saturating_add(chance.below(40) as u16) } else { v });
        let moved: Vec<u16> = moved.collect();
        for index in 0..field.response().tiles() {
            let before = Moment::new(&field, index, &sky, suns.0, plane.clone());
            let after = Moment::new(&field, index, &mixed, suns.1, moved.clone());
            all[kind].extend(hold(&field, index, &before, &after));
        }
    }
    for (name, mut own) in ["sky", "sun falls", "sun rises", "sun moves"].into_iter().zip(all) {
        own.sort_by(f32::total_cmp);
        println!("looseness of changes, {name}: {:.2} (median of {} tiles)", own[own.len() / 2], own.len());
    }
}
