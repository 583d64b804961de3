//! Where a view disagrees with the field's receivers, and which part of the post that tells of.
//!
//! The view's gain is that of the loop ([`super::gain`]). What is left of each pixel's logarithm is looked at in two ways. Its
//! medians over cells of the picture are fitted by a plane and a bowl (Tukey's biweight): a lens that darkens towards its
//! corners, light that grows to one side. And the places where the receivers' own light changes sharply, such as edges of
//! shadows, are looked for in the neighbourhood: where the view shows them elsewhere, pose or lens are off.

use super::gain::{FINEST, MAD, REACH, ViewGain, tukey};
use crate::linear_system::solve;
use crate::quantile::median;

/// What a view should show: linear radiance of pixels that are nothing but receivers, without the virtual geometry, by pixel;
/// and what it shows there, linear, 1 = white. `None` where that tells nothing.
pub struct Compared {
    /// Pixels per row.
    pub width: usize,
    /// Radiance, red, green and blue.
    pub expected: Vec<Option<[f32; 3]>>,
    /// Light of the view.
    pub seen: Vec<Option<[f32; 3]>>,
}

/// How a view differs from the receivers in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// The view's gain and how single pixels scatter about it.
    pub gain: ViewGain,
    /// Pixels that were compared.
    pub pixels: usize,
    /// How it changes over the picture; `None` where receivers cover too little of it.
    pub trend: Option<Trend>,
    /// Where the view shows the sharp changes of the receivers' light; `None` where there are too few.
    pub shift: Option<Shift>,
}

/// Growth of the view's light over the receivers', natural logarithms, each with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trend {
    /// From the picture's middle to its right edge.
    pub right: (f64, f64),
    /// From the middle to the lower edge.
    pub down: (f64, f64),
    /// From the middle to the corners, on all sides alike.
    pub corners: (f64, f64),
}

/// The displacement at which the view fits the receivers best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// To the right and down, px.
    pub px: [f64; 2],
    /// What is left of the misfit there, as a share of that without displacement.
    pub left: f64,
    /// As far as was looked, px.
    pub reach_px: usize,
}

/// Cells that the picture is cut into, across and down.
const CELLS: (usize, usize) = (16, 12);
/// Pixels of a cell that have a median worth the name, and cells that a plane and a bowl are fitted to.
const CELL_PIXELS: usize = 6;
const FEWEST_CELLS: usize = 16;
const STEPS: usize = 12;

impl Disagreement {
    /// Of a view whose gain is known.
    pub fn of(gain: ViewGain, compared: &Compared) -> Self {
        let pixels = compared.seen.iter().zip(&compared.expected).filter(|(s, e)| s.is_some() && e.is_some()).count();
        Disagreement { gain, pixels, trend: trend(compared, gain.gain), shift: shift(compared) }
    }
}

impl Compared {
    fn height(&self) -> usize {
        self.expected.len() / self.width.max(1)
    }

    /// ln of seen over expected over gain of a pixel, mean of the channels.
    fn residual(&self, at: usize, gain: [f64; 3]) -> Option<f64> {
        let (seen, expected) = (self.seen[at]?, self.expected[at]?);
        let log = |c: usize| (f64::from(seen[c]) / f64::from(expected[c]) / gain[c]).ln();
        Some((log(0) + log(1) + log(2)) / 3.0)
    }
}

/// A cell's place, from -1 to 1 over the picture's width and height, and its median residual.
struct Cell {
    row: [f64; 4],
    residual: f64,
}

fn cells(compared: &Compared, gain: [f64; 3]) -> Vec<Cell> {
    let (width, height) = (compared.width, compared.height());
    let mut residuals = vec![Vec::new(); CELLS.0 * CELLS.1];
    for at in 0..compared.expected.len() {
        if let Some(residual) = compared.residual(at, gain) {
            let (x, y) = (at % width * CELLS.0 / width, at / width * CELLS.1 / height);
            residuals[y * CELLS.0 + x].push(residual);
        }
    }
    let middle = |index: usize, of: usize| (2 * index + 1) as f64 / of as f64 - 1.0;
    let diagonal2 = (width * width + height * height) as f64;
    let cell = |(index, own): (usize, &mut Vec<f64>)| {
        let (x, y) = (middle(index % CELLS.0, CELLS.0), middle(index / CELLS.0, CELLS.1));
        let radius2 = ((x * width as f64).powi(2) + (y * height as f64).powi(2)) / diagonal2;
        let residual = if own.len() < CELL_PIXELS { None } else { median(own) };
        residual.map(|residual| Cell { row: [1.0, x, y, radius2], residual })
    };
    residuals.iter_mut().enumerate().filter_map(cell).collect()
}

