//! The sun's response plane for one direction of the sun, traced anew when the sun has moved.

use crate::sun::angle_deg;
use rayon::prelude::*;
use relume_firmware::bounce::{Rgb, mean_up};
use relume_firmware::field::Field;
use relume_firmware::sunlight::SunLight;

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
    /// Light on the bounce points, in the upper half, and its means up their tree.
    means: Vec<Rgb>,
    dir_world: Option<[f32; 3]>,
    step_deg: f64,
}

impl SunPlane {
    pub(super) fn new(field: &Field<'_>) -> Self {
        let response = field.response();
        SunPlane {
            values: vec![0; response.plane_len()],
            fresh: vec![0; response.plane_len()],
            changes: vec![Change::default(); response.tiles()],
            means: vec![[0.0; 3]; 2 * field.bounce().points()],
            dir_world: None,
            step_deg: 0.0,
        }
    }

    pub(super) fn set_step_deg(&mut self, step_deg: f64) {
        self.step_deg = step_deg.max(0.0);
    }

    pub(super) fn plane(&self) -> &[u16] {
        &self.values
    }

    /// Traces the plane for this direction if it is further from the traced one than the step; returns what changed.
    pub(super) fn follow(
        &mut self,
        field: &Field<'_>,
        dir_world: [f32; 3],
        pool: Option<&rayon::ThreadPool>,
    ) -> Option<&[Change]> {
        if self.dir_world.is_some_and(|old| old == dir_world || angle_deg(old, dir_world) < self.step_deg) {
            return None;
        }
        let light = SunLight::new(field, dir_world);
        let response = field.response();
        let slots = slots(field, &mut self.fresh);
        let old = &self.values;
        let means = &mut self.means;
        super::install(pool, || {
            let points = means.len() / 2;
            let chunks = means[points..].par_chunks_mut(POINTS_AT_ONCE).enumerate();
            chunks.for_each(|(chunk, out)| light.points(field, chunk * POINTS_AT_ONCE, out));
            mean_up(means);
            (slots, &mut self.changes).into_par_iter().enumerate().for_each(|(index, (slot, change))| {
                light.tile(field, index, means, slot);
                let at = response.tile(index).plane_at;
                let before = &old[at..at + slot.len()];
                let largest = slot.iter().zip(before).map(|(a, b)| u32::from(a.abs_diff(*b))).max();
                let peak = slot.iter().chain(before).map(|&v| u32::from(v)).max();
                *change = Change { largest: largest.unwrap_or(0), peak: peak.unwrap_or(0) };
            });
        });
        std::mem::swap(&mut self.values, &mut self.fresh);
        self.dir_world = Some(dir_world);
        Some(&self.changes)
    }
}

/// The plane cut into the tiles' slots, in tile order. Places rise with the tile number in files of `relume-bake`;
/// a tile whose place does not gets an empty slot and thus no sun.
fn slots<'p>(field: &Field<'_>, mut plane: &'p mut [u16]) -> Vec<&'p mut [u16]> {
    let response = field.response();
    let mut begin = 0;
    (0..response.tiles())
        .map(|index| {
            let tile = response.tile(index);
            let skip = tile.plane_at.checked_sub(begin)?;
            let (_, rest) = std::mem::take(&mut plane).split_at_mut_checked(skip)?;
            let (slot, rest) = rest.split_at_mut_checked(3 * tile.padded_pixels())?;
            plane = rest;
            begin = tile.plane_at + slot.len();
            Some(slot)
        })
        .map(Option::unwrap_or_default)
        .collect()
}
