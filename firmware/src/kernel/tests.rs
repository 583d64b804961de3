//! Every path against the scalar one, over random and worst-case inputs, with guards around the outputs.

use super::*;

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn below(&mut self, n: u64) -> usize {
        (self.next() % n) as usize
    }
}

#[derive(Clone, Copy, Debug)]
enum Fill {
    Random,
    Largest,
    Alternating,
    Zero,
}

const FILLS: [Fill; 4] = [Fill::Random, Fill::Largest, Fill::Alternating, Fill::Zero];

fn signed(fill: Fill, random: &mut Random, at: usize, largest: i32) -> i32 {
    match fill {
        Fill::Random => random.below(2 * largest as u64 + 1) as i32 - largest,
        Fill::Largest => largest,
        Fill::Alternating => {
            if at.is_multiple_of(2) {
                largest
            } else {
                -largest
            }
        }
        Fill::Zero => 0,
    }
}

#[test]
fn projection_equals_scalar() {
    let (fast, mut random) = (Kernel::detect(), Random(1));
    for round in 0..60 {
        let fill = FILLS[round % 4];
        let (stride, rank) = (16 * (1 + random.below(68)), random.below(129));
        let v: Vec<u8> = (0..stride * rank).map(|k| signed(fill, &mut random, k, 127) as i8 as u8).collect();
        // At most 2^24 in sum, as FixedWeights guarantees.
        let largest = ((1 << 24) / stride as i32).min(32767);
        let weights: Vec<i16> = (0..stride).map(|k| signed(fill, &mut random, k, largest) as i16).collect();
        let lit: Vec<u8> = (0..stride / 16).filter(|_| random.below(4) != 0).map(|b| b as u8).collect();
        let job = Projection { v: &v, weights: &weights, lit_blocks: &lit };
        let (mut expected, mut found) = (vec![7; rank + 2], vec![7; rank + 2]);
        Kernel::SCALAR.project(&job, &mut expected[1..=rank]);
        fast.project(&job, &mut found[1..=rank]);
        assert_eq!(expected, found, "{} {fill:?} stride {stride} rank {rank}", fast.name());
        let exact = |k: usize| -> i64 {
            let term = |i: usize| i64::from(v[k * stride + i] as i8) * i64::from(weights[i]);
            lit.iter().flat_map(|&block| usize::from(block) * 16..usize::from(block) * 16 + 16).map(term).sum()
        };
        assert!((0..rank).all(|k| i64::from(found[k + 1]) == exact(k)), "an i32 lane overflowed");
    }
}

#[test]
fn reconstruction_equals_scalar_and_an_i64_sum() {
    let (fast, mut random) = (Kernel::detect(), Random(2));
    for round in 0..120 {
        let fill = FILLS[round % 4];
        let (n, pairs) = (16 * (1 + random.below(16)), random.below(65));
        let u: Vec<u8> = (0..pairs * n * 2).map(|k| signed(fill, &mut random, k, 127) as i8 as u8).collect();
        let pair = |random: &mut Random, k: usize| {
            let (a, b) = (signed(fill, random, 2 * k, 32767), signed(fill, random, 2 * k + 1, 32767));
            a & 0xffff | b << 16
        };
        let q: [Vec<i32>; 3] = core::array::from_fn(|_| (0..pairs).map(|k| pair(&mut random, k)).collect());
        let row = |random: &mut Random| if round % 3 == 0 { 0xffff } else { random.below(65536) as u16 };
        let rows: Vec<u8> = (0..3 * n).flat_map(|_| row(&mut random).to_le_bytes()).collect();
        let plane: Vec<u16> = (0..3 * n).map(|_| row(&mut random)).collect();
        let right = core::array::from_fn(|_| 16 + random.below(17) as u32);
        let left = core::array::from_fn(|_| if round % 5 == 0 { random.below(31) as u32 } else { 0 });
        let sun = (round % 2 == 0)
            .then(|| (&plane[..], core::array::from_fn(|_| crate::weights::MAX_SUN_Q16 >> random.below(20) as u32)));
        let job =
            Reconstruction { u: &u, pixels: n, pairs: q.each_ref().map(|q| &q[..]), rows: &rows, right, left, sun };
        let mut expected = vec![vec![-1; n + 16]; 3];
        let mut found = expected.clone();
        for (kernel, out) in [(Kernel::SCALAR, &mut expected), (fast, &mut found)] {
            let [r, g, b] = &mut out[..] else { unreachable!() };
            kernel.reconstruct(&job, [&mut r[8..8 + n], &mut g[8..8 + n], &mut b[8..8 + n]]);
        }
        assert_eq!(expected, found, "{} {fill:?} n {n} pairs {pairs}", fast.name());
        for (c, plane) in found.iter().enumerate() {
            assert!(plane[..8].iter().chain(&plane[8 + n..]).all(|&guard| guard == -1));
            for x in 0..n {
                assert_eq!(i64::from(plane[8 + x]), exact(&job, c, x), "c {c} x {x}");
            }
        }
    }
}

