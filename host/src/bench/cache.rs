//! The size of the last-level cache.

use std::path::Path;

/// Where Linux tells about the caches of the first processor.
const CACHES: &str = "/sys/devices/system/cpu/cpu0/cache";

/// Size of the largest cache, bytes; `None` where the system does not tell.
pub fn last_level_bytes() -> Option<usize> {
    largest(Path::new(CACHES))
}

fn largest(caches: &Path) -> Option<usize> {
    let entries = std::fs::read_dir(caches).ok()?.flatten();
    let sizes = entries.filter_map(|entry| parse_size(&std::fs::read_to_string(entry.path().join("size")).ok()?));
    sizes.max()
}

/// `32K`, `8M` or plain bytes.
fn parse_size(text: &str) -> Option<usize> {
    let text = text.trim();
    let (digits, unit) = match text.strip_suffix(['K', 'M']) {
        Some(digits) if text.ends_with('K') => (digits, 1 << 10),
        Some(digits) => (digits, 1 << 20),
        None => (text, 1),
    };
    digits.parse::<usize>().ok()?.checked_mul(unit).filter(|&bytes| bytes > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_linux_writes_them() {
        assert_eq!(parse_size("491520K\n"), Some(491_520 << 10));
        assert_eq!(parse_size("8M"), Some(8 << 20));
        assert_eq!(parse_size("4096"), Some(4096));
        assert_eq!((parse_size("0K"), parse_size("many")), (None, None));
    }

    #[test]
    fn the_largest_counts() {
        let folder = tempfile::tempdir().unwrap();
        for (index, size) in ["48K", "2048K", "32K"].into_iter().enumerate() {
            let cache = folder.path().join(format!("index{index}"));
            std::fs::create_dir(&cache).unwrap();
            std::fs::write(cache.join("size"), size).unwrap();
        }
        assert_eq!(largest(folder.path()), Some(2 << 20));
        assert_eq!(largest(&folder.path().join("nothing")), None);
    }
}
