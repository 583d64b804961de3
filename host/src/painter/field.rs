//! A field as the picture shown.

use super::Painter;
use crate::damage::Damage;
use crate::exposure::{automatic, automatic_of};
use crate::relight::{
    Backdrop, Budget, BudgetError, FrameCounters, Framebuffer, ReceiverLight, Relighter, Shading, Untold, View,
};
use crate::sun::{dir_world, position_of};
use crate::sunband::nearest;
use crate::view::Still;
use crate::view::disagreement::Disagreement;
use crate::view::gain::ViewGain;
use crate::view::mask::Mask;
use crate::weights::{PatchWeights, SunWeight};
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;
use relume_firmware::receivers::Receivers;
use relume_firmware::weights::WeightError;

/// How far the sun may move in a post before its light is traced anew, degrees: twelve seconds' way, a tenth of its width.
pub const SUN_STEP_DEG: f64 = 0.05;

/// Tiles that the running exposure looks at: enough for a hundredth of its steps.
const EXPOSURE_TILES: usize = 128;

/// A field over a view.
pub struct FieldPainter<'f> {
    field: Field<'f>,
    relighter: Relighter<'f>,
    /// What is really behind the picture.
    view: View,
    /// Puts receivers in it into the light that the virtual geometry leaves them.
    receivers: Option<ReceiverLight<'f>>,
    framebuffer: Framebuffer,
    /// What stands in front of the picture, and the picture with it.
    mask: Option<(Mask, Vec<u32>)>,
    /// Has the view changed since the picture was drawn?
    is_view_new: bool,
    /// Is the sun that is shown to stay?
    is_sun_held: bool,
    /// Channel values that the exposure is chosen by, reused.
    sampled: Vec<f32>,
}

impl<'f> FieldPainter<'f> {
    /// A painter for a checked field; `view` must have its size. `threads` = 0 takes one per core.
    pub fn new(field: Field<'f>, view: Still, threads: usize) -> Self {
        let (width, height) = (field.width(), field.height());
        FieldPainter {
            relighter: Relighter::new(field, threads),
            view: View::new(width, height, view.pixels_bgrx),
            receivers: None,
            framebuffer: Framebuffer::new(width, height),
            mask: None,
            is_view_new: true,
            is_sun_held: false,
            sampled: Vec::new(),
            field,
        }
    }

    /// Puts what the view shows of the field's receivers into the shadow and the reflected light of the virtual geometry.
    pub fn show_receivers(&mut self, receivers: Option<Receivers<'f>>) {
        self.receivers = receivers.map(|receivers| ReceiverLight::new(&self.field, receivers));
        if self.receivers.is_some() {
            self.relighter.expect_live_view();
        }
    }

    /// Shows the view in front of the picture where a mask says so; receivers are not measured by there.
    pub fn put_behind(&mut self, mask: Option<Mask>) {
        if let (Some(receivers), Some(mask)) = (&mut self.receivers, &mask) {
            receivers.leave_out(mask.shares());
        }
        let length = self.framebuffer.pixels.len();
        self.mask = mask.map(|mask| (mask, vec![0; length]));
    }

    /// Relights the still behind the picture, too, which was taken in the light `then`. False where it shows too little of the
    /// field's receivers.
    ///
    /// # Errors
    /// When the weights do not fit.
    pub fn relight_still(&mut self, then: &PatchWeights) -> Result<bool, WeightError> {
        let Some(receivers) = &mut self.receivers else { return Ok(false) };
        receivers.set_still_light(then, self.view.pixels())
    }

    /// Where the view disagrees with the light of the field's receivers in it.
    ///
    /// # Errors
    /// [`Untold`]: why it cannot be told.
    pub fn disagreement(&mut self) -> Result<Disagreement, Untold> {
        let receivers = self.receivers.as_mut().ok_or(Untold::Few(0))?;
        receivers.follow();
        receivers.disagreement(self.view.pixels())
    }

    /// Gets ready for a live view: what it shows first is composited only, like what comes later.
    pub fn expect_live_view(&mut self) {
        self.relighter.expect_live_view();
    }

    /// Keeps every frame to a budget.
    ///
    /// # Errors
    /// [`BudgetError`], if no frame of this field can.
    pub fn set_budget(&mut self, budget: Budget) -> Result<(), BudgetError> {
        self.relighter.set_budget(budget)
    }
}

impl FieldPainter<'_> {
    /// The exposure that the whole picture asks for ([`automatic`]), not a sample of it.
    pub fn exact_exposure(&mut self) -> Option<f64> {
        let picture = self.relighter.radiance();
        automatic(&picture.rgb, &picture.alpha)
    }
}

impl FieldPainter<'static> {
    /// Traces the sun behind frames, and only when it has moved by more than `step_deg`, degrees.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn trace_behind(&mut self, step_deg: f64) -> std::io::Result<()> {
        self.relighter.set_sun_step_deg(step_deg);
        if let Some(receivers) = &mut self.receivers {
            receivers.set_sun_step_deg(step_deg);
            receivers.trace_behind()?;
        }
        self.relighter.trace_behind()
    }
}

