//! Relume itself as one of the methods: the field under a budget, or copies of it in turn.

use std::cell::RefCell;
use std::rc::Rc;

use relume_firmware::field::Field;

use super::budget::Budget;
use super::clock::cpu_s;
use super::facts;
use super::method::{BenchSky, Method, Shown};
use super::report::RELUME_NAME;
use crate::relight::{FrameCounters, Framebuffer, Relighter, View};

/// The relighters of a field, or of copies of it, that take turns. Budgets may share them, except those that
/// learn from frame to frame.
pub struct Relighters<'f> {
    fields: Vec<Field<'f>>,
    relighters: Vec<Relighter<'f>>,
    threads: usize,
    next: usize,
    view: View,
    framebuffer: Framebuffer,
    counters: FrameCounters,
}

impl<'f> Relighters<'f> {
    /// Relighters of one thread, one for each of `fields`, over a black view. `None` without a field.
    pub fn new(fields: Vec<Field<'f>>) -> Option<Self> {
        let first = fields.first()?;
        let (width, height) = (first.width(), first.height());
        let relighters = fields.iter().map(|field| Relighter::new(*field, 1)).collect();
        let view = View::new(width, height, Vec::new());
        let (framebuffer, counters) = (Framebuffer::new(width, height), FrameCounters::default());
        Some(Relighters { fields, relighters, threads: 1, next: 0, view, framebuffer, counters })
    }

    fn set_threads(&mut self, threads: usize) {
        if self.threads != threads {
            self.relighters = self.fields.iter().map(|field| Relighter::new(*field, threads)).collect();
            self.threads = threads;
        }
    }

    fn move_on(&mut self) {
        self.next = (self.next + 1) % self.relighters.len();
    }

    fn project(&mut self, sky: &BenchSky, budget: Budget) -> anyhow::Result<()> {
        let relighter = &mut self.relighters[self.next];
        budget.set(relighter)?;
        relighter.invalidate();
        relighter.set_weights(&sky.weights, sky.exposure)?;
        Ok(())
    }

    /// Draws every tile.
    fn draw(&mut self) {
        let relighter = &mut self.relighters[self.next];
        relighter.redraw();
        self.counters = relighter.draw(&self.view, &mut self.framebuffer);
    }

    fn radiance(&mut self, covered: &[u32]) -> Vec<[f32; 3]> {
        let picture = self.relighters[self.next].radiance();
        covered.iter().map(|&at| picture.rgb[at as usize]).collect()
    }
}

/// The field relit under a budget.
pub struct Relume<'f> {
    shared: Rc<RefCell<Relighters<'f>>>,
    budget: Budget,
    covered: Rc<[u32]>,
}

impl<'f> Relume<'f> {
    /// `covered` names the pixels that are compared.
    pub fn new(shared: Rc<RefCell<Relighters<'f>>>, covered: Rc<[u32]>, budget: Budget) -> Self {
        Relume { shared, budget, covered }
    }

    /// Linear radiance of the covered pixels.
    ///
    /// # Errors
    /// If the weights are refused.
    pub fn radiance(&mut self, sky: &BenchSky) -> anyhow::Result<Vec<[f32; 3]>> {
        let mut shared = self.shared.borrow_mut();
        shared.project(sky, self.budget)?;
        Ok(shared.radiance(&self.covered))
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
        Some(self.budget.to_string())
    }

    fn set_threads(&mut self, threads: usize) {
        self.shared.borrow_mut().set_threads(threads);
    }

    fn bytes_read(&self, sky: &BenchSky) -> usize {
        let field = self.shared.borrow().fields[0];
        facts::bytes_read(&field, self.budget.max_rank(), sky.has_sun()) + facts::way_back_bytes(&field, sky)
    }

    fn warm_up(&mut self, skies: &[BenchSky]) -> anyhow::Result<()> {
        // Every copy meets every sky: its sun is traced, and its memory for patches apart is there.
        let copies = self.shared.borrow().relighters.len();
        let mut turns = skies.iter().flat_map(|sky| std::iter::repeat_n(sky, copies));
        turns.try_for_each(|sky| self.frame(sky))
    }

    fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()> {
        let mut shared = self.shared.borrow_mut();
        shared.move_on();
        shared.project(sky, self.budget)?;
        shared.draw();
        Ok(())
    }

    fn redraw(&mut self) -> bool {
        let mut shared = self.shared.borrow_mut();
        // The only copy keeps its coefficients; of several the next one has some from an earlier turn.
        shared.move_on();
        shared.draw();
        true
    }

    fn show(&mut self, sky: &BenchSky) -> anyhow::Result<Shown> {
        self.frame(sky)?;
        let mut shared = self.shared.borrow_mut();
        let radiance = shared.radiance(&self.covered);
        let codes = self.covered.iter().map(|&at| {
            let [_, r, g, b] = shared.framebuffer.pixels[at as usize].to_be_bytes();
            [r, g, b]
        });
        Ok(Shown { radiance, codes: codes.collect(), bound_codes: shared.counters.bound_codes })
    }
}
