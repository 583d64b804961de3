//! The certified bound is never below the true error, whatever the light.

use relume_firmware::kernel::Kernel;
use relume_firmware::weights::{Apart, EXCESS_TIMES_MEAN, MAX_STANDOUTS, standouts};
use relume_tests::stressbound::{Examiner, TileFound};
use relume_tests::stressfield::Matter::{self, *};
use relume_tests::stressfield::StressField;
use relume_tests::stresslight::{self as light, Chance, PatchLight};
use std::sync::OnceLock;

const ALL: [Matter; 12] =
    [Street, OnePatch, Checkers, Black, NoBlue, OnlyRed, BlackRows, Decades, Dim, Holes, Empty, Street];

/// 4 x 3 tiles with a ragged edge, one of each kind.
fn zoo() -> &'static StressField {
    static ZOO: OnceLock<StressField> = OnceLock::new();
    ZOO.get_or_init(|| StressField::new(64, (61, 43), 0.004, &ALL, 1.0))
}

/// What a set of lights found.
#[derive(Default)]
struct Tally {
    lights: usize,
    /// Per light, largest bound over largest error of all tiles: linear and in codes.
    looseness: Vec<[f64; 2]>,
}

impl Tally {
    /// Examines all tiles under a light and holds the bound against the truth.
    fn add(&mut self, examiner: &mut Examiner<'_>, name: &str, given: &PatchLight, exposure: f32, apart: &[Apart]) {
        examiner.set(given, exposure, apart);
        let mut all = TileFound::default();
        for index in 0..examiner.field.response().tiles() {
            let found = examiner.tile(index, given, exposure);
            let share = found.share;
            let holds = share.plain <= 1.0 && share.weighted <= 1.0 && share.codes <= 1.0;
            assert!(holds, "{name}, tile {index}: {found:?}");
            if examiner.is_plain(index) {
                (all.bound, all.error) = (all.bound.max(found.bound), all.error.max(found.error));
            }
        }
        self.lights += 1;
        if all.error.plain > 0.0 {
            self.looseness.push([all.bound.plain / all.error.plain, all.bound.codes / all.error.codes]);
        }
    }

    fn report(mut self, name: &str) {
        let mut middle = |kind: usize| {
            self.looseness.sort_by(|a, b| a[kind].total_cmp(&b[kind]));
            self.looseness.get(self.looseness.len() / 2).map_or(1.0, |of| of[kind])
        };
        let (linear, codes) = (middle(0), middle(1));
        println!("looseness, {name}: {linear:.2} linear, {codes:.2} codes (median of {} lights)", self.lights);
    }
}

#[test]
fn each_patch_alone() {
    let mut examiner = Examiner::new(zoo());
    let (patches, mut tally) = (zoo().patches.len(), Tally::default());
    for patch in 0..patches {
        tally.add(&mut examiner, "alone", &light::alone(patches, patch, 1.0), 1.0, &[]);
        let alone = light::alone(patches, patch, 1.0);
        tally.add(&mut examiner, "alone, by its rows", &alone, 1.0, &light::whole(&alone, &[patch as u16]));
    }
    tally.report("each patch alone");
}

#[test]
fn skies_like_captured_ones_and_their_sums_over_twelve_decades() {
    let mut examiner = Examiner::new(zoo());
    let mut tally = Tally::default();
    for seed in 0..24 {
        let sky = light::captured(&zoo().patches, seed, 0.3);
        tally.add(&mut examiner, "captured", &sky, 1.0, &[]);
        let sum = light::both(&sky, &light::torch(&zoo().patches, seed + 100, 30.0));
        tally.add(&mut examiner, "sum", &sum, 0.5, &[]);
        for exposure in [1e-6f32, 1e-3, 1e6] {
            tally.add(&mut examiner, "level", &light::times(&sky, 1.0 / exposure), exposure, &[]);
            tally.add(&mut examiner, "far out", &sky, exposure, &[]);
        }
    }
    tally.report("captured skies");
}

