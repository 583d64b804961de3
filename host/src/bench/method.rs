//! What the bench compares, and how: every method turns the same weights into the same kind of picture.

use super::clock::{cpu_s, median};
use super::error::{Errors, compare};
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

/// What a method shows of the covered pixels, in row-major order.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Linear radiance, premultiplied, before exposure.
    pub radiance: Vec<[f32; 3]>,
    /// 8-bit sRGB codes at the sky's exposure, over black.
    pub codes: Vec<[u8; 3]>,
}

/// A way to relight.
pub trait Method {
    /// Name for the report.
    fn name(&self) -> &'static str;
    /// The budget it works under, if it takes one.
    fn budget(&self) -> Option<String>;
    /// One full frame, timed: weights to 8-bit codes in the method's own framebuffer, nothing kept from the frame before.
    ///
    /// # Errors
    /// If the weights are refused.
    fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()>;
    /// The picture that [`Method::frame`] makes of this sky, for measuring its error.
    ///
    /// # Errors
    /// If the weights are refused.
    fn show(&mut self, sky: &BenchSky) -> anyhow::Result<Shown>;
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
            all.push(compare(&shown.radiance, &shown.codes, exact, f64::from(sky.exposure)));
        }
    }
    Ok(all)
}

/// Median CPU time per frame of each method, seconds. The methods take turns frame by frame, the skies change with every
/// frame, and one round goes untimed.
///
/// # Errors
/// If a method refuses a sky.
pub fn time(methods: &mut [Box<dyn Method + '_>], skies: &[BenchSky], rounds: usize) -> anyhow::Result<Vec<f64>> {
    let mut times = vec![Vec::with_capacity(rounds); methods.len()];
    for (round, sky) in skies.iter().cycle().take(rounds + skies.len()).enumerate() {
        for (method, times) in methods.iter_mut().zip(&mut times) {
            let start = cpu_s();
            method.frame(sky)?;
            let took = cpu_s() - start;
            if round >= skies.len() {
                times.push(took);
            }
        }
    }
    Ok(times.iter().map(|times| median(times)).collect())
}

/// Median CPU time per frame of one method under one sky, seconds.
#[cfg(test)]
pub(crate) fn time_one(method: &mut dyn Method, sky: &BenchSky, rounds: usize) -> anyhow::Result<f64> {
    let mut times = Vec::new();
    for _ in 0..rounds {
        let start = cpu_s();
        method.frame(sky)?;
        times.push(cpu_s() - start);
    }
    Ok(median(&times))
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
    fn every_method_draws_every_round() {
        let naive = made_up(4, 16);
        let skies = [sky("a", 16, &naive), sky("b", 16, &naive)];
        let mut methods: Vec<Box<dyn Method>> = vec![Box::new(naive), Box::new(made_up(4, 16))];
        let times = time(&mut methods, &skies, 5).unwrap();
        assert_eq!(times.len(), 2);
        assert!(times.iter().all(|t| t.is_finite() && *t >= 0.0));
    }
}
