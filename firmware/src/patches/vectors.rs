//! Directions as vectors in double precision.

pub(crate) type Vec3 = [f64; 3];

/// Two unit vectors that are normal to a unit vector and to each other.
pub(crate) fn beside(v: Vec3) -> (Vec3, Vec3) {
    let least = (0..3).min_by(|&a, &b| v[a].abs().total_cmp(&v[b].abs())).unwrap_or(0);
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let a = cross(v, axis);
    let length = libm::sqrt(dot(a, a));
    let a = a.map(|c| c / length);
    (a, cross(v, a))
}

pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
