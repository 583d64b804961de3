//! What the bench compares, and how: every method turns the same weights into the same kind of picture.

use std::sync::Arc;
use std::time::Instant;

use super::arena::Arena;
use super::clock::cpu_s;
use super::error::{Errors, compare};
use super::sample::Sample;
use crate::weights::PatchWeights;

/// One sky as the methods get it.
#[derive(Clone, Debug)]
pub struct BenchSky {
    /// Name for the report.
    pub name: String,
    /// Weights; without a sun where the comparison leaves it out.
    pub weights: PatchWeights,
    /// Exposure, the same for all methods.
    pub exposure: f32,
    /// The exact picture's covered pixels, if there is a stack.
    pub exact: Option<Vec<[f64; 3]>>,
}

impl BenchSky {
    /// Is the sun up in it, as compared?
    pub fn has_sun(&self) -> bool {
        self.weights.sun.is_some()
    }
}

/// What a method shows of its pixels, in row-major order.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Linear radiance, premultiplied, before exposure.
    pub radiance: Vec<[f32; 3]>,
    /// 8-bit sRGB codes at the sky's exposure, over black.
    pub codes: Vec<[u8; 3]>,
    /// No code is further from the exact picture's than this, as far as the sky's light goes; `None`: nothing is promised.
    pub bound_codes: Option<f32>,
}

/// A way to relight.
pub trait Method {
    /// Name for the report.
    fn name(&self) -> &'static str;
    /// The budget it works under, if it takes one.
    fn budget(&self) -> Option<String>;
    /// The pixels it works on; `None`: all covered ones.
    fn sample(&self) -> Option<&Sample> {
        None
    }
    /// Works on so many threads from now on.
    fn set_threads(&mut self, _threads: usize) {}
    /// Bytes that a full frame of its own pixels reads under a sky.
    fn bytes_read(&self, _sky: &BenchSky) -> usize {
        0
    }
    /// Untimed frames before the timed ones.
    ///
    /// # Errors
    /// If the weights are refused.
    fn warm_up(&mut self, skies: &[BenchSky]) -> anyhow::Result<()> {
        skies.iter().try_for_each(|sky| self.frame(sky))
    }
    /// One full frame, timed: weights to 8-bit codes in the method's own framebuffer, nothing kept from the frame before.
    ///
    /// # Errors
    /// If the weights are refused.
    fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()>;
    /// The pixels of a frame whose coefficients are known already, timed apart; `false`: there is no such thing here.
    fn redraw(&mut self) -> bool {
        false
    }
    /// The picture that [`Method::frame`] makes of this sky, for measuring its error.
    ///
    /// # Errors
    /// If the weights are refused.
    fn show(&mut self, sky: &BenchSky) -> anyhow::Result<Shown>;
    /// From now on every frame reads other numbers, out of `arena`; the pictures then mean nothing.
    ///
    /// # Errors
    /// When the arena is too small.
    fn go_beyond_caches(&mut self, _arena: &Arc<Arena>) -> anyhow::Result<()> {
        Ok(())
    }
}

/// Errors of a method under each sky that has an exact picture.
///
/// # Errors
/// If the method refuses a sky.
pub fn errors(method: &mut dyn Method, skies: &[BenchSky]) -> anyhow::Result<Vec<Errors>> {
    let mut all = Vec::new();
    for sky in skies {
        if let Some(exact) = &sky.exact {
            let shown = method.show(sky)?;
            let sampled: Option<Vec<[f64; 3]>> = method
                .sample()
                .filter(|sample| sample.indices.len() < exact.len())
                .map(|sample| sample.indices.iter().map(|&index| exact[index as usize]).collect());
            let exact = sampled.as_deref().unwrap_or(exact);
            let errors = compare(&shown.radiance, &shown.codes, exact, f64::from(sky.exposure));
            all.push(Errors { bound_codes: shown.bound_codes.map(f64::from), ..errors });
        }
    }
    Ok(all)
}

/// What the frames of one method took, seconds, in the order of the frames, scaled to all covered pixels.
#[derive(Clone, Debug, Default)]
pub struct Times {
    /// CPU time of all threads.
    pub cpu_s: Vec<f64>,
    /// Wall-clock time.
    pub wall_s: Vec<f64>,
    /// CPU time of frames whose coefficients were known.
    pub redraw_cpu_s: Vec<f64>,
    /// Had the frame a sun?
    pub has_sun: Vec<bool>,
}

/// Untimed frames before a timed one. A dense sum reads so much that the caches have settled only after two of them.
const UNTIMED: usize = 3;

/// How frames follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Before each timed frame the method makes [`UNTIMED`] ones under other skies, so that the caches hold what it left
    /// there itself and not what another method did.
    FrameAfterFrame,
    /// Nothing is left in the caches.
    Cold,
}

