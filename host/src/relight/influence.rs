//! How much light each patch brings to any pixel of a block at most: what tells that all tiles of a block may stay before
//! anything is projected for it.
//!
//! Response is not negative, so that when the light of the patches moves by `d_i`, no pixel of the block moves further up than
//! `sum_i max_x R_x(i) max(d_i, 0)`, nor further down than the same of `-d_i`. That holds for the uncompressed response, which
//! the way back brackets ([`relume_firmware::wayback::RowFacts::most`]), plain as well as over row scale: whatever the error of
//! what is shown was under the light of then, it has grown by no more than this.

use super::tiles::TileState;
use relume_firmware::coefficients::Sides;
use relume_firmware::field::Field;
use relume_firmware::kernel::{Kernel, Loops};
use relume_firmware::tile::{LANE_PAD, Tile, padded};

/// Most light that counts; more is as good as any.
const MAX_LIGHT: f32 = (1u128 << 80) as f32;
/// More than single precision loses of the products and in a sum over all patches.
const LOSS: f32 = 1e-4;

/// The largest response of each block to each patch.
pub(super) struct Influence {
    /// `[block][channel][padded patch]`, the upper half of an f32, rounded up.
    largest: Vec<u16>,
    /// Values of a channel.
    stride: usize,
}

impl Influence {
    /// Of all blocks; `None` where the field has no way back to tell it.
    pub(super) fn new(field: &Field<'_>, (tiles, states): (&[Tile<'_>], &[TileState])) -> Option<Self> {
        let stride = padded(field.patch_set().len());
        let mut influence = Influence { largest: vec![0; field.response().blocks() * 3 * stride], stride };
        for (block, largest) in influence.largest.chunks_exact_mut(3 * stride).enumerate() {
            for index in field.response().tiles_of(block).filter(|&index| !states[index].empty) {
                widen(field, &tiles[index], largest)?;
            }
        }
        Some(influence)
    }

    /// How far any pixel of a block has moved from the light of `then` to that of `now`, at most, per channel.
    pub(super) fn moved(&self, block: usize, (then, now): (&[f32], &[f32]), kernel: Kernel) -> [Sides; 3] {
        let largest = &self.largest[3 * self.stride * block..][..3 * self.stride];
        kernel.widely(Moved { largest, then, now })
    }
}

/// Takes the responses of a tile into those of its block; `None` if they are not known.
fn widen(field: &Field<'_>, tile: &Tile<'_>, largest: &mut [u16]) -> Option<()> {
    let stride = largest.len() / 3;
    for patch in 0..field.patch_set().len() {
        let most = field.way_back().get(tile, patch)?.facts().most();
        for c in 0..3 {
            let value = &mut largest[c * stride + patch];
            *value = (*value).max(upper_half(most * tile.row_top(c)));
        }
    }
    Some(())
}

/// The upper half of a number that is not negative, rounded up; finite.
fn upper_half(value: f32) -> u16 {
    (value.min(MAX_LIGHT).to_bits().saturating_add(0xffff) >> 16) as u16
}

/// [`Influence::moved`].
struct Moved<'a> {
    largest: &'a [u16],
    then: &'a [f32],
    now: &'a [f32],
}

impl Loops for Moved<'_> {
    type Out = [Sides; 3];

    #[inline(always)]
    fn run(self) -> [Sides; 3] {
        let stride = self.largest.len() / 3;
        let channel = |c: usize| c * stride..(c + 1) * stride;
        core::array::from_fn(|c| moved(&self.largest[channel(c)], &self.then[channel(c)], &self.now[channel(c)]))
    }
}

#[inline(always)]
fn moved(largest: &[u16], then: &[f32], now: &[f32]) -> Sides {
    let (mut up, mut net) = ([0.0f32; LANE_PAD], [0.0f32; LANE_PAD]);
    let steps = then.as_chunks::<LANE_PAD>().0.iter().zip(now.as_chunks::<LANE_PAD>().0);
    for (largest, (then, now)) in largest.as_chunks::<LANE_PAD>().0.iter().zip(steps) {
        for k in 0..LANE_PAD {
            let step = f32::from_bits(u32::from(largest[k]) << 16) * (now[k] - then[k]);
            net[k] += step;
            up[k] += if step > 0.0 { step } else { 0.0 };
        }
    }
    let (up, net) = (up.iter().sum::<f32>(), net.iter().sum::<f32>());
    // What the sums lose is a part of all that they add up.
    let loss = LOSS * (2.0 * up - net);
    Sides { down: up - net + loss, up: up + loss }
}

/// Moments whose light is remembered: a block that has stayed since an earlier one is projected anew.
const REMEMBERED: usize = 64;

