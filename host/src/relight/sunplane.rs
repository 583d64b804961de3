//! The sun's response plane for one direction of the sun, traced anew when the sun has moved: at once, or on a thread of its
//! own while frames go on under the plane before, at first without the sun.

use super::suntracer::SunTracer;
use crate::sun::angle_deg;
use rayon::prelude::*;
use relume_firmware::bounce::{Rgb, mean_up};
use relume_firmware::field::Field;
use relume_firmware::sunlight::SunLight;
use std::ops::Range;

/// Bounce points that one task lights.
const POINTS_AT_ONCE: usize = 512;

/// How the plane changed in one tile, in 1/32768.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Change {
    /// Largest change of any value.
    pub(super) largest: u32,
    /// Largest value.
    pub(super) peak: u32,
}

/// u16 per covered pixel and channel, in 1/32768, laid out like the field's row scales.
pub(super) struct SunPlane {
    values: Vec<u16>,
    fresh: Vec<u16>,
    changes: Vec<Change>,
    means: Vec<Rgb>,
    dir_world: Option<[f32; 3]>,
    step_deg: f64,
    tracer: Option<SunTracer>,
    is_held: bool,
}

/// A plane whose sun stood further away than this is not shown until the next is traced, degrees: yesterday's evening tells
/// nothing of a morning.
const FAR_DEG: f64 = 10.0;

impl SunPlane {
    pub(super) fn new(field: &Field<'_>) -> Self {
        let response = field.response();
        SunPlane {
            values: vec![0; response.plane_len()],
            fresh: vec![0; response.plane_len()],
            changes: vec![Change::default(); response.tiles()],
            means: means(field),
            dir_world: None,
            step_deg: 0.0,
            tracer: None,
            is_held: false,
        }
    }

    pub(super) fn set_step_deg(&mut self, step_deg: f64) {
        self.step_deg = step_deg.max(0.0);
    }

    /// Traces on a thread of its own. Until the first plane is there, nothing comes of the sun.
    pub(super) fn trace_behind(&mut self, field: Field<'static>) -> std::io::Result<()> {
        self.tracer = Some(SunTracer::start(field)?);
        self.dir_world = None;
        self.values.fill(0);
        Ok(())
    }

    /// Is a plane being traced behind frames?
    pub(super) fn is_tracing(&mut self) -> bool {
        self.tracer.as_mut().is_some_and(SunTracer::is_tracing)
    }

