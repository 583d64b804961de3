//! RGB codes to YUYV: BT.601 coefficients, limited range (Y 16..=235, chroma 16..=240), chroma of two pixels averaged.
//!
//! That is what V4L2 takes for granted for YUYV of a UVC camera whose colour descriptor says SMPTE 170M.

/// YUYV of two black pixels.
pub const BLACK: [u8; 4] = [16, 128, 16, 128];

/// Y of a pixel: 16 + 219 (0.299 R + 0.587 G + 0.114 B) / 255.
fn luma([r, g, b]: [i32; 3]) -> u8 {
    (16 + ((16_829 * r + 33_039 * g + 6_416 * b + 32_768) >> 16)) as u8
}

/// Two pixels next to each other, as Y0 Cb Y1 Cr.
pub fn pack(left: [u8; 3], right: [u8; 3]) -> [u8; 4] {
    let (left, right) = (left.map(i32::from), right.map(i32::from));
    // Sums of two: one more bit to shift out.
    let [r, g, b] = [left[0] + right[0], left[1] + right[1], left[2] + right[2]];
    let half = 1 << 16;
    let cb = 128 + ((-9_714 * r - 19_070 * g + 28_784 * b + half) >> 17);
    let cr = 128 + ((28_784 * r - 24_103 * g - 4_681 * b + half) >> 17);
    [luma(left), cb as u8, luma(right), cr as u8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_bars_are_those_of_the_standard() {
        // 100 % bars of BT.601 in 8 bits, as published (Y, Cb, Cr).
        let bars = [
            ([255, 255, 255], [235, 128, 128]),
            ([255, 255, 0], [210, 16, 146]),
            ([0, 255, 255], [170, 166, 16]),
            ([0, 255, 0], [145, 54, 34]),
            ([255, 0, 255], [106, 202, 222]),
            ([255, 0, 0], [81, 90, 240]),
            ([0, 0, 255], [41, 240, 110]),
            ([0, 0, 0], [16, 128, 128]),
        ];
        for (rgb, [y, cb, cr]) in bars {
            assert_eq!(pack(rgb, rgb), [y, cb, y, cr], "{rgb:?}");
        }
        assert_eq!(pack([0; 3], [0; 3]), BLACK);
    }

    #[test]
    fn chroma_is_the_pairs_mean_and_luma_each_ones_own() {
        let mut worst = 0.0f64;
        for i in 0..4096u32 {
            let hash = |k: u32| (i.wrapping_mul(2_654_435_761) ^ k.wrapping_mul(0x9e37_79b9)).rotate_left(k) as u8;
            let (a, b) = ([hash(1), hash(2), hash(3)], [hash(4), hash(5), hash(6)]);
            let luma = |p: [u8; 3]| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]);
            let y = 0.5 * (luma(a) + luma(b));
            let mean = |k: usize| 0.5 * (f64::from(a[k]) + f64::from(b[k]));
            let expected = [
                16.0 + 219.0 / 255.0 * luma(a),
                128.0 + 224.0 / 255.0 * (mean(2) - y) / (2.0 - 2.0 * 0.114),
                16.0 + 219.0 / 255.0 * luma(b),
                128.0 + 224.0 / 255.0 * (mean(0) - y) / (2.0 - 2.0 * 0.299),
            ];
            for (found, expected) in pack(a, b).iter().zip(expected) {
                worst = worst.max((f64::from(*found) - expected).abs());
            }
        }
        assert!(worst < 0.51, "{worst}");
    }
}
