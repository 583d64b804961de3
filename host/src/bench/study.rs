//! The times of all methods under one condition, on one thread and on two.

use super::bandwidth::Bandwidth;
use super::clock::median;
use super::method::{BenchSky, Method, Times, Turn, time};
use super::report::{Section, Timing};

/// Numbers of threads that are tried.
pub const THREADS: [usize; 2] = [1, 2];

/// What every figure of a run is related to.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    /// Covered pixels of the picture.
    pub covered_px: usize,
    /// This run's read bandwidth.
    pub bandwidth: Bandwidth,
}

/// Times all methods into `section`, on one thread and then on two.
///
/// # Errors
/// If a method refuses a sky.
pub fn fill(
    section: &mut Section,
    methods: &mut [Box<dyn Method + '_>],
    skies: &[BenchSky],
    (rounds, turn): (usize, Turn),
    scale: Scale,
) -> anyhow::Result<()> {
    section.sun_included = skies.iter().any(BenchSky::has_sun);
    for threads in THREADS {
        methods.iter_mut().for_each(|method| method.set_threads(threads));
        let times = time(methods, skies, rounds, turn)?;
        let timings =
            methods.iter().zip(&times).map(|(method, times)| timing(method.as_ref(), threads, times, skies, scale));
        section.timings.extend(timings);
    }
    section.compare_with_dense();
    Ok(())
}

fn timing(method: &dyn Method, threads: usize, times: &Times, skies: &[BenchSky], scale: Scale) -> Timing {
    let (cpu_s, wall_s) = (median(&times.cpu_s), median(&times.wall_s));
    let only = |sun: bool| {
        let chosen = times.cpu_s.iter().zip(&times.has_sun).filter(|(_, has_sun)| **has_sun == sun);
        let chosen: Vec<f64> = chosen.map(|(took, _)| *took).collect();
        (!chosen.is_empty()).then(|| 1e3 * median(&chosen))
    };
    let sampled = method.sample().map_or(1.0, |sample| sample.scale);
    let bytes: usize = skies.iter().map(|sky| method.bytes_read(sky)).sum();
    let read = bytes as f64 / skies.len().max(1) as f64 * sampled;
    let bandwidth = match threads {
        1 => scale.bandwidth.one_thread_bytes_per_cpu_s,
        _ => scale.bandwidth.two_threads_bytes_per_cpu_s,
    };
    Timing {
        name: method.name().to_owned(),
        budget: method.budget(),
        threads,
        cpu_ms_per_frame: 1e3 * cpu_s,
        cpu_ms_per_frame_with_sun: only(true),
        cpu_ms_per_frame_without_sun: only(false),
        cpu_ms_per_frame_coefficients_reused: (!times.redraw_cpu_s.is_empty())
            .then(|| 1e3 * median(&times.redraw_cpu_s)),
        wall_ms_per_frame: 1e3 * wall_s,
        bytes_read_per_covered_pixel: read / scale.covered_px as f64,
        share_of_read_bandwidth: read / cpu_s / bandwidth,
        times_faster_than_dense_f32_openblas: None,
        times_faster_than_dense_f32_openblas_coefficients_reused: None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::method::tests::{Naive, made_up, sky};
    use super::*;
    use crate::weights::SunWeight;

    #[test]
    fn medians_and_shares_by_hand() {
        let times = Times {
            cpu_s: vec![0.001, 0.002, 0.004],
            wall_s: vec![0.001, 0.002, 0.003],
            redraw_cpu_s: vec![0.0005],
            has_sun: vec![false, true, true],
        };
        struct Reads(Naive);
        impl Method for Reads {
            fn name(&self) -> &'static str {
                "reads"
            }
            fn budget(&self) -> Option<String> {
                self.0.budget()
            }
            fn bytes_read(&self, sky: &BenchSky) -> usize {
                if sky.has_sun() { 4000 } else { 1000 }
            }
            fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()> {
                self.0.frame(sky)
            }
            fn show(&mut self, sky: &BenchSky) -> anyhow::Result<super::super::method::Shown> {
                self.0.show(sky)
            }
        }
        let bandwidth =
            Bandwidth { one_thread_bytes_per_cpu_s: 6e6, two_threads_bytes_per_cpu_s: 12e6, buffer_bytes: 1 };
        let scale = Scale { covered_px: 100, bandwidth };
        let reads = Reads(made_up(1, 16));
        let (without, mut with) = (sky("without", 16, &reads.0), sky("with", 16, &reads.0));
        with.weights.sun = Some(SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: [1.0; 3] });
        let skies = [without, with.clone(), with];
        let one = timing(&reads, 1, &times, &skies, scale);
        assert_eq!((one.cpu_ms_per_frame, one.wall_ms_per_frame), (2.0, 2.0));
        assert_eq!((one.cpu_ms_per_frame_with_sun, one.cpu_ms_per_frame_without_sun), (Some(3.0), Some(1.0)));
        assert_eq!(one.cpu_ms_per_frame_coefficients_reused, Some(0.5));
        assert!((one.bytes_read_per_covered_pixel - 30.0).abs() < 1e-9);
        assert!((one.share_of_read_bandwidth - 0.25).abs() < 1e-9);
        assert!((timing(&reads, 2, &times, &skies, scale).share_of_read_bandwidth - 0.125).abs() < 1e-9);
    }
}