/// The definition in i128, without any of the kernels' bounds.
fn exact(job: &Reconstruction<'_>, c: usize, x: usize) -> i64 {
    let mut sum = 0i128;
    for (j, &pair) in job.pairs[c].iter().enumerate() {
        let at = (j * job.pixels + x) * 2;
        sum += i128::from(job.u[at] as i8) * i128::from(pair as i16);
        sum += i128::from(job.u[at + 1] as i8) * i128::from((pair >> 16) as i16);
    }
    let at = 2 * (c * job.pixels + x);
    let row = i128::from(u16::from_le_bytes([job.rows[at], job.rows[at + 1]]));
    let half = 1i128 << (job.right[c] - 1);
    let limit = i128::from(LINEAR_LIMIT >> job.left[c]);
    let value = ((sum * row + half) >> job.right[c]).clamp(-limit, limit) << job.left[c];
    let sun = job.sun.map_or(0, |(plane, weight)| {
        (i128::from(plane[c * job.pixels + x]) * i128::from(weight[c]) + (1 << (SUN_SHIFT - 1))) >> SUN_SHIFT
    });
    (value + sun) as i64
}

#[test]
fn this_machine_runs_a_vector_path() {
    assert_ne!(Kernel::detect(), Kernel::SCALAR);
}

#[test]
fn residuals_equal_scalar_and_their_definition() {
    let (fast, mut random) = (Kernel::detect(), Random(3));
    for round in 0..100 {
        let fill = FILLS[round % 4];
        let n = 16 * (1 + random.below(16));
        let codes: Vec<u8> = (0..3 * n).map(|k| signed(fill, &mut random, k, 127) as i8 as u8).collect();
        let factor = core::array::from_fn(|c| signed(fill, &mut random, c, RESIDUAL_LIMIT));
        let before = (1 << 30) - 1 + LINEAR_LIMIT;
        let term = ResidualTerm { codes: &codes, pixels: n, factor };
        let mut found = [Kernel::SCALAR, fast].map(|kernel| {
            let mut out = vec![vec![before; n + 16]; 3];
            let [r, g, b] = &mut out[..] else { unreachable!() };
            kernel.add_residual(&term, [&mut r[8..8 + n], &mut g[8..8 + n], &mut b[8..8 + n]]);
            out
        });
        assert_eq!(found[0], found[1], "{} {fill:?} n {n}", fast.name());
        for (c, plane) in found[1].iter_mut().enumerate() {
            for x in 0..n {
                let exact = f64::from(codes[c * n + x] as i8) * f64::from(factor[c]) / 256.0;
                assert!((f64::from(plane[8 + x]) - f64::from(before) - exact).abs() <= 0.5);
            }
            assert!(plane[..8].iter().chain(&plane[8 + n..]).all(|&guard| guard == before));
        }
    }
}

#[test]
fn tone_equals_scalar_at_every_value() {
    let fast = Kernel::detect();
    let values: Vec<i32> = (-64..(1 << 20) + 64).collect();
    let other: Vec<i32> = values.iter().map(|v| v.wrapping_mul(-77_777_777)).collect();
    let last: Vec<i32> = values.iter().rev().copied().collect();
    let [expected, found] = [Kernel::SCALAR, fast].map(|kernel| {
        let mut out = vec![0; values.len()];
        kernel.tone([&values, &other, &last], &mut out);
        out
    });
    assert!(expected == found);
}
