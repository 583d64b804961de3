//! This machine's kernel against the scalar one, without a test harness and its threads, which some emulators do not run.

use relume_firmware::kernel::{Kernel, Projection, RESIDUAL_LIMIT, Reconstruction, ResidualTerm};

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Within +-`largest`; every fourth round its extremes.
    fn signed(&mut self, round: usize, largest: i32) -> i32 {
        let bits = self.next();
        match round % 4 {
            0 => largest,
            1 if bits & 1 == 0 => -largest,
            1 => largest,
            _ => (bits % (2 * largest as u64 + 1)) as i32 - largest,
        }
    }

    fn bytes(&mut self, round: usize, n: usize) -> Vec<u8> {
        (0..n).map(|_| self.signed(round, 127) as i8 as u8).collect()
    }
}

fn planes(kernel: Kernel, n: usize, run: impl Fn(Kernel, [&mut [i32]; 3])) -> [Vec<i32>; 3] {
    let mut out = [0, 1, 2].map(|_| vec![5; n]);
    let [r, g, b] = &mut out;
    run(kernel, [r, g, b]);
    out
}

fn main() {
    let (fast, mut random) = (Kernel::detect(), Random(7));
    for round in 0..40 {
        let (n, pairs, stride) = (16 * (1 + round % 16), 1 + round % 64, 16 * (1 + round % 68));
        let v = random.bytes(round, stride * pairs);
        let largest = ((1 << 24) / stride as i32).min(32767);
        let weights: Vec<i16> = (0..stride).map(|_| random.signed(round, largest) as i16).collect();
        let lit: Vec<u8> = (0..stride / 16).filter(|b| (b + round) % 5 != 0).map(|b| b as u8).collect();
        let project = |kernel: Kernel| {
            let mut out = vec![9; pairs];
            kernel.project(&Projection { v: &v, weights: &weights, lit_blocks: &lit }, &mut out);
            out
        };
        assert_eq!(project(Kernel::SCALAR), project(fast), "projection, round {round}");
        let u = random.bytes(round, pairs * n * 2);
        let q: Vec<i32> =
            (0..pairs).map(|_| (random.signed(round, 32767) & 0xffff) | (random.signed(round, 32767) << 16)).collect();
        let rows: Vec<u8> = (0..6 * n).map(|_| random.next() as u8).collect();
        let plane: Vec<u16> = (0..3 * n).map(|_| random.next() as u16).collect();
        let sun = (round % 2 == 0).then_some((&plane[..], [(1 << 25) - 1, 77_777, 0]));
        let (right, left) = ([16, 20 + round as u32 % 13, 32], [round as u32 % 31, 0, 0]);
        let job = Reconstruction { u: &u, pixels: n, pairs: [&q, &q, &q], rows: &rows, right, left, sun };
        let sum = |kernel| planes(kernel, n, |kernel, out| kernel.reconstruct(&job, out));
        let linear = sum(fast);
        assert_eq!(sum(Kernel::SCALAR), linear, "reconstruction, round {round}");
        let factor = [random.signed(round, RESIDUAL_LIMIT), 1, -12_345];
        let term = ResidualTerm { codes: &u[..3 * n.min(u.len() / 48 * 16)], pixels: n.min(u.len() / 48 * 16), factor };
        let add = |kernel| planes(kernel, term.pixels, |kernel, out| kernel.add_residual(&term, out));
        assert_eq!(add(Kernel::SCALAR), add(fast), "residual, round {round}");
    }
    let values: Vec<i32> = (-64..(1 << 20) + 64).step_by(1).collect();
    let tone = |kernel: Kernel| {
        let mut out = vec![0; values.len()];
        kernel.tone([&values, &values, &values], &mut out);
        out
    };
    assert!(tone(Kernel::SCALAR) == tone(fast), "tone");
    println!("test result: ok. 4 passed; 0 failed; 0 ignored; {} equals scalar", fast.name());
}
