//! Every path against the scalar one, over random and worst-case inputs, with guards around the outputs.

use super::*;
use crate::tone::srgb_code;

/// SplitMix64 (Steele, Lea, Flood 2014).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    pub(super) fn below(&mut self, n: u64) -> usize {
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
fn projections_are_the_exact_sums() {
    let mut random = Random(1);
    for round in 0..60 {
        let fill = FILLS[round % 4];
        let (stride, rank) = (16 * (1 + random.below(68)), random.below(129));
        let v: Vec<u8> = (0..stride * rank).map(|k| signed(fill, &mut random, k, 127) as i8 as u8).collect();
        // At most 2^24 in sum, as FixedWeights guarantees.
        let largest = ((1 << 24) / stride as i32).min(if round.is_multiple_of(3) { 32767 } else { 32639 });
        let mut weights: Vec<i16> = (0..stride).map(|k| signed(fill, &mut random, k, largest) as i16).collect();
        if (round / 4).is_multiple_of(2) {
            weights.iter_mut().for_each(|w| *w = w.abs());
        }
        let lit: Vec<u8> = (0..stride / 16).filter(|_| random.below(4) != 0).map(|b| b as u8).collect();
        let job = Projection { v: &v, weights: &weights, lit_blocks: &lit };
        let exact = |k: usize| -> i64 {
            let term = |i: usize| i64::from(v[k * stride + i] as i8) * i64::from(weights[i]);
            lit.iter().flat_map(|&block| usize::from(block) * 16..usize::from(block) * 16 + 16).map(term).sum()
        };
        let expected: Vec<i64> = [7].into_iter().chain((0..rank).map(exact)).chain([7]).collect();
        for kernel in Kernel::paths() {
            let mut found = vec![7; rank + 2];
            kernel.project(&job, &mut found[1..=rank]);
            let found: Vec<i64> = found.into_iter().map(i64::from).collect();
            assert_eq!(expected, found, "{} {fill:?} stride {stride} rank {rank}", kernel.name());
        }
    }
}

/// The largest sums there are: 2^24 counts on V of 127, in any arrangement, and as a step up and down.
#[test]
fn projections_at_their_bound_do_not_wrap() {
    let stride = crate::weights::MAX_PADDED;
    let lit: Vec<u8> = (0..stride / 16).map(|block| block as u8).collect();
    let even = ((1 << 24) / stride as i32) as i16;
    let most = |sign: i16| {
        (0..stride).map(move |k| {
            if k < 512 {
                sign * 32767
            } else if k == 512 {
                sign * 512
            } else {
                0
            }
        })
    };
    let arrangements: [Vec<i16>; 5] = [
        most(1).collect(),
        most(-1).collect(),
        most(1).rev().collect(),
        vec![even; stride],
        most(1).enumerate().map(|(k, w)| if k % 2 == 0 { w } else { -w }).collect(),
    ];
    for weights in arrangements {
        assert!(weights.iter().map(|w| i64::from(w.unsigned_abs())).sum::<i64>() <= crate::weights::MAX_SUM);
        let rows: [fn(i16) -> i8; 4] =
            [|_| 127, |_| -127, |w| if w < 0 { -127 } else { 127 }, |w| if w < 0 { 127 } else { -127 }];
        let v: Vec<u8> = rows.iter().flat_map(|row| weights.iter().map(|&w| row(w) as u8)).collect();
        let exact =
            |row: &[u8]| row.iter().zip(&weights).map(|(&v, &w)| i64::from(v as i8) * i64::from(w)).sum::<i64>();
        let expected: Vec<i64> = v.chunks_exact(stride).map(exact).collect();
        assert!(expected.iter().all(|sum| i32::try_from(*sum).is_ok()));
        for kernel in Kernel::paths() {
            let mut found = [0; 4];
            kernel.project(&Projection { v: &v, weights: &weights, lit_blocks: &lit }, &mut found);
            assert_eq!(found.map(i64::from).to_vec(), expected, "{}", kernel.name());
        }
    }
}

