//! Receivers in front of the post: their light with the virtual geometry and without it -> factors of the view.

mod compared;

pub use compared::Untold;

use super::reading::{power_of_two, white_light};
use super::{Relighter, Shading};
use crate::view::gain::{ViewGain, middle};
use crate::weights::PatchWeights;
use relume_firmware::field::Field;
use relume_firmware::receivers::{DARKEST, Receivers, factor_of_still, share_of_view};
use relume_firmware::shade::log_factor;
use relume_firmware::tile::{TILE_PIXELS, TILE_PX};
use relume_firmware::tone::ViewLight;
use relume_firmware::weights::WeightError;

/// Shares of display white between which what a white surface shows in all the light is kept: so nothing is beyond white, and
/// half a code is little.
const WHITE: std::ops::RangeInclusive<f64> = 0.2..=1.0;

/// Pixels that show nothing but receivers by which a view's gain is measured, at most.
const GAUGES: usize = 4096;
/// Codes that tell how much light there was: not clipped, and not so dark that one code is much.
const TELLING: std::ops::RangeInclusive<u8> = 16..=245;

/// Receivers darker than this share of a white surface in the open tell nothing.
const DIMMEST: f32 = 8.0 * DARKEST;

/// A pixel of the view that shows nothing but receivers.
#[derive(Clone, Copy)]
struct WholePixel {
    /// In the picture.
    place: usize,
    /// In the plane of the first channel, and from channel to channel.
    at: usize,
    pitch: usize,
}

/// The light that a still was taken in.
struct StillLight {
    /// The still's linear light per radiance.
    gain: [f64; 3],
    /// What a white surface showed in all of that light.
    white: f64,
    /// That its receivers were relit with.
    exposure: f32,
}

impl StillLight {
    /// What the still's light is multiplied by, once its receivers' is divided by their light then and multiplied by that of
    /// now, relit with `exposure` and to be shown with `shown_exposure`; and what everything else is multiplied by, which has
    /// no model: by how much brighter a white surface has become.
    fn scales(&self, channel: usize, white: f64, (exposure, shown_exposure): (f32, f32)) -> (f32, f32) {
        let exposed = f64::from(shown_exposure) / self.gain[channel];
        let receivers = exposed * f64::from(self.exposure) / f64::from(exposure);
        let rest = if self.white > 0.0 { exposed * white / self.white } else { exposed };
        (receivers as f32, rest as f32)
    }
}

/// The receivers of a field under the newest light.
pub struct ReceiverLight<'f> {
    with: Relighter<'f>,
    without: Relighter<'f>,
    /// Linear values of both, laid out like the row scales.
    light: [Vec<f32>; 2],
    /// What the view is multiplied by.
    shading: Shading,
    /// Which part of the view's pixel is the receiver, `[tile][padded covered pixel]`: a third of the lights' layout.
    shares: Vec<f32>,
    exposure: f32,
    /// The light that the view was taken in, if that is not today's.
    still: Option<StillLight>,
    /// What light of the view is multiplied by besides, per channel: of receivers, and of everything else.
    scales: [(f32, f32); 3],
    is_rescaled: bool,
    /// Pixels that show nothing but receivers, spread over the picture.
    whole: Vec<WholePixel>,
    /// `[row][column]`: above 0 where something that is in no model stands in front of the receivers; or nothing.
    in_front: Vec<u8>,
    /// Room for the logarithms of their gains.
    logs: Vec<f64>,
    /// `[tile]`: has its light changed?
    changed: Vec<bool>,
    tone: ViewLight,
}

