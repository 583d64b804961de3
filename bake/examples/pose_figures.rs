//! How well `relume-bake camera` finds pose and lens: `cargo run --release -p relume-bake --example pose_figures -- SEED COUNT [POINTS]`.
//!
//! Cameras of three kinds are drawn at random; each sees twelve places (or POINTS, a multiple of 12), one in each of 4 x 3 parts of its still and
//! 0.6 to 1.6 times as far as the site, where they are clicked with 0.5 px of noise in each axis. The table holds what the fit is off
//! against the true camera, and beside it what an estimator that reaches the bound of Cramer and Rao would be off in the
//! same set-ups: one that knows how the lenses were drawn, and one that knows the lens but for its focal length.

use glam::{DMat3, DVec3};
use relume_bake::camera::{Optics, Projection};
use relume_bake::pose::doubt::{covariance, places};
use relume_bake::pose::model::{KAPPA, MOVES, Model, Prior, diagonal_px};
use relume_bake::pose::points::Point;
use relume_bake::pose::{Options, Stand, fit};
use std::process::ExitCode;

const NOISE_PX: f64 = 0.5;
/// The goals: px, degrees, share of the distance.
const GOALS: [f64; 3] = [0.5, 0.1, 0.002];

/// Xorshift64* (Vigna 2016).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (std::f64::consts::TAU * self.unit()).cos()
    }
}

/// How lenses of a kind are drawn.
struct Kind {
    name: &'static str,
    projection: Projection,
    /// Half the diagonal over the focal length.
    corner: [f64; 2],
    /// Mean and standard deviation of the distortion at the corner.
    kappa: [[f64; 2]; 4],
}

/// Standard deviation of the principal point, diagonals.
const PRINCIPAL: f64 = 0.004;

const KINDS: [Kind; 3] = [
    Kind {
        name: "ordinary",
        projection: Projection::Radial,
        corner: [0.35, 0.8],
        kappa: [[0.0, 0.03], [0.0, 0.006], [0.0, 0.001], [0.0, 0.0]],
    },
    Kind {
        name: "wide",
        projection: Projection::Radial,
        corner: [0.9, 1.3],
        kappa: [[-0.15, 0.06], [0.025, 0.012], [0.0, 0.004], [0.0, 0.0]],
    },
    Kind {
        name: "fisheye",
        projection: Projection::KannalaBrandt,
        corner: [1.3, 1.75],
        kappa: [[0.0, 0.04], [0.0, 0.01], [0.0, 0.003], [0.0, 0.001]],
    },
];

impl Kind {
    fn camera(&self, random: &mut Random) -> Model {
        let width = random.within(1600.0, 6000.0) as u32;
        let size_px = [width, width * 3 / 4];
        let focal_px = 0.5 * diagonal_px(size_px) / random.within(self.corner[0], self.corner[1]);
        let yaw = DMat3::from_rotation_y(random.within(0.0, std::f64::consts::TAU));
        let tilt = DMat3::from_rotation_x(random.within(-0.2, 0.3)) * DMat3::from_rotation_z(0.03 * random.normal());
        // A level camera's axes: right +X, down -Y, forward -Z.
        let level = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        let rotation = (yaw * tilt * level).transpose();
        let eye = DVec3::new(random.within(-50.0, 50.0), 1.7, random.within(-50.0, 50.0));
        let ideal = Optics::ideal(self.projection, size_px, focal_px);
        let mut model = Model::new(Stand { rotation, eye }, &ideal, random.within(15.0, 60.0));
        let [dx, dy] = [0; 2].map(|_| PRINCIPAL * diagonal_px(size_px) * random.normal());
        model.principal_px = [ideal.principal_px[0] + dx, ideal.principal_px[1] + dy];
        model.kappa = self.kappa.map(|[mean, sigma]| mean + sigma * random.normal());
        model
    }

    /// The distribution that lenses are drawn from; a lens that is known but for its focal length.
    fn priors(&self) -> [Prior; 2] {
        let mut drawn = [1.0, PRINCIPAL, PRINCIPAL, 0.0, 0.0, 0.0, 0.0];
        (0..4).for_each(|i| drawn[KAPPA - 6 + i] = self.kappa[i][1].max(1e-9));
        let known = [1.0, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9];
        [Prior { name: "drawn", sigma: drawn }, Prior { name: "known", sigma: known }]
    }
}

