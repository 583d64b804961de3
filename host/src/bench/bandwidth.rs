//! What this machine's memory delivers to one thread, measured in the same run as the methods.

use super::clock::cpu_s;

/// Largest buffer that is read, bytes.
const BUFFER_BYTES: usize = 1 << 30;
const PASSES: usize = 5;

/// Read bandwidth of one thread.
#[derive(Clone, Copy, Debug)]
pub struct Bandwidth {
    /// Bytes per second of CPU time, best of the passes.
    pub bytes_per_s: f64,
    /// Size of the buffer that was summed.
    pub buffer_bytes: usize,
}

/// Sums a buffer of 1 GiB, or of a quarter of the available memory where that is less, and takes the best pass.
pub fn read_bandwidth() -> Bandwidth {
    measure(BUFFER_BYTES.min(available_memory().unwrap_or(BUFFER_BYTES) / 4))
}

fn measure(bytes: usize) -> Bandwidth {
    let words = (bytes / 64).max(1) * 8;
    let buffer: Vec<u64> = (0..words as u64).collect();
    let mut best = f64::INFINITY;
    for _ in 0..PASSES {
        let start = cpu_s();
        std::hint::black_box(sum(std::hint::black_box(&buffer)));
        best = best.min(cpu_s() - start);
    }
    let buffer_bytes = words * size_of::<u64>();
    Bandwidth { bytes_per_s: buffer_bytes as f64 / best.max(1e-9), buffer_bytes }
}

/// Eight independent sums, so that no addition waits for another and only the reading is left.
fn sum(buffer: &[u64]) -> u64 {
    let mut lanes = [0u64; 8];
    for line in buffer.chunks_exact(8) {
        for (lane, value) in lanes.iter_mut().zip(line) {
            *lane = lane.wrapping_add(*value);
        }
    }
    lanes.iter().fold(0, |total, lane| total.wrapping_add(*lane))
}

/// Memory that can be taken without swapping, bytes; `None` where the system does not tell.
pub fn available_memory() -> Option<usize> {
    parse_available(&std::fs::read_to_string("/proc/meminfo").ok()?)
}

fn parse_available(meminfo: &str) -> Option<usize> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.split_whitespace().next()?.parse::<usize>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_every_word() {
        let buffer: Vec<u64> = (0..800).collect();
        assert_eq!(sum(&buffer), 800 * 799 / 2);
    }

    #[test]
    fn bandwidth_is_that_of_a_computer() {
        let found = measure(8 << 20);
        assert_eq!(found.buffer_bytes, 8 << 20);
        assert!(found.bytes_per_s > 1e8 && found.bytes_per_s < 1e13, "{found:?}");
    }

    #[test]
    fn meminfo_is_read_in_kib() {
        assert_eq!(parse_available("MemTotal: 9 kB\nMemAvailable:   2048 kB\n"), Some(2048 * 1024));
        assert_eq!(parse_available("MemTotal: 9 kB\n"), None);
    }
}