impl<'f> ReceiverLight<'f> {
    /// Of the receivers of `field`.
    pub fn new(field: &Field<'f>, receivers: Receivers<'f>) -> Self {
        let (with, without) = (Relighter::new(receivers.with, 1), Relighter::new(receivers.without, 1));
        let length = with.light_len().max(without.light_len());
        let tiles = field.response().tiles();
        let mut shares = vec![0.0; length / 3];
        for index in 0..tiles {
            let (tile, own) = (receivers.with.response().tile(index), field.response().tile(index));
            let mut covered = [0u8; TILE_PIXELS];
            let own_shares = own.coverage.unwrap_or(&[255; TILE_PIXELS]);
            own.covered().zip(own_shares).for_each(|(place, &share)| covered[place] = share);
            for (k, place) in tile.covered().enumerate() {
                let receiver = tile.coverage.map_or(255, |coverage| coverage[k]);
                shares[tile.plane_at / 3 + k] = share_of_view(receiver, covered[place]);
            }
        }
        ReceiverLight {
            whole: spread(whole_pixels(&with, &shares, &[])),
            in_front: Vec::new(),
            light: [vec![0.0; length], vec![0.0; length]],
            shading: Shading::new((0..tiles).map(|index| with.tile(index).pixels() > 0)),
            with,
            without,
            logs: Vec::with_capacity(GAUGES),
            shares,
            exposure: 1.0,
            still: None,
            scales: [(1.0, 1.0); 3],
            is_rescaled: false,
            changed: vec![true; tiles],
            tone: ViewLight::new(),
        }
    }

    /// Measures nothing where `shares` (255ths, of the view's size, row 0 at the top) says that something else stands in front.
    pub fn leave_out(&mut self, shares: &[u8]) {
        self.in_front = shares.to_vec();
        self.whole = spread(whole_pixels(&self.with, &self.shares, &self.in_front));
    }

    /// Retraces the sun only when it has moved by more than this, degrees.
    pub fn set_sun_step_deg(&mut self, step_deg: f64) {
        self.both(|relighter| relighter.set_sun_step_deg(step_deg));
    }

