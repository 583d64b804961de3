//! The work of a bake: scene -> response -> tiles, a block of tiles at a time, in any order and on any machine.

use crate::bake::{BakeError, BakeOptions, sun_dir_world};
use crate::blocks::{BlockCompressor, BlockTile, FieldBlock};
use crate::bouncepoints::BouncePoints;
use crate::brightness::brightness;
use crate::camera::Camera;
use crate::error::{ExactTile, TestLight};
use crate::heldout::{TestSky, captured, held_out};
use crate::part::Part;
use crate::preview::{self, SmallPicture};
use crate::prior::Prior;
use crate::progress::Progress;
use crate::response::{TileResponse, Transport};
use crate::stack::{Manifest, ManifestSun, StackWriter};
use crate::sun::SunDisc;
use crate::sunlayers::CasterLayers;
use crate::transfer::Gathered;
use crate::viewpoint::check_shape;
use rayon::prelude::*;
use relume_firmware::glue::map::MapError;
use relume_firmware::patches::PatchSet;
use relume_firmware::tile::{BLOCK_TILES, TILE_PX};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Mutex;

/// A block that is done and waits for its place in the file.
#[derive(Debug, Serialize, Deserialize)]
pub struct DoneBlock {
    /// Its number, row by row.
    pub number: u32,
    /// Its bytes.
    pub block: FieldBlock,
    /// Per tile of it, row by row, its exact sums.
    pub exact: Vec<ExactTile>,
}

/// Columns and rows of blocks of a picture, `size` in px.
pub fn block_grid(size: (u32, u32)) -> (u32, u32) {
    let edge_px = (BLOCK_TILES * TILE_PX) as u32;
    (size.0.div_ceil(edge_px), size.1.div_ceil(edge_px))
}

/// Number of blocks of a picture.
pub fn block_count(size: (u32, u32)) -> u32 {
    let (columns, rows) = block_grid(size);
    columns * rows
}

/// Everything that all blocks share.
pub struct Job<'s> {
    /// Light from the patches to the pixels.
    pub transport: Transport<'s>,
    /// Turns responses into bytes.
    pub compressor: BlockCompressor,
    /// What sunlight is passed on from.
    pub bounce: BouncePoints,
    /// The whole view, small.
    pub small: SmallPicture,
    /// The uncompressed stack, if one is wanted.
    pub stack: Option<StackWriter>,
    stack_sun: Option<SunDisc>,
    /// Held-out skies.
    pub test_light: TestLight,
    /// The patches.
    pub patches: PatchSet,
    /// What of the scene it is of.
    pub part: Part<'s>,
    size: (u32, u32),
}

/// About so many pixels of a small picture tell how bright each patch makes the large one.
const SMALL_PX: f64 = 3072.0;

impl<'s> Job<'s> {
    /// Prepares a bake: patches, held-out skies, bounce points and what the compression must know of the whole picture.
    ///
    /// # Errors
    /// [`BakeError`].
    pub fn new(part: Part<'s>, camera: &Camera, options: &BakeOptions) -> Result<Self, BakeError> {
        check_shape(camera, options.size)?;
        let patches = options.patch_set()?;
        let maps: Result<Vec<TestSky>, MapError> =
            options.test_maps.iter().map(|path| captured(path, &patches)).collect();
        let test_light = TestLight::new(held_out(&patches).into_iter().chain(maps?).collect());
        let transport = Transport::of(part, camera, patches, options.size, options.transport)?;
        let small_tiles = small_tiles(part, camera, patches, options)?;
        let samples: Vec<f32> = small_tiles.1.iter().flat_map(|tile| tile.response.iter().copied()).collect();
        let (skies, whites) = brightness(Prior::for_set(&patches), &samples);
        let stack_sun = options.stack_sun.map(|sun| (sun, sun_dir_world(sun, camera.north_deg)));
        let stack = options.stack.as_deref().map(|dir| {
            let dir = part.stack_folder.map_or(dir.to_owned(), |folder| dir.join(folder));
            let transport = &options.transport;
            let mut manifest =
                Manifest::new(&patches, options.size, transport.max_hits, transport.seed, camera.north_deg);
            manifest.sun =
                stack_sun.map(|([azimuth, altitude], dir)| ManifestSun::new(azimuth, altitude, dir.to_array()));
            StackWriter::create(&dir, manifest)
        });
        let stack = stack.transpose()?;
        Ok(Job {
            bounce: transport.bounce_points(),
            transport,
            small: small_picture(small_tiles, &test_light),
            compressor: BlockCompressor::new(skies, options.error, whites, CasterLayers::new(part.scene)),
            stack,
            stack_sun: stack_sun.map(|(_, dir)| SunDisc::new(dir)),
            test_light,
            patches,
            part,
            size: options.size,
        })
    }