/// A job's storage.
struct Case {
    fill: Fill,
    pixels: usize,
    covered: usize,
    u: Vec<u8>,
    pairs: [Vec<i32>; 3],
    rows: Vec<u8>,
    unit: [f32; 3],
    response: Vec<u16>,
    weight: Option<[f32; 3]>,
    stride: usize,
}

impl Case {
    fn new(round: usize, random: &mut Random) -> Self {
        let fill = FILLS[round % 4];
        let (pixels, pairs) = (16 * (1 + random.below(16)), random.below(65));
        // Mostly light between 0 and 1, where the codes are; sometimes the ends of the range.
        let bits = (pairs as f32 * 2.0 + 1.0).log2() as i32 / 2 + 37;
        let largest_row =
            |random: &mut Random| if round.is_multiple_of(3) { 0xffff } else { random.below(65536) as u16 };
        // 32639 is the largest that two signed bytes hold.
        let largest_q = [32767, 32639, 300][round / 4 % 3];
        let pair = |random: &mut Random, k: usize| {
            let (a, b) = (signed(fill, random, 2 * k, largest_q), signed(fill, random, 2 * k + 1, largest_q));
            a & 0xffff | b << 16
        };
        Case {
            fill,
            pixels,
            covered: pixels - random.below(16),
            u: (0..pairs * pixels * 2).map(|k| signed(fill, random, k, 127) as i8 as u8).collect(),
            pairs: core::array::from_fn(|_| (0..pairs).map(|k| pair(random, k)).collect()),
            rows: (0..3 * pixels).flat_map(|_| largest_row(random).to_le_bytes()).collect(),
            unit: match round % 7 {
                0 => [UNIT_LIMIT, 0.0, 2f32.powi(-110)],
                _ => core::array::from_fn(|_| 2f32.powi(-bits - random.below(8) as i32) * 1.2345),
            },
            response: (0..3 * pixels).map(|_| largest_row(random)).collect(),
            weight: match round % 5 {
                0 | 2 => None,
                1 => Some([UNIT_LIMIT, 0.0, 1e-7]),
                _ => Some(core::array::from_fn(|_| 2f32.powi(-16 - random.below(6) as i32) * 1.1)),
            },
            stride: TILE_PX + random.below(3),
        }
    }

    fn job(&self) -> Reconstruction<'_> {
        Reconstruction {
            u: &self.u,
            pixels: self.pixels,
            covered: self.covered,
            pairs: self.pairs.each_ref().map(|pairs| &pairs[..]),
            rows: &self.rows,
            unit: self.unit,
            sun: self.weight.map(|weight| (&self.response[..], weight)),
        }
    }

    fn row(&self, c: usize, x: usize) -> f64 {
        let at = 2 * (c * self.pixels + x);
        f64::from(u16::from_le_bytes([self.rows[at], self.rows[at + 1]]))
    }

    /// The definition with an exact sum, and how far single precision may be from it.
    fn exact(&self, c: usize, x: usize) -> (f64, f64) {
        let mut sum = 0i128;
        for (j, &pair) in self.pairs[c].iter().enumerate() {
            let at = (j * self.pixels + x) * 2;
            sum += i128::from(self.u[at] as i8) * i128::from(pair as i16);
            sum += i128::from(self.u[at + 1] as i8) * i128::from((pair >> 16) as i16);
        }
        let at = c * self.pixels + x;
        let patches = sum as f64 * self.row(c, x) * f64::from(self.unit[c]);
        let sun = self.weight.map_or(0.0, |weight| f64::from(self.response[at]) * f64::from(weight[c]));
        (patches + sun, (patches.abs() + sun) * 2f64.powi(-22))
    }
}

/// What a path gave: planes and pixels with guards around them.
#[derive(Clone, Debug, PartialEq)]
struct Given {
    planes: [Vec<f32>; 3],
    shown: Vec<u32>,
    extent: Extent,
}

const GUARD: u32 = 0xdead_beef;

