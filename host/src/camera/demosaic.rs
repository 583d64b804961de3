//! Raw sensor samples to RGB: every 2x2 cell of the colour filter becomes one pixel.
//!
//! Binning and not interpolating, because the picture is measured and not looked at: no value is made up from a
//! neighbour, so a clipped sample stays clipped and spreads to nobody; noise falls with the two greens' mean; a quarter
//! of the pixels is merged. The colours of a cell lie up to one raw pixel apart, which no patch of sky resolves.

/// Which colours a 2x2 cell holds: the upper row, then the lower one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BayerOrder {
    /// Red, green; green, blue.
    Rggb,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
    /// Blue, green; green, red.
    Bggr,
}

impl BayerOrder {
    /// A cell's `[upper left, upper right, lower left, lower right]` as `[red, green, green, blue]`.
    fn sorted(self, [a, b, c, d]: [u16; 4]) -> [u16; 4] {
        match self {
            BayerOrder::Rggb => [a, b, c, d],
            BayerOrder::Grbg => [b, a, d, c],
            BayerOrder::Gbrg => [c, a, d, b],
            BayerOrder::Bggr => [d, b, c, a],
        }
    }
}

/// Bins two raw rows into one row of RGB codes. A green at or above `clip` hides the other, darker one: their mean would
/// pass for a measured value. Cells that `out` has no room for, and odd last samples, are left out.
pub fn bin_rows<T>(order: BayerOrder, [upper, lower]: [&[u16]; 2], clip: u16, out: &mut [T], code: impl Fn(u16) -> T) {
    let cells = upper.chunks_exact(2).zip(lower.chunks_exact(2));
    for (pixel, (up, low)) in out.chunks_exact_mut(3).zip(cells) {
        let [red, green, other, blue] = order.sorted([up[0], up[1], low[0], low[1]]);
        let brighter = green.max(other);
        let mean = u32::from(green).midpoint(u32::from(other)) as u16;
        let green = if brighter >= clip { brighter } else { mean };
        for (value, sample) in pixel.iter_mut().zip([red, green, blue]) {
            *value = code(sample);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORDERS: [(BayerOrder, &[u8; 4]); 4] = [
        (BayerOrder::Rggb, b"RGGB"),
        (BayerOrder::Grbg, b"GRBG"),
        (BayerOrder::Gbrg, b"GBRG"),
        (BayerOrder::Bggr, b"BGGR"),
    ];

    /// A mosaic of `light(colour, x, y)`, as a sensor with this filter sees it.
    fn mosaic(filter: &[u8; 4], width: usize, light: impl Fn(u8, usize, usize) -> u16) -> [Vec<u16>; 2] {
        [0, 1].map(|y| (0..width).map(|x| light(filter[y * 2 + x % 2], x, y)).collect())
    }

    #[test]
    fn a_flat_field_keeps_its_colour_in_every_order() {
        for (order, filter) in ORDERS {
            let [upper, lower] = mosaic(filter, 6, |colour, _, _| match colour {
                b'R' => 100,
                b'G' => 200,
                _ => 50,
            });
            let mut out = [0u16; 9];
            bin_rows(order, [&upper, &lower], 65535, &mut out, |code| code);
            assert_eq!(out, [100, 200, 50, 100, 200, 50, 100, 200, 50], "{order:?}");
        }
    }

    #[test]
    fn a_ramp_stays_a_ramp_of_the_same_slope() {
        // Grey light 1000 + 40 x: a cell at column 2 i sees 1000 + 80 i, red and blue half a cell beside at most.
        for (order, filter) in ORDERS {
            let [upper, lower] = mosaic(filter, 16, |_, x, _| 1000 + 40 * x as u16);
            let mut out = [0u16; 24];
            bin_rows(order, [&upper, &lower], 65535, &mut out, |code| code);
            for (cell, pixel) in out.chunks_exact(3).enumerate() {
                assert_eq!(usize::from(pixel[1]), 1020 + 80 * cell, "{order:?}: the greens' mean is the cell's middle");
                for colour in [pixel[0], pixel[2]] {
                    assert!((i32::from(colour) - 1020 - 80 * cell as i32).abs() == 20, "{order:?} {pixel:?}");
                }
            }
            let slopes = (0..7).map(|i| [0, 1, 2].map(|k| out[3 * i + 3 + k] - out[3 * i + k]));
            slopes.for_each(|slope| assert_eq!(slope, [80; 3], "{order:?}"));
        }
    }

    #[test]
    fn one_clipped_green_is_not_averaged_away() {
        let mut out = [0u8; 3];
        bin_rows(BayerOrder::Rggb, [&[10, 255], &[101, 20]], 250, &mut out, |code| code as u8);
        assert_eq!(out, [10, 255, 20]);
        bin_rows(BayerOrder::Rggb, [&[10, 200], &[101, 20]], 250, &mut out, |code| code as u8);
        assert_eq!(out, [10, 150, 20]);
    }
}
