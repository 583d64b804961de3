//! A million incremental updates beside projections from scratch at the same scales, on every path of this machine.

use relume_firmware::coefficients::{Coefficients, project_channel};
use relume_firmware::kernel::{Kernel, Linear, Shown};
use relume_firmware::tile::{MAX_RANK, Tile};
use relume_firmware::weights::{FixedWeights, LightApart, Values, WeightStep};
use relume_tests::stressfield::{Matter, StressField};
use relume_tests::stresslight::{Chance, PatchLight, captured};

/// Updates; `RELUME_STRESS_STEPS` sets another number, as an emulator needs.
fn updates() -> usize {
    std::env::var("RELUME_STRESS_STEPS").ok().and_then(|steps| steps.parse().ok()).unwrap_or(1_000_000)
}

/// Pixels of the block: two rows of a tile.
const PIXELS: usize = 32;

/// A block's sums as one path carries them on.
struct Follower {
    kernel: Kernel,
    sums: Vec<i32>,
}

impl Follower {
    fn new(kernel: Kernel, tile: &Tile<'_>) -> Self {
        Follower { kernel, sums: vec![0; 3 * tile.v_rank()] }
    }

    fn add<'w>(&mut self, tile: &Tile<'_>, values: impl Fn(usize) -> Values<'w>) {
        let mut fresh = [0i32; MAX_RANK];
        for (c, sums) in self.sums.chunks_exact_mut(tile.v_rank()).enumerate() {
            project_channel(tile, c, values(c), self.kernel, &mut fresh[..sums.len()]);
            sums.iter_mut().zip(fresh).for_each(|(sum, fresh)| *sum += fresh);
        }
    }

    fn scratch(&mut self, tile: &Tile<'_>, weights: &FixedWeights) {
        self.sums.fill(0);
        self.add(tile, |c| weights.values(c));
    }

    /// Codes of the first tile's pixels.
    fn pixels(&self, tile: &Tile<'_>, weights: &FixedWeights) -> [u32; PIXELS] {
        let mut coefficients = Coefficients::ZERO;
        let sums = [0, 1, 2].map(|c| &self.sums[c * tile.v_rank()..(c + 1) * tile.v_rank()]);
        coefficients.set_sums(tile, sums, weights.exponent());
        let mut pixels = [0; PIXELS];
        let shown = Shown { pixels_xrgb: &mut pixels, stride: 16 };
        self.kernel.relight(&coefficients.job(tile, None), Linear::Skip, Some(shown));
        pixels
    }
}

/// The sky's next moment: mostly a few patches drift; at times all flicker about a power of two, or jump by 2^20.
fn next(sky: &mut PatchLight, level: &mut f32, first: &PatchLight, chance: &mut Chance, update: usize) {
    match update % 5000 {
        0 => sky.clone_from(first),
        1000 => *level *= (1 << 20) as f32,
        1010 => *level /= (1 << 20) as f32,
        2000..2100 => {
            let about = if update.is_multiple_of(2) { 0.9999 } else { 1.0001 };
            sky.iter_mut().for_each(|rgb| *rgb = [about * 32767.0 / 16384.0; 3]);
        }
        2100 => sky.clone_from(first),
        _ => {
            for _ in 0..2 {
                let patch = 1 + chance.below(sky.len() - 1);
                sky[patch] = sky[patch].map(|value| (value + 0.1 * (chance.unit() - 0.5)).clamp(0.0, 1.5));
            }
        }
    }
}

#[test]
fn a_million_updates_leave_no_byte_different() {
    let stress = StressField::new(16, (16, 2), 0.002, &[Matter::Checkers], 1.0);
    let field = stress.field();
    let tile = field.response().tile(0);
    let (mut weights, mut before) =
        (FixedWeights::dark(stress.patches.len()), FixedWeights::dark(stress.patches.len()));
    let (mut step, mut chance) = (WeightStep::NONE, Chance(11));
    let mut followers: Vec<Follower> = Kernel::paths().map(|kernel| Follower::new(kernel, &tile)).collect();
    let mut scratches: Vec<Follower> = Kernel::paths().map(|kernel| Follower::new(kernel, &tile)).collect();
    // The first patch is the brightest and stays, so that the scale does.
    let mut first = captured(&stress.patches, 1, 0.1);
    first[0] = [2.0; 3];
    let (mut sky, mut level, mut stepped, mut seen) = (first.clone(), 0.5f32, 0, std::collections::HashSet::new());
    for update in 0..updates() {
        next(&mut sky, &mut level, &first, &mut chance, update);
        before.clone_from(&weights);
        weights.set(&sky, None, level, LightApart::NONE).unwrap();
        let steps = step.set(&before, &weights);
        stepped += usize::from(steps);
        let scratch_at = update % scratches.len();
        let scratch = &mut scratches[scratch_at];
        scratch.scratch(&tile, &weights);
        let expected = scratch.pixels(&tile, &weights);
        for follower in &mut followers {
            if steps {
                follower.add(&tile, |c| step.values(c));
            } else {
                follower.scratch(&tile, &weights);
            }
            assert!(follower.sums == scratch.sums, "update {update}, {}", follower.kernel.name());
            assert_eq!(follower.pixels(&tile, &weights), expected, "update {update}, {}", follower.kernel.name());
        }
        seen.insert(expected[3]);
    }
    let paths: Vec<&str> = Kernel::paths().map(Kernel::name).collect();
    println!("{} updates, {stepped} of them steps, rank {}, {paths:?}: 0 bytes differ", updates(), tile.v_rank());
    assert!(stepped * 100 > updates() * 99 && seen.len() > 50, "{stepped} {}", seen.len());
}
