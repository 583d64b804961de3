//! The camera as numbers that a fit may move, and how the picture of points depends on them.
//!
//! Distortion is counted at the corner of the still: `kappa_i = k_i t^(2i)`, `t` = half the still's diagonal over the focal
//! length, is the share by which the i-th term moves a point there. So one standard deviation means the same for a
//! telephoto and a wide lens.

use super::points::Point;
use super::threepoint::Stand;
use crate::camera::{Optics, Projection};
use glam::{DMat3, DVec3};
use relume_firmware::lens::Lens;

/// Moves of rotation (radians about the camera's axes), eye (in units of [`Model::scale_m`], world axes), logarithm of the
/// focal length, principal point (in still diagonals) and distortion at the corner.
pub type Moves = [f64; MOVES];
/// Number of [`Moves`].
pub const MOVES: usize = 13;
/// The first move that has a standard deviation beforehand.
pub const FOCAL: usize = 6;
/// The first move of the principal point.
pub const PRINCIPAL: usize = 7;
/// The first move of the distortion.
pub const KAPPA: usize = 9;
/// Steps for derivatives.
pub const STEP: f64 = 1e-6;

/// What is thought of a lens before any point is measured: standard deviations of [`Moves`] from [`FOCAL`] on, around a
/// focal length of the still's diagonal and a principal point in its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// In words.
    pub name: &'static str,
    /// Standard deviations.
    pub sigma: [f64; MOVES - FOCAL],
}

/// Lenses as they come. A fit takes the one under which its points are most probable.
pub const PRIORS: [Prior; 4] = [
    Prior { name: "hardly bent", sigma: [1.0, 0.002, 0.002, 0.003, 0.001, 0.0005, 0.0003] },
    Prior { name: "little bent", sigma: [1.0, 0.007, 0.007, 0.02, 0.005, 0.002, 0.001] },
    Prior { name: "bent", sigma: [1.0, 0.01, 0.01, 0.08, 0.025, 0.01, 0.004] },
    Prior { name: "strongly bent", sigma: [1.0, 0.02, 0.02, 0.3, 0.1, 0.04, 0.02] },
];

/// A camera with all that a fit may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// Where it stands.
    pub stand: Stand,
    /// Width and height of the still, px.
    pub size_px: [u32; 2],
    /// How an angle becomes a distance.
    pub projection: Projection,
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, px from the top left corner.
    pub principal_px: [f64; 2],
    /// Distortion at the corner.
    pub kappa: [f64; 4],
    /// The largest angle that is imaged, degrees.
    pub max_angle_deg: f64,
    /// A typical distance of the points from the eye, m.
    pub scale_m: f64,
}

/// Diagonal of a picture, px.
pub fn diagonal_px(size_px: [u32; 2]) -> f64 {
    f64::from(size_px[0]).hypot(f64::from(size_px[1]))
}

impl Model {
    /// Terms of distortion that the projection has.
    pub fn terms(&self) -> usize {
        match self.projection {
            Projection::Radial => 3,
            Projection::KannalaBrandt => 4,
        }
    }

    /// Number of moves that the projection has.
    pub fn moves(&self) -> usize {
        KAPPA + self.terms()
    }

    /// The lens as the camera file says it.
    pub fn optics(&self) -> Optics {
        let corner = 0.5 * diagonal_px(self.size_px) / self.focal_px;
        let mut k = self.kappa;
        k.iter_mut().enumerate().for_each(|(i, k)| *k /= corner.powi(2 * (i as i32 + 1)));
        k[self.terms()..].fill(0.0);
        let Model { size_px, focal_px, principal_px, projection, max_angle_deg, .. } = *self;
        Optics { size_px, focal_px, principal_px, projection, k, max_angle_deg }
    }

    /// The same camera with `optics` and `stand`; the inverse of [`Model::optics`].
    pub fn new(stand: Stand, optics: &Optics, scale_m: f64) -> Self {
        let corner = 0.5 * diagonal_px(optics.size_px) / optics.focal_px;
        let mut kappa = optics.k;
        kappa.iter_mut().enumerate().for_each(|(i, k)| *k *= corner.powi(2 * (i as i32 + 1)));
        let Optics { size_px, focal_px, principal_px, projection, max_angle_deg, .. } = *optics;
        Model { stand, size_px, projection, focal_px, principal_px, kappa, max_angle_deg, scale_m }
    }

    /// The camera moved; of a shorter list the rest stays.
    pub fn moved(&self, moves: &[f64]) -> Self {
        let at = |index: usize| moves.get(index).copied().unwrap_or(0.0);
        let turn = DVec3::new(at(0), at(1), at(2));
        let shift = DVec3::new(at(3), at(4), at(5)) * self.scale_m;
        let diagonal = diagonal_px(self.size_px);
        let mut kappa = self.kappa;
        kappa.iter_mut().enumerate().for_each(|(i, value)| *value += at(KAPPA + i));
        Model {
            stand: Stand {
                rotation: DMat3::from_quat(glam::DQuat::from_scaled_axis(turn)) * self.stand.rotation,
                eye: self.stand.eye + shift,
            },
            focal_px: self.focal_px * at(FOCAL).exp(),
            principal_px: std::array::from_fn(|c| self.principal_px[c] + diagonal * at(PRINCIPAL + c)),
            kappa,
            ..*self
        }
    }

