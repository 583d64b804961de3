//! Relume itself as one of the methods: the field, one thread, at most so many ranks per tile.

use relume_firmware::field::Field;

use super::clock::cpu_s;
use super::method::{BenchSky, Method, Shown};
use super::report::RELUME_NAME;
use crate::relight::{Framebuffer, Relighter, View};

/// Ranks per tile that a run tries, and all that the field has.
pub const RANK_BUDGETS: [usize; 4] = [2, 4, 8, 16];

/// The field relit with at most `max_rank` ranks per tile.
pub struct Relume<'f> {
    relighter: Relighter<'f>,
    max_rank: Option<usize>,
    view: View,
    framebuffer: Framebuffer,
    covered: Vec<u32>,
}

impl<'f> Relume<'f> {
    /// A relighter with one thread over a black view; `max_rank` `None` takes all ranks that the field has.
    pub fn new(field: Field<'f>, covered: Vec<u32>, max_rank: Option<usize>) -> Self {
        let (width, height) = (field.width(), field.height());
        let mut relighter = Relighter::new(field, 1);
        if let Some(ranks) = max_rank {
            relighter.set_rank_limit(Some(ranks));
        }
        let view = View::new(width, height, Vec::new());
        Relume { relighter, max_rank, view, framebuffer: Framebuffer::new(width, height), covered }
    }

    /// Linear radiance of the covered pixels.
    ///
    /// # Errors
    /// If the weights are refused.
    pub fn radiance(&mut self, sky: &BenchSky) -> anyhow::Result<Vec<[f32; 3]>> {
        self.relighter.set_weights(&sky.weights, sky.exposure)?;
        let picture = self.relighter.radiance();
        Ok(self.covered.iter().map(|&at| picture.rgb[at as usize]).collect())
    }
}

/// CPU seconds that tracing the sun takes on one thread after it has moved; not part of a frame with the sun at rest.
///
/// # Errors
/// If the weights are refused.
pub fn sun_trace_s(field: Field<'_>, sky: &BenchSky) -> anyhow::Result<f64> {
    let mut relighter = Relighter::new(field, 1);
    let mut took = || -> anyhow::Result<f64> {
        let start = cpu_s();
        relighter.set_weights(&sky.weights, sky.exposure)?;
        Ok(cpu_s() - start)
    };
    let (traced, at_rest) = (took()?, took()?);
    Ok((traced - at_rest).max(0.0))
}

impl Method for Relume<'_> {
    fn name(&self) -> &'static str {
        RELUME_NAME
    }

    fn budget(&self) -> Option<String> {
        Some(self.max_rank.map_or_else(|| "all ranks".to_owned(), |ranks| format!("{ranks} ranks")))
    }

    fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()> {
        self.relighter.invalidate();
        self.relighter.set_weights(&sky.weights, sky.exposure)?;
        self.relighter.draw(&self.view, &mut self.framebuffer);
        Ok(())
    }

    fn show(&mut self, sky: &BenchSky) -> anyhow::Result<Shown> {
        self.frame(sky)?;
        let codes = self.covered.iter().map(|&at| {
            let [_, r, g, b] = self.framebuffer.pixels[at as usize].to_be_bytes();
            [r, g, b]
        });
        let codes = codes.collect();
        Ok(Shown { radiance: self.radiance(sky)?, codes })
    }
}
