//! The parameters of a lens as least squares sees them: offsets from nominal values, all 0 at the start.

use crate::lens::{Lens, LensFile, LensModel};

/// Three of orientation, then those of the lens.
pub(super) const COUNT: usize = 10;
/// The orientation's parameters.
pub(super) const ORIENTATION: std::ops::Range<usize> = 0..3;
/// What each is called in `LENS.json`.
pub(super) const NAMES: [&str; COUNT] = [
    "camera_to_world",
    "camera_to_world",
    "camera_to_world",
    "focal_px",
    "center_px[0]",
    "center_px[1]",
    "k[0]",
    "k[1]",
    "k[2]",
    "k[3]",
];
/// Standard deviation of lenses around their nominal values: ln of the focal length, centre in shares of the picture's smaller
/// side, Kannala-Brandt's coefficients (equisolid and stereographic lenses lie at -0.042 and +0.083 of the first).
pub(super) const SPREAD: [f64; COUNT] =
    [f64::INFINITY, f64::INFINITY, f64::INFINITY, 0.3, 0.03, 0.03, 0.06, 0.02, 0.01, 0.003];
/// Steps for derivatives.
pub(super) const STEPS: [f64; COUNT] = [1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5];

/// The indices of the parameters that a model has.
pub(super) fn of_model(model: LensModel) -> std::ops::Range<usize> {
    if model == LensModel::KannalaBrandt { 0..COUNT } else { 0..6 }
}

/// Smaller side of the picture, pixels.
pub(super) fn smaller_side(file: &LensFile) -> f64 {
    let given = file.width.zip(file.height).map(|(width, height)| width.min(height) as f64);
    given.unwrap_or(2.0 * file.center_px[0].min(file.center_px[1]))
}

/// The lens with its parameters off those of `base`; none where that makes no lens.
pub(super) fn offset(base: &LensFile, offsets: &[f64; COUNT]) -> Option<LensFile> {
    let side = smaller_side(base);
    let file = LensFile {
        focal_px: base.focal_px * offsets[3].exp(),
        center_px: [base.center_px[0] + side * offsets[4], base.center_px[1] + side * offsets[5]],
        k: std::array::from_fn(|i| base.k[i] + offsets[6 + i]),
        camera_to_world: product(&rotation([offsets[0], offsets[1], offsets[2]]), &base.camera_to_world),
        ..base.clone()
    };
    file.focal_px.is_finite().then_some(file)
}

/// The lens of a file, where it is one.
pub(super) fn lens(file: &LensFile) -> Option<Lens> {
    file.lens("the fit").ok()
}

/// Rotation by a vector: its length is the angle in radians, right-handed about it (Rodrigues' formula).
pub(super) fn rotation(vector: [f64; 3]) -> [[f64; 3]; 3] {
    let angle = vector.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [x, y, z] = if angle > 0.0 { vector.map(|c| c / angle) } else { [0.0, 1.0, 0.0] };
    let (sin, cos) = angle.sin_cos();
    let t = 1.0 - cos;
    [
        [t * x * x + cos, t * x * y - sin * z, t * x * z + sin * y],
        [t * x * y + sin * z, t * y * y + cos, t * y * z - sin * x],
        [t * x * z - sin * y, t * y * z + sin * x, t * z * z + cos],
    ]
}

/// Matrix product a b.
pub(super) fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}