fn measured(truth: &Model, count: usize, random: &mut Random) -> Option<Vec<Point>> {
    let [width, height] = truth.size_px.map(f64::from);
    let mut points = Vec::new();
    for index in 0..count {
        let (column, row) = ((index % 4) as f64, (index / 4 % 3) as f64);
        let at = [width * (column + random.unit()) / 4.0, height * (row + random.unit()) / 3.0];
        let distance = truth.scale_m * (0.6f64.ln() + random.unit() * (1.6f64 / 0.6).ln()).exp();
        let world = truth.stand.eye + truth.dir_world(at)? * distance;
        let noisy = at.map(|px| px + NOISE_PX * random.normal());
        let position_px = [noisy[0].clamp(0.0, width), noisy[1].clamp(0.0, height)];
        points.push(Point { line: points.len() + 1, position_px, world });
    }
    Some(points)
}

/// Off by: picture (rms, worst; px), orientation (degrees), position (share of the distance).
fn off(truth: &Model, found: &Model, points: &[Point]) -> [f64; 4] {
    let (a, b) = (truth.projector(), found.projector());
    let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0f64);
    for place in places(truth, points) {
        let (Some(a), Some(b)) = (a.project(place), b.project(place)) else { continue };
        let squared = (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        sum += squared;
        count += 1.0;
        worst = worst.max(squared);
    }
    let turn = truth.stand.rotation * found.stand.rotation.transpose();
    let sine = DVec3::new(turn.y_axis.z - turn.z_axis.y, turn.z_axis.x - turn.x_axis.z, turn.x_axis.y - turn.y_axis.x);
    let distances = truth.distances_m(points);
    let moved = truth.stand.eye.distance(found.stand.eye) / distances[distances.len() / 2];
    [(sum / f64::max(count, 1.0)).sqrt(), worst.sqrt(), (0.5 * sine.length()).min(1.0).asin().to_degrees(), moved]
}

/// One column of the table: rows as [`off`] has them, one per set-up.
#[derive(Default)]
struct Column(Vec<[f64; 4]>);

impl Column {
    fn quantile(&self, index: usize, share: f64) -> f64 {
        let mut all: Vec<f64> = self.0.iter().map(|row| row[index]).collect();
        all.sort_by(f64::total_cmp);
        all[((all.len() - 1) as f64 * share).round() as usize]
    }

    /// Share of the set-ups that meet the goals for picture, orientation and position, and all three, percent.
    fn meets(&self) -> [f64; 4] {
        let is_met = |row: &[f64; 4]| [row[0] <= GOALS[0], row[2] <= GOALS[1], row[3] <= GOALS[2]];
        let share = |of: &dyn Fn([bool; 3]) -> bool| {
            100.0 * self.0.iter().filter(|row| of(is_met(row))).count() as f64 / self.0.len() as f64
        };
        [share(&|met| met[0]), share(&|met| met[1]), share(&|met| met[2]), share(&|met| met == [true; 3])]
    }

    fn print(&self, name: &str) {
        let pair = |index: usize, times: f64| [0.5, 1.0].map(|share| times * self.quantile(index, share));
        let [[a, b], [c, d], [e, f], [g, h]] = [pair(0, 1.0), pair(1, 1.0), pair(2, 1.0), pair(3, 100.0)];
        let [picture, turn, place, all] = self.meets();
        println!(
            "  {name:28} {a:6.2} {b:6.2}   {c:6.2} {d:7.2}   {e:6.3} {f:6.3}   {g:6.3} {h:6.3}   {picture:4.0} {turn:4.0} {place:4.0} {all:4.0}"
        );
    }
}

/// Errors of estimators that reach the bound, drawn around the truth.
fn efficient(truth: &Model, points: &[Point], prior: &Prior, random: &mut Random, column: &mut Column) {
    let Some(bound) = covariance(truth, points, NOISE_PX, prior) else { return };
    for _ in 0..8 {
        let normal: Vec<f64> = (0..MOVES).map(|_| random.normal()).take(truth.moves()).collect();
        let Some(moves) = bound.drawn(&normal) else { return };
        column.0.push(off(truth, &truth.moved(&moves), points));
    }
}