/// The light of the newest moment, and of those before in which tiles were looked at.
pub(super) struct Lights {
    /// `[moment % REMEMBERED][channel][padded patch]`, radiance times exposure.
    values: Vec<f32>,
    /// Which moment's each is; 0: none.
    moments: [u64; REMEMBERED],
    newest: Vec<f32>,
}

impl Lights {
    /// Of a field of so many patches; nothing is known yet.
    pub(super) fn new(patches: usize) -> Self {
        let len = 3 * padded(patches);
        Lights { values: vec![0.0; REMEMBERED * len], moments: [0; REMEMBERED], newest: vec![0.0; len] }
    }

    /// Takes the light of a new moment.
    pub(super) fn set(&mut self, radiance: &[[f32; 3]], exposure: f32) {
        for (c, values) in self.newest.chunks_exact_mut(padded(radiance.len())).enumerate() {
            values.iter_mut().zip(radiance).for_each(|(value, rgb)| *value = (rgb[c] * exposure).min(MAX_LIGHT));
        }
    }

    pub(super) fn newest(&self) -> &[f32] {
        &self.newest
    }

    /// Remembers the newest light as that of `moment`.
    pub(super) fn remember(&mut self, moment: u64) {
        let slot = (moment % REMEMBERED as u64) as usize;
        if self.moments[slot] != moment {
            self.moments[slot] = moment;
            let len = self.newest.len();
            self.values[slot * len..(slot + 1) * len].copy_from_slice(&self.newest);
        }
    }

    /// The light of an earlier moment, if it is still known.
    pub(super) fn of(&self, moment: u64) -> Option<&[f32]> {
        let slot = (moment % REMEMBERED as u64) as usize;
        let len = self.newest.len();
        (self.moments[slot] == moment).then(|| &self.values[slot * len..(slot + 1) * len])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers between 0 and 1.
    fn scattered(seed: u64, len: usize) -> impl Iterator<Item = f32> {
        let mut state = seed;
        std::iter::repeat_with(move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        })
        .take(len)
    }

    #[test]
    fn no_sum_moves_further_and_the_bound_is_hardly_wider() {
        let stride = 48;
        for (kernel, seed) in Kernel::paths().flat_map(|kernel| (0..12u64).map(move |seed| (kernel, seed))) {
            let response: Vec<f32> = scattered(seed, 3 * stride).map(|r| r * r * r).collect();
            let largest = response.iter().map(|&r| upper_half(r)).collect();
            let influence = Influence { largest, stride };
            let then: Vec<f32> = scattered(seed + 100, 3 * stride).map(|l| 1e3 * l).collect();
            let steps = scattered(seed + 200, 3 * stride).map(|s| if seed % 3 == 0 { s } else { s - 0.5 });
            let now: Vec<f32> = then.iter().zip(steps).map(|(l, s)| (l + s).max(0.0)).collect();
            let sides = influence.moved(0, (&then, &now), kernel);
            for (c, sides) in sides.into_iter().enumerate() {
                let exact = |way: f64| -> f64 {
                    let range = c * stride..(c + 1) * stride;
                    let step = |at: usize| way * (f64::from(now[at]) - f64::from(then[at]));
                    range.map(|at| f64::from(response[at]) * step(at).max(0.0)).sum()
                };
                for (found, exact) in [(sides.up, exact(1.0)), (sides.down, exact(-1.0))] {
                    let found = f64::from(found);
                    assert!(found >= exact && found <= 1.01 * exact + 0.01, "{seed} {c}: {found} {exact}");
                }
            }
        }
    }

    #[test]
    fn upper_halves_are_above_and_near() {
        for value in scattered(1, 1000).map(|v| v * 1e-3).chain([0.0, 1.0, 1e30, f32::INFINITY]) {
            let found = f32::from_bits(u32::from(upper_half(value)) << 16);
            assert!(found.is_finite() && found >= value.min(MAX_LIGHT) && found <= value * 1.0079, "{value} {found}");
        }
    }

    #[test]
    fn lights_are_remembered_until_many_others_are() {
        let mut lights = Lights::new(16);
        lights.set(&[[1.0, 2.0, 3.0]; 16], 0.5);
        lights.remember(7);
        for moment in 8..7 + REMEMBERED as u64 {
            lights.set(&[[moment as f32; 3]; 16], 1.0);
            lights.remember(moment);
        }
        let known = lights.of(7).map(|light| [light[0], light[16], light[32]]);
        assert_eq!(known, Some([0.5, 1.0, 1.5]));
        lights.remember(7 + REMEMBERED as u64);
        assert!(lights.of(7).is_none() && lights.of(0).is_none());
    }
}
