//! Patches that outshine what the prior of skies expects.
//!
//! The factors are good for light that the prior's modes ([`crate::bound`]) make up. What one patch shines beyond what
//! they would give it, fitted to all other patches, is its excess: that is shown by the patch's own rows, and only what was
//! expected goes through the factors.

use super::{Apart, MAX_PADDED};
use crate::bound::{BOUND_MODES, Bounds};
use crate::kernel::{Kernel, Loops};

/// Most patches that stand out of an ordinary sky.
pub const MAX_STANDOUTS: usize = 16;
/// A patch stands out of it when its excess is this many times the patches' mean radiance.
pub const EXCESS_TIMES_MEAN: f32 = 1.5;
/// Most patches that [`standouts`] can name.
pub const MOST_STANDOUTS: usize = 96;
/// Share of its excess that a patch may lose to the modes while they are fitted to it, too.
const LEAST_LEFT: f32 = 0.5;
/// How often what stands out is looked for.
const LOOKS: usize = 4;
/// Steps in which an excess is solved for, at most, and what is left of the right side then, squared.
const STEPS: usize = 16;
const SOLVED: f32 = 1e-8;

/// Patches that outshine what is expected of them by more than `times_mean` times the mean radiance: as many as `out` has
/// room for and no more than [`MOST_STANDOUTS`], ascending, with their excess in radiance. Returns how many of `out` were
/// written.
pub fn standouts(
    bounds: &Bounds<'_>,
    radiance_linear: &[[f32; 3]],
    times_mean: f32,
    kernel: Kernel,
    out: &mut [Apart],
) -> usize {
    let bright = |rgb: &[f32; 3]| rgb[0].max(rgb[1]).max(rgb[2]);
    let sum = radiance_linear.iter().map(|rgb| f64::from(bright(rgb))).sum::<f64>();
    let mean = (sum / radiance_linear.len().max(1) as f64) as f32;
    let least = times_mean * mean;
    // An excess is part of the radiance: many skies need no more than this.
    let may_stand_out = mean.is_normal() && least.is_finite() && radiance_linear.iter().any(|rgb| bright(rgb) > least);
    if !may_stand_out || radiance_linear.len() != bounds.patches() {
        return 0;
    }
    let mut plain = [[0.0; MAX_PADDED]; 3];
    for (patch, rgb) in radiance_linear.iter().enumerate() {
        (0..3).for_each(|c| plain[c][patch] = rgb[c] / mean);
    }
    kernel.widely(TakeModes { bounds, light: &mut plain });
    let chosen = choose(bounds, &plain, (times_mean, out.len()), kernel);
    for (k, out) in out.iter_mut().enumerate().take(chosen.count) {
        let most = radiance_linear[usize::from(chosen.patches[k])];
        let excess = |c: usize| (chosen.excess[c][k] * mean).max(0.0).min(most[c]);
        *out = Apart { patch: chosen.patches[k], light: core::array::from_fn(excess) };
    }
    chosen.count
}

/// Light per patch, `[channel][patch]`, in units of its mean.
type Light = [[f32; MAX_PADDED]; 3];

/// The patches that stand out, `most` at most, and by how much; `plain` is what no mode has of the light.
fn choose(bounds: &Bounds<'_>, plain: &Light, (times_mean, most): (f32, usize), kernel: Kernel) -> Chosen {
    let brightest = |light: &Light| Chosen::brightest(bounds.patches(), light, (LEAST_LEFT * times_mean, most));
    // What stands out hides its neighbours, because the modes are fitted to it, too: it is taken away to look again.
    let mut chosen = brightest(plain);
    for _ in 1..LOOKS {
        chosen.solve(bounds, plain);
        let mut beyond = *plain;
        kernel.widely(AddModes { bounds, chosen: &chosen, light: &mut beyond });
        let again = brightest(&beyond);
        if again.patches[..again.count] == chosen.patches[..chosen.count] {
            break;
        }
        chosen = again;
    }
    // Whenever some fall out, the modes are fitted to them again.
    loop {
        chosen.solve(bounds, plain);
        if !chosen.drop_below(times_mean) {
            return chosen;
        }
    }
}

/// Leaves of a light what no mode has.
struct TakeModes<'a> {
    bounds: &'a Bounds<'a>,
    light: &'a mut Light,
}

impl Loops for TakeModes<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        for light in self.light.iter_mut() {
            self.bounds.take_modes(&mut light[..self.bounds.patches()], |_, _| {});
        }
    }
}

/// Adds what the modes have of the chosen patches' excess: to what a plain fit leaves, so that it becomes what a fit without
/// that excess leaves, and the excess itself where it is.
struct AddModes<'a> {
    bounds: &'a Bounds<'a>,
    chosen: &'a Chosen,
    light: &'a mut Light,
}

