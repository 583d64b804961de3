//! What stands out of a sky is found by how much it does.

use relume_firmware::kernel::Kernel;
use relume_firmware::levels::{LEVELS, apart};
use relume_firmware::weights::{Apart, EXCESS_TIMES_MEAN, LightApart, MAX_STANDOUTS, MOST_STANDOUTS, standouts};
use relume_tests::stressfield::{Matter, StressField};
use relume_tests::stresslight::{self as light, Chance, PatchLight};

fn mean(light: &PatchLight) -> f32 {
    light.iter().map(|rgb| rgb.iter().fold(0.0f32, |most, v| most.max(*v))).sum::<f32>() / light.len() as f32
}

/// A sky that the field's prior makes up, but for what is added to it, gives back what was added: its patches and its size.
#[test]
fn what_was_added_to_an_expected_sky_is_found() {
    let stress = StressField::new(256, (16, 16), 0.004, &[Matter::Street], 1.0);
    let field = stress.field();
    let (bounds, patches) = (field.bounds().unwrap(), stress.patches.len());
    for seed in 0..40 {
        let mut chance = Chance(seed);
        let given = light::captured(&stress.patches, seed, 1.0);
        let mut sky = expected(&bounds, &given);
        let mut added: Vec<Apart> = vec![];
        for _ in 0..seed % 6 {
            let (patch, size) = (chance.below(patches), mean(&sky) * (12.0 + 200.0 * chance.unit()));
            if added.iter().all(|one| usize::from(one.patch) != patch) {
                added.push(Apart { patch: patch as u16, light: [size, 0.5 * size, 0.1 * size] });
                (0..3).for_each(|c| sky[patch][c] += added[added.len() - 1].light[c]);
            }
        }
        added.sort_unstable_by_key(|one| one.patch);
        let mut found = [Apart::default(); MAX_STANDOUTS];
        let count = standouts(&bounds, &sky, EXCESS_TIMES_MEAN, Kernel::detect(), &mut found);
        // What is small beside the largest may be taken for expected.
        let least = 1.5 * EXCESS_TIMES_MEAN * mean(&sky);
        for one in added.iter().filter(|one| one.light[0] > least) {
            let own = found[..count].iter().find(|own| own.patch == one.patch);
            let own = own.unwrap_or_else(|| panic!("sky {seed}: patch {} is not found", one.patch));
            for c in 0..3 {
                let error = (own.light[c] - one.light[c]).abs();
                assert!(
                    error <= 0.1 * one.light[0],
                    "sky {seed}, patch {}: {:?}, not {:?}",
                    one.patch,
                    own.light,
                    one.light
                );
            }
        }
        let is_added = |own: &Apart| added.iter().any(|one| one.patch == own.patch);
        assert!(found[..count].iter().all(is_added), "sky {seed}: {:?} was not added", &found[..count]);
    }
}

/// What the modes have of a light, patch by patch; light is not negative.
fn expected(bounds: &relume_firmware::bound::Bounds<'_>, given: &PatchLight) -> PatchLight {
    let parts: Vec<[f32; 3]> = (0..bounds.modes())
        .map(|k| {
            core::array::from_fn(|c| given.iter().enumerate().map(|(at, rgb)| bounds.mode_at(k, at) * rgb[c]).sum())
        })
        .collect();
    let patch = |patch: usize| {
        core::array::from_fn(|c| {
            parts.iter().enumerate().map(|(k, part)| part[c] * bounds.mode_at(k, patch)).sum::<f32>().max(0.0)
        })
    };
    (0..given.len()).map(patch).collect()
}

/// A bright cluster, which the modes are bent to: each patch of it is found, although its neighbours hide it.
#[test]
fn neighbours_that_hide_each_other_are_found() {
    let stress = StressField::new(256, (16, 16), 0.004, &[Matter::Street], 1.0);
    let field = stress.field();
    let bounds = field.bounds().unwrap();
    let (mut missing, mut all) = (0, 0);
    for seed in 0..20 {
        let given = light::captured(&stress.patches, seed, 1.0);
        let mut sky = expected(&bounds, &given);
        let centre = stress.patches.dir_world(Chance(seed).below(256));
        let away = |patch: usize| {
            let dot: f32 = stress.patches.dir_world(patch).iter().zip(centre).map(|(a, b)| a * b).sum();
            1.0 - dot
        };
        let mut cluster: Vec<usize> = (0..256).collect();
        cluster.sort_by(|&a, &b| away(a).total_cmp(&away(b)));
        for (rank, &patch) in cluster[..12].iter().enumerate() {
            sky[patch] = sky[patch].map(|v| v + 60.0 / (1.0 + rank as f32));
        }
        let mut found = [Apart::default(); MAX_STANDOUTS];
        let count = standouts(&bounds, &sky, EXCESS_TIMES_MEAN, Kernel::detect(), &mut found);
        missing +=
            cluster[..8].iter().filter(|&&p| found[..count].iter().all(|own| usize::from(own.patch) != p)).count();
        all += 8;
    }
    assert!(10 * missing <= all, "{missing} of {all} are not found");
}

#[test]
fn no_light_and_impossible_light_have_no_standouts() {
    let stress = StressField::new(256, (16, 16), 0.004, &[Matter::Street], 1.0);
    let field = stress.field();
    let (bounds, patches) = (field.bounds().unwrap(), stress.patches.len());
    let mut found = [Apart::default(); MAX_STANDOUTS];
    for value in [0.0, 1e-45, -1.0, f32::NAN, f32::INFINITY, f32::MAX] {
        let mut sky = vec![[value; 3]; patches];
        let _ = standouts(&bounds, &sky, EXCESS_TIMES_MEAN, Kernel::detect(), &mut found);
        sky[3] = [1.0; 3];
        let count = standouts(&bounds, &sky, EXCESS_TIMES_MEAN, Kernel::detect(), &mut found);
        assert!(
            found[..count].iter().all(|own| own.light.iter().all(|v| (0.0..=1.0).contains(v))),
            "{value}: {found:?}"
        );
    }
    let too_many = vec![[1.0; 3]; 2 * patches + 600];
    assert_eq!(standouts(&bounds, &too_many, EXCESS_TIMES_MEAN, Kernel::detect(), &mut found), 0);
    // Of one patch alone nothing is expected.
    for patch in 0..patches {
        let alone = light::alone(patches, patch, 3.0);
        let count = standouts(&bounds, &alone, EXCESS_TIMES_MEAN, Kernel::detect(), &mut found);
        assert_eq!((count, usize::from(found[0].patch)), (1, patch));
        assert!((found[0].light[1] - 3.0).abs() < 0.1, "{patch}: {found:?}");
    }
}

#[test]
fn the_highest_level_sets_all_light_apart_and_the_others_less() {
    let stress = StressField::new(256, (16, 16), 0.004, &[Matter::Street], 1.0);
    let sky = light::torch(&stress.patches, 3, 100.0);
    let mut most = 0;
    for level in 0..LEVELS {
        let mut room = [Apart::default(); MOST_STANDOUTS];
        match apart(level, &stress.field(), &sky, Kernel::detect(), &mut room) {
            LightApart::Some(some) if level < LEVELS - 1 => {
                assert!(some.len() > most, "level {level}: {} after {most}", some.len());
                most = some.len();
            }
            LightApart::All => assert_eq!(level, LEVELS - 1),
            LightApart::Some(some) => panic!("level {level}: only {some:?}"),
        }
    }
}
