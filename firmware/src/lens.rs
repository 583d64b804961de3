//! The lens of a view: pixels to directions in the camera and back.
//!
//! A direction (x right, y down, z forward) has the slope `t` from the axis; the picture shows it at
//! `principal + focal * p(t)` along (x, y), with `p(t) = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)`.
//! `Radial` (Brown 1971, as OpenCV's `projectPoints` without tangential terms, k4 = 0): `t = tan(theta)`.
//! `KannalaBrandt` (Kannala & Brandt 2006, OpenCV's `fisheye`): `t = theta`, which may pass 90 degrees.
//! Pixel (column, row) has its centre at (column + 0.5, row + 0.5), where OpenCV has (column, row).
//!
//! ```text
//! layer LENS, 80 bytes, left out where the picture is a pinhole's
//!   0  u32 model (0 radial, 1 Kannala-Brandt)    4  u32 1 where the model turns back at the largest t, else 0
//!   8  f64[2] focal length, px of the field      24  f64[2] principal point, px from the top left corner
//!  40  f64[4] k                                  72  f64 largest t that the lens images
//! ```

use core::f64::consts::PI;

/// Length of the layer LENS, bytes.
pub const LENS: usize = 80;

/// What `t` is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// The tangent of the angle from the axis.
    Radial,
    /// The angle from the axis, radians.
    KannalaBrandt,
}

/// Tangent beyond which no radial model is followed: 89.9 degrees.
const LARGEST_TANGENT: f64 = 573.0;

/// A lens over the pixels of one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// What `t` is.
    pub projection: Projection,
    /// Focal length across and down, px.
    pub focal_px: [f64; 2],
    /// Where the axis meets the picture, px from its top left corner.
    pub principal_px: [f64; 2],
    /// Distortion.
    pub k: [f64; 4],
    limit: f64,
    folds: bool,
}

/// A direction in the camera, and how it changes from pixel to pixel.
#[derive(Clone, Copy, Debug)]
pub struct LensRay {
    /// Unit; x right, y down, z forward.
    pub dir_camera: [f64; 3],
    /// Change per pixel to the right.
    pub across: [f64; 3],
    /// Change per pixel down.
    pub down: [f64; 3],
}

impl Lens {
    /// A lens that images up to `most_angle` (radians) from its axis, or less where `p` stops growing before.
    pub fn new(
        projection: Projection,
        focal_px: [f64; 2],
        principal_px: [f64; 2],
        k: [f64; 4],
        most_angle: f64,
    ) -> Self {
        let end = match projection {
            Projection::Radial if most_angle < 0.5 * PI => libm::tan(most_angle).min(LARGEST_TANGENT),
            Projection::Radial => LARGEST_TANGENT,
            Projection::KannalaBrandt => most_angle.min(PI),
        };
        let mut lens = Lens { projection, focal_px, principal_px, k, limit: end, folds: false };
        let mut t = 0.0;
        while t < end {
            let next = (t + 0.01 + 0.01 * t).min(end);
            if lens.polynomial(next).1 <= 0.0 {
                (lens.limit, lens.folds) = (t, true);
                break;
            }
            t = next;
        }
        lens
    }

    /// The same lens over a picture with `times` as many pixels across and down.
    pub fn scaled(self, times: [f64; 2]) -> Self {
        let scale = |v: [f64; 2]| [v[0] * times[0], v[1] * times[1]];
        Lens { focal_px: scale(self.focal_px), principal_px: scale(self.principal_px), ..self }
    }

    /// The distance from the principal point, in focal lengths, where the model turns back and means nothing any more;
    /// none if it grows as far as the lens images.
    pub fn fold(&self) -> Option<f64> {
        self.folds.then(|| self.polynomial(self.limit).0)
    }

    /// Distance of a picture position from the principal point, in focal lengths.
    pub fn radius(&self, position_px: [f64; 2]) -> f64 {
        let [x, y] = self.plane(position_px);
        libm::hypot(x, y)
    }

    fn plane(&self, position_px: [f64; 2]) -> [f64; 2] {
        core::array::from_fn(|c| (position_px[c] - self.principal_px[c]) / self.focal_px[c])
    }