    /// The camera prepared to project.
    pub fn projector(&self) -> Projector {
        Projector::new(self.stand, self.optics().lens())
    }

    /// How far the lens is from what `prior` expects, in its standard deviations, move by move from [`FOCAL`] on.
    pub fn unlikeliness(&self, prior: &Prior) -> impl Iterator<Item = f64> {
        let diagonal = diagonal_px(self.size_px);
        let focal = (self.focal_px / diagonal).ln();
        let [cx, cy]: [f64; 2] =
            std::array::from_fn(|c| (self.principal_px[c] - 0.5 * f64::from(self.size_px[c])) / diagonal);
        let [k1, k2, k3, k4] = self.kappa;
        let all = [focal, cx, cy, k1, k2, k3, k4];
        let sigma = prior.sigma;
        (0..self.moves() - FOCAL).map(move |index| all[index] / sigma[index])
    }

    /// Change of the picture position of `world` per move, px; none where it is not shown.
    pub fn slopes(&self, world: DVec3) -> Option<Vec<[f64; 2]>> {
        let shifted = |index: usize, by: f64| {
            let mut moves = [0.0; MOVES];
            moves[index] = by;
            self.moved(&moves).projector().project(world)
        };
        let slope = |index: usize| {
            let (low, high) = (shifted(index, -STEP)?, shifted(index, STEP)?);
            Some([0, 1].map(|c| (high[c] - low[c]) / (2.0 * STEP)))
        };
        (0..self.moves()).map(slope).collect()
    }

    /// The world direction from the eye through a picture position, px.
    pub fn dir_world(&self, position_px: [f64; 2]) -> Option<DVec3> {
        let dir = self.optics().lens().direction(position_px)?;
        Some(self.stand.rotation.transpose() * DVec3::from(dir))
    }

    /// Distances of points from the eye, m, ascending.
    pub fn distances_m(&self, points: &[Point]) -> Vec<f64> {
        let mut all: Vec<f64> = points.iter().map(|point| point.world.distance(self.stand.eye)).collect();
        all.sort_by(f64::total_cmp);
        all
    }
}

/// Projects points of the world.
#[derive(Clone, Copy, Debug)]
pub struct Projector {
    stand: Stand,
    lens: Lens,
}

impl Projector {
    /// Of a stand and the lens over the still.
    pub fn new(stand: Stand, lens: Lens) -> Self {
        Projector { stand, lens }
    }

    /// Picture position, px; none where the lens does not show `world`.
    pub fn project(&self, world: DVec3) -> Option<[f64; 2]> {
        self.lens.project((self.stand.rotation * (world - self.stand.eye)).to_array())
    }

    /// From where the still shows a point to where the camera would, px.
    pub fn residual(&self, point: &Point) -> Option<[f64; 2]> {
        let seen = self.project(point.world)?;
        Some([seen[0] - point.position_px[0], seen[1] - point.position_px[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distortion_at_the_corner_and_in_the_file_are_the_same_lens() {
        let k = [-0.21, 0.06, -0.01, 0.0];
        let optics = Optics { k, ..Optics::ideal(Projection::Radial, [1600, 1200], 1250.0) };
        let stand = Stand { rotation: DMat3::IDENTITY, eye: DVec3::ZERO };
        let model = Model::new(stand, &optics, 10.0);
        // Half the diagonal is 1000 px: t = 0.8.
        assert!((model.kappa[0] + 0.21 * 0.64).abs() < 1e-12 && (model.kappa[1] - 0.06 * 0.4096).abs() < 1e-12);
        let back = model.optics();
        assert!((0..4).all(|i| (back.k[i] - k[i]).abs() < 1e-12) && back.focal_px == optics.focal_px);
    }

    #[test]
    fn slopes_are_those_of_a_pinhole() {
        let stand = Stand { rotation: DMat3::IDENTITY, eye: DVec3::ZERO };
        let model = Model::new(stand, &Optics::ideal(Projection::Radial, [600, 800], 1000.0), 10.0);
        let slopes = model.slopes(DVec3::new(1.0, -0.5, 10.0)).unwrap();
        let near = |found: [f64; 2], wanted: [f64; 2]| {
            assert!((0..2).all(|c| (found[c] - wanted[c]).abs() < 1e-4), "{found:?} {wanted:?}");
        };
        // Seen at (100, -50) px from the axis: eye a unit of 10 m to the right, focal length by a factor e^1.
        near(slopes[3], [-1000.0, 0.0]);
        near(slopes[FOCAL], [100.0, -50.0]);
        near(slopes[PRINCIPAL], [1000.0, 0.0]);
        let share = (100.0f64.powi(2) + 50.0f64.powi(2)) / 500.0f64.powi(2);
        near(slopes[KAPPA], [100.0 * share, -50.0 * share]);
    }
}
