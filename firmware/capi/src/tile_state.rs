//! What a tile shows, and whether that may stay.

use crate::frame::{Target, ViewIdentity};
use relume_firmware::field::Field;
use relume_firmware::kernel::SUN_SHIFT;
use relume_firmware::relight::{Coefficients, LINEAR_BITS};
use relume_firmware::tile::TILE_PIXELS;
use relume_firmware::tone::LINEAR_SLOPE;
use relume_firmware::weights::{MAX_STANDOUTS, Standout};

/// A tile is kept when the bound on its change is below half an 8-bit code where the tone curve is steepest
/// (1/2^20 of display white).
const HALF_CODE: f32 = 0.5 / LINEAR_SLOPE * (1 << LINEAR_BITS) as f32;

/// The light of a frame beside the tile's own coefficients.
#[derive(Clone, Copy)]
pub struct FrameLight<'a> {
    /// The sun's weight; 0: no sun.
    pub sun_q16: [u32; 3],
    /// Patches whose residuals are read.
    pub standouts: &'a [Standout],
}

/// What a tile was last drawn with.
#[derive(Clone, Copy)]
struct Drawn {
    coefficients: Coefficients,
    sun_q16: [u32; 3],
    standouts: [Standout; MAX_STANDOUTS],
    view: ViewIdentity,
    target: Target,
}

/// One tile's state from frame to frame.
pub struct TileState {
    drawn: Option<Drawn>,
    /// Number of the light that the tile was last found to show, or near enough; 0: none.
    judged_light: u64,
    /// Number of the sun's direction that the tile's plane was traced for; 0: none.
    pub traced_sun: u64,
    /// Largest change of the sun's response since the tile was last drawn, in 1/32768, summed over retracings.
    sun_drift: u32,
    /// Largest value of the sun's response before and after the newest tracing, in 1/32768.
    sun_peak: u32,
    /// Does the view show through anywhere?
    shows_view: bool,
    /// Has the tile no geometry?
    pub empty: bool,
}

impl TileState {
    /// A tile that was never drawn.
    pub fn new(field: &Field<'_>, index: usize) -> Self {
        let tile = field.response().tile(index);
        TileState {
            drawn: None,
            judged_light: 0,
            traced_sun: 0,
            sun_drift: 0,
            sun_peak: 0,
            shows_view: tile.pixels() < TILE_PIXELS || field.coverage(index).is_some(),
            empty: tile.pixels() == 0,
        }
    }

    /// Takes a new response to the sun of direction number `sun` over the old one.
    pub fn take_sun(&mut self, sun: u64, slot: &mut [u16], fresh: &[u16]) {
        let (mut largest, mut peak) = (0, 0);
        for (old, &new) in slot.iter_mut().zip(fresh) {
            largest = largest.max(old.abs_diff(new));
            peak = peak.max(*old).max(new);
            *old = new;
        }
        self.sun_drift = self.sun_drift.saturating_add(u32::from(largest));
        self.sun_peak = u32::from(peak);
        self.traced_sun = sun;
        self.judged_light = 0;
    }

    /// Was the tile drawn here and over this view?
    pub fn in_place(&self, target: Target, view: ViewIdentity) -> bool {
        self.drawn.as_ref().is_some_and(|drawn| drawn.target == target && (!self.shows_view || drawn.view == view))
    }

    /// Does the tile show light number `light` already?
    pub fn shows_light(&self, light: u64) -> bool {
        self.empty || self.judged_light == light
    }

    /// Would the tile change by less than half a code? Remembers it if so.
    pub fn may_stay(
        &mut self,
        field: &Field<'_>,
        index: usize,
        coefficients: &Coefficients,
        (light, frame): (u64, FrameLight<'_>),
    ) -> bool {
        let Some(drawn) = &self.drawn else { return false };
        let unit = (1u32 << SUN_SHIFT) as f32;
        let sun = |c: usize| {
            let (old, new) = (drawn.sun_q16[c], frame.sun_q16[c]);
            (self.sun_drift as f32 * old.max(new) as f32 + old.abs_diff(new) as f32 * self.sun_peak as f32) / unit
        };
        let mut bound = coefficients.change_bound(&drawn.coefficients) + sun(0).max(sun(1)).max(sun(2));
        if bound < HALF_CODE {
            bound += residual_change(field, index, frame.standouts, &drawn.standouts);
        }
        let stays = bound < HALF_CODE;
        if stays {
            self.judged_light = light;
        }
        stays
    }

    /// Notes that the tile was drawn.
    pub fn note_drawn(
        &mut self,
        coefficients: &Coefficients,
        (light, frame): (u64, FrameLight<'_>),
        (target, view): (Target, ViewIdentity),
    ) {
        let mut standouts = [Standout::default(); MAX_STANDOUTS];
        for (own, other) in standouts.iter_mut().zip(frame.standouts) {
            *own = *other;
        }
        let coefficients = *coefficients;
        self.drawn = Some(Drawn { coefficients, sun_q16: frame.sun_q16, standouts, view, target });
        self.judged_light = light;
        self.sun_drift = 0;
    }
}

/// A bound on what residuals change in a tile between two lights' standouts, in 1/2^20 of display white.
fn residual_change(field: &Field<'_>, index: usize, new: &[Standout], old: &[Standout]) -> f32 {
    if new.is_empty() && old.iter().all(|s| s.light == [0.0; 3]) {
        return 0.0;
    }
    let (tile, residuals) = (field.response().tile(index), field.residuals());
    let light =
        |of: &[Standout], patch: u16| of.iter().find(|s| s.patch == patch).map_or([0.0; 3], |standout| standout.light);
    let change = |patch: u16| {
        let Some(residual) = residuals.get(index, &tile, usize::from(patch)) else { return 0.0 };
        let (new, old) = (light(new, patch), light(old, patch));
        let step = |c: usize| (new[c] - old[c]).abs() * residual.scale[c];
        127.0 * step(0).max(step(1)).max(step(2))
    };
    let gone = old.iter().filter(|s| light(new, s.patch) == [0.0; 3] && s.light != [0.0; 3]);
    let sum: f32 = new.iter().chain(gone).map(|standout| change(standout.patch)).sum();
    sum * (1 << LINEAR_BITS) as f32 + 1.0
}
