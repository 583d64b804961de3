//! A measured lens: focal length, principal point and distortion, over the pixels of a still.

use relume_firmware::lens::{Lens, Projection};

/// A lens over a still of `size_px`; pictures of other sizes show the same, if they have its shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Width and height of the still, px.
    pub size_px: [u32; 2],
    /// Focal length, px of the still.
    pub focal_px: f64,
    /// Where the axis meets the still, px from its top left corner; its first pixel's centre is (0.5, 0.5).
    pub principal_px: [f64; 2],
    /// How an angle from the axis becomes a distance.
    pub projection: Projection,
    /// Distortion (firmware/src/lens.rs); of a radial model the first three.
    pub k: [f64; 4],
    /// The largest angle from the axis that the lens images, degrees; 180 for whatever the model allows.
    pub max_angle_deg: f64,
}

impl Optics {
    /// A lens without distortion, its axis in the middle.
    pub fn ideal(projection: Projection, size_px: [u32; 2], focal_px: f64) -> Self {
        let principal_px = size_px.map(|side| 0.5 * f64::from(side));
        Optics { size_px, focal_px, principal_px, projection, k: [0.0; 4], max_angle_deg: 180.0 }
    }

    /// The lens over the still.
    pub fn lens(&self) -> Lens {
        Lens::new(self.projection, [self.focal_px; 2], self.principal_px, self.k, self.max_angle_deg.to_radians())
    }

    /// The lens over a picture of the same view, `size` = width and height in px.
    pub fn lens_over(&self, size: (u32, u32)) -> Lens {
        let [width, height] = self.size_px.map(f64::from);
        self.lens().scaled([f64::from(size.0) / width, f64::from(size.1) / height])
    }

    /// Vertical field of view of a pinhole with this focal length, degrees.
    pub fn pinhole_fov_y_deg(&self) -> f64 {
        2.0 * (0.5 * f64::from(self.size_px[1]) / self.focal_px).atan().to_degrees()
    }

    /// Has a picture of `size` (width, height) the still's shape, to within the rounding of its sides to pixels?
    pub fn fits(&self, size: (u32, u32)) -> bool {
        let [width, height] = self.size_px.map(f64::from);
        let (w, h) = (f64::from(size.0), f64::from(size.1));
        (w * height / width - h).abs() <= 0.5 || (h * width / height - w).abs() <= 0.5
    }

    /// Where within the still the model turns back: px from the principal point.
    pub fn fold_px(&self) -> Option<f64> {
        let lens = self.lens();
        let [width, height] = self.size_px.map(f64::from);
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        let farthest = corners.map(|corner| lens.radius(corner)).into_iter().fold(0.0, f64::max);
        lens.fold().filter(|&fold| fold < farthest).map(|fold| fold * self.focal_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_the_stills_shape_fit() {
        let optics = Optics::ideal(Projection::Radial, [4000, 3000], 3000.0);
        assert!(optics.fits((1024, 768)) && optics.fits((1366, 1024)) && optics.fits((1366, 1025)));
        assert!(!optics.fits((1920, 1080)) && !optics.fits((3000, 4000)) && !optics.fits((1024, 770)));
    }

    #[test]
    fn a_smaller_picture_shows_the_same() {
        let k = [-0.2, 0.05, 0.0, 0.0];
        let optics =
            Optics { k, principal_px: [2030.0, 1490.0], ..Optics::ideal(Projection::Radial, [4000, 3000], 3000.0) };
        let (large, small) = (optics.lens(), optics.lens_over((400, 300)));
        let [a, b] = [large.direction([3210.0, 700.0]), small.direction([321.0, 70.0])].map(Option::unwrap);
        assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-12));
    }

    #[test]
    fn a_fold_within_the_still_is_told_and_one_beyond_is_not() {
        let bent = Optics { k: [-1.0 / 3.0, 0.0, 0.0, 0.0], ..Optics::ideal(Projection::Radial, [400, 300], 200.0) };
        assert!((bent.fold_px().unwrap() - 133.3).abs() < 0.5);
        assert_eq!(Optics { focal_px: 800.0, ..bent }.fold_px(), None);
        assert_eq!(Optics { max_angle_deg: 40.0, ..bent }.fold_px(), None);
    }
}
