//! Solid angles of lights: each stands for the directions that are nearest to it, before the horizon.
//!
//! A cell is the cone that the planes halfway to all other lights leave, cut to half the sphere around its light: a polygon
//! on the tangent plane, whose solid angle is the sum over triangles (A. van Oosterom and J. Strackee, The solid angle of a
//! plane triangle, IEEE Trans. Biomed. Eng. 30, 1983).

type Vec3 = [f64; 3];

/// Solid angles of the cells of unit directions, sr; 0 for one behind the horizon. `horizon` is a unit normal.
pub(super) fn solid_angles_sr(dirs: &[Vec3], horizon: Option<Vec3>) -> Vec<f64> {
    (0..dirs.len()).map(|light| cell_sr(dirs, light, horizon)).collect()
}

fn cell_sr(dirs: &[Vec3], light: usize, horizon: Option<Vec3>) -> f64 {
    let own = dirs[light];
    let mut cone = half_sphere(own);
    for (other, dir) in dirs.iter().enumerate() {
        if other != light {
            let halfway = std::array::from_fn(|k| own[k] - dir[k]);
            cone = cut(&cone, halfway);
        }
    }
    if let Some(axis) = horizon {
        cone = cut(&cone, axis);
    }
    solid_angle_sr(&cone, own)
}

/// A square cone that is as good as half the sphere around a direction, counter-clockwise around it.
fn half_sphere(own: Vec3) -> Vec<Vec3> {
    const FAR: f64 = 1e6;
    let axis = if own[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let a = unit(cross(axis, own));
    let b = cross(own, a);
    let corner = |(s, t): (f64, f64)| unit(std::array::from_fn(|k| own[k] + FAR * (s * a[k] + t * b[k])));
    [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].map(corner).to_vec()
}

/// What of a cone lies before a plane through its tip.
fn cut(cone: &[Vec3], normal: Vec3) -> Vec<Vec3> {
    let mut left = Vec::with_capacity(cone.len() + 1);
    for (k, &from) in cone.iter().enumerate() {
        let to = cone[(k + 1) % cone.len()];
        let (here, there) = (dot(normal, from), dot(normal, to));
        if here >= 0.0 {
            left.push(from);
        }
        if (here >= 0.0) != (there >= 0.0) {
            left.push(unit(std::array::from_fn(|k| (from[k] * there - to[k] * here) / (there - here))));
        }
    }
    left
}

fn solid_angle_sr(cone: &[Vec3], inside: Vec3) -> f64 {
    let triangle = |k: usize| {
        let (a, b) = (cone[k], cone[(k + 1) % cone.len()]);
        let volume = dot(inside, cross(a, b));
        2.0 * volume.atan2(1.0 + dot(inside, a) + dot(a, b) + dot(b, inside))
    };
    (0..cone.len()).map(triangle).sum::<f64>().max(0.0)
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: Vec3) -> Vec3 {
    let length = dot(v, v).sqrt();
    v.map(|c| c / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn even_solids_share_the_sphere() {
        let octahedron: Vec<Vec3> = (0..6)
            .map(|k| std::array::from_fn(|c| if c == k / 2 { if k % 2 == 0 { 1.0 } else { -1.0 } } else { 0.0 }))
            .collect();
        for omega in solid_angles_sr(&octahedron, None) {
            assert!((omega - 2.0 * TAU / 6.0).abs() < 1e-9, "{omega}");
        }
        let half = solid_angles_sr(&octahedron, Some([0.0, 0.0, 1.0]));
        assert!((half[0] - TAU / 6.0).abs() < 1e-9 && (half[4] - TAU / 3.0).abs() < 1e-9 && half[5] < 1e-9, "{half:?}");
        // One light over a horizon has half the sphere.
        let one = solid_angles_sr(&[[0.0, 0.0, 1.0]], Some([0.0, 0.0, 1.0]));
        assert!((one[0] - TAU).abs() < 0.01 * TAU, "{one:?}");
    }

    #[test]
    fn cells_of_any_lights_fill_the_sphere() {
        let dirs: Vec<Vec3> = (0..97)
            .map(|k| {
                let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / 97.0;
                let (sin, cos) = (f64::from(k * k) * 1.7).sin_cos();
                let r = (1.0f64 - z * z).sqrt();
                [r * cos, r * sin, z]
            })
            .collect();
        let total: f64 = solid_angles_sr(&dirs, None).iter().sum();
        assert!((total - 4.0 * PI).abs() < 1e-6, "{total}");
        let dome: Vec<Vec3> = dirs.into_iter().filter(|dir| dir[2] > 0.0).collect();
        let total: f64 = solid_angles_sr(&dome, Some([0.0, 0.0, 1.0])).iter().sum();
        assert!((total - TAU).abs() < 1e-6, "{total}");
    }
}
