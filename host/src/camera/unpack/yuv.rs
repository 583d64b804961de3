//! YUV to RGB by the coding that the driver names.

/// Which codes black and white have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Range {
    /// Y from 16 to 235, U and V from 16 to 240.
    #[default]
    Limited,
    /// 0 to 255.
    Full,
}

/// Which luminance Y is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Matrix {
    /// BT.601, most webcams.
    #[default]
    Bt601,
    /// BT.709, high definition.
    Bt709,
    /// BT.2020.
    Bt2020,
    /// SMPTE 240M.
    Smpte240m,
}

/// What YUV values stand for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct YuvCoding {
    /// Which codes black and white have.
    pub range: Range,
    /// Which luminance Y is.
    pub matrix: Matrix,
}

impl Matrix {
    /// Shares of red and blue in Y.
    fn shares(self) -> (f64, f64) {
        match self {
            Matrix::Bt601 => (0.299, 0.114),
            Matrix::Bt709 => (0.2126, 0.0722),
            Matrix::Bt2020 => (0.2627, 0.0593),
            Matrix::Smpte240m => (0.212, 0.087),
        }
    }
}

/// Fraction bits of the factors.
const FRACTION: u32 = 16;

/// The factors of one coding.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToRgb {
    black: i32,
    y: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

impl ToRgb {
    pub(super) fn new(coding: YuvCoding) -> Self {
        let (red, blue) = coding.matrix.shares();
        let green = 1.0 - red - blue;
        let (black, luma, chroma) = match coding.range {
            Range::Limited => (16, 255.0 / 219.0, 255.0 / 224.0),
            Range::Full => (0, 1.0, 1.0),
        };
        let fixed = |factor: f64| (factor * f64::from(1 << FRACTION)).round() as i32;
        ToRgb {
            black,
            y: fixed(luma),
            red_v: fixed(chroma * 2.0 * (1.0 - red)),
            green_u: fixed(-chroma * 2.0 * (1.0 - blue) * blue / green),
            green_v: fixed(-chroma * 2.0 * (1.0 - red) * red / green),
            blue_u: fixed(chroma * 2.0 * (1.0 - blue)),
        }
    }

    /// RGB codes of two pixels that share U and V; `out` has room for one or both.
    pub(super) fn pair(&self, luma: [u8; 2], [u, v]: [u8; 2], out: &mut [u8]) {
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        let half = 1 << (FRACTION - 1);
        let offsets = [self.red_v * v + half, self.green_u * u + self.green_v * v + half, self.blue_u * u + half];
        for (pixel, y) in out.chunks_exact_mut(3).zip(luma) {
            let y = self.y * (i32::from(y) - self.black);
            for (code, offset) in pixel.iter_mut().zip(offsets) {
                *code = ((y + offset) >> FRACTION).clamp(0, 255) as u8;
            }
        }
    }
}