impl Given {
    /// Runs a path; `keeps`: planes are 0 not wanted, 1 written, 2 added to.
    fn by(kernel: Kernel, case: &Case, keeps: u8, shows: bool) -> Self {
        let n = case.pixels;
        let mut planes = [0, 1, 2].map(|c| vec![0.25 * c as f32 - 0.125; n + 16]);
        let mut shown = vec![GUARD; n / 16 * case.stride + 32];
        let mut inner = planes.each_mut().map(|plane| &mut plane[8..8 + n]);
        let linear = match keeps {
            0 => Linear::Skip,
            1 => Linear::Write(inner.each_mut().map(|plane| &mut **plane)),
            _ => Linear::Add(inner.each_mut().map(|plane| &mut **plane)),
        };
        let rows = (n / 16 - 1) * case.stride + 16;
        let target = Shown { pixels_xrgb: &mut shown[16..16 + rows], stride: case.stride };
        let extent = kernel.relight(&case.job(), linear, shows.then_some(target));
        Given { planes, shown, extent }
    }

    /// Equal bits, not only equal numbers.
    fn bits(&self) -> (Vec<u32>, &[u32], Extent) {
        (self.planes.iter().flatten().map(|v| v.to_bits()).collect(), &self.shown, self.extent)
    }
}

fn code(shown: u32, c: usize) -> f64 {
    f64::from(shown >> (16 - 8 * c) & 0xff)
}

#[test]
fn every_path_relights_to_the_same_bits() {
    let mut random = Random(2);
    for round in 0..150 {
        let case = Case::new(round, &mut random);
        for (keeps, shows) in [(0, false), (0, true), (1, false), (1, true), (2, false), (2, true)] {
            let expected = Given::by(Kernel::SCALAR, &case, keeps, shows);
            for kernel in Kernel::paths() {
                let found = Given::by(kernel, &case, keeps, shows);
                assert!(expected.bits() == found.bits(), "{} {:?} {keeps} {shows}", kernel.name(), case.fill);
            }
        }
    }
}

#[test]
fn relit_values_are_the_exact_sums_to_single_precision() {
    let mut random = Random(3);
    for round in 0..60 {
        let case = Case::new(round, &mut random);
        let n = case.pixels;
        let (new, added) = (Given::by(Kernel::detect(), &case, 1, true), Given::by(Kernel::detect(), &case, 2, true));
        let only_shown = Given::by(Kernel::detect(), &case, 0, true);
        assert_eq!((&only_shown.shown, only_shown.extent), (&new.shown, new.extent));
        for c in 0..3 {
            let before = 0.25 * c as f32 - 0.125;
            for x in 0..n {
                let (exact, allowed) = case.exact(c, x);
                let (value, sum) = (new.planes[c][8 + x], added.planes[c][8 + x]);
                assert!((f64::from(value) - exact).abs() <= allowed, "c {c} x {x}: {value} {exact}");
                assert_eq!(sum, before + value);
                let at = 16 + x / 16 * case.stride + x % 16;
                for (given, value) in [(&new, value), (&added, sum)] {
                    let curve = srgb_code(f64::from(value).clamp(0.0, 1.0));
                    assert!((code(given.shown[at], c) - curve).abs() <= 0.535, "c {c} x {x}: {value}");
                }
            }
            for given in [&new, &added] {
                let plane = &given.planes[c];
                let covered = &plane[8..8 + case.covered];
                let least = given.extent.smallest()[c];
                let inside = covered.iter().all(|&value| value >= least || least == 0.0 || value >= 1.0);
                let tight = |end: f32, by: f32| covered.iter().any(|&value| (end / by..=end * by).contains(&value));
                let low = covered.iter().any(|&value| value < 2f32.powi(-15));
                let high = covered.iter().any(|&value| value >= 1.0);
                let by = 1.0 + 1.0 / 4096.0;
                assert!(inside && (tight(least, by) || low && least < 2f32.powi(-15) || high && least > 0.999));
                let rows = (0..n).map(|x| case.row(c, x));
                let over_rows = plane[8..].iter().zip(rows).filter(|(_, row)| *row > 0.0);
                let exact =
                    over_rows.map(|(v, row)| f64::from(*v) / row * 65535.0).fold(f64::INFINITY, f64::min).max(0.0);
                let faintest = f64::from(given.extent.faintest()[c]);
                assert!(faintest <= exact && (faintest >= 0.87 * exact || exact > 1e30), "{faintest} {exact}");
                assert!(plane[..8].iter().chain(&plane[8 + n..]).all(|&guard| guard == before));
            }
        }
        let is_guard = |at: usize| at < 16 || (at - 16) / case.stride >= n / 16 || (at - 16) % case.stride >= 16;
        assert!(new.shown.iter().enumerate().all(|(at, &word)| (word == GUARD) == is_guard(at)));
    }
}