    /// p(t) and its slope.
    fn polynomial(&self, t: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.k;
        let s = t * t;
        let value = t * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))));
        (value, 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4))))
    }

    /// Picture position (px) of a direction in the camera, of any length; none where the lens does not image it.
    pub fn project(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        let off_axis = libm::hypot(x, y);
        let t = match self.projection {
            Projection::Radial if z <= 0.0 => return None,
            Projection::Radial => off_axis / z,
            Projection::KannalaBrandt => libm::atan2(off_axis, z),
        };
        if t.is_nan() || t > self.limit {
            return None;
        }
        let stretch = if off_axis > 0.0 { self.polynomial(t).0 / off_axis } else { 0.0 };
        Some([
            self.principal_px[0] + self.focal_px[0] * x * stretch,
            self.principal_px[1] + self.focal_px[1] * y * stretch,
        ])
    }

    /// Unit direction in the camera at a picture position (px); none beyond what the lens images.
    pub fn direction(&self, position_px: [f64; 2]) -> Option<[f64; 3]> {
        let within = self.radius(position_px) <= self.polynomial(self.limit).0;
        within.then(|| self.ray(position_px).dir_camera)
    }

    /// The direction at a picture position (px), and its change; beyond what the lens images, that of the edge.
    pub fn ray(&self, position_px: [f64; 2]) -> LensRay {
        let [x, y] = self.plane(position_px);
        let radius = libm::hypot(x, y);
        let t = self.inverse(radius);
        let (sin, cos, angle_slope) = match self.projection {
            Projection::Radial => {
                let cos = 1.0 / libm::sqrt(1.0 + t * t);
                (t * cos, cos, cos * cos)
            }
            Projection::KannalaBrandt => (libm::sin(t), libm::cos(t), 1.0),
        };
        let outward = if radius > 0.0 { [x / radius, y / radius] } else { [1.0, 0.0] };
        // Along the radius, and around the axis.
        let along = angle_slope / self.polynomial(t).1;
        let around = if radius > 1e-9 { sin / radius } else { 1.0 };
        let change = |part_out: f64, part_around: f64| {
            let [a, b] = [part_out * along, part_around * around];
            [outward[0] * cos * a - outward[1] * b, outward[1] * cos * a + outward[0] * b, -sin * a]
        };
        let [fx, fy] = self.focal_px;
        LensRay {
            dir_camera: [outward[0] * sin, outward[1] * sin, cos],
            across: change(outward[0] / fx, -outward[1] / fx),
            down: change(outward[1] / fy, outward[0] / fy),
        }
    }

    /// Solid angle of the pixel around a picture position, sr.
    pub fn pixel_solid_angle(&self, position_px: [f64; 2]) -> f64 {
        let LensRay { across: [a, b, c], down: [x, y, z], .. } = self.ray(position_px);
        let [u, v, w] = [b * z - c * y, c * x - a * z, a * y - b * x];
        libm::sqrt(u * u + v * v + w * w)
    }

    /// The t of a radius in focal lengths: Newton's steps, halved brackets where these leave the bracket.
    fn inverse(&self, radius: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.limit);
        if radius >= self.polynomial(high).0 {
            return high;
        }
        let mut t = radius.min(high);
        for _ in 0..60 {
            let (found, slope) = self.polynomial(t);
            let error = found - radius;
            if error.abs() <= 1e-14 * (1.0 + radius) {
                break;
            }
            if error > 0.0 {
                high = t
            } else {
                low = t
            }
            let newton = t - error / slope;
            t = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        }
        t
    }

    /// The layer LENS.
    pub fn encode(&self) -> [u8; LENS] {
        let mut out = [0u8; LENS];
        out[..4].copy_from_slice(&u32::from(self.projection == Projection::KannalaBrandt).to_le_bytes());
        out[4] = u8::from(self.folds);
        let values = self.focal_px.iter().chain(&self.principal_px).chain(&self.k).chain([&self.limit]);
        for (slot, value) in out[8..].chunks_exact_mut(8).zip(values) {
            slot.copy_from_slice(&value.to_le_bytes());
        }
        out
    }

    /// What the layer LENS says; none if no lens is like that.
    pub(crate) fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; LENS] = bytes.try_into().ok()?;
        let mut values = [0.0f64; 9];
        for (value, slot) in values.iter_mut().zip(bytes[8..].as_chunks::<8>().0) {
            *value = f64::from_le_bytes(*slot);
        }
        let [fx, fy, cx, cy, k1, k2, k3, k4, limit] = values;
        let projection = match bytes[0] {
            0 => Projection::Radial,
            1 => Projection::KannalaBrandt,
            _ => return None,
        };
        let most = if projection == Projection::Radial { LARGEST_TANGENT } else { PI };
        let lens = Lens {
            projection,
            focal_px: [fx, fy],
            principal_px: [cx, cy],
            k: [k1, k2, k3, k4],
            limit,
            folds: bytes[4] == 1,
        };
        let sound = bytes[1..4] == [0; 3] && bytes[4] <= 1 && bytes[5..8] == [0; 3];
        let sound = sound && values.iter().all(|v| v.is_finite() && v.abs() < 1e12);
        let sound = sound && fx > 1e-6 && fy > 1e-6 && limit > 0.0 && limit <= most && lens.polynomial(limit).0 > 0.0;
        sound.then_some(lens)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRINCIPAL: [f64; 2] = [641.0, 352.5];

    fn radial() -> Lens {
        Lens::new(Projection::Radial, [900.0, 901.0], PRINCIPAL, [-0.21, 0.07, -0.008, 0.0], PI)
    }

    fn fisheye() -> Lens {
        Lens::new(Projection::KannalaBrandt, [330.0; 2], PRINCIPAL, [0.03, -0.012, 0.004, -0.0006], PI)
    }

    #[test]
    fn pixels_go_to_directions_and_back() {
        for (lens, reach) in [(radial(), 700.0), (fisheye(), 640.0)] {
            for index in 0..400 {
                let angle = f64::from(index) * 2.4;
                let distance = reach * libm::sqrt(f64::from(index) / 400.0);
                let at = [PRINCIPAL[0] + distance * libm::cos(angle), PRINCIPAL[1] + distance * libm::sin(angle)];
                let dir = lens.direction(at).unwrap();
                let back = lens.project(dir.map(|c| 3.7 * c)).unwrap();
                assert!(libm::hypot(back[0] - at[0], back[1] - at[1]) < 1e-9, "{at:?} {back:?}");
            }
        }
    }

    #[test]
    fn changes_from_pixel_to_pixel_are_differences() {
        for lens in [radial(), fisheye()] {
            for at in [[641.0, 352.5], [700.0, 360.0], [100.0, 650.0], [1200.0, 30.0]] {
                let ray = lens.ray(at);
                for (change, step) in [(ray.across, [1e-3, 0.0]), (ray.down, [0.0, 1e-3])] {
                    let [low, high] =
                        [-0.5, 0.5].map(|s| lens.ray([at[0] + s * step[0], at[1] + s * step[1]]).dir_camera);
                    for c in 0..3 {
                        assert!((change[c] - (high[c] - low[c]) / 1e-3).abs() < 1e-8, "{at:?} {change:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_fisheye_sees_behind_itself_and_an_equidistant_one_ends_at_its_angle() {
        let dir = [libm::sin(2.0), 0.0, libm::cos(2.0)];
        assert!(fisheye().project(dir).is_some() && radial().project(dir).is_none());
        let ends = Lens::new(Projection::KannalaBrandt, [100.0; 2], [0.0; 2], [0.0; 4], 1.6);
        assert!(ends.project([libm::sin(1.7), 0.0, libm::cos(1.7)]).is_none() && ends.fold().is_none());
        assert!(ends.direction([159.0, 0.0]).is_some() && ends.direction([161.0, 0.0]).is_none());
    }

    #[test]
    fn a_model_that_turns_back_is_told() {
        // p(t) = t - t^3 / 3 turns at t = 1, where it is 2/3.
        let lens = Lens::new(Projection::Radial, [100.0; 2], [0.0; 2], [-1.0 / 3.0, 0.0, 0.0, 0.0], PI);
        assert!((lens.fold().unwrap() - 2.0 / 3.0).abs() < 1e-3);
        let straight = Lens::new(Projection::Radial, [100.0; 2], [0.0; 2], [0.1, 0.0, 0.0, 0.0], PI);
        assert_eq!(straight.fold(), None);
    }

    #[test]
    fn layers_come_back_and_nonsense_does_not() {
        for lens in [radial(), fisheye()] {
            assert_eq!(Lens::decode(&lens.encode()), Some(lens));
        }
        let whole = radial().encode();
        let with = |at: usize, bytes: [u8; 8]| {
            let mut bent = whole;
            bent[at..at + 8].copy_from_slice(&bytes);
            Lens::decode(&bent)
        };
        assert_eq!(with(0, 2u64.to_le_bytes()), None);
        assert_eq!(with(8, f64::NAN.to_le_bytes()), None);
        assert_eq!(with(8, (-1.0f64).to_le_bytes()), None);
        assert_eq!(with(72, 1e9f64.to_le_bytes()), None);
        assert_eq!(Lens::decode(&whole[..79]), None);
    }
}
