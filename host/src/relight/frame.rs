//! A frame: which tiles are drawn, over which view, within which budget.

use super::budget::Budget;
use super::buffers::{Framebuffer, View};
use super::counters::FrameCounters;
use super::draw::{Drawing, Drew};
use super::shading::{Backdrop, BackdropVersion};
use super::tiles::TileState;
use super::{Relighter, install};
use rayon::prelude::*;
use relume_firmware::composite::{Compositor, ViewPixels};
use relume_firmware::tile::TILE_PX;
use std::time::{Duration, Instant};

impl Relighter<'_> {
    /// Draws the newest weights over `view`: only tiles that may change by half a code or more since they were last
    /// drawn. Where a new view shows through tiles that may stay, only that is composited. View and framebuffer must have
    /// the field's size.
    pub fn draw(&mut self, view: &View, framebuffer: &mut Framebuffer) -> FrameCounters {
        self.draw_over(&Backdrop { view, shading: None }, framebuffer)
    }

    /// The same over a view that is shaded.
    pub fn draw_over(&mut self, behind: &Backdrop<'_>, framebuffer: &mut Framebuffer) -> FrameCounters {
        let started = if self.new_weights { self.started } else { Instant::now() };
        let (width, height) = (self.field.width(), self.field.height());
        if framebuffer.pixels.len() != width * height {
            *framebuffer = Framebuffer::new(width, height);
            self.redraw();
            self.states.iter_mut().for_each(|state| state.is_drawn = false);
        }
        if let Some(still) = self.still(behind) {
            return still;
        }
        self.look_at(behind.view);
        let only_view = self.shown.is_some_and(|(_, _, moment)| self.settled && moment == self.moment);
        self.catch_up(Some(behind));
        if !only_view {
            self.find_standing();
        }
        if !self.new_weights {
            self.counters.count_no_light();
        }
        if let Budget::Time(allowed) = self.budget {
            self.choose(behind, started, allowed);
        }
        let drawing = Instant::now();
        let mut drew = self.draw_tiles(behind, framebuffer);
        self.pace.follow(drawing.elapsed(), drew.drawn);
        if let Budget::ErrorCodes(codes) = self.budget {
            drew = self.draw_within(codes, behind, framebuffer, drew);
        }
        let counters = self.count(&drew);
        if !only_view || drew.drawn > 0 {
            self.remember_standing();
        }
        let finished = self.settled && drew.waiting == 0;
        self.shown = finished.then_some((counters, behind.version(), self.moment));
        self.new_weights = false;
        counters
    }

    /// Draws again with more of the way back until no tile is off by more than `codes`, after a frame that `drew` so much.
    fn draw_within(
        &mut self,
        codes: f32,
        behind: &Backdrop<'_>,
        framebuffer: &mut Framebuffer,
        mut drew: Drew,
    ) -> Drew {
        while self.levels.bounds(&self.field).is_some() && self.raise_levels(codes) {
            let again = self.draw_tiles(behind, framebuffer);
            let (drawn, composited) = (drew.drawn + again.drawn, drew.composited + again.composited);
            drew = Drew { drawn, composited, ..again };
            drew.kept = self.counters.tiles.saturating_sub(drew.empty + drew.drawn + drew.composited);
        }
        drew
    }

    /// The counters of a frame that `drew` so much.
    pub(super) fn count(&self, drew: &Drew) -> FrameCounters {
        let mut counters = FrameCounters {
            tiles_drawn: drew.drawn,
            tiles_composited: drew.composited,
            tiles_kept: drew.kept,
            tiles_waiting: drew.waiting,
            tiles_empty: drew.empty,
            tiles_way_back: drew.way_back,
            tiles_beyond_budget: drew.beyond_budget,
            rank_limit: self.rank_limit,
            ..self.counters
        };
        if self.levels.bounds(&self.field).is_some() {
            (counters.bound_linear, counters.bound_codes) = (Some(drew.bound_linear), Some(drew.bound_codes));
        }
        counters
    }

    /// Can blocks be looked at instead of tiles? Not within an error budget, which needs each tile's own bound, nor where the
    /// sun's response has moved, or fewer ranks are used.
    pub(super) fn may_stand(&self) -> bool {
        self.levels.bounds(&self.field).is_some()
            && !matches!(self.budget, Budget::ErrorCodes(_))
            && self.rank_limit.is_none()
            && !self.counters.sun_traced
    }

    /// Projects the blocks that lag behind the newest weights and must be drawn all the same, before what is behind.
    pub(super) fn catch_up(&mut self, behind: Option<&Backdrop<'_>>) {
        let version = |tile: usize| behind.map_or(BackdropVersion::NONE, |behind| behind.version_of(tile));
        let (possible, response) = (self.may_stand(), self.field.response());
        let (field, levels, states) = ((&self.field, &*self.tiles), &self.levels, &self.states);
        for (index, block) in self.blocks.iter_mut().enumerate().filter(|(_, block)| block.lags()) {
            let stays = possible && block.standing.stays().is_some();
            if !stays || response.tiles_of(index).any(|tile| states[tile].must_be_drawn(version(tile))) {
                block.standing.forget();
                block.project(field, index, levels, self.kernel, false);
            }
        }
    }

    /// Finds the blocks whose tiles all may stay, beside those that were not even projected.
    pub(super) fn find_standing(&mut self) {
        let possible = self.may_stand();
        let by_factors = self.levels.get(0).weights.apart().next().is_none();
        let (slope, sun_q16) = (&self.slope, self.shown_sun_q16());
        for block in self.blocks.iter_mut().filter(|block| !block.lags()) {
            // Once the light is not known any more in which tiles were looked at, they are looked at again.
            let possible = possible && block.standing.moment().is_none_or(|moment| self.lights.of(moment).is_some());
            match (possible, by_factors) {
                (true, true) => block.stand(slope, sun_q16),
                (true, false) => block.standing.look_again(),
                (false, _) => block.standing.forget(),
            }
        }
    }

    /// Remembers how far the tiles of the other blocks have moved.
    pub(super) fn remember_standing(&mut self) {
        if !self.may_stand() {
            return;
        }
        let (moment, sun_q16) = (self.moment, self.shown_sun_q16());
        let response = self.field.response();
        let mut looked_at = false;
        for (index, block) in self.blocks.iter_mut().enumerate().filter(|(_, block)| block.tile.is_some()) {
            let drawn = response.tiles_of(index).fold(false, |any, tile| self.states[tile].was_drawn() | any);
            if drawn || block.standing.stays().is_none() {
                looked_at = true;
                block.remember(response.tiles_of(index).map(|tile| &self.states[tile]), (moment, sun_q16));
            }
        }
        if looked_at {
            self.lights.remember(moment);
        }
    }

    /// The sun's weight in what is drawn.
    pub(super) fn shown_sun_q16(&self) -> [u32; 3] {
        self.given.sun.map_or([0; 3], |_| self.levels.get(0).weights.sun_q16())
    }

    /// Takes notice of the view: once it changes it is live, and the edge pixels' light is kept from then on, so that a new
    /// view is composited without relighting.
    fn look_at(&mut self, view: &View) {
        let changed = self.view.replace(view.identity).is_some_and(|old| old != view.identity);
        if changed {
            self.expect_live_view();
        }
    }

    /// Keeps the edge pixels' light from now on, before a view has ever changed: then even the first change is composited
    /// only, and what is drawn when depends on the light alone.
    pub fn expect_live_view(&mut self) {
        if !std::mem::replace(&mut self.live, true) {
            self.states.iter_mut().zip(&self.tiles).for_each(|(state, tile)| state.keep_edges(tile));
        }
    }

    /// The counters of a frame in which nothing has changed since the one before, if this is one.
    pub(super) fn still(&self, behind: &Backdrop<'_>) -> Option<FrameCounters> {
        let (last, version, moment) = self.shown?;
        let same = self.settled && version == behind.version() && moment == self.moment;
        let kept = FrameCounters {
            tiles_drawn: 0,
            tiles_composited: 0,
            tiles_waiting: 0,
            tiles_kept: last.tiles - last.tiles_empty,
            bound_linear: last.bound_linear,
            bound_codes: last.bound_codes,
            rank_limit: self.rank_limit,
            tiles_empty: last.tiles_empty,
            tiles_way_back: 0,
            tiles_beyond_budget: last.tiles_beyond_budget,
            ..self.counters
        };
        same.then_some(kept.without_light())
    }

    /// Finds what has changed, and lets wait what does not get done in the time that is left.
    fn choose(&mut self, behind: &Backdrop<'_>, started: Instant, allowed: Duration) {
        let mut states = std::mem::take(&mut self.states);
        self.with_drawing(behind, |drawing| {
            let judge = |(index, state): (usize, &mut TileState)| drawing.judge(index, state);
            if self.alone {
                states.iter_mut().enumerate().for_each(judge);
            } else {
                install(self.pool.as_ref(), || states.par_iter_mut().enumerate().with_min_len(64).for_each(judge));
            }
        });
        self.states = states;
        let tiles = self.counters.tiles;
        let most = self.pace.tiles_in(allowed.saturating_sub(started.elapsed()), tiles);
        self.choice.choose(&mut self.states, most);
    }

    fn draw_tiles(&mut self, behind: &Backdrop<'_>, framebuffer: &mut Framebuffer) -> Drew {
        let (width, columns) = (self.field.width(), self.field.response().grid().0);
        let mut states = std::mem::take(&mut self.states);
        let drew = self.with_drawing(behind, |drawing| {
            let band =
                |(row, (pixels, states)): (usize, (&mut [u32], &mut [TileState]))| drawing.band(row, pixels, states);
            let pixels = &mut framebuffer.pixels;
            if self.alone {
                let bands = pixels.chunks_mut(width * TILE_PX).zip(states.chunks_mut(columns));
                bands.enumerate().map(band).fold(Drew::default(), Drew::and)
            } else {
                let bands = pixels.par_chunks_mut(width * TILE_PX).zip(states.par_chunks_mut(columns));
                install(self.pool.as_ref(), || bands.enumerate().map(band).reduce(Drew::default, Drew::and))
            }
        });
        self.states = states;
        drew
    }

    /// Works with what all tiles of a frame share.
    pub(super) fn with_drawing<R>(&self, behind: &Backdrop<'_>, work: impl FnOnce(&Drawing<'_>) -> R) -> R {
        let ((unpacked, count), view) = (self.levels.unpacked(), behind.view);
        work(&Drawing {
            field: &self.field,
            tiles: &self.tiles,
            compositor: Compositor {
                view: ViewPixels { pixels_xrgb: &view.pixels, stride: view.width },
                light: &self.light,
                kernel: self.kernel,
            },
            levels: &self.levels,
            blocks: &self.blocks,
            sun: self.given.sun.map(|_| (self.sun.plane(), self.shown_sun_q16())),
            unpacked: &unpacked[..count],
            for_time: matches!(self.budget, Budget::Time(_)),
            most_codes: if let Budget::ErrorCodes(codes) = self.budget { codes } else { f32::INFINITY },
            slope: &self.slope,
            behind: *behind,
            rank_limit: self.rank_limit,
            moment: self.moment,
        })
    }
}
