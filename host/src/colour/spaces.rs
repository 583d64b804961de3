//! Colour spaces of the calibration: linear Rec.709, CIE XYZ, CIE L*a*b*, daylight.

/// A colour's three values.
pub type Triple = [f64; 3];

/// CIE XYZ of linear Rec.709 (ITU-R BT.709 primaries, D65).
pub const XYZ_OF_REC709: [Triple; 3] = [
    [0.412_390_80, 0.357_584_34, 0.180_480_79],
    [0.212_639_01, 0.715_168_68, 0.072_192_32],
    [0.019_330_82, 0.119_194_78, 0.950_532_15],
];
/// The inverse of [`XYZ_OF_REC709`].
pub const REC709_OF_XYZ: [Triple; 3] = [
    [3.240_969_94, -1.537_383_18, -0.498_610_76],
    [-0.969_243_64, 1.875_967_50, 0.041_555_06],
    [0.055_630_08, -0.203_976_96, 1.056_971_51],
];
/// White of D65 (2 degree observer), XYZ with Y = 1.
pub const D65: Triple = [0.950_455_93, 1.0, 1.089_057_75];
/// White of D50 (2 degree observer, ICC), XYZ with Y = 1.
pub const D50: Triple = [0.964_2, 1.0, 0.825_1];

/// Bradford's cone responses of XYZ (Lam 1985), and the inverse.
const BRADFORD: [Triple; 3] = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
const BRADFORD_BACK: [Triple; 3] = [
    [0.986_992_9, -0.147_054_3, 0.159_962_7],
    [0.432_305_3, 0.518_360_3, 0.049_291_2],
    [-0.008_528_7, 0.040_042_8, 0.968_486_7],
];

/// Matrix x vector.
pub fn apply(matrix: &[Triple; 3], v: Triple) -> Triple {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The XYZ that a surface has under another white, as it would look the same (Bradford).
pub fn adapt(xyz: Triple, from_white: Triple, to_white: Triple) -> Triple {
    let (from, to) = (apply(&BRADFORD, from_white), apply(&BRADFORD, to_white));
    let cones = apply(&BRADFORD, xyz);
    apply(&BRADFORD_BACK, std::array::from_fn(|k| cones[k] * to[k] / from[k]))
}

/// CIE L*a*b* (CIE 15) of XYZ against a white.
pub fn lab(xyz: Triple, white: Triple) -> Triple {
    const EDGE: f64 = 6.0 / 29.0;
    let f = |t: f64| if t > EDGE.powi(3) { t.cbrt() } else { t / (3.0 * EDGE * EDGE) + 4.0 / 29.0 };
    let [x, y, z]: Triple = std::array::from_fn(|k| f(xyz[k] / white[k]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// XYZ of CIE L*a*b* against a white.
pub fn xyz_of_lab([l, a, b]: Triple, white: Triple) -> Triple {
    const EDGE: f64 = 6.0 / 29.0;
    let back = |f: f64| if f > EDGE { f.powi(3) } else { 3.0 * EDGE * EDGE * (f - 4.0 / 29.0) };
    let y = (l + 16.0) / 116.0;
    let f = [y + a / 500.0, y, y - b / 200.0];
    std::array::from_fn(|k| white[k] * back(f[k]))
}

/// White of daylight of a correlated colour temperature (4000 to 25000 K), XYZ with Y = 1 (CIE 15, Judd et al. 1964).
pub fn daylight(kelvin: f64) -> Triple {
    let t = kelvin.clamp(4000.0, 25_000.0);
    let x = if t <= 7000.0 {
        -4.607e9 / t.powi(3) + 2.9678e6 / t.powi(2) + 0.099_11e3 / t + 0.244_063
    } else {
        -2.0064e9 / t.powi(3) + 1.9018e6 / t.powi(2) + 0.247_48e3 / t + 0.237_040
    };
    let y = -3.0 * x * x + 2.87 * x - 0.275;
    [x / y, 1.0, (1.0 - x - y) / y]
}