impl FieldPainter<'_> {
    fn is_tracing(&mut self) -> bool {
        self.relighter.is_tracing() | self.receivers.as_mut().is_some_and(ReceiverLight::is_tracing)
    }

    /// The picture and the receivers with and without it each have a tracer. A picture in the sun over ground that is still
    /// without it, or exposed by such ground, would flash: what the tracers find is taken when all of them are done.
    fn take_suns_together(&mut self) {
        let is_held = self.is_tracing() | self.is_sun_held;
        self.relighter.hold_sun(is_held);
        if let Some(receivers) = &mut self.receivers {
            receivers.hold_sun(is_held);
        }
    }

    /// The same weights with the sun moved into the band of the field's site, when it stands outside.
    fn moved_into_band(&self, weights: &PatchWeights) -> Option<(PatchWeights, String)> {
        let [latitude, longitude] = self.field.header().site?;
        let sun = weights.sun?;
        let position = position_of(sun.dir_world, self.north_deg());
        let near = nearest(position, latitude.into())?;
        let mut moved = weights.clone();
        let dir_world = dir_world(near, self.north_deg());
        moved.sun = (near.altitude_deg > 0.0).then_some(SunWeight { dir_world, ..sun });
        let note = format!(
            "sun at azimuth {:.1}, altitude {:.1} is outside the field's site {latitude:.2}, {longitude:.2}; shown at {:.1}, {:.1}",
            position.azimuth_deg, position.altitude_deg, near.azimuth_deg, near.altitude_deg
        );
        Some((moved, note))
    }
}

impl Painter for FieldPainter<'_> {
    fn size(&self) -> (usize, usize) {
        (self.framebuffer.width, self.framebuffer.height)
    }

    fn patch_set(&self) -> PatchSet {
        *self.field.patch_set()
    }

    fn north_deg(&self) -> f64 {
        f64::from(self.field.camera().north_deg)
    }

    fn relight(&mut self, weights: &PatchWeights, exposure: f32) -> anyhow::Result<Option<String>> {
        let moved = self.moved_into_band(weights);
        let (weights, note) = match &moved {
            Some((weights, note)) => (weights, Some(note.clone())),
            None => (weights, None),
        };
        self.take_suns_together();
        self.relighter.set_weights(weights, exposure)?;
        if let Some(receivers) = &mut self.receivers {
            receivers.set_weights(weights, exposure)?;
        }
        let waits = || self.relighter.awaits_sun().then(|| "the sun is being traced, and not shown yet".into());
        Ok(note.or_else(waits))
    }

    fn sun_dir_world(&self) -> Option<[f32; 3]> {
        self.relighter.sun_dir_world()
    }

    fn hold_sun(&mut self, is_held: bool) {
        self.is_sun_held = is_held;
    }

    fn has_news(&mut self) -> bool {
        !self.is_tracing() && (self.relighter.has_news() | self.receivers.as_mut().is_some_and(ReceiverLight::has_news))
    }

    fn wanted_exposure(&mut self) -> Option<f64> {
        self.relighter.sample_radiance(EXPOSURE_TILES, &mut self.sampled);
        automatic_of(&mut self.sampled)
    }

    fn view_gain(&mut self) -> Option<ViewGain> {
        // A view in the sun tells nothing beside receivers that are still without it.
        if self.relighter.awaits_sun() {
            return None;
        }
        let receivers = self.receivers.as_mut()?;
        receivers.follow();
        receivers.gain(self.view.pixels())
    }

    fn draw(&mut self, damage: &mut Damage) -> anyhow::Result<FrameCounters> {
        let receiver_tiles_drawn = self.receivers.as_mut().map_or(0, ReceiverLight::follow);
        let shading = self.receivers.as_ref().map(ReceiverLight::shading);
        let counters = self.relighter.draw_over(&Backdrop { view: &self.view, shading }, &mut self.framebuffer);
        self.relighter.take_damage(damage);
        let is_view_new = std::mem::take(&mut self.is_view_new) | (receiver_tiles_drawn > 0);
        if let Some((mask, shown)) = &mut self.mask {
            if is_view_new {
                mask.relight(self.view.pixels(), shading.map(Shading::rest));
                mask.mark(damage);
            }
            mask.put(damage, (&self.framebuffer.pixels, self.view.pixels()), shown);
        }
        Ok(FrameCounters { receiver_tiles_drawn, ..counters })
    }

    fn show_view(&mut self, pixels_bgrx: &mut Vec<u32>) {
        self.is_view_new = true;
        self.view.exchange(pixels_bgrx);
    }

    fn view_bgrx(&self) -> &[u32] {
        self.view.pixels()
    }

    fn pixels_bgrx(&self) -> &[u32] {
        self.mask.as_ref().map_or(&self.framebuffer.pixels, |(_, shown)| shown)
    }
}
