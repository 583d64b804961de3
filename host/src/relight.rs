//! Field and weights into pictures: the tile loop around the firmware's kernels, with what each frame skipped.

mod file;
mod sunplane;

pub use file::{FieldFile, FieldFileError};

use crate::weights::PatchWeights;
use rayon::prelude::*;
use relume_firmware::composite::{Compositor, ViewPixels};
use relume_firmware::field::Field;
use relume_firmware::kernel::{Kernel, SUN_SHIFT};
use relume_firmware::relight::{Coefficients, LINEAR_BITS, LinearTile, TileLight};
use relume_firmware::surface::Surface;
use relume_firmware::tile::{MAX_RANK, TILE_PIXELS, TILE_PX};
use relume_firmware::tone::{LINEAR_SLOPE, ViewLight};
use relume_firmware::weights::{FixedWeights, MAX_STANDOUTS, Standout, SunWeight, WeightError};
use std::sync::atomic::{AtomicU64, Ordering};
use sunplane::SunPlane;

/// A linear picture: premultiplied Rec.709 radiance in the weights' unit, and coverage.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`, row 0 at the top.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage, 0..=1, same order.
    pub alpha: Vec<f32>,
}

/// The real view behind, as 0x00RRGGBB sRGB pixels. Each new view has an identity of its own, so that a still costs
/// nothing after its first frame.
#[derive(Clone, Debug)]
pub struct View {
    width: usize,
    height: usize,
    pixels: Vec<u32>,
    identity: u64,
}

static VIEWS: AtomicU64 = AtomicU64::new(1);

impl View {
    /// A view of `width * height` pixels; missing pixels are black.
    pub fn new(width: usize, height: usize, mut pixels: Vec<u32>) -> Self {
        pixels.resize(width * height, 0);
        View { width, height, pixels, identity: VIEWS.fetch_add(1, Ordering::Relaxed) }
    }

    /// Width and height, px.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Changes the pixels in place (a live camera's next frame) and gives the view a new identity.
    pub fn pixels_mut(&mut self) -> &mut [u32] {
        self.identity = VIEWS.fetch_add(1, Ordering::Relaxed);
        &mut self.pixels
    }
}

/// What is shown: 0x00RRGGBB pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Framebuffer {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`.
    pub pixels: Vec<u32>,
}

impl Framebuffer {
    /// A black one.
    pub fn new(width: usize, height: usize) -> Self {
        Framebuffer { width, height, pixels: vec![0; width * height] }
    }
}

/// What one frame did and what it was spared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct FrameCounters {
    /// Tiles of the field.
    pub tiles: usize,
    /// Tiles without geometry: nothing is stored or read for them.
    pub tiles_empty: usize,
    /// Tiles drawn.
    pub tiles_drawn: usize,
    /// Tiles with geometry left as they were, because they would change by less than half a code.
    pub tiles_kept: usize,
    /// Patches of the field.
    pub patches: usize,
    /// Patches without light: not read.
    pub patches_dark: usize,
    /// Was there sun?
    pub sun_up: bool,
    /// Was the sun's response traced anew for this frame?
    pub sun_traced: bool,
}

/// What a tile showed when it was last drawn.
#[derive(Clone, Debug)]
struct Drawn {
    coefficients: Coefficients,
    sun_q16: [u32; 3],
    standouts: [Standout; MAX_STANDOUTS],
    view: u64,
}

impl Default for Drawn {
    fn default() -> Self {
        let standouts = [Standout::default(); MAX_STANDOUTS];
        Drawn { coefficients: Coefficients::ZERO, sun_q16: [0; 3], standouts, view: 0 }
    }
}

/// One tile's state from frame to frame.
#[derive(Clone, Debug)]
struct TileState {
    coefficients: Coefficients,
    /// Valid where `is_drawn`.
    drawn: Drawn,
    is_drawn: bool,
    /// Largest change of the sun's response plane since the tile was last drawn, in 1/32768, summed over retracings.
    sun_drift: u32,
    /// Largest value of the sun's response plane, in 1/32768.
    sun_peak: u32,
    /// Does the view show through anywhere?
    shows_view: bool,
    empty: bool,
}

/// Relights one field, frame after frame, on `threads` threads.
pub struct Relighter<'f> {
    field: Field<'f>,
    kernel: Kernel,
    light: ViewLight,
    pool: Option<rayon::ThreadPool>,
    /// One thread: frames run on the caller's, without handing over.
    alone: bool,
    weights: FixedWeights,
    given: PatchWeights,
    sun: SunPlane,
    states: Vec<TileState>,
    max_rank: usize,
    counters: FrameCounters,
}

