//! A relighter on one thread with its view and framebuffer, and the CPU time of its frames.

use relume_firmware::field::Field;

use super::clock::cpu_s;
use crate::relight::{FrameCounters, Framebuffer, Relighter, View};
use crate::weights::PatchWeights;

/// Relights one field over a black view.
pub struct Stage<'f> {
    /// The relighter.
    pub relighter: Relighter<'f>,
    /// What it shows.
    pub framebuffer: Framebuffer,
    view: View,
}

impl<'f> Stage<'f> {
    /// One that has drawn nothing yet.
    pub fn new(field: Field<'f>) -> Self {
        let (width, height) = (field.width(), field.height());
        Stage {
            relighter: Relighter::new(field, 1),
            framebuffer: Framebuffer::new(width, height),
            view: View::new(width, height, Vec::new()),
        }
    }

    /// Weights to picture, as far as it changes: CPU seconds and counters.
    ///
    /// # Errors
    /// If the weights are refused.
    pub fn frame(&mut self, weights: &PatchWeights, exposure: f32) -> anyhow::Result<(f64, FrameCounters)> {
        let start = cpu_s();
        self.relighter.set_weights(weights, exposure)?;
        let counters = self.relighter.draw(&self.view, &mut self.framebuffer);
        Ok((cpu_s() - start, counters))
    }

    /// The same with nothing kept from before.
    ///
    /// # Errors
    /// If the weights are refused.
    pub fn full_frame(&mut self, weights: &PatchWeights, exposure: f32) -> anyhow::Result<(f64, FrameCounters)> {
        self.relighter.invalidate();
        self.frame(weights, exposure)
    }

    /// The same after the view has changed, as a live one does with every frame. Whoever fills it in pays for that.
    ///
    /// # Errors
    /// If the weights are refused.
    pub fn frame_of_live_view(
        &mut self,
        weights: &PatchWeights,
        exposure: f32,
    ) -> anyhow::Result<(f64, FrameCounters)> {
        self.view.pixels_mut();
        self.frame(weights, exposure)
    }

    /// Linear radiance of the pixels at `covered` under `weights`.
    ///
    /// # Errors
    /// If the weights are refused.
    pub fn radiance(&mut self, weights: &PatchWeights, covered: &[u32]) -> anyhow::Result<Vec<[f64; 3]>> {
        self.relighter.set_weights(weights, 1.0)?;
        let picture = self.relighter.radiance();
        Ok(covered.iter().map(|&at| picture.rgb[at as usize].map(f64::from)).collect())
    }
}
