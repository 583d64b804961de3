//! Repeatable pseudo-random numbers and smooth noise for the demo's site.

/// A number in 0..1 that only depends on its arguments.
pub(super) fn hash(x: i64, y: i64, seed: u32) -> f32 {
    // The mixing steps of splitmix64 (Steele, Lea and Flood 2014).
    let mut bits = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
    bits = (bits ^ u64::from(seed).wrapping_mul(0x94d0_49bb_1331_11eb)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 40) as f32 / (1u32 << 24) as f32
}

/// Value noise in 0..1 with lattice constant 1. `period` > 0 makes it repeat, so that a texture tiles.
pub(super) fn noise(x: f32, y: f32, period: i64, seed: u32) -> f32 {
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let (part_x, part_y) = (smooth(x - cell_x), smooth(y - cell_y));
    let wrap = |n: i64| if period > 0 { n.rem_euclid(period) } else { n };
    let at = |dx: i64, dy: i64| hash(wrap(cell_x as i64 + dx), wrap(cell_y as i64 + dy), seed);
    let top = at(0, 0) + (at(1, 0) - at(0, 0)) * part_x;
    let bottom = at(0, 1) + (at(1, 1) - at(0, 1)) * part_x;
    top + (bottom - top) * part_y
}

/// Fractal noise about 0, within -1..1: `octaves` of value noise, each twice as fine and half as strong.
pub(super) fn fbm(x: f32, y: f32, octaves: u32, period: i64, seed: u32) -> f32 {
    let mut sum = 0.0;
    let mut strength = 0.5;
    let mut scale = 1.0;
    for octave in 0..octaves {
        let period = period << octave;
        sum += strength * (2.0 * noise(x * scale, y * scale, period, seed + octave) - 1.0);
        strength *= 0.5;
        scale *= 2.0;
    }
    sum
}

/// 0 below `low`, 1 above `high`, smooth between.
pub(super) fn smoothstep(low: f32, high: f32, value: f32) -> f32 {
    smooth(((value - low) / (high - low)).clamp(0.0, 1.0))
}

fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_uniform_and_noise_tiles() {
        let values: Vec<f32> = (0..10_000).map(|n| hash(n % 100, n / 100, 3)).collect();
        let mean = values.iter().sum::<f32>() / 10_000.0;
        let square = values.iter().map(|v| v * v).sum::<f32>() / 10_000.0;
        assert!((mean - 0.5).abs() < 0.01 && (square - 1.0 / 3.0).abs() < 0.01, "{mean} {square}");
        for step in 0..50 {
            let at = step as f32 * 0.37;
            assert!((fbm(at, 2.3, 4, 8, 1) - fbm(at + 8.0, 2.3 - 8.0, 4, 8, 1)).abs() < 1e-4);
        }
    }
}
