//! CPU time of this process: what a frame costs a board, whatever else the machine does meanwhile.

use rustix::time::{ClockId, clock_gettime};

/// CPU time used so far by all threads of this process, seconds.
///
/// The process clock and not the thread's: a method that hands its work to a thread of its own must not look free.
pub fn cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Median of the values (mean of the middle two for an even count); NaN for none.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_moves_the_clock_and_never_backwards() {
        let (wall, start) = (std::time::Instant::now(), cpu_s());
        let (mut x, mut last) = (1u64, start);
        while last - start < 0.01 {
            x = std::hint::black_box(x.wrapping_mul(3));
            let now = cpu_s();
            assert!(now >= last);
            last = now;
            assert!(wall.elapsed().as_secs() < 20, "10 ms of work were not counted");
        }
    }

    #[test]
    fn medians_by_hand() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
    }
}
