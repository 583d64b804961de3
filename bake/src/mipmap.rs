//! Mipmaps: a picture's levels, each half as wide and high as the one before, and how a level is looked at.

use glam::Vec2;

use crate::texture::Wrap;

/// Width and height of the level after one of these.
pub(crate) fn halved((width, height): (usize, usize)) -> Option<(usize, usize)> {
    (width > 1 || height > 1).then(|| ((width / 2).max(1), (height / 2).max(1)))
}

/// Calls `add` with every texel of a level of size `from` that lies under texel (`x`, `y`) of the level of size `to`, and the
/// share of the latter that it covers; the shares of a texel sum up to 1.
pub(crate) fn under(from: (usize, usize), to: (usize, usize), (x, y): (usize, usize), mut add: impl FnMut(usize, f32)) {
    let overlaps = |from: usize, to: usize, at: usize| {
        let scale = from as f32 / to as f32;
        let (low, high) = (at as f32 * scale, (at + 1) as f32 * scale);
        let last = (high.ceil() as usize).min(from);
        (low as usize..last)
            .map(move |k| (k, ((k + 1) as f32).min(high) - (k as f32).max(low)))
            .map(move |(k, length)| (k, length / scale))
    };
    for (row, down) in overlaps(from.1, to.1, y) {
        for (column, across) in overlaps(from.0, to.0, x) {
            add(row * from.0 + column, down * across);
        }
    }
}

/// The four texels around `uv` in a level of `size`, and the weight of each; `None` for coordinates that are not finite.
#[inline]
pub(crate) fn around((width, height): (usize, usize), wrap: [Wrap; 2], uv: Vec2) -> Option<[(usize, f32); 4]> {
    let at = uv * Vec2::new(width as f32, height as f32) - 0.5;
    if !at.is_finite() {
        return None;
    }
    let corner = at.floor();
    let part = at - corner;
    let place = |dx: i64, dy: i64| {
        let x = wrap[0].texel((corner.x as i64).saturating_add(dx), width as i64);
        let y = wrap[1].texel((corner.y as i64).saturating_add(dy), height as i64);
        y * width + x
    };
    let rest = 1.0 - part;
    Some([
        (place(0, 0), rest.x * rest.y),
        (place(1, 0), part.x * rest.y),
        (place(0, 1), rest.x * part.y),
        (place(1, 1), part.x * part.y),
    ])
}

/// The level below and the one above `lod` (0 the finest) of `levels`, and the part of the latter.
#[inline]
pub(crate) fn levels_at(lod: f32, levels: usize) -> (usize, usize, f32) {
    let lod = if lod.is_finite() { lod.clamp(0.0, (levels - 1) as f32) } else { 0.0 };
    let low = lod as usize;
    (low, (low + 1).min(levels - 1), lod - low as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_odd_levels_sum_up_to_one_and_keep_the_mean() {
        for (from, to) in [((5, 3), (2, 1)), ((4, 4), (2, 2)), ((1, 7), (1, 3))] {
            let mut used = vec![0.0f32; from.0 * from.1];
            for y in 0..to.1 {
                for x in 0..to.0 {
                    let mut sum = 0.0;
                    under(from, to, (x, y), |texel, share| {
                        sum += share;
                        used[texel] += share;
                    });
                    assert!((sum - 1.0).abs() < 1e-5, "{from:?} {sum}");
                }
            }
            let each = (to.0 * to.1) as f32 / (from.0 * from.1) as f32;
            assert!(used.iter().all(|share| (share - each).abs() < 1e-5), "{used:?}");
        }
    }

    #[test]
    fn levels_end_at_one_texel() {
        let sizes: Vec<_> = std::iter::successors(Some((5, 3)), |&size| halved(size)).collect();
        assert_eq!(sizes, [(5, 3), (2, 1), (1, 1)]);
        assert_eq!(levels_at(1.25, 3), (1, 2, 0.25));
        assert_eq!(
            (levels_at(9.0, 3), levels_at(f32::NAN, 3), levels_at(-1.0, 1)),
            ((2, 2, 0.0), (0, 1, 0.0), (0, 0, 0.0))
        );
    }
}