fn trend(compared: &Compared, gain: [f64; 3]) -> Option<Trend> {
    let cells = cells(compared, gain);
    if cells.len() < FEWEST_CELLS {
        return None;
    }
    let mut fitted = [0.0; 4];
    let mut inverse = [[0.0; 4]; 4];
    let mut scale = f64::INFINITY;
    for _ in 0..STEPS {
        let (mut a, mut b) = ([[0.0; 4]; 4], [[0.0; 1]; 4]);
        for cell in &cells {
            let weight = tukey((cell.residual - value(&fitted, &cell.row)) / (REACH * scale));
            for i in 0..4 {
                b[i][0] += weight * cell.row[i] * cell.residual;
                (0..4).for_each(|j| a[i][j] += weight * cell.row[i] * cell.row[j]);
            }
        }
        fitted = solve(a, b).map(|[value]| value);
        inverse = solve(a, std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j)))));
        let mut off: Vec<f64> = cells.iter().map(|cell| (cell.residual - value(&fitted, &cell.row)).abs()).collect();
        scale = (median(&mut off)? / MAD).max(FINEST);
    }
    let with_error = |k: usize| (fitted[k], scale * inverse[k][k].max(0.0).sqrt());
    let trend = Trend { right: with_error(1), down: with_error(2), corners: with_error(3) };
    let is_known = |(value, error): (f64, f64)| value.is_finite() && error.is_finite();
    [trend.right, trend.down, trend.corners].into_iter().all(is_known).then_some(trend)
}

fn value(fitted: &[f64; 4], row: &[f64; 4]) -> f64 {
    (0..4).map(|k| fitted[k] * row[k]).sum()
}

/// Natural logarithm by which receivers change from a pixel to its neighbours where they are sharp.
const SHARP: f64 = 0.2;
/// Fewest and most such places.
const PLACES: (usize, usize) = (64, 4096);
/// Share of the picture's width that is looked about in, and bounds of it, px.
const LOOK: f64 = 1.0 / 64.0;
const LOOK_PX: (usize, usize) = (4, 24);
/// Misfits are held to this, natural logarithm: what stands in front fits nowhere.
const HELD: f64 = 0.5;

/// Places at which the receivers' green light changes sharply, with its logarithm: whole receivers all around.
fn sharp_places(compared: &Compared) -> Vec<(usize, f64)> {
    let (width, height) = (compared.width, compared.height());
    let log = |at: usize| compared.expected[at].map(|rgb| f64::from(rgb[1]).ln());
    let mut places = Vec::new();
    for y in 1..height.saturating_sub(1) {
        for at in y * width + 1..(y + 1) * width - 1 {
            let [Some(own), Some(left), Some(right), Some(above), Some(below)] =
                [at, at - 1, at + 1, at - width, at + width].map(log)
            else {
                continue;
            };
            let around = [own, left, right, above, below];
            let high = around.into_iter().fold(f64::NEG_INFINITY, f64::max);
            let low = around.into_iter().fold(f64::INFINITY, f64::min);
            if high - low > SHARP {
                places.push((at, own));
            }
        }
    }
    let step = places.len().div_ceil(PLACES.1).max(1);
    places.into_iter().step_by(step).collect()
}

fn shift(compared: &Compared) -> Option<Shift> {
    let places = sharp_places(compared);
    if places.len() < PLACES.0 {
        return None;
    }
    let reach = ((compared.width as f64 * LOOK) as usize).clamp(LOOK_PX.0, LOOK_PX.1);
    let side = 2 * reach + 1;
    let seen: Vec<Option<f64>> = compared.seen.iter().map(|rgb| rgb.map(|rgb| f64::from(rgb[1]).ln())).collect();
    let mut logs = Vec::with_capacity(places.len());
    let misfits: Vec<f64> = (0..side * side)
        .map(|k| {
            let offset = [(k % side) as isize - reach as isize, (k / side) as isize - reach as isize];
            misfit(compared.width, &seen, (&places, offset), &mut logs)
        })
        .collect();
    let best = (0..misfits.len()).min_by(|&a, &b| misfits[a].total_cmp(&misfits[b]))?;
    let here = misfits[reach * side + reach];
    let (x, y) = (best % side, best / side);
    let refined = |at: usize, index: usize, step: usize| {
        let inside = at > 0 && at + 1 < side;
        let part = if inside { vertex([misfits[index - step], misfits[index], misfits[index + step]]) } else { 0.0 };
        at as f64 - reach as f64 + part
    };
    let left = if here > 0.0 { misfits[best] / here } else { 1.0 };
    Some(Shift { px: [refined(x, best, 1), refined(y, best, side)], left, reach_px: reach })
}

/// Mean misfit of the places if the view shows them by `offset` (right, down) from where they should be.
fn misfit(
    width: usize,
    seen: &[Option<f64>],
    (places, offset): (&[(usize, f64)], [isize; 2]),
    logs: &mut Vec<f64>,
) -> f64 {
    logs.clear();
    let mut lost = 0usize;
    for &(at, expected) in places {
        let column = (at % width) as isize + offset[0];
        let place = at as isize + offset[0] + offset[1] * width as isize;
        let is_inside = (0..width as isize).contains(&column) && (0..seen.len() as isize).contains(&place);
        match seen.get(place.max(0) as usize).copied().flatten().filter(|_| is_inside) {
            Some(log) => logs.push(log - expected),
            None => lost += 1,
        }
    }
    // The median that `quantile` gives leaves the others in another order only.
    let Some(middle) = median(logs) else { return HELD };
    let sum: f64 = logs.iter().map(|log| (log - middle).abs().min(HELD)).sum();
    (sum + lost as f64 * HELD) / places.len() as f64
}