    fn both(&mut self, mut act: impl FnMut(&mut Relighter<'f>)) {
        act(&mut self.with);
        act(&mut self.without);
    }

    /// Is a tracer at work?
    pub fn is_tracing(&mut self) -> bool {
        self.with.is_tracing() | self.without.is_tracing()
    }

    /// Keeps to the sun that is shown, whatever a tracer has ready, until this is lifted.
    pub fn hold_sun(&mut self, is_held: bool) {
        self.both(|relighter| relighter.hold_sun(is_held));
    }

    /// Has a tracer finished? Then setting the same weights once more takes its work.
    pub fn has_news(&mut self) -> bool {
        self.with.has_news() | self.without.has_news()
    }

    /// Takes new weights, and the exposure that the picture is shown at.
    ///
    /// # Errors
    /// [`WeightError`]; everything then stays as it was.
    pub fn set_weights(&mut self, weights: &PatchWeights, shown_exposure: f32) -> Result<(), WeightError> {
        let white = white_light(weights, self.with.field());
        if white > 0.0 && !WHITE.contains(&(white * f64::from(self.exposure))) {
            self.exposure = power_of_two(white);
            self.both(Relighter::redraw);
        }
        self.with.set_weights(weights, self.exposure)?;
        let Some(still) = &self.still else { return self.without.set_weights(weights, self.exposure) };
        let scales = std::array::from_fn(|channel| still.scales(channel, white, (self.exposure, shown_exposure)));
        if self.scales != scales {
            self.scales = scales;
            self.is_rescaled = true;
        }
        Ok(())
    }

    /// Has the view be one that was taken in the light `then`: it is relit, too. False where it shows too little of the
    /// receivers to tell how it was exposed.
    ///
    /// # Errors
    /// [`WeightError`].
    pub fn set_still_light(&mut self, then: &PatchWeights, view: &[u32]) -> Result<bool, WeightError> {
        let white = white_light(then, self.with.field());
        let exposure = power_of_two(white);
        self.exposure = exposure;
        self.with.set_weights(then, exposure)?;
        self.without.set_weights(then, exposure)?;
        self.follow();
        self.still = self.gain(view).map(|ViewGain { gain, .. }| StillLight { gain, white, exposure });
        Ok(self.still.is_some())
    }

    /// Linear light of `view` (1 = white) per radiance of the newest weights, from what it shows of the receivers; `None` where
    /// that is too little. Of the last
    /// [`ReceiverLight::follow`].
    pub fn gain(&mut self, view: &[u32]) -> Option<ViewGain> {
        let (mut gain, mut scatter) = ([0.0; 3], 0.0f64);
        for (channel, gain) in gain.iter_mut().enumerate() {
            self.logs.clear();
            for pixel in &self.whole {
                let code = view[pixel.place].to_be_bytes()[1 + channel];
                let light = self.light[1][pixel.at + channel * pixel.pitch];
                if TELLING.contains(&code) && light > DIMMEST {
                    self.logs.push(f64::from(self.tone.linear(code) / light).ln());
                }
            }
            let (middle, deviation) = middle(&mut self.logs)?;
            *gain = f64::from(self.exposure) * middle.exp();
            scatter = scatter.max(deviation);
        }
        Some(ViewGain { gain, scatter })
    }

    /// Brings the factors up to the newest weights; how many tiles of them have changed.
    pub fn follow(&mut self) -> usize {
        let [with, without] = &mut self.light;
        self.with.keep_light(with);
        self.without.keep_light(without);
        let changed = &mut self.changed;
        let mut note = |tile: usize| changed[tile] = true;
        self.with.take_written(&mut note);
        self.without.take_written(&mut note);
        if std::mem::take(&mut self.is_rescaled) {
            self.shading.set_rest(self.scales.map(|(_, rest)| rest));
            self.changed.fill(true);
        }
        let mut count = 0;
        for index in 0..self.changed.len() {
            if std::mem::take(&mut self.changed[index]) {
                count += usize::from(self.shade(index));
            }
        }
        count
    }

    /// Finds the factors of a tile anew; false where it has no receivers.
    fn shade(&mut self, index: usize) -> bool {
        let tile = self.with.tile(index);
        let (n, from) = (tile.padded_pixels(), tile.plane_at);
        let Some(log_factors) = self.shading.change(index) else { return false };
        for (channel, log_factors) in log_factors.iter_mut().enumerate() {
            let (at, scales) = (from + channel * n, self.scales[channel]);
            log_factors.fill(log_factor(scales.1));
            for (k, place) in tile.covered().enumerate() {
                let (with, without) = (self.light[0][at + k], self.light[1][at + k]);
                let factor = factor_of_still(with, without, self.shares[from / 3 + k], scales);
                log_factors[place] = log_factor(factor);
            }
        }
        true
    }

    /// What the view is multiplied by, as of the last [`ReceiverLight::follow`].
    pub fn shading(&self) -> &Shading {
        &self.shading
    }
}

/// At most [`GAUGES`] of these, from all over the picture.
fn spread(whole: Vec<WholePixel>) -> Vec<WholePixel> {
    let step = whole.len().div_ceil(GAUGES).max(1);
    whole.into_iter().step_by(step).collect()
}

/// All pixels that show nothing but receivers, with nothing in front of these.
fn whole_pixels(receivers: &Relighter<'_>, shares: &[f32], in_front: &[u8]) -> Vec<WholePixel> {
    let field = receivers.field();
    let (width, columns) = (field.width(), field.response().grid().0);
    let mut whole = Vec::new();
    for index in 0..field.response().tiles() {
        let tile = receivers.tile(index);
        let corner = index / columns * TILE_PX * width + index % columns * TILE_PX;
        for (k, place) in tile.covered().enumerate() {
            let is_whole = tile.coverage.is_none_or(|coverage| coverage[k] == 255);
            if is_whole && shares[tile.plane_at / 3 + k] == 1.0 {
                let place = corner + place / TILE_PX * width + place % TILE_PX;
                if in_front.get(place).is_none_or(|&share| share == 0) {
                    whole.push(WholePixel { place, at: tile.plane_at + k, pitch: tile.padded_pixels() });
                }
            }
        }
    }
    whole
}

impl ReceiverLight<'static> {
    /// Traces the sun on threads of their own. That of a still's light stays.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn trace_behind(&mut self) -> std::io::Result<()> {
        if self.still.is_none() {
            self.without.trace_behind()?;
        }
        self.with.trace_behind()
    }
}