    /// Columns and rows of its blocks.
    pub fn grid(&self) -> (u32, u32) {
        block_grid(self.size)
    }

    /// Number of its blocks.
    pub fn blocks(&self) -> u32 {
        block_count(self.size)
    }

    /// Transport, stack and compression of a block.
    ///
    /// # Errors
    /// [`BakeError`] of the stack.
    pub fn block(&self, number: u32) -> Result<DoneBlock, BakeError> {
        let place = (number % self.grid().0, number / self.grid().0);
        let (columns, rows) = self.transport.tiles();
        let edge = BLOCK_TILES as u32;
        let mut tiles = Vec::with_capacity(BLOCK_TILES * BLOCK_TILES);
        for ty in (place.1 * edge..(place.1 + 1) * edge).take_while(|&ty| ty < rows) {
            for tx in (place.0 * edge..(place.0 + 1) * edge).take_while(|&tx| tx < columns) {
                tiles.push(self.gathered((tx, ty), self.transport.tile(tx, ty))?);
            }
        }
        Ok(self.compressed(number, tiles))
    }

    /// A tile with what sunlight it gets by way of others; written to the stack.
    pub(crate) fn gathered(&self, at: (u32, u32), response: TileResponse) -> Result<BlockTile, BakeError> {
        let Gathered { bounce, sun } = self.transport.gather(&self.bounce, &response, self.stack_sun.as_ref());
        if let Some(stack) = &self.stack {
            let sun = self.stack_sun.as_ref().map(|disc| self.transport.sun_tile(&response, &sun, disc));
            stack.write_tile(&response, sun.as_deref())?;
        }
        Ok(BlockTile { at, response, bounce })
    }

    /// The block of these tiles, compressed.
    pub(crate) fn compressed(&self, number: u32, tiles: Vec<BlockTile>) -> DoneBlock {
        let exact = tiles.iter().map(|tile| self.test_light.sums(&tile.response.response)).collect();
        DoneBlock { number, block: self.compressor.block(tiles), exact }
    }
}

/// Makes the blocks `numbers` on all threads and hands each to `done`, in order and as soon as those before it are done.
///
/// # Errors
/// The first of `make` or `done`.
pub fn in_order<E: Send>(
    numbers: Range<u32>,
    bar: Option<&Progress>,
    make: impl Fn(u32) -> Result<DoneBlock, E> + Sync,
    done: impl FnMut(DoneBlock) -> Result<(), E> + Send,
) -> Result<(), E> {
    let in_order = Mutex::new(InOrder { next: numbers.start, waiting: BTreeMap::new(), done });
    // A bridge hands the numbers out in order, so that few blocks wait for one that takes long.
    numbers.par_bridge().try_for_each(|number| {
        let block = make(number)?;
        if let Some(bar) = bar {
            bar.step();
        }
        in_order.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take(block)
    })
}

/// Puts blocks in order.
struct InOrder<F> {
    next: u32,
    waiting: BTreeMap<u32, DoneBlock>,
    done: F,
}

impl<E, F: FnMut(DoneBlock) -> Result<(), E>> InOrder<F> {
    fn take(&mut self, block: DoneBlock) -> Result<(), E> {
        self.waiting.insert(block.number, block);
        while let Some(block) = self.waiting.remove(&self.next) {
            self.next += 1;
            (self.done)(block)?;
        }
        Ok(())
    }
}

/// Size and response of a small picture of the same view.
fn small_tiles(
    part: Part<'_>,
    camera: &Camera,
    patches: PatchSet,
    options: &BakeOptions,
) -> Result<((u32, u32), Vec<TileResponse>), BakeError> {
    let (width, height) = options.size;
    let times = (f64::from(width) * f64::from(height) / SMALL_PX).sqrt().floor().max(2.0) as u32;
    let size = (width.div_ceil(times), height.div_ceil(times));
    let small = Transport::of(part, camera, patches, size, options.transport)?;
    let (columns, rows) = small.tiles();
    let places: Vec<(u32, u32)> = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).collect();
    Ok((size, places.par_iter().map(|&(x, y)| small.tile(x, y)).collect()))
}

/// What the small picture shows under the held-out skies.
fn small_picture((size, tiles): ((u32, u32), Vec<TileResponse>), light: &TestLight) -> SmallPicture {
    let part = |tile: &TileResponse| {
        let at = |&index: &u16| (tile.place(index).into(), tile.coverage[usize::from(index)]);
        preview::Part { pixels: tile.covered.iter().map(at).collect(), exact: light.sums(&tile.response) }
    };
    SmallPicture { size, parts: tiles.iter().map(part).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_the_picture() {
        assert_eq!(block_grid((64, 48)), (2, 2));
        assert_eq!(block_grid((65, 32)), (3, 1));
        assert_eq!(block_count((1920, 1080)), 60 * 34);
    }
}
