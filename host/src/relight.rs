//! Field and weights into pictures: the frame around the firmware's kernels, with what each frame skipped.

mod blocks;
mod budget;
mod buffers;
mod counters;
mod draw;
mod file;
mod frame;
mod influence;
mod levels;
mod light;
mod reading;
mod receivers;
mod restore;
mod shading;
mod standing;
mod sunplane;
mod suntracer;
mod tiles;
mod waiting;

pub use budget::{Budget, BudgetError};
pub use buffers::{Framebuffer, Picture, View};
pub use counters::{CounterTotals, FrameCounters};
pub use file::{FieldFile, FieldFileError};
pub use receivers::{ReceiverLight, Untold};
pub use shading::{Backdrop, Shading};

use crate::damage::Damage;
use crate::weights::PatchWeights;
use blocks::{Block, Projected};
use budget::Pace;
use influence::{Influence, Lights};
use levels::Levels;
use rayon::prelude::*;
use relume_firmware::bound::CodeSlope;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::levels::is_error_budget;
use relume_firmware::patches::PatchSet;
use relume_firmware::tile::Tile;
use relume_firmware::tone::ViewLight;
use relume_firmware::weights::{SunWeight, WeightError};
use shading::BackdropVersion;
use std::time::Instant;
use sunplane::SunPlane;
use tiles::TileState;
use waiting::Choice;

/// Relights one field, frame after frame, on `threads` threads.
pub struct Relighter<'f> {
    field: Field<'f>,
    /// The field's tiles in row-major order, so that no frame has to read their records.
    tiles: Vec<Tile<'f>>,
    kernel: Kernel,
    light: ViewLight,
    slope: CodeSlope,
    pool: Option<rayon::ThreadPool>,
    /// One thread: frames run on the caller's, without handing over.
    alone: bool,
    levels: Levels,
    /// The newest weights at the exposure that they are read at; none before the first reading.
    reading: Option<Box<Levels>>,
    /// The newest weights; their sun only where it is shown.
    given: PatchWeights,
    /// The sun of the newest weights, if it is up, shown or not.
    awaited_sun: Option<SunWeight>,
    /// Room for light whose sun its patches take in, where the field does not answer suns.
    taken_in: Option<PatchWeights>,
    exposure: f32,
    sun: SunPlane,
    blocks: Vec<Block>,
    states: Vec<TileState>,
    influence: Option<Influence>,
    lights: Lights,
    budget: Budget,
    pace: Pace,
    choice: Choice,
    rank_limit: Option<usize>,
    /// Number of the light that blocks have coefficients of and ranks are limited for.
    moment: u64,
    /// Set weights since the last [`Relighter::draw`]?
    new_weights: bool,
    /// Do all blocks have the coefficients of `given`?
    settled: bool,
    /// When the newest weights came.
    started: Instant,
    /// The view that was drawn last.
    view: Option<u64>,
    /// Has the view ever changed? Then light is kept where it shows through.
    live: bool,
    /// The counters of the last frame, its view and its moment.
    shown: Option<(FrameCounters, BackdropVersion, u64)>,
    counters: FrameCounters,
}

impl<'f> Relighter<'f> {
    /// A relighter on `threads` threads, 0 for one per core.
    pub fn new(field: Field<'f>, threads: usize) -> Self {
        Self::with_kernel(field, threads, Kernel::detect())
    }

    /// The same on a kernel of the caller's choice.
    pub fn with_kernel(field: Field<'f>, threads: usize, kernel: Kernel) -> Self {
        let response = field.response();
        let patches = field.patch_set().len();
        let pool = thread_pool(threads);
        let tiles: Vec<Tile<'f>> = (0..response.tiles()).map(|index| response.tile(index)).collect();
        let states: Vec<TileState> = tiles.iter().map(TileState::new).collect();
        let blocks: Vec<Block> =
            (0..response.blocks()).map(|index| Block::new(&field, index, (&tiles, &states))).collect();
        let counters = FrameCounters {
            tiles: response.tiles(),
            blocks: blocks.iter().filter(|block| block.tile.is_some()).count(),
            patches,
            ..FrameCounters::default()
        };
        Relighter {
            field,
            kernel,
            light: ViewLight::new(),
            slope: CodeSlope::new(),
            alone: threads == 1 || pool.is_none(),
            pool,
            levels: Levels::new(&field, kernel),
            reading: None,
            given: PatchWeights { radiance: vec![[0.0; 3]; patches], sun: None },
            awaited_sun: None,
            taken_in: (!field.answers_sun()).then(|| PatchWeights { radiance: vec![[0.0; 3]; patches], sun: None }),
            exposure: 1.0,
            sun: SunPlane::new(&field),
            influence: Influence::new(&field, (&tiles, &states)),
            lights: Lights::new(patches),
            tiles,
            blocks,
            states,
            budget: Budget::default(),
            pace: Pace::default(),
            choice: Choice::new(response.tiles()),
            rank_limit: None,
            moment: 1,
            new_weights: false,
            settled: false,
            started: Instant::now(),
            view: None,
            live: false,
            shown: None,
            counters,
        }
    }