fn study(kind: &Kind, random: &mut Random, (count, of_points): (usize, usize)) {
    let (mut fitted, mut bounds) = (Column::default(), [Column::default(), Column::default()]);
    let (mut failed, mut dropped, mut calibration, mut found_strays) = (0, 0, [0.0; 3], [0, 0, 0]);
    while fitted.0.len() + failed < count {
        let truth = kind.camera(random);
        // Nobody builds a lens that bends so much that its model turns back just beyond the still.
        let corner_px = 0.6 * diagonal_px(truth.size_px);
        if truth.optics().lens().fold().is_some_and(|fold| fold * truth.focal_px < corner_px) {
            continue;
        }
        let Some(points) = measured(&truth, of_points, random) else { continue };
        for (prior, column) in kind.priors().iter().zip(&mut bounds) {
            efficient(&truth, &points, prior, random, column);
        }
        let Ok(found) = fit(&points, truth.size_px, &Options::default()) else {
            failed += 1;
            continue;
        };
        let errors = off(&truth, &found.model, &points);
        fitted.0.push(errors);
        dropped += found.strays().count();
        let expected = [found.doubt.picture_px, found.doubt.orientation_deg, found.doubt.position_m / truth.scale_m];
        for (sum, (error, expected)) in
            calibration.iter_mut().zip([errors[0], errors[2], errors[3]].iter().zip(expected))
        {
            *sum += (error / expected).powi(2);
        }
        strays(&truth, points, random, &mut found_strays);
    }
    println!("{} ({count} set-ups; {failed} without a fit; {dropped} good points dropped)", kind.name);
    fitted.print("fit");
    bounds[0].print("bound, lenses known as drawn");
    bounds[1].print("bound, lens known");
    let [a, b, c] = calibration.map(|sum| (sum / fitted.0.len().max(1) as f64).sqrt());
    println!("  error over standard error, rms: picture {a:.2}, orientation {b:.2}, position {c:.2}");
    let [both, one, wrong] = found_strays;
    println!(
        "  two points moved by 10 to 60 px: both named {both}, one {one}, good points named {wrong}, of {count}\n"
    );
}

/// Moves two points and counts whether the fit names them.
fn strays(truth: &Model, mut points: Vec<Point>, random: &mut Random, found: &mut [usize; 3]) {
    let count = points.len();
    let first = (random.unit() * count as f64) as usize % count;
    let moved = [first, (first + 1 + (random.unit() * (count - 1) as f64) as usize % (count - 1)) % count];
    for index in moved {
        let (sin, cos) = random.within(0.0, std::f64::consts::TAU).sin_cos();
        let by = random.within(10.0, 60.0);
        let [u, v] = points[index].position_px;
        points[index].position_px = [u + by * cos, v + by * sin];
    }
    let Ok(fitted) = fit(&points, truth.size_px, &Options::default()) else { return };
    let named: Vec<usize> = fitted.strays().map(|seen| seen.point.line - 1).collect();
    let right = moved.iter().filter(|index| named.contains(index)).count();
    found[0] += usize::from(right == 2);
    found[1] += usize::from(right == 1);
    found[2] += named.iter().filter(|index| !moved.contains(index)).count();
}

fn main() -> ExitCode {
    let numbers: Option<Vec<u64>> = std::env::args().skip(1).map(|text| text.parse().ok()).collect();
    let (seed, count, points) = match numbers.as_deref() {
        Some(&[seed, count]) => (seed, count as usize, 12),
        Some(&[seed, count, points]) if points >= 12 => (seed, count as usize, points as usize),
        _ => {
            eprintln!("pose_figures SEED COUNT [POINTS]");
            return ExitCode::from(2);
        }
    };
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    (0..16).for_each(|_| _ = random.unit());
    println!(
        "{points} points, {NOISE_PX} px of noise; goals: picture {} px (rms), orientation {} degrees, position {} %",
        GOALS[0],
        GOALS[1],
        100.0 * GOALS[2]
    );
    println!(
        "  {:28} {:>13}   {:>14}   {:>13}   {:>13}   {:>19}",
        "median and worst", "picture px", "its worst px", "orient. deg", "position %", "meets them, all, %"
    );
    for kind in &KINDS {
        study(kind, &mut random, (count, points));
    }
    ExitCode::SUCCESS
}