/// A tile is kept when the bound on its change is below half an 8-bit code where the tone curve is steepest.
const HALF_CODE: f32 = 0.5 / LINEAR_SLOPE * (1 << LINEAR_BITS) as f32;

impl<'f> Relighter<'f> {
    /// A relighter on `threads` threads, 0 for one per core.
    pub fn new(field: Field<'f>, threads: usize) -> Self {
        Self::with_kernel(field, threads, Kernel::detect())
    }

    /// The same on a kernel of the caller's choice.
    pub fn with_kernel(field: Field<'f>, threads: usize, kernel: Kernel) -> Self {
        let tiles = field.response();
        let states = (0..tiles.tiles()).map(|index| TileState::new(&field, index)).collect();
        let patches = field.patch_set().len();
        let pool = thread_pool(threads);
        Relighter {
            field,
            kernel,
            light: ViewLight::new(),
            alone: threads == 1 || pool.is_none(),
            pool,
            weights: FixedWeights::dark(patches),
            given: PatchWeights { radiance: vec![[0.0; 3]; patches], sun: None },
            sun: SunPlane::new(&field),
            states,
            max_rank: MAX_RANK,
            counters: FrameCounters { tiles: tiles.tiles(), patches, ..FrameCounters::default() },
        }
    }

    /// The field.
    pub fn field(&self) -> &Field<'f> {
        &self.field
    }

    /// The kernel path in use.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// Uses at most this many ranks per tile from the next weights on.
    pub fn set_max_rank(&mut self, max_rank: usize) {
        self.max_rank = max_rank;
    }

    /// Retraces the sun only when it has moved by more than this, degrees (0: whenever it has moved).
    pub fn set_sun_step_deg(&mut self, step_deg: f64) {
        self.sun.set_step_deg(step_deg);
    }

    /// Forgets what was relit: the next [`Relighter::draw`] draws every tile with geometry. Tiles that show the view
    /// alone are not concerned.
    pub fn invalidate(&mut self) {
        self.states.iter_mut().filter(|state| !state.empty).for_each(|state| state.is_drawn = false);
    }

    /// Takes weights and an exposure (factor from radiance to display white): quantises and projects them, and traces
    /// the sun's response if it has moved.
    ///
    /// # Errors
    /// [`WeightError`]; everything then stays as it was.
    pub fn set_weights(&mut self, given: &PatchWeights, exposure: f32) -> Result<(), WeightError> {
        let sun = given.sun.filter(sun_is_up);
        self.weights.set(&given.radiance, sun.as_ref(), exposure)?;
        self.given.radiance.clone_from(&given.radiance);
        self.given.sun = sun;
        self.counters.patches_dark = self.weights.dark_patches();
        self.counters.sun_up = sun.is_some();
        self.counters.sun_traced = false;
        if let Some(sun) = sun {
            let changes = self.sun.follow(&self.field, sun.dir_world, self.pool.as_ref());
            self.counters.sun_traced = changes.is_some();
            for (state, change) in self.states.iter_mut().zip(changes.unwrap_or(&[])) {
                state.sun_drift = state.sun_drift.saturating_add(change.largest);
                state.sun_peak = change.peak;
            }
        }
        let (field, weights, kernel, max_rank) = (&self.field, &self.weights, self.kernel, self.max_rank);
        let project = |(index, state): (usize, &mut TileState)| {
            if !state.empty {
                let response = field.response();
                if index + 1 < response.tiles() {
                    Coefficients::prefetch_projection(&response.tile(index + 1), kernel);
                }
                state.coefficients.project(&response.tile(index), weights, kernel, max_rank);
            }
        };
        let states = &mut self.states;
        if self.alone {
            states.iter_mut().enumerate().for_each(project);
        } else {
            install(self.pool.as_ref(), || states.par_iter_mut().enumerate().with_min_len(16).for_each(project));
        }
        Ok(())
    }

    /// The linear picture of the newest weights, whatever their exposure was.
    pub fn radiance(&mut self) -> Picture {
        let (width, height) = (self.field.width(), self.field.height());
        let mut picture =
            Picture { width, height, rgb: vec![[0.0; 3]; width * height], alpha: vec![0.0; width * height] };
        let exposure = reading_exposure(&self.given, &self.field);
        let mut weights = FixedWeights::dark(self.given.radiance.len());
        // The same weights were accepted before, and the exposure is finite.
        if weights.set(&self.given.radiance, self.given.sun.as_ref(), exposure).is_err() {
            return picture;
        }
        let scale = 1.0 / (f64::from(exposure) * f64::from(1u32 << LINEAR_BITS));
        let (field, kernel, max_rank) = (&self.field, self.kernel, self.max_rank);
        let sun = self.given.sun.map(|_| (self.sun.plane(), weights.sun_q16()));
        let light = TileLight { sun, standouts: weights.standouts() };
        let (columns, _) = field.response().grid();
        let bands = picture.rgb.par_chunks_mut(width * TILE_PX).zip(picture.alpha.par_chunks_mut(width * TILE_PX));
        install(self.pool.as_ref(), || {
            bands.enumerate().for_each(|(row, (rgb, alpha))| {
                let (mut linear, mut coefficients) = (LinearTile::new(), Coefficients::ZERO);
                for column in 0..columns {
                    let index = row * columns + column;
                    let tile = field.response().tile(index);
                    coefficients.project(&tile, &weights, kernel, max_rank);
                    coefficients.pixels(field, index, &light, kernel, &mut linear);
                    let coverage = field.coverage(index);
                    for (k, pixel) in tile.covered().enumerate() {
                        let at = pixel / TILE_PX * width + column * TILE_PX + pixel % TILE_PX;
                        rgb[at] = linear.rgb(k).map(|value| (f64::from(value) * scale) as f32);
                        alpha[at] = coverage.map_or(1.0, |c| f32::from(c[k]) / 255.0);
                    }
                }
            });
        });
        picture
    }

    /// Draws the newest weights over `view`: only tiles that may change by half a code or more since they were last
    /// drawn, or where a new view shows through. View and framebuffer must have the field's size.
    pub fn draw(&mut self, view: &View, framebuffer: &mut Framebuffer) -> FrameCounters {
        let (width, height) = (self.field.width(), self.field.height());
        if framebuffer.pixels.len() != width * height {
            *framebuffer = Framebuffer::new(width, height);
            self.states.iter_mut().for_each(|state| state.is_drawn = false);
        }
        let (columns, _) = self.field.response().grid();
        let drawing = Drawing {
            field: &self.field,
            compositor: Compositor {
                view: ViewPixels { pixels_xrgb: &view.pixels, stride: view.width },
                light: &self.light,
                kernel: self.kernel,
            },
            light: TileLight {
                sun: self.given.sun.map(|_| (self.sun.plane(), self.weights.sun_q16())),
                standouts: self.weights.standouts(),
            },
            view: view.identity,
        };
        let band = |(row, (pixels, states)): (usize, (&mut [u32], &mut [TileState]))| drawing.band(row, pixels, states);
        let add = |a: Drew, b: Drew| Drew { drawn: a.drawn + b.drawn, kept: a.kept + b.kept, empty: a.empty + b.empty };
        let (pixels, states) = (&mut framebuffer.pixels, &mut self.states);
        let drew = if self.alone {
            let bands = pixels.chunks_mut(width * TILE_PX).zip(states.chunks_mut(columns));
            bands.enumerate().map(band).fold(Drew::default(), add)
        } else {
            let bands = pixels.par_chunks_mut(width * TILE_PX).zip(states.par_chunks_mut(columns));
            install(self.pool.as_ref(), || bands.enumerate().map(band).reduce(Drew::default, add))
        };
        FrameCounters { tiles_drawn: drew.drawn, tiles_kept: drew.kept, tiles_empty: drew.empty, ..self.counters }
    }
}

