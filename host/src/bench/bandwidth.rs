//! What this machine's memory delivers to one thread and to two, measured in the same run as the methods.

use super::arena::Arena;
use super::clock::cpu_s;

/// Least buffer that is read, bytes, where there is room.
const BUFFER_BYTES: usize = 1 << 30;
const PASSES: usize = 5;

/// Read bandwidth.
#[derive(Clone, Copy, Debug)]
pub struct Bandwidth {
    /// Bytes per second of CPU time of one thread, best of the passes.
    pub one_thread_bytes_per_cpu_s: f64,
    /// The same of two threads at once: by the CPU time of both, so that other programs do not count.
    pub two_threads_bytes_per_cpu_s: f64,
    /// Size of the buffer that was summed.
    pub buffer_bytes: usize,
}

/// Sums a buffer of 1 GiB, or of four times the last-level cache where that is more, or of a quarter of the available
/// memory where that is less.
pub fn read_bandwidth(last_level_cache_bytes: usize) -> std::io::Result<Bandwidth> {
    let wanted = BUFFER_BYTES.max(last_level_cache_bytes.saturating_mul(4));
    measure(wanted.min(available_memory().unwrap_or(wanted) / 4))
}

fn measure(bytes: usize) -> std::io::Result<Bandwidth> {
    let bytes = (bytes / 128).max(1) * 128;
    let mut arena = Arena::zeros(bytes)?;
    arena.fill_made_up();
    let words: &[u64] = bytemuck::cast_slice(&arena.bytes()[..bytes]);
    let (mut one, mut two) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..PASSES {
        let start = cpu_s();
        std::hint::black_box(sum(std::hint::black_box(words)));
        one = one.min(cpu_s() - start);
        let (start, (low, high)) = (cpu_s(), words.split_at(words.len() / 2));
        std::thread::scope(|scope| {
            let other = scope.spawn(|| sum(std::hint::black_box(low)));
            std::hint::black_box((sum(std::hint::black_box(high)), other.join().ok()));
        });
        two = two.min(cpu_s() - start);
    }
    let per_s = |seconds: f64| bytes as f64 / seconds.max(1e-9);
    Ok(Bandwidth {
        one_thread_bytes_per_cpu_s: per_s(one),
        two_threads_bytes_per_cpu_s: per_s(two),
        buffer_bytes: bytes,
    })
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
        let found = measure(8 << 20).unwrap();
        assert_eq!(found.buffer_bytes, 8 << 20);
        for rate in [found.one_thread_bytes_per_cpu_s, found.two_threads_bytes_per_cpu_s] {
            assert!(rate > 1e8 && rate < 1e13, "{found:?}");
        }
    }

    #[test]
    fn meminfo_is_read_in_kib() {
        assert_eq!(parse_available("MemTotal: 9 kB\nMemAvailable:   2048 kB\n"), Some(2048 * 1024));
        assert_eq!(parse_available("MemTotal: 9 kB\n"), None);
    }
}