/// All ranks, all ends: the integer sum is the exact one, before single precision sees it.
#[test]
fn sums_of_the_most_ranks_do_not_wrap() {
    let pairs = crate::tile::MAX_RANK / 2;
    for (sign, odd) in [(1, 1), (-1, -1), (1, -1)] {
        let mut case = Case::new(1, &mut Random(5));
        case.pixels = 32;
        case.covered = 32;
        case.unit = [2f32.powi(-45); 3];
        case.weight = None;
        case.rows = [0xff; 6 * 32].to_vec();
        case.u = (0..pairs * 32).flat_map(|_| [127i8 as u8, (127 * odd) as i8 as u8]).collect();
        case.pairs = core::array::from_fn(|_| vec![(sign * 32767) & 0xffff | (sign * odd * 32767) << 16; pairs]);
        // Below 2^29.
        let sum = i64::from(sign) * 128 * 127 * 32767;
        let expected = sum as f32 * 65535.0 * 2f32.powi(-45);
        for kernel in Kernel::paths() {
            let found = Given::by(kernel, &case, 1, false);
            assert!(found.planes.iter().all(|plane| plane[8..40] == [expected; 32]), "{} {sign} {odd}", kernel.name());
        }
    }
}

#[test]
fn a_job_without_covered_pixels_has_an_empty_extent() {
    let mut case = Case::new(1, &mut Random(4));
    (case.pixels, case.covered) = (16, 0);
    case.rows.truncate(96);
    case.response.truncate(48);
    for kernel in Kernel::paths() {
        assert_eq!(Given::by(kernel, &case, 1, true).extent.smallest_log, Extent::EMPTY.smallest_log);
    }
}

#[test]
fn this_machine_runs_a_vector_path() {
    assert_ne!(Kernel::detect(), Kernel::SCALAR);
    assert!(Kernel::paths().any(|kernel| kernel == Kernel::detect()));
}

/// The system's own word on `sdot`, which a Cortex-A72 lacks.
#[cfg(target_arch = "aarch64")]
#[test]
#[allow(unsafe_code)]
fn sdot_is_chosen_only_where_the_system_names_it() {
    let auxv = std::fs::read("/proc/self/auxv").unwrap();
    let word = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap());
    let hwcap = auxv.chunks_exact(16).find(|pair| word(&pair[..8]) == 16).map_or(0, |pair| word(&pair[8..]));
    let name = if hwcap >> 20 & 1 == 1 { "neon-dot" } else { "neon" };
    // SAFETY: the system's capabilities.
    let told = unsafe { Kernel::of_hwcap(hwcap) };
    assert_eq!((Kernel::detect().name(), told.name()), (name, name));
}

#[test]
fn every_path_tones_every_logarithm_alike() {
    // Each float's upper 21 bits, both signs, infinities and NaN among them, with lower bits of all kinds.
    let all: Vec<f32> = (0..1u32 << 21).map(|k| f32::from_bits(k << 11 | k.wrapping_mul(0x9e37) & 0x7ff)).collect();
    let other: Vec<f32> = all.iter().rev().copied().collect();
    let light = crate::tone::ViewLight::new();
    let last: Vec<f32> = (0..all.len()).map(|k| light.linear(k as u8)).collect();
    let mut expected = vec![0; all.len()];
    Kernel::SCALAR.tone([&all, &other, &last], &mut expected);
    assert!(expected.iter().enumerate().all(|(k, &word)| word as u8 == k as u8));
    for kernel in Kernel::paths() {
        let mut found = vec![0; all.len()];
        kernel.tone([&all, &other, &last], &mut found);
        assert!(expected == found, "{}", kernel.name());
    }
}