    /// Takes nothing that is ready, and asks for nothing, for as long as this is so.
    pub(super) fn hold(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    pub(super) fn plane(&self) -> &[u16] {
        &self.values
    }

    /// The direction that the plane is for.
    pub(super) fn dir_world(&self) -> Option<[f32; 3]> {
        self.dir_world
    }

    /// Is a plane ready that [`SunPlane::follow`] would take?
    pub(super) fn has_news(&mut self) -> bool {
        self.tracer.as_mut().is_some_and(SunTracer::is_ready)
    }

    /// Will there be a plane of about this direction once it is followed? Until then light is shown as if it had no sun, so
    /// that pictures depend on what they show alone, not on what waited.
    pub(super) fn will_show(&mut self, dir_world: [f32; 3]) -> bool {
        match &mut self.tracer {
            Some(tracer) => {
                let ready = tracer.ready_dir_world().filter(|_| !self.is_held);
                ready.into_iter().chain(self.dir_world).any(|traced| is_near(traced, dir_world))
            }
            None => true,
        }
    }

    /// Traces the plane for this direction if it is further from the traced one than the step, or has it traced and takes
    /// what was ready when [`SunPlane::will_show`] was asked, unless the sun has gone far from it; returns what changed.
    pub(super) fn follow(
        &mut self,
        field: &Field<'_>,
        dir_world: [f32; 3],
        pool: Option<&rayon::ThreadPool>,
    ) -> Option<&[Change]> {
        let step_deg = self.step_deg;
        let moved =
            |from: Option<[f32; 3]>| from.is_none_or(|old| old != dir_world && angle_deg(old, dir_world) >= step_deg);
        if let Some(tracer) = &mut self.tracer {
            if self.is_held {
                return None;
            }
            let taken = tracer.known_dir_world();
            if taken.is_some() {
                tracer.take(&mut self.fresh);
            }
            if moved(taken.or(self.dir_world)) {
                tracer.ask(dir_world);
            }
            self.dir_world = Some(taken.filter(|&traced| is_near(traced, dir_world))?);
        } else {
            if !moved(self.dir_world) {
                return None;
            }
            super::install(pool, || trace(field, dir_world, &mut self.means, &mut self.fresh));
            self.dir_world = Some(dir_world);
        }
        super::install(pool, || compare(field, &self.values, &self.fresh, &mut self.changes));
        std::mem::swap(&mut self.values, &mut self.fresh);
        Some(&self.changes)
    }
}

fn is_near(traced: [f32; 3], dir_world: [f32; 3]) -> bool {
    traced == dir_world || angle_deg(traced, dir_world) < FAR_DEG
}

/// Room for the light on the bounce points, in the upper half, and its means up their tree.
pub(super) fn means(field: &Field<'_>) -> Vec<Rgb> {
    vec![[0.0; 3]; 2 * field.bounce().points()]
}

/// Traces the whole plane.
pub(super) fn trace(field: &Field<'_>, dir_world: [f32; 3], means: &mut [Rgb], plane: &mut [u16]) {
    let light = SunLight::new(field, dir_world);
    let points = means.len() / 2;
    let chunks = means[points..].par_chunks_mut(POINTS_AT_ONCE).enumerate();
    chunks.for_each(|(chunk, out)| light.points(field, chunk * POINTS_AT_ONCE, out));
    mean_up(means);
    let means = &*means;
    let tiles = field.response().tiles();
    if tiles > 0 {
        light_tiles(0..tiles, 0, plane, &|index, slot| light.tile(field, index, means, slot), field);
    }
}

/// How far two planes are apart, tile by tile.
fn compare(field: &Field<'_>, old: &[u16], new: &[u16], changes: &mut [Change]) {
    let response = field.response();
    changes.par_iter_mut().enumerate().with_min_len(64).for_each(|(index, change)| {
        let tile = response.tile(index);
        let place = tile.plane_at..tile.plane_at + 3 * tile.padded_pixels();
        let (Some(old), Some(new)) = (old.get(place.clone()), new.get(place)) else { return };
        let largest = new.iter().zip(old).map(|(a, b)| u32::from(a.abs_diff(*b))).max();
        let peak = new.iter().chain(old).map(|&v| u32::from(v)).max();
        *change = Change { largest: largest.unwrap_or(0), peak: peak.unwrap_or(0) };
    });
}

/// Lights tiles whose slots lie in `plane`, which begins at `begin` of the whole one, halves of them on threads of their own: so
/// that nothing is allocated to hand the slots out. Places rise with the tile number in files of `relume-bake`; a tile whose place
/// does not gets no sun.
fn light_tiles(
    tiles: Range<usize>,
    begin: usize,
    plane: &mut [u16],
    light: &(impl Fn(usize, &mut [u16]) + Sync),
    field: &Field<'_>,
) {
    let response = field.response();
    let first_at = response.tile(tiles.start).plane_at;
    if tiles.len() == 1 {
        let end = first_at + 3 * response.tile(tiles.start).padded_pixels();
        let place = first_at.checked_sub(begin).zip(end.checked_sub(begin));
        let slot = place.and_then(|(first, end)| plane.get_mut(first..end));
        return light(tiles.start, slot.unwrap_or_default());
    }
    let middle = tiles.start + tiles.len() / 2;
    let middle_at = response.tile(middle).plane_at.clamp(begin, begin + plane.len());
    let (low, high) = plane.split_at_mut(middle_at - begin);
    rayon::join(
        || light_tiles(tiles.start..middle, begin, low, light, field),
        || light_tiles(middle..tiles.end, middle_at, high, light, field),
    );
}