/// Where a parabola through three values, one apart, is lowest: from -0.5 to 0.5 around the middle one.
fn vertex([before, at, after]: [f64; 3]) -> f64 {
    let bend = before - 2.0 * at + after;
    if bend > 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (160, 100);

    /// Ground with the shadows of posts on it; the view sees it by `offset` elsewhere, `light` times as bright.
    fn compared(offset: [f64; 2], light: impl Fn(f64, f64) -> f64) -> Compared {
        let ground = |x: f64, y: f64| {
            let stripe = (0.21 * x + 0.05 * y).sin().mul_add(8.0, -3.0).clamp(-1.0, 1.0);
            let across = (0.17 * y - 0.04 * x).sin().mul_add(8.0, -3.0).clamp(-1.0, 1.0);
            (0.5 - 0.15 * stripe - 0.15 * across) as f32
        };
        let at = |k: usize| ((k % SIZE.0) as f64, (k / SIZE.0) as f64);
        let noise = |k: usize| 1.0 + 0.05 * ((k.wrapping_mul(2_654_435_761) >> 7) % 1000) as f64 / 1000.0;
        let is_ground = |k: usize| k / SIZE.0 > 20;
        let expected = (0..SIZE.0 * SIZE.1).map(|k| is_ground(k).then(|| [ground(at(k).0, at(k).1); 3])).collect();
        let seen = |k: usize| {
            let (x, y) = at(k);
            let share = [2.0 * x / SIZE.0 as f64 - 1.0, 2.0 * y / SIZE.1 as f64 - 1.0];
            let value = f64::from(ground(x - offset[0], y - offset[1])) * light(share[0], share[1]) * noise(k);
            [value as f32; 3]
        };
        Compared { width: SIZE.0, expected, seen: (0..SIZE.0 * SIZE.1).map(|k| Some(seen(k))).collect() }
    }

    fn found(offset: [f64; 2], light: impl Fn(f64, f64) -> f64) -> Disagreement {
        let gain = ViewGain { gain: [1.025; 3], scatter: 0.05 };
        Disagreement::of(gain, &compared(offset, light))
    }

    #[test]
    fn a_view_that_agrees_has_no_trend_and_no_shift() {
        let Disagreement { trend: Some(trend), shift: Some(shift), pixels, .. } = found([0.0; 2], |_, _| 1.0) else {
            panic!("cannot tell")
        };
        assert_eq!(pixels, 79 * SIZE.0);
        assert!([trend.right, trend.down, trend.corners].iter().all(|(value, _)| value.abs() < 0.01), "{trend:?}");
        assert!(shift.px.iter().all(|px| px.abs() < 0.1) && shift.left == 1.0, "{shift:?}");
    }

    #[test]
    fn a_shift_is_found_to_a_quarter_of_a_pixel() {
        for (offset, most_left) in [([2.0, 0.0], 0.3), ([-1.0, 3.0], 0.3), ([0.5, -1.5], 0.85)] {
            let shift = found(offset, |_, _| 1.0).shift.unwrap();
            let is_near = (0..2).all(|k| (shift.px[k] - offset[k]).abs() < 0.25);
            assert!(is_near && shift.left < most_left, "{offset:?} {shift:?}");
        }
    }

    #[test]
    fn vignetting_and_a_slope_are_told_apart() {
        let radius2 = |x: f64, y: f64| (2.56 * x * x + y * y) / 3.56;
        let bowl = found([0.0; 2], |x, y| (-0.3 * radius2(x, y)).exp()).trend.unwrap();
        let near = |(value, error): (f64, f64), wanted: f64| (value - wanted).abs() < 0.02 && error < 0.03;
        assert!(near(bowl.corners, -0.3) && near(bowl.right, 0.0) && near(bowl.down, 0.0), "{bowl:?}");
        let slope = found([0.0; 2], |x, y| (0.2 * x - 0.1 * y).exp()).trend.unwrap();
        assert!(near(slope.corners, 0.0) && near(slope.right, 0.2) && near(slope.down, -0.1), "{slope:?}");
    }

    #[test]
    fn smooth_ground_tells_no_shift_and_little_of_it_no_trend() {
        let mut smooth = compared([0.0; 2], |_, _| 1.0);
        smooth.expected.iter_mut().flatten().for_each(|rgb| *rgb = [0.4; 3]);
        let gain = ViewGain { gain: [1.0; 3], scatter: 0.05 };
        assert_eq!(Disagreement::of(gain, &smooth).shift, None);
        smooth.expected.iter_mut().enumerate().filter(|(k, _)| k % SIZE.0 > 8).for_each(|(_, rgb)| *rgb = None);
        assert_eq!(Disagreement::of(gain, &smooth).trend, None);
    }
}