    /// The field.
    pub fn field(&self) -> &Field<'f> {
        &self.field
    }

    /// Tile number `index` of the field.
    pub(super) fn tile(&self, index: usize) -> &Tile<'f> {
        &self.tiles[index]
    }

    /// The kernel path in use.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// Keeps to a budget from the next weights on.
    ///
    /// # Errors
    /// [`BudgetError`], if no frame of this field can.
    pub fn set_budget(&mut self, budget: Budget) -> Result<(), BudgetError> {
        match budget {
            Budget::ErrorCodes(codes) if !is_error_budget(codes) => return Err(BudgetError::Codes(codes)),
            Budget::ErrorCodes(_) if self.field.bounds().is_none() => return Err(BudgetError::NoBounds),
            Budget::Time(time) if time.is_zero() => return Err(BudgetError::Time),
            _ => {}
        }
        if self.budget == budget {
            return Ok(());
        }
        self.budget = budget;
        self.blocks.iter_mut().for_each(|block| block.set_level(0));
        self.invalidate();
        Ok(())
    }

    /// Uses at most this many ranks per tile from the next frame on; `None` for all.
    pub fn set_rank_limit(&mut self, limit: Option<usize>) {
        self.moment += u64::from(self.rank_limit != limit);
        self.rank_limit = limit;
    }

    /// Retraces the sun only when it has moved by more than this, degrees (0: whenever it has moved).
    pub fn set_sun_step_deg(&mut self, step_deg: f64) {
        self.sun.set_step_deg(step_deg);
    }

    /// The direction of the sun whose light is shown; behind the newest weights' while a tracer is at work, `None` before the
    /// first is traced, and where the last was of another time of day.
    pub fn sun_dir_world(&self) -> Option<[f32; 3]> {
        self.given.sun.and(self.sun.dir_world())
    }

    /// Is there a sun whose light is not shown yet, because it is still being traced?
    pub fn awaits_sun(&self) -> bool {
        self.awaited_sun.is_some() && self.given.sun.is_none()
    }

    /// Is a tracer at work?
    pub fn is_tracing(&mut self) -> bool {
        self.sun.is_tracing()
    }

    /// Keeps to the sun that is shown, whatever a tracer has ready, until this is lifted: relighters of one picture take their
    /// suns together.
    pub fn hold_sun(&mut self, is_held: bool) {
        self.sun.hold(is_held);
    }

    /// Has a tracer finished? Then setting the same weights once more takes its work.
    pub fn has_news(&mut self) -> bool {
        self.awaited_sun.is_some() && self.sun.has_news()
    }

    /// Bounds the error, as by default, or not: then nothing is known of it, and every tile is drawn with every frame. For
    /// measuring what the bounds and the memory of what was drawn cost. An error budget without bounds restores nothing.
    pub fn set_bounds(&mut self, on: bool) {
        self.levels.set_bounds(on);
        self.invalidate();
    }

    /// Bounds of what the last frame shows, tile by tile in row-major order: no linear value of the sky's light and no
    /// 8-bit code, rounding included, is further from the uncompressed response's. `None` where there is nothing to bound.
    pub fn tile_bounds(&self) -> impl Iterator<Item = Option<(f32, f32)>> {
        let bounded = self.levels.bounds(&self.field).is_some();
        self.states.iter().map(move |state| (bounded && state.is_drawn && !state.empty).then_some(state.shown_bound))
    }

    /// Forgets what was relit: the next weights are projected from scratch and the next [`Relighter::draw`] draws every
    /// tile with geometry. Tiles that show the view alone are not concerned.
    pub fn invalidate(&mut self) {
        self.redraw();
        self.blocks.iter_mut().for_each(Block::forget);
        self.settled = false;
    }

    /// Draws every tile anew with the next frame, without projecting anew.
    pub fn redraw(&mut self) {
        self.shown = None;
        self.states.iter_mut().filter(|state| !state.empty).for_each(|state| state.is_drawn = false);
        self.blocks.iter_mut().for_each(|block| block.standing.forget());
    }

    /// Marks the tiles whose pixels were written since this was asked last.
    pub fn take_damage(&mut self, damage: &mut Damage) {
        let written = self
            .states
            .iter_mut()
            .enumerate()
            .filter_map(|(index, state)| std::mem::take(&mut state.is_new).then_some(index));
        written.for_each(|index| damage.mark(index));
    }

    /// Takes weights and an exposure (factor from radiance to display white): quantises and projects them, and traces
    /// the sun's response if it has moved. Of a field that does not answer suns, the patches around the sun stand for it.
    ///
    /// # Errors
    /// [`WeightError`]; everything then stays as it was.
    pub fn set_weights(&mut self, given: &PatchWeights, exposure: f32) -> Result<(), WeightError> {
        let Some(mut taken_in) = self.taken_in.take() else { return self.set_answered(given, exposure) };
        taken_in.radiance.clone_from(&given.radiance);
        taken_in.sun = given.sun;
        taken_in.take_sun_in(self.field.patch_set());
        let set = self.set_answered(&taken_in, exposure);
        self.taken_in = Some(taken_in);
        set
    }

    /// The same for light that the field answers.
    fn set_answered(&mut self, given: &PatchWeights, exposure: f32) -> Result<(), WeightError> {
        let sun = given.sun.filter(|sun| sun_is_up(sun, self.field.patch_set()));
        if !self.has_news()
            && self.settled
            && exposure == self.exposure
            && sun == self.awaited_sun
            && given.radiance == self.given.radiance
        {
            self.counters.count_no_light();
            return Ok(());
        }
        self.started = Instant::now();
        let shown_sun = sun.filter(|sun| self.sun.will_show(sun.dir_world));
        self.levels.set(&self.field, (&given.radiance, shown_sun), exposure)?;
        self.given.radiance.clone_from(&given.radiance);
        (self.given.sun, self.awaited_sun) = (shown_sun, sun);
        self.exposure = exposure;
        self.lights.set(&given.radiance, exposure);
        self.new_weights = true;
        self.moment += 1;
        self.levels.unpack(&self.field, &self.tiles);
        self.lower_levels();
        self.follow_sun();
        self.project(true);
        let weights = &self.levels.get(0).weights;
        self.counters.patches_dark = weights.dark_patches();
        self.counters.patches_apart = weights.apart().count();
        self.counters.patches_changed = match self.levels.step() {
            _ if self.counters.blocks_projected > 0 => self.counters.patches - self.counters.patches_dark,
            Some(step) => step.changed(),
            None => 0,
        };
        self.settled = true;
        Ok(())
    }

    fn follow_sun(&mut self) {
        self.counters.sun_up = self.given.sun.is_some();
        self.counters.sun_traced = false;
        let Some(sun) = self.awaited_sun else { return };
        let Some(changes) = self.sun.follow(&self.field, sun.dir_world, self.pool.as_ref()) else { return };
        self.counters.sun_traced = true;
        for (state, change) in self.states.iter_mut().zip(changes) {
            state.sun.retraced(change.largest, change.peak);
        }
        self.blocks.iter_mut().for_each(|block| block.standing.forget());
    }

    /// Brings all blocks to the newest weights of their levels.
    fn project(&mut self, new_weights: bool) {
        for level in 1..=self.levels.top() {
            if self.blocks.iter().any(|block| block.level == level) {
                self.levels.prepare(&self.field, level, &self.given, self.exposure);
            }
        }
        let spares = new_weights && self.may_stand();
        let (sun_q16, slope, lights) = (self.shown_sun_q16(), &self.slope, &self.lights);
        let influence = self.influence.as_ref().filter(|_| spares);
        let (field, levels, kernel) = ((&self.field, &*self.tiles), &self.levels, self.kernel);
        let project = |(index, block): (usize, &mut Block)| {
            let then = block.standing.moment().and_then(|moment| lights.of(moment));
            let stays = influence.zip(then).is_some_and(|(influence, then)| {
                let change = influence.moved(index, (then, lights.newest()), kernel);
                block.stays_unprojected(slope, sun_q16, change)
            });
            match if stays { block.lag() } else { block.project(field, index, levels, kernel, new_weights) } {
                Projected::Kept => [0; 3],
                Projected::Whole => [1, 0, 0],
                Projected::Stepped => [0, 1, 0],
                Projected::Spared => [0, 0, 1],
            }
        };
        let add = |a: [usize; 3], b: [usize; 3]| std::array::from_fn(|k| a[k] + b[k]);
        let blocks = &mut self.blocks;
        let counts = if self.alone {
            blocks.iter_mut().enumerate().map(project).fold([0; 3], add)
        } else {
            install(self.pool.as_ref(), || {
                blocks.par_iter_mut().enumerate().with_min_len(8).map(project).reduce(|| [0; 3], add)
            })
        };
        let before = if new_weights { [0; 3] } else { self.counters.blocks_counted() };
        self.counters.count_blocks(add(before, counts));
    }
}

impl Relighter<'static> {
    /// Traces the sun on a thread of its own: frames go on with the direction before, the first ones without the sun.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn trace_behind(&mut self) -> std::io::Result<()> {
        self.redraw();
        self.sun.trace_behind(self.field)
    }
}

/// A sun below the horizon, where there is one, costs nothing and shows nothing.
fn sun_is_up(sun: &SunWeight, set: &PatchSet) -> bool {
    (sun.dir_world[1] >= 0.0 || set.horizon().is_none()) && sun.irradiance.iter().any(|&e| e > 0.0)
}

/// The thread pool; `None` where none can be had, and work is done on the caller's thread.
fn thread_pool(threads: usize) -> Option<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()
}

fn install<R: Send>(pool: Option<&rayon::ThreadPool>, work: impl FnOnce() -> R + Send) -> R {
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}