impl Loops for AddModes<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let patches = &self.chosen.patches[..self.chosen.count];
        for (light, excess) in self.light.iter_mut().zip(&self.chosen.excess) {
            for k in 0..self.bounds.modes() {
                let at = |(patch, excess): (&u16, &f32)| self.bounds.mode_at(k, usize::from(*patch)) * excess;
                self.bounds.add_mode(k, patches.iter().zip(excess).map(at).sum(), light);
            }
        }
    }
}

/// Patches that may stand out, ascending.
struct Chosen {
    patches: [u16; MOST_STANDOUTS],
    count: usize,
    /// How much more light each has than is expected, `[channel][chosen]`.
    excess: [[f32; MOST_STANDOUTS]; 3],
}

impl Chosen {
    /// The brightest above `least`, `most` at most.
    fn brightest(patches: usize, light: &Light, (least, most): (f32, usize)) -> Self {
        let most = most.min(MOST_STANDOUTS);
        let mut found = [(0.0f32, 0u16); MOST_STANDOUTS];
        let mut count = 0;
        let [red, green, blue] = light;
        let all = red.iter().zip(green).zip(blue).map(|((r, g), b)| r.max(*g).max(*b)).take(patches);
        for (patch, own) in all.enumerate().filter(|&(_, own)| own > least) {
            let at = found[..count].iter().position(|&(other, _)| other < own).unwrap_or(count);
            if at < most {
                let last = count.min(most - 1);
                found.copy_within(at..last, at + 1);
                found[at] = (own, patch as u16);
                count = last + 1;
            }
        }
        let mut patches = found.map(|(_, patch)| patch);
        patches[..count].sort_unstable();
        Chosen { patches, count, excess: [[0.0; MOST_STANDOUTS]; 3] }
    }

    /// Drops those whose excess is no more than `least`; were there any?
    fn drop_below(&mut self, least: f32) -> bool {
        let before = self.count;
        self.count = 0;
        for k in 0..before {
            if (0..3).any(|c| self.excess[c][k] > least) {
                self.patches[self.count] = self.patches[k];
                self.count += 1;
            }
        }
        self.count < before
    }

    /// Finds how much more each has than modes fitted to all patches but these would give it; `plain` is what modes fitted
    /// to all leave.
    ///
    /// With `H = Z Z^T` over orthonormal modes `Z` that is `plain = (1 - H) light`. What is fitted without the chosen
    /// ones leaves `x` of them where `(1 - H_SS) x = plain_S` (deletion residuals: Cook and Weisberg, Residuals and
    /// Influence in Regression, 1982, section 2.2), here by conjugate gradients: where the modes could make up the chosen
    /// ones alone, the first steps leave that to them.
    fn solve(&mut self, bounds: &Bounds<'_>, plain: &Light) {
        let (patches, count) = (&self.patches[..self.count], self.count);
        let mut modes = [[0.0f32; MOST_STANDOUTS]; BOUND_MODES];
        for (k, mode) in modes.iter_mut().enumerate().take(bounds.modes()) {
            mode.iter_mut().zip(patches).for_each(|(mode, &patch)| *mode = bounds.mode_at(k, usize::from(patch)));
        }
        let modes = &modes[..bounds.modes()];
        for (excess, plain) in self.excess.iter_mut().zip(plain) {
            let mut left = [0.0f32; MOST_STANDOUTS];
            left.iter_mut().zip(patches).for_each(|(left, &patch)| *left = plain[usize::from(patch)]);
            let mut way = left;
            *excess = [0.0; MOST_STANDOUTS];
            let mut size = square(&left[..count]);
            let enough = SOLVED * size;
            for _ in 0..STEPS {
                let turned = without_modes(modes, &way, count);
                let along = way[..count].iter().zip(&turned).map(|(a, b)| a * b).sum::<f32>();
                if size <= enough || along <= 0.0 {
                    break;
                }
                let step = size / along;
                for k in 0..count {
                    excess[k] += step * way[k];
                    left[k] -= step * turned[k];
                }
                let before = core::mem::replace(&mut size, square(&left[..count]));
                way.iter_mut().zip(&left).for_each(|(way, left)| *way = left + size / before * *way);
            }
        }
    }
}

/// `(1 - H_SS) x`.
fn without_modes(modes: &[[f32; MOST_STANDOUTS]], x: &[f32; MOST_STANDOUTS], count: usize) -> [f32; MOST_STANDOUTS] {
    // What lies beyond them is 0.
    let (mut out, groups) = (*x, count.div_ceil(8));
    let (x, _) = x.as_chunks::<8>();
    for mode in modes {
        let (mode, _) = mode.as_chunks::<8>();
        let mut lanes = [0.0f32; 8];
        for (mode, x) in mode[..groups].iter().zip(x) {
            (0..8).for_each(|k| lanes[k] += mode[k] * x[k]);
        }
        let part: f32 = lanes.iter().sum();
        for (out, mode) in out.as_chunks_mut::<8>().0.iter_mut().zip(&mode[..groups]) {
            (0..8).for_each(|k| out[k] -= part * mode[k]);
        }
    }
    out
}

fn square(x: &[f32]) -> f32 {
    x.iter().map(|v| v * v).sum()
}