/// Times the methods. They take turns frame by frame in an order that changes with every round, as the sky does.
///
/// # Errors
/// If a method refuses a sky.
pub fn time(
    methods: &mut [Box<dyn Method + '_>],
    skies: &[BenchSky],
    rounds: usize,
    turn: Turn,
) -> anyhow::Result<Vec<Times>> {
    let mut times = vec![Times::default(); methods.len()];
    for method in methods.iter_mut() {
        method.warm_up(skies)?;
    }
    for (round, sky) in skies.iter().cycle().take(rounds).enumerate() {
        for index in order(methods.len(), round) {
            let (method, times) = (&mut methods[index], &mut times[index]);
            if turn == Turn::FrameAfterFrame {
                (1..=UNTIMED).rev().try_for_each(|ahead| method.frame(&skies[(round + ahead) % skies.len()]))?;
            }
            let scale = method.sample().map_or(1.0, |sample| sample.scale);
            let (start, wall) = (cpu_s(), Instant::now());
            method.frame(sky)?;
            times.cpu_s.push((cpu_s() - start) * scale);
            times.wall_s.push(wall.elapsed().as_secs_f64() * scale);
            times.has_sun.push(sky.has_sun());
            let start = cpu_s();
            if method.redraw() {
                times.redraw_cpu_s.push((cpu_s() - start) * scale);
            }
        }
    }
    Ok(times)
}

/// All of `0..count` once, in an order of the round's own.
fn order(count: usize, round: usize) -> impl Iterator<Item = usize> {
    let apart = |step: &usize| (2..=*step).all(|d| !(step.is_multiple_of(d) && count.is_multiple_of(d)));
    let steps: Vec<usize> = (1..count.max(2)).filter(apart).collect();
    let step = steps[round % steps.len()];
    (0..count).map(move |place| (place * step + round) % count)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::bench::error::srgb_code;

    /// The plainest method there is: the f64 sum, pixel by pixel.
    pub(crate) struct Naive {
        /// `[channel][pixel][patch]`.
        pub(crate) response: [Vec<Vec<f32>>; 3],
        /// Added to every value, to make an error of known size.
        pub(crate) offset: f64,
        pub(crate) frames: usize,
    }

    impl Naive {
        pub(crate) fn sum(&self, weights: &[[f32; 3]]) -> Vec<[f64; 3]> {
            let value = |c: usize, row: &Vec<f32>| -> f64 {
                row.iter().zip(weights).map(|(r, w)| f64::from(*r) * f64::from(w[c])).sum()
            };
            let pixels = self.response[0].len();
            (0..pixels).map(|p| [0, 1, 2].map(|c| value(c, &self.response[c][p]) + self.offset)).collect()
        }
    }

    impl Method for Naive {
        fn name(&self) -> &'static str {
            "naive_f64"
        }
        fn budget(&self) -> Option<String> {
            None
        }
        fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()> {
            self.frames += 1;
            std::hint::black_box(self.sum(&sky.weights.radiance));
            Ok(())
        }
        fn show(&mut self, sky: &BenchSky) -> anyhow::Result<Shown> {
            let sum = self.sum(&sky.weights.radiance);
            Ok(Shown {
                radiance: sum.iter().map(|p| p.map(|v| v as f32)).collect(),
                codes: sum.iter().map(|p| p.map(|v| srgb_code(v * f64::from(sky.exposure)))).collect(),
                bound_codes: None,
            })
        }
    }

    pub(crate) fn made_up(pixels: usize, patches: usize) -> Naive {
        let entry = |c: usize, p: usize, i: usize| ((c * 7 + p * 13 + i * 29) % 31) as f32 / 31.0;
        let channel = |c| (0..pixels).map(|p| (0..patches).map(|i| entry(c, p, i)).collect()).collect();
        Naive { response: [0, 1, 2].map(channel), offset: 0.0, frames: 0 }
    }

    pub(crate) fn sky(name: &str, patches: usize, naive: &Naive) -> BenchSky {
        let radiance: Vec<[f32; 3]> = (0..patches).map(|i| [0, 1, 2].map(|c| 0.1 + (i * (c + 2) % 5) as f32)).collect();
        let exact = naive.sum(&radiance);
        let exposure = crate::bench::error::exposure_for(&exact).unwrap() as f32;
        BenchSky { name: name.to_owned(), weights: PatchWeights { radiance, sun: None }, exposure, exact: Some(exact) }
    }

    #[test]
    fn a_constant_offset_is_found_again() {
        let mut naive = made_up(50, 16);
        let sky = sky("one", 16, &naive);
        assert!(errors(&mut naive, std::slice::from_ref(&sky)).unwrap()[0].rmse < 1e-7);
        naive.offset = 0.5;
        let exact = sky.exact.as_ref().unwrap();
        let mean = exact.iter().flatten().sum::<f64>() / 150.0;
        let found = errors(&mut naive, &[sky]).unwrap()[0];
        assert!((found.rmse - 0.5 / mean).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn orders_hold_every_method_once_and_differ() {
        for count in 1..20 {
            for round in 0..40 {
                let mut all: Vec<usize> = order(count, round).collect();
                all.sort_unstable();
                assert_eq!(all, (0..count).collect::<Vec<_>>());
            }
        }
        let behind = |round| {
            let all: Vec<usize> = order(14, round).collect();
            all[(all.iter().position(|&k| k == 3).unwrap() + 13) % 14]
        };
        assert!((1..6).any(|round| behind(round) != behind(0)));
    }

    #[test]
    fn every_method_draws_every_round() {
        let naive = made_up(4, 16);
        let skies = [sky("a", 16, &naive), sky("b", 16, &naive)];
        let mut methods: Vec<Box<dyn Method>> = vec![Box::new(naive), Box::new(made_up(4, 16))];
        let times = time(&mut methods, &skies, 5, Turn::FrameAfterFrame).unwrap();
        assert_eq!(times.len(), 2);
        for times in &times {
            assert_eq!((times.cpu_s.len(), times.wall_s.len(), times.redraw_cpu_s.len()), (5, 5, 0));
            assert!(times.cpu_s.iter().all(|t| t.is_finite() && *t >= 0.0));
        }
    }
}