#[test]
fn torches_through_the_factors_and_by_their_rows() {
    let mut examiner = Examiner::new(zoo());
    let mut tally = Tally::default();
    let mut found = 0;
    for seed in 0..12 {
        for times in [10.0, 1e3, 1e6] {
            let given = light::torch(&zoo().patches, seed, times);
            let bounds = examiner.field.bounds().unwrap();
            let mut bright = [Apart::default(); MAX_STANDOUTS];
            let count = standouts(&bounds, &given, EXCESS_TIMES_MEAN, Kernel::detect(), &mut bright);
            found += count.min(1);
            let all: Vec<u16> = (0..given.len() as u16).collect();
            for apart in [&[][..], &bright[..count], &light::whole(&given, &all)] {
                tally.add(&mut examiner, "torch", &given, 0.3 / times, apart);
                tally.add(&mut examiner, "torch", &given, 0.3, apart);
            }
        }
    }
    // Of 64 patches 31 modes make up a good part of any light: some torches are as expected as their sky.
    assert!(found >= 24, "only {found} torches stand out");
    tally.report("torches");
}

/// Light that only falls where a pixel's residual has one sign: no light does the bound more harm.
#[test]
fn lights_along_the_residual_of_a_pixel() {
    let mut examiner = Examiner::new(zoo());
    let (mut tally, mut chance) = (Tally::default(), Chance(7));
    for index in 0..examiner.field.response().tiles() {
        let pixels = examiner.field.response().tile(index).pixels();
        for _ in 0..3.min(pixels) {
            let residual = examiner.residual(index, chance.below(3 * pixels));
            for (sign, sized) in [(1.0, true), (-1.0, true), (1.0, false), (-1.0, false)] {
                tally.add(&mut examiner, "along a residual", &light::along(&residual, sign, sized), 1.0, &[]);
            }
        }
    }
    tally.report("along residuals");
}

#[test]
fn fewer_ranks_than_the_tile_has() {
    let mut examiner = Examiner::new(zoo());
    for max_rank in [0, 2, 6] {
        examiner.max_rank = max_rank;
        let mut tally = Tally::default();
        for seed in 0..6 {
            tally.add(&mut examiner, "few ranks", &light::captured(&zoo().patches, seed, 0.3), 1.0, &[]);
        }
        tally.report(&format!("{max_rank} ranks"));
    }
}

/// Random weights with most patches dark, and counts that sit right at the ends of what 16 bits hold.
#[test]
fn random_lights() {
    let mut examiner = Examiner::new(zoo());
    let (mut tally, mut chance) = (Tally::default(), Chance(3));
    for round in 0..100 {
        let lit = [0.05, 0.3, 1.0][round % 3];
        let power = [1.0, 4.0, 16.0][round / 3 % 3];
        let mut value = || if chance.unit() < lit { chance.unit().powf(power) * 2.0 } else { 0.0 };
        let given: PatchLight = (0..zoo().patches.len()).map(|_| [value(), value(), value()]).collect();
        tally.add(&mut examiner, "random", &given, 1.0, &[]);
    }
    tally.report("random lights");
}

/// Black tiles and empty ones show nothing that could be rounded: a bright neighbour in their block must not make their
/// bound larger than its own.
#[test]
fn black_and_empty_tiles_are_bound_no_worse_than_their_neighbours() {
    let stress = StressField::new(16, (48, 16), 0.004, &[Street, Black, Empty], 1.0);
    let (mut examiner, given) = (Examiner::new(&stress), light::captured(&stress.patches, 1, 1.0));
    examiner.set(&given, 1.0, &[]);
    let [street, black, empty] = [0, 1, 2].map(|index| examiner.tile(index, &given, 1.0).bound.plain);
    assert!(street > 0.0 && black <= street && empty == 0.0, "{street} {black} {empty}");
}

#[test]
fn few_and_many_patches_and_responses_of_any_size() {
    for (upper, scale) in [(16, 1.0), (16, 1e-6), (16, 1e6), (64, 1e-9), (256, 1.0)] {
        let stress =
            StressField::new(upper, (33, 17), 0.004, &[Street, Checkers, Empty, OnlyRed, Black, Decades], scale);
        let (mut examiner, mut tally) = (Examiner::new(&stress), Tally::default());
        for seed in 0..6 {
            let given = light::times(&light::captured(&stress.patches, seed, 0.3), 1.0 / scale);
            tally.add(&mut examiner, "any size", &given, 1.0, &[]);
            tally.add(&mut examiner, "any size, 0 apart", &given, 1.0, &light::whole(&given, &[0, 5]));
        }
        tally.report(&format!("{upper} patches, responses times {scale:e}"));
    }
}
