//! A field as the picture shown.

use super::Painter;
use crate::exposure::automatic;
use crate::relight::{Framebuffer, Relighter, View};
use crate::view::Still;
use crate::weights::PatchWeights;
use relume_firmware::field::Field;
use relume_firmware::patches::PatchSet;

/// A field over a still view.
pub struct FieldPainter<'f> {
    field: Field<'f>,
    relighter: Relighter<'f>,
    view: View,
    framebuffer: Framebuffer,
}

impl<'f> FieldPainter<'f> {
    /// A painter for a checked field; `view` must have its size. `threads` = 0 takes one per core.
    pub fn new(field: Field<'f>, view: Still, threads: usize) -> Self {
        let (width, height) = (field.width(), field.height());
        FieldPainter {
            relighter: Relighter::new(field, threads),
            view: View::new(width, height, view.pixels_bgrx),
            framebuffer: Framebuffer::new(width, height),
            field,
        }
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
        self.relighter.set_weights(weights, exposure)?;
        Ok(None)
    }

    fn wanted_exposure(&mut self) -> Option<f64> {
        let picture = self.relighter.radiance();
        automatic(&picture.rgb, &picture.alpha)
    }

    fn draw(&mut self) -> anyhow::Result<bool> {
        let counters = self.relighter.draw(&self.view, &mut self.framebuffer);
        Ok(counters.tiles_drawn > 0)
    }

    fn pixels_bgrx(&self) -> &[u32] {
        &self.framebuffer.pixels
    }
}