/// A sun at or below the horizon costs nothing and shows nothing.
fn sun_is_up(sun: &SunWeight) -> bool {
    sun.dir_world[1] >= 0.0 && sun.irradiance.iter().any(|&e| e > 0.0)
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

/// A power of two that brings the picture near display white, so that fixed point keeps its precision: from the
/// radiance that a white surface would show if it met all the light at once.
fn reading_exposure(weights: &PatchWeights, field: &Field<'_>) -> f32 {
    let set = field.patch_set();
    let sky: f64 = weights
        .radiance
        .iter()
        .enumerate()
        .map(|(patch, rgb)| f64::from(rgb.iter().fold(0.0f32, |m, &v| m.max(v))) * f64::from(set.solid_angle_sr(patch)))
        .sum();
    let sun = weights.sun.map_or(0.0, |sun| f64::from(sun.irradiance.iter().fold(0.0f32, |m, &v| m.max(v))));
    let white = (sky + sun) / std::f64::consts::PI;
    if white > 0.0 { 2f64.powf(-white.log2().ceil()).clamp(1e-30, 1e30) as f32 } else { 1.0 }
}

impl TileState {
    fn new(field: &Field<'_>, index: usize) -> Self {
        let tile = field.response().tile(index);
        TileState {
            coefficients: Coefficients::ZERO,
            drawn: Drawn::default(),
            is_drawn: false,
            sun_drift: 0,
            sun_peak: 0,
            shows_view: tile.pixels() < TILE_PIXELS || field.coverage(index).is_some(),
            empty: tile.pixels() == 0,
        }
    }

    /// May tile number `index` stay as it is?
    fn unchanged(&self, index: usize, drawing: &Drawing<'_>) -> bool {
        let drawn = &self.drawn;
        if !self.is_drawn {
            return false;
        }
        if self.shows_view && drawn.view != drawing.view {
            return false;
        }
        let sun_q16 = drawing.sun_q16();
        let unit = (1u32 << SUN_SHIFT) as f32;
        let sun = |c: usize| {
            let moved = self.sun_drift as f32 * drawn.sun_q16[c].max(sun_q16[c]) as f32;
            (moved + drawn.sun_q16[c].abs_diff(sun_q16[c]) as f32 * self.sun_peak as f32) / unit
        };
        let sun = sun(0).max(sun(1)).max(sun(2));
        let bound = self.coefficients.change_bound(&drawn.coefficients) + sun;
        bound < HALF_CODE && bound + drawing.residual_change(index, &drawn.standouts) < HALF_CODE
    }
}

/// Tiles of a band or frame, by what became of them.
#[derive(Clone, Copy, Default)]
struct Drew {
    drawn: usize,
    kept: usize,
    empty: usize,
}

/// What all bands of a frame share.
struct Drawing<'a> {
    field: &'a Field<'a>,
    compositor: Compositor<'a>,
    light: TileLight<'a>,
    view: u64,
}

