//! The pose from three points (Grunert 1841, as in Haralick, Lee, Ottenberg & Nolle, *Review and Analysis of Solutions of the
//! Three Point Perspective Pose Estimation Problem*, IJCV 1994): up to four poses that put three places on three rays.

use glam::{DMat3, DVec3};
use nalgebra::Matrix4;

/// Where a camera stands: `camera = rotation * (world - eye)`, x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    /// World directions to camera directions.
    pub rotation: DMat3,
    /// The eye, m.
    pub eye: DVec3,
}

/// Calls `found` with every pose from which `places` lie along the unit directions `rays` (camera).
pub fn poses(places: [DVec3; 3], rays: [DVec3; 3], mut found: impl FnMut(Stand)) {
    let [p1, p2, p3] = places;
    let [a2, b2, c2] = [p2.distance_squared(p3), p1.distance_squared(p3), p1.distance_squared(p2)];
    let [cos_a, cos_b, cos_c] = [rays[1].dot(rays[2]), rays[0].dot(rays[2]), rays[0].dot(rays[1])];
    let Some(world) = triad(places) else { return };
    let (m, p) = ((a2 - c2) / b2, (a2 + c2) / b2);
    // With distances s1, s2 = u s1 and s3 = v s1 from the eye, this quartic in v is what the law of cosines leaves.
    let quartic = [
        (1.0 + m).powi(2) - 4.0 * a2 / b2 * cos_c * cos_c,
        4.0 * (-m * (1.0 + m) * cos_b + 2.0 * a2 / b2 * cos_c * cos_c * cos_b - (1.0 - p) * cos_a * cos_c),
        2.0 * (m * m - 1.0 + 2.0 * m * m * cos_b * cos_b + 2.0 * (b2 - c2) / b2 * cos_a * cos_a
            - 4.0 * p * cos_a * cos_b * cos_c
            + 2.0 * (b2 - a2) / b2 * cos_c * cos_c),
        4.0 * (m * (1.0 - m) * cos_b - (1.0 - p) * cos_a * cos_c + 2.0 * c2 / b2 * cos_a * cos_a * cos_b),
        (m - 1.0).powi(2) - 4.0 * c2 / b2 * cos_a * cos_a,
    ];
    for v in real_roots(quartic) {
        let under = 2.0 * (cos_c - v * cos_a);
        let u = ((m - 1.0) * v * v - 2.0 * m * cos_b * v + 1.0 + m) / under;
        let squared = b2 / (1.0 + v * v - 2.0 * v * cos_b);
        if !(v > 0.0 && u > 0.0 && u.is_finite() && squared > 0.0) {
            continue;
        }
        let s1 = squared.sqrt();
        let seen = [rays[0] * s1, rays[1] * (u * s1), rays[2] * (v * s1)];
        if let Some(camera) = triad(seen) {
            let rotation = camera * world.transpose();
            let middle = |of: [DVec3; 3]| (of[0] + of[1] + of[2]) / 3.0;
            found(Stand { rotation, eye: middle(places) - rotation.transpose() * middle(seen) });
        }
    }
}

/// An orthonormal frame of a triangle.
fn triad([a, b, c]: [DVec3; 3]) -> Option<DMat3> {
    let along = (b - a).try_normalize()?;
    let side = c - a;
    let normal = along.cross(side);
    // A sliver's plane is noise.
    if normal.length() < 1e-6 * side.length() {
        return None;
    }
    let normal = normal.try_normalize()?;
    Some(DMat3::from_cols(along, normal.cross(along), normal))
}

/// Real roots of a polynomial of the fourth degree, lowest coefficient first.
fn real_roots(c: [f64; 5]) -> impl Iterator<Item = f64> {
    let companion = Matrix4::new(
        -c[3] / c[4],
        -c[2] / c[4],
        -c[1] / c[4],
        -c[0] / c[4], //
        1.0,
        0.0,
        0.0,
        0.0, //
        0.0,
        1.0,
        0.0,
        0.0, //
        0.0,
        0.0,
        1.0,
        0.0,
    );
    let sound = companion.iter().all(|value| value.is_finite());
    let roots = sound.then(|| companion.complex_eigenvalues());
    let roots = roots.into_iter().flat_map(|all| [all[0], all[1], all[2], all[3]]);
    // Noise turns a double root into a pair of complex ones close to the axis.
    roots.filter(|root| root.im.abs() <= 1e-3 * (1.0 + root.re.abs())).map(move |root| {
        (0..2).fold(root.re, |v, _| {
            let value = (((c[4] * v + c[3]) * v + c[2]) * v + c[1]) * v + c[0];
            let slope = ((4.0 * c[4] * v + 3.0 * c[3]) * v + 2.0 * c[2]) * v + c[1];
            let next = v - value / slope;
            if next.is_finite() && (next - v).abs() < 0.1 * (1.0 + v.abs()) { next } else { v }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_true_pose_is_among_those_found() {
        let rotation = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_y(-1.1) * DMat3::from_rotation_z(0.2);
        let truth = Stand { rotation, eye: DVec3::new(3.0, -2.0, 7.5) };
        let seen = [DVec3::new(-1.0, 0.5, 9.0), DVec3::new(2.5, 1.0, 7.0), DVec3::new(0.3, -1.5, 12.0)];
        let places = seen.map(|at| truth.eye + rotation.transpose() * at);
        let mut nearest = f64::INFINITY;
        poses(places, seen.map(DVec3::normalize), |stand| {
            nearest = nearest.min(stand.eye.distance(truth.eye));
            for (place, ray) in places.iter().zip(seen) {
                let back = (stand.rotation * (*place - stand.eye)).normalize();
                assert!((back - ray.normalize()).length() < 1e-6, "{back}");
            }
        });
        assert!(nearest < 1e-8, "{nearest}");
    }

    #[test]
    fn degenerate_triangles_give_nothing() {
        let places = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X];
        poses(places, [DVec3::Z, DVec3::new(0.1, 0.0, 1.0).normalize(), DVec3::new(0.2, 0.0, 1.0).normalize()], |_| {
            panic!("a line has no pose")
        });
        poses([DVec3::ZERO; 3], [DVec3::Z; 3], |_| panic!("a point has no pose"));
    }
}