impl Drawing<'_> {
    /// Draws one row of tiles.
    fn band(&self, row: usize, pixels: &mut [u32], states: &mut [TileState]) -> Drew {
        let width = self.field.width();
        let rows = pixels.len() / width;
        let Ok(mut surface) = Surface::new(pixels, width, rows, width) else { return Drew::default() };
        let mut drew = Drew::default();
        let mut linear = LinearTile::new();
        let columns = states.len();
        for (column, state) in states.iter_mut().enumerate() {
            let index = row * columns + column;
            drew.empty += usize::from(state.empty);
            if state.unchanged(index, self) {
                drew.kept += usize::from(!state.empty);
                continue;
            }
            let response = self.field.response();
            if index + 1 < response.tiles() {
                Coefficients::prefetch_pixels(&response.tile(index + 1), self.compositor.kernel);
            }
            let tile = response.tile(index);
            state.coefficients.pixels(self.field, index, &self.light, self.compositor.kernel, &mut linear);
            let at = (column * TILE_PX, row * TILE_PX);
            let target = (&mut surface, row * TILE_PX);
            self.compositor.tile(&tile, &linear, self.field.coverage(index), at, target);
            state.sun_drift = 0;
            self.note(state);
            drew.drawn += usize::from(!state.empty);
        }
        drew
    }

    fn sun_q16(&self) -> [u32; 3] {
        self.light.sun.map_or([0; 3], |(_, q16)| q16)
    }

    fn note(&self, state: &mut TileState) {
        let drawn = &mut state.drawn;
        drawn.coefficients.copy_from(&state.coefficients);
        drawn.sun_q16 = self.sun_q16();
        drawn.standouts = [Standout::default(); MAX_STANDOUTS];
        drawn.standouts[..self.light.standouts.len()].copy_from_slice(self.light.standouts);
        drawn.view = self.view;
        state.is_drawn = true;
    }

    /// A bound on what residuals change in a tile that was drawn with `old` standouts, in 1/2^20 of display white.
    fn residual_change(&self, index: usize, old: &[Standout]) -> f32 {
        if self.light.standouts.is_empty() && old.iter().all(|s| s.light == [0.0; 3]) {
            return 0.0;
        }
        let (tile, residuals) = (self.field.response().tile(index), self.field.residuals());
        let light = |of: &[Standout], patch: u16| {
            of.iter().find(|s| s.patch == patch && s.light != [0.0; 3]).map_or([0.0; 3], |s| s.light)
        };
        let change = |patch: u16| {
            let Some(residual) = residuals.get(index, &tile, usize::from(patch)) else { return 0.0 };
            let (new, old) = (light(self.light.standouts, patch), light(old, patch));
            let step = |c: usize| (new[c] - old[c]).abs() * residual.scale[c];
            127.0 * step(0).max(step(1)).max(step(2))
        };
        let gone = old.iter().filter(|s| light(self.light.standouts, s.patch) == [0.0; 3]);
        let sum: f32 = self.light.standouts.iter().chain(gone).map(|s| change(s.patch)).sum();
        sum * (1 << LINEAR_BITS) as f32 + 1.0
    }
}
